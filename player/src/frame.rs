//! The frame: the ordered list of passes, and the per-frame data that they read.

#[cfg(feature = "hot-reload")]
mod reload;

use cairn_format::gpu::{
    DirectionalLight, FEATURE_SHADOWS, GlobalUniform, NO_TEXTURE, VisiblePush,
};
use cairn_format::{Frustum, Package, SectionKind};
use glam::Mat4;

use crate::PlayerError;
use crate::camera::Camera;
use crate::draw::{DrawList, DrawStats};
use crate::gpu::{
    Buffer, Commands, DescriptorSet, FRAMES_IN_FLIGHT, FrameTarget, Gpu, GpuResult, ImageRef,
    Layouts, Load, SetIndex, vk,
};
use crate::graph::{FrameGraph, Graph, Stage, Usage, Uses};
use crate::lights::Lights;
use crate::passes::Passes;
use crate::passes::depth::DepthImages;
use crate::passes::occlusion::{self, Surroundings};
use crate::passes::shadow::{Casters, ShadowView};
use crate::passes::{resolve_color, resolve_surface, shade, surface};
use crate::plan::{Plan, ShadowMap};
use crate::scene::{self, GpuScene};
use crate::settings::{Mode, Settings, SpecularOcclusion};
use crate::targets::Targets;
use crate::tracer::Tracer;

