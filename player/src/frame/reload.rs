//! New pipelines for a renderer that keeps its targets.

use super::Renderer;
use crate::PlayerError;
use crate::passes::Passes;

impl Renderer {
    /// Compiles every pipeline anew; where one fails, all stay as they are.
    ///
    /// # Errors
    /// Failures of Vulkan.
    pub fn rebuild_pipelines(&mut self) -> Result<(), PlayerError> {
        let (gpu, layouts, format) = (&self.gpu, &self.layouts, self.target_format);
        let passes = Passes::new(gpu, layouts, &self.graph, &self.targets, &self.plan, format)?;
        if let Some(tracer) = &mut self.tracer {
            tracer.rebuild_pipelines(format)?;
        }
        self.passes = passes;
        // What the old shaders drew into the shadow map is drawn again.
        self.shadow.forget();
        Ok(())
    }
}
