//! Renders a package without a window and reads the image back.

pub mod denoise;
pub mod trace;

use std::ffi::CStr;
use std::time::Instant;

use cairn_format::Package;

use crate::PlayerError;
use crate::camera::Camera;
use crate::draw::DrawStats;
use crate::frame::Renderer;
use crate::gpu::{
    Buffer, BufferDesc, FrameTarget, Frames, Gpu, GpuOptions, GpuResult, Image, ImageDesc, Memory,
    PassTime, Submission, Sync, vk,
};
use crate::scene::{GpuScene, SceneStats};
use crate::settings::{Mode, Settings};
use denoise::Denoiser;
use trace::{TraceOptions, TraceStats, trace_on};

/// Display-encoded output, which a shader encodes.
const OUTPUT_FORMAT: vk::Format = vk::Format::R8G8B8A8_UNORM;

/// What to render.
#[derive(Clone, Debug)]
pub struct HeadlessOptions {
    /// Pixels.
    pub size: [u32; 2],
    /// Viewpoint of every frame.
    pub camera: Camera,
    /// Look of every frame.
    pub settings: Settings,
    /// Frames drawn; the last is read back. At least 1.
    pub frames: u32,
    /// Also read back linear radiance.
    pub hdr: bool,
    /// Device and validation.
    pub gpu: GpuOptions,
}

/// The last frame and what it cost.
#[derive(Clone, Debug)]
pub struct HeadlessImage {
    /// Pixels.
    pub width: u32,
    /// Pixels.
    pub height: u32,
    /// Rows from the top, sRGB with linear alpha.
    pub rgba8: Vec<u8>,
    /// Rows from the top, linear; where it was asked for.
    pub hdr: Option<Vec<[f32; 4]>>,
    /// Median GPU time of each pass over the frames, in the order of the frame.
    pub passes: Vec<PassMedian>,
    /// What the last frame drew.
    pub draws: DrawStats,
    /// What was uploaded.
    pub scene: SceneStats,
    /// Device name.
    pub device: String,
    /// Driver name and version.
    pub driver: String,
    /// Messages of the validation layer; empty where it is off or content.
    pub validation: Vec<String>,
    /// What tracing cost, where the image was traced.
    pub trace: Option<TraceStats>,
    /// Albedo and normal of the first hit, where they were asked for.
    pub guides: Option<[Vec<[f32; 4]>; 2]>,
    /// Wall time of denoising in milliseconds, where the picture was denoised.
    pub denoise_ms: Option<f64>,
}

/// A pass's median GPU time.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct PassMedian {
    /// Name of the pass.
    pub name: String,
    /// Milliseconds.
    pub milliseconds: f64,
}

impl HeadlessImage {
    /// Texels of the HDR image with a channel that is NaN or infinite; `None` where it was not read back.
    pub fn non_finite(&self) -> Option<usize> {
        let texels = self.hdr.as_ref()?;
        let bad = texels
            .iter()
            .filter(|texel| !texel.iter().all(|channel| channel.is_finite()));
        Some(bad.count())
    }
}

/// Renders `options.frames` frames, which are alike but for their index: no clock is read.
///
/// # Errors
/// [`PlayerError::Input`] for a size that the device cannot render; a bad package; failures of Vulkan.
pub fn render(package: &Package, options: &HeadlessOptions) -> Result<HeadlessImage, PlayerError> {
    let gpu = Gpu::new(&options.gpu)?;
    let mut image = render_on(&gpu, package, options)?;
    image.validation = gpu.close();
    Ok(image)
}

/// As [`render`]; where the settings ask for path tracing, until one of `limits`, and denoised where they ask for it.
/// This is the only place that denoises: what is measured against comes from [`trace_on`].
///
/// # Errors
/// As [`render`]; where a denoiser is asked for and missing, before anything is rendered.
pub fn render_traced(
    package: &Package,
    options: &HeadlessOptions,
    limits: &TraceOptions,
) -> Result<HeadlessImage, PlayerError> {
    let asked = options.settings.mode == Mode::PathTrace;
    let denoiser = (asked && options.settings.path.denoise)
        .then(Denoiser::open)
        .transpose()?;
    let gpu = Gpu::new(&options.gpu)?;
    let mut image = match &denoiser {
        _ if !asked || !gpu.traces_rays() => render_on(&gpu, package, options)?,
        None => trace_on(&gpu, package, options, limits)?,
        Some(denoiser) => {
            let guided = TraceOptions {
                guides: true,
                ..*limits
            };
            let mut image = trace_on(&gpu, package, options, &guided)?;
            denoise::picture(denoiser, &mut image, &options.settings)?;
            image.guides = image.guides.filter(|_| limits.guides);
            image
        }
    };
    image.validation = gpu.close();
    Ok(image)
}

