//! The block encoders behind one interface: what a role may be stored as, and how a level becomes blocks. Radiance too.

use cairn_format::TextureFormat;
use rayon::prelude::*;

use super::bc::Image;
use super::ispc;
use super::role::unorm16;
use super::{
    Effort, EncodeOptions, Kernels, Quality, Role, SkyFormat, Target, bc5, bc6h, bc7, hdr, uastc,
};
use crate::environment::level_to_rgba16f;

/// Blocks of one task: enough to fill the lanes of the BC7 search with blocks of one kind.
const BLOCKS_PER_CALL: usize = 256;

/// A block encoder at one setting.
#[derive(rkyv::Archive, rkyv::Serialize, rkyv::Deserialize, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Codec {
    /// Four channels of 8-bit codes; the squared error of the codes is made small.
    Bc7 { quality: Quality, kernels: Kernels },
    /// The first two stored channels, from f32.
    Bc5,
    /// The first stored channel, from f32.
    Bc4,
    /// Universal blocks: four channels, or luminance and alpha of what has one or two, from f32.
    Uastc { quality: Quality },
    /// No blocks: the codes as they are, normals in 16 bits.
    Plain,
    /// Not encoded: the universal blocks of the file.
    Passed,
    /// Not encoded: the universal blocks of the file, rewritten as BC7.
    Transcoded,
    /// Radiance; the squared error of half floats' bits is made small.
    Bc6h { quality: Quality },
    /// Radiance in half floats.
    Half,
    /// Radiance in nine bits a channel under one exponent.
    SharedExponent,
}

impl Codec {
    /// The encoders of a role, from the cheapest up.
    pub fn ladder(role: Role, kernels: Kernels, target: Target) -> Vec<Self> {
        match role.format(target) {
            TextureFormat::UastcUnorm | TextureFormat::UastcSrgb => {
                Quality::ALL.map(|quality| Self::Uastc { quality }).to_vec()
            }
            TextureFormat::Bc5Unorm => vec![Self::Bc5],
            TextureFormat::Bc4Unorm => vec![Self::Bc4],
            TextureFormat::Rgba8Srgb | TextureFormat::Rgba8Unorm | TextureFormat::Rgba16Unorm => {
                vec![Self::Plain]
            }
            _ => Quality::ALL
                .map(|quality| Self::Bc7 { quality, kernels })
                .to_vec(),
        }
    }

    /// The encoders that `options` allow for a role, from the cheapest up: one, or all where a PSNR is the target.
    pub fn allowed(role: Role, options: &EncodeOptions) -> Vec<Self> {
        let ladder = Self::ladder(role, options.kernels, options.target);
        match options.effort {
            super::Effort::AtLeast { .. } => ladder,
            super::Effort::Preset(quality) => {
                let rung = Quality::ALL.iter().position(|&one| one == quality);
                let rung = rung.unwrap_or(0).min(ladder.len() - 1);
                vec![ladder[rung]]
            }
        }
    }

    /// The encoder of radiance that options allow; a target in decibels is one of 8-bit codes, and gives the default.
    pub fn radiance(format: SkyFormat, effort: Effort) -> Self {
        match (format, effort) {
            (SkyFormat::Bc6h, Effort::Preset(quality)) => Self::Bc6h { quality },
            (SkyFormat::Bc6h, Effort::AtLeast { .. }) => Self::Bc6h {
                quality: Quality::Default,
            },
            (SkyFormat::Rgba16f, _) => Self::Half,
            (SkyFormat::Rgb9e5, _) => Self::SharedExponent,
        }
    }

    /// The format of radiance.
    ///
    /// # Panics
    /// If the encoder is one of images.
    pub fn radiance_format(self) -> TextureFormat {
        match self {
            Self::Bc6h { .. } => TextureFormat::Bc6hUfloat,
            Self::Half => TextureFormat::Rgba16Float,
            Self::SharedExponent => TextureFormat::Rgb9e5Ufloat,
            _ => unreachable!("an encoder of images"),
        }
    }

    /// As reports have it: the preset, and whether the bytes depend on the machine. Empty where there is no choice.
    pub fn setting(self) -> String {
        match self {
            Self::Bc7 {
                quality,
                kernels: Kernels::Reproducible,
            } => quality.name().into(),
            Self::Bc7 { quality, .. } => format!("{} native", quality.name()),
            Self::Uastc { quality } | Self::Bc6h { quality } => quality.name().into(),
            Self::Passed => "passed through".into(),
            Self::Transcoded => "transcoded".into(),
            Self::Bc5 | Self::Bc4 | Self::Plain | Self::Half | Self::SharedExponent => {
                String::new()
            }
        }
    }

