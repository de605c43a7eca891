//! How cubes of radiance are stored: BC6H, half floats, or a shared exponent, and what that costs.

use cairn_format::TextureFormat;
use half::f16;
use rayon::prelude::*;

use super::bc6h;
use crate::environment::{HALF_MAX, level_to_rgba16f};

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

impl SkyFormat {
    /// The package's format.
    pub fn texture_format(self) -> TextureFormat {
        match self {
            Self::Bc6h => TextureFormat::Bc6hUfloat,
            Self::Rgba16f => TextureFormat::Rgba16Float,
            Self::Rgb9e5 => TextureFormat::Rgb9e5Ufloat,
        }
    }

    /// Bytes of a cube level of faces `size` texels wide, and the sums of squared error and squared radiance
    /// over its texels, by decoding.
    pub fn encode(self, texels: &[[f32; 3]], size: u32) -> (Vec<u8>, [f64; 2]) {
        let (bytes, decoded) = match self {
            Self::Bc6h => encode_bc6h(texels, size as usize),
            Self::Rgba16f => {
                let half = |channel: f32| f16::from_f32(channel.clamp(0.0, HALF_MAX)).to_f32();
                let decoded = texels.iter().map(|texel| texel.map(half)).collect();
                (level_to_rgba16f(texels), decoded)
            }
            Self::Rgb9e5 => {
                let words: Vec<u32> = texels.iter().map(|texel| pack_rgb9e5(*texel)).collect();
                let decoded = words.iter().map(|word| unpack_rgb9e5(*word)).collect();
                (
                    words.into_iter().flat_map(u32::to_le_bytes).collect(),
                    decoded,
                )
            }
        };
        let decoded: Vec<[f32; 3]> = decoded;
        let mut sums = [0.0; 2];
        for (a, b) in texels.as_flattened().iter().zip(decoded.as_flattened()) {
            let (exact, stored) = (f64::from(*a), f64::from(*b));
            sums[0] += (exact - stored) * (exact - stored);
            sums[1] += exact * exact;
        }
        (bytes, sums)
    }
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

/// Blocks of all faces; blocks across an edge repeat the last row and column.
fn encode_bc6h(texels: &[[f32; 3]], side: usize) -> (Vec<u8>, Vec<[f32; 3]>) {
    let across = side.div_ceil(4);
    let half = |channel: f32| f16::from_f32(channel.clamp(0.0, HALF_MAX)).to_bits();
    let source = |block: usize, texel: usize| {
        let (face, row, column) = (
            block / (across * across),
            block / across % across,
            block % across,
        );
        let x = (4 * column + texel % 4).min(side - 1);
        let y = (4 * row + texel / 4).min(side - 1);
        (face * side + y) * side + x
    };
    let blocks: Vec<[u8; 16]> = (0..6 * across * across)
        .into_par_iter()
        .map(|block| {
            let gathered = std::array::from_fn(|k| texels[source(block, k)].map(half));
            bc6h::compress_block(&gathered)
        })
        .collect();
    let mut decoded = vec![[0.0; 3]; texels.len()];
    for (index, block) in blocks.iter().enumerate() {
        for (k, texel) in bc6h::decompress_block(block).into_iter().enumerate() {
            decoded[source(index, k)] = texel.map(|bits| f16::from_bits(bits).to_f32());
        }
    }
    (blocks.concat(), decoded)
}

/// `VK_FORMAT_E5B9G9R9_UFLOAT_PACK32` (Vulkan 1.3, "Shared Exponent to RGB").
fn pack_rgb9e5(texel: [f32; 3]) -> u32 {
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
            let (bytes, [error, scale]) = format.encode(&texels, size);
            let expected = 6 * format.texture_format().level_bytes(size, size);
            assert_eq!(bytes.len() as u64, expected);
            let relative = (error / scale).sqrt();
            assert!(relative < bound && relative > 0.0, "{format:?}: {relative}");
        }
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
            let [_, stored_inside, stored_across] = steps(&encode_bc6h(texels, side).1, side);
            eprintln!(
                "{side}: {across:.2e} across edges, {inside:.2e} between blocks; \
                 BC6H {stored_across:.2e}, {stored_inside:.2e}"
            );
            // The blocks on both sides of an edge are as far apart as any two neighbours: what differs is chance.
            assert!(across <= inside, "{side}");
            assert!(stored_across <= 1.05 * stored_inside, "{side}");
        }
    }
}
