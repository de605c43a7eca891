//! How cubes of radiance are stored: BC6H, half floats, or a shared exponent, and what that costs.

use half::f16;
use rayon::prelude::*;

use super::{Codec, bc6h};
use crate::environment::HALF_MAX;

/// Storage of the sky and of the prefiltered cube.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum SkyFormat {
    /// One byte a texel.
    #[default]
    Bc6h,
    /// Half floats, eight bytes a texel.
    Rgba16f,
    /// Nine bits a channel under one exponent, four bytes a texel.
    Rgb9e5,
}

/// What storing radiance lost.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RadianceError {
    /// Sums over the channels: of the squared error, and of the squared radiance.
    squares: [f64; 2],
    pub log: LogError,
}

impl RadianceError {
    /// Of a stored cube level of faces `size` texels wide, by decoding.
    pub fn of(codec: Codec, texels: &[[f32; 3]], size: u32, bytes: &[u8]) -> Self {
        // Sums of equal parts, in order, so that they do not depend on the number of threads.
        let parts: Vec<Self> = match codec {
            Codec::Bc6h { .. } => {
                let grid = BlockGrid {
                    side: size as usize,
                };
                let blocks = bytes.as_chunks::<16>().0;
                let parts = blocks.par_chunks(PART).enumerate().map(|(part, blocks)| {
                    let mut error = Self::default();
                    for (at, block) in blocks.iter().enumerate() {
                        let decoded = bc6h::decompress_block(block);
                        for (texel, bits) in decoded.into_iter().enumerate() {
                            if let Some(index) = grid.inside(part * PART + at, texel) {
                                error.texel(texels[index], bits.map(half_value));
                            }
                        }
                    }
                    error
                });
                parts.collect()
            }
            Codec::SharedExponent => {
                let words = bytes.as_chunks::<4>().0;
                Self::parts(texels, |index| {
                    unpack_rgb9e5(u32::from_le_bytes(words[index]))
                })
            }
            _ => {
                let halves = bytes.as_chunks::<8>().0;
                Self::parts(texels, |index| {
                    let [r0, r1, g0, g1, b0, b1, ..] = halves[index];
                    [[r0, r1], [g0, g1], [b0, b1]].map(|bytes| f16::from_le_bytes(bytes).to_f32())
                })
            }
        };
        let mut error = Self::default();
        for part in parts {
            error.merge(&part);
        }
        error
    }

    fn parts(texels: &[[f32; 3]], stored: impl Fn(usize) -> [f32; 3] + Sync) -> Vec<Self> {
        let parts = texels.par_chunks(16 * PART).enumerate();
        let parts = parts.map(|(part, texels)| {
            let mut error = Self::default();
            for (at, texel) in texels.iter().enumerate() {
                error.texel(*texel, stored(part * 16 * PART + at));
            }
            error
        });
        parts.collect()
    }

    /// Adds a texel.
    pub fn texel(&mut self, exact: [f32; 3], stored: [f32; 3]) {
        for (exact, stored) in exact.into_iter().zip(stored) {
            let (exact, stored) = (f64::from(exact), f64::from(stored));
            self.squares[0] += (exact - stored) * (exact - stored);
            self.squares[1] += exact * exact;
            self.log.add(exact, stored);
        }
    }

    /// Adds the error of other texels.
    pub fn merge(&mut self, other: &Self) {
        for (sum, part) in self.squares.iter_mut().zip(other.squares) {
            *sum += part;
        }
        self.log.squares += other.log.squares;
        self.log.count += other.log.count;
    }

    /// Root of the squared error over the squared radiance; 0 of black.
    pub fn relative_rms(&self) -> f64 {
        let [error, scale] = self.squares;
        if scale > 0.0 {
            (error / scale).sqrt()
        } else {
            0.0
        }
    }
}

/// Blocks whose error is summed at once.
const PART: usize = 256;

/// The nearest half float from 0 to the largest; 0 of what is negative, the sign of zero included, or no number.
pub(crate) fn half_bits(channel: f32) -> u16 {
    if channel > 0.0 {
        f16::from_f32(channel.min(HALF_MAX)).to_bits()
    } else {
        0
    }
}

fn half_value(bits: u16) -> f32 {
    f16::from_bits(bits).to_f32()
}