    const fn block_bytes(self) -> usize {
        match self {
            Self::Bc7 { .. } | Self::Bc5 | Self::Uastc { .. } | Self::Bc6h { .. } => 16,
            Self::Bc4 => 8,
            Self::Plain | Self::Passed | Self::Transcoded | Self::Half | Self::SharedExponent => {
                unreachable!()
            }
        }
    }

    /// Compresses an image, blocks in rows; blocks across the edge repeat the last row and column. The bytes do not
    /// depend on the number of threads.
    pub(super) fn compress(self, role: Role, image: &Image) -> Vec<u8> {
        if self == Self::Plain {
            return plain(role, image);
        }
        let count = image.blocks_across() * image.height.div_ceil(4) as usize;
        let bytes = self.block_bytes();
        let mut out = vec![0_u8; count * bytes];
        out.par_chunks_mut(BLOCKS_PER_CALL * bytes)
            .enumerate()
            .for_each(|(call, out)| self.run(role, image, call * BLOCKS_PER_CALL, out));
        out
    }

    /// Blocks of an encoder from `first` on, `BLOCKS_PER_CALL` at most.
    fn run(self, role: Role, image: &Image, first: usize, out: &mut [u8]) {
        let count = out.len() / self.block_bytes();
        match self {
            Self::Bc7 { quality, kernels } => {
                let mut blocks = [[[0_u8; 4]; 16]; BLOCKS_PER_CALL];
                for (at, block) in blocks[..count].iter_mut().enumerate() {
                    *block = image.gather(image.codes, first + at);
                }
                let out = out.as_chunks_mut::<16>().0;
                match kernels {
                    Kernels::Reproducible => {
                        bc7::compress(&blocks[..count], quality, image.alpha_is_read, out);
                    }
                    Kernels::Native => ispc::bc7(quality, &blocks[..count], out),
                }
            }
            Self::Bc5 => {
                for (at, out) in out.as_chunks_mut::<16>().0.iter_mut().enumerate() {
                    let texels = image.gather(image.exact, first + at);
                    let stored = texels.map(|texel| role.stored(texel));
                    *out = bc5::compress_block(&stored.map(|[x, y, ..]| [x, y]));
                }
            }
            Self::Bc4 => {
                for (at, out) in out.as_chunks_mut::<8>().0.iter_mut().enumerate() {
                    let texels = image.gather(image.exact, first + at);
                    *out = bc5::compress_channel(&texels.map(|texel| role.stored(texel)[0]));
                }
            }
            Self::Uastc { quality } => {
                let search = uastc::Search::of(quality);
                for (at, out) in out.as_chunks_mut::<16>().0.iter_mut().enumerate() {
                    let texels = universal(role, image, first + at);
                    *out = uastc::compress_block(&texels, true, search);
                }
            }
            Self::Plain
            | Self::Passed
            | Self::Transcoded
            | Self::Bc6h { .. }
            | Self::Half
            | Self::SharedExponent => unreachable!("no block encoder of images"),
        }
    }

    /// Stores a cube level of faces `size` texels wide. The bytes do not depend on the number of threads.
    ///
    /// # Panics
    /// If the encoder is one of images.
    pub fn compress_cube(self, texels: &[[f32; 3]], size: u32) -> Vec<u8> {
        match self {
            Self::Bc6h { quality } => {
                let grid = hdr::BlockGrid {
                    side: size as usize,
                };
                let mut out = vec![0_u8; grid.blocks() * self.block_bytes()];
                out.par_chunks_mut(BLOCKS_PER_CALL * self.block_bytes())
                    .enumerate()
                    .for_each(|(call, out)| {
                        let out = out.as_chunks_mut::<16>().0;
                        let mut blocks = [[[0_u16; 3]; 16]; BLOCKS_PER_CALL];
                        for (at, block) in blocks[..out.len()].iter_mut().enumerate() {
                            *block = grid.gather(texels, call * BLOCKS_PER_CALL + at);
                        }
                        bc6h::compress(&blocks[..out.len()], quality, out);
                    });
                out
            }
            Self::Half => level_to_rgba16f(texels),
            Self::SharedExponent => {
                let words = texels.iter().map(|texel| hdr::pack_rgb9e5(*texel));
                words.flat_map(u32::to_le_bytes).collect()
            }
            _ => unreachable!("an encoder of images"),
        }
    }
}

/// The texels of a level, row by row.
fn plain(role: Role, image: &Image) -> Vec<u8> {
    if role != Role::Normal {
        return image.codes.as_flattened().to_vec();
    }
    let wide = image.exact.iter().flat_map(|&texel| role.stored(texel));
    wide.flat_map(|value| unorm16(value).to_le_bytes())
        .collect()
}

