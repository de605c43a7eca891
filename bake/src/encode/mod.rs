//! Turns decoded images into block-compressed mip chains, with the error of what is stored.

mod bc;
mod bc5;
mod bc6h;
mod bc7;
mod bleed;
mod chain;
mod codec;
mod coverage;
mod error;
mod hdr;
mod ispc;
mod masked;
mod mips;
mod partition;
pub mod peers;
mod role;
mod settings;
pub(crate) mod srgb;
pub mod toksvig;
mod uastc;
mod wide;

use std::time::Instant;

use cairn_format::TextureFormat;
use cairn_format::texture::full_mip_count;
use serde::Serialize;

pub use chain::Universal;
pub use codec::Codec;
pub use error::AngleError;
pub use hdr::{LogError, RadianceError, SkyFormat};
pub(crate) use hdr::{half_bits, unpack_rgb9e5};
pub use mips::MipFilter;
pub use role::Role;
pub use settings::{Effort, EncodeOptions, Kernels, Quality, Target, native_isa};

use crate::scene::Wrap;
use chain::Chain;
use toksvig::WideningReport;

/// What materials read from the alpha channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AlphaUse {
    /// Nothing: stored as opaque, or as 254 of 255 where that serves colour.
    Ignore,
    /// It is 1 everywhere, and stays so exactly.
    Opaque,
    /// A value of its own, which weighs nothing.
    Value,
    /// Opacity.
    Blend,
    /// An alpha test, opaque where `alpha >= cutoff`. The cutoff is on the texture's own alpha: the
    /// material's divided by the alpha of its base colour factor.
    Mask { cutoff: f32 },
}

/// A decoded image and how it is sampled.
#[derive(Clone, Copy, Debug)]
pub struct Source<'a> {
    pub width: u32,
    pub height: u32,
    /// 16-bit RGBA as the file has it (sRGB for colour), rows top to bottom; 8-bit values times 257.
    pub texels: &'a [[u16; 4]],
    pub wrap_u: Wrap,
    pub wrap_v: Wrap,
    pub alpha: AlphaUse,
}

/// A full mip chain in one block format.
#[derive(rkyv::Archive, rkyv::Serialize, rkyv::Deserialize, Clone, Debug, PartialEq)]
pub struct EncodedTexture {
    pub format: TextureFormat,
    pub width: u32,
    pub height: u32,
    /// Level 0 first, down to 1x1, each of `format.level_bytes` of its size.
    pub levels: Vec<Vec<u8>>,
    pub report: TextureReport,
}

/// Why blocks of a file are not stored as they are.
#[derive(
    rkyv::Archive,
    rkyv::Serialize,
    rkyv::Deserialize,
    Clone,
    Copy,
    Debug,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    Serialize,
)]
#[serde(rename_all = "kebab-case")]
pub enum Altered {
    /// Colour bled under zero alpha.
    Bled,
    /// The constant image became one texel.
    Constant,
    /// The alpha test would pass more or less of it than of level 0.
    Coverage,
    /// Its normals are not of unit length, from which shaders rebuild z.
    NotUnit,
    /// It shares an image with another.
    Packed,
}

impl Altered {
    /// As reports have it.
    pub const fn reason(self) -> &'static str {
        match self {
            Self::Bled => "colour bled under zero alpha",
            Self::Constant => "constant",
            Self::Coverage => "alpha coverage",
            Self::NotUnit => "normals not of unit length",
            Self::Packed => "packed with another image",
        }
    }
}

