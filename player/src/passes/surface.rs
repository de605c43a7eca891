//! Depth, normal and roughness of the visible triangles, for the passes that read the screen.

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
        spirv: cairn_shaders::SURFACE_COMP.spirv,
        constants: &constants,
    };
    ComputePass::new(gpu, layouts, "surface", &shader, |set, parity| {
        write(set, parity, graph, targets);
    })
}

/// What the pass touches.
pub fn uses(targets: &Targets) -> Uses {
    let mut uses = visible::uses(targets);
    if let Some(surface) = targets.surface {
        uses.push(surface.normal, Usage::StorageClear(Stage::Compute));
        uses.push(surface.roughness, Usage::StorageClear(Stage::Compute));
    }
    if targets.is_resolved() {
        uses.push(targets.depth.current, Usage::StorageClear(Stage::Compute));
    }
    uses
}

/// Fills the pass's set.
pub fn write(set: &mut DescriptorSet, parity: usize, graph: &Graph, targets: &Targets) {
    visible::write(set, parity, graph, targets);
    let image = |handle| graph.owned_at(handle, parity);
    if targets.is_resolved() {
        set.write_storage_image(0, image(targets.depth.current));
    }
    if let Some(surface) = targets.surface {
        set.write_storage_image(1, image(surface.normal));
        set.write_storage_image(2, image(surface.roughness));
    }
}
