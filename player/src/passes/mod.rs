//! The passes of a frame, one file each.

pub mod ao_spatial;
pub mod ao_temporal;
pub mod compute;
pub mod contact;
pub mod depth;
pub mod forward;
pub mod gtao;
pub mod occlusion;
pub mod pathtrace;
pub mod resolve_color;
pub mod resolve_surface;
pub mod shade;
pub mod shadow;
pub mod skybox;
pub mod surface;
pub mod tonemap;
pub mod transparent;
#[cfg(feature = "ui")]
pub mod ui;
pub mod visibility;
pub mod visible;

#[cfg(test)]
mod tests;

use crate::draw::Draw;
use crate::gpu::{
    Blend, ColorTarget, Commands, DepthState, Gpu, GpuResult, GraphicsPipeline,
    GraphicsPipelineDesc, Layouts, Shader, VertexInput, vk,
};
use crate::graph::Graph;
use crate::plan::Plan;
use crate::settings::{Brdf, ShadowFilter};
use crate::targets::{AoImages, Targets};

/// Linear radiance before exposure.
pub const HDR_FORMAT: vk::Format = vk::Format::R16G16B16A16_SFLOAT;
/// Reverse-Z: 1 at the near plane, 0 at infinity.
pub const DEPTH_FORMAT: vk::Format = vk::Format::D32_SFLOAT;

/// World normal `n * 0.5 + 0.5`.
pub const NORMAL_FORMAT: vk::Format = vk::Format::A2B10G10R10_UNORM_PACK32;
/// Perceptual roughness.
pub const ROUGHNESS_FORMAT: vk::Format = vk::Format::R8_UNORM;
/// Instance plus 1, and triangle of its mesh.
pub const VISIBILITY_FORMAT: vk::Format = vk::Format::R32G32_UINT;
/// Infinity in reverse-Z.
const FAR_DEPTH: f32 = 0.0;

/// What a package has, and how it is shaded: the choices that are compiled into pipelines.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Variant {
    /// Some group cuts by alpha.
    pub masked: bool,
    /// Some group blends.
    pub blended: bool,
    /// There are cubes to light with.
    pub environment: bool,
    /// There is a BRDF table.
    pub brdf_lut: bool,
    /// There are directional lights.
    pub lights: bool,
    /// Single or multiple scattering.
    pub brdf: Brdf,
    /// Vertices have colours.
    pub vertex_colors: bool,
    /// Textures have transforms.
    pub texture_transforms: bool,
    /// Some material has a clear coat.
    pub clearcoat: bool,
    /// The reflection of some dielectric is not glTF's default.
    pub specular: bool,
    /// Some material has sheen.
    pub sheen: bool,
    /// Point and spot lights that shine.
    pub punctual_lights: u32,
    /// A debug view is drawn.
    pub debug_view: bool,
    /// Ambient occlusion of the screen is there.
    pub screen_occlusion: bool,
    /// Contact shadows of the screen are there.
    pub contact_shadows: bool,
    /// Filter of the shadow map; absent without one.
    pub shadows: Option<ShadowFilter>,
}

/// The passes of a plan; what it does not need is absent.
pub struct Passes {
    pub shadow: Option<shadow::Shadow>,
    pub depth: Option<depth::Depth>,
    pub resolve_surface: Option<compute::ComputePass>,
    pub gtao: Option<compute::ComputePass>,
    pub ao_spatial: Option<compute::ComputePass>,
    pub ao_temporal: Option<compute::ComputePass>,
    pub contact: Option<compute::ComputePass>,
    pub visibility: Option<visibility::Visibility>,
    pub surface: Option<compute::ComputePass>,
    pub forward: Option<forward::Forward>,
    pub shade: Option<compute::ComputePass>,
    pub skybox: Option<skybox::Skybox>,
    pub transparent: Option<transparent::Transparent>,
    pub resolve_color: Option<compute::ComputePass>,
    pub tonemap: tonemap::Tonemap,
}

