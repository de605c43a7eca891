//! Which triangle each sample sees: all that rasterisation decides before surfaces are shaded in compute.

use super::{Alpha, FAR_DEPTH, SurfacePipelines, VISIBILITY_FORMAT, depth_state};
use crate::draw::Draw;
use crate::gpu::{
    Blend, ColorAttachment, ColorTarget, Commands, DepthAttachment, Gpu, GpuResult,
    GraphicsPipeline, GraphicsPipelineDesc, ImageRef, Layouts, Load, Shader, VertexInput, vk,
};
use crate::plan::Plan;

/// The pass's pipelines.
pub struct Visibility(SurfacePipelines);

impl Visibility {
    /// Builds what the package needs.
    pub fn new(gpu: &Gpu, layouts: &Layouts, plan: &Plan) -> GpuResult<Self> {
        let build = |alpha| pipeline(gpu, layouts, plan, alpha);
        SurfacePipelines::new(plan.variant.masked, build).map(Self)
    }

    /// Clears depth and draws. Sets and vertex buffers are bound.
    pub fn record(
        &self,
        commands: &mut Commands,
        triangles: ImageRef<'_>,
        depth: ImageRef<'_>,
        opaque: &[Draw],
        masked: &[Draw],
    ) {
        let extent = depth.extent();
        let color = ColorAttachment {
            image: triangles,
            // Where depth stays far, nobody reads it: a clear would cost as much as drawing.
            load: Load::Discard,
            store: true,
        };
        let depth = DepthAttachment {
            image: depth,
            load: Load::Clear(FAR_DEPTH),
            store: true,
        };
        commands.begin_rendering(extent, &[color], Some(depth));
        self.0.draw(commands, extent, opaque, masked);
        commands.end_rendering();
    }
}

fn pipeline(
    gpu: &Gpu,
    layouts: &Layouts,
    plan: &Plan,
    alpha: Alpha,
) -> GpuResult<GraphicsPipeline> {
    let constants = plan.variant.constants(alpha);
    let shader = |spirv| Shader {
        spirv,
        constants: &constants,
    };
    let desc = GraphicsPipelineDesc {
        name: match alpha {
            Alpha::Cut => "visibility masked",
            _ => "visibility opaque",
        },
        vertex: shader(cairn_shaders::VISIBILITY_VERT.spirv),
        fragment: Some(shader(cairn_shaders::VISIBILITY_FRAG.spirv)),
        input: VertexInput::Positions,
        colors: &[ColorTarget {
            format: VISIBILITY_FORMAT,
            blend: Blend::None,
        }],
        depth: Some(depth_state(vk::CompareOp::GREATER_OR_EQUAL, true)),
        samples: plan.samples,
        depth_bias: false,
    };
    GraphicsPipeline::new(gpu, layouts, &desc)
}
