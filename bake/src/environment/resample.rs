//! Equirectangular map to cube face by integration over every cube texel.

use std::f64::consts::PI;

use glam::DVec3;
use rayon::prelude::*;

use super::cubemap::{edge_coordinate, to_f32};
use super::equirect::{Equirect, Rows};
use super::mirrors::{self, Mirror};
use super::quadrature::Rule;
use super::taps::Taps;

/// Points per panel; a panel never spans a kink of the map's horizontal blend or of the texel's
/// outline, so the integrand is smooth in it.
const PANEL_POINTS: usize = 3;
/// Points per panel of maps at least [`FINE_WIDTH`] wide, whose panels are narrow.
const FINE_PANEL_POINTS: usize = 2;
const FINE_WIDTH: u32 = 256;

/// One meridian that crosses a texel.
pub(super) struct Meridian {
    /// Columns on both sides, the right one's blend weight; the left one is not wrapped.
    pub left: i64,
    pub right: i64,
    pub blend: f64,
    /// Quadrature weight in radians of longitude.
    pub weight: f64,
    /// `|cos|`, `|sin|` of the longitude relative to the face's axis.
    cosine: f64,
    sine: f64,
}

/// Mean radiance of every texel of a cube of the given even side.
///
/// Radiance is the map's bilinear reconstruction (see [`Rows`]). Each texel is integrated along
/// meridians: Gauss-Legendre in longitude between all kinks, exact in `y` along each meridian.
/// All weights are positive, a constant map gives that constant, and the map's total energy is
/// kept to quadrature precision whatever the ratio of texel sizes, single-texel suns included.
///
/// Where the map's width is a multiple of four, the cube's mirror planes are the map's: the weights of one quadrant
/// of a side and of a pole's face then serve all others.
pub(super) fn equirect_to_cube(input: &Equirect, rows: &Rows, size: u32) -> Vec<[f32; 3]> {
    let resampler = Resampler::new(input, rows, size);
    let symmetric = input.width.is_multiple_of(4);
    let sides = if symmetric {
        mirrors::sides(input)
    } else {
        Vec::new()
    };
    let poles = if symmetric {
        mirrors::poles(input)
    } else {
        Vec::new()
    };
    let side = size as usize;
    let mut texels = vec![[0.0; 3]; 6 * side * side];
    if symmetric {
        let columns = resampler.side_columns(0.0);
        resampler.quadrant(&sides, &mut texels, |x, y, taps| {
            resampler.side_taps(&columns[side / 2 + x], side / 2 + y, taps);
        });
        resampler.quadrant(&poles, &mut texels, |x, y, taps| {
            resampler.pole_taps(side / 2 + x, side / 2 + y, true, taps);
        });
        return texels;
    }
    for face in 0..6 {
        let texels = &mut texels[face * side * side..][..side * side];
        match side_face_turn(face) {
            Some(turn) => {
                let columns = resampler.side_columns(turn);
                resampler.face(texels, |x, y, taps| {
                    resampler.side_taps(&columns[x], y, taps);
                });
            }
            None => resampler.face(texels, |x, y, taps| {
                resampler.pole_taps(x, y, face == 2, taps);
            }),
        }
    }
    texels
}

/// Mean radiance over every cell of an equirectangular grid, by the same integration.
pub(super) fn equirect_means(
    input: &Equirect,
    rows: &Rows,
    width: u32,
    height: u32,
) -> Vec<[f32; 3]> {
    let resampler = Resampler::new(input, rows, 0);
    let edge = |column: u32| resampler.column(f64::from(column) / f64::from(width) - 0.5);
    let columns: Vec<Vec<Meridian>> = (0..width)
        .map(|column| {
            let mut meridians = Vec::new();
            resampler.meridians(edge(column), edge(column + 1), 0.0, &mut meridians);
            meridians
        })
        .collect();
    let bands = Rows::new(height);
    (0..height as usize)
        .into_par_iter()
        .flat_map_iter(|row| {
            let (low, high) = (bands.y_within(row, 1.0), bands.y_within(row, 0.0));
            let mean = |meridians: &Vec<Meridian>| {
                let mut sum = DVec3::ZERO;
                let mut area = 0.0;
                for meridian in meridians {
                    sum += resampler.along(meridian, low, high) * meridian.weight;
                    area += meridian.weight * (high - low);
                }
                to_f32(sum / area)
            };
            columns.iter().map(mean).collect::<Vec<_>>()
        })
        .collect()
}

/// Longitude of a side face's centre in turns; `None` for the faces of the poles.
fn side_face_turn(face: usize) -> Option<f64> {
    match face {
        0 => Some(0.0),
        1 => Some(0.5),
        4 => Some(0.25),
        5 => Some(-0.25),
        _ => None,
    }
}

