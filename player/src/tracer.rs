//! The path-traced frame: trace, tone map. Samples add up until something that they depend on changes.

use cairn_format::Package;
use cairn_format::gpu::{DirectionalLight, GlobalUniform, MATERIAL_UNLIT, NO_TEXTURE};

use crate::PlayerError;
use crate::frame::Overlay;
use crate::gpu::{
    Buffer, BufferDesc, BuildStats, Commands, DescriptorSet, FRAMES_IN_FLIGHT, FrameTarget, Gpu,
    GpuResult, Layouts, Memory, Sampler, SamplerDesc, SetIndex, Sync, vk,
};
use crate::graph::{Graph, Handle, Stage, Target, Usage, Uses};
use crate::lights::{Lights, SceneLights};
use crate::passes::Variant;
use crate::passes::pathtrace::{
    ACCUMULATION_FORMAT, Batch, PathTrace, TraceTargets, TraceVariant, TracedLights, push,
};
use crate::passes::tonemap::Tonemap;
use crate::scene::GpuScene;
use crate::scene::trace::TraceScene;
use crate::settings::Settings;

/// Bytes of the counters: three pairs of words.
const COUNTER_BYTES: u64 = 24;

/// What the GPU counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Counters {
    /// Samples that were NaN or infinite, and were left out.
    pub non_finite: u64,
    /// Rays, where they were counted.
    pub rays: u64,
    /// Luminance that the firefly clamp took away, summed over all samples.
    pub removed_luminance: f64,
}

/// Draws a package by path tracing into images of one format and size.
pub struct Tracer {
    gpu: Gpu,
    layouts: Layouts,
    scene: TraceScene,
    lights: SceneLights,
    variant: TraceVariant,
    pass: PathTrace,
    tonemap: Tonemap,
    graph: Graph,
    accumulated: Handle,
    guides: Option<[Handle; 2]>,
    output: Handle,
    counters: Buffer,
    nearest: Sampler,
    targets: DescriptorSet,
    slots: Vec<Slot>,
    chosen: Lights,
    state: Option<State>,
    batch: Batch,
    /// Rays are counted: the pipeline is another one.
    pub count_rays: bool,
    /// Albedo and normal of the first hit are accumulated too.
    pub with_guides: bool,
    /// Light counts only where it is sampled, not where paths meet it.
    pub sampled_only: bool,
    /// Every ray is traced twice, which changes nothing but the time.
    pub rays_twice: bool,
}

struct Slot {
    uniform: Buffer,
    lights: Buffer,
    set: DescriptorSet,
}

/// What samples depend on: a change begins a new mean.
#[derive(Clone, PartialEq)]
struct State {
    uniform: GlobalUniform,
    settings: Settings,
    variant: TraceVariant,
}

impl Tracer {
    /// Builds acceleration structures, pipelines and targets.
    ///
    /// # Errors
    /// A damaged package; failures of Vulkan.
    ///
    /// # Panics
    /// Where the device cannot trace rays.
    pub fn new(
        gpu: &Gpu,
        scene: &GpuScene,
        package: &Package,
        surfaces: Variant,
        target_format: vk::Format,
        extent: [u32; 2],
        settings: &Settings,
    ) -> Result<Self, PlayerError> {
        let layouts = &scene.layouts;
        let lights = SceneLights::new(package)?;
        let trace = TraceScene::new(gpu, scene, package, settings.path.merge)?;
        let variant = variant(scene, &trace, package, &lights, surfaces, settings)?;
        let mut graph = Graph::new(extent);
        let usage = vk::ImageUsageFlags::STORAGE
            | vk::ImageUsageFlags::SAMPLED
            | vk::ImageUsageFlags::TRANSFER_SRC;
        let target = |name| Target::new(name, ACCUMULATION_FORMAT, usage);
        let accumulated = graph.image(gpu, target("accumulated"))?;
        let output = graph.imported("output");
        let nearest = Sampler::new(gpu, "nearest clamp", &SamplerDesc::NEAREST_CLAMP)?;
        let counters = Buffer::new(
            gpu,
            &BufferDesc {
                name: "trace counters",
                size: COUNTER_BYTES,
                usage: vk::BufferUsageFlags::STORAGE_BUFFER
                    | vk::BufferUsageFlags::TRANSFER_DST
                    | vk::BufferUsageFlags::TRANSFER_SRC,
                memory: Memory::Device,
            },
        )?;
        let targets = TraceTargets {
            accumulated: graph.owned(accumulated),
            guides: None,
            counters: &counters,
            distribution: trace.distribution(),
        };
        let pass = PathTrace::new(gpu, layouts, &variant, &targets)?;
        let slots: GpuResult<Vec<Slot>> = (0..FRAMES_IN_FLIGHT)
            .map(|_| Slot::new(gpu, scene, &trace, lights.capacity()))
            .collect();
        Ok(Self {
            targets: targets_set(layouts, &graph, accumulated, &nearest)?,
            tonemap: Tonemap::new(gpu, layouts, target_format)?,
            slots: slots?,
            gpu: gpu.clone(),
            layouts: layouts.clone(),
            scene: trace,
            lights,
            variant,
            pass,
            graph,
            accumulated,
            guides: None,
            output,
            counters,
            nearest,
            chosen: Lights::default(),
            state: None,
            batch: Batch {
                first_sample: 0,
                samples: 0,
                index: 0,
            },
            count_rays: false,
            with_guides: false,
            sampled_only: false,
            rays_twice: false,
        })
    }