/// Draws over the finished picture.
pub type Overlay<'a> = &'a dyn Fn(&mut Commands, ImageRef<'_>);

/// Draws packages into images of one format and size.
pub struct Renderer {
    gpu: Gpu,
    layouts: Layouts,
    target_format: vk::Format,
    plan: Plan,
    pub(crate) graph: Graph,
    pub(crate) targets: Targets,
    pub(crate) passes: Passes,
    /// The path-traced frame, from its first use on.
    tracer: Option<Tracer>,
    slots: Vec<Slot>,
    draws: DrawList,
    /// Pixels that blended surfaces may cover.
    blended: Option<[u32; 4]>,
    lights: Lights,
    shadow: ShadowView,
    previous_view_projection: Option<Mat4>,
    frame_index: u32,
}

/// What the CPU writes while the GPU still reads the other slot.
struct Slot {
    uniform: Buffer,
    visible: Buffer,
    /// Instances that cast shadows, of all cascades; absent without a shadow map.
    casters: Option<Buffer>,
    lights: Buffer,
    set: DescriptorSet,
}

impl Renderer {
    /// Builds passes and targets. `target_format` is that of the images that `record` gets: see [`crate::passes::tonemap`].
    ///
    /// # Errors
    /// [`PlayerError::Input`] where draw groups share instances; failures of Vulkan.
    pub fn new(
        gpu: &Gpu,
        scene: &GpuScene,
        package: &Package,
        target_format: vk::Format,
        extent: [u32; 2],
        settings: &Settings,
    ) -> Result<Self, PlayerError> {
        let plan = Plan::new(gpu, scene, package, settings)?;
        let layouts = &scene.layouts;
        let mut graph = Graph::new(extent);
        let targets = Targets::new(gpu, layouts, &mut graph, &plan)?;
        let capacity = visible_capacity(package)?;
        let mut slots = (0..FRAMES_IN_FLIGHT)
            .map(|_| Slot::new(gpu, scene, capacity))
            .collect::<GpuResult<Vec<Slot>>>()?;
        for slot in &mut slots {
            slot.follow(gpu, &plan)?;
        }
        Ok(Self {
            passes: Passes::new(gpu, layouts, &graph, &targets, &plan, target_format)?,
            slots,
            gpu: gpu.clone(),
            layouts: layouts.clone(),
            target_format,
            plan,
            graph,
            targets,
            tracer: None,
            draws: DrawList::default(),
            blended: None,
            lights: Lights::default(),
            shadow: ShadowView::default(),
            previous_view_projection: None,
            frame_index: 0,
        })
    }

    /// Replaces the targets by ones of another size.
    ///
    /// # Errors
    /// Failures of Vulkan.
    pub fn resize(&mut self, gpu: &Gpu, extent: [u32; 2]) -> Result<(), PlayerError> {
        self.graph.resize(gpu, extent)?;
        if let Some(tracer) = &mut self.tracer {
            tracer.resize(extent)?;
        }
        self.targets.write(&self.layouts, &self.graph)?;
        self.passes
            .rebind(&self.layouts, &self.graph, &self.targets)?;
        Ok(())
    }

    /// As [`Renderer::record_under`], with nothing over the picture.
    ///
    /// # Errors
    /// As there.
    pub fn record(
        &mut self,
        commands: &mut Commands,
        scene: &GpuScene,
        package: &Package,
        camera: &Camera,
        settings: &Settings,
        target: FrameTarget<'_>,
    ) -> Result<(), PlayerError> {
        self.record_under(commands, scene, package, camera, settings, target, None)
    }

    /// Records one frame into `target`, which has the renderer's extent; `overlay` then draws over the picture, as
    /// an attachment that it keeps.
    ///
    /// # Errors
    /// A package that changed on disk; failures of Vulkan.
    #[allow(clippy::too_many_arguments)]
    pub fn record_under(
        &mut self,
        commands: &mut Commands,
        scene: &GpuScene,
        package: &Package,
        camera: &Camera,
        settings: &Settings,
        target: FrameTarget<'_>,
        overlay: Option<Overlay<'_>>,
    ) -> Result<(), PlayerError> {
        self.follow_settings(scene, package, settings)?;
        if settings.mode == Mode::PathTrace && self.gpu.traces_rays() {
            return self.record_traced(commands, scene, package, camera, settings, target, overlay);
        }
        self.graph.advance();
        self.update(commands.slot(), scene, package, camera, settings)?;
        let (parity, extent) = (self.graph.parity(), self.graph.extent());
        let slot = &self.slots[commands.slot()];
        bind(commands, scene, slot, self.targets.set(parity));

        self.passes
            .tonemap
            .bind_target(&self.layouts, target.image)?;
        let (passes, draws, targets) = (&self.passes, &self.draws, &self.targets);
        let layouts = &self.layouts;
        let drawn = targets.drawn;
        let (opaque, masked) = (&draws.opaque, &draws.masked);
        let around = Surroundings {
            diagonal: scene::diagonal(package),
            // This frame's number: the counter is one ahead.
            frame: self.frame_index.wrapping_sub(1),
            history: targets.ao.is_some_and(|ao| self.graph.has_history(ao.ao)),
            parity,
            extent,
        };
        let mut frame = self.graph.begin(commands, Some((targets.output, target)));

        let shadow = targets.shadow.as_ref().zip(slot.casters.as_ref());
        if let (Some(pass), Some((target, casters))) = (&passes.shadow, shadow)
            && self.shadow.is_stale()
        {
            let usage = if self.shadow.is_all_stale() {
                Usage::DepthClear
            } else {
                Usage::Depth
            };
            let view = &self.shadow;
            frame.pass(c"shadow", &[(target.map, usage)], |commands, images| {
                pass.record(commands, layouts, images, target.map, view, casters);
                commands.bind_vertex_buffer(1, &slot.visible, 0);
            });
        }
        if let Some(depth) = &passes.depth {
            let mut uses = Uses::of(&[(drawn.depth, Usage::DepthClear)]);
            for surface in drawn.surface.iter() {
                uses.push(surface.normal, Usage::ColorClear);
                uses.push(surface.roughness, Usage::ColorClear);
            }
            frame.pass(c"depth", &uses, |commands, images| {
                let surface = drawn.surface;
                let images = DepthImages {
                    depth: images.get(drawn.depth),
                    surface: surface
                        .map(|surface| [images.get(surface.normal), images.get(surface.roughness)]),
                };
                depth.record(commands, images, opaque, masked);
            });
        }
        if let (Some(visibility), Some(triangles)) = (&passes.visibility, targets.visibility) {
            let uses = [
                (triangles, Usage::ColorClear),
                (drawn.depth, Usage::DepthClear),
            ];
            frame.pass(c"visibility", &uses, |commands, images| {
                let (triangles, depth) = (images.get(triangles), images.get(drawn.depth));
                visibility.record(commands, triangles, depth, opaque, masked);
            });
        }
        let draw_groups = scene.draw_group_count;
        if let Some(pass) = &passes.surface {
            let push = VisiblePush {
                draw_groups,
                layer: [0; 4],
            };
            frame.pass(c"surface", &surface::uses(targets), |commands, _| {
                commands.push_constants(layouts, &push);
                pass.record(commands, layouts, parity, extent);
            });
        }
        if let Some(resolve) = &passes.resolve_surface {
            let uses = resolve_surface::uses(targets);
            frame.pass(c"resolve surface", &uses, |commands, _| {
                resolve.record(commands, layouts, parity, extent);
            });
        }
        // GTAO, its spatial and its temporal filter, contact shadows.
        occlusion::record(&mut frame, passes, layouts, targets, settings, &around);
        if let Some(forward) = &passes.forward {
            let depth_use = match passes.depth {
                Some(_) => Usage::Depth,
                None => Usage::DepthClear,
            };
            let mut uses = Uses::of(&[(drawn.hdr, Usage::ColorClear), (drawn.depth, depth_use)]);
            targets.add_lighting(&mut uses, Stage::Fragment);
            frame.pass(c"forward", &uses, |commands, images| {
                let (hdr, depth) = (images.get(drawn.hdr), images.get(drawn.depth));
                forward.record(commands, hdr, depth, opaque, masked);
            });
        }
        if let Some(skybox) = &passes.skybox {
            frame.pass(c"skybox", &skybox.uses(targets), |commands, images| {
                skybox.record(commands, layouts, images, targets, parity);
            });
        }
        // Several samples that are shaded in compute are blended into a layer, which shading then takes up.
        let layers = self.plan.compute && self.plan.samples > 1;
        let layer = self.blended.filter(|_| layers);
        let whole = [0, 0, extent[0], extent[1]];
        let blend = |frame: &mut FrameGraph<'_>, load| {
            let Some(transparent) = &passes.transparent else {
                return;
            };
            let usage = match load {
                Load::Keep => Usage::Color,
                _ => Usage::ColorClear,
            };
            let mut uses = Uses::of(&[(drawn.hdr, usage), (drawn.depth, Usage::Depth)]);
            targets.add_lighting(&mut uses, Stage::Fragment);
            frame.pass(c"transparent", &uses, |commands, images| {
                let (hdr, depth) = (images.get(drawn.hdr), images.get(drawn.depth));
                let part = layer.unwrap_or(whole);
                transparent.record(commands, hdr, depth, load, part, &draws.blend);
            });
        };
        if layer.is_some() {
            blend(&mut frame, Load::Clear([0.0; 4]));
        }
        if let Some(pass) = &passes.shade {
            let push = VisiblePush {
                draw_groups,
                layer: layer.unwrap_or_default(),
            };
            let mut uses = shade::uses(targets, layer.is_some());
            targets.add_lighting(&mut uses, Stage::Compute);
            frame.pass(c"shade", &uses, |commands, _| {
                commands.push_constants(layouts, &push);
                pass.record(commands, layouts, parity, extent);
            });
        }
        if !layers {
            blend(&mut frame, Load::Keep);
        }
        if let Some(resolve) = &passes.resolve_color {
            let uses = resolve_color::uses(targets);
            frame.pass(c"resolve color", &uses, |commands, _| {
                resolve.record(commands, layouts, parity, extent);
            });
        }
        let [read, write] = passes.tonemap.usages();
        let uses = [(targets.hdr, read), (targets.output, write)];
        frame.pass(c"tonemap", &uses, |commands, images| {
            let output = images.get(targets.output);
            passes
                .tonemap
                .record(commands, layouts, output, settings.tonemap);
        });
        if let Some(overlay) = overlay {
            let uses = [(targets.output, Usage::Color)];
            frame.pass(c"ui", &uses, |commands, images| {
                overlay(commands, images.get(targets.output));
            });
        }
        frame.finish();
        Ok(())
    }

    #[allow(clippy::too_many_arguments)]
    fn record_traced(
        &mut self,
        commands: &mut Commands,
        scene: &GpuScene,
        package: &Package,
        camera: &Camera,
        settings: &Settings,
        target: FrameTarget<'_>,
        overlay: Option<Overlay<'_>>,
    ) -> Result<(), PlayerError> {
        let (extent, surfaces) = (self.graph.extent(), self.plan.variant);
        let mut tracer = match self.tracer.take() {
            Some(tracer) => tracer,
            None => {
                let format = self.target_format;
                let gpu = &self.gpu;
                Tracer::new(gpu, scene, package, surfaces, format, extent, settings)?
            }
        };
        let uniform = frame_uniform(camera, extent, scene, settings);
        let samples = settings.path.samples_per_frame;
        let recorded = tracer.record(
            commands, scene, package, surfaces, &uniform, settings, samples, target, overlay,
        );
        self.tracer = Some(tracer);
        recorded
    }

    /// Samples per pixel of the path-traced image, where there is one.
    pub fn traced_samples(&self) -> Option<u32> {
        self.tracer.as_ref().map(|tracer| tracer.progress().0)
    }

    /// Copies the HDR image that the last `record` drew: rows of RGBA half floats.
    pub fn copy_hdr(&mut self, commands: &mut Commands, buffer: &Buffer) {
        let hdr = self.targets.hdr;
        let mut frame = self.graph.begin(commands, None);
        frame.pass(
            c"copy hdr",
            &[(hdr, Usage::CopySource)],
            |commands, images| {
                commands.copy_image_to_buffer(images.get(hdr), 0, 0, buffer, 0);
            },
        );
    }

    /// What the frame consists of.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// What the last `record` drew.
    pub fn draw_stats(&self) -> DrawStats {
        self.draws.stats()
    }

    /// Rebuilds passes and targets where the settings ask for other ones.
    fn follow_settings(
        &mut self,
        scene: &GpuScene,
        package: &Package,
        settings: &Settings,
    ) -> Result<(), PlayerError> {
        let plan = Plan::new(&self.gpu, scene, package, settings)?;
        if plan == self.plan {
            return Ok(());
        }
        let mut graph = Graph::new(self.graph.extent());
        let (gpu, layouts) = (&self.gpu, &self.layouts);
        let targets = Targets::new(gpu, layouts, &mut graph, &plan)?;
        self.passes = Passes::new(gpu, layouts, &graph, &targets, &plan, self.target_format)?;
        for slot in &mut self.slots {
            slot.follow(gpu, &plan)?;
        }
        self.shadow.forget();
        (self.graph, self.targets, self.plan) = (graph, targets, plan);
        Ok(())
    }

    /// Culls, and fills this slot's buffers.
    fn update(
        &mut self,
        slot: usize,
        scene: &GpuScene,
        package: &Package,
        camera: &Camera,
        settings: &Settings,
    ) -> Result<(), PlayerError> {
        let extent = self.graph.extent();
        let mut uniform = camera_uniform(camera, extent);
        let view_projection = Mat4::from_cols_array_2d(&uniform.view_projection);
        let previous = self.previous_view_projection.unwrap_or(view_projection);
        uniform.prev_view_projection = previous.to_cols_array_2d();
        uniform.frame_index = self.frame_index;
        fill_scene(&mut uniform, scene);
        scene.lights.choose(settings, &mut self.lights);
        uniform.directional_light_count = self.lights.records.len() as u32;
        fill_settings(&mut uniform, settings);
        uniform.feature_flags = self.plan.feature_flags();
        self.previous_view_projection = Some(view_projection);
        self.frame_index = self.frame_index.wrapping_add(1);

        let (groups, bounds) = (package.draw_groups()?, package.instance_bounds()?);
        let frustum = Frustum::from_view_projection(&view_projection);
        let clusters = package.cluster_bounds()?;
        self.draws.build(
            groups,
            &bounds,
            clusters.as_ref(),
            &frustum,
            camera.position,
        );
        self.blended = self.draws.blended_part(&bounds, &view_projection, extent);
        let slot = &mut self.slots[slot];
        if let (Some(casters), Some(light)) = (&mut slot.casters, self.lights.shadowed) {
            let [width, height] = extent.map(|size| size as f32);
            let casting = Casters {
                scene: scene::bounds(package),
                groups,
                bounds,
                clusters,
            };
            let aspect = width / height;
            self.shadow
                .update(camera, aspect, light, &casting, &settings.shadow);
            let (diameter, shadow) = (light.angular_diameter, &settings.shadow);
            self.shadow.cascades.fill(&mut uniform, shadow, diameter);
            uniform.feature_flags |= FEATURE_SHADOWS;
            self.shadow.write(casters)?;
        }
        slot.lights.write(0, &self.lights.records)?;
        slot.uniform.write(0, &[uniform])?;
        slot.visible.write(0, &self.draws.visible)?;
        Ok(())
    }
}

