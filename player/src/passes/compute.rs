//! A compute pass over every pixel: its pipeline, and set 3 for even and for odd frames, because pairs of images
//! take turns.

use crate::gpu::{
    Commands, ComputePipeline, DescriptorSet, Gpu, GpuResult, Layouts, SetIndex, Shader, vk,
};

/// Invocations of a workgroup along each side.
const GROUP: u32 = 8;

/// A pipeline of 8x8 workgroups with its sets.
pub struct ComputePass {
    name: &'static str,
    pipeline: ComputePipeline,
    sets: [DescriptorSet; 2],
}

impl ComputePass {
    /// Compiles the pipeline; `write` fills set 3 for frames of the given parity.
    ///
    /// # Errors
    /// Failures of Vulkan.
    pub fn new(
        gpu: &Gpu,
        layouts: &Layouts,
        name: &'static str,
        shader: &Shader<'_>,
        write: impl FnMut(&mut DescriptorSet, usize),
    ) -> GpuResult<Self> {
        Ok(Self {
            name,
            pipeline: ComputePipeline::new(gpu, layouts, name, shader)?,
            sets: sets(layouts, name, write)?,
        })
    }

    /// Makes the sets anew, after images were replaced.
    ///
    /// # Errors
    /// Failures of Vulkan.
    pub fn rebind(
        &mut self,
        layouts: &Layouts,
        write: impl FnMut(&mut DescriptorSet, usize),
    ) -> GpuResult<()> {
        self.sets = sets(layouts, self.name, write)?;
        Ok(())
    }

    /// Runs once per pixel of `extent`. Sets 0 to 2 are bound, push constants set.
    pub fn record(
        &self,
        commands: &mut Commands,
        layouts: &Layouts,
        parity: usize,
        extent: [u32; 2],
    ) {
        commands.bind_compute(&self.pipeline);
        let point = vk::PipelineBindPoint::COMPUTE;
        commands.bind_sets(layouts, point, &[&self.sets[parity % 2]]);
        commands.dispatch([extent[0].div_ceil(GROUP), extent[1].div_ceil(GROUP), 1]);
    }
}

fn sets(
    layouts: &Layouts,
    name: &str,
    mut write: impl FnMut(&mut DescriptorSet, usize),
) -> GpuResult<[DescriptorSet; 2]> {
    let mut set = |parity| -> GpuResult<DescriptorSet> {
        let mut set = layouts.allocate(SetIndex::Pass, name)?;
        write(&mut set, parity);
        Ok(set)
    };
    Ok([set(0)?, set(1)?])
}
