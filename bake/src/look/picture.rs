//! Small pictures of images, for terminals and pages.

use cairn_format::TextureFormat;
use cairn_format::scene::{ArchivedImage, ArchivedImageRole};
use cairn_format::texture::mip_extent;

use super::decode::{Plane, layer};
use crate::encode::srgb;
use crate::environment::texel_at;

/// 8-bit sRGB with straight alpha, rows from the top.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// Texels.
    pub width: u32,
    /// Texels.
    pub height: u32,
    /// Red, green, blue, alpha.
    pub texels: Vec<[u8; 4]>,
}

impl Picture {
    /// The picture as the bytes of a PNG.
    pub fn png(&self) -> Vec<u8> {
        use image::ImageEncoder;
        let mut bytes = Vec::new();
        let encoder = image::codecs::png::PngEncoder::new(&mut bytes);
        encoder
            .write_image(
                self.texels.as_flattened(),
                self.width,
                self.height,
                image::ExtendedColorType::Rgba8,
            )
            .unwrap_or_else(|error| {
                unreachable!("a picture is {}x{}: {error}", self.width, self.height)
            });
        bytes
    }

    /// Rows of text: two texels over each other in a character, colours by 24-bit escape sequences, transparency
    /// over grey.
    pub fn half_blocks(&self) -> Vec<String> {
        use std::fmt::Write;
        let over_grey = |[r, g, b, a]: [u8; 4]| {
            [r, g, b].map(|channel| {
                let mixed = u32::from(channel) * u32::from(a) + 128 * (255 - u32::from(a));
                mixed / 255
            })
        };
        let rows = self.texels.chunks(2 * self.width as usize);
        rows.map(|pair| {
            let (upper, lower) = pair.split_at(self.width as usize);
            let mut text = String::new();
            for (x, texel) in upper.iter().enumerate() {
                let [r, g, b] = over_grey(*texel);
                let _ = write!(text, "\x1b[38;2;{r};{g};{b}");
                if let Some(texel) = lower.get(x) {
                    let [r, g, b] = over_grey(*texel);
                    let _ = write!(text, ";48;2;{r};{g};{b}");
                }
                text.push_str("m\u{2580}");
            }
            text.push_str("\x1b[0m");
            text
        })
        .collect()
    }
}

/// A picture of an image, `size` texels at most on either side: of a cube its panorama, of radiance a tonemapped
/// one, of normals with z rebuilt, of data its channels as they are.
///
/// # Panics
/// Where `texels` is not the texel section of the image's package.
pub fn thumbnail(image: &ArchivedImage, texels: &[u8], size: u32) -> Picture {
    level_picture(image, texels, level_for(image, size), size)
}

/// A [`thumbnail`] of one level.
///
/// # Panics
/// As [`thumbnail`], or where there is no such level.
pub fn level_picture(image: &ArchivedImage, texels: &[u8], level: usize, size: u32) -> Picture {
    let mut plane = if image.layers.to_native() == 6 {
        panorama(image, texels, level, size)
    } else {
        layer(image, texels, level, 0)
    };
    match image.role {
        ArchivedImageRole::Normal if plane.format == TextureFormat::Bc5Unorm => {
            plane.texels.iter_mut().for_each(rebuild_z);
        }
        _ => {}
    }
    if image.layers.to_native() == 6 {
        tonemap(&mut plane.texels);
    } else if image.role == ArchivedImageRole::Environment {
        // A table of fractions, whose fourth is no coverage.
        plane.texels.iter_mut().for_each(|texel| texel[3] = 1.0);
    }
    let light = plane.format.is_srgb();
    shrink(&plane, size, light)
}

/// The smallest level that still has `size` texels on its longer side.
fn level_for(image: &ArchivedImage, size: u32) -> usize {
    let longer = image.width.to_native().max(image.height.to_native());
    let fine = |level: &usize| mip_extent(longer, *level as u32) >= size;
    (0..image.levels.len()).rev().find(fine).unwrap_or(0)
}

/// A cube seen all around: u = 0.5 + atan2(z, x) / 2 pi, v = acos(y) / pi.
fn panorama(image: &ArchivedImage, texels: &[u8], level: usize, size: u32) -> Plane {
    let faces: Vec<Plane> = (0..6)
        .map(|face| layer(image, texels, level, face))
        .collect();
    let side = faces[0].width;
    let (width, height) = (size, size.div_ceil(2));
    let mut out = Vec::with_capacity((width * height) as usize);
    for y in 0..height {
        for x in 0..width {
            let polar = std::f64::consts::PI * (f64::from(y) + 0.5) / f64::from(height);
            let turn = (f64::from(x) + 0.5) / f64::from(width) - 0.5;
            let azimuth = std::f64::consts::TAU * turn;
            let (sine, cosine) = (libm::sin(polar), libm::cos(polar));
            let direction = [sine * libm::cos(azimuth), cosine, sine * libm::sin(azimuth)];
            let index = texel_at(direction.into(), side);
            let face = index / (side * side) as usize;
            out.push(faces[face].texels[index % (side * side) as usize]);
        }
    }
    Plane {
        format: faces[0].format,
        width,
        height,
        texels: out,
    }
}

