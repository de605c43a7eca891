//! Turns the length that averaged normals lose into roughness: what a mip no longer shows of a bumpy surface as shape,
//! it shows as gloss.
//!
//! Over the footprint of a texel, unit normals `n` have the mean `m`, and `1 - |m|^2` is their spread (Toksvig,
//! "Mipmapping Normal Maps", 2005). As a von Mises-Fisher lobe its concentration is `|m| (3 - |m|^2) / (1 - |m|^2)`
//! (Banerjee et al., "Clustering on the Unit Hypersphere", 2005), the inverse of the variance of slopes along an axis;
//! twice that variance adds to the square of GGX's alpha, which is roughness squared.
//!
//! Spread alone turns a mirror with a few scratches dull, as their steep normals dominate it. So the lobe is never
//! made lower than the mean of the lobes under the texel is at `m`: where most of the footprint is flat, the
//! reflection stays.

mod lobe;

use std::ops::Range;
use std::time::Instant;

use cairn_format::texture::{full_mip_count, mip_extent};
use rayon::prelude::*;
use serde::Serialize;

use super::mips::{self, Plane, Weighting};
use super::role::{unit_normal, unorm16};
use super::{AlphaUse, MipFilter, Role, Source, chain};
use lobe::Lobe;

/// Alpha of a mirror, for heights of lobes.
const LEAST_ALPHA: f64 = 1e-3;
/// Texels of a level whose lobes are judged, which `LevelWidening` promises.
const JUDGED: usize = 32;

/// A material's roughness and the bumps that it lies on.
#[derive(Clone, Copy, Debug)]
pub struct Surface<'a> {
    pub normals: Source<'a>,
    /// Of x and y, before normals are normalised.
    pub normal_scale: f32,
    /// Roughness in green, further data in the other channels; 1 in all of them where there is none.
    pub data: Option<Source<'a>>,
    /// The levels of `data` below its first, where its file has all of them.
    pub data_levels: &'a [Vec<[u16; 4]>],
    /// Roughness is green times this.
    pub factor: f32,
}

/// Levels of data whose green is roughness, its factor included.
#[derive(Clone, Debug, PartialEq)]
pub struct Widened {
    /// Those of the data or of the normals, whichever has more texels along each axis.
    pub width: u32,
    pub height: u32,
    /// All levels, from the largest down.
    pub levels: Vec<Vec<[u16; 4]>>,
    pub report: WideningReport,
}

/// What was done to roughness, how well it fits and how long it took.
#[derive(rkyv::Archive, rkyv::Serialize, rkyv::Deserialize, Clone, Debug, PartialEq, Serialize)]
pub struct WideningReport {
    /// From the largest down.
    pub levels: Vec<LevelWidening>,
    pub seconds: f64,
    /// Texels of all levels a second.
    pub megapixels_per_second: f64,
}

/// One level.
#[derive(
    rkyv::Archive,
    rkyv::Serialize,
    rkyv::Deserialize,
    Clone,
    Copy,
    Debug,
    Default,
    PartialEq,
    Serialize,
)]
pub struct LevelWidening {
    /// Of roughness, 0 to 1.
    pub mean_rise: f64,
    pub max_rise: f64,
    /// Share of the light that goes elsewhere than where the surface under a texel reflects it, over half vectors, under
    /// a light of three degrees; mean of 32 texels: with the roughness as filtered.
    pub error_before: f64,
    /// The same with the roughness widened.
    pub error_after: f64,
}

