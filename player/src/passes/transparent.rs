//! Blended surfaces over everything else, back to front.

use super::{Alpha, cover, front_face, issue, surface_pipeline};
use crate::draw::Draw;
use crate::gpu::{
    ColorAttachment, Commands, DepthAttachment, Gpu, GpuResult, GraphicsPipeline, ImageRef,
    Layouts, Load, vk,
};
use crate::plan::Plan;

/// The pass's pipeline.
pub struct Transparent {
    pipeline: GraphicsPipeline,
}

impl Transparent {
    /// Builds the pipeline.
    pub fn new(gpu: &Gpu, layouts: &Layouts, plan: &Plan) -> GpuResult<Self> {
        Ok(Self {
            pipeline: surface_pipeline(gpu, layouts, plan, Alpha::Blended)?,
        })
    }

    /// Draws in the list's order, over what the target holds or on an empty layer. A double-sided surface is drawn twice, far faces first, so that a closed
    /// shape's inside lies behind its outside.
    pub fn record(
        &self,
        commands: &mut Commands,
        hdr: ImageRef<'_>,
        depth: ImageRef<'_>,
        load: Load<[f32; 4]>,
        draws: &[Draw],
    ) {
        let extent = hdr.extent();
        let color = ColorAttachment {
            image: hdr,
            load,
            store: true,
        };
        let depth = DepthAttachment {
            image: depth,
            load: Load::Keep,
            store: false,
        };
        commands.begin_rendering(extent, &[color], Some(depth));
        commands.bind_graphics(&self.pipeline);
        cover(commands, extent, true);
        for draw in draws {
            commands.set_front_face(front_face(draw));
            if draw.double_sided {
                commands.set_cull_mode(vk::CullModeFlags::FRONT);
                issue(commands, draw);
            }
            commands.set_cull_mode(vk::CullModeFlags::BACK);
            issue(commands, draw);
        }
        commands.end_rendering();
    }
}