struct Resampler<'a> {
    input: &'a Equirect,
    rows: &'a Rows,
    rule: Rule,
    size: u32,
}

impl<'a> Resampler<'a> {
    fn new(input: &'a Equirect, rows: &'a Rows, size: u32) -> Self {
        let points = if input.width < FINE_WIDTH {
            PANEL_POINTS
        } else {
            FINE_PANEL_POINTS
        };
        Self {
            input,
            rows,
            rule: Rule::gauss_legendre(points),
            size,
        }
    }

    /// Continuous column at a longitude in turns; texel centres lie at integers.
    fn column(&self, turn: f64) -> f64 {
        (0.5 + turn) * f64::from(self.input.width) - 0.5
    }

    /// Appends the meridians between two columns, with longitudes relative to `origin`.
    fn meridians(&self, from: f64, to: f64, origin: f64, out: &mut Vec<Meridian>) {
        let radians = 2.0 * PI / f64::from(self.input.width);
        let mut start = from.min(to);
        let end = from.max(to);
        let mut cell = libm::floor(start);
        while start < end {
            let stop = end.min(cell + 1.0);
            for &(node, weight) in &self.rule.nodes {
                let column = start + (stop - start) * node;
                let longitude = (column - origin) * radians;
                out.push(Meridian {
                    left: cell as i64,
                    right: cell as i64 + 1,
                    blend: column - cell,
                    weight: weight * (stop - start) * radians,
                    cosine: libm::cos(longitude).abs(),
                    sine: libm::sin(longitude).abs(),
                });
            }
            start = stop;
            cell += 1.0;
        }
    }

    /// Integral of radiance along a meridian between two `y`.
    fn along(&self, meridian: &Meridian, low: f64, high: f64) -> DVec3 {
        let mut sum = DVec3::ZERO;
        let wrap = |column: i64| column.rem_euclid(i64::from(self.input.width)) as usize;
        let (left, right) = (wrap(meridian.left), wrap(meridian.right));
        self.rows.integrate(low, high, |row, weight| {
            let left = self.input.texel(left, row);
            let right = self.input.texel(right, row);
            sum += (left + (right - left) * meridian.blend) * weight;
        });
        sum
    }

    /// Meridians of every column of the face whose centre is at a longitude.
    fn side_columns(&self, turn: f64) -> Vec<Vec<Meridian>> {
        let origin = self.column(turn);
        let column_at = |index: usize| {
            self.column(turn - libm::atan(edge_coordinate(index, self.size)) / (2.0 * PI))
        };
        (0..self.size as usize)
            .into_par_iter()
            .map(|x| {
                let mut meridians = Vec::new();
                self.meridians(column_at(x), column_at(x + 1), origin, &mut meridians);
                meridians
            })
            .collect()
    }

    fn side_taps(&self, meridians: &[Meridian], y: usize, taps: &mut Taps) {
        let (top, bottom) = (
            edge_coordinate(y, self.size),
            edge_coordinate(y + 1, self.size),
        );
        taps.start(meridians);
        for meridian in meridians {
            // On the meridian s = tan(longitude), so y = -t cos / sqrt(1 + (t cos)^2).
            let sine_of_latitude = |t: f64| {
                let slope = -t * meridian.cosine;
                slope / (1.0 + slope * slope).sqrt()
            };
            taps.add(
                self.rows,
                meridian,
                sine_of_latitude(bottom),
                sine_of_latitude(top),
            );
        }
        taps.finish();
    }

    fn pole_taps(&self, x: usize, y: usize, up: bool, taps: &mut Taps) {
        let texel = PoleTexel::new(x, y, up, self.size);
        let mut meridians = std::mem::take(&mut taps.meridians);
        meridians.clear();
        let corners = texel.corner_turns().map(|turn| self.column(turn));
        let origin = self.column(0.0);
        for pair in corners.windows(2) {
            self.meridians(pair[0], pair[1], origin, &mut meridians);
        }
        taps.start(&meridians);
        for meridian in &meridians {
            let Some((near, far)) = texel.radii(meridian) else {
                continue;
            };
            let height = |radius: f64| 1.0 / (1.0 + radius * radius).sqrt();
            let (high, low) = (height(near), height(far));
            let (low, high) = if up { (low, high) } else { (-high, -low) };
            taps.add(self.rows, meridian, low, high);
        }
        taps.finish();
        taps.meridians = meridians;
    }

    /// Texels of a face, each with taps of its own.
    fn face(&self, texels: &mut [[f32; 3]], build: impl Fn(usize, usize, &mut Taps) + Sync) {
        let side = self.size as usize;
        let own = Mirror::none(self.input);
        texels.par_chunks_exact_mut(side).enumerate().for_each_init(
            Taps::default,
            |taps, (y, row)| {
                for (x, texel) in row.iter_mut().enumerate() {
                    build(x, y, taps);
                    *texel = taps.mean(self.input, &own);
                }
            },
        );
    }

