//! Encoders of others beside ours under one call, for comparisons: BC7 by bc7e, BC6H by Intel's kernels.

use ctt_bc7enc_rdo as bc7e;

use super::{Quality, bc, bc6h, bc7, ispc};
use intel_tex_2::{RgbaSurface, bc6h as intel};

/// A BC7 encoder at one preset.
pub struct Encoder {
    pub name: &'static str,
    pub preset: &'static str,
    kind: Kind,
}

enum Kind {
    Ours(Quality),
    Bc7e(Box<ispc::Bc7Params>),
}

impl Encoder {
    /// Compresses blocks on the calling thread; without `alpha`, all of it is 255 and nobody reads it.
    pub fn compress(&self, blocks: &[[[u8; 4]; 16]], alpha: bool, out: &mut [[u8; 16]]) {
        match &self.kind {
            Kind::Ours(quality) => {
                let runs = blocks.chunks(256).zip(out.chunks_mut(256));
                for (blocks, out) in runs {
                    bc7::compress(blocks, *quality, alpha, out);
                }
            }
            Kind::Bc7e(params) => ispc::compress(params, blocks, out),
        }
    }
}

/// Our presets from the cheapest up, then those of bc7e, by its kernels for this machine.
pub fn all() -> Vec<Encoder> {
    let ours = Quality::ALL.map(|quality| Encoder {
        name: "Cairn",
        preset: quality.name(),
        kind: Kind::Ours(quality),
    });
    let bc7e = [
        ("ultrafast", bc7e::params_init_ultrafast(false)),
        ("veryfast", bc7e::params_init_veryfast(false)),
        ("fast", bc7e::params_init_fast(false)),
        ("basic", bc7e::params_init_basic(false)),
        ("slow", bc7e::params_init_slow(false)),
        ("veryslow", bc7e::params_init_veryslow(false)),
    ];
    let bc7e = bc7e.map(|(preset, params)| Encoder {
        name: "bc7e (ISPC, native)",
        preset,
        kind: Kind::Bc7e(Box::new(params)),
    });
    ours.into_iter().chain(bc7e).collect()
}

/// The texels of a BC7 block.
pub fn decode(block: &[u8; 16]) -> [[u8; 4]; 16] {
    bc::decode_bc7(block)
}

/// A BC6H encoder at one preset.
pub struct HalfEncoder {
    pub name: &'static str,
    pub preset: &'static str,
    kind: HalfKind,
}

enum HalfKind {
    Ours(Quality),
    Intel(intel::EncodeSettings),
}

/// Blocks of RGB half bits, in the layout that each encoder reads.
pub struct HalfBlocks {
    pub blocks: Vec<[[u16; 3]; 16]>,
    /// The blocks one beside the other, four rows of RGBA.
    surface: Vec<[u16; 4]>,
}

impl HalfBlocks {
    pub fn new(blocks: Vec<[[u16; 3]; 16]>) -> Self {
        let across = 4 * blocks.len();
        let texel = |at: usize| {
            let [r, g, b] = blocks[at % across / 4][at / across * 4 + at % 4];
            [r, g, b, 0]
        };
        Self {
            surface: (0..16 * blocks.len()).map(texel).collect(),
            blocks,
        }
    }
}

impl HalfEncoder {
    /// Compresses blocks on the calling thread.
    pub fn compress(&self, source: &HalfBlocks, out: &mut [[u8; 16]]) {
        match &self.kind {
            HalfKind::Ours(quality) => {
                let runs = source.blocks.chunks(256).zip(out.chunks_mut(256));
                for (blocks, out) in runs {
                    bc6h::compress(blocks, *quality, out);
                }
            }
            HalfKind::Intel(settings) => {
                let width = 4 * source.blocks.len() as u32;
                let surface = RgbaSurface {
                    data: bytemuck::cast_slice(&source.surface),
                    width,
                    height: 4,
                    stride: 8 * width,
                };
                intel::compress_blocks_into(settings, &surface, out.as_flattened_mut());
            }
        }
    }
}

/// Our presets from the cheapest up, then those of Intel's texture compressor, by its kernels for this machine.
pub fn all_half() -> Vec<HalfEncoder> {
    let ours = Quality::ALL.map(|quality| HalfEncoder {
        name: "Cairn",
        preset: quality.name(),
        kind: HalfKind::Ours(quality),
    });
    let intel = [
        ("very_fast", intel::very_fast_settings()),
        ("fast", intel::fast_settings()),
        ("basic", intel::basic_settings()),
        ("slow", intel::slow_settings()),
        ("very_slow", intel::very_slow_settings()),
    ];
    let intel = intel.map(|(preset, settings)| HalfEncoder {
        name: "Intel (ISPC, native)",
        preset,
        kind: HalfKind::Intel(settings),
    });
    ours.into_iter().chain(intel).collect()
}

/// The texels of a BC6H block, as half bits.
pub fn decode_half(block: &[u8; 16]) -> [[u16; 3]; 16] {
    bc6h::decompress_block(block)
}
