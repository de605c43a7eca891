//! The path tracer: rays from every pixel, several samples a dispatch, added to a running mean.

use cairn_format::gpu::{
    LIGHT_EMITTERS, LIGHT_ENVIRONMENT, LIGHT_PUNCTUAL, LIGHT_SUN, PathTracePush,
};

use crate::gpu::Buffer;
use crate::gpu::{
    Commands, DescriptorSet, Gpu, GpuResult, ImageRef, Layouts, RayPipeline, RayPipelineDesc,
    SetIndex, Shader, vk,
};
use crate::lights::SunDisc;
use crate::passes::Variant;
use crate::scene::GpuScene;
use crate::scene::trace::TraceScene;
use crate::settings::{PathSampler, Settings};

/// Linear mean radiance, and the spread of its luminance.
pub const ACCUMULATION_FORMAT: vk::Format = vk::Format::R32G32B32A32_SFLOAT;
/// Numbers of the views that the path tracer draws.
const VIEWS: [u32; 6] = [0, 4, 5, 6, 7, 9];

/// What is compiled into the pipeline.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TraceVariant {
    /// As in raster.
    pub surfaces: Variant,
    /// Masked or blended geometry.
    pub alpha: bool,
    /// The environment has an importance table.
    pub environment_table: bool,
    /// The environment's sun shines.
    pub sun: bool,
    /// Directional, point or spot lights shine.
    pub point_lights: bool,
    /// Emissive triangles are listed.
    pub emitters: bool,
    /// Some material has a normal map.
    pub normal_maps: bool,
    /// Some material is unlit.
    pub unlit: bool,
    /// Rays are counted.
    pub count_rays: bool,
    /// Albedo and normal are accumulated.
    pub guides: bool,
    /// Texture levels follow ray cones.
    pub lod: bool,
    /// Debug view.
    pub view: u32,
    /// Where sample coordinates come from.
    pub sampler: PathSampler,
    /// Light counts only where it is sampled.
    pub sampled_only: bool,
    /// Every ray is traced twice.
    pub rays_twice: bool,
    /// Camera rays pass single-sided surfaces from behind.
    pub see_through: bool,
}

impl TraceVariant {
    fn constants(&self) -> Vec<(u32, u32)> {
        let view = if VIEWS.contains(&self.view) {
            self.view
        } else {
            u32::MAX
        };
        let own = [
            (32, u32::from(self.alpha)),
            (33, u32::from(self.environment_table)),
            (34, u32::from(self.sun)),
            (35, u32::from(self.point_lights)),
            (36, u32::from(self.emitters)),
            (37, u32::from(self.normal_maps)),
            (38, u32::from(self.count_rays)),
            (39, u32::from(self.guides)),
            (40, view),
            (41, self.sampler as u32),
            (42, u32::from(self.sampled_only)),
            (43, u32::from(self.lod)),
            (44, u32::from(self.unlit)),
            (45, u32::from(self.rays_twice)),
            (46, u32::from(self.see_through)),
        ];
        self.surfaces
            .traced_constants()
            .into_iter()
            .chain(own)
            .collect()
    }
}

/// What a dispatch adds to the mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Batch {
    /// Samples that each pixel has.
    pub first_sample: u32,
    /// Samples that each pixel gets.
    pub samples: u32,
    /// Dispatches before.
    pub index: u32,
}

/// The pipeline and its set.
pub struct PathTrace {
    pipeline: RayPipeline,
    set: DescriptorSet,
}

/// What the pass writes.
pub struct TraceTargets<'a> {
    pub accumulated: ImageRef<'a>,
    /// Albedo and normal, where they are accumulated.
    pub guides: Option<[ImageRef<'a>; 2]>,
    pub counters: &'a Buffer,
    /// Of the environment's importance table, where there is one.
    pub distribution: Option<&'a Buffer>,
}

