//! Turns decoded images into block-compressed mip chains, with the error of what is stored.

mod bc;
mod bc5;
mod bc6h;
mod bc7;
mod coverage;
mod error;
mod hdr;
mod ispc;
mod mips;
mod role;
pub(crate) mod srgb;

use std::time::Instant;

use cairn_format::TextureFormat;
use cairn_format::texture::full_mip_count;
use rayon::prelude::*;
use serde::Serialize;

pub use error::AngleError;
pub use hdr::SkyFormat;
pub(crate) use hdr::unpack_rgb9e5;
pub use mips::MipFilter;
pub use role::Role;

use crate::scene::Wrap;
use mips::{Plane, Weighting};

/// Effort of the BC7 encoders: errors are about those of bc7e's ultrafast, veryfast and slow, which native kernels
/// are. BC5 has one setting, a search over f32 texels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub enum Quality {
    Fast,
    #[default]
    Default,
    Best,
}

/// Which encoders run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub enum Kernels {
    /// Our own encoders, whose arithmetic leaves processors no choice: the same bytes on every machine. BC7 takes
    /// two to three times as long as the native kernels.
    #[default]
    Reproducible,
    /// The ISPC kernels of BC7 for this machine. Their reciprocals are approximate, and differ even between vendors
    /// of one instruction set: the bytes depend on the CPU.
    Native,
}

/// Settings of `encode`; all of them, the role and the source decide the bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub struct EncodeOptions {
    pub quality: Quality,
    pub filter: MipFilter,
    pub kernels: Kernels,
}

/// What materials read from the alpha channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AlphaUse {
    /// Nothing: stored as opaque.
    Ignore,
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

/// What was lost and how long it took. All but the times is deterministic.
#[derive(rkyv::Archive, rkyv::Serialize, rkyv::Deserialize, Clone, Debug, PartialEq, Serialize)]
pub struct TextureReport {
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
    /// Coverage of each level as stored less that of the source; empty unless masked.
    pub alpha_coverage_delta: Vec<f64>,
    /// Wall time of the whole chain.
    pub seconds: f64,
    /// Texels of the whole chain a second.
    pub megapixels_per_second: f64,
}

/// Coverage is held within this share of the source's, where the level has enough texels for it.
const COVERAGE_TOLERANCE: f64 = 0.01;
/// Encodings of a masked level: block compression moves alpha, so the target is corrected by what came out.
const COVERAGE_ATTEMPTS: usize = 4;

/// Filters the full mip chain of an image and compresses every level. Deterministic: the bytes do not
/// depend on the number of threads nor, with reproducible kernels, on the x86-64 machine.
///
/// Mips are filtered in f32 from the level above: colour in linear light (weighted by alpha where it is
/// used), data as it is, normals as vectors that are normalised when they are stored.
///
/// # Panics
/// If the image is empty or `texels` is not `width * height` long.
pub fn encode(source: &Source, role: Role, options: &EncodeOptions) -> EncodedTexture {
    let start = Instant::now();
    let mut chain = Chain::new(source, role, options);
    for level in 0..full_mip_count(source.width, source.height) {
        if level > 0 {
            chain.descend();
        }
        chain.push_level();
    }
    chain.finish(start.elapsed().as_secs_f64())
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

/// A chain in the making: the level reached, and what was stored so far.
struct Chain<'a> {
    source: &'a Source<'a>,
    role: Role,
    options: &'a EncodeOptions,
    plane: Plane,
    levels: Vec<Vec<u8>>,
    errors: Vec<error::LevelError>,
    mean_lengths: Vec<f64>,
    coverages: Vec<f64>,
    /// Coverage of the source.
    coverage: f64,
    texels: u64,
}

impl<'a> Chain<'a> {
    fn new(source: &'a Source, role: Role, options: &'a EncodeOptions) -> Self {
        assert!(source.width > 0 && source.height > 0, "the image is empty");
        assert_eq!(
            source.texels.len() as u64,
            u64::from(source.width) * u64::from(source.height)
        );
        let opaque = source.alpha == AlphaUse::Ignore;
        let plane = Plane {
            width: source.width,
            height: source.height,
            texels: source
                .texels
                .par_iter()
                .map(|&texel| {
                    let [x, y, z, alpha] = role.filterable(texel);
                    [x, y, z, if opaque { 1.0 } else { alpha }]
                })
                .collect(),
        };
        let mut chain = Self {
            source,
            role,
            options,
            plane,
            levels: Vec::new(),
            errors: Vec::new(),
            mean_lengths: Vec::new(),
            coverages: Vec::new(),
            coverage: 0.0,
            texels: 0,
        };
        if let Some(grid) = chain.mask() {
            chain.coverage = grid.coverage(&coverage::scaled(&chain.alpha(), 1.0));
        }
        chain
    }

    fn wrap(&self) -> [Wrap; 2] {
        [self.source.wrap_u, self.source.wrap_v]
    }

    fn alpha(&self) -> Vec<f32> {
        self.plane.texels.par_iter().map(|texel| texel[3]).collect()
    }

    /// The alpha test of the current level. BC5 has no alpha.
    fn mask(&self) -> Option<coverage::Grid> {
        match self.source.alpha {
            AlphaUse::Mask { cutoff } if self.role != Role::Normal => Some(coverage::Grid {
                width: self.plane.width,
                height: self.plane.height,
                wrap: self.wrap(),
                cutoff,
            }),
            _ => None,
        }
    }