    /// Texels of every image of a face's last quadrant, whose `x` and `y` count from the face's middle.
    fn quadrant(
        &self,
        images: &[Mirror],
        texels: &mut [[f32; 3]],
        build: impl Fn(usize, usize, &mut Taps) + Sync,
    ) {
        let half = self.size as usize / 2;
        let rows: Vec<Vec<[f32; 3]>> = (0..half)
            .into_par_iter()
            .map_init(Taps::default, |taps, y| {
                let mut values = Vec::with_capacity(half * images.len());
                for x in 0..half {
                    build(x, y, taps);
                    values.extend(images.iter().map(|image| taps.mean(self.input, image)));
                }
                values
            })
            .collect();
        for (y, row) in rows.iter().enumerate() {
            for (at, value) in row.iter().enumerate() {
                let (x, image) = (at / images.len(), &images[at % images.len()]);
                texels[image.texel(x, y, half)] = *value;
            }
        }
    }
}

/// A texel of a pole's face. The face's side is even, so it lies in one quadrant around the pole
/// and is described there by magnitudes of the direction's `x` and `z`.
struct PoleTexel {
    near_x: f64,
    far_x: f64,
    positive_x: bool,
    near_z: f64,
    far_z: f64,
    positive_z: bool,
}

impl PoleTexel {
    fn new(x: usize, y: usize, up: bool, size: u32) -> Self {
        let span = |index: usize| {
            let (a, b) = (
                edge_coordinate(index, size),
                edge_coordinate(index + 1, size),
            );
            (a.abs().min(b.abs()), a.abs().max(b.abs()), a + b > 0.0)
        };
        let (near_x, far_x, positive_x) = span(x);
        let (near_z, far_z, positive_t) = span(y);
        Self {
            near_x,
            far_x,
            positive_x,
            near_z,
            far_z,
            positive_z: positive_t == up,
        }
    }

    /// Longitudes of the four corners in turns, in monotonic order.
    fn corner_turns(&self) -> [f64; 4] {
        let inner = libm::atan2(self.near_z, self.near_x);
        let outer = libm::atan2(self.far_z, self.far_x);
        let angles = [
            libm::atan2(self.near_z, self.far_x),
            inner.min(outer),
            inner.max(outer),
            libm::atan2(self.far_z, self.near_x),
        ];
        angles.map(|angle| {
            let turn = angle / (2.0 * PI);
            match (self.positive_x, self.positive_z) {
                (true, true) => turn,
                (true, false) => -turn,
                (false, true) => 0.5 - turn,
                (false, false) => turn - 0.5,
            }
        })
    }

    /// Distances from the pole, in the face's plane, at which a meridian enters and leaves.
    fn radii(&self, meridian: &Meridian) -> Option<(f64, f64)> {
        let cosine = meridian.cosine.max(f64::MIN_POSITIVE);
        let sine = meridian.sine.max(f64::MIN_POSITIVE);
        let near = (self.near_x / cosine).max(self.near_z / sine);
        let far = (self.far_x / cosine).min(self.far_z / sine);
        (far > near).then_some((near, far))
    }
}

#[cfg(test)]
mod tests {
    use super::super::cubemap::{energy, texel_at};
    use super::*;

    fn resample(input: &Equirect, size: u32) -> Vec<[f32; 3]> {
        equirect_to_cube(input, &Rows::new(input.height), size)
    }

    #[test]
    fn every_single_texel_sun_keeps_its_energy() {
        let mut worst: f64 = 0.0;
        for (width, height, size) in [
            (64_u32, 32_u32, 32_u32),
            (61, 17, 8),
            (5, 40, 64),
            (2, 1, 8),
        ] {
            let rows = Rows::new(height);
            for index in 0..(width * height) as usize {
                if index > 200 && index % 37 != 0 {
                    continue;
                }
                let mut texels = vec![[0.0; 3]; (width * height) as usize];
                texels[index] = [1e6, 1.0, 0.0];
                let input = Equirect {
                    width,
                    height,
                    texels,
                };
                let sum = energy(&equirect_to_cube(&input, &rows, size), size);
                let exact = input.energy(&rows);
                worst = worst.max((sum.x / exact.x - 1.0).abs());
                worst = worst.max((sum.y / exact.y - 1.0).abs());
                assert_eq!(sum.z, 0.0);
            }
        }
        eprintln!("worst energy error of a single-texel sun: {worst:.2e}");
        assert!(worst < 1e-4, "{worst}");
    }

