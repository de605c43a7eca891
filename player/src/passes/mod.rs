//! The passes of a frame, one file each.

pub mod forward;
pub mod skybox;
pub mod tonemap;
pub mod transparent;

#[cfg(test)]
mod tests;

use crate::draw::Draw;
use crate::gpu::{
    Blend, ColorTarget, Commands, DepthState, Gpu, GpuResult, GraphicsPipeline,
    GraphicsPipelineDesc, Layouts, Shader, VertexInput, vk,
};
use crate::settings::Brdf;

/// Linear radiance before exposure.
pub const HDR_FORMAT: vk::Format = vk::Format::R16G16B16A16_SFLOAT;
/// Reverse-Z: 1 at the near plane, 0 at infinity.
pub const DEPTH_FORMAT: vk::Format = vk::Format::D32_SFLOAT;

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
}

/// How a fragment's alpha is used.
#[derive(Clone, Copy, PartialEq)]
enum Alpha {
    Ignored,
    Cut,
    Blended,
}

impl Variant {
    /// Specialisation constants of `forward.vert` and `forward.frag`: see `options.glsl`.
    fn constants(&self, alpha: Alpha) -> [(u32, u32); 8] {
        let values = [
            alpha == Alpha::Cut,
            alpha == Alpha::Blended,
            self.environment,
            self.brdf_lut,
            self.lights,
            self.brdf == Brdf::Energy,
            self.vertex_colors,
            self.texture_transforms,
        ];
        std::array::from_fn(|id| (id as u32, u32::from(values[id])))
    }
}

/// A pipeline of the scene's surfaces: depth is always tested, and written where nothing blends; blended colour is
/// `src * a + dst * (1 - a)`, glTF's "over".
fn surface_pipeline(
    gpu: &Gpu,
    layouts: &Layouts,
    variant: &Variant,
    alpha: Alpha,
) -> GpuResult<GraphicsPipeline> {
    let (name, blend, writes_depth) = match alpha {
        Alpha::Ignored => ("forward opaque", Blend::None, true),
        Alpha::Cut => ("forward masked", Blend::None, true),
        Alpha::Blended => ("transparent", Blend::Alpha, false),
    };
    let constants = variant.constants(alpha);
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
        depth: Some(depth_state(vk::CompareOp::GREATER, writes_depth)),
        samples: 1,
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

fn issue(commands: &mut Commands, draw: &Draw) {
    commands.draw_indexed(
        draw.index_count,
        draw.instance_count,
        draw.first_index,
        draw.vertex_offset,
        draw.first_visible,
    );
}