/// What was lost and how long it took. All but the times is deterministic.
#[derive(rkyv::Archive, rkyv::Serialize, rkyv::Deserialize, Clone, Debug, PartialEq, Serialize)]
pub struct TextureReport {
    /// The encoder that was chosen.
    #[serde(skip)]
    pub codec: Codec,
    /// Why levels that the source has in the package's kind of blocks were encoded again, one entry a level.
    pub altered_levels: Vec<Altered>,
    /// Decibels that level 0 lacks of the PSNR asked for, where no preset reaches it.
    pub missed_db: Option<f64>,
    /// Of level 0, on the stored values in 0..=1 (sRGB-encoded for colour): RGB, RGBA where alpha is used,
    /// or xy. Decibels; infinite where nothing was lost.
    pub psnr_db: f64,
    /// The same for every level, against the f32 mip it was made of.
    pub level_psnr_db: Vec<f64>,
    /// Of level 0, RGB in linear light; colour only.
    pub psnr_linear_light_db: Option<f64>,
    /// Of level 0: 99th percentile over blocks of the RMS error, in steps of 1/255.
    pub p99_block_rmse: f64,
    /// Of level 0, with z rebuilt as the shader does; normals only.
    pub normal_angle_deg: Option<AngleError>,
    /// Mean length of the averaged normals of each level: 1 where the surface under a texel is flat, less
    /// the more its normals spread. Empty unless normals.
    pub normal_mean_length: Vec<f64>,
    /// What averaged normals did to roughness, where `EncodeOptions::toksvig` asks for it and the texture holds some.
    pub widening: Option<WideningReport>,
    /// Share of the source that passes the alpha test, where it is masked.
    pub alpha_coverage: Option<f64>,
    /// Coverage of each level as stored less that of the source; empty unless masked. A level of one texel has
    /// coverage 0 or 1.
    pub alpha_coverage_delta: Vec<f64>,
    /// Wall time of the whole chain.
    pub seconds: f64,
    /// Texels of the whole chain a second.
    pub megapixels_per_second: f64,
}

/// Filters the full mip chain of an image and compresses every level. Deterministic: the bytes do not
/// depend on the number of threads nor, with reproducible kernels, on the x86-64 machine.
///
/// Mips are filtered in f32 from the level above: colour in linear light (weighted by alpha where it is
/// used), data as it is, normals as vectors that are normalised when they are stored. Colour under no alpha is
/// replaced by that of its surroundings, so that bilinear reads at borders see sensible colour.
///
/// # Panics
/// If the image is empty or `texels` is not `width * height` long.
pub fn encode(source: &Source, role: Role, options: &EncodeOptions) -> EncodedTexture {
    encode_levels(source, &[], None, role, options)
}

/// As [`encode`], with levels 1, 2, ... of `smaller` instead of filtered ones, as far as there are any. Levels of
/// `universal` that show what would be encoded are stored as they are, or rewritten, as the target asks.
///
/// # Panics
/// Those of [`encode`], and if a smaller level is not of its size.
pub fn encode_levels(
    source: &Source,
    smaller: &[Vec<[u16; 4]>],
    universal: Option<Universal>,
    role: Role,
    options: &EncodeOptions,
) -> EncodedTexture {
    let start = Instant::now();
    let mut chain = Chain::new(source, universal, role, options);
    for level in 0..full_mip_count(source.width, source.height) {
        match (level as usize)
            .checked_sub(1)
            .map(|level| smaller.get(level))
        {
            None => {}
            Some(Some(texels)) => chain.take(texels),
            Some(None) => chain.descend(),
        }
        chain.push_level();
    }
    chain.finish(start.elapsed().as_secs_f64())
}

/// Levels 1, 2, ... of data, filtered as [`encode`] does.
pub fn data_levels(source: &Source, filter: MipFilter) -> Vec<Vec<[u16; 4]>> {
    let size = [source.width, source.height];
    let mut plane = chain::plane(source.texels, size, Role::Data, source.alpha);
    let wrap = [source.wrap_u, source.wrap_v];
    (1..full_mip_count(source.width, source.height))
        .map(|_| {
            plane = mips::halve(&plane, filter, wrap, mips::Weighting::Plain);
            let texels = plane.texels.iter();
            texels.map(|texel| texel.map(role::unorm16)).collect()
        })
        .collect()
}

/// The only value of a constant image. Alpha counts, whatever `source.alpha` says.
pub fn constant_value(source: &Source) -> Option<[u16; 4]> {
    let (&first, rest) = source.texels.split_first()?;
    rest.iter().all(|&texel| texel == first).then_some(first)
}

/// Whether every texel has full alpha.
pub fn is_opaque(texels: &[[u16; 4]]) -> bool {
    texels.iter().all(|texel| texel[3] == u16::MAX)
}

#[cfg(test)]
mod tests;
