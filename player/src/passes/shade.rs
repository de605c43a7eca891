//! Radiance of every pixel from its visible triangles, in compute: surfaces, sky and blended layer, resolved.

use super::compute::ComputePass;
use super::visible;
use crate::gpu::{DescriptorSet, Gpu, GpuResult, Layouts, Shader};
use crate::graph::{Graph, Stage, Usage, Uses};
use crate::plan::Plan;
use crate::targets::Targets;

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
) -> GpuResult<ComputePass> {
    let constants = visible::constants(plan);
    let shader = Shader {
        spirv: cairn_shaders::SHADE_COMP.spirv,
        constants: &constants,
    };
    ComputePass::new(gpu, layouts, "shade", &shader, |set, parity| {
        write(set, parity, graph, targets);
    })
}

/// What the pass touches, but for what the lights and the screen's occlusion add.
pub fn uses(targets: &Targets, layered: bool) -> Uses {
    let mut uses = visible::uses(targets);
    uses.push(targets.hdr, Usage::StorageClear(Stage::Compute));
    if layered {
        uses.push(targets.drawn.hdr, Usage::Sampled(Stage::Compute));
    }
    uses
}

/// Fills the pass's set.
pub fn write(set: &mut DescriptorSet, parity: usize, graph: &Graph, targets: &Targets) {
    visible::write(set, parity, graph, targets);
    let image = |handle| graph.owned_at(handle, parity);
    set.write_storage_image(0, image(targets.hdr));
    if targets.drawn.hdr != targets.hdr {
        set.write_image(6, 0, image(targets.drawn.hdr), &targets.samplers.nearest);
    }
}
