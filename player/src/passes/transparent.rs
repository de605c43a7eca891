//! Blended surfaces over everything else, back to front.

use super::{Alpha, front_face, issue, surface_pipeline};
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

    /// Draws in the list's order, inside of `part` (left, top, right, bottom), over what the
    /// target holds or on an empty layer. A double-sided surface is drawn twice, far faces first, so that a closed
    /// shape's inside lies behind its outside.
    pub fn record(
        &self,
        commands: &mut Commands,
        hdr: ImageRef<'_>,
        depth: ImageRef<'_>,
        load: Load<[f32; 4]>,
        part: [u32; 4],
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
            store: true,
        };
        commands.begin_rendering_part(part, &[color], Some(depth));
        commands.bind_graphics(&self.pipeline);
        commands.set_viewport(extent, true);
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
