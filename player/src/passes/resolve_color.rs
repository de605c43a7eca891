//! One radiance per pixel from its samples, weighted so that bright edges stay smooth behind the tone curve.

use super::compute::ComputePass;
use crate::gpu::{DescriptorSet, Gpu, GpuResult, Layouts, Shader};
use crate::graph::{Graph, Stage, Usage, Uses};
use crate::plan::Plan;
use crate::targets::Targets;

/// Builds the pass for multisampled targets.
///
/// # Errors
/// Failures of Vulkan.
pub fn new(
    gpu: &Gpu,
    layouts: &Layouts,
    graph: &Graph,
    targets: &Targets,
    plan: &Plan,
) -> GpuResult<ComputePass> {
    let constants = [(0, plan.samples)];
    let shader = Shader {
        spirv: cairn_shaders::RESOLVE_COLOR_COMP.spirv,
        constants: &constants,
    };
    ComputePass::new(gpu, layouts, "resolve color", &shader, |set, parity| {
        write(set, parity, graph, targets);
    })
}

/// What the pass touches.
pub fn uses(targets: &Targets) -> Uses {
    Uses::of(&[
        (targets.drawn.hdr, Usage::Sampled(Stage::Compute)),
        (targets.hdr, Usage::StorageClear(Stage::Compute)),
    ])
}

/// Fills the pass's set.
pub fn write(set: &mut DescriptorSet, parity: usize, graph: &Graph, targets: &Targets) {
    let image = |handle| graph.owned_at(handle, parity);
    set.write_storage_image(0, image(targets.hdr));
    let nearest = &targets.samplers.nearest;
    set.write_image(4, 0, image(targets.drawn.hdr), nearest);
}
