//! Radiance of every pixel from its visible triangles, in compute: surfaces, sky and blended layer, resolved.

use super::compute::ComputePass;
use super::visible_constants;
use crate::gpu::{DescriptorSet, Gpu, GpuResult, Layouts, Shader};
use crate::graph::{Graph, Stage, Usage, Uses};
use crate::plan::Plan;
use crate::targets::Targets;

/// Push constants of `visible.glsl`.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
pub struct VisiblePush {
    /// Records in the draw group buffer.
    pub draw_groups: u32,
    /// Pixels that the layer of blended surfaces covers: left, top, right, bottom; all 0 without one.
    pub layer: [u32; 4],
}

impl VisiblePush {
    /// For that many draw groups.
    pub fn new(draw_groups: u32, layer: Option<[u32; 4]>) -> Self {
        Self {
            draw_groups,
            layer: layer.unwrap_or_default(),
        }
    }
}

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
        spirv: cairn_shaders::SHADE_COMP.spirv,
        constants: &constants,
    };
    ComputePass::new(gpu, layouts, "shade", &shader, |set, parity| {
        write(set, parity, graph, targets);
    })
}

/// What the pass touches, but for what the lights and the screen's occlusion add.
pub fn uses(targets: &Targets, layered: bool) -> Uses {
    let mut uses = Uses::of(&[
        (targets.hdr, Usage::StorageClear(Stage::Compute)),
        (targets.drawn.depth, Usage::Sampled(Stage::Compute)),
    ]);
    if let Some(triangles) = targets.visibility {
        uses.push(triangles, Usage::Sampled(Stage::Compute));
    }
    if layered {
        uses.push(targets.drawn.hdr, Usage::Sampled(Stage::Compute));
    }
    uses
}

/// Fills the pass's set.
pub fn write(set: &mut DescriptorSet, parity: usize, graph: &Graph, targets: &Targets) {
    let image = |handle| graph.owned_at(handle, parity);
    let nearest = &targets.samplers.nearest;
    set.write_storage_image(0, image(targets.hdr));
    let resolved = targets.drawn.depth != targets.depth.current;
    if let Some(triangles) = targets.visibility {
        let binding = if resolved { 5 } else { 4 };
        set.write_image(binding, 0, image(triangles), nearest);
    }
    if resolved {
        set.write_image(7, 0, image(targets.drawn.depth), nearest);
    }
    if targets.drawn.hdr != targets.hdr {
        set.write_image(6, 0, image(targets.drawn.hdr), nearest);
    }
}
