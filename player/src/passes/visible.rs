//! What the passes that read the visibility target have in common.

use super::{Alpha, Variant};
use crate::gpu::DescriptorSet;
use crate::graph::{Graph, Stage, Usage, Uses};
use crate::plan::Plan;
use crate::targets::Targets;

/// Specialisation constants: the surfaces', then those of `samples.glsl`.
pub(super) fn constants(plan: &Plan) -> Vec<(u32, u32)> {
    let mut constants = Variant::constants(&plan.variant, Alpha::Ignored).to_vec();
    constants.extend([(32, plan.samples), (33, u32::from(plan.skybox))]);
    constants
}

/// The triangles and the depth that says where there are any.
pub(super) fn uses(targets: &Targets) -> Uses {
    let mut uses = Uses::of(&[(targets.drawn.depth, Usage::Sampled(Stage::Compute))]);
    if let Some(triangles) = targets.visibility {
        uses.push(triangles, Usage::Sampled(Stage::Compute));
    }
    uses
}

/// Binds both for `samples.glsl`: one sample's depth is in set 2.
pub(super) fn write(set: &mut DescriptorSet, parity: usize, graph: &Graph, targets: &Targets) {
    let image = |handle| graph.owned_at(handle, parity);
    let nearest = &targets.samplers.nearest;
    let resolved = targets.is_resolved();
    if let Some(triangles) = targets.visibility {
        let binding = if resolved { 5 } else { 4 };
        set.write_image(binding, 0, image(triangles), nearest);
    }
    if resolved {
        set.write_image(7, 0, image(targets.drawn.depth), nearest);
    }
}
