//! Texture formats of a package: block layout, level sizes, chain lengths.

use rkyv::{Archive, Deserialize, Serialize};

/// How texel blocks are stored. Discriminants are part of the file format.
#[derive(
    Archive, Serialize, Deserialize, Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash,
)]
#[rkyv(attr(allow(missing_docs)), derive(Clone, Copy, Debug, PartialEq, Eq))]
#[repr(u8)]
pub enum TextureFormat {
    /// BC7, linear: `VK_FORMAT_BC7_UNORM_BLOCK`.
    Bc7Unorm = 0,
    /// BC7, sRGB colour and linear alpha: `VK_FORMAT_BC7_SRGB_BLOCK`.
    Bc7Srgb = 1,
    /// BC5, two linear channels: `VK_FORMAT_BC5_UNORM_BLOCK`. Normal maps: x and y, z rebuilt.
    Bc5Unorm = 2,
    /// BC4, one linear channel: `VK_FORMAT_BC4_UNORM_BLOCK`.
    Bc4Unorm = 3,
    /// BC6H, unsigned half floats: `VK_FORMAT_BC6H_UFLOAT_BLOCK`.
    Bc6hUfloat = 4,
    /// Four 8-bit linear channels: `VK_FORMAT_R8G8B8A8_UNORM`.
    Rgba8Unorm = 5,
    /// Four 8-bit channels, sRGB colour: `VK_FORMAT_R8G8B8A8_SRGB`.
    Rgba8Srgb = 6,
    /// Four half floats: `VK_FORMAT_R16G16B16A16_SFLOAT`.
    Rgba16Float = 7,
    /// Three 9-bit mantissas sharing a 5-bit exponent: `VK_FORMAT_E5B9G9R9_UFLOAT_PACK32`.
    Rgb9e5Ufloat = 8,
    /// Four 16-bit linear channels: `VK_FORMAT_R16G16B16A16_UNORM`.
    Rgba16Unorm = 9,
    /// UASTC LDR 4x4 blocks of Basis Universal, linear: the player transcodes them to what the device reads.
    UastcUnorm = 10,
    /// UASTC LDR 4x4 blocks, sRGB colour and linear alpha.
    UastcSrgb = 11,
}

impl ArchivedTextureFormat {
    /// The format, out of its archived form.
    pub const fn native(self) -> TextureFormat {
        match self {
            Self::Bc7Unorm => TextureFormat::Bc7Unorm,
            Self::Bc7Srgb => TextureFormat::Bc7Srgb,
            Self::Bc5Unorm => TextureFormat::Bc5Unorm,
            Self::Bc4Unorm => TextureFormat::Bc4Unorm,
            Self::Bc6hUfloat => TextureFormat::Bc6hUfloat,
            Self::Rgba8Unorm => TextureFormat::Rgba8Unorm,
            Self::Rgba8Srgb => TextureFormat::Rgba8Srgb,
            Self::Rgba16Float => TextureFormat::Rgba16Float,
            Self::Rgb9e5Ufloat => TextureFormat::Rgb9e5Ufloat,
            Self::Rgba16Unorm => TextureFormat::Rgba16Unorm,
            Self::UastcUnorm => TextureFormat::UastcUnorm,
            Self::UastcSrgb => TextureFormat::UastcSrgb,
        }
    }
}

impl TextureFormat {
    /// Every format, in the order of their values.
    pub const ALL: [Self; 12] = [
        Self::Bc7Unorm,
        Self::Bc7Srgb,
        Self::Bc5Unorm,
        Self::Bc4Unorm,
        Self::Bc6hUfloat,
        Self::Rgba8Unorm,
        Self::Rgba8Srgb,
        Self::Rgba16Float,
        Self::Rgb9e5Ufloat,
        Self::Rgba16Unorm,
        Self::UastcUnorm,
        Self::UastcSrgb,
    ];

    /// Width and height in texels of one block; 1 for uncompressed formats.
    pub const fn block_extent(self) -> u32 {
        match self {
            Self::Bc7Unorm
            | Self::Bc7Srgb
            | Self::Bc5Unorm
            | Self::Bc4Unorm
            | Self::Bc6hUfloat
            | Self::UastcUnorm
            | Self::UastcSrgb => 4,
            Self::Rgba8Unorm
            | Self::Rgba8Srgb
            | Self::Rgba16Float
            | Self::Rgb9e5Ufloat
            | Self::Rgba16Unorm => 1,
        }
    }

    /// Bytes of one block.
    pub const fn block_bytes(self) -> u32 {
        match self {
            Self::Bc7Unorm
            | Self::Bc7Srgb
            | Self::Bc5Unorm
            | Self::Bc6hUfloat
            | Self::UastcUnorm
            | Self::UastcSrgb => 16,
            Self::Bc4Unorm | Self::Rgba16Float | Self::Rgba16Unorm => 8,
            Self::Rgba8Unorm | Self::Rgba8Srgb | Self::Rgb9e5Ufloat => 4,
        }
    }

    /// Whether no device samples it: the player transcodes its blocks while it uploads.
    pub const fn is_universal(self) -> bool {
        matches!(self, Self::UastcUnorm | Self::UastcSrgb)
    }

    /// Bytes of one layer of a level of `width` x `height` texels, edge blocks whole.
    pub const fn level_bytes(self, width: u32, height: u32) -> u64 {
        let extent = self.block_extent();
        let blocks = width.div_ceil(extent) as u64 * height.div_ceil(extent) as u64;
        blocks * self.block_bytes() as u64
    }

    /// Whether sampling decodes colour from sRGB.
    pub const fn is_srgb(self) -> bool {
        matches!(self, Self::Bc7Srgb | Self::Rgba8Srgb | Self::UastcSrgb)
    }
}

/// Edge length of mip `level` of an image of edge length `extent`: `max(1, extent >> level)`.
pub const fn mip_extent(extent: u32, level: u32) -> u32 {
    let shifted = if level < 32 { extent >> level } else { 0 };
    if shifted == 0 { 1 } else { shifted }
}

/// Levels of a full chain down to 1x1: `1 + floor(log2(max(width, height)))`; 0 for an empty image.
pub const fn full_mip_count(width: u32, height: u32) -> u32 {
    let largest = if width > height { width } else { height };
    32 - largest.leading_zeros()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edge_blocks_are_whole() {
        assert_eq!(TextureFormat::Bc7Unorm.level_bytes(5, 3), 2 * 16);
        assert_eq!(TextureFormat::Bc4Unorm.level_bytes(1, 1), 8);
        assert_eq!(TextureFormat::Rgba16Float.level_bytes(3, 3), 72);
    }

    #[test]
    fn chains_end_at_one_texel() {
        for (width, height, count) in [(1, 1, 1), (2, 1, 2), (5, 3, 3), (256, 17, 9), (0, 0, 0)] {
            assert_eq!(full_mip_count(width, height), count);
        }
        assert_eq!(mip_extent(5, 1), 2);
        assert_eq!(mip_extent(5, 40), 1);
    }
}
