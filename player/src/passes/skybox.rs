//! The environment's sky wherever nothing was drawn.

use super::compute::ComputePass;
use super::{depth_state, fullscreen, hdr_target};
use crate::gpu::{
    Blend, ColorAttachment, Commands, DepthAttachment, DescriptorSet, Gpu, GpuResult,
    GraphicsPipeline, GraphicsPipelineDesc, ImageRef, Layouts, Load, Shader, VertexInput, vk,
};
use crate::graph::{Graph, Images, Stage, Usage, Uses};
use crate::plan::Plan;
use crate::targets::Targets;

/// The pass: compute where a pixel has one sample, else a triangle at infinity, which every sample tests.
pub struct Skybox(Method);

enum Method {
    Fragment(GraphicsPipeline),
    Compute(ComputePass),
}

impl Skybox {
    /// Builds the pass.
    ///
    /// # Errors
    /// Failures of Vulkan.
    pub fn new(
        gpu: &Gpu,
        layouts: &Layouts,
        graph: &Graph,
        targets: &Targets,
        plan: &Plan,
    ) -> GpuResult<Self> {
        let method = if plan.samples > 1 {
            Method::Fragment(triangle(gpu, layouts, plan.samples)?)
        } else {
            let shader = Shader {
                spirv: cairn_shaders::SKYBOX_COMP.spirv,
                constants: &[],
            };
            let fill = |set: &mut DescriptorSet, parity| write(set, parity, graph, targets);
            Method::Compute(ComputePass::new(gpu, layouts, "skybox", &shader, fill)?)
        };
        Ok(Self(method))
    }

    /// Follows images that were replaced.
    ///
    /// # Errors
    /// Failures of Vulkan.
    pub fn rebind(&mut self, layouts: &Layouts, graph: &Graph, targets: &Targets) -> GpuResult<()> {
        match &mut self.0 {
            Method::Fragment(_) => Ok(()),
            Method::Compute(pass) => {
                pass.rebind(layouts, |set, parity| write(set, parity, graph, targets))
            }
        }
    }

    /// What the pass touches.
    pub fn uses(&self, targets: &Targets) -> Uses {
        match self.0 {
            Method::Fragment(_) => Uses::of(&[
                (targets.drawn.hdr, Usage::Color),
                (targets.drawn.depth, Usage::Depth),
            ]),
            Method::Compute(_) => Uses::of(&[
                (targets.hdr, Usage::Storage(Stage::Compute)),
                (targets.depth.current, Usage::Sampled(Stage::Compute)),
            ]),
        }
    }

    /// Draws behind what the targets hold. Sets 0 to 2 are bound.
    pub fn record(
        &self,
        commands: &mut Commands,
        layouts: &Layouts,
        images: &Images<'_>,
        targets: &Targets,
        parity: usize,
    ) {
        match &self.0 {
            Method::Fragment(pipeline) => {
                let (hdr, depth) = (
                    images.get(targets.drawn.hdr),
                    images.get(targets.drawn.depth),
                );
                draw(commands, pipeline, hdr, depth);
            }
            Method::Compute(pass) => {
                let extent = images.get(targets.hdr).extent();
                pass.record(commands, layouts, parity, extent);
            }
        }
    }
}

/// Passes where depth is still infinitely far: the triangle lies at 0.
fn triangle(gpu: &Gpu, layouts: &Layouts, samples: u32) -> GpuResult<GraphicsPipeline> {
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
    GraphicsPipeline::new(gpu, layouts, &desc)
}

fn draw(
    commands: &mut Commands,
    pipeline: &GraphicsPipeline,
    hdr: ImageRef<'_>,
    depth: ImageRef<'_>,
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
        store: true,
    };
    commands.begin_rendering(extent, &[color], Some(depth));
    commands.bind_graphics(pipeline);
    fullscreen(commands, extent, true);
    commands.draw(3, 1);
    commands.end_rendering();
}

fn write(set: &mut DescriptorSet, parity: usize, graph: &Graph, targets: &Targets) {
    set.write_storage_image(0, graph.owned_at(targets.hdr, parity));
}
