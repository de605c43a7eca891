//! OpenEXR pictures of linear values, uncompressed 32-bit floats.

use std::io::Cursor;

use ::exr::prelude::{Encoding, Image, SpecificChannels, WritableImage};
use cairn_format::scene::ArchivedImage;

use super::layer;
use crate::encode::srgb;

/// A level of an image: sRGB colour decoded to linear light, radiance as it is stored (times the environment's scale
/// it is the source's). The faces of a cube stand one under the other, +X -X +Y -Y +Z -Z, each as Vulkan orders its
/// rows.
///
/// # Errors
/// What the encoder says.
pub fn exr(image: &ArchivedImage, texels: &[u8], level: usize) -> Result<Vec<u8>, String> {
    let layers = (0..image.layers.to_native()).map(|face| layer(image, texels, level, face));
    let planes: Vec<_> = layers.collect();
    let (width, height) = (planes[0].width as usize, planes[0].height as usize);
    let is_srgb = planes[0].format.is_srgb();
    let linear = |code: f32| {
        if is_srgb {
            srgb::decode_u8((code * 255.0).round() as u8)
        } else {
            code
        }
    };
    let channels = SpecificChannels::rgba(|at: ::exr::math::Vec2<usize>| {
        let [r, g, b, a] = planes[at.y() / height].texels[at.y() % height * width + at.x()];
        (linear(r), linear(g), linear(b), a)
    });
    let mut picture = Image::from_channels((width, height * planes.len()), channels);
    picture.layer_data.encoding = Encoding::UNCOMPRESSED;
    let mut out = Cursor::new(Vec::new());
    let written = picture.write().to_buffered(&mut out);
    written.map_err(|error| error.to_string())?;
    Ok(out.into_inner())
}
