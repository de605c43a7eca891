//! Errors of any tool's filtered cubes against the same brute-force sums.

use std::collections::BTreeMap;
use std::time::Instant;

use glam::{DMat3, DVec3};

use super::cubemap::{Cube, texel_at, texel_direction, to_f64};
use super::equirect::{Equirect, Rows};
use super::resample;
use super::verify::{Kernel, Oracle, probe_texels, relative_rms};

/// Relative error that the oracle is asked to judge.
const BOUND: f64 = 2e-4;
/// Side of the sky that a tool's axes are found with.
const FRAME_SIZE: u32 = 32;

/// One sky, and the truth about it as far as it was asked for.
pub struct Truth<'a> {
    input: &'a Equirect,
    rows: Rows,
    probes: usize,
    /// By level size, kernel and axes: sums at the probes.
    known: BTreeMap<String, Vec<DVec3>>,
    /// Seconds of the sums so far, and how many.
    seconds: f64,
    sums: usize,
}

impl<'a> Truth<'a> {
    /// Of a map, at `probes` directions spread evenly over the sphere.
    pub fn new(input: &'a Equirect, probes: usize) -> Self {
        Self {
            input,
            rows: Rows::new(input.height),
            probes,
            known: BTreeMap::new(),
            seconds: 0.0,
            sums: 0,
        }
    }

    /// Relative RMS error of a cube level, whose directions the axes turn into the map's.
    pub fn error(&mut self, texels: &[[f32; 3]], size: u32, kernel: Kernel, axes: DMat3) -> f64 {
        let indices = probe_texels(self.probes, size);
        let key = format!("{size} {kernel:?} {axes:?}");
        if !self.known.contains_key(&key) {
            let normals: Vec<DVec3> = indices
                .iter()
                .map(|&index| axes * texel_direction(index, size))
                .collect();
            let start = Instant::now();
            let sums = Oracle::new(self.input, &self.rows, BOUND).integrals(&normals, kernel);
            self.seconds += start.elapsed().as_secs_f64();
            self.sums += sums.len();
            self.known.insert(key.clone(), sums);
        }
        let found = indices.iter().map(|&index| to_f64(texels[index]));
        relative_rms(found, &self.known[&key])
    }

    /// How many sums were made.
    pub fn sums(&self) -> usize {
        self.sums
    }

    /// The axes under which an unfiltered cube level shows the map best: among the turns by quarters and mirrors.
    pub fn axes(&self, texels: &[[f32; 3]], size: u32) -> DMat3 {
        let sky = resample::equirect_to_cube(self.input, &self.rows, FRAME_SIZE);
        let levels = Cube::single(size, texels.to_vec()).with_mips();
        let level = levels.levels.len() - 1 - FRAME_SIZE.min(size).ilog2() as usize;
        let (small, small_size) = (&levels.levels[level], levels.level_size(level));
        // Logarithms, as a sun would drown the rest, and no tool's filter keeps it alike.
        let seen = |texel: [f32; 3]| to_f64(texel.map(|channel| libm::log1pf(channel.min(1e4))));
        let difference = |axes: &DMat3| {
            let texels = small.iter().enumerate();
            let difference = |(index, &texel): (usize, &[f32; 3])| {
                let place = texel_at(*axes * texel_direction(index, small_size), FRAME_SIZE);
                (seen(texel) - seen(sky[place])).length_squared()
            };
            texels.map(difference).sum::<f64>()
        };
        let mut best = (f64::INFINITY, DMat3::IDENTITY);
        for axes in all_axes() {
            let difference = difference(&axes);
            if difference < best.0 {
                best = (difference, axes);
            }
        }
        best.1
    }
}

/// The 48 turns and mirrors that keep the cube.
fn all_axes() -> Vec<DMat3> {
    let orders = [
        [0, 1, 2],
        [0, 2, 1],
        [1, 0, 2],
        [1, 2, 0],
        [2, 0, 1],
        [2, 1, 0],
    ];
    let unit = [DVec3::X, DVec3::Y, DVec3::Z];
    orders
        .into_iter()
        .flat_map(|order| {
            (0..8).map(move |signs| {
                let axis = |k: usize| {
                    let sign = if signs >> k & 1 == 1 { -1.0 } else { 1.0 };
                    unit[order[k]] * sign
                };
                DMat3::from_cols(axis(0), axis(1), axis(2))
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sky() -> Equirect {
        let texels = (0..64 * 32)
            .map(|index| {
                let (x, y) = (index % 64, index / 64);
                [x as f32, y as f32, if x < 9 && y < 13 { 50.0 } else { 0.0 }]
            })
            .collect();
        Equirect {
            width: 64,
            height: 32,
            texels,
        }
    }

    #[test]
    fn axes_of_a_turned_and_mirrored_cube_are_found() {
        let input = sky();
        let truth = Truth::new(&input, 8);
        let cube = resample::equirect_to_cube(&input, &truth.rows, 64);
        for axes in all_axes().into_iter().step_by(5) {
            let turned: Vec<[f32; 3]> = (0..cube.len())
                .map(|index| cube[texel_at(axes * texel_direction(index, 64), 64)])
                .collect();
            assert_eq!(truth.axes(&turned, 64), axes);
        }
    }

    #[test]
    fn our_own_levels_are_close_and_wrong_ones_are_not() {
        let input = sky();
        let options = super::super::EnvironmentOptions {
            prefiltered_size: 32,
            probes: 0,
            sun: super::super::SunMode::Keep,
            ..super::super::EnvironmentOptions::default()
        };
        let products = super::super::bake_environment(input.clone(), &options, &|_, _| {});
        let cube = &products.prefiltered;
        let mut truth = Truth::new(&input, 12);
        let alpha = super::super::level_roughness(1, cube.levels.len()).powi(2);
        let kernel = Kernel::Lobe(alpha);
        let mut error =
            |axes: DMat3| truth.error(&cube.levels[1], cube.level_size(1), kernel, axes);
        assert!(error(DMat3::IDENTITY) < 2e-3);
        assert!(error(DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0))) > 0.05);
        assert_eq!(truth.sums(), 24);
    }
}
