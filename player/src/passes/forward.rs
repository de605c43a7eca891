//! Opaque surfaces, then those cut by alpha, with depth.

use super::{Alpha, Variant, cover, front_face, issue, surface_pipeline};
use crate::draw::Draw;
use crate::gpu::{
    ColorAttachment, Commands, DepthAttachment, Gpu, GpuResult, GraphicsPipeline, ImageRef,
    Layouts, Load, vk,
};

/// Behind everything where no sky is drawn.
const BACKGROUND: [f32; 4] = [0.0, 0.0, 0.0, 1.0];
/// Infinity in reverse-Z.
const FAR_DEPTH: f32 = 0.0;

/// The pass's pipelines.
pub struct Forward {
    opaque: GraphicsPipeline,
    masked: Option<GraphicsPipeline>,
}

impl Forward {
    /// Builds what the package needs: without masked groups there is no pipeline that discards.
    pub fn new(gpu: &Gpu, layouts: &Layouts, variant: &Variant) -> GpuResult<Self> {
        let masked = variant
            .masked
            .then(|| surface_pipeline(gpu, layouts, variant, Alpha::Cut));
        Ok(Self {
            opaque: surface_pipeline(gpu, layouts, variant, Alpha::Ignored)?,
            masked: masked.transpose()?,
        })
    }

    /// Clears both targets and draws. Sets and vertex buffers are bound.
    pub fn record(
        &self,
        commands: &mut Commands,
        hdr: ImageRef<'_>,
        depth: ImageRef<'_>,
        opaque: &[Draw],
        masked: &[Draw],
    ) {
        let extent = hdr.extent();
        let color = ColorAttachment {
            image: hdr,
            load: Load::Clear(BACKGROUND),
            store: true,
        };
        let depth = DepthAttachment {
            image: depth,
            load: Load::Clear(FAR_DEPTH),
            store: true,
        };
        commands.begin_rendering(extent, &[color], Some(depth));
        bucket(commands, extent, &self.opaque, opaque);
        if let Some(pipeline) = &self.masked {
            bucket(commands, extent, pipeline, masked);
        }
        commands.end_rendering();
    }
}

/// Draws in the package's order, changing state only where it differs from the draw before.
fn bucket(commands: &mut Commands, extent: [u32; 2], pipeline: &GraphicsPipeline, draws: &[Draw]) {
    let mut last = None;
    for draw in draws {
        if last.is_none() {
            commands.bind_graphics(pipeline);
            cover(commands, extent, true);
        }
        let state = (draw.double_sided, draw.mirrored);
        if last != Some(state) {
            commands.set_cull_mode(if draw.double_sided {
                vk::CullModeFlags::NONE
            } else {
                vk::CullModeFlags::BACK
            });
            commands.set_front_face(front_face(draw));
            last = Some(state);
        }
        issue(commands, draw);
    }
}