    #[test]
    fn labelled_map_puts_each_colour_on_its_axis() {
        let (width, height) = (64_u32, 32_u32);
        let axes = [
            DVec3::X,
            DVec3::NEG_X,
            DVec3::Y,
            DVec3::NEG_Y,
            DVec3::Z,
            DVec3::NEG_Z,
        ];
        let colours = [
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 1.0],
            [0.0, 1.0, 0.0],
            [1.0, 0.0, 1.0],
            [0.0, 0.0, 1.0],
            [1.0, 1.0, 0.0],
        ];
        let texels = (0..width * height)
            .map(|index| {
                let u = (f64::from(index % width) + 0.5) / f64::from(width);
                let v = (f64::from(index / width) + 0.5) / f64::from(height);
                let (longitude, polar) = ((u - 0.5) * 2.0 * PI, v * PI);
                let direction = DVec3::new(
                    libm::sin(polar) * libm::cos(longitude),
                    libm::cos(polar),
                    libm::sin(polar) * libm::sin(longitude),
                );
                axes.iter()
                    .position(|axis| axis.dot(direction) > 0.8)
                    .map_or([0.0; 3], |axis| colours[axis])
            })
            .collect();
        let size = 32;
        let cube = resample(
            &Equirect {
                width,
                height,
                texels,
            },
            size,
        );
        for (axis, colour) in axes.iter().zip(colours) {
            let texel = cube[texel_at(*axis, size)];
            for channel in 0..3 {
                assert!((texel[channel] - colour[channel]).abs() < 1e-6, "{axis}");
            }
        }
    }

    /// A map without any symmetry.
    fn speckled(width: u32, height: u32) -> Equirect {
        let texels = (0..width * height)
            .map(|i| [((i * 7919) % 101) as f32, ((i * 104_729) % 53) as f32, 1.0])
            .collect();
        Equirect {
            width,
            height,
            texels,
        }
    }

    #[test]
    fn mirrored_weights_are_those_of_every_texel() {
        let (width, height, size) = (24_u32, 13_u32, 16_u32);
        let input = speckled(width, height);
        let rows = Rows::new(height);
        let resampler = Resampler::new(&input, &rows, size);
        let shared = resample(&input, size);
        let side = size as usize;
        for face in 0..6 {
            let mut own = vec![[0.0; 3]; side * side];
            match side_face_turn(face) {
                Some(turn) => {
                    let columns = resampler.side_columns(turn);
                    resampler.face(&mut own, |x, y, taps| {
                        resampler.side_taps(&columns[x], y, taps);
                    });
                }
                None => resampler.face(&mut own, |x, y, taps| {
                    resampler.pole_taps(x, y, face == 2, taps);
                }),
            }
            for (index, (a, b)) in own.iter().zip(&shared[face * side * side..]).enumerate() {
                let difference = (a[0] - b[0]).abs().max((a[1] - b[1]).abs());
                assert!(
                    difference < 1e-4 * a[0].max(1.0),
                    "face {face} texel {index}: {a:?} {b:?}"
                );
            }
        }
    }

    #[test]
    fn texels_match_dense_supersampling_of_the_reconstruction() {
        let (width, height, size) = (24_u32, 12_u32, 8_u32);
        let input = speckled(width, height);
        let rows = Rows::new(height);
        let cube = equirect_to_cube(&input, &rows, size);
        let steps = 96;
        for index in (0..6 * 64).step_by(5) {
            let (face, x, y) = (index / 64, index % 8, index / 8 % 8);
            let (mut sum, mut area) = (DVec3::ZERO, 0.0);
            for k in 0..steps * steps {
                let offset = |k: usize| (k as f64 + 0.5) / steps as f64;
                let s = (x as f64 + offset(k % steps)) / 4.0 - 1.0;
                let t = (y as f64 + offset(k / steps)) / 4.0 - 1.0;
                let direction = DVec3::from(super::super::cubemap::face_direction(face, s, t));
                let weight = 1.0 / direction.length_squared().powf(1.5);
                let unit = direction.normalize();
                let column = (0.5 + libm::atan2(unit.z, unit.x) / (2.0 * PI)) * 24.0 - 0.5;
                let left = libm::floor(column);
                let blend = column - left;
                let left = (left as i64).rem_euclid(24) as usize;
                rows.blend(unit.y, |row, share| {
                    let value = input.texel(left, row) * (1.0 - blend)
                        + input.texel((left + 1) % 24, row) * blend;
                    sum += value * (share * weight);
                });
                area += weight;
            }
            let reference = sum / area;
            let error = (super::super::cubemap::to_f64(cube[index]) - reference).length();
            assert!(error < 2e-3 * reference.length(), "texel {index}: {error}");
        }
    }
}
