//! The environment's sky wherever nothing was drawn.

use super::{depth_state, fullscreen, hdr_target};
use crate::gpu::{
    Blend, ColorAttachment, Commands, DepthAttachment, Gpu, GpuResult, GraphicsPipeline,
    GraphicsPipelineDesc, ImageRef, Layouts, Load, Shader, VertexInput, vk,
};

/// The pass's pipeline.
pub struct Skybox {
    pipeline: GraphicsPipeline,
}

impl Skybox {
    /// Passes where depth is still infinitely far: the triangle lies at 0.
    pub fn new(gpu: &Gpu, layouts: &Layouts, samples: u32) -> GpuResult<Self> {
        let desc = GraphicsPipelineDesc {
            name: "skybox",
            vertex: Shader {
                spirv: cairn_shaders::SKYBOX_VERT.spirv,
                constants: &[],
            },
            fragment: Some(Shader {
                spirv: cairn_shaders::SKYBOX_FRAG.spirv,
                constants: &[],
            }),
            input: VertexInput::None,
            colors: &[hdr_target(Blend::None)],
            depth: Some(depth_state(vk::CompareOp::GREATER_OR_EQUAL, false)),
            samples,
            depth_bias: false,
        };
        Ok(Self {
            pipeline: GraphicsPipeline::new(gpu, layouts, &desc)?,
        })
    }

    /// Draws behind what the targets hold. Sets are bound.
    pub fn record(&self, commands: &mut Commands, hdr: ImageRef<'_>, depth: ImageRef<'_>) {
        let extent = hdr.extent();
        let color = ColorAttachment {
            image: hdr,
            load: Load::Keep,
            store: true,
        };
        let depth = DepthAttachment {
            image: depth,
            load: Load::Keep,
            store: true,
        };
        commands.begin_rendering(extent, &[color], Some(depth));
        commands.bind_graphics(&self.pipeline);
        fullscreen(commands, extent, true);
        commands.draw(3, 1);
        commands.end_rendering();
    }
}
