//! Filters ambient occlusion over neighbouring pixels of the same surface.

use cairn_format::gpu::AoSpatialPush;

use super::compute::ComputePass;
use crate::gpu::{DescriptorSet, Gpu, GpuResult, Layouts, Shader};
use crate::graph::{Graph, Stage, Usage, Uses};
use crate::settings::AoSettings;
use crate::targets::{AoImages, Targets};

/// From the settings.
pub fn push(settings: &AoSettings) -> AoSpatialPush {
    AoSpatialPush {
        intensity: settings.intensity,
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
    images: AoImages,
) -> GpuResult<ComputePass> {
    let shader = Shader {
        spirv: cairn_shaders::AO_SPATIAL_COMP.spirv,
        constants: &[],
    };
    ComputePass::new(gpu, layouts, "ao spatial", &shader, |set, parity| {
        write(set, parity, graph, targets, images);
    })
}

/// What the pass touches.
pub fn uses(targets: &Targets, images: AoImages) -> Uses {
    let mut uses = Uses::of(&[
        (targets.depth.current, Usage::Sampled(Stage::Compute)),
        (images.noisy, Usage::Sampled(Stage::Compute)),
        (images.filtered(), Usage::StorageClear(Stage::Compute)),
    ]);
    for surface in targets.surface.iter() {
        uses.push(surface.normal, Usage::Sampled(Stage::Compute));
    }
    uses
}

/// Fills the pass's set.
pub fn write(
    set: &mut DescriptorSet,
    parity: usize,
    graph: &Graph,
    targets: &Targets,
    images: AoImages,
) {
    let nearest = &targets.samplers.nearest;
    set.write_storage_image(0, graph.owned_at(images.filtered(), parity));
    set.write_image(4, 0, graph.owned_at(images.noisy, parity), nearest);
}