    /// Replaces the targets by ones of another size.
    ///
    /// # Errors
    /// Failures of Vulkan.
    pub fn resize(&mut self, extent: [u32; 2]) -> GpuResult<()> {
        self.graph.resize(&self.gpu, extent)?;
        self.rebind()?;
        self.state = None;
        Ok(())
    }

    /// Adds a batch of samples and records the frame into `target`, which has the tracer's extent. `uniform` is the
    /// frame's; `samples` are added to each pixel, none of them shows what is there.
    ///
    /// # Errors
    /// Failures of Vulkan.
    #[expect(
        clippy::too_many_arguments,
        reason = "a frame's inputs, each of another kind"
    )]
    pub fn record(
        &mut self,
        commands: &mut Commands,
        scene: &GpuScene,
        package: &Package,
        surfaces: Variant,
        uniform: &GlobalUniform,
        settings: &Settings,
        samples: u32,
        target: FrameTarget<'_>,
        overlay: Option<Overlay<'_>>,
    ) -> Result<(), PlayerError> {
        self.follow(scene, package, surfaces, settings)?;
        self.lights.choose(settings, &mut self.chosen);
        let sun = self.lights.sun_disc(settings);
        let lights = TracedLights {
            sun,
            directional: if sun.is_some() {
                0
            } else {
                self.chosen.records.len() as u32
            },
            punctual: self.variant.surfaces.punctual_lights,
        };
        let restarted = self.restart(uniform, settings);
        let batch = Batch {
            samples,
            ..self.batch
        };
        let rows = self.graph.extent()[1] as f32;
        let spread = 2.0 * uniform.inv_projection[1][1].abs() / rows;
        let constants = push(scene, &self.scene, &lights, settings, spread, batch);
        let slot = &mut self.slots[commands.slot()];
        slot.uniform.write(0, &[*uniform])?;
        slot.lights.write(0, &self.chosen.records)?;
        let sets = [&slot.set, &scene.bindless, &self.targets];
        for point in [
            vk::PipelineBindPoint::RAY_TRACING_KHR,
            vk::PipelineBindPoint::GRAPHICS,
            vk::PipelineBindPoint::COMPUTE,
        ] {
            commands.bind_sets(&self.layouts, point, &sets);
        }
        if restarted {
            commands.memory_barrier(TRACING, CLEARING);
            commands.clear_buffer(&self.counters);
            commands.memory_barrier(CLEARING, TRACING);
        }
        self.tonemap.bind_target(&self.layouts, target.image)?;
        self.draw(commands, settings, &constants, target, overlay);
        self.batch.first_sample += samples;
        self.batch.index += u32::from(samples > 0);
        Ok(())
    }

    fn draw(
        &mut self,
        commands: &mut Commands,
        settings: &Settings,
        constants: &cairn_format::gpu::PathTracePush,
        target: FrameTarget<'_>,
        overlay: Option<Overlay<'_>>,
    ) {
        let extent = self.graph.extent();
        let (pass, tonemap, layouts) = (&self.pass, &self.tonemap, &self.layouts);
        let (accumulated, output) = (self.accumulated, self.output);
        let mut frame = self.graph.begin(commands, Some((output, target)));
        if constants.sample_count > 0 {
            let mut uses = Uses::of(&[(accumulated, Usage::Storage(Stage::RayTracing))]);
            for guide in self.guides.iter().flatten() {
                uses.push(*guide, Usage::Storage(Stage::RayTracing));
            }
            frame.pass(c"path trace", &uses, |commands, _| {
                pass.record(commands, layouts, extent, constants);
            });
        }
        let [read, write] = tonemap.usages();
        let uses = [(accumulated, read), (output, write)];
        frame.pass(c"tonemap", &uses, |commands, images| {
            tonemap.record(commands, layouts, images.get(output), settings.tonemap);
        });
        if let Some(overlay) = overlay {
            frame.pass(c"ui", &[(output, Usage::Color)], |commands, images| {
                overlay(commands, images.get(output));
            });
        }
        frame.finish();
    }

    /// Copies the mean: rows of RGBA floats, A the squared deviations of the batches' luminances.
    pub fn copy_accumulated(&mut self, commands: &mut Commands, buffer: &Buffer) {
        let handle = self.accumulated;
        self.copy(commands, handle, buffer);
    }

    /// Copies albedo and normal, where they are accumulated.
    pub fn copy_guides(&mut self, commands: &mut Commands, buffers: [&Buffer; 2]) {
        if let Some(guides) = self.guides {
            for (guide, buffer) in guides.into_iter().zip(buffers) {
                self.copy(commands, guide, buffer);
            }
        }
    }

    fn copy(&mut self, commands: &mut Commands, handle: Handle, buffer: &Buffer) {
        let mut frame = self.graph.begin(commands, None);
        let uses = [(handle, Usage::CopySource)];
        frame.pass(c"copy accumulated", &uses, |commands, images| {
            commands.copy_image_to_buffer(images.get(handle), 0, 0, buffer, 0);
        });
    }

    /// Reads the counters, after all submissions have finished.
    ///
    /// # Errors
    /// Failures of Vulkan.
    pub fn counters(&self) -> GpuResult<Counters> {
        let readback = Buffer::new(
            &self.gpu,
            &BufferDesc {
                name: "counter readback",
                size: COUNTER_BYTES,
                usage: vk::BufferUsageFlags::TRANSFER_DST,
                memory: Memory::Readback,
            },
        )?;
        self.gpu.once(|commands| {
            commands.memory_barrier(TRACING, COPYING);
            commands.copy_buffer(&self.counters, 0, &readback, 0, COUNTER_BYTES);
            commands.memory_barrier(COPIED, HOST);
            Ok(())
        })?;
        let mut words = [0u64; 3];
        readback.read(0, &mut words)?;
        Ok(Counters {
            non_finite: words[0],
            rays: words[1],
            removed_luminance: words[2] as f64 / 1024.0,
        })
    }

    /// Samples that each pixel has, and the dispatches that they came in.
    pub fn progress(&self) -> (u32, u32) {
        (self.batch.first_sample, self.batch.index)
    }

    /// What building the acceleration structures cost.
    pub fn build_stats(&self) -> BuildStats {
        self.scene.build_stats()
    }

    /// Rebuilds the pipeline where it depends on a setting that changed.
    fn follow(
        &mut self,
        scene: &GpuScene,
        package: &Package,
        surfaces: Variant,
        settings: &Settings,
    ) -> Result<(), PlayerError> {
        let mut wanted = variant(
            scene,
            &self.scene,
            package,
            &self.lights,
            surfaces,
            settings,
        )?;
        wanted.count_rays = self.count_rays;
        wanted.guides = self.with_guides;
        wanted.sampled_only = self.sampled_only;
        wanted.rays_twice = self.rays_twice;
        if wanted == self.variant {
            return Ok(());
        }
        if wanted.guides && self.guides.is_none() {
            let usage = vk::ImageUsageFlags::STORAGE | vk::ImageUsageFlags::TRANSFER_SRC;
            let mut add = |name| {
                let target = Target::new(name, ACCUMULATION_FORMAT, usage);
                self.graph.image(&self.gpu, target)
            };
            self.guides = Some([add("albedo guide")?, add("normal guide")?]);
        }
        self.variant = wanted;
        let targets = self.trace_targets();
        self.pass = PathTrace::new(&self.gpu, &self.layouts, &wanted, &targets)?;
        Ok(())
    }

    /// Compiles every pipeline anew, and begins a new mean; where one fails, all stay as they are.
    ///
    /// # Errors
    /// Failures of Vulkan.
    #[cfg(feature = "hot-reload")]
    pub fn rebuild_pipelines(&mut self, target_format: vk::Format) -> GpuResult<()> {
        let (gpu, layouts) = (&self.gpu, &self.layouts);
        let pass = PathTrace::new(gpu, layouts, &self.variant, &self.trace_targets())?;
        self.tonemap = Tonemap::new(gpu, layouts, target_format)?;
        self.pass = pass;
        self.state = None;
        Ok(())
    }

    fn trace_targets(&self) -> TraceTargets<'_> {
        TraceTargets {
            accumulated: self.graph.owned(self.accumulated),
            guides: self
                .guides
                .map(|guides| guides.map(|guide| self.graph.owned(guide))),
            counters: &self.counters,
            distribution: self.scene.distribution(),
        }
    }

    fn rebind(&mut self) -> GpuResult<()> {
        let set = PathTrace::set(&self.layouts, &self.trace_targets())?;
        self.pass.rebind(set);
        self.targets = targets_set(&self.layouts, &self.graph, self.accumulated, &self.nearest)?;
        Ok(())
    }

    /// Begins a new mean where the old one is of something else.
    fn restart(&mut self, uniform: &GlobalUniform, settings: &Settings) -> bool {
        let state = State {
            uniform: still(uniform),
            settings: settled(settings),
            variant: self.variant,
        };
        if self.state.as_ref() == Some(&state) {
            return false;
        }
        self.state = Some(state);
        self.batch = Batch {
            first_sample: 0,
            samples: 0,
            index: 0,
        };
        true
    }
}

