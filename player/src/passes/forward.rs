//! Opaque surfaces, then those cut by alpha, with depth.

use super::{FAR_DEPTH, SurfacePipelines, surface_pipeline};
use crate::draw::Draw;
use crate::gpu::{
    ColorAttachment, Commands, DepthAttachment, Gpu, GpuResult, ImageRef, Layouts, Load,
};
use crate::plan::Plan;

/// Behind everything where no sky is drawn.
const BACKGROUND: [f32; 4] = [0.0, 0.0, 0.0, 1.0];

/// The pass's pipelines.
pub struct Forward {
    pipelines: SurfacePipelines,
    prepass: bool,
}

impl Forward {
    /// Builds what the package needs. A prepass has cut already: nothing discards behind one.
    pub fn new(gpu: &Gpu, layouts: &Layouts, plan: &Plan) -> GpuResult<Self> {
        let cuts = plan.variant.masked && !plan.prepass;
        let build = |alpha| surface_pipeline(gpu, layouts, plan, alpha);
        Ok(Self {
            pipelines: SurfacePipelines::new(cuts, build)?,
            prepass: plan.prepass,
        })
    }

    /// Clears colour, and depth where no prepass drew it, and draws. Sets and vertex buffers are bound.
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
            load: if self.prepass {
                Load::Keep
            } else {
                Load::Clear(FAR_DEPTH)
            },
            store: true,
        };
        commands.begin_rendering(extent, &[color], Some(depth));
        self.pipelines.draw(commands, extent, opaque, masked);
        commands.end_rendering();
    }
}
