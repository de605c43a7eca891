//! BC7 encoders under one call, ours and bc7e's, for comparisons.

use ctt_bc7enc_rdo as bc7e;

use super::{Quality, bc, bc7, ispc};

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
