//! Opaque surfaces, then those cut by alpha, with depth.

use super::{Alpha, FAR_DEPTH, bucket, surface_pipeline};
use crate::draw::Draw;
use crate::gpu::{
    ColorAttachment, Commands, DepthAttachment, Gpu, GpuResult, GraphicsPipeline, ImageRef,
    Layouts, Load,
};
use crate::plan::Plan;

/// Behind everything where no sky is drawn.
const BACKGROUND: [f32; 4] = [0.0, 0.0, 0.0, 1.0];

/// The pass's pipelines.
pub struct Forward {
    opaque: GraphicsPipeline,
    /// Absent behind a prepass too, which has cut already.
    masked: Option<GraphicsPipeline>,
    prepass: bool,
}

impl Forward {
    /// Builds what the package needs: without masked groups there is no pipeline that discards.
    pub fn new(gpu: &Gpu, layouts: &Layouts, plan: &Plan) -> GpuResult<Self> {
        let cuts = plan.variant.masked && !plan.prepass;
        let masked = cuts.then(|| surface_pipeline(gpu, layouts, plan, Alpha::Cut));
        Ok(Self {
            opaque: surface_pipeline(gpu, layouts, plan, Alpha::Ignored)?,
            masked: masked.transpose()?,
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
        bucket(commands, extent, &self.opaque, opaque);
        let pipeline = self.masked.as_ref().unwrap_or(&self.opaque);
        bucket(commands, extent, pipeline, masked);
        commands.end_rendering();
    }
}