/// Makes the levels of a surface's roughness.
pub fn widen(surface: &Surface, filter: MipFilter) -> Widened {
    let start = Instant::now();
    let bumps = Bumps::new(surface);
    let extent = |axis: fn(&Source) -> u32| surface.data.as_ref().map_or(1, axis);
    let width = surface.normals.width.max(extent(|data| data.width));
    let height = surface.normals.height.max(extent(|data| data.height));
    let sampled = surface.data.unwrap_or(surface.normals);
    let wrap = [sampled.wrap_u, sampled.wrap_v];
    let mut plane = top(surface, width, height);
    let own = surface
        .data
        .filter(|data| (data.width, data.height) == (width, height));
    let mut levels = Vec::new();
    let mut report = Vec::new();
    let mut texels = 0;
    for level in 0..full_mip_count(width, height) {
        if level > 0 {
            let given = surface.data_levels.get(level as usize - 1);
            plane = match given.filter(|_| own.is_some()) {
                Some(texels) => {
                    let size = [plane.width, plane.height].map(|size| mip_extent(size, 1));
                    chain::plane(texels, size, Role::Data, AlphaUse::Ignore)
                }
                None => mips::halve(&plane, filter, wrap, Weighting::Plain),
            };
        }
        let (stored, widening) = bumps.level(&plane, surface.factor);
        texels += stored.len();
        levels.push(stored);
        report.push(widening);
    }
    let seconds = start.elapsed().as_secs_f64();
    Widened {
        width,
        height,
        levels,
        report: WideningReport {
            levels: report,
            seconds,
            megapixels_per_second: texels as f64 / 1e6 / seconds.max(1e-9),
        },
    }
}

/// The data at the size of the widened image.
fn top(surface: &Surface, width: u32, height: u32) -> Plane {
    let Some(data) = surface.data else {
        return Plane {
            width,
            height,
            texels: vec![[1.0; 4]; width as usize * height as usize],
        };
    };
    let size = [data.width, data.height];
    let plane = chain::plane(data.texels, size, Role::Data, AlphaUse::Ignore);
    if size == [width, height] {
        plane
    } else {
        mips::enlarge(&plane, [width, height], [data.wrap_u, data.wrap_v])
    }
}

/// The unit normals of a map, as shaders scale them.
struct Bumps {
    width: usize,
    height: usize,
    normals: Vec<[f32; 3]>,
}

/// The normals under a texel.
struct Spread {
    /// Direction of their mean.
    mean: [f64; 3],
    /// Variance of slopes along an axis; infinite where the mean has no direction.
    variance: f64,
}

impl Bumps {
    fn new(surface: &Surface) -> Self {
        let map = &surface.normals;
        let scale = surface.normal_scale;
        let normals = map.texels.par_iter().map(|&texel| {
            let [x, y, z, _] = Role::Normal.filterable(texel);
            let [x, y, z, _] = unit_normal([scale * x, scale * y, z, 1.0]);
            [x, y, z]
        });
        Self {
            width: map.width as usize,
            height: map.height as usize,
            normals: normals.collect(),
        }
    }

    /// The texels to store of a level of data.
    fn level(&self, plane: &Plane, factor: f32) -> (Vec<[u16; 4]>, LevelWidening) {
        let width = plane.width as usize;
        let height = plane.height as usize;
        let rows: Vec<(Vec<[u16; 4]>, f64, f64)> = (0..height)
            .into_par_iter()
            .map(|y| {
                let (mut sum, mut most) = (0.0, 0.0_f64);
                let row = (0..width)
                    .map(|x| {
                        let texel = plane.texels[y * width + x];
                        let filtered = f64::from((factor * texel[1]).clamp(0.0, 1.0));
                        let roughness = match self.spread([x, y], [width, height]) {
                            Some((under, spread)) => self.widened(filtered, &under, &spread),
                            None => filtered,
                        };
                        sum += roughness - filtered;
                        most = most.max(roughness - filtered);
                        let stored = [texel[0], roughness as f32, texel[2], texel[3]];
                        stored.map(unorm16)
                    })
                    .collect();
                (row, sum, most)
            })
            .collect();
        let [error_before, error_after] = self.judge(plane, factor);
        let widening = LevelWidening {
            mean_rise: rows.iter().map(|row| row.1).sum::<f64>() / (width * height) as f64,
            max_rise: rows.iter().map(|row| row.2).fold(0.0, f64::max),
            error_before,
            error_after,
        };
        let texels = rows.into_iter().flat_map(|row| row.0).collect();
        (texels, widening)
    }

