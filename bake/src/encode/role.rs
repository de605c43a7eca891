//! What a texture is used for, which decides its block format and the space it is filtered in.

use cairn_format::TextureFormat;
use glam::Vec3;

use super::{Target, srgb};

/// Vectors shorter than this carry no direction: an 8-bit normal map cannot store zero exactly, and writes
/// it as 127 or 128 in each channel, a vector of length up to 0.007.
const SHORTEST_NORMAL: f32 = 0.02;

/// The use of a texture by the materials that read it.
#[derive(
    rkyv::Archive,
    rkyv::Serialize,
    rkyv::Deserialize,
    Clone,
    Copy,
    Debug,
    PartialEq,
    Eq,
    Hash,
    PartialOrd,
    Ord,
)]
pub enum Role {
    /// Base colour or emissive: sRGB colour, linear alpha; BC7.
    Color,
    /// Linear values in three or four channels; BC7.
    Data,
    /// Two linear values, in red and green; BC5.
    Pair,
    /// One linear value, in red; BC4.
    Single,
    /// Tangent-space normals: x and y of the unit vector as `0.5 v + 0.5`; BC5. The shader computes
    /// `v = 2 t - 1`, then `z = sqrt(max(0, 1 - x^2 - y^2))`.
    Normal,
}

impl Role {
    /// The format its blocks are stored in.
    pub const fn format(self, target: Target) -> TextureFormat {
        match (target, self) {
            (Target::Desktop, Self::Color) => TextureFormat::Bc7Srgb,
            (Target::Desktop, Self::Data) => TextureFormat::Bc7Unorm,
            (Target::Desktop, Self::Pair | Self::Normal) => TextureFormat::Bc5Unorm,
            (Target::Desktop, Self::Single) => TextureFormat::Bc4Unorm,
            (Target::Uncompressed, Self::Color) => TextureFormat::Rgba8Srgb,
            (Target::Uncompressed, Self::Data | Self::Pair | Self::Single) => {
                TextureFormat::Rgba8Unorm
            }
            (Target::Uncompressed, Self::Normal) => TextureFormat::Rgba16Unorm,
            (Target::Portable, Self::Color) => TextureFormat::UastcSrgb,
            (Target::Portable, _) => TextureFormat::UastcUnorm,
        }
    }

    /// Stored channels that are red and green of pairs and normals: universal blocks store the second as alpha,
    /// which modes of luminance and alpha keep apart.
    pub const fn pair_channels(self, target: Target) -> [usize; 2] {
        match (target, self) {
            (Target::Portable, Self::Pair | Self::Normal) => [0, 3],
            _ => [0, 1],
        }
    }

    /// Leading channels that carry data, where the alpha of colours does so or not.
    pub(super) const fn channels(self, alpha: bool) -> usize {
        match (self, alpha) {
            (Self::Single, _) => 1,
            (Self::Pair | Self::Normal, _) => 2,
            (Self::Color | Self::Data, false) => 3,
            (Self::Color | Self::Data, true) => 4,
        }
    }

    /// A source texel in the space it is filtered in: linear light and straight alpha for colour, the
    /// values themselves for data, a unit vector of the upper hemisphere (w = 1) for normals.
    pub(super) fn filterable(self, texel: [u16; 4]) -> [f32; 4] {
        let unorm = texel.map(|code| f32::from(code) / 65535.0);
        match self {
            Self::Color => [
                srgb::decode_u16(texel[0]),
                srgb::decode_u16(texel[1]),
                srgb::decode_u16(texel[2]),
                unorm[3],
            ],
            Self::Data | Self::Pair | Self::Single => unorm,
            Self::Normal => {
                let [x, y, z, _] = unorm.map(|value| 2.0 * value - 1.0);
                unit_normal([x, y, z.max(0.0), 1.0])
            }
        }
    }

    /// A filtered texel as it would be stored with unlimited precision, in [0,1].
    pub(super) fn stored(self, texel: [f32; 4]) -> [f32; 4] {
        match self {
            Self::Color => [
                srgb::encode(texel[0]),
                srgb::encode(texel[1]),
                srgb::encode(texel[2]),
                texel[3],
            ],
            Self::Data | Self::Pair | Self::Single => texel,
            Self::Normal => {
                let [x, y, ..] = unit_normal(texel);
                [0.5 * x + 0.5, 0.5 * y + 0.5, 0.0, 1.0]
            }
        }
    }

    /// A filtered texel in the 8-bit codes that the block encoders read, halves rounded up.
    pub(super) fn codes(self, texel: [f32; 4]) -> [u8; 4] {
        match self {
            Self::Color => [
                srgb::encode_u8(texel[0]),
                srgb::encode_u8(texel[1]),
                srgb::encode_u8(texel[2]),
                unorm8(texel[3]),
            ],
            _ => self.stored(texel).map(unorm8),
        }
    }
}

/// The nearest 8-bit code of a value in [0,1], halves rounded up; clamps, and NaN gives 0.
pub(super) fn unorm8(value: f32) -> u8 {
    (value * 255.0 + 0.5) as u8
}

/// The nearest 16-bit code of a value in [0,1]; clamps.
pub(super) fn unorm16(value: f32) -> u16 {
    (value * 65535.0 + 0.5) as u16
}

/// xyz normalised; (0,0,1) where it has no direction.
pub(super) fn unit_normal(texel: [f32; 4]) -> [f32; 4] {
    let vector = Vec3::new(texel[0], texel[1], texel[2]);
    let length = vector.length();
    // A NaN length must fail the test too.
    let unit = if length >= SHORTEST_NORMAL && length.is_finite() {
        vector / length
    } else {
        Vec3::Z
    };
    [unit.x, unit.y, unit.z, 1.0]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wide(texel: [u8; 4]) -> [u16; 4] {
        texel.map(|code| u16::from(code) * 257)
    }

    #[test]
    fn eight_bit_colour_and_data_keep_their_codes() {
        for code in 0..=255_u8 {
            let texel = [code, 255 - code, code / 2, code];
            for role in [Role::Color, Role::Data] {
                assert_eq!(role.codes(role.filterable(wide(texel))), texel, "{role:?}");
            }
        }
    }

    #[test]
    fn rounding_is_half_up() {
        assert_eq!(unorm8(0.5), 128);
        assert_eq!(unorm8(0.0), 0);
        assert_eq!(unorm8(1.0), 255);
        assert_eq!(unorm8(-0.1), 0);
        assert_eq!(unorm8(1.1), 255);
        assert_eq!(unorm8(f32::NAN), 0);
    }

    #[test]
    fn normals_without_direction_point_up() {
        for texel in [
            [128, 128, 128, 255],
            [127, 127, 127, 255],
            [128, 128, 0, 255],
        ] {
            assert_eq!(
                Role::Normal.filterable(wide(texel)),
                [0.0, 0.0, 1.0, 1.0],
                "{texel:?}"
            );
        }
        assert_eq!(unit_normal([f32::NAN, 0.0, 1.0, 1.0]), [0.0, 0.0, 1.0, 1.0]);
        assert_eq!(unit_normal([0.0; 4]), [0.0, 0.0, 1.0, 1.0]);
    }

    #[test]
    fn normals_are_unit_before_they_are_stored() {
        // A vector of length 0.5 along x and z.
        let texel = [32768 + 11585, 32768, 32768 + 11585, 65535];
        let [x, y, z, _] = Role::Normal.filterable(texel);
        assert!((x - std::f32::consts::FRAC_1_SQRT_2).abs() < 1e-4);
        assert!(y.abs() < 1e-4 && (z - x).abs() < 1e-4);
    }
}
