//! Path tracing without a window: until enough samples, time, or accuracy.

use std::time::{Duration, Instant};

use cairn_format::Package;

use super::{
    COPY, HeadlessImage, HeadlessOptions, OUTPUT_FORMAT, Output, Times, check_size, readback,
};
use crate::PlayerError;
use crate::frame::frame_uniform;
use crate::gpu::{Buffer, BuildStats, FRAMES_IN_FLIGHT, FrameTarget, Frames, Gpu, GpuResult, vk};
use crate::plan::Plan;
use crate::scene::GpuScene;
use crate::settings::Settings;
use crate::tracer::{Counters, Tracer};

/// Samples of a dispatch where the settings leave the pace to the program.
const BATCH: u32 = 16;
/// Dispatches that are timed to tell rays from shading.
const SPLIT_BATCHES: u32 = 8;
/// Dispatches from which their spread says something.
const LEAST_BATCHES: u32 = 4;

/// When to stop; the first of the limits that is reached. Without any, as many samples as the frames hold.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TraceOptions {
    /// Samples per pixel.
    pub samples: Option<u32>,
    /// Seconds of tracing.
    pub seconds: Option<f64>,
    /// Estimated relative error of the image: root of the mean variance over the mean luminance.
    pub target_error: Option<f64>,
    /// Count rays, which costs time.
    pub count_rays: bool,
    /// Afterwards measure the share of time that rays take.
    pub split: bool,
    /// Light counts only where it is sampled, not where paths meet it.
    pub sampled_only: bool,
    /// Also read back albedo and normal.
    pub guides: bool,
}

/// What a path-traced image cost, and how good it is.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct TraceStats {
    /// Samples per pixel.
    pub samples: u32,
    /// Dispatches.
    pub batches: u32,
    /// Wall time of tracing, builds and compilation left out.
    pub seconds: f64,
    /// Samples of all pixels in a second, in units of 10^6.
    pub megasamples_per_second: f64,
    /// Rays in a second, in units of 10^6; 0 where they were not counted.
    pub megarays_per_second: f64,
    /// Estimated relative error; from the spread of the dispatches, so it is too high for stratified samples.
    pub relative_error: Option<f64>,
    /// What the GPU counted.
    pub counters: Counters,
    /// Rays against shading, where that was asked for.
    pub split: Option<Split>,
    /// The acceleration structures.
    pub build: BuildStats,
}

/// How much of the time rays take: the same samples with every ray traced once and twice. The second is nearer to what
/// it needs in the caches, so the share is a lower bound.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Split {
    /// Samples per pixel of either run.
    pub samples: u32,
    /// Wall time with every ray once.
    pub seconds: f64,
    /// Wall time with every ray twice.
    pub twice_seconds: f64,
    /// What the second time added, over the first.
    pub ray_share: f64,
}

/// A picture on the way to a better one.
#[derive(Clone, Debug, PartialEq)]
pub struct Stage {
    /// Samples per pixel.
    pub samples: u32,
    /// Wall time of tracing so far; of copying pictures only this one's.
    pub seconds: f64,
    /// Mean radiance, rows of RGBA; A is 1.
    pub radiance: Vec<[f32; 4]>,
}

/// Pictures of one run after each of these ascending numbers of samples.
///
/// # Errors
/// As [`trace_on`].
pub fn trace_series(
    gpu: &Gpu,
    package: &Package,
    options: &HeadlessOptions,
    counts: &[u32],
) -> Result<Vec<Stage>, PlayerError> {
    let limits = TraceOptions {
        samples: counts.last().copied(),
        ..TraceOptions::default()
    };
    let mut run = Run::checked(gpu, package, options, &limits)?;
    // What a device does on first use is not tracing: a batch of other samples, which the change of seed takes back.
    run.settings.path.seed ^= 1;
    run.record(1, true)?;
    run.settings.path.seed ^= 1;
    let mut seconds = 0.0;
    let mut stages = Vec::with_capacity(counts.len());
    for count in counts {
        let start = Instant::now();
        while run.samples < *count {
            let samples = run.batch.min(*count - run.samples);
            run.record(samples, false)?;
            run.samples += samples;
        }
        run.record(0, true)?;
        let elapsed = start.elapsed().as_secs_f64();
        let mut radiance = run.radiance()?;
        radiance.iter_mut().for_each(|texel| texel[3] = 1.0);
        stages.push(Stage {
            samples: *count,
            seconds: seconds + elapsed,
            radiance,
        });
        seconds += elapsed;
    }
    Ok(stages)
}

