//! A mip chain in the making: the level reached, and what was stored so far.

use cairn_format::TextureFormat;
use cairn_format::texture::{full_mip_count, mip_extent};
use rayon::prelude::*;

use super::mips::{self, Plane, Weighting};
use super::role::unorm8;
use super::{AlphaUse, Codec, EncodeOptions, EncodedTexture, Role, Source, TextureReport};
use super::{Altered, bc, bleed, coverage, error, masked};
use crate::scene::Wrap;

mod pass;

pub use pass::Universal;

/// See the module.
pub(super) struct Chain<'a> {
    source: &'a Source<'a>,
    role: Role,
    options: &'a EncodeOptions,
    plane: Plane,
    /// Whether level 0 is no longer the source's own texels.
    altered: bool,
    codec: Codec,
    /// Whether a level that was encoded has decided the encoder.
    chosen: bool,
    universal: Option<Universal<'a>>,
    /// What level 0 is stored by, where that is no encoder.
    first: Option<Codec>,
    /// Why levels of the file are encoded again.
    altered_levels: Vec<Altered>,
    /// Stored channels of pairs and normals.
    places: [usize; 2],
    missed_db: Option<f64>,
    levels: Vec<Vec<u8>>,
    errors: Vec<error::LevelError>,
    mean_lengths: Vec<f64>,
    coverages: Vec<f64>,
    /// Coverage of the source.
    coverage: f64,
    texels: u64,
}