impl Slot {
    fn new(gpu: &Gpu, scene: &GpuScene, visible: u64) -> GpuResult<Self> {
        let uniform_size = size_of::<GlobalUniform>();
        let lights_size = scene.lights.capacity() * size_of::<DirectionalLight>();
        let uniforms = vk::BufferUsageFlags::UNIFORM_BUFFER;
        let vertices = vk::BufferUsageFlags::VERTEX_BUFFER;
        let storage = vk::BufferUsageFlags::STORAGE_BUFFER;
        let uniform = Buffer::upload(gpu, "global uniform", uniform_size, uniforms)?;
        let visible = Buffer::upload(gpu, "visible instances", visible as usize * 4, vertices)?;
        let lights = Buffer::upload(gpu, "directional lights", lights_size, storage)?;
        let mut set = scene.layouts.allocate(SetIndex::Frame, "frame")?;
        scene.bind(&mut set, &uniform, &lights)?;
        Ok(Self {
            uniform,
            visible,
            casters: None,
            lights,
            set,
        })
    }

    /// Makes or drops what only some plans need.
    fn follow(&mut self, gpu: &Gpu, plan: &Plan) -> GpuResult<()> {
        let casters = plan.shadow.map(|map: ShadowMap| {
            let size = self.visible.size() as usize * map.cascades as usize;
            Buffer::upload(
                gpu,
                "shadow casters",
                size,
                vk::BufferUsageFlags::VERTEX_BUFFER,
            )
        });
        self.casters = casters.transpose()?;
        Ok(())
    }
}