fn rebuild_z(texel: &mut [f32; 4]) {
    let [x, y] = [2.0 * texel[0] - 1.0, 2.0 * texel[1] - 1.0];
    texel[2] = 0.5 + 0.5 * (1.0 - x * x - y * y).max(0.0).sqrt();
}

/// Exposes radiance so that its logarithmic mean is a middle grey, and bends what is brighter (Reinhard et al. 2002);
/// stores sRGB.
fn tonemap(texels: &mut [[f32; 4]]) {
    let luminance = |[r, g, b, _]: &[f32; 4]| 0.2126 * r + 0.7152 * g + 0.0722 * b;
    let sum: f64 = texels
        .iter()
        .map(|texel| libm::log(f64::from(luminance(texel)).max(1e-6)))
        .sum();
    let mean = libm::exp(sum / texels.len().max(1) as f64) as f32;
    let exposure = 0.18 / mean;
    for texel in texels {
        for channel in &mut texel[..3] {
            let exposed = *channel * exposure;
            *channel = srgb::encode((exposed / (1.0 + exposed)).clamp(0.0, 1.0));
        }
        texel[3] = 1.0;
    }
}

/// Means over the texels of each cell; in linear light where `light`.
fn shrink(plane: &Plane, size: u32, light: bool) -> Picture {
    let longer = plane.width.max(plane.height).max(1);
    let scaled = |side: u32| {
        let scaled = (u64::from(side) * u64::from(size)).div_ceil(u64::from(longer));
        (scaled as u32).clamp(1, side)
    };
    let (width, height) = (scaled(plane.width), scaled(plane.height));
    let span = |index: u32, count: u32, side: u32| {
        let edge = |index: u32| (u64::from(index) * u64::from(side) / u64::from(count)) as u32;
        edge(index)..edge(index + 1).max(edge(index) + 1)
    };
    let code = |value: f32| (value.clamp(0.0, 1.0) * 255.0).round() as u8;
    let mut texels = Vec::with_capacity((width * height) as usize);
    for y in 0..height {
        for x in 0..width {
            let (mut sum, mut count) = ([0.0; 4], 0.0);
            for row in span(y, height, plane.height) {
                for column in span(x, width, plane.width) {
                    let texel = plane.texels[(row * plane.width + column) as usize];
                    for (channel, (sum, value)) in sum.iter_mut().zip(texel).enumerate() {
                        *sum += if light && channel < 3 {
                            srgb::decode_u8(code(value))
                        } else {
                            value
                        };
                    }
                    count += 1.0;
                }
            }
            let [r, g, b, a] = sum.map(|sum| sum / count);
            let color =
                [r, g, b].map(|value| code(if light { srgb::encode(value) } else { value }));
            texels.push([color[0], color[1], color[2], code(a)]);
        }
    }
    Picture {
        width,
        height,
        texels,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plane(width: u32, height: u32, texels: Vec<[f32; 4]>) -> Plane {
        Plane {
            format: TextureFormat::Rgba8Srgb,
            width,
            height,
            texels,
        }
    }

    #[test]
    fn shrinking_is_a_mean_in_linear_light() {
        let black_and_white = vec![[0.0, 0.0, 0.0, 1.0], [1.0, 1.0, 1.0, 0.0]];
        let small = shrink(&plane(2, 1, black_and_white.clone()), 1, true);
        assert_eq!((small.width, small.height), (1, 1));
        // Half of the light is 188 in sRGB; alpha has no curve.
        assert_eq!(small.texels, [[188, 188, 188, 128]]);
        assert_eq!(
            shrink(&plane(2, 1, black_and_white), 1, false).texels,
            [[128; 4]]
        );
    }

    #[test]
    fn thin_images_keep_a_texel() {
        let small = shrink(&plane(300, 1, vec![[0.5; 4]; 300]), 16, false);
        assert_eq!((small.width, small.height), (16, 1));
    }

    #[test]
    fn a_character_holds_two_texels() {
        let picture = Picture {
            width: 1,
            height: 3,
            texels: vec![[255, 0, 0, 255], [0, 255, 0, 255], [9, 9, 9, 0]],
        };
        let rows = picture.half_blocks();
        assert_eq!(rows[0], "\x1b[38;2;255;0;0;48;2;0;255;0m\u{2580}\x1b[0m");
        assert_eq!(rows[1], "\x1b[38;2;128;128;128m\u{2580}\x1b[0m");
    }

    #[test]
    fn pictures_are_png() {
        let picture = Picture {
            width: 2,
            height: 1,
            texels: vec![[1, 2, 3, 4], [5, 6, 7, 8]],
        };
        let read = image::load_from_memory(&picture.png())
            .expect("a PNG")
            .to_rgba8();
        assert_eq!(read.as_raw().as_slice(), picture.texels.as_flattened());
    }
}
