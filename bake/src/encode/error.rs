//! Error of compressed blocks against the f32 level they were made of.

use cairn_format::TextureFormat;
use rayon::prelude::*;
use serde::Serialize;

use super::role::{Role, unit_normal};
use super::{bc, srgb};

/// Angles between stored and exact normals, degrees.
#[derive(
    rkyv::Archive, rkyv::Serialize, rkyv::Deserialize, Clone, Copy, Debug, PartialEq, Serialize,
)]
pub struct AngleError {
    pub p50: f64,
    pub p99: f64,
    pub max: f64,
}

/// Error of one level.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct LevelError {
    /// Of the stored values in [0,1]; infinite where they are exact.
    pub psnr_db: f64,
    /// The same of RGB in linear light, for colour.
    pub psnr_linear_light_db: Option<f64>,
    /// 99th percentile over blocks of the RMS error of the stored values, in steps of 1/255.
    pub p99_block_rmse: f64,
    pub angle_deg: Option<AngleError>,
}

impl LevelError {
    /// That of blocks which are the source itself.
    pub fn none(role: Role) -> Self {
        Self {
            psnr_db: f64::INFINITY,
            psnr_linear_light_db: (role == Role::Color).then_some(f64::INFINITY),
            p99_block_rmse: 0.0,
            angle_deg: None,
        }
    }
}

/// One level and its exact values.
pub(super) struct Level<'a, F> {
    pub role: Role,
    pub format: TextureFormat,
    /// Stored channels of pairs and normals.
    pub places: [usize; 2],
    pub width: u32,
    pub height: u32,
    pub blocks: &'a [u8],
    /// The f32 level, in the role's filterable space.
    pub exact: &'a [[f32; 4]],
    /// The exact stored value of the texel at an index: `role.stored(exact[index])`, or a cheaper source of it.
    pub stored: F,
    /// Leading channels that carry data.
    pub channels: usize,
}

/// Sums over the texels of one block that lie inside the image.
struct BlockError {
    texels: usize,
    stored: f64,
    linear: f64,
    /// Squared distances of unit normals.
    chords: [f32; 16],
}

impl<F: Fn(usize) -> [f32; 4] + Sync> Level<'_, F> {
    pub fn measure(&self) -> LevelError {
        let [across, down] = [self.width, self.height].map(|size| size.div_ceil(4) as usize);
        let blocks: Vec<BlockError> = (0..across * down)
            .into_par_iter()
            .map(|index| self.measure_block(index, [index % across, index / across]))
            .collect();
        let texels: usize = blocks.iter().map(|block| block.texels).sum();
        let stored: f64 = blocks.iter().map(|block| block.stored).sum();
        let linear: f64 = blocks.iter().map(|block| block.linear).sum();
        let mut rmse: Vec<f32> = blocks
            .iter()
            .map(|block| {
                let mean = block.stored / (block.texels * self.channels) as f64;
                (mean.sqrt() * 255.0) as f32
            })
            .collect();
        LevelError {
            psnr_db: psnr(stored / (texels * self.channels) as f64),
            psnr_linear_light_db: (self.role == Role::Color)
                .then(|| psnr(linear / (texels * 3) as f64)),
            p99_block_rmse: f64::from(percentile(&mut rmse, 0.99)),
            angle_deg: (self.role == Role::Normal).then(|| angles(&blocks)),
        }
    }

    fn decode(&self, index: usize, block: [usize; 2]) -> bc::Block {
        let format = self.format;
        if format.block_extent() == 1 {
            let size = [self.width as usize, self.height as usize];
            return bc::decode_plain(format, self.blocks, size, block);
        }
        let bytes = format.block_bytes() as usize;
        bc::decode_block(format, &self.blocks[index * bytes..][..bytes])
    }

    fn measure_block(&self, index: usize, block: [usize; 2]) -> BlockError {
        let decoded = self.decode(index, block);
        let [first, second] = self.places;
        let mut error = BlockError {
            texels: 0,
            stored: 0.0,
            linear: 0.0,
            chords: [0.0; 16],
        };
        for (texel, &[r, g, b, a]) in decoded.iter().enumerate() {
            let value = [[r, g, b, a][first], [r, g, b, a][second], b, a];
            let x = block[0] * 4 + texel % 4;
            let y = block[1] * 4 + texel / 4;
            if x >= self.width as usize || y >= self.height as usize {
                continue;
            }
            let index = y * self.width as usize + x;
            let stored = (self.stored)(index);
            error.stored += squared_distance(&value[..self.channels], &stored[..self.channels]);
            match self.role {
                Role::Color => {
                    let light = value.map(|v| srgb::decode_u8((v * 255.0).round() as u8));
                    error.linear += squared_distance(&light[..3], &self.exact[index][..3]);
                }
                Role::Data | Role::Pair | Role::Single => {}
                Role::Normal => {
                    let exact = unit_normal(self.exact[index]);
                    error.chords[error.texels] =
                        squared_distance(&rebuilt_normal(value), &exact[..3]) as f32;
                }
            }
            error.texels += 1;
        }
        error
    }
}

