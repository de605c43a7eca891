//! The nearest sample of each pixel's depth, with its normal and roughness: what screen-space passes read under
//! multisampling.

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
    let constants = [(0, plan.samples), (1, u32::from(plan.normals))];
    let shader = Shader {
        spirv: cairn_shaders::RESOLVE_SURFACE_COMP.spirv,
        constants: &constants,
    };
    ComputePass::new(gpu, layouts, "resolve surface", &shader, |set, parity| {
        write(set, parity, graph, targets);
    })
}

/// What the pass touches.
pub fn uses(targets: &Targets) -> Uses {
    let drawn = &targets.drawn;
    let mut uses = Uses::of(&[
        (drawn.depth, Usage::Sampled(Stage::Compute)),
        (targets.depth.current, Usage::StorageClear(Stage::Compute)),
    ]);
    for surface in drawn.surface.iter() {
        uses.push(surface.normal, Usage::Sampled(Stage::Compute));
        uses.push(surface.roughness, Usage::Sampled(Stage::Compute));
    }
    for surface in targets.surface.iter() {
        uses.push(surface.normal, Usage::StorageClear(Stage::Compute));
        uses.push(surface.roughness, Usage::StorageClear(Stage::Compute));
    }
    uses
}

/// Fills the pass's set.
pub fn write(set: &mut DescriptorSet, parity: usize, graph: &Graph, targets: &Targets) {
    let image = |handle| graph.owned_at(handle, parity);
    let nearest = &targets.samplers.nearest;
    set.write_storage_image(0, image(targets.depth.current));
    set.write_image(4, 0, image(targets.drawn.depth), nearest);
    if let (Some(resolved), Some(drawn)) = (targets.surface, targets.drawn.surface) {
        set.write_storage_image(1, image(resolved.normal));
        set.write_storage_image(2, image(resolved.roughness));
        set.write_image(5, 0, image(drawn.normal), nearest);
        set.write_image(6, 0, image(drawn.roughness), nearest);
    }
}
