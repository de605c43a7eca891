//! Pictures to measure others against: path traced, supersampled, or read from a file.

use std::path::Path;

use cairn_format::Package;

use crate::PlayerError;
use crate::camera::Camera;
use crate::exr;
use crate::gpu::{Gpu, GpuOptions};
use crate::headless::trace::{TraceOptions, trace_on};
use crate::headless::{HeadlessOptions, Session};
use crate::metrics::Picture;
use crate::settings::{Mode, Settings};

/// Frames that the temporal filters of a supersampled picture get to settle.
const SETTLING: u32 = 8;

/// What a picture is measured against.
#[derive(Clone, Debug, PartialEq)]
pub enum Ruler {
    /// The path tracer with this many samples per pixel.
    PathTraced(u32),
    /// The raster picture at this many times its width and height, averaged: measures aliasing and noise, not
    /// light transport.
    Supersampled(u32),
}

impl Ruler {
    /// The best ruler of this device: the path tracer where it traces rays.
    pub fn best(gpu: &Gpu, samples: u32, size: [u32; 2]) -> Self {
        if gpu.traces_rays() {
            return Self::PathTraced(samples.max(1));
        }
        Self::supersampled(gpu, samples, size)
    }

    /// The raster picture with `samples` per pixel, or fewer where the device has not the size.
    pub fn supersampled(gpu: &Gpu, samples: u32, size: [u32; 2]) -> Self {
        let limit = gpu.limits().max_image_dimension2_d;
        let fits = |factor: &u32| size.iter().all(|side| side * factor <= limit);
        let wanted = samples.max(1).isqrt();
        Self::Supersampled((1..=wanted).rev().find(fits).unwrap_or(1))
    }

    /// Its name, with how many samples it takes.
    pub fn name(&self) -> String {
        match self {
            Self::PathTraced(samples) => format!("path tracer ({samples} samples)"),
            Self::Supersampled(factor) => {
                format!("supersampled raster ({} samples)", factor * factor)
            }
        }
    }

    /// What the ruler cannot measure, where there is such a thing.
    pub fn note(&self) -> Option<&'static str> {
        match self {
            Self::PathTraced(_) => None,
            Self::Supersampled(_) => Some(
                "not path traced: the reference is the raster picture with many samples per pixel, so the errors are \
                 those of aliasing and noise, not of light transport",
            ),
        }
    }

    /// Linear radiance of what `camera` sees.
    ///
    /// # Errors
    /// A size that the device cannot render; a bad package; failures of Vulkan.
    pub fn picture(
        &self,
        gpu: &Gpu,
        package: &Package,
        size: [u32; 2],
        camera: &Camera,
        settings: &Settings,
    ) -> Result<Picture, PlayerError> {
        match self {
            Self::PathTraced(samples) => traced(gpu, package, size, camera, settings, *samples),
            Self::Supersampled(factor) => {
                let large = size.map(|side| side * factor);
                let picture = raster(gpu, package, large, camera, settings, SETTLING)?;
                Ok(average(&picture, *factor as usize))
            }
        }
    }
}

fn traced(
    gpu: &Gpu,
    package: &Package,
    size: [u32; 2],
    camera: &Camera,
    settings: &Settings,
    samples: u32,
) -> Result<Picture, PlayerError> {
    let options = HeadlessOptions {
        size,
        camera: *camera,
        settings: Settings {
            mode: Mode::PathTrace,
            ..settings.clone()
        },
        frames: 1,
        hdr: true,
        gpu: GpuOptions::default(),
    };
    let limits = TraceOptions {
        samples: Some(samples),
        ..TraceOptions::default()
    };
    let image = trace_on(gpu, package, &options, &limits)?;
    let Some(radiance) = &image.hdr else {
        panic!("radiance was asked for")
    };
    Ok(Picture::from_rgba(
        size[0] as usize,
        size[1] as usize,
        radiance,
    ))
}

/// Linear radiance of the last of `frames` raster frames.
///
/// # Errors
/// A size that the device cannot render; a bad package; failures of Vulkan.
pub fn raster(
    gpu: &Gpu,
    package: &Package,
    size: [u32; 2],
    camera: &Camera,
    settings: &Settings,
    frames: u32,
) -> Result<Picture, PlayerError> {
    let mut session = Session::new(gpu, package, size, settings, true)?;
    for frame in 1..=frames {
        session.frame(camera, settings, frame == frames)?;
    }
    session.finish()?;
    session_picture(&session, size)
}

