//! Contents of a package as files of other programs.

mod dds;
mod exr;
mod ktx2;
mod ply;

use cairn_format::TextureFormat;
use cairn_format::scene::ArchivedImage;
use cairn_format::texture::mip_extent;

pub use self::exr::exr;
pub use dds::dds;
pub use ktx2::ktx2;
pub use ply::ply;

use super::decode::layer;

/// A level of a 2D image as a PNG of what shaders read: sRGB or linear codes as they are stored, 16 bits where the
/// package has them.
///
/// # Errors
/// Where the image is a cube or holds radiance, which no PNG can.
pub fn png(image: &ArchivedImage, texels: &[u8], level: usize) -> Result<Vec<u8>, String> {
    if image.layers.to_native() != 1 {
        return Err("a cube is no PNG; write .exr, .dds or .ktx2".into());
    }
    let plane = layer(image, texels, level, 0);
    let deep = match plane.format {
        TextureFormat::Bc6hUfloat | TextureFormat::Rgba16Float | TextureFormat::Rgb9e5Ufloat => {
            return Err("a PNG holds no radiance; write .exr, .dds or .ktx2".into());
        }
        TextureFormat::Rgba16Unorm => true,
        _ => false,
    };
    let code = |value: &f32, largest: f32| (value.clamp(0.0, 1.0) * largest).round();
    let values = plane.texels.as_flattened();
    let (bytes, kind): (Vec<u8>, _) = if deep {
        let codes = values.iter().map(|value| code(value, 65535.0) as u16);
        (
            codes.flat_map(u16::to_ne_bytes).collect(),
            image::ExtendedColorType::Rgba16,
        )
    } else {
        let codes = values.iter().map(|value| code(value, 255.0) as u8);
        (codes.collect(), image::ExtendedColorType::Rgba8)
    };
    use image::ImageEncoder;
    let mut out = Vec::new();
    image::codecs::png::PngEncoder::new(&mut out)
        .write_image(&bytes, plane.width, plane.height, kind)
        .map_err(|error| error.to_string())?;
    Ok(out)
}

/// Bytes of one layer of one level, as they are stored.
fn stored<'a>(image: &ArchivedImage, texels: &'a [u8], level: usize, layer: u32) -> &'a [u8] {
    let format = image.format.native();
    let extent = |side: u32| mip_extent(side, level as u32);
    let bytes = format.level_bytes(
        extent(image.width.to_native()),
        extent(image.height.to_native()),
    );
    let start = image.levels[level].offset.to_native() + u64::from(layer) * bytes;
    &texels[start as usize..(start + bytes) as usize]
}