/// Error of radiance in stops: of base-2 logarithms of channels, which count as the smallest normal half where they are
/// below it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LogError {
    squares: f64,
    count: u64,
}

impl LogError {
    /// Adds a channel.
    pub fn add(&mut self, exact: f64, stored: f64) {
        let floor = f16::MIN_POSITIVE.to_f64();
        let stops = log2(stored.max(floor) / exact.max(floor));
        self.squares += stops * stops;
        self.count += 1;
    }

    /// The root of the mean squared error against the 30 stops of normal halves, decibels; 999 where nothing was lost.
    pub fn psnr_db(&self) -> f64 {
        if self.squares > 0.0 {
            10.0 * libm::log10(900.0 * self.count as f64 / self.squares)
        } else {
            999.0
        }
    }
}

/// Within 1e-6, for positive normal numbers: the series of the inverse hyperbolic tangent about the nearest power.
fn log2(value: f64) -> f64 {
    let bits = value.to_bits();
    // The power of two that leaves sqrt(1/2) to sqrt(2).
    let power = ((bits + (0x3ff0_0000_0000_0000 - 0x3fe6_a09e_667f_3bcd)) >> 52) as i64 - 1023;
    let scaled = f64::from_bits((bits as i64 - (power << 52)) as u64);
    let t = (scaled - 1.0) / (scaled + 1.0);
    let square = t * t;
    let series = 1.0 + square * (1.0 / 3.0 + square * (0.2 + square * (1.0 / 7.0 + square / 9.0)));
    power as f64 + 2.0 * std::f64::consts::LOG2_E * t * series
}

/// The blocks of all faces, `side` texels wide, one face after the other; blocks across an edge repeat the last row and
/// column.
#[derive(Clone, Copy)]
pub(super) struct BlockGrid {
    pub side: usize,
}

impl BlockGrid {
    pub fn blocks(self) -> usize {
        let across = self.side.div_ceil(4);
        6 * across * across
    }

    /// Column and row of a block's texel, and its face.
    fn place(self, block: usize, texel: usize) -> [usize; 3] {
        let across = self.side.div_ceil(4);
        let (row, column) = (block / across % across, block % across);
        let face = block / (across * across);
        [4 * column + texel % 4, 4 * row + texel / 4, face]
    }

    /// The index of a block's texel, unless it lies beyond the edge.
    fn inside(self, block: usize, texel: usize) -> Option<usize> {
        let [x, y, face] = self.place(block, texel);
        (x < self.side && y < self.side).then_some((face * self.side + y) * self.side + x)
    }

    /// The half floats of a block; what is negative or no number becomes 0.
    pub fn gather(self, texels: &[[f32; 3]], block: usize) -> [[u16; 3]; 16] {
        let [left, top, face] = self.place(block, 0);
        std::array::from_fn(|texel| {
            let x = (left + texel % 4).min(self.side - 1);
            let y = (top + texel / 4).min(self.side - 1);
            texels[(face * self.side + y) * self.side + x].map(half_bits)
        })
    }
}

/// `VK_FORMAT_E5B9G9R9_UFLOAT_PACK32` (Vulkan 1.3, "Shared Exponent to RGB").
pub(super) fn pack_rgb9e5(texel: [f32; 3]) -> u32 {
    let clamped = texel.map(|channel| channel.clamp(0.0, 65408.0));
    let largest = clamped.iter().copied().fold(0.0, f32::max);
    // Exponent of the float, read from its bits so that no logarithm rounds.
    let float = (largest.to_bits() >> 23) as i32 - 127;
    let mut exponent = float.max(-16) + 16;
    let scaled = |value: f32, exponent: i32| {
        let unit = f64::from(value) / f64::from_bits(((1023 + exponent - 24) as u64) << 52);
        libm::floor(unit + 0.5) as u32
    };
    if scaled(largest, exponent) == 512 {
        exponent += 1;
    }
    let [r, g, b] = clamped.map(|channel| scaled(channel, exponent));
    r | g << 9 | b << 18 | (exponent as u32) << 27
}

