//! Measures products against f64 sums over every texel of the input map.

use std::f64::consts::PI;

use glam::DVec3;
use rayon::prelude::*;

use super::cubemap::{texel_at, texel_direction, to_f64};
use super::equirect::{Equirect, Rows};
use super::ggx::{half_vector_weight, lobe_weight};
use super::quadrature::Rule;

/// Longitude and latitude samples at least this many across the map, so that the sum resolves
/// the lobes where the map itself is coarse.
const SAMPLES_ACROSS: usize = 1024;
/// Share of the bound that the oracle itself may be off by.
const OWN_SHARE: f64 = 0.05;

/// What radiance is weighed with about a normal, as a function of the angle between them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kernel {
    /// `n.l`: irradiance.
    Cosine,
    /// The BRDF at normal incidence, of this alpha: what we prefilter with.
    Lobe(f64),
    /// `D(h) n.l` of this alpha: the lobe without the shadowing of microfacets, as other tools have it (Karis 2013).
    HalfVector(f64),
}

impl Kernel {
    fn alpha(self) -> f64 {
        match self {
            Self::Cosine => 1.0,
            Self::Lobe(alpha) | Self::HalfVector(alpha) => alpha,
        }
    }
}

/// Texels of a cube level nearest to `count` directions spread evenly over the sphere.
pub(super) fn probe_texels(count: usize, size: u32) -> Vec<usize> {
    let golden = PI * (3.0 - 5.0_f64.sqrt());
    (0..count)
        .map(|k| {
            let y = 1.0 - (2.0 * k as f64 + 1.0) / count as f64;
            let radius = (1.0 - y * y).sqrt();
            let longitude = golden * k as f64;
            texel_at(
                DVec3::new(
                    radius * libm::cos(longitude),
                    y,
                    radius * libm::sin(longitude),
                ),
                size,
            )
        })
        .collect()
}

/// The map's integrals by brute force.
pub(super) struct Oracle<'a> {
    input: &'a Equirect,
    rows: &'a Rows,
    /// Relative RMS error that the oracle is to judge.
    bound: f64,
}

/// A meridian of the sum: columns beside it, the right one's share, `cos` and `sin` of longitude, weight.
struct Meridian {
    left: usize,
    right: usize,
    blend: f64,
    at: DVec3,
    weight: f64,
}

impl<'a> Oracle<'a> {
    pub fn new(input: &'a Equirect, rows: &'a Rows, bound: f64) -> Self {
        Self { input, rows, bound }
    }

    /// Normalised integral of radiance times the kernel about each normal, in f64 over every input texel with exact
    /// solid angles.
    ///
    /// A texel is a tent, twice as wide as itself, which one sample at its centre makes narrower: too narrow, where
    /// `(texel / alpha)^2 / 6` matters beside the bound. There each of the tent's linear parts has two Gauss points.
    pub fn integrals(&self, normals: &[DVec3], kernel: Kernel) -> Vec<DVec3> {
        let narrowing = (PI / self.rows.count() as f64 / kernel.alpha()).powi(2) / 6.0;
        let exact = narrowing > OWN_SHARE * self.bound;
        match kernel {
            Kernel::Cosine => self.sum(normals, exact, |squared| (1.0 - 0.5 * squared).max(0.0)),
            Kernel::Lobe(alpha) => self.sum(normals, exact, |squared| lobe_weight(squared, alpha)),
            Kernel::HalfVector(alpha) => {
                self.sum(normals, exact, |squared| half_vector_weight(squared, alpha))
            }
        }
    }

    fn sum(
        &self,
        normals: &[DVec3],
        exact: bool,
        weight: impl Fn(f64) -> f64 + Sync,
    ) -> Vec<DVec3> {
        let meridians = self.meridians(exact);
        let bands: Vec<Vec<(DVec3, f64)>> = (0..self.rows.count())
            .into_par_iter()
            .map(|row| {
                let mut sums = vec![(DVec3::ZERO, 0.0); normals.len()];
                for (y, thickness) in self.heights(row, exact) {
                    self.add_band(y, thickness, &meridians, normals, &weight, &mut sums);
                }
                sums
            })
            .collect();
        let mut totals = vec![(DVec3::ZERO, 0.0); normals.len()];
        for band in &bands {
            for (total, part) in totals.iter_mut().zip(band) {
                total.0 += part.0;
                total.1 += part.1;
            }
        }
        totals
            .into_iter()
            .map(|(sum, weight)| sum / weight)
            .collect()
    }