/// The fields of the uniform that paths depend on.
fn still(uniform: &GlobalUniform) -> GlobalUniform {
    let [x, y, z, _] = uniform.camera_position_and_exposure;
    GlobalUniform {
        camera_position_and_exposure: [x, y, z, 0.0],
        view: uniform.view,
        projection: uniform.projection,
        ibl_intensity: uniform.ibl_intensity,
        ibl_rotation_sin: uniform.ibl_rotation_sin,
        ibl_rotation_cos: uniform.ibl_rotation_cos,
        ..GlobalUniform::default()
    }
}

/// The settings without those that only concern display and pace.
fn settled(settings: &Settings) -> Settings {
    let mut settled = settings.clone();
    settled.ev = 0.0;
    settled.tonemap = crate::settings::Tonemap::Linear;
    settled.path.samples_per_frame = 1;
    settled
}

fn variant(
    scene: &GpuScene,
    trace: &TraceScene,
    package: &Package,
    lights: &SceneLights,
    surfaces: Variant,
    settings: &Settings,
) -> Result<TraceVariant, PlayerError> {
    let materials = package.materials()?;
    let sun = lights.sun_disc(settings).is_some();
    let directional = lights.count(settings).0 > usize::from(sun);
    let bends = package.material_extensions()?.iter();
    let mut bends = bends.map(|lobes| lobes.clearcoat_normal_tex);
    Ok(TraceVariant {
        surfaces,
        alpha: trace.alpha,
        environment_table: trace.has_environment_table() && scene.has_environment(),
        sun,
        point_lights: directional || surfaces.punctual_lights > 0,
        emitters: trace.emissive_count > 0,
        normal_maps: materials.iter().any(|one| one.normal_tex != NO_TEXTURE)
            || bends.any(|texture| texture != NO_TEXTURE),
        unlit: materials
            .iter()
            .any(|material| material.double_sided & MATERIAL_UNLIT != 0),
        count_rays: false,
        guides: false,
        lod: settings.path.lod,
        view: settings.debug_view,
        sampler: settings.path.sampler,
        sampled_only: false,
        rays_twice: false,
        see_through: settings.path.see_through,
    })
}

