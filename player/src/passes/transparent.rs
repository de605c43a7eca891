//! Blended surfaces over everything else, back to front.

use super::{Alpha, Variant, cover, depth_state, front_face, hdr_target, issue};
use crate::draw::Draw;
use crate::gpu::{
    Blend, ColorAttachment, Commands, DepthAttachment, Gpu, GpuResult, GraphicsPipeline,
    GraphicsPipelineDesc, ImageRef, Layouts, Load, Shader, VertexInput, vk,
};

/// The pass's pipeline.
pub struct Transparent {
    pipeline: GraphicsPipeline,
}

impl Transparent {
    /// Depth is tested and not written; colour is `src * a + dst * (1 - a)`, glTF's "over".
    pub fn new(gpu: &Gpu, layouts: &Layouts, variant: &Variant) -> GpuResult<Self> {
        let constants = variant.constants(Alpha::Blended);
        let desc = GraphicsPipelineDesc {
            name: "transparent",
            vertex: Shader {
                spirv: cairn_shaders::FORWARD_VERT.spirv,
                constants: &constants,
            },
            fragment: Some(Shader {
                spirv: cairn_shaders::FORWARD_FRAG.spirv,
                constants: &constants,
            }),
            input: VertexInput::Scene,
            colors: &[hdr_target(Blend::Alpha)],
            depth: Some(depth_state(vk::CompareOp::GREATER, false)),
        };
        Ok(Self {
            pipeline: GraphicsPipeline::new(gpu, layouts, &desc)?,
        })
    }

    /// Draws in the list's order. A double-sided surface is drawn twice, far faces first, so that a closed
    /// shape's inside lies behind its outside.
    pub fn record(
        &self,
        commands: &mut Commands,
        hdr: ImageRef<'_>,
        depth: ImageRef<'_>,
        draws: &[Draw],
    ) {
        let extent = hdr.extent();
        let color = ColorAttachment {
            image: hdr,
            load: Load::Keep,
            store: true,
        };
        let depth = DepthAttachment {
            image: depth,
            load: Load::Keep,
            store: false,
        };
        commands.begin_rendering(extent, &[color], Some(depth));
        commands.bind_graphics(&self.pipeline);
        cover(commands, extent, true);
        for draw in draws {
            commands.set_front_face(front_face(draw));
            if draw.double_sided {
                commands.set_cull_mode(vk::CullModeFlags::FRONT);
                issue(commands, draw);
            }
            commands.set_cull_mode(vk::CullModeFlags::BACK);
            issue(commands, draw);
        }
        commands.end_rendering();
    }
}
