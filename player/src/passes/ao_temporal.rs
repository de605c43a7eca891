//! Joins this frame's ambient occlusion with that of the frames before.

use cairn_format::gpu::AoTemporalPush;

use super::compute::ComputePass;
use crate::gpu::{DescriptorSet, Gpu, GpuResult, Layouts, Shader};
use crate::graph::{Graph, Stage, Usage, Uses};
use crate::settings::AoSettings;
use crate::targets::{AoImages, Targets};

/// `valid`: whether the last frame wrote the history.
pub fn push(settings: &AoSettings, valid: bool) -> AoTemporalPush {
    AoTemporalPush {
        weight: settings.temporal,
        valid: u32::from(valid),
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
        spirv: cairn_shaders::AO_TEMPORAL_COMP.spirv,
        constants: &[],
    };
    ComputePass::new(gpu, layouts, "ao temporal", &shader, |set, parity| {
        write(set, parity, graph, targets, images);
    })
}

/// What the pass touches.
pub fn uses(targets: &Targets, images: AoImages) -> Uses {
    Uses::of(&[
        (targets.depth.current, Usage::Sampled(Stage::Compute)),
        (images.filtered(), Usage::Sampled(Stage::Compute)),
        (images.ao.history, Usage::Sampled(Stage::Compute)),
        (images.ao.current, Usage::StorageClear(Stage::Compute)),
    ])
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
    set.write_storage_image(0, graph.owned_at(images.ao.current, parity));
    set.write_image(4, 0, graph.owned_at(images.filtered(), parity), nearest);
    set.write_image(5, 0, graph.owned_at(images.ao.history, parity), nearest);
}
