//! Levels of alpha-tested textures whose decoded alpha covers as much as the source's.
//!
//! Filtered alpha is scaled first (Castaño, "Computing Alpha Mipmaps", 2010). Where the few values of a small or
//! regular level leave a scale no choice, its texels are told apart instead: an affine map keeps their order, spreads
//! them about the cutoff, and splits equal ones by an ordered dither, so that the threshold can pass between any two
//! (compare Yuksel, "Alpha Distribution for Alpha Testing", 2018). A level of one texel covers all or nothing; it is
//! put at the cutoff itself, so that trilinear reads between it and the level above still cut where that one does.

use cairn_format::TextureFormat;

use super::bc;
use super::coverage::{Grid, scaled};

/// Coverage is held within this share of the source's.
const TOLERANCE: f64 = 0.01;
/// Encodings of a scaled level: block compression moves alpha, so the target is corrected by what came out.
const ATTEMPTS: usize = 4;
/// Encodings of a level of spread texels.
const BISECTIONS: usize = 14;
/// How far from the cutoff spread alpha goes: enough for eight-bit codes, little enough for smooth transitions.
/// Each falls on other codes; the next is tried where one does not come near enough.
const REACHES: [f32; 3] = [0.35, 0.25, 0.45];
/// Least distance of the extremes before spreading, as a share of alpha: closer ones are dithered.
const LEAST_SPREAD: f32 = 1.0 / 32.0;

/// A level and what it covers.
pub(super) struct Kept {
    pub blocks: Vec<u8>,
    /// The alpha that was encoded, in [0,1].
    pub alpha: Vec<f32>,
    /// Of the decoded blocks.
    pub coverage: f64,
}

/// Encodes a level below the first, its alpha changed until the decoded blocks cover `target`. `codes` get the
/// alpha of the last attempt.
pub(super) fn keep(
    format: TextureFormat,
    grid: &Grid,
    alpha: &[f32],
    target: f64,
    codes: &mut [[u8; 4]],
    compress: &dyn Fn(&[[u8; 4]]) -> Vec<u8>,
) -> Kept {
    let mut search = Search {
        format,
        grid,
        target,
        codes,
        compress,
        best: None,
    };
    if alpha.len() == 1 {
        search.attempt(&[at_cutoff(grid.cutoff, target)]);
    } else {
        search.scale(alpha);
        if !search.is_near() {
            for reach in REACHES {
                search.spread(alpha, reach);
            }
        }
    }
    search.best.expect("there is at least one attempt")
}

/// The code nearest to the cutoff on the side of the larger share.
fn at_cutoff(cutoff: f32, target: f64) -> f32 {
    let opaque = (f64::from(cutoff) * 255.0).ceil();
    let code = if target >= 0.5 { opaque } else { opaque - 1.0 };
    (code.clamp(0.0, 255.0) / 255.0) as f32
}

struct Search<'a> {
    format: TextureFormat,
    grid: &'a Grid,
    target: f64,
    codes: &'a mut [[u8; 4]],
    compress: &'a dyn Fn(&[[u8; 4]]) -> Vec<u8>,
    best: Option<Kept>,
}

impl Search<'_> {
    fn distance(&self, coverage: f64) -> f64 {
        (coverage - self.target).abs()
    }

    fn is_near(&self) -> bool {
        let limit = TOLERANCE * self.target;
        self.best
            .as_ref()
            .is_some_and(|best| self.distance(best.coverage) <= limit)
    }

    /// Encodes alpha in [0,1] and keeps it where it is nearer; its coverage.
    fn attempt(&mut self, alpha: &[f32]) -> f64 {
        for (code, alpha) in self.codes.iter_mut().zip(scaled(alpha, 1.0)) {
            code[3] = alpha;
        }
        let blocks = (self.compress)(self.codes);
        let decoded = bc::decode_alpha(self.format, &blocks, self.grid.width, self.grid.height);
        let coverage = self.grid.coverage(&decoded);
        let better = self
            .best
            .as_ref()
            .is_none_or(|best| self.distance(coverage) < self.distance(best.coverage));
        if better {
            self.best = Some(Kept {
                blocks,
                alpha: alpha.to_vec(),
                coverage,
            });
        }
        coverage
    }

    fn scale(&mut self, alpha: &[f32]) {
        let mut target = self.target;
        let mut last = None;
        for _ in 0..ATTEMPTS {
            let scale = self.grid.scale_to(alpha, target);
            if last == Some(scale) {
                return;
            }
            last = Some(scale);
            let changed: Vec<f32> = alpha.iter().map(|a| (a * scale).clamp(0.0, 1.0)).collect();
            let coverage = self.attempt(&changed);
            if self.is_near() {
                return;
            }
            target = (target + self.target - coverage).clamp(0.0, 1.0);
        }
    }

    /// Bisects the value that is mapped to the cutoff.
    fn spread(&mut self, alpha: &[f32], reach: f32) {
        let cutoff = self.grid.cutoff;
        let values = told_apart(alpha, self.grid.width as usize);
        let (mut low, mut high) = extremes(&values);
        let gain = 2.0 * reach / (high - low).max(f32::MIN_POSITIVE);
        for _ in 0..BISECTIONS {
            if self.is_near() {
                return;
            }
            let middle = 0.5 * (low + high);
            let changed: Vec<f32> = values
                .iter()
                .map(|value| (cutoff + gain * (value - middle)).clamp(0.0, 1.0))
                .collect();
            if self.attempt(&changed) < self.target {
                high = middle;
            } else {
                low = middle;
            }
        }
    }
}

