//! Shadows of small things nearby, searched in the depth image towards directional light 0.

use cairn_format::gpu::ContactPush;

use super::compute::ComputePass;
use crate::gpu::{DescriptorSet, Gpu, GpuResult, Layouts, Shader};
use crate::graph::{Graph, Handle, Stage, Usage, Uses};
use crate::settings::ContactSettings;
use crate::targets::Targets;

/// Distance of 0 in the settings: this part of the scene's diagonal.
const AUTO_DISTANCE: f32 = 0.02;
/// Thickness of 0 in the settings: this part of the distance.
const AUTO_THICKNESS: f32 = 0.25;

/// `diagonal` is the scene's, metres.
pub fn push(settings: &ContactSettings, diagonal: f32) -> ContactPush {
    let reach = match settings.distance {
        0.0 => AUTO_DISTANCE * diagonal,
        distance => distance,
    };
    let thickness = match settings.thickness {
        0.0 => AUTO_THICKNESS * reach,
        thickness => thickness,
    };
    ContactPush {
        reach,
        thickness,
        steps: settings.steps,
    }
}

/// Builds the pass; `mask` is 1 where the light arrives.
///
/// # Errors
/// Failures of Vulkan.
pub fn new(gpu: &Gpu, layouts: &Layouts, graph: &Graph, mask: Handle) -> GpuResult<ComputePass> {
    let shader = Shader {
        spirv: cairn_shaders::CONTACT_COMP.spirv,
        constants: &[],
    };
    ComputePass::new(gpu, layouts, "contact", &shader, |set, parity| {
        write(set, parity, graph, mask);
    })
}

/// What the pass touches.
pub fn uses(targets: &Targets, mask: Handle) -> Uses {
    let mut uses = Uses::of(&[
        (targets.depth.current, Usage::Sampled(Stage::Compute)),
        (mask, Usage::StorageClear(Stage::Compute)),
    ]);
    for surface in targets.surface.iter() {
        uses.push(surface.normal, Usage::Sampled(Stage::Compute));
    }
    uses
}

/// Fills the pass's set.
pub fn write(set: &mut DescriptorSet, parity: usize, graph: &Graph, mask: Handle) {
    set.write_storage_image(0, graph.owned_at(mask, parity));
}
