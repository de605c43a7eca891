//! Measures products against f64 sums over every texel of the input map.

use std::f64::consts::PI;

use glam::DVec3;
use rayon::prelude::*;

use super::cubemap::{texel_at, texel_direction, to_f64};
use super::equirect::{Equirect, Rows};

/// Longitude and latitude samples at least this many across the map, so that the sum resolves
/// the lobes where the map itself is coarse.
const SAMPLES_ACROSS: usize = 1024;

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

/// Normalised integral of radiance times `kernel(|n - l|^2)` about each normal, in f64 over
/// every input texel with exact solid angles.
pub(super) fn reference(
    input: &Equirect,
    rows: &Rows,
    normals: &[DVec3],
    kernel: impl Fn(f64) -> f64 + Sync,
) -> Vec<DVec3> {
    let (width, height) = (input.width as usize, rows.count());
    let parts = SAMPLES_ACROSS.div_ceil(width).max(1);
    let across: Vec<(usize, usize, f64, DVec3)> = (0..width * parts)
        .map(|k| {
            let column = (k as f64 + 0.5) / parts as f64 - 0.5;
            let left = libm::floor(column);
            let longitude = 2.0 * PI * ((column + 0.5) / width as f64 - 0.5);
            let at = DVec3::new(libm::cos(longitude), 0.0, libm::sin(longitude));
            let wrap = |c: i64| c.rem_euclid(width as i64) as usize;
            (wrap(left as i64), wrap(left as i64 + 1), column - left, at)
        })
        .collect();
    let bands: Vec<Vec<(DVec3, f64)>> = (0..height * parts)
        .into_par_iter()
        .map(|band| {
            let row = band / parts;
            let y = rows.y_within(row, ((band % parts) as f64 + 0.5) / parts as f64);
            let radius = (1.0 - y * y).max(0.0).sqrt();
            let mut blends = Vec::with_capacity(3);
            rows.blend(y, |row, share| blends.push((row, share)));
            let mut sums = vec![(DVec3::ZERO, 0.0); normals.len()];
            for &(left, right, blend, at) in &across {
                let direction = DVec3::new(at.x * radius, y, at.z * radius);
                let mut radiance = DVec3::ZERO;
                for &(row, share) in &blends {
                    let (a, b) = (input.texel(left, row), input.texel(right, row));
                    radiance += (a * (1.0 - blend) + b * blend) * share;
                }
                for (normal, sum) in normals.iter().zip(&mut sums) {
                    let weight = kernel((*normal - direction).length_squared());
                    sum.0 += radiance * weight;
                    sum.1 += weight;
                }
            }
            let thickness = rows.thickness(row);
            for sum in &mut sums {
                *sum = (sum.0 * thickness, sum.1 * thickness);
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

/// Relative RMS error of a cube level at `probes` texels against [`reference`].
pub(super) fn relative_rms(
    input: &Equirect,
    rows: &Rows,
    (texels, size): (&[[f32; 3]], u32),
    probes: usize,
    kernel: impl Fn(f64) -> f64 + Sync,
) -> f64 {
    let indices = probe_texels(probes, size);
    let normals: Vec<DVec3> = indices.iter().map(|&i| texel_direction(i, size)).collect();
    let exact = reference(input, rows, &normals, kernel);
    let (mut error, mut scale) = (0.0, 0.0);
    for (&index, exact) in indices.iter().zip(&exact) {
        error += (to_f64(texels[index]) - *exact).length_squared();
        scale += exact.length_squared();
    }
    if scale > 0.0 {
        (error / scale).sqrt()
    } else {
        error.sqrt()
    }
}

/// Kernel of [`reference`] for irradiance.
pub(super) fn cosine_kernel(distance_squared: f64) -> f64 {
    (1.0 - 0.5 * distance_squared).max(0.0)
}