impl Passes {
    /// Compiles the pipelines.
    ///
    /// # Errors
    /// Failures of Vulkan.
    pub fn new(
        gpu: &Gpu,
        layouts: &Layouts,
        graph: &Graph,
        targets: &Targets,
        plan: &Plan,
        target_format: vk::Format,
    ) -> GpuResult<Self> {
        let resolved = plan.samples > 1 && !plan.compute;
        let visibility = plan
            .compute
            .then(|| visibility::Visibility::new(gpu, layouts, plan));
        let surface = (plan.compute && plan.normals)
            .then(|| surface::new(gpu, layouts, graph, targets, plan));
        let shade = plan
            .compute
            .then(|| shade::new(gpu, layouts, graph, targets, plan));
        let forward = (!plan.compute).then(|| forward::Forward::new(gpu, layouts, plan));
        let shadow = plan.shadow.map(|_| shadow::Shadow::new(gpu, layouts, plan));
        let depth = plan.prepass.then(|| depth::Depth::new(gpu, layouts, plan));
        let resolve_surface = (resolved && plan.normals)
            .then(|| resolve_surface::new(gpu, layouts, graph, targets, plan));
        let ao = plan.ao.zip(targets.ao);
        let gtao = ao.map(|(plan, images)| gtao::new(gpu, layouts, graph, images, plan));
        let ao_spatial =
            ao.map(|(_, images)| ao_spatial::new(gpu, layouts, graph, targets, images));
        let ao_temporal = ao
            .filter(|(plan, _)| plan.temporal)
            .map(|(_, images)| ao_temporal::new(gpu, layouts, graph, targets, images));
        let contact = targets
            .contact
            .map(|mask| contact::new(gpu, layouts, graph, mask));
        let skybox = (plan.skybox && !plan.compute)
            .then(|| skybox::Skybox::new(gpu, layouts, graph, targets, plan));
        let blended = plan.variant.blended;
        let transparent = blended.then(|| transparent::Transparent::new(gpu, layouts, plan));
        let resolve_color =
            resolved.then(|| resolve_color::new(gpu, layouts, graph, targets, plan));
        Ok(Self {
            shadow: shadow.transpose()?,
            depth: depth.transpose()?,
            resolve_surface: resolve_surface.transpose()?,
            gtao: gtao.transpose()?,
            ao_spatial: ao_spatial.transpose()?,
            ao_temporal: ao_temporal.transpose()?,
            contact: contact.transpose()?,
            visibility: visibility.transpose()?,
            surface: surface.transpose()?,
            forward: forward.transpose()?,
            shade: shade.transpose()?,
            skybox: skybox.transpose()?,
            transparent: transparent.transpose()?,
            resolve_color: resolve_color.transpose()?,
            tonemap: tonemap::Tonemap::new(gpu, layouts, target_format)?,
        })
    }

    /// Follows images that were replaced by ones of another size.
    ///
    /// # Errors
    /// Failures of Vulkan.
    pub fn rebind(&mut self, layouts: &Layouts, graph: &Graph, targets: &Targets) -> GpuResult<()> {
        if let Some(pass) = &mut self.resolve_surface {
            pass.rebind(layouts, |set, parity| {
                resolve_surface::write(set, parity, graph, targets);
            })?;
        }
        if let Some(images) = targets.ao {
            self.rebind_ao(layouts, graph, targets, images)?;
        }
        if let (Some(pass), Some(mask)) = (&mut self.contact, targets.contact) {
            pass.rebind(layouts, |set, parity| {
                contact::write(set, parity, graph, mask);
            })?;
        }
        if let Some(pass) = &mut self.surface {
            pass.rebind(layouts, |set, parity| {
                surface::write(set, parity, graph, targets);
            })?;
        }
        if let Some(pass) = &mut self.shade {
            pass.rebind(layouts, |set, parity| {
                shade::write(set, parity, graph, targets);
            })?;
        }
        if let Some(pass) = &mut self.skybox {
            pass.rebind(layouts, graph, targets)?;
        }
        if let Some(pass) = &mut self.resolve_color {
            pass.rebind(layouts, |set, parity| {
                resolve_color::write(set, parity, graph, targets);
            })?;
        }
        Ok(())
    }
}

impl Passes {
    fn rebind_ao(
        &mut self,
        layouts: &Layouts,
        graph: &Graph,
        targets: &Targets,
        images: AoImages,
    ) -> GpuResult<()> {
        if let Some(pass) = &mut self.gtao {
            pass.rebind(layouts, |set, parity| {
                gtao::write(set, parity, graph, images);
            })?;
        }
        if let Some(pass) = &mut self.ao_spatial {
            pass.rebind(layouts, |set, parity| {
                ao_spatial::write(set, parity, graph, targets, images);
            })?;
        }
        if let Some(pass) = &mut self.ao_temporal {
            pass.rebind(layouts, |set, parity| {
                ao_temporal::write(set, parity, graph, targets, images);
            })?;
        }
        Ok(())
    }
}

/// How a fragment's alpha is used.
#[derive(Clone, Copy, PartialEq)]
enum Alpha {
    Ignored,
    Cut,
    Blended,
}

impl Variant {
    /// Specialisation constants of ray-tracing stages.
    fn traced_constants(&self) -> Vec<(u32, u32)> {
        let opaque = Self {
            debug_view: false,
            ..*self
        };
        opaque.constants(Alpha::Ignored).to_vec()
    }

    /// Specialisation constants of `forward.vert` and `forward.frag`: see `options.glsl`.
    fn constants(&self, alpha: Alpha) -> [(u32, u32); 16] {
        let values = [
            alpha == Alpha::Cut,
            alpha == Alpha::Blended,
            self.environment,
            self.brdf_lut,
            self.lights,
            self.brdf == Brdf::Energy,
            self.vertex_colors,
            self.texture_transforms,
            self.clearcoat,
            self.specular,
            self.sheen,
        ]
        .map(u32::from);
        let rest = [self.debug_view, self.screen_occlusion, self.contact_shadows].map(u32::from);
        let lights = [self.punctual_lights];
        let shadows = match self.shadows {
            None => 0,
            Some(ShadowFilter::Pcf) => 1,
            Some(ShadowFilter::Pcss) => 2,
        };
        let values = values.into_iter().chain(lights).chain(rest);
        let mut values = values.chain([shadows]);
        std::array::from_fn(|id| (id as u32, values.next().unwrap_or_default()))
    }
}