/// A block in the channels that universal blocks store, 0 to 255. Colour and data keep the codes, whose alpha may
/// have been changed.
fn universal(role: Role, image: &Image, block: usize) -> uastc::Texels {
    if matches!(role, Role::Color | Role::Data) {
        let codes = image.gather(image.codes, block);
        return codes.map(|code| code.map(f32::from));
    }
    image.gather(image.exact, block).map(|texel| {
        let [x, y, ..] = role
            .stored(texel)
            .map(|value| (value * 255.0).clamp(0.0, 255.0));
        let second = if role == Role::Single { 255.0 } else { y };
        [x, x, x, second]
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encode::Effort;

    #[test]
    fn presets_choose_one_rung_and_targets_all() {
        for quality in Quality::ALL {
            let options = EncodeOptions {
                effort: quality.into(),
                ..EncodeOptions::default()
            };
            let kernels = Kernels::Reproducible;
            let bc7 = Codec::Bc7 { quality, kernels };
            assert_eq!(Codec::allowed(Role::Color, &options), [bc7]);
            assert_eq!(Codec::allowed(Role::Normal, &options), [Codec::Bc5]);
            assert_eq!(Codec::allowed(Role::Pair, &options), [Codec::Bc5]);
            assert_eq!(Codec::allowed(Role::Single, &options), [Codec::Bc4]);
            let portable = EncodeOptions {
                target: Target::Portable,
                ..options
            };
            for role in [Role::Color, Role::Single, Role::Normal] {
                let uastc = Codec::Uastc { quality };
                assert_eq!(Codec::allowed(role, &portable), [uastc]);
            }
        }
        let options = EncodeOptions {
            effort: Effort::AtLeast { centibel: 4200 },
            kernels: Kernels::Native,
            ..EncodeOptions::default()
        };
        let all = Codec::allowed(Role::Data, &options);
        let settings: Vec<String> = all.into_iter().map(Codec::setting).collect();
        assert_eq!(settings, ["fast native", "default native", "best native"]);
    }

    #[test]
    fn radiance_has_the_preset_of_images() {
        for quality in Quality::ALL {
            let bc6h = Codec::radiance(SkyFormat::Bc6h, quality.into());
            assert_eq!(bc6h, Codec::Bc6h { quality });
            assert_eq!(bc6h.setting(), quality.name());
        }
        let target = Effort::AtLeast { centibel: 4200 };
        assert_eq!(
            Codec::radiance(SkyFormat::Bc6h, target),
            Codec::radiance(SkyFormat::Bc6h, Effort::default())
        );
        let exact = Codec::radiance(SkyFormat::Rgba16f, target);
        assert_eq!((exact, exact.setting().as_str()), (Codec::Half, ""));
    }

    #[test]
    fn uncompressed_texels_lose_rounding_alone() {
        let exact: Vec<[f32; 4]> = (0..35)
            .map(|index| [0.3 * (index as f32 * 0.7).sin(), 0.2, 0.9, 1.0])
            .collect();
        let image = Image {
            width: 7,
            height: 5,
            codes: &[],
            exact: &exact,
            alpha_is_read: false,
        };
        let format = Role::Normal.format(Target::Uncompressed);
        let level = Codec::Plain.compress(Role::Normal, &image);
        assert_eq!(level.len() as u64, format.level_bytes(7, 5));
        let block = crate::encode::bc::decode_plain(format, &level, [7, 5], [1, 1]);
        for (texel, [x, y, ..]) in block.into_iter().enumerate() {
            let (column, row) = (4 + texel % 4, 4 + texel / 4);
            if column >= 7 || row >= 5 {
                assert_eq!([x, y], [0.0; 2]);
                continue;
            }
            let [expected_x, expected_y, ..] = Role::Normal.stored(exact[row * 7 + column]);
            assert!((x - expected_x).abs() < 1e-5 && (y - expected_y).abs() < 1e-5);
        }
        let codes = [[1, 2, 3, 4], [250, 0, 9, 255]];
        let image = Image {
            width: 2,
            height: 1,
            codes: &codes,
            exact: &[],
            alpha_is_read: true,
        };
        let level = Codec::Plain.compress(Role::Color, &image);
        assert_eq!(level, codes.as_flattened());
    }

    #[test]
    fn one_channel_of_bc4_is_that_of_bc5() {
        let exact: Vec<[f32; 4]> = (0..35)
            .map(|index| [(index as f32 / 34.0).powi(2), 0.5, 0.0, 1.0])
            .collect();
        let image = Image {
            width: 7,
            height: 5,
            codes: &[],
            exact: &exact,
            alpha_is_read: true,
        };
        let (one, two) = (
            Codec::Bc4.compress(Role::Data, &image),
            Codec::Bc5.compress(Role::Data, &image),
        );
        assert_eq!(one.len(), 4 * 8);
        for (one, two) in one.chunks(8).zip(two.chunks(16)) {
            assert_eq!(one, &two[..8]);
        }
    }
}