/// Mean radiance after the same number of samples with each of these seeds, by one pipeline.
///
/// # Errors
/// As [`trace_on`].
pub fn trace_seeds(
    gpu: &Gpu,
    package: &Package,
    options: &HeadlessOptions,
    samples: u32,
    seeds: &[u32],
) -> Result<Vec<Vec<[f32; 4]>>, PlayerError> {
    let limits = TraceOptions {
        samples: Some(samples),
        ..TraceOptions::default()
    };
    let mut run = Run::checked(gpu, package, options, &limits)?;
    let mut pictures = Vec::with_capacity(seeds.len());
    for seed in seeds {
        run.settings.path.seed = *seed;
        run.samples = 0;
        while run.samples < samples {
            run.step()?;
        }
        run.record(0, true)?;
        pictures.push(run.radiance()?);
    }
    Ok(pictures)
}

/// Path-traces on a device that can.
///
/// # Errors
/// As [`super::render`]; [`PlayerError::Input`] where the device cannot trace rays.
pub fn trace_on(
    gpu: &Gpu,
    package: &Package,
    options: &HeadlessOptions,
    limits: &TraceOptions,
) -> Result<HeadlessImage, PlayerError> {
    let mut run = Run::checked(gpu, package, options, limits)?;
    let start = Instant::now();
    while !run.done(limits, start.elapsed())? {
        run.step()?;
    }
    run.finish(start)
}

struct Run<'a> {
    gpu: &'a Gpu,
    package: &'a Package,
    options: &'a HeadlessOptions,
    /// The options', but for what runs after each other change.
    settings: Settings,
    scene: GpuScene,
    tracer: Tracer,
    plan: Plan,
    output: Output,
    accumulated: Buffer,
    guides: Option<[Buffer; 2]>,
    frames: Frames,
    times: Times,
    submitted: usize,
    samples: u32,
    batch: u32,
    goal: u32,
    error: Option<f64>,
    split: bool,
}

impl<'a> Run<'a> {
    /// [`Self::new`] where the device has what it takes.
    fn checked(
        gpu: &'a Gpu,
        package: &'a Package,
        options: &'a HeadlessOptions,
        limits: &TraceOptions,
    ) -> Result<Self, PlayerError> {
        check_size(gpu, options.size)?;
        if !gpu.traces_rays() {
            return Err(PlayerError::Input(format!(
                "{} cannot trace rays (VK_KHR_ray_tracing_pipeline): use --mode raster",
                gpu.device_name()
            )));
        }
        Self::new(gpu, package, options, limits)
    }

