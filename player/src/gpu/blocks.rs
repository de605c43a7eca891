//! Families of block-compressed formats: what a device has, and what it may be asked for.

use ash::vk;

/// Families of block-compressed formats.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Blocks {
    /// BC1 to BC7: `textureCompressionBC`.
    pub bc: bool,
    /// ASTC, low dynamic range: `textureCompressionASTC_LDR`.
    pub astc: bool,
}

/// Which families may be used. Less than all shows here what another device would show.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum AllowedBlocks {
    /// All that the device has.
    #[default]
    All,
    /// ASTC alone, as on most mobile GPUs.
    Astc,
    /// None: textures are uncompressed.
    None,
}

impl Blocks {
    /// Those of `self` that are allowed.
    pub(super) fn of(self, allowed: AllowedBlocks) -> Self {
        Self {
            bc: self.bc && allowed == AllowedBlocks::All,
            astc: self.astc && allowed != AllowedBlocks::None,
        }
    }

    /// Name of the family that `format` belongs to, where it is none of these.
    pub(super) fn lacks(self, format: vk::Format) -> Option<&'static str> {
        let within = |first: vk::Format, last: vk::Format| {
            (first.as_raw()..=last.as_raw()).contains(&format.as_raw())
        };
        let bc = within(vk::Format::BC1_RGB_UNORM_BLOCK, vk::Format::BC7_SRGB_BLOCK);
        let astc = within(
            vk::Format::ASTC_4X4_UNORM_BLOCK,
            vk::Format::ASTC_12X12_SRGB_BLOCK,
        );
        match (bc && !self.bc, astc && !self.astc) {
            (true, _) => Some("BC"),
            (_, true) => Some("ASTC"),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn families_are_told_by_format() {
        let none = Blocks::default();
        assert_eq!(none.lacks(vk::Format::BC7_SRGB_BLOCK), Some("BC"));
        assert_eq!(none.lacks(vk::Format::BC6H_UFLOAT_BLOCK), Some("BC"));
        assert_eq!(none.lacks(vk::Format::ASTC_4X4_SRGB_BLOCK), Some("ASTC"));
        assert_eq!(none.lacks(vk::Format::R8G8B8A8_SRGB), None);
        let all = Blocks {
            bc: true,
            astc: true,
        };
        assert_eq!(all.lacks(vk::Format::BC4_UNORM_BLOCK), None);
        let mobile = all.of(AllowedBlocks::Astc);
        assert_eq!((mobile.bc, mobile.astc), (false, true));
        assert_eq!(all.of(AllowedBlocks::None), none);
        assert_eq!(none.of(AllowedBlocks::All), none);
    }
}
