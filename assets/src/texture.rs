//! Eight-bit images for the procedural textures.

use libm::round;

/// An interleaved 8-bit image, row 0 at the top.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Image {
    pub width: usize,
    pub height: usize,
    /// 3 (RGB) or 4 (RGBA).
    pub channels: usize,
    pub data: Vec<u8>,
}

/// A value in 0..1 as a byte, rounded to nearest.
pub fn byte(value: f64) -> u8 {
    round(value.clamp(0.0, 1.0) * 255.0) as u8
}

impl Image {
    /// Calls `shade` with the texel centre (u, v) in 0..1, v downwards, for each texel.
    pub fn from_fn<const N: usize>(
        width: usize,
        height: usize,
        mut shade: impl FnMut(f64, f64) -> [f64; N],
    ) -> Self {
        let mut data = Vec::with_capacity(width * height * N);
        for y in 0..height {
            for x in 0..width {
                let u = (x as f64 + 0.5) / width as f64;
                let v = (y as f64 + 0.5) / height as f64;
                data.extend(shade(u, v).map(byte));
            }
        }
        Self {
            width,
            height,
            channels: N,
            data,
        }
    }

    /// Tangent-space normal map of a repeating height field, green up the image (glTF 2.0, 3.9.3).
    ///
    /// `height` gives heights in the unit in which the image is 1 wide, so slopes are true slopes.
    pub fn normals_from_height(size: usize, height: impl Fn(f64, f64) -> f64) -> Self {
        let step = 1.0 / size as f64;
        Self::from_fn(size, size, |u, v| {
            let du = (height(u + step, v) - height(u - step, v)) / (2.0 * step);
            let dv = (height(u, v + step) - height(u, v - step)) / (2.0 * step);
            let length = libm::sqrt(du * du + dv * dv + 1.0);
            [-du, dv, 1.0].map(|n| n / length * 0.5 + 0.5)
        })
    }

    /// The image as a PNG with the strongest compression and a filter chosen per row.
    pub fn encode_png(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.width as u32, self.height as u32);
        encoder.set_color(match self.channels {
            3 => png::ColorType::Rgb,
            _ => png::ColorType::Rgba,
        });
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_compression(png::Compression::High);
        encoder.set_filter(png::Filter::Adaptive);
        let mut writer = encoder.write_header().expect("a Vec takes every write");
        writer
            .write_image_data(&self.data)
            .expect("the data has the header's size");
        writer.finish().expect("a Vec takes every write");
        bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normals_point_away_from_rising_ground() {
        let period = std::f64::consts::TAU;
        let ramp = Image::normals_from_height(64, |u, _| 0.05 * libm::sin(u * period));
        assert!(ramp.data[0] < 100, "rising to the right tilts to the left");
        let down = Image::normals_from_height(64, |_, v| 0.05 * libm::sin(v * period));
        assert!(down.data[1] > 155, "rising downwards tilts up the image");
        for texel in ramp.data.chunks(3).chain(down.data.chunks(3)) {
            let n: Vec<f64> = texel.iter().map(|&b| f64::from(b) / 127.5 - 1.0).collect();
            let length = n.iter().map(|c| c * c).sum::<f64>();
            assert!((length - 1.0).abs() < 0.02, "{n:?}");
        }
    }

    #[test]
    fn png_round_trips() {
        let image = Image::from_fn(7, 5, |u, v| [u, v, u * v, 1.0 - u]);
        let png = image.encode_png();
        let mut reader = png::Decoder::new(std::io::Cursor::new(png))
            .read_info()
            .expect("our own PNG");
        let mut data = vec![0; reader.output_buffer_size().expect("small")];
        let info = reader.next_frame(&mut data).expect("our own PNG");
        assert_eq!((info.width, info.height), (7, 5));
        assert_eq!(data, image.data);
    }
}
