//! The passes that find what lies around each pixel, in their order: GTAO, its filters, contact shadows.

use super::{Passes, ao_spatial, ao_temporal, contact, gtao};
use crate::gpu::Layouts;
use crate::graph::FrameGraph;
use crate::settings::Settings;
use crate::targets::Targets;

/// What the passes know of the frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surroundings {
    /// Diagonal of the scene, metres.
    pub diagonal: f32,
    /// Number of the frame.
    pub frame: u32,
    /// Whether the last frame wrote ambient occlusion.
    pub history: bool,
    /// Of the frame: which image of a pair is the current one.
    pub parity: usize,
    /// Pixels.
    pub extent: [u32; 2],
}

/// Records those that the plan has. Sets 0 to 2 are bound.
pub fn record(
    frame: &mut FrameGraph<'_>,
    passes: &Passes,
    layouts: &Layouts,
    targets: &Targets,
    settings: &Settings,
    around: &Surroundings,
) {
    let (parity, extent) = (around.parity, around.extent);
    if let (Some(pass), Some(ao)) = (&passes.gtao, targets.ao) {
        let push = gtao::push(&settings.ao, around.diagonal, around.frame);
        frame.pass(c"gtao", &gtao::uses(targets, ao), |commands, _| {
            commands.push_constants(layouts, &push);
            pass.record(commands, layouts, parity, extent);
        });
    }
    if let (Some(pass), Some(ao)) = (&passes.ao_spatial, targets.ao) {
        let (push, uses) = (
            ao_spatial::push(&settings.ao),
            ao_spatial::uses(targets, ao),
        );
        frame.pass(c"ao spatial", &uses, |commands, _| {
            commands.push_constants(layouts, &push);
            pass.record(commands, layouts, parity, extent);
        });
    }
    if let (Some(pass), Some(ao)) = (&passes.ao_temporal, targets.ao) {
        let push = ao_temporal::push(&settings.ao, around.history);
        frame.pass(
            c"ao temporal",
            &ao_temporal::uses(targets, ao),
            |commands, _| {
                commands.push_constants(layouts, &push);
                pass.record(commands, layouts, parity, extent);
            },
        );
    }
    if let (Some(pass), Some(mask)) = (&passes.contact, targets.contact) {
        let push = contact::push(&settings.contact, around.diagonal);
        frame.pass(c"contact", &contact::uses(targets, mask), |commands, _| {
            commands.push_constants(layouts, &push);
            pass.record(commands, layouts, parity, extent);
        });
    }
}
