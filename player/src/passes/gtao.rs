//! Ambient occlusion and bent normals out of the depth image, noisy.

use cairn_format::gpu::GtaoPush;

use super::compute::ComputePass;
use crate::gpu::{DescriptorSet, Gpu, GpuResult, Layouts, Shader};
use crate::graph::{Graph, Stage, Usage, Uses};
use crate::plan::AoPlan;
use crate::settings::AoSettings;
use crate::targets::{AoImages, Targets};

/// Frames after which the noise repeats.
const NOISE_FRAMES: u32 = 64;

/// `diagonal` is the scene's, metres. Without a filter over time the noise stands still.
pub fn push(settings: &AoSettings, diagonal: f32, frame: u32) -> GtaoPush {
    GtaoPush {
        radius: settings.reach(diagonal),
        thin_compensation: settings.thin_compensation,
        noise_frame: match settings.temporal {
            0.0 => 0,
            _ => frame % NOISE_FRAMES,
        },
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
    images: AoImages,
    plan: AoPlan,
) -> GpuResult<ComputePass> {
    let constants = [(0, plan.directions), (1, plan.steps)];
    let shader = Shader {
        spirv: cairn_shaders::GTAO_COMP.spirv,
        constants: &constants,
    };
    ComputePass::new(gpu, layouts, "gtao", &shader, |set, parity| {
        write(set, parity, graph, images);
    })
}

/// What the pass touches.
pub fn uses(targets: &Targets, images: AoImages) -> Uses {
    let mut uses = Uses::of(&[
        (targets.depth.current, Usage::Sampled(Stage::Compute)),
        (images.noisy, Usage::StorageClear(Stage::Compute)),
    ]);
    for surface in targets.surface.iter() {
        uses.push(surface.normal, Usage::Sampled(Stage::Compute));
    }
    uses
}

/// Fills the pass's set.
pub fn write(set: &mut DescriptorSet, parity: usize, graph: &Graph, images: AoImages) {
    set.write_storage_image(0, graph.owned_at(images.noisy, parity));
}
