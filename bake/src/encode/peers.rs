//! Encoders of others beside ours under one call, for comparisons: BC7 by bc7e and Intel's kernels, BC6H by Intel's.

use ctt_bc7enc_rdo as bc7e;

use super::{Quality, bc, bc6h, bc7, ispc};
use intel_tex_2::{RgbaSurface, bc6h as intel_half, bc7 as intel};

const INTEL: &str = "Intel (ISPC, native)";

/// A BC7 encoder at one preset.
pub struct Encoder {
    pub name: &'static str,
    pub preset: &'static str,
    kind: Kind,
}

enum Kind {
    Ours(Quality),
    Bc7e(Box<ispc::Bc7Params>),
    /// Its settings for opaque images, and for others.
    Intel([intel::EncodeSettings; 2]),
}

/// Blocks of codes, in the layout that each encoder reads.
pub struct Blocks {
    pub blocks: Vec<[[u8; 4]; 16]>,
    surface: Vec<[u8; 4]>,
}

impl Blocks {
    pub fn new(blocks: Vec<[[u8; 4]; 16]>) -> Self {
        Self {
            surface: side_by_side(&blocks),
            blocks,
        }
    }
}

/// Blocks one beside the other, in four rows.
fn side_by_side<T: Copy>(blocks: &[[T; 16]]) -> Vec<T> {
    let across = 4 * blocks.len();
    let texel = |at: usize| blocks[at % across / 4][at / across * 4 + at % 4];
    (0..16 * blocks.len()).map(texel).collect()
}

/// The surface of `count` blocks of texels of `size` bytes.
fn surface(data: &[u8], count: usize, size: u32) -> RgbaSurface<'_> {
    let width = 4 * count as u32;
    RgbaSurface {
        data,
        width,
        height: 4,
        stride: size * width,
    }
}

impl Encoder {
    /// Compresses blocks on the calling thread; without `alpha`, all of it is 255 and nobody reads it.
    pub fn compress(&self, source: &Blocks, alpha: bool, out: &mut [[u8; 16]]) {
        let blocks = &source.blocks;
        match &self.kind {
            Kind::Ours(quality) => {
                let runs = blocks.chunks(256).zip(out.chunks_mut(256));
                for (blocks, out) in runs {
                    bc7::compress(blocks, *quality, alpha, out);
                }
            }
            Kind::Bc7e(params) => ispc::compress(params, blocks, out),
            Kind::Intel(settings) => {
                let surface = surface(source.surface.as_flattened(), blocks.len(), 4);
                intel::compress_blocks_into(
                    &settings[usize::from(alpha)],
                    &surface,
                    out.as_flattened_mut(),
                );
            }
        }
    }
}

/// Our presets from the cheapest up, then those of bc7e and of Intel's texture compressor, by their kernels for this
/// machine.
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
    let intel = [
        (
            "ultra_fast",
            intel::opaque_ultra_fast_settings(),
            intel::alpha_ultra_fast_settings(),
        ),
        (
            "very_fast",
            intel::opaque_very_fast_settings(),
            intel::alpha_very_fast_settings(),
        ),
        (
            "fast",
            intel::opaque_fast_settings(),
            intel::alpha_fast_settings(),
        ),
        (
            "basic",
            intel::opaque_basic_settings(),
            intel::alpha_basic_settings(),
        ),
        (
            "slow",
            intel::opaque_slow_settings(),
            intel::alpha_slow_settings(),
        ),
    ];
    let intel = intel.map(|(preset, opaque, alpha)| Encoder {
        name: INTEL,
        preset,
        kind: Kind::Intel([opaque, alpha]),
    });
    ours.into_iter().chain(bc7e).chain(intel).collect()
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
    Intel(intel_half::EncodeSettings),
}

/// Blocks of RGB half bits, in the layout that each encoder reads.
pub struct HalfBlocks {
    pub blocks: Vec<[[u16; 3]; 16]>,
    /// The blocks one beside the other, four rows of RGBA.
    surface: Vec<[u16; 4]>,
}

impl HalfBlocks {
    pub fn new(blocks: Vec<[[u16; 3]; 16]>) -> Self {
        let texels = side_by_side(&blocks).into_iter();
        Self {
            surface: texels.map(|[r, g, b]| [r, g, b, 0]).collect(),
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
                let data = bytemuck::cast_slice(&source.surface);
                let surface = surface(data, source.blocks.len(), 8);
                intel_half::compress_blocks_into(settings, &surface, out.as_flattened_mut());
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
        ("very_fast", intel_half::very_fast_settings()),
        ("fast", intel_half::fast_settings()),
        ("basic", intel_half::basic_settings()),
        ("slow", intel_half::slow_settings()),
        ("very_slow", intel_half::very_slow_settings()),
    ];
    let intel = intel.map(|(preset, settings)| HalfEncoder {
        name: INTEL,
        preset,
        kind: HalfKind::Intel(settings),
    });
    ours.into_iter().chain(intel).collect()
}

/// The texels of a BC6H block, as half bits.
pub fn decode_half(block: &[u8; 16]) -> [[u16; 3]; 16] {
    bc6h::decompress_block(block)
}