impl<'a> Chain<'a> {
    pub fn new(
        source: &'a Source,
        universal: Option<Universal<'a>>,
        role: Role,
        options: &'a EncodeOptions,
    ) -> Self {
        assert!(source.width > 0 && source.height > 0, "the image is empty");
        assert_eq!(
            source.texels.len() as u64,
            u64::from(source.width) * u64::from(source.height)
        );
        let size = [source.width, source.height];
        let mut plane = plane(source.texels, size, role, source.alpha);
        let opacity = matches!(source.alpha, AlphaUse::Blend | AlphaUse::Mask { .. });
        let altered = opacity && role != Role::Normal && bleed::bleed(&mut plane);
        let levels = full_mip_count(source.width, source.height) as usize;
        let mut chain = Self {
            source,
            role,
            options,
            plane,
            altered,
            codec: Codec::allowed(role, options)[0],
            chosen: false,
            universal,
            first: None,
            altered_levels: Vec::new(),
            places: role.pair_channels(options.target),
            missed_db: None,
            levels: Vec::with_capacity(levels),
            errors: Vec::with_capacity(levels),
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

    fn format(&self) -> TextureFormat {
        self.role.format(self.options.target)
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

    /// Goes on to the next level.
    pub fn descend(&mut self) {
        let weighting = match (self.role, self.source.alpha) {
            (Role::Normal, _) => Weighting::Signed,
            (_, AlphaUse::Ignore | AlphaUse::Opaque | AlphaUse::Value) => Weighting::Plain,
            _ => Weighting::Alpha,
        };
        self.plane = mips::halve(&self.plane, self.options.filter, self.wrap(), weighting);
    }

    /// Goes on to a level that the source has.
    pub fn take(&mut self, texels: &[[u16; 4]]) {
        let [width, height] = [self.plane.width, self.plane.height].map(|size| mip_extent(size, 1));
        assert_eq!(texels.len(), width as usize * height as usize);
        self.plane = plane(texels, [width, height], self.role, self.source.alpha);
        self.altered = true;
    }

    /// Stores the level as the file has it, or else compresses and measures it; the first one decides the encoder.
    pub fn push_level(&mut self) {
        if self.pass_level() {
            return;
        }
        let mut codes: Vec<[u8; 4]> = self
            .plane
            .texels
            .par_iter()
            .map(|&texel| self.role.codes(texel))
            .collect();
        let (blocks, error) = match self.mask() {
            Some(grid) if !self.levels.is_empty() && !self.options.plain_alpha => {
                let coverage = self.coverage;
                let compress = |codes: &[[u8; 4]]| self.compress(self.codec, codes);
                let found = masked::keep(
                    self.format(),
                    &grid,
                    &self.alpha(),
                    coverage,
                    &mut codes,
                    &compress,
                );
                self.coverages.push(found.coverage);
                let error = self.measure(&found.blocks, Some(&found.alpha));
                (found.blocks, error)
            }
            mask => {
                let (blocks, error) = self.choose(&codes);
                if let Some(grid) = mask {
                    let alpha = bc::decode_alpha(self.format(), &blocks, grid.width, grid.height);
                    self.coverages.push(grid.coverage(&alpha));
                }
                (blocks, error)
            }
        };
        self.store(blocks, error);
    }

    fn store(&mut self, blocks: Vec<u8>, error: error::LevelError) {
        self.errors.push(error);
        if self.role == Role::Normal {
            self.mean_lengths.push(mean_length(&self.plane.texels));
        }
        self.texels += self.plane.texels.len() as u64;
        self.levels.push(blocks);
    }

    /// The blocks of a level and their error. At the first one that is encoded the cheapest encoder that reaches the
    /// PSNR asked for is chosen, or else the best.
    fn choose(&mut self, codes: &[[u8; 4]]) -> (Vec<u8>, error::LevelError) {
        let target = self.options.effort.target_db();
        let allowed = match target {
            Some(_) if !self.chosen => Codec::allowed(self.role, self.options),
            _ => vec![self.codec],
        };
        let mut best: Option<(Vec<u8>, error::LevelError)> = None;
        for codec in allowed {
            let blocks = self.compress(codec, codes);
            let error = self.measure(&blocks, None);
            let better = best
                .as_ref()
                .is_none_or(|best| error.psnr_db > best.1.psnr_db);
            if better {
                self.codec = codec;
                best = Some((blocks, error));
            }
            if target.is_some_and(|target| error.psnr_db >= target) {
                break;
            }
        }
        self.chosen = true;
        let (blocks, error) = best.expect("a role has an encoder");
        if self.levels.is_empty() {
            let lacks = target.map(|target| target - error.psnr_db);
            self.missed_db = lacks.filter(|lacks| *lacks > 0.0);
        }
        (blocks, error)
    }

    fn compress(&self, codec: Codec, codes: &[[u8; 4]]) -> Vec<u8> {
        let image = bc::Image {
            width: self.plane.width,
            height: self.plane.height,
            codes,
            exact: &self.plane.texels,
            alpha_is_read: self.source.alpha != AlphaUse::Ignore,
        };
        // Normals beside those of a file that has them as colour.
        let role = match self.role {
            Role::Normal if self.places != Role::Normal.pair_channels(self.options.target) => {
                Role::Data
            }
            role => role,
        };
        codec.compress(role, &image)
    }

    /// The error of a level's blocks; `alpha` stands for the filtered alpha where it was changed.
    fn measure(&self, blocks: &[u8], alpha: Option<&[f32]>) -> error::LevelError {
        self.measure_at(blocks, alpha, self.places)
    }

    /// As [`Self::measure`], of pairs and normals in the channels `places`.
    fn measure_at(
        &self,
        blocks: &[u8],
        alpha: Option<&[f32]>,
        places: [usize; 2],
    ) -> error::LevelError {
        let role = self.role;
        let reads_alpha = !matches!(self.source.alpha, AlphaUse::Ignore | AlphaUse::Opaque);
        let channels = role.channels(reads_alpha);
        let own = self.levels.is_empty() && !self.altered;
        let stored = |index: usize| match role {
            // The source itself, which spares the transfer function there and back.
            _ if own && role != Role::Normal => {
                self.source.texels[index].map(|code| f32::from(code) / 65535.0)
            }
            _ => {
                let mut stored = role.stored(self.plane.texels[index]);
                if let Some(alpha) = alpha {
                    stored[3] = alpha[index];
                }
                stored
            }
        };
        error::Level {
            role,
            format: self.format(),
            places,
            width: self.plane.width,
            height: self.plane.height,
            blocks,
            exact: &self.plane.texels,
            stored,
            channels,
        }
        .measure()
    }

    /// The finished chain, made in `seconds`.
    pub fn finish(self, seconds: f64) -> EncodedTexture {
        let top = self.errors[0];
        let masked = self.mask().is_some();
        EncodedTexture {
            format: self.format(),
            width: self.source.width,
            height: self.source.height,
            levels: self.levels,
            report: TextureReport {
                codec: self.first.unwrap_or(self.codec),
                altered_levels: self.altered_levels,
                missed_db: self.missed_db,
                psnr_db: top.psnr_db,
                level_psnr_db: self.errors.iter().map(|error| error.psnr_db).collect(),
                psnr_linear_light_db: top.psnr_linear_light_db,
                p99_block_rmse: top.p99_block_rmse,
                normal_angle_deg: top.angle_deg,
                normal_mean_length: self.mean_lengths,
                widening: None,
                alpha_coverage: masked.then_some(self.coverage),
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

/// Texels in the space they are filtered in; where nothing reads alpha, it is one.
pub(super) fn plane(
    texels: &[[u16; 4]],
    [width, height]: [u32; 2],
    role: Role,
    alpha: AlphaUse,
) -> Plane {
    let opaque = matches!(alpha, AlphaUse::Ignore | AlphaUse::Opaque);
    let texels = texels.par_iter().map(|&texel| {
        let [x, y, z, alpha] = role.filterable(texel);
        [x, y, z, if opaque { 1.0 } else { alpha }]
    });
    Plane {
        width,
        height,
        texels: texels.collect(),
    }
}

fn mean_length(texels: &[[f32; 4]]) -> f64 {
    let sum: f64 = texels
        .iter()
        .map(|&[x, y, z, _]| f64::from((x * x + y * y + z * z).sqrt()))
        .sum();
    sum / texels.len() as f64
}