/// The normal that a shader reads: z rebuilt from x and y.
fn rebuilt_normal(texel: [f32; 4]) -> [f32; 3] {
    let (x, y) = (2.0 * texel[0] - 1.0, 2.0 * texel[1] - 1.0);
    let z = (1.0 - x * x - y * y).max(0.0).sqrt();
    let length = (x * x + y * y + z * z).sqrt();
    [x / length, y / length, z / length]
}

fn squared_distance(a: &[f32], b: &[f32]) -> f64 {
    a.iter()
        .zip(b)
        .map(|(a, b)| {
            let difference = f64::from(a - b);
            difference * difference
        })
        .sum()
}

/// Peak 1 over a mean squared error, decibels.
fn psnr(mean_squared: f64) -> f64 {
    -10.0 * libm::log10(mean_squared)
}

fn angles(blocks: &[BlockError]) -> AngleError {
    let mut chords: Vec<f32> = blocks
        .iter()
        .flat_map(|block| &block.chords[..block.texels])
        .copied()
        .collect();
    let mut degrees = |share: f64| {
        let chord = f64::from(percentile(&mut chords, share)).sqrt();
        2.0 * libm::asin((0.5 * chord).min(1.0)).to_degrees()
    };
    AngleError {
        p50: degrees(0.5),
        p99: degrees(0.99),
        max: degrees(1.0),
    }
}

/// The least value that at least `share` of `values` do not exceed. `values` is reordered.
fn percentile(values: &mut [f32], share: f64) -> f32 {
    let rank = (share * values.len() as f64).ceil() as usize;
    let index = rank.clamp(1, values.len()) - 1;
    *values.select_nth_unstable_by(index, f32::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_nearest_ranks() {
        let mut values: Vec<f32> = (1..=200_u8).rev().map(f32::from).collect();
        assert_eq!(percentile(&mut values, 0.5), 100.0);
        assert_eq!(percentile(&mut values, 0.99), 198.0);
        assert_eq!(percentile(&mut values, 1.0), 200.0);
        assert_eq!(percentile(&mut [7.0], 0.01), 7.0);
    }

    #[test]
    fn psnr_of_one_step() {
        let step = 1.0_f64 / 255.0;
        assert!((psnr(step * step) - 48.130_803_608_679_1).abs() < 1e-9);
        assert_eq!(psnr(0.0), f64::INFINITY);
    }

    /// A flat BC5 block of code 128 in both channels against a normal tilted by a known angle.
    #[test]
    fn angle_of_a_known_block() {
        let channel = [128, 128, 0, 0, 0, 0, 0, 0];
        let blocks = [channel, channel].concat();
        let tilt = 10.0_f64.to_radians();
        let exact = [[tilt.sin() as f32, 0.0, tilt.cos() as f32, 1.0]; 6];
        let error = Level {
            role: Role::Normal,
            format: TextureFormat::Bc5Unorm,
            places: [0, 1],
            width: 3,
            height: 2,
            blocks: &blocks,
            exact: &exact,
            stored: |index| Role::Normal.stored(exact[index]),
            channels: 2,
        }
        .measure();
        let code = 2.0 * 128.0 / 255.0 - 1.0_f64;
        let stored = glam::DVec3::new(code, code, (1.0 - 2.0 * code * code).sqrt());
        let expected = stored
            .dot(glam::DVec3::new(tilt.sin(), 0.0, tilt.cos()))
            .acos();
        let angle = error.angle_deg.expect("a normal map");
        for value in [angle.p50, angle.p99, angle.max] {
            assert!((value - expected.to_degrees()).abs() < 1e-4, "{value}");
        }
        let mean = ((tilt.sin() - code) * 0.5).powi(2) / 2.0 + (0.5 * code).powi(2) / 2.0;
        assert!((error.psnr_db + 10.0 * mean.log10()).abs() < 1e-3);
    }
}