    fn add_band(
        &self,
        y: f64,
        thickness: f64,
        meridians: &[Meridian],
        normals: &[DVec3],
        weight: &(impl Fn(f64) -> f64 + Sync),
        sums: &mut [(DVec3, f64)],
    ) {
        let radius = (1.0 - y * y).max(0.0).sqrt();
        let mut blends = Vec::with_capacity(3);
        self.rows.blend(y, |row, share| blends.push((row, share)));
        for meridian in meridians {
            let direction = DVec3::new(meridian.at.x * radius, y, meridian.at.z * radius);
            let area = thickness * meridian.weight;
            let mut radiance = DVec3::ZERO;
            for &(row, share) in &blends {
                let left = self.input.texel(meridian.left, row);
                let right = self.input.texel(meridian.right, row);
                radiance += (left * (1.0 - meridian.blend) + right * meridian.blend) * share;
            }
            for (normal, sum) in normals.iter().zip(sums.iter_mut()) {
                let squared = (*normal - direction).length_squared();
                // Below the horizon.
                if squared < 2.0 {
                    let weight = weight(squared) * area;
                    sum.0 += radiance * weight;
                    sum.1 += weight;
                }
            }
        }
    }

    /// Samples in longitude: between neighbouring texel centres radiance is linear.
    fn meridians(&self, exact: bool) -> Vec<Meridian> {
        let width = self.input.width as usize;
        let parts = SAMPLES_ACROSS.div_ceil(width).max(1);
        let rule = if exact {
            Rule::gauss_legendre(2)
        } else {
            Rule {
                nodes: vec![(0.5, 1.0)],
            }
        };
        // Midpoints about the centres themselves where there is but one.
        let shift = if exact { 0.0 } else { 0.5 };
        let mut meridians = Vec::with_capacity(width * parts * rule.nodes.len());
        for part in 0..width * parts {
            for &(node, weight) in &rule.nodes {
                let column = (part as f64 + node) / parts as f64 - shift;
                let left = libm::floor(column);
                let longitude = 2.0 * PI * ((column + 0.5) / width as f64 - 0.5);
                let wrap = |column: i64| column.rem_euclid(width as i64) as usize;
                meridians.push(Meridian {
                    left: wrap(left as i64),
                    right: wrap(left as i64 + 1),
                    blend: column - left,
                    at: DVec3::new(libm::cos(longitude), 0.0, libm::sin(longitude)),
                    weight: weight / parts as f64,
                });
            }
        }
        meridians
    }

    /// `y` and thickness of the samples of a row.
    fn heights(&self, row: usize, exact: bool) -> Vec<(f64, f64)> {
        let parts = SAMPLES_ACROSS.div_ceil(self.input.width as usize).max(1);
        if !exact {
            let thickness = self.rows.thickness(row) / parts as f64;
            let middle = |part: usize| (part as f64 + 0.5) / parts as f64;
            return (0..parts)
                .map(|part| (self.rows.y_within(row, middle(part)), thickness))
                .collect();
        }
        let rule = Rule::gauss_legendre(2);
        let mut heights = Vec::new();
        for (high, low) in self.rows.linear_parts(row) {
            let step = (high - low) / parts as f64;
            for part in 0..parts {
                heights.extend(
                    rule.nodes
                        .iter()
                        .map(|&(node, weight)| (high - (part as f64 + node) * step, weight * step)),
                );
            }
        }
        heights
    }

    /// Relative RMS error of a cube level at `probes` texels spread evenly over the sphere.
    pub fn relative_rms(
        &self,
        (texels, size): (&[[f32; 3]], u32),
        probes: usize,
        kernel: &Kernel,
    ) -> f64 {
        let indices = probe_texels(probes, size);
        let normals: Vec<DVec3> = indices.iter().map(|&i| texel_direction(i, size)).collect();
        let exact = self.integrals(&normals, *kernel);
        let found = indices.iter().map(|&index| to_f64(texels[index]));
        relative_rms(found, &exact)
    }
}

/// Root of the summed squared differences, relative to that of the truth; absolute where that is black.
pub(super) fn relative_rms(found: impl Iterator<Item = DVec3>, exact: &[DVec3]) -> f64 {
    let (mut error, mut scale) = (0.0, 0.0);
    for (found, exact) in found.zip(exact) {
        error += (found - *exact).length_squared();
        scale += exact.length_squared();
    }
    if scale > 0.0 {
        (error / scale).sqrt()
    } else {
        error.sqrt()
    }
}
