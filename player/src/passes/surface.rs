//! Depth, normal and roughness of the visible triangles, for the passes that read the screen.

use super::compute::ComputePass;
use super::visible_constants;
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
    let constants = visible_constants(plan);
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
    let mut uses = Uses::of(&[(targets.drawn.depth, Usage::Sampled(Stage::Compute))]);
    if let Some(triangles) = targets.visibility {
        uses.push(triangles, Usage::Sampled(Stage::Compute));
    }
    if let Some(surface) = targets.surface {
        uses.push(surface.normal, Usage::StorageClear(Stage::Compute));
        uses.push(surface.roughness, Usage::StorageClear(Stage::Compute));
    }
    if targets.drawn.depth != targets.depth.current {
        uses.push(targets.depth.current, Usage::StorageClear(Stage::Compute));
    }
    uses
}

/// Fills the pass's set.
pub fn write(set: &mut DescriptorSet, parity: usize, graph: &Graph, targets: &Targets) {
    let image = |handle| graph.owned_at(handle, parity);
    let nearest = &targets.samplers.nearest;
    let resolved = targets.drawn.depth != targets.depth.current;
    if let Some(triangles) = targets.visibility {
        let binding = if resolved { 5 } else { 4 };
        set.write_image(binding, 0, image(triangles), nearest);
    }
    if resolved {
        set.write_image(7, 0, image(targets.drawn.depth), nearest);
        set.write_storage_image(0, image(targets.depth.current));
    }
    if let Some(surface) = targets.surface {
        set.write_storage_image(1, image(surface.normal));
        set.write_storage_image(2, image(surface.roughness));
    }
}