fn extremes(values: &[f32]) -> (f32, f32) {
    let fold = |(least, most): (f32, f32), &value: &f32| (least.min(value), most.max(value));
    values.iter().fold((f32::MAX, f32::MIN), fold)
}

/// `alpha`, dithered where its values lie too close.
fn told_apart(alpha: &[f32], width: usize) -> Vec<f32> {
    let (least, most) = extremes(alpha);
    let lack = (LEAST_SPREAD - (most - least)).max(0.0);
    alpha
        .iter()
        .enumerate()
        .map(|(index, alpha)| alpha + lack * dither(index % width, index / width))
        .collect()
}

/// Ordered dither in [0,1): the bits of `x ^ y` and `y`, the lowest first (Bayer 1973), over 64x64 texels.
fn dither(x: usize, y: usize) -> f32 {
    let (mut value, mut bit) = (0.0, 0.5);
    for level in 0..6 {
        for source in [x ^ y, y] {
            value += bit * (source >> level & 1) as f32;
            bit *= 0.5;
        }
    }
    value
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::encode::{Codec, Kernels, Quality, Role};
    use crate::scene::Wrap;

    fn kept(width: u32, height: u32, cutoff: f32, alpha: &[f32], target: f64) -> Kept {
        let grid = Grid {
            width,
            height,
            wrap: [Wrap::Repeat; 2],
            cutoff,
        };
        let mut codes = vec![[80, 120, 60, 0]; alpha.len()];
        let compress = |codes: &[[u8; 4]]| {
            let image = bc::Image {
                width,
                height,
                codes,
                exact: &[],
                alpha_is_read: true,
            };
            Codec::Bc7 {
                quality: Quality::Default,
                kernels: Kernels::Reproducible,
            }
            .compress(Role::Color, &image)
        };
        keep(
            TextureFormat::Bc7Srgb,
            &grid,
            alpha,
            target,
            &mut codes,
            &compress,
        )
    }

    /// BC7 holds eight values of alpha a block, which is why a whole block of equal texels may be 2 % off.
    #[test]
    fn equal_texels_cover_any_share_from_two_on() {
        for (width, height) in [(2, 1), (1, 2), (2, 2), (4, 4), (8, 2), (3, 5), (16, 16)] {
            for cutoff in [0.2, 0.5, 0.75] {
                for target in [0.1, 0.43, 0.5, 0.8] {
                    let alpha = vec![target as f32; (width * height) as usize];
                    let coverage = kept(width, height, cutoff, &alpha, target).coverage;
                    assert!(
                        (coverage - target).abs() <= 0.02,
                        "{width}x{height}, cutoff {cutoff}: {coverage} for {target}"
                    );
                }
            }
        }
    }

    #[test]
    fn one_texel_is_at_the_cutoff() {
        for (target, code, coverage) in [(0.43, 127.0, 0.0), (0.57, 128.0, 1.0)] {
            let found = kept(1, 1, 0.5, &[0.9], target);
            assert_eq!(found.coverage, coverage);
            assert_eq!(found.alpha, [code / 255.0]);
        }
        assert_eq!(at_cutoff(0.0, 0.0), 0.0);
        assert_eq!(at_cutoff(1.5, 1.0), 1.0);
    }

    #[test]
    fn nothing_and_everything_stay() {
        for target in [0.0, 1.0] {
            let found = kept(4, 4, 0.5, &[target as f32; 16], target);
            assert_eq!(found.coverage, target);
        }
    }

    #[test]
    fn the_dither_takes_every_value_once() {
        let values: BTreeSet<u32> = (0..64 * 64)
            .map(|index| (dither(index % 64, index / 64) * 4096.0) as u32)
            .collect();
        assert_eq!(values.len(), 4096);
        assert_eq!(values.last(), Some(&4095));
    }
}