/// A pipeline of the scene's surfaces. Behind a prepass, only what has the prepass's depth is shaded, so that cut
/// surfaces need no second test; without one, depth is tested and written. Blended colour is
/// `src * a + dst * (1 - a)`, glTF's "over".
fn surface_pipeline(
    gpu: &Gpu,
    layouts: &Layouts,
    plan: &Plan,
    alpha: Alpha,
) -> GpuResult<GraphicsPipeline> {
    let (name, blend) = match alpha {
        Alpha::Ignored => ("forward opaque", Blend::None),
        Alpha::Cut => ("forward masked", Blend::None),
        Alpha::Blended => ("transparent", Blend::Alpha),
    };
    let blend = if plan.overdraw { Blend::Add } else { blend };
    let depth = match alpha {
        Alpha::Blended => depth_state(vk::CompareOp::GREATER, false),
        _ if plan.prepass => depth_state(vk::CompareOp::EQUAL, false),
        // Of equal depths the last one stays, as behind a prepass.
        _ => depth_state(vk::CompareOp::GREATER_OR_EQUAL, true),
    };
    let constants = plan.variant.constants(alpha);
    let shader = |spirv| Shader {
        spirv,
        constants: &constants,
    };
    let desc = GraphicsPipelineDesc {
        name,
        vertex: shader(cairn_shaders::FORWARD_VERT.spirv),
        fragment: Some(shader(cairn_shaders::FORWARD_FRAG.spirv)),
        input: VertexInput::Scene,
        colors: &[hdr_target(blend)],
        depth: Some(depth),
        samples: plan.samples,
        depth_bias: false,
    };
    GraphicsPipeline::new(gpu, layouts, &desc)
}

fn hdr_target(blend: Blend) -> ColorTarget {
    ColorTarget {
        format: HDR_FORMAT,
        blend,
    }
}

fn depth_state(compare: vk::CompareOp, write: bool) -> DepthState {
    DepthState {
        format: DEPTH_FORMAT,
        compare,
        write,
    }
}

/// Viewport and scissor of the whole target. `flipped` turns Y up, as scene passes have it.
fn cover(commands: &mut Commands, extent: [u32; 2], flipped: bool) {
    commands.set_viewport(extent, flipped);
    commands.set_scissor(extent);
}

/// State of a pass that draws one triangle over the target.
fn fullscreen(commands: &mut Commands, extent: [u32; 2], flipped: bool) {
    cover(commands, extent, flipped);
    commands.set_cull_mode(vk::CullModeFlags::NONE);
    commands.set_front_face(vk::FrontFace::COUNTER_CLOCKWISE);
}

fn front_face(draw: &Draw) -> vk::FrontFace {
    if draw.mirrored {
        vk::FrontFace::CLOCKWISE
    } else {
        vk::FrontFace::COUNTER_CLOCKWISE
    }
}

/// What draws a pass's surfaces: opaque ones, and those cut by alpha.
pub(crate) struct SurfacePipelines {
    opaque: GraphicsPipeline,
    /// Absent where nothing is cut, so that no pipeline discards.
    masked: Option<GraphicsPipeline>,
}

impl SurfacePipelines {
    fn new(masked: bool, build: impl Fn(Alpha) -> GpuResult<GraphicsPipeline>) -> GpuResult<Self> {
        Ok(Self {
            opaque: build(Alpha::Ignored)?,
            masked: masked.then(|| build(Alpha::Cut)).transpose()?,
        })
    }

    /// The pipeline of surfaces cut by alpha; without one of their own they draw as the others.
    fn masked(&self) -> &GraphicsPipeline {
        self.masked.as_ref().unwrap_or(&self.opaque)
    }

    /// Draws both lists. Targets, sets and vertex buffers are bound.
    fn draw(&self, commands: &mut Commands, extent: [u32; 2], opaque: &[Draw], masked: &[Draw]) {
        bucket(commands, extent, &self.opaque, opaque);
        bucket(commands, extent, self.masked(), masked);
    }
}

/// Draws in the list's order, changing state only where it differs from the draw before.
fn bucket(commands: &mut Commands, extent: [u32; 2], pipeline: &GraphicsPipeline, draws: &[Draw]) {
    let mut last = None;
    for draw in draws {
        if last.is_none() {
            commands.bind_graphics(pipeline);
            cover(commands, extent, true);
        }
        let state = (draw.double_sided, draw.mirrored);
        if last != Some(state) {
            commands.set_cull_mode(if draw.double_sided {
                vk::CullModeFlags::NONE
            } else {
                vk::CullModeFlags::BACK
            });
            commands.set_front_face(front_face(draw));
            last = Some(state);
        }
        issue(commands, draw);
    }
}

fn issue(commands: &mut Commands, draw: &Draw) {
    commands.draw_indexed(
        draw.index_count,
        draw.instance_count,
        draw.first_index,
        draw.vertex_offset,
        draw.first_visible,
    );
}
