//! Specular prefiltering: every texel integrates the GGX lobe over the whole sky.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::cells::CellLevel;
use super::cubemap::{texel_at, texel_direction, to_f64};
use super::cut::CellList;
use super::lattice::{self, Lattice};
use super::verify::probe_texels;

/// Cell sides allowed relative to the lobe's local scale `sqrt(angle^2 + (2 alpha)^2)`, coarsest first; the last ones
/// are but the truth that others are tried against.
const CUTS: [f64; 13] = [
    0.8, 0.56, 0.4, 0.28, 0.2, 0.14, 0.1, 0.07, 0.05, 0.035, 0.025, 0.018, 0.0125,
];
/// Places in [`CUTS`] from a cut to the one that is its truth: about a third of it, with a hundredth of its error.
const TRUTH: usize = 3;
/// Directions, even over the sphere, at which a choice is tried; the brightest of every face are tried besides.
const TRIALS: usize = 24;
/// Share of the bound that a choice may use: a trial sees few directions, and there are two choices.
const SAFETY: f64 = 0.5;
/// Side of the level the search starts from.
pub(super) const COARSEST_CELLS: u32 = 8;
/// Least side of the level in which the brightest directions are looked for.
const BRIGHT_CELLS: u32 = 64;
/// Values per side of a tile; a tile shares one list of cells.
const TILE: usize = 4;
/// Coarsest steps between values, relative to alpha, that are tried: the lobe's spectrum falls off as
/// `exp(-2 alpha k)`.
const WIDEST_STEP: f64 = 0.9;

/// Roughness of a level: 0 at the finest, 1 at the coarsest.
pub fn level_roughness(level: usize, levels: usize) -> f64 {
    if levels > 1 {
        level as f64 / (levels - 1) as f64
    } else {
        0.0
    }
}

/// Radiance filtered by the GGX lobe about every texel's direction, with a relative RMS error that stays within
/// `bound` as far as trials tell.
///
/// No sampling: each value integrates a cut through the cell pyramid that covers its whole hemisphere, fine near the
/// lobe's peak and coarser along its tails, so no light is missed and the result has no noise. Weights are
/// normalised by the same cut. The coarsest cut that a trial finds close enough is taken. Where the level has more
/// texels than the lobe's width asks for, values are integrated on a coarser lattice and interpolated between, if
/// that too stays within the bound at directions where the integral is known.
pub(super) fn prefilter(
    pyramid: &[CellLevel<'_>],
    size: u32,
    alpha: f64,
    bound: f64,
) -> Vec<[f32; 3]> {
    let trial = Trial::new(pyramid, size);
    let cut = trial.coarsest_cut(alpha, bound);
    let exact = trial.values(alpha, cut);
    for ratio in [4, 2] {
        let lattice = Lattice::around(size, ratio);
        if f64::from(lattice.size) < 2.0 / (WIDEST_STEP * alpha) || !lattice.saves(size) {
            continue;
        }
        let texels = lattice::interpolate(&evaluate(pyramid, &lattice, alpha, cut), &lattice, size);
        let found: Vec<DVec3> = trial.texels.iter().map(|&at| to_f64(texels[at])).collect();
        if trial.within(&found, &exact, bound) {
            return texels;
        }
    }
    evaluate(pyramid, &Lattice::whole(size), alpha, cut)
}

/// The filtered radiance at every point of a lattice.
fn evaluate(pyramid: &[CellLevel<'_>], lattice: &Lattice, alpha: f64, cut: f64) -> Vec<[f32; 3]> {
    let side = lattice.side();
    let tile = TILE.min(side);
    let tiles = side / tile;
    let place = |block: usize, k: usize| {
        let (face, row, column) = (
            block / (tiles * tiles),
            block / tiles % tiles,
            block % tiles,
        );
        (face, column * tile + k % tile, row * tile + k / tile)
    };
    let blocks: Vec<Vec<[f32; 3]>> = (0..6 * tiles * tiles)
        .into_par_iter()
        .map_init(CellList::default, |list, block| {
            let directions: Vec<DVec3> = (0..tile * tile)
                .map(|k| {
                    let (face, x, y) = place(block, k);
                    lattice.direction(face, x, y)
                })
                .collect();
            list.gather(pyramid, &directions, alpha, cut);
            directions
                .iter()
                .map(|&direction| list.integrate(direction.as_vec3(), alpha as f32))
                .collect()
        })
        .collect();
    let mut values = vec![[0.0; 3]; 6 * side * side];
    for (block, filtered) in blocks.iter().enumerate() {
        for (k, value) in filtered.iter().enumerate() {
            let (face, x, y) = place(block, k);
            values[(face * side + y) * side + x] = *value;
        }
    }
    values
}

/// Texels at which choices are tried before a whole level is filtered.
struct Trial<'a> {
    pyramid: &'a [CellLevel<'a>],
    size: u32,
    texels: Vec<usize>,
}

impl<'a> Trial<'a> {
    fn new(pyramid: &'a [CellLevel<'a>], size: u32) -> Self {
        let mut texels = probe_texels(TRIALS, size);
        let bright = pyramid.iter().find(|level| level.size >= BRIGHT_CELLS);
        let level = bright.unwrap_or(&pyramid[pyramid.len() - 1]);
        let luminance = |index: usize| level.cell(index).radiance.iter().sum::<f32>();
        let per_face = level.solid_angles.len();
        texels.extend((0..6).map(|face| {
            let cells = face * per_face..(face + 1) * per_face;
            let brightest = cells.max_by(|&a, &b| luminance(a).total_cmp(&luminance(b)));
            let centroid = Vec3::from(level.cell(brightest.unwrap_or(0)).centroid);
            texel_at(centroid.as_dvec3(), size)
        }));
        Self {
            pyramid,
            size,
            texels,
        }
    }

    fn values(&self, alpha: f64, cut: f64) -> Vec<DVec3> {
        let value = |list: &mut CellList, &index: &usize| {
            let direction = texel_direction(index, self.size);
            list.gather(self.pyramid, &[direction], alpha, cut);
            to_f64(list.integrate(direction.as_vec3(), alpha as f32))
        };
        self.texels
            .par_iter()
            .map_init(CellList::default, value)
            .collect()
    }

    /// Whether values are close enough to the truth, over the sphere and about the brightest directions.
    fn within(&self, values: &[DVec3], truth: &[DVec3], bound: f64) -> bool {
        [0..TRIALS, TRIALS..truth.len()].into_iter().all(|range| {
            let pairs = values[range.clone()].iter().zip(&truth[range.clone()]);
            let error: f64 = pairs.map(|(a, b)| (*a - *b).length_squared()).sum();
            let scale: f64 = truth[range]
                .iter()
                .map(|value| value.length_squared())
                .sum();
            error <= scale * (SAFETY * bound) * (SAFETY * bound)
        })
    }

    fn coarsest_cut(&self, alpha: f64, bound: f64) -> f64 {
        let mut tried: Vec<Vec<DVec3>> = Vec::new();
        for (at, &cut) in CUTS[..CUTS.len() - TRUTH].iter().enumerate() {
            while tried.len() <= at + TRUTH {
                tried.push(self.values(alpha, CUTS[tried.len()]));
            }
            if self.within(&tried[at], &tried[at + TRUTH], bound) {
                return cut;
            }
        }
        CUTS[CUTS.len() - TRUTH]
    }
}