/// As [`render`], on a device that exists.
///
/// # Errors
/// As [`render`].
pub fn render_on(
    gpu: &Gpu,
    package: &Package,
    options: &HeadlessOptions,
) -> Result<HeadlessImage, PlayerError> {
    if options.settings.mode == Mode::PathTrace {
        if gpu.traces_rays() {
            return trace_on(gpu, package, options, &TraceOptions::default());
        }
        eprintln!(
            "{} cannot trace rays: rasterised instead",
            gpu.device_name()
        );
    }
    if options.frames == 0 {
        return Err(PlayerError::Input("0 frames: at least 1 is needed".into()));
    }
    let settings = &options.settings;
    let mut session = Session::new(gpu, package, options.size, settings, options.hdr)?;
    let mut times = Times::default();
    for index in 1..=options.frames {
        let copied = index == options.frames;
        session.frame(&options.camera, settings, copied)?;
        times.add(session.timings());
    }
    session.finish()?;
    times.add(session.timings());
    Ok(HeadlessImage {
        width: options.size[0],
        height: options.size[1],
        rgba8: session.pixels()?,
        hdr: session.radiance()?,
        passes: times.medians(),
        draws: session.draw_stats(),
        scene: session.scene.stats.clone(),
        device: gpu.device_name().to_owned(),
        driver: gpu.driver().to_owned(),
        validation: gpu.validation_messages(),
        trace: None,
        guides: None,
        denoise_ms: None,
    })
}

/// A package on a device that is drawn frame by frame without a window.
pub struct Session<'a> {
    gpu: &'a Gpu,
    package: &'a Package,
    scene: GpuScene,
    renderer: Renderer,
    frames: Frames,
    output: Output,
    last: Option<Submission>,
}

impl<'a> Session<'a> {
    /// Uploads the package. `hdr` makes room for linear radiance.
    ///
    /// # Errors
    /// [`PlayerError::Input`] for a size that the device cannot render; a bad package; failures of Vulkan.
    pub fn new(
        gpu: &'a Gpu,
        package: &'a Package,
        size: [u32; 2],
        settings: &Settings,
        hdr: bool,
    ) -> Result<Self, PlayerError> {
        check_size(gpu, size)?;
        let scene = GpuScene::upload(gpu, package)?;
        Ok(Self {
            renderer: Renderer::new(gpu, &scene, package, OUTPUT_FORMAT, size, settings)?,
            output: Output::new(gpu, size, hdr)?,
            frames: Frames::new(gpu)?,
            gpu,
            package,
            scene,
            last: None,
        })
    }

    /// Records and submits a frame; `copied` ones can be read back after [`Session::finish`]. Returns the seconds
    /// that recording took on the CPU.
    ///
    /// # Errors
    /// A package that changed on disk; failures of Vulkan.
    pub fn frame(
        &mut self,
        camera: &Camera,
        settings: &Settings,
        copied: bool,
    ) -> Result<f64, PlayerError> {
        let mut commands = self.frames.begin()?;
        let target = FrameTarget {
            image: self.output.image.view(),
            final_layout: vk::ImageLayout::TRANSFER_SRC_OPTIMAL,
            final_sync: COPY,
        };
        let start = Instant::now();
        self.renderer.record(
            &mut commands,
            &self.scene,
            self.package,
            camera,
            settings,
            target,
        )?;
        let seconds = start.elapsed().as_secs_f64();
        if copied {
            let output = &self.output;
            commands.copy_image_to_buffer(output.image.view(), 0, 0, &output.pixels, 0);
            if let Some(buffer) = &output.radiance {
                self.renderer.copy_hdr(&mut commands, buffer);
            }
        }
        self.last = Some(self.frames.submit(commands)?);
        Ok(seconds)
    }

    /// Waits for the last frame and reads its times.
    ///
    /// # Errors
    /// Failures of Vulkan.
    pub fn finish(&mut self) -> Result<(), PlayerError> {
        if let Some(submission) = self.last {
            self.gpu.wait(submission)?;
            self.frames.collect()?;
        }
        Ok(())
    }

    /// GPU times of the newest frame that was waited for: after [`Session::frame`] the one before the last, after
    /// [`Session::finish`] the last; empty before.
    pub fn timings(&self) -> &[PassTime] {
        self.frames.timings()
    }

    /// sRGB bytes of the last copied frame, rows of RGBA from the top.
    ///
    /// # Errors
    /// Failures of Vulkan.
    pub fn pixels(&self) -> Result<Vec<u8>, PlayerError> {
        Ok(self.output.read_pixels()?)
    }

    /// Linear radiance of the last copied frame, where there is room for it.
    ///
    /// # Errors
    /// Failures of Vulkan.
    pub fn radiance(&self) -> Result<Option<Vec<[f32; 4]>>, PlayerError> {
        Ok(self.output.read_radiance()?)
    }

    /// What the last frame drew.
    pub fn draw_stats(&self) -> DrawStats {
        self.renderer.draw_stats()
    }
}

/// The read-back copy, which is the output's last use.
const COPY: Sync = Sync {
    stage: vk::PipelineStageFlags2::COPY,
    access: vk::AccessFlags2::TRANSFER_READ,
};

