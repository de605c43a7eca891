//! Exposure, tone curve and encoding into the image that is shown.

use super::fullscreen;
use crate::gpu::{
    Blend, ColorAttachment, ColorTarget, Commands, Gpu, GpuResult, GraphicsPipeline,
    GraphicsPipelineDesc, ImageRef, Layouts, Load, Shader, VertexInput, vk,
};
use crate::settings::Tonemap as Curve;

/// The pass's pipeline.
pub struct Tonemap {
    pipeline: GraphicsPipeline,
}

impl Tonemap {
    /// `format` is an sRGB one: the attachment encodes.
    pub fn new(gpu: &Gpu, layouts: &Layouts, format: vk::Format) -> GpuResult<Self> {
        let desc = GraphicsPipelineDesc {
            name: "tonemap",
            vertex: Shader {
                spirv: cairn_shaders::FULLSCREEN_VERT.spirv,
                constants: &[],
            },
            fragment: Some(Shader {
                spirv: cairn_shaders::TONEMAP_FRAG.spirv,
                constants: &[],
            }),
            input: VertexInput::None,
            colors: &[ColorTarget {
                format,
                blend: Blend::None,
            }],
            depth: None,
            samples: 1,
            depth_bias: false,
        };
        Ok(Self {
            pipeline: GraphicsPipeline::new(gpu, layouts, &desc)?,
        })
    }

    /// Reads the HDR image of set 2, which has the target's extent, texel by texel. Sets are bound.
    pub fn record(
        &self,
        commands: &mut Commands,
        layouts: &Layouts,
        target: ImageRef<'_>,
        curve: Curve,
    ) {
        let extent = target.extent();
        let color = ColorAttachment {
            image: target,
            load: Load::Discard,
            store: true,
        };
        commands.begin_rendering(extent, &[color], None);
        commands.bind_graphics(&self.pipeline);
        fullscreen(commands, extent, false);
        let curve: u32 = match curve {
            Curve::Aces | Curve::Agx | Curve::Neutral => 0,
            Curve::Linear => 1,
        };
        commands.push_constants(layouts, &curve);
        commands.draw(3, 1);
        commands.end_rendering();
    }
}
