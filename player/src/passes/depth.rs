//! Depth of opaque and cut surfaces before anything is shaded, with normals and roughness where a pass reads them.

use super::{
    Alpha, FAR_DEPTH, NORMAL_FORMAT, ROUGHNESS_FORMAT, SurfacePipelines, Variant, depth_state,
};
use crate::draw::Draw;
use crate::gpu::{
    Blend, ColorAttachment, ColorTarget, Commands, DepthAttachment, Gpu, GpuResult,
    GraphicsPipeline, GraphicsPipelineDesc, ImageRef, Layouts, Load, Shader, VertexInput, vk,
};
use crate::plan::Plan;

/// No normal: what the sky has.
const NO_NORMAL: [f32; 4] = [0.5, 0.5, 0.5, 1.0];
const NO_ROUGHNESS: [f32; 4] = [1.0; 4];

/// The pass's pipelines.
pub struct Depth(SurfacePipelines);

/// What the pass draws to.
#[derive(Clone, Copy)]
pub struct DepthImages<'a> {
    pub depth: ImageRef<'a>,
    /// Normal and roughness.
    pub surface: Option<[ImageRef<'a>; 2]>,
}

impl Depth {
    /// Builds what the package needs.
    pub fn new(gpu: &Gpu, layouts: &Layouts, plan: &Plan) -> GpuResult<Self> {
        let build = |alpha| pipeline(gpu, layouts, plan, alpha);
        SurfacePipelines::new(plan.variant.masked, build).map(Self)
    }

    /// Clears the targets and draws. Sets and vertex buffers are bound.
    pub fn record(
        &self,
        commands: &mut Commands,
        images: DepthImages<'_>,
        opaque: &[Draw],
        masked: &[Draw],
    ) {
        let extent = images.depth.extent();
        let depth = DepthAttachment {
            image: images.depth,
            load: Load::Clear(FAR_DEPTH),
            store: true,
        };
        let color = |image, clear| ColorAttachment {
            image,
            load: Load::Clear(clear),
            store: true,
        };
        match images.surface {
            Some([normal, roughness]) => {
                let colors = [color(normal, NO_NORMAL), color(roughness, NO_ROUGHNESS)];
                commands.begin_rendering(extent, &colors, Some(depth));
            }
            None => commands.begin_rendering(extent, &[], Some(depth)),
        }
        self.0.draw(commands, extent, opaque, masked);
        commands.end_rendering();
    }
}

/// Opaque surfaces need a fragment shader only for their normals.
fn pipeline(
    gpu: &Gpu,
    layouts: &Layouts,
    plan: &Plan,
    alpha: Alpha,
) -> GpuResult<GraphicsPipeline> {
    let constants = constants(&plan.variant, alpha, plan.normals);
    let shader = |spirv| Shader {
        spirv,
        constants: &constants,
    };
    let target = |format| ColorTarget {
        format,
        blend: Blend::None,
    };
    let colors = [target(NORMAL_FORMAT), target(ROUGHNESS_FORMAT)];
    let desc = GraphicsPipelineDesc {
        name: match alpha {
            Alpha::Cut => "depth masked",
            _ => "depth opaque",
        },
        vertex: shader(cairn_shaders::FORWARD_VERT.spirv),
        fragment: (plan.normals || alpha == Alpha::Cut)
            .then(|| shader(cairn_shaders::DEPTH_FRAG.spirv)),
        input: VertexInput::Scene,
        colors: &colors[..if plan.normals { 2 } else { 0 }],
        depth: Some(depth_state(vk::CompareOp::GREATER_OR_EQUAL, true)),
        samples: plan.samples,
        depth_bias: false,
    };
    GraphicsPipeline::new(gpu, layouts, &desc)
}

/// Those of the surfaces, then `WRITES_SURFACE`.
fn constants(variant: &Variant, alpha: Alpha, normals: bool) -> Vec<(u32, u32)> {
    let mut constants = variant.constants(alpha).to_vec();
    constants.push((WRITES_SURFACE, u32::from(normals)));
    constants
}

/// Specialisation constant of `depth.frag`.
const WRITES_SURFACE: u32 = 31;