pub(crate) fn unpack_rgb9e5(word: u32) -> [f32; 3] {
    let scale = f32::from_bits((127 + (word >> 27) - 24) << 23);
    [0, 9, 18].map(|shift| ((word >> shift) & 511) as f32 * scale)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encode::{Effort, Quality};
    use crate::environment::{
        EnvironmentOptions, Equirect, SunMode, bake_environment, face_direction, texel_at,
    };

    #[test]
    fn shared_exponents_round_to_half_a_step() {
        for value in [0.0, 1e-6, 0.3, 1.0, 511.6, 1023.9, 65408.0, 1e9] {
            let got = unpack_rgb9e5(pack_rgb9e5([value, 0.5 * value, 0.0]));
            let clamped = value.min(65408.0);
            let step = (clamped / 256.0).max(2.0_f32.powi(-24));
            assert!((got[0] - clamped).abs() <= 0.5 * step, "{value}: {got:?}");
            assert_eq!(got[2], 0.0);
        }
    }

    #[test]
    fn every_format_states_its_error() {
        let size = 6;
        let texels: Vec<[f32; 3]> = (0..6 * 36)
            .map(|i| [1.0 + 0.02 * (i % 6) as f32, 0.7, 0.1 * (i % 7) as f32])
            .collect();
        for (format, bound) in [
            (SkyFormat::Rgba16f, 3e-4),
            (SkyFormat::Rgb9e5, 2e-3),
            (SkyFormat::Bc6h, 0.2),
        ] {
            let codec = Codec::radiance(format, Effort::default());
            let bytes = codec.compress_cube(&texels, size);
            let expected = 6 * codec.radiance_format().level_bytes(size, size);
            assert_eq!(bytes.len() as u64, expected);
            let error = RadianceError::of(codec, &texels, size, &bytes);
            let relative = error.relative_rms();
            assert!(relative < bound && relative > 0.0, "{format:?}: {relative}");
            // In stops, of which this bound is about the half.
            let stops = 30.0 / libm::pow(10.0, error.log.psnr_db() / 20.0);
            assert!(stops > 0.0 && stops < 3.0 * bound, "{format:?}: {stops}");
        }
    }

    /// A level as BC6H stores it.
    fn decoded(texels: &[[f32; 3]], side: usize, quality: Quality) -> Vec<[f32; 3]> {
        let bytes = Codec::Bc6h { quality }.compress_cube(texels, side as u32);
        let grid = BlockGrid { side };
        let mut decoded = vec![[-1.0; 3]; texels.len()];
        for (index, block) in bytes.as_chunks::<16>().0.iter().enumerate() {
            for (k, bits) in bc6h::decompress_block(block).into_iter().enumerate() {
                if let Some(at) = grid.inside(index, k) {
                    decoded[at] = bits.map(half_value);
                }
            }
        }
        decoded
    }

    #[test]
    fn levels_below_a_block_repeat_their_edge() {
        for side in [1, 2, 3, 5] {
            let texels: Vec<[f32; 3]> = (0..6 * side * side)
                .map(|i| [0.5 + 0.01 * i as f32, 0.25, 0.125])
                .collect();
            let grid = BlockGrid { side };
            for block in 0..grid.blocks() {
                let [.., face] = grid.place(block, 0);
                for (texel, bits) in grid.gather(&texels, block).into_iter().enumerate() {
                    let [x, y, _] = grid.place(block, texel).map(|at| at.min(side - 1));
                    let exact = texels[(face * side + y) * side + x];
                    assert_eq!(bits, exact.map(|channel| f16::from_f32(channel).to_bits()));
                }
            }
            for quality in Quality::ALL {
                let stored = decoded(&texels, side, quality);
                for (a, b) in texels.as_flattened().iter().zip(stored.as_flattened()) {
                    assert!((a - b).abs() < 0.02 * a, "{side}: {a} {b}");
                }
            }
        }
    }

    #[test]
    fn what_is_no_radiance_is_clamped() {
        let hostile = [f32::NAN, -1.0, f32::INFINITY, f32::NEG_INFINITY, 1e9, -0.0];
        let texels: Vec<[f32; 3]> = (0..6 * 16).map(|i| [hostile[i % 6]; 3]).collect();
        for quality in Quality::ALL {
            for (exact, stored) in texels.iter().zip(decoded(&texels, 4, quality)) {
                let expected = if exact[0] > 0.0 { HALF_MAX } else { 0.0 };
                assert_eq!(stored, [expected; 3], "{quality:?} {exact:?}");
            }
        }
    }

    #[test]
    fn stops_are_those_of_the_logarithm() {
        for value in [1e-4, 0.3, 0.706, 0.708, 1.0, 1.413, 1.415, 7.7, 6e4] {
            assert!((log2(value) - libm::log2(value)).abs() < 1e-6, "{value}");
        }
        let mut error = LogError::default();
        assert_eq!(error.psnr_db(), 999.0);
        error.add(1.0, 2.0);
        error.add(0.0, 1e-5);
        // One stop in one channel of two, against 30.
        assert!((error.psnr_db() - 10.0 * libm::log10(1800.0)).abs() < 1e-6);
    }

    /// Root mean square steps between neighbouring texels: inside blocks, between the blocks of a face, and across the
    /// edges of faces.
    fn steps(texels: &[[f32; 3]], side: usize) -> [f64; 3] {
        let mut sums = [[0.0; 2]; 3];
        for index in 0..texels.len() {
            let (face, x, y) = (index / (side * side), index % side, index / side % side);
            for (dx, dy) in [(1, 0), (0, 1), (-1, 0), (0, -1)] {
                let coordinate = |at: i64| {
                    let at = (2.0 * at as f64 + 1.0) / side as f64 - 1.0;
                    // Just beyond the edge, where the border of the next face lies.
                    at.clamp(-1.0 - 1e-6, 1.0 + 1e-6)
                };
                let (s, t) = (coordinate(x as i64 + dx), coordinate(y as i64 + dy));
                let block = |x: i64, y: i64| (x.div_euclid(4), y.div_euclid(4));
                let (x, y) = (x as i64, y as i64);
                let kind = if s.abs() > 1.0 || t.abs() > 1.0 {
                    2
                } else {
                    usize::from(block(x, y) != block(x + dx, y + dy))
                };
                let direction = glam::DVec3::from(face_direction(face, s, t));
                let next = texels[texel_at(direction, side as u32)];
                let pairs = texels[index].iter().zip(next);
                let squared: f64 = pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum();
                sums[kind][0] += squared;
                sums[kind][1] += 1.0;
            }
        }
        sums.map(|[sum, count]: [f64; 2]| (sum / count).sqrt())
    }

    /// Blocks end at the edges of faces, as they do within them: an edge is no rougher for it.
    #[test]
    fn edges_of_compressed_cubes_are_as_even_as_faces() {
        let (width, height) = (256_u32, 128_u32);
        let texels = (0..width * height).map(|index| {
            let u = f64::from(index % width) / f64::from(width) * std::f64::consts::TAU;
            let v = f64::from(index / width) / f64::from(height) * std::f64::consts::PI;
            let wave = 1.0 + 0.5 * (3.0 * u).sin() * v.sin() + 0.3 * (5.0 * v).cos();
            [
                wave as f32,
                (0.5 * wave) as f32,
                0.7 + 0.2 * (2.0 * u).cos() as f32,
            ]
        });
        let map = Equirect {
            width,
            height,
            texels: texels.collect(),
        };
        let options = EnvironmentOptions {
            sky_size: Some(64),
            prefiltered_size: 32,
            probes: 0,
            sun: SunMode::Keep,
            ..EnvironmentOptions::default()
        };
        let products = bake_environment(map, &options, &|_, _| {});
        for (cube, level) in [(&products.sky, 0), (&products.prefiltered, 1)] {
            let (texels, side) = (&cube.levels[level], cube.level_size(level) as usize);
            let [_, inside, across] = steps(texels, side);
            assert!(across <= inside, "{side}");
            for quality in Quality::ALL {
                let stored = decoded(texels, side, quality);
                let [_, stored_inside, stored_across] = steps(&stored, side);
                eprintln!(
                    "{side}: {across:.2e} across edges, {inside:.2e} between blocks; \
                     BC6H {} {stored_across:.2e}, {stored_inside:.2e}",
                    quality.name()
                );
                // The blocks on both sides of an edge are as far apart as any two neighbours: what differs is chance.
                assert!(stored_across <= 1.05 * stored_inside, "{side}");
            }
        }
    }
}