    fn new(
        gpu: &'a Gpu,
        package: &'a Package,
        options: &'a HeadlessOptions,
        limits: &TraceOptions,
    ) -> Result<Self, PlayerError> {
        let scene = GpuScene::upload(gpu, package)?;
        let settings = &options.settings;
        let plan = Plan::new(gpu, &scene, package, settings)?;
        let (size, surfaces) = (options.size, plan.variant);
        let mut tracer = Tracer::new(
            gpu,
            &scene,
            package,
            surfaces,
            OUTPUT_FORMAT,
            size,
            settings,
        )?;
        tracer.count_rays = limits.count_rays;
        tracer.sampled_only = limits.sampled_only;
        tracer.with_guides = limits.guides;
        let texels = u64::from(size[0]) * u64::from(size[1]);
        let frames = options
            .frames
            .saturating_mul(settings.path.samples_per_frame);
        let open_ended = limits.seconds.is_some() || limits.target_error.is_some();
        let goal = limits
            .samples
            .unwrap_or(if open_ended { u32::MAX } else { frames });
        let guides = limits.guides.then(|| -> GpuResult<[Buffer; 2]> {
            let buffer = || readback(gpu, "guide readback", texels * 16);
            Ok([buffer()?, buffer()?])
        });
        let pace = settings.path.samples_per_frame;
        Ok(Self {
            output: Output::new(gpu, options.size, false)?,
            accumulated: readback(gpu, "accumulation readback", texels * 16)?,
            guides: guides.transpose()?,
            frames: Frames::new(gpu)?,
            gpu,
            package,
            options,
            settings: settings.clone(),
            scene,
            tracer,
            plan,
            times: Times::default(),
            submitted: 0,
            samples: 0,
            batch: if pace > 1 {
                pace
            } else {
                BATCH.min(goal.div_ceil(LEAST_BATCHES)).max(1)
            },
            goal: goal.max(1),
            error: None,
            split: limits.split,
        })
    }

    /// Submits one batch.
    fn step(&mut self) -> Result<(), PlayerError> {
        let samples = self.batch.min(self.goal - self.samples);
        self.record(samples, false)?;
        self.samples += samples;
        Ok(())
    }

    fn record(&mut self, samples: u32, last: bool) -> Result<(), PlayerError> {
        let mut commands = self.frames.begin()?;
        if self.submitted >= FRAMES_IN_FLIGHT {
            self.times.add(self.frames.timings());
        }
        let target = FrameTarget {
            image: self.output.image.view(),
            final_layout: vk::ImageLayout::TRANSFER_SRC_OPTIMAL,
            final_sync: COPY,
        };
        let options = self.options;
        let uniform = frame_uniform(&options.camera, options.size, &self.scene, &self.settings);
        self.tracer.record(
            &mut commands,
            &self.scene,
            self.package,
            self.plan.variant,
            &uniform,
            &self.settings,
            samples,
            target,
            None,
        )?;
        if last {
            let (image, pixels) = (self.output.image.view(), &self.output.pixels);
            commands.copy_image_to_buffer(image, 0, 0, pixels, 0);
            self.tracer
                .copy_accumulated(&mut commands, &self.accumulated);
            if let Some([albedo, normal]) = &self.guides {
                self.tracer.copy_guides(&mut commands, [albedo, normal]);
            }
        }
        let submission = self.frames.submit(commands)?;
        self.submitted += 1;
        if last {
            self.gpu.wait(submission)?;
        }
        Ok(())
    }

    /// Whether a limit is reached. Accuracy is looked at whenever the number of batches has doubled.
    fn done(&mut self, limits: &TraceOptions, elapsed: Duration) -> Result<bool, PlayerError> {
        if self.samples >= self.goal {
            return Ok(true);
        }
        let batches = self.tracer.progress().1;
        if batches == 0 {
            return Ok(false);
        }
        if limits
            .seconds
            .is_some_and(|seconds| elapsed.as_secs_f64() >= seconds)
        {
            return Ok(true);
        }
        let Some(target) = limits.target_error else {
            return Ok(false);
        };
        if batches < LEAST_BATCHES || !batches.is_power_of_two() {
            return Ok(false);
        }
        self.record(0, true)?;
        self.error = relative_error(&self.radiance()?, batches);
        Ok(self.error.is_some_and(|error| error <= target))
    }

    fn radiance(&self) -> Result<Vec<[f32; 4]>, PlayerError> {
        let mut texels = vec![[0.0f32; 4]; self.output.texels];
        self.accumulated.read(0, texels.as_flattened_mut())?;
        Ok(texels)
    }

