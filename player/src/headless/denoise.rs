//! Denoising of a path-traced picture that is to be looked at; a reference is never denoised.

use std::time::Instant;

use super::HeadlessImage;
use crate::PlayerError;
use crate::metrics::{Picture, display};
use crate::settings::Settings;

#[cfg(feature = "oidn")]
pub use crate::gpu::oidn::Denoiser;

/// The denoiser of a build without one: it cannot be had.
#[cfg(not(feature = "oidn"))]
#[derive(Debug)]
pub enum Denoiser {}

#[cfg(not(feature = "oidn"))]
impl Denoiser {
    /// Says what to build.
    ///
    /// # Errors
    /// [`PlayerError::Input`], always.
    pub fn open() -> Result<Self, PlayerError> {
        Err(PlayerError::Input(
            "--path-denoise: this build has no denoiser; build with `cargo build --release -p cairn-player \
             --features oidn`, or leave it out"
                .into(),
        ))
    }

    fn denoise(
        &self,
        _size: [u32; 2],
        _color: &mut [[f32; 4]],
        _guides: &[Vec<[f32; 4]>; 2],
    ) -> Result<(), PlayerError> {
        match *self {}
    }
}

/// Replaces radiance and display values of a traced image, which has guides, by denoised ones. The display values are
/// not dithered.
///
/// # Errors
/// Failures of the denoiser.
///
/// # Panics
/// Where the image has no radiance or no guides.
pub fn picture(
    denoiser: &Denoiser,
    image: &mut HeadlessImage,
    settings: &Settings,
) -> Result<(), PlayerError> {
    let (Some(color), Some(guides)) = (&mut image.hdr, &image.guides) else {
        panic!("a denoiser reads radiance and guides")
    };
    let start = Instant::now();
    denoiser.denoise([image.width, image.height], color, guides)?;
    image.denoise_ms = Some(start.elapsed().as_secs_f64() * 1e3);
    let radiance = Picture::from_rgba(image.width as usize, image.height as usize, color);
    image.rgba8 = display::display(&radiance, settings).to_srgb8();
    Ok(())
}