    /// The normals under a texel of a level; `None` where it lies within one.
    fn spread(&self, at: [usize; 2], size: [usize; 2]) -> Option<([Range<usize>; 2], Spread)> {
        let under = [
            footprint(at[0], size[0], self.width),
            footprint(at[1], size[1], self.height),
        ];
        let count = under[0].len() * under[1].len();
        if count == 1 {
            return None;
        }
        let (mut sum, mut squares) = ([0.0_f64; 3], 0.0);
        for [x, y, z] in self.under(&under) {
            for (sum, value) in sum.iter_mut().zip([x, y, z]) {
                *sum += value;
            }
            squares += x * x + y * y + z * z;
        }
        let mean = sum.map(|sum| sum / count as f64);
        let squared = mean.iter().map(|value| value * value).sum::<f64>();
        let length = squared.sqrt();
        // Against the mean of the squares, not 1: rounded normals are not quite unit, and alpha is the root of this.
        let lost = (squares / count as f64 - squared).max(0.0);
        if length < 1e-6 {
            let spread = Spread {
                mean: [0.0, 0.0, 1.0],
                variance: f64::INFINITY,
            };
            return Some((under, spread));
        }
        let spread = Spread {
            mean: mean.map(|value| value / length),
            variance: lost / (length * (3.0 - squared)),
        };
        Some((under, spread))
    }

    fn under<'a>(&'a self, under: &'a [Range<usize>; 2]) -> impl Iterator<Item = [f64; 3]> + 'a {
        let rows = under[1].clone();
        rows.flat_map(|y| &self.normals[y * self.width..][under[0].clone()])
            .map(|normal| normal.map(f64::from))
    }

    /// Roughness that shows the normals under a texel.
    fn widened(&self, roughness: f64, under: &[Range<usize>; 2], spread: &Spread) -> f64 {
        // Slopes of a variance of 1e-12 are no bumps but rounding.
        if spread.variance < 1e-12 {
            return roughness;
        }
        let alpha = roughness * roughness;
        let by_spread = (alpha * alpha + 2.0 * spread.variance).min(1.0);
        let floored = (alpha * alpha).max(LEAST_ALPHA * LEAST_ALPHA);
        let count = under[0].len() * under[1].len();
        let height = self
            .under(under)
            .map(|normal| lobe::relative_height(normal, spread.mean, floored))
            .sum::<f64>()
            / count as f64;
        let by_height = floored / height.max(1e-30);
        // The square root of alpha is roughness.
        by_spread.min(by_height).sqrt().sqrt().max(roughness)
    }

    /// The mean difference of lobes from what they stand for, as filtered and widened.
    fn judge(&self, plane: &Plane, factor: f32) -> [f64; 2] {
        let (width, height) = (plane.width as usize, plane.height as usize);
        let count = (width * height).min(JUDGED);
        let mut sums = [0.0; 2];
        for number in 0..count {
            let index = (2 * number + 1) * width * height / (2 * count);
            let at = [index % width, index / width];
            let Some((under, spread)) = self.spread(at, [width, height]) else {
                continue;
            };
            let filtered = f64::from((factor * plane.texels[index][1]).clamp(0.0, 1.0));
            let widened = self.widened(filtered, &under, &spread);
            let normals: Vec<[f64; 3]> = self.under(&under).collect();
            let truth = Lobe::mean_of(&normals, filtered);
            for (sum, roughness) in sums.iter_mut().zip([filtered, widened]) {
                *sum += truth.difference(&Lobe::of(spread.mean, roughness));
            }
        }
        sums.map(|sum| sum / count as f64)
    }
}

/// Texels of an axis of `source` that lie under texel `index` of `out`, whole ones.
fn footprint(index: usize, out: usize, source: usize) -> Range<usize> {
    if out >= source {
        let centre = (2 * index + 1) * source / (2 * out);
        return centre..centre + 1;
    }
    index * source / out..((index + 1) * source).div_ceil(out)
}

#[cfg(test)]
mod tests;