    /// Traces some batches again, with every ray once and then twice.
    fn measure_split(&mut self) -> Result<Split, PlayerError> {
        let mut timed = |twice: bool| -> Result<f64, PlayerError> {
            self.tracer.rays_twice = twice;
            // The pipeline is made, and the device at work.
            self.record(self.batch, true)?;
            let start = Instant::now();
            for _ in 0..SPLIT_BATCHES {
                self.record(self.batch, false)?;
            }
            self.record(0, true)?;
            Ok(start.elapsed().as_secs_f64())
        };
        let (seconds, twice_seconds) = (timed(false)?, timed(true)?);
        Ok(Split {
            samples: self.batch * SPLIT_BATCHES,
            seconds,
            twice_seconds,
            ray_share: (twice_seconds - seconds) / seconds,
        })
    }

    fn finish(mut self, start: Instant) -> Result<HeadlessImage, PlayerError> {
        self.record(0, true)?;
        let seconds = start.elapsed().as_secs_f64();
        self.frames.collect()?;
        self.times.add(self.frames.timings());
        let mut texels = self.radiance()?;
        let (samples, batches) = self.tracer.progress();
        let error = relative_error(&texels, batches);
        for texel in &mut texels {
            texel[3] = 1.0;
        }
        let counters = self.tracer.counters()?;
        let rgba8 = self.output.read_pixels()?;
        let split = self.split.then(|| self.measure_split()).transpose()?;
        let pixels = self.output.texels as f64;
        let stats = TraceStats {
            samples,
            batches,
            seconds,
            megasamples_per_second: pixels * f64::from(samples) / seconds * 1e-6,
            megarays_per_second: counters.rays as f64 / seconds * 1e-6,
            relative_error: error,
            counters,
            split,
            build: self.tracer.build_stats(),
        };
        Ok(HeadlessImage {
            width: self.options.size[0],
            height: self.options.size[1],
            rgba8,
            hdr: Some(texels),
            passes: self.times.medians(),
            draws: crate::draw::DrawStats::default(),
            scene: self.scene.stats.clone(),
            device: self.gpu.device_name().to_owned(),
            driver: self.gpu.driver().to_owned(),
            validation: self.gpu.validation_messages(),
            guides: self
                .guides
                .as_ref()
                .map(read_guides)
                .transpose()?
                .map(|guides| guides.map(|guide| guide[..self.output.texels].to_vec())),
            trace: Some(stats),
            denoise_ms: None,
        })
    }
}

fn read_guides(buffers: &[Buffer; 2]) -> GpuResult<[Vec<[f32; 4]>; 2]> {
    let read = |buffer: &Buffer| -> GpuResult<Vec<[f32; 4]>> {
        let mut texels = vec![[0.0f32; 4]; (buffer.size() / 16) as usize];
        buffer.read(0, texels.as_flattened_mut())?;
        Ok(texels)
    };
    Ok([read(&buffers[0])?, read(&buffers[1])?])
}

/// Root of the mean variance of the pixels' means over the mean luminance; `None` of less than two batches or black.
fn relative_error(texels: &[[f32; 4]], batches: u32) -> Option<f64> {
    if batches < 2 {
        return None;
    }
    let count = f64::from(batches) * f64::from(batches - 1);
    let (mut variance, mut luminance) = (0.0, 0.0);
    for [r, g, b, deviations] in texels.iter().map(|texel| texel.map(f64::from)) {
        variance += deviations.max(0.0) / count;
        luminance += 0.2126 * r + 0.7152 * g + 0.0722 * b;
    }
    let pixels = texels.len() as f64;
    (luminance > 0.0).then(|| (variance / pixels).sqrt() / (luminance / pixels))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_error_is_that_of_the_mean() {
        // Four batches with luminances 1, 1, 3, 3: squared deviations 4, variance of the mean 4 / 12.
        let texel = [2.0, 2.0, 2.0, 4.0];
        let error = relative_error(&[texel; 7], 4).expect("two batches");
        assert!((error - (4.0_f64 / 12.0).sqrt() / 2.0).abs() < 1e-6);
        assert_eq!(relative_error(&[texel], 1), None);
        assert_eq!(relative_error(&[[0.0; 4]], 9), None);
    }
}