fn bind(commands: &mut Commands, scene: &GpuScene, slot: &Slot, targets: &DescriptorSet) {
    let sets = [&slot.set, &scene.bindless, targets];
    for point in [
        vk::PipelineBindPoint::GRAPHICS,
        vk::PipelineBindPoint::COMPUTE,
    ] {
        commands.bind_sets(&scene.layouts, point, &sets);
    }
    if let (Some(vertices), Some(indices)) = (&scene.vertices, &scene.indices) {
        commands.bind_vertex_buffer(0, vertices, 0);
        commands.bind_vertex_buffer(1, &slot.visible, 0);
        commands.bind_index_buffer(indices);
    }
}

/// Most instances that a view can show. Each belongs to one group, so a sum above the number of instances would
/// let a small file ask for any amount of memory.
fn visible_capacity(package: &Package) -> Result<u64, PlayerError> {
    let instances = package.count(SectionKind::Instances);
    let groups = package.draw_groups()?;
    let drawn: u64 = groups
        .iter()
        .map(|group| u64::from(group.instance_count))
        .sum();
    if drawn > instances {
        return Err(PlayerError::Input(format!(
            "draw groups hold {drawn} instances, but the package has {instances}"
        )));
    }
    Ok(drawn)
}

/// The uniform of a frame without history.
pub(crate) fn frame_uniform(
    camera: &Camera,
    extent: [u32; 2],
    scene: &GpuScene,
    settings: &Settings,
) -> GlobalUniform {
    let mut uniform = camera_uniform(camera, extent);
    uniform.prev_view_projection = uniform.view_projection;
    fill_scene(&mut uniform, scene);
    fill_settings(&mut uniform, settings);
    uniform
}