    fn descend(&mut self) {
        let weighting = match (self.role, self.source.alpha) {
            (Role::Normal, _) => Weighting::Signed,
            (_, AlphaUse::Ignore | AlphaUse::Value) => Weighting::Plain,
            _ => Weighting::Alpha,
        };
        self.plane = mips::halve(&self.plane, self.options.filter, self.wrap(), weighting);
    }

    fn push_level(&mut self) {
        let mut codes: Vec<[u8; 4]> = self
            .plane
            .texels
            .par_iter()
            .map(|&texel| self.role.codes(texel))
            .collect();
        let (blocks, scale) = match self.mask() {
            None => (self.compress(&codes), 1.0),
            Some(grid) => {
                let (blocks, scale, coverage) = self.compress_masked(&grid, &mut codes);
                self.coverages.push(coverage);
                (blocks, scale)
            }
        };
        if self.role == Role::Normal {
            self.mean_lengths.push(mean_length(&self.plane.texels));
        }
        self.errors.push(self.measure(&blocks, scale));
        self.texels += self.plane.texels.len() as u64;
        self.levels.push(blocks);
    }

    fn compress(&self, codes: &[[u8; 4]]) -> Vec<u8> {
        let image = bc::Image {
            width: self.plane.width,
            height: self.plane.height,
            codes,
            exact: &self.plane.texels,
        };
        bc::compress(self.role, &image, self.options)
    }

    /// The blocks of a masked level, the factor on its alpha, and its coverage as decoded. Level 0 keeps
    /// its alpha; below, alpha is scaled until the coverage of the decoded blocks is the source's.
    fn compress_masked(&self, grid: &coverage::Grid, codes: &mut [[u8; 4]]) -> (Vec<u8>, f32, f64) {
        let encode = |codes: &[[u8; 4]]| {
            let blocks = self.compress(codes);
            let alpha = bc::decode_alpha(&blocks, grid.width, grid.height);
            (blocks, grid.coverage(&alpha))
        };
        if self.levels.is_empty() {
            let (blocks, coverage) = encode(codes);
            return (blocks, 1.0, coverage);
        }
        let alpha = self.alpha();
        let mut target = self.coverage;
        let mut best: Option<(Vec<u8>, f32, f64)> = None;
        let distance = |coverage: f64| (coverage - self.coverage).abs();
        for _ in 0..COVERAGE_ATTEMPTS {
            let scale = grid.scale_to(&alpha, target);
            if best.as_ref().is_some_and(|best| best.1 == scale) {
                break;
            }
            for (code, alpha) in codes.iter_mut().zip(coverage::scaled(&alpha, scale)) {
                code[3] = alpha;
            }
            let (blocks, coverage) = encode(codes);
            if best
                .as_ref()
                .is_none_or(|best| distance(coverage) < distance(best.2))
            {
                best = Some((blocks, scale, coverage));
            }
            if distance(coverage) <= COVERAGE_TOLERANCE * self.coverage {
                break;
            }
            target = (target + self.coverage - coverage).clamp(0.0, 1.0);
        }
        best.expect("there is at least one attempt")
    }

    fn measure(&self, blocks: &[u8], alpha_scale: f32) -> error::LevelError {
        let role = self.role;
        let channels = match (role, self.source.alpha) {
            (Role::Normal, _) => 2,
            (_, AlphaUse::Ignore) => 3,
            _ => 4,
        };
        let top = self.levels.is_empty();
        let stored = |index: usize| match role {
            // The source itself, which spares the transfer function there and back.
            Role::Color | Role::Data if top => {
                self.source.texels[index].map(|code| f32::from(code) / 65535.0)
            }
            _ => {
                let [x, y, z, alpha] = role.stored(self.plane.texels[index]);
                [x, y, z, (alpha * alpha_scale).min(1.0)]
            }
        };
        error::Level {
            role,
            width: self.plane.width,
            height: self.plane.height,
            blocks,
            exact: &self.plane.texels,
            stored,
            channels,
        }
        .measure()
    }

    fn finish(self, seconds: f64) -> EncodedTexture {
        let top = self.errors[0];
        EncodedTexture {
            format: self.role.format(),
            width: self.source.width,
            height: self.source.height,
            levels: self.levels,
            report: TextureReport {
                psnr_db: top.psnr_db,
                level_psnr_db: self.errors.iter().map(|error| error.psnr_db).collect(),
                psnr_linear_light_db: top.psnr_linear_light_db,
                p99_block_rmse: top.p99_block_rmse,
                normal_angle_deg: top.angle_deg,
                normal_mean_length: self.mean_lengths,
                alpha_coverage_delta: self
                    .coverages
                    .iter()
                    .map(|coverage| coverage - self.coverage)
                    .collect(),
                seconds,
                megapixels_per_second: self.texels as f64 / 1e6 / seconds.max(1e-9),
            },
        }
    }
}

fn mean_length(texels: &[[f32; 4]]) -> f64 {
    let sum: f64 = texels
        .iter()
        .map(|&[x, y, z, _]| f64::from((x * x + y * y + z * z).sqrt()))
        .sum();
    sum / texels.len() as f64
}

#[cfg(test)]
mod tests;