fn check_size(gpu: &Gpu, size: [u32; 2]) -> Result<(), PlayerError> {
    let limit = gpu.limits().max_image_dimension2_d;
    let [width, height] = size;
    if width == 0 || height == 0 || width > limit || height > limit {
        return Err(PlayerError::Input(format!(
            "size {width}x{height}: each side must be 1 to {limit} pixels on {}",
            gpu.device_name()
        )));
    }
    Ok(())
}

/// The image drawn into, and the memory that it is copied to.
struct Output {
    image: Image,
    texels: usize,
    pixels: Buffer,
    radiance: Option<Buffer>,
}

impl Output {
    fn new(gpu: &Gpu, size: [u32; 2], hdr: bool) -> GpuResult<Self> {
        let image = Image::new(
            gpu,
            &ImageDesc {
                name: "output",
                format: OUTPUT_FORMAT,
                extent: size,
                levels: 1,
                layers: 1,
                cube: false,
                array: false,
                samples: 1,
                usage: vk::ImageUsageFlags::STORAGE | vk::ImageUsageFlags::TRANSFER_SRC,
            },
        )?;
        let texels = u64::from(size[0]) * u64::from(size[1]);
        let radiance = hdr.then(|| readback(gpu, "radiance readback", texels * 8));
        Ok(Self {
            image,
            texels: texels as usize,
            pixels: readback(gpu, "pixel readback", texels * 4)?,
            radiance: radiance.transpose()?,
        })
    }

    fn read_pixels(&self) -> GpuResult<Vec<u8>> {
        let mut pixels = vec![0; self.texels * 4];
        self.pixels.read(0, &mut pixels)?;
        Ok(pixels)
    }

    fn read_radiance(&self) -> GpuResult<Option<Vec<[f32; 4]>>> {
        let Some(buffer) = &self.radiance else {
            return Ok(None);
        };
        let mut halves = vec![[0_u16; 4]; self.texels];
        buffer.read(0, &mut halves)?;
        Ok(Some(
            halves.into_iter().map(|half| half.map(from_half)).collect(),
        ))
    }
}

fn readback(gpu: &Gpu, name: &str, size: u64) -> GpuResult<Buffer> {
    Buffer::new(
        gpu,
        &BufferDesc {
            name,
            size,
            usage: vk::BufferUsageFlags::TRANSFER_DST,
            memory: Memory::Readback,
        },
    )
}

/// IEEE 754 binary16 to binary32, exact.
pub(crate) fn from_half(bits: u16) -> f32 {
    let sign = u32::from(bits >> 15) << 31;
    let (exponent, mantissa) = (u32::from(bits >> 10 & 31), u32::from(bits & 1023));
    match exponent {
        0 => f32::from_bits(sign | (mantissa as f32 * (-24_f32).exp2()).to_bits()),
        31 => f32::from_bits(sign | 0x7f80_0000 | mantissa << 13),
        _ => f32::from_bits(sign | (exponent + 112) << 23 | mantissa << 13),
    }
}

/// GPU times of each pass, in the order in which passes first appeared.
#[derive(Default)]
struct Times(Vec<(&'static CStr, Vec<f64>)>);

impl Times {
    fn add(&mut self, frame: &[PassTime]) {
        for pass in frame {
            match self.0.iter_mut().find(|(name, _)| *name == pass.name) {
                Some((_, times)) => times.push(pass.milliseconds),
                None => self.0.push((pass.name, vec![pass.milliseconds])),
            }
        }
    }

    fn medians(self) -> Vec<PassMedian> {
        let median = |(name, mut times): (&'static CStr, Vec<f64>)| {
            times.sort_by(f64::total_cmp);
            PassMedian {
                name: name.to_string_lossy().into_owned(),
                milliseconds: times[times.len() / 2],
            }
        };
        self.0.into_iter().map(median).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_convert_exactly() {
        for (bits, value) in [
            (0x0000, 0.0),
            (0x3c00, 1.0),
            (0xc000, -2.0),
            (0x7bff, 65504.0),
            (0x0001, 5.960_464_5e-8),
            (0x0400, 6.103_515_6e-5),
            (0x3555, 0.333_251_95),
        ] {
            assert_eq!(from_half(bits), value, "{bits:#06x}");
        }
        assert!(from_half(0x7c01).is_nan() && from_half(0xfc00) == f32::NEG_INFINITY);
    }

    #[test]
    fn medians_keep_the_order_of_passes() {
        let mut times = Times::default();
        for milliseconds in [3.0, 1.0, 2.0] {
            let pass = |name, milliseconds| PassTime { name, milliseconds };
            times.add(&[pass(c"b", milliseconds), pass(c"a", 9.0)]);
        }
        let medians = times.medians();
        assert_eq!(
            (medians[0].name.as_str(), medians[0].milliseconds),
            ("b", 2.0)
        );
        assert_eq!(medians[1].name, "a");
    }
}
