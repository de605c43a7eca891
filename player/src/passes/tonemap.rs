//! Exposure, tone curve, dithering and encoding into the image that is shown.

use super::fullscreen;
use crate::gpu::{
    Blend, ColorAttachment, ColorTarget, Commands, ComputePipeline, DescriptorSet, Gpu, GpuResult,
    GraphicsPipeline, GraphicsPipelineDesc, ImageRef, Layouts, Load, SetIndex, Shader, VertexInput,
    vk,
};
use crate::graph::{Stage, Usage};
use crate::settings::Tonemap as Curve;

/// Invocations of a workgroup along each side.
const GROUP: u32 = 8;

/// The pass: compute where the target can be stored to, else a triangle over it.
pub struct Tonemap(Method);

enum Method {
    /// The target has an sRGB format: the attachment encodes.
    Fragment(GraphicsPipeline),
    /// The target has a plain format: the shader encodes.
    Compute {
        pipeline: ComputePipeline,
        /// Set 3 with the target that it was made for.
        bound: Option<(vk::ImageView, DescriptorSet)>,
    },
}

impl Tonemap {
    /// A target of `R8G8B8A8_UNORM` needs storage usage; any other format is an sRGB attachment.
    pub fn new(gpu: &Gpu, layouts: &Layouts, format: vk::Format) -> GpuResult<Self> {
        if format == vk::Format::R8G8B8A8_UNORM {
            let shader = Shader {
                spirv: cairn_shaders::TONEMAP_COMP.spirv,
                constants: &[],
            };
            return Ok(Self(Method::Compute {
                pipeline: ComputePipeline::new(gpu, layouts, "tonemap", &shader)?,
                bound: None,
            }));
        }
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
        Ok(Self(Method::Fragment(GraphicsPipeline::new(
            gpu, layouts, &desc,
        )?)))
    }

    /// How the pass uses the HDR image and the target.
    pub fn usages(&self) -> [Usage; 2] {
        match self.0 {
            Method::Fragment(_) => [Usage::Sampled(Stage::Fragment), Usage::ColorClear],
            Method::Compute { .. } => [
                Usage::Sampled(Stage::Compute),
                Usage::StorageClear(Stage::Compute),
            ],
        }
    }

    /// Tells the pass what the next [`Tonemap::record`] draws into.
    ///
    /// # Errors
    /// Failures of Vulkan.
    pub fn bind_target(&mut self, layouts: &Layouts, target: ImageRef<'_>) -> GpuResult<()> {
        let Method::Compute { bound, .. } = &mut self.0 else {
            return Ok(());
        };
        let view = target.raw_view();
        if bound.as_ref().is_none_or(|(known, _)| *known != view) {
            let mut set = layouts.allocate(SetIndex::Pass, "tonemap")?;
            set.write_storage_image(0, target);
            *bound = Some((view, set));
        }
        Ok(())
    }

    /// Reads the HDR image of set 2, which has the target's extent, texel by texel. Sets 0 to 2 are bound.
    ///
    /// # Panics
    /// Where the target was not bound.
    pub fn record(
        &self,
        commands: &mut Commands,
        layouts: &Layouts,
        target: ImageRef<'_>,
        curve: Curve,
    ) {
        let extent = target.extent();
        let number = number(curve);
        match &self.0 {
            Method::Fragment(pipeline) => {
                let color = ColorAttachment {
                    image: target,
                    load: Load::Discard,
                    store: true,
                };
                commands.begin_rendering(extent, &[color], None);
                commands.bind_graphics(pipeline);
                fullscreen(commands, extent, false);
                commands.push_constants(layouts, &number);
                commands.draw(3, 1);
                commands.end_rendering();
            }
            Method::Compute { pipeline, bound } => {
                let Some((_, set)) = bound else {
                    panic!("the target was not bound");
                };
                commands.bind_compute(pipeline);
                commands.bind_sets(layouts, vk::PipelineBindPoint::COMPUTE, &[set]);
                commands.push_constants(layouts, &number);
                commands.dispatch([extent[0].div_ceil(GROUP), extent[1].div_ceil(GROUP), 1]);
            }
        }
    }
}

/// The `CURVE_*` constants of `tonemap.glsl`.
fn number(curve: Curve) -> u32 {
    match curve {
        Curve::Aces => 0,
        Curve::Linear => 1,
        Curve::Agx => 2,
        Curve::Neutral => 3,
    }
}