/// Linear radiance of a session's last copied frame.
///
/// # Errors
/// Failures of Vulkan.
///
/// # Panics
/// Where the session has no room for radiance.
pub fn session_picture(session: &Session<'_>, size: [u32; 2]) -> Result<Picture, PlayerError> {
    let radiance = session.radiance()?;
    let Some(radiance) = radiance else {
        panic!("the session was made without radiance")
    };
    Ok(Picture::from_rgba(
        size[0] as usize,
        size[1] as usize,
        &radiance,
    ))
}

/// Means of squares of `factor` texels a side; what is left over at the right and below is dropped.
pub fn average(picture: &Picture, factor: usize) -> Picture {
    let (width, height) = (picture.width / factor, picture.height / factor);
    let texel = |index: usize| {
        let (x, y) = (index % width * factor, index / width * factor);
        let mut sum = [0.0f64; 3];
        for row in y..y + factor {
            for texel in &picture.texels[row * picture.width + x..][..factor] {
                (0..3).for_each(|channel| sum[channel] += f64::from(texel[channel]));
            }
        }
        sum.map(|sum| (sum / (factor * factor) as f64) as f32)
    };
    Picture {
        width,
        height,
        texels: (0..width * height).map(texel).collect(),
    }
}

/// A reference on disk.
#[derive(Clone, Debug, PartialEq)]
pub enum Stored {
    /// Linear radiance, from OpenEXR.
    Radiance(Picture),
    /// Linear display values, from an 8-bit PNG.
    Display(Picture),
}

/// Reads an uncompressed EXR or an 8-bit RGB or RGBA PNG, by its first bytes.
///
/// # Errors
/// [`PlayerError::Input`] naming the file and what is wrong with it.
pub fn read(path: &Path) -> Result<Stored, PlayerError> {
    let fail = |what: String| PlayerError::Input(format!("{}: {what}", path.display()));
    let bytes = std::fs::read(path).map_err(|error| fail(error.to_string()))?;
    if bytes.starts_with(b"\x89PNG") {
        return Ok(Stored::Display(decode_png(&bytes).map_err(fail)?));
    }
    Ok(Stored::Radiance(exr::decode(&bytes).map_err(fail)?))
}

fn decode_png(bytes: &[u8]) -> Result<Picture, String> {
    let mut decoder = png::Decoder::new(std::io::Cursor::new(bytes));
    decoder.set_transformations(png::Transformations::EXPAND | png::Transformations::STRIP_16);
    let mut reader = decoder.read_info().map_err(|error| error.to_string())?;
    let size = reader.output_buffer_size().ok_or("too large")?;
    let mut pixels = vec![0; size];
    let info = reader
        .next_frame(&mut pixels)
        .map_err(|error| error.to_string())?;
    let channels = match info.color_type {
        png::ColorType::Rgb => 3,
        png::ColorType::Rgba => 4,
        other => return Err(format!("a PNG of {other:?}: RGB or RGBA is needed")),
    };
    let opaque = |texel: &[u8]| [texel[0], texel[1], texel[2], 255];
    let rgba: Vec<u8> = pixels[..info.buffer_size()]
        .chunks_exact(channels)
        .flat_map(opaque)
        .collect();
    Ok(Picture::from_srgb8(
        info.width as usize,
        info.height as usize,
        &rgba,
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn averages_are_means_of_squares() {
        let picture = Picture {
            width: 4,
            height: 2,
            texels: (0..8).map(|value| [value as f32, 1.0, 0.0]).collect(),
        };
        let small = average(&picture, 2);
        assert_eq!((small.width, small.height), (2, 1));
        assert_eq!(small.texels, [[2.5, 1.0, 0.0], [4.5, 1.0, 0.0]]);
    }

    #[test]
    fn what_we_write_is_read() {
        let folder = tempfile::tempdir().expect("a folder");
        let picture = Picture {
            width: 2,
            height: 1,
            texels: vec![[0.0, 0.5, 1.0], [0.25, 2.0, 0.125]],
        };
        let exr_file = folder.path().join("a.exr");
        std::fs::write(&exr_file, exr::encode(&picture)).expect("written");
        assert_eq!(
            read(&exr_file).expect("read"),
            Stored::Radiance(picture.clone())
        );
        let png_file = folder.path().join("a.png");
        crate::png::write(&png_file, 2, 1, &picture.to_srgb8()).expect("written");
        let Stored::Display(back) = read(&png_file).expect("read") else {
            panic!("radiance from a PNG")
        };
        assert_eq!(back.to_srgb8(), picture.to_srgb8());
        std::fs::write(&exr_file, b"nonsense").expect("written");
        assert!(
            read(&exr_file)
                .expect_err("refused")
                .to_string()
                .contains("a.exr")
        );
    }
}