/// Matrices and exposure-free camera fields; the rest is neutral.
fn camera_uniform(camera: &Camera, extent: [u32; 2]) -> GlobalUniform {
    let [width, height] = extent.map(|size| size as f32);
    let (view, projection) = (camera.view(), camera.projection(width / height));
    let view_projection = projection * view;
    GlobalUniform {
        view: view.to_cols_array_2d(),
        projection: projection.to_cols_array_2d(),
        view_projection: view_projection.to_cols_array_2d(),
        inv_view_projection: view_projection.inverse().to_cols_array_2d(),
        inv_projection: projection.inverse().to_cols_array_2d(),
        inv_view: view.inverse().to_cols_array_2d(),
        camera_position_and_exposure: camera.position.extend(1.0).to_array(),
        screen_size: [width, height],
        ..GlobalUniform::default()
    }
}

fn fill_scene(uniform: &mut GlobalUniform, scene: &GpuScene) {
    let environment = scene.environment.as_ref();
    let slot = |index: Option<u32>| index.unwrap_or(NO_TEXTURE);
    uniform.brdf_lut_index = slot(scene.brdf_lut_slot);
    uniform.skybox_cubemap_index = slot(environment.map(|slots| slots.sky));
    uniform.irradiance_cubemap_index = slot(environment.map(|slots| slots.irradiance));
    uniform.prefiltered_cubemap_index = slot(environment.map(|slots| slots.prefiltered));
    uniform.ibl_intensity = environment.map_or(1.0, |slots| slots.scale);
    uniform.prefiltered_mip_count = environment.map_or(1, |slots| slots.prefiltered_levels);
}

fn fill_settings(uniform: &mut GlobalUniform, settings: &Settings) {
    uniform.camera_position_and_exposure[3] = settings.ev.exp2();
    uniform.ibl_intensity *= settings.ibl_intensity;
    uniform.ibl_rotation_sin = settings.ibl_yaw.sin();
    uniform.ibl_rotation_cos = settings.ibl_yaw.cos();
    uniform.debug_render_mode = settings.debug_view;
    uniform.ao_so_mode = match settings.ao.specular {
        SpecularOcclusion::Lagarde => 0,
        SpecularOcclusion::Gtso => 1,
    };
}