impl PathTrace {
    /// Compiles the pipeline.
    ///
    /// # Errors
    /// Failures of Vulkan.
    pub fn new(
        gpu: &Gpu,
        layouts: &Layouts,
        variant: &TraceVariant,
        targets: &TraceTargets<'_>,
    ) -> GpuResult<Self> {
        let constants = variant.constants();
        let shader = |shader: &'static cairn_shaders::Shader| Shader {
            spirv: shader.spirv,
            constants: &constants,
        };
        let desc = RayPipelineDesc {
            name: "path trace",
            raygen: shader(&cairn_shaders::PATHTRACE_RGEN),
            miss: shader(&cairn_shaders::PATHTRACE_RMISS),
            closest_hit: shader(&cairn_shaders::PATHTRACE_RCHIT),
            any_hit: variant
                .alpha
                .then(|| shader(&cairn_shaders::PATHTRACE_RAHIT)),
        };
        Ok(Self {
            pipeline: RayPipeline::new(gpu, layouts, &desc)?,
            set: set(layouts, targets)?,
        })
    }

    /// Makes the pass's set.
    ///
    /// # Errors
    /// Failures of Vulkan.
    pub fn set(layouts: &Layouts, targets: &TraceTargets<'_>) -> GpuResult<DescriptorSet> {
        set(layouts, targets)
    }

    /// Follows images that were replaced.
    pub fn rebind(&mut self, set: DescriptorSet) {
        self.set = set;
    }

    /// Traces `batch` for every pixel. Sets 0 and 1 are bound.
    pub fn record(
        &self,
        commands: &mut Commands,
        layouts: &Layouts,
        extent: [u32; 2],
        push: &PathTracePush,
    ) {
        let point = vk::PipelineBindPoint::RAY_TRACING_KHR;
        commands.bind_ray_tracing(&self.pipeline);
        commands.bind_sets(layouts, point, &[&self.set]);
        commands.push_constants(layouts, push);
        commands.trace_rays(&self.pipeline, extent);
    }
}

fn set(layouts: &Layouts, targets: &TraceTargets<'_>) -> GpuResult<DescriptorSet> {
    let mut set = layouts.allocate(SetIndex::Pass, "path trace")?;
    set.write_storage_image(0, targets.accumulated);
    if let Some([albedo, normal]) = targets.guides {
        set.write_storage_image(1, albedo);
        set.write_storage_image(2, normal);
    }
    set.write_buffer(8, targets.counters)?;
    if let Some(distribution) = targets.distribution {
        set.write_buffer(9, distribution)?;
    }
    Ok(set)
}

/// The lights of a frame, as rays see them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TracedLights {
    /// The environment's sun.
    pub sun: Option<SunDisc>,
    /// Directional records; the sun is none of them.
    pub directional: u32,
    /// Point and spot records.
    pub punctual: u32,
}

/// Push constants of a dispatch. `pixel_height` is the height of the image plane at distance 1, in pixels' parts:
/// twice the tangent of half the field of view over the rows.
pub fn push(
    scene: &GpuScene,
    trace: &TraceScene,
    lights: &TracedLights,
    settings: &Settings,
    cone_spread: f32,
    batch: Batch,
) -> PathTracePush {
    let path = &settings.path;
    let bit = |condition: bool, bit: u32| if condition { bit } else { 0 };
    let environment = trace.has_environment_table() && settings.ibl_intensity > 0.0;
    let points = lights.directional + lights.punctual;
    PathTracePush {
        mesh_instances: trace.mesh_instances(),
        sun_direction: lights.sun.map_or([0.0, 1.0, 0.0], |sun| sun.direction),
        sun_sin2: lights.sun.map_or(0.0, |sun| sun.sin2),
        sun_radiance: lights.sun.map_or([0.0; 3], |sun| sun.radiance),
        max_clamp: path.clamp,
        center: trace.center,
        cone_spread,
        max_bounces: path.bounces,
        first_sample: batch.first_sample,
        sample_count: batch.samples,
        batch: batch.index,
        sampled_lights: bit(environment && path.sample_environment, LIGHT_ENVIRONMENT)
            | bit(lights.sun.is_some() && path.sample_lights, LIGHT_SUN)
            | bit(points > 0 && path.sample_lights, LIGHT_PUNCTUAL)
            | bit(
                trace.emissive_count > 0 && path.sample_emitters,
                LIGHT_EMITTERS,
            ),
        punctual_light_count: lights.punctual,
        occlusion_distance: settings.ao.reach(trace.diagonal),
        seed: path.seed,
        show_sky: u32::from(settings.skybox && scene.has_environment()),
        directional_light_count: lights.directional,
        vertices: trace.vertices,
        emissive_count: trace.emissive_count,
        merged_geometries: trace.merged_count,
    }
}