fn targets_set(
    layouts: &Layouts,
    graph: &Graph,
    accumulated: Handle,
    sampler: &Sampler,
) -> GpuResult<DescriptorSet> {
    let mut set = layouts.allocate(SetIndex::Targets, "traced targets")?;
    set.write_image(0, 0, graph.owned(accumulated), sampler);
    Ok(set)
}

impl Slot {
    fn new(gpu: &Gpu, scene: &GpuScene, trace: &TraceScene, lights: usize) -> GpuResult<Self> {
        let (uniforms, storage) = (
            vk::BufferUsageFlags::UNIFORM_BUFFER,
            vk::BufferUsageFlags::STORAGE_BUFFER,
        );
        let lights = size_of::<DirectionalLight>() * lights.max(1);
        let uniform = Buffer::upload(gpu, "traced uniform", size_of::<GlobalUniform>(), uniforms)?;
        let lights = Buffer::upload(gpu, "traced lights", lights, storage)?;
        let mut set = scene.layouts.allocate(SetIndex::Frame, "traced frame")?;
        scene.bind(&mut set, &uniform, &lights)?;
        trace.bind(&mut set)?;
        Ok(Self {
            uniform,
            lights,
            set,
        })
    }
}

const TRACING: Sync = Sync {
    stage: vk::PipelineStageFlags2::RAY_TRACING_SHADER_KHR,
    access: vk::AccessFlags2::from_raw(
        vk::AccessFlags2::SHADER_STORAGE_READ.as_raw()
            | vk::AccessFlags2::SHADER_STORAGE_WRITE.as_raw(),
    ),
};
const CLEARING: Sync = Sync {
    stage: vk::PipelineStageFlags2::CLEAR,
    access: vk::AccessFlags2::TRANSFER_WRITE,
};
const COPYING: Sync = Sync {
    stage: vk::PipelineStageFlags2::COPY,
    access: vk::AccessFlags2::TRANSFER_READ,
};
const COPIED: Sync = Sync {
    stage: vk::PipelineStageFlags2::COPY,
    access: vk::AccessFlags2::TRANSFER_WRITE,
};
const HOST: Sync = Sync {
    stage: vk::PipelineStageFlags2::HOST,
    access: vk::AccessFlags2::HOST_READ,
};
