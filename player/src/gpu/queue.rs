//! The queue's timeline: what was submitted, what has finished, and which objects may now be destroyed.

use ash::vk;
use gpu_allocator::vulkan::Allocation;

use super::descriptor::SET_COUNT;
use super::device::Shared;
use super::error::{GpuError, GpuResult};

/// A point of the queue's timeline: everything submitted up to it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Submission(pub(super) u64);

/// A dropped object.
pub(super) enum Garbage {
    Buffer(vk::Buffer, Allocation),
    Image(vk::Image, vk::ImageView, Allocation),
    View(vk::ImageView),
    Sampler(vk::Sampler),
    DescriptorPool(vk::DescriptorPool),
    Layouts(vk::PipelineLayout, [vk::DescriptorSetLayout; SET_COUNT]),
    Structure(vk::AccelerationStructureKHR),
    Pipeline(vk::Pipeline),
    CommandPool(vk::CommandPool),
    QueryPool(vk::QueryPool),
}

/// Objects wait here for the submissions that may use them.
#[derive(Default)]
pub(super) struct Timeline {
    /// Value that the last submission signals.
    submitted: u64,
    /// Recordings begun and neither submitted nor dropped: they may use any object dropped meanwhile.
    open: u32,
    /// Object and the value after which it is unused; `u64::MAX` while a recording is open.
    garbage: Vec<(u64, Garbage)>,
}

impl Timeline {
    fn discard(&mut self, object: Garbage) {
        let after = if self.open == 0 {
            self.submitted
        } else {
            u64::MAX
        };
        self.garbage.push((after, object));
    }

    fn close_recording(&mut self) {
        self.open -= 1;
        if self.open == 0 {
            for (after, _) in &mut self.garbage {
                *after = (*after).min(self.submitted);
            }
        }
    }

    /// Removes one object that is unused once `completed` is reached.
    fn take_unused(&mut self, completed: u64) -> Option<Garbage> {
        let index = self
            .garbage
            .iter()
            .position(|(after, _)| *after <= completed)?;
        // In order: what lies in a buffer goes before the buffer.
        Some(self.garbage.remove(index).1)
    }
}

/// Binary semaphores around a submission that presents.
pub(super) struct Handshake {
    /// Signalled when the swapchain's image may be written.
    pub(super) acquired: vk::Semaphore,
    /// Signalled when the frame is finished.
    pub(super) finished: vk::Semaphore,
}

impl Shared {
    /// Destroys `object` once nothing can use it.
    pub(super) fn discard(&self, object: Garbage) {
        self.timeline().discard(object);
    }

    /// Counts a recording that begins.
    pub(super) fn open_recording(&self) {
        self.timeline().open += 1;
    }

    /// Counts a recording that was dropped without being submitted.
    pub(super) fn abandon_recording(&self) {
        self.timeline().close_recording();
    }

    /// Submits an ended command buffer whose recording was counted.
    pub(super) fn submit(
        &self,
        commands: vk::CommandBuffer,
        handshake: Option<&Handshake>,
    ) -> GpuResult<Submission> {
        let mut timeline = self.timeline();
        let value = timeline.submitted + 1;
        let commands = [vk::CommandBufferSubmitInfo::default().command_buffer(commands)];
        let semaphore = |semaphore, stage| {
            vk::SemaphoreSubmitInfo::default()
                .semaphore(semaphore)
                .stage_mask(stage)
        };
        let all = vk::PipelineStageFlags2::ALL_COMMANDS;
        let output = vk::PipelineStageFlags2::COLOR_ATTACHMENT_OUTPUT;
        let finished = handshake.map_or(vk::Semaphore::null(), |handshake| handshake.finished);
        let acquired = handshake.map_or(vk::Semaphore::null(), |handshake| handshake.acquired);
        let signals = [
            semaphore(self.semaphore, all).value(value),
            semaphore(finished, all),
        ];
        let waits = [semaphore(acquired, output)];
        let count = usize::from(handshake.is_some());
        let info = vk::SubmitInfo2::default()
            .command_buffer_infos(&commands)
            .wait_semaphore_infos(&waits[..count])
            .signal_semaphore_infos(&signals[..1 + count]);
        // SAFETY: the lock keeps other threads off the queue; the command buffer is ended and belongs to this
        // device; semaphores are alive.
        let result = unsafe {
            self.device
                .queue_submit2(self.queue, &[info], vk::Fence::null())
        };
        if result.is_ok() {
            timeline.submitted = value;
        }
        timeline.close_recording();
        result.map_err(GpuError::of("vkQueueSubmit2"))?;
        Ok(Submission(value))
    }

    /// Blocks until a submission has finished.
    pub(super) fn wait(&self, submission: Submission) -> GpuResult<()> {
        let (semaphores, values) = ([self.semaphore], [submission.0]);
        let info = vk::SemaphoreWaitInfo::default()
            .semaphores(&semaphores)
            .values(&values);
        // SAFETY: the semaphore is a timeline semaphore of this device.
        unsafe { self.device.wait_semaphores(&info, u64::MAX) }
            .map_err(GpuError::of("vkWaitSemaphores"))
    }

    /// Blocks until the queue is empty, then destroys what was dropped.
    pub(super) fn wait_idle(&self) -> GpuResult<()> {
        {
            let _queue = self.timeline();
            // SAFETY: the lock keeps other threads off the queue.
            unsafe { self.device.device_wait_idle() }.map_err(GpuError::of("vkDeviceWaitIdle"))?;
        }
        self.collect()
    }

    /// Destroys dropped objects that no submission uses any more.
    pub(super) fn collect(&self) -> GpuResult<()> {
        // SAFETY: the semaphore is a timeline semaphore of this device.
        let completed = unsafe { self.device.get_semaphore_counter_value(self.semaphore) }
            .map_err(GpuError::of("vkGetSemaphoreCounterValue"))?;
        self.destroy_until(completed);
        Ok(())
    }

    /// Destroys everything dropped, used or not; only once the device is idle or lost.
    pub(super) fn destroy_all(&self) {
        self.destroy_until(u64::MAX);
    }

    fn destroy_until(&self, completed: u64) {
        loop {
            let unused = self.timeline().take_unused(completed);
            match unused {
                Some(object) => self.destroy(object),
                None => return,
            }
        }
    }

    fn destroy(&self, object: Garbage) {
        let device = &self.device;
        // SAFETY: the object belongs to this device, its owner is gone, and all submissions that could use it
        // have finished.
        unsafe {
            match object {
                Garbage::Buffer(buffer, allocation) => {
                    device.destroy_buffer(buffer, None);
                    self.free(allocation);
                }
                Garbage::Image(image, view, allocation) => {
                    device.destroy_image_view(view, None);
                    device.destroy_image(image, None);
                    self.free(allocation);
                }
                Garbage::View(view) => device.destroy_image_view(view, None),
                Garbage::Sampler(sampler) => device.destroy_sampler(sampler, None),
                Garbage::DescriptorPool(pool) => device.destroy_descriptor_pool(pool, None),
                Garbage::Layouts(pipeline, sets) => {
                    device.destroy_pipeline_layout(pipeline, None);
                    for set in sets {
                        device.destroy_descriptor_set_layout(set, None);
                    }
                }
                Garbage::Structure(structure) => self
                    .ray_tracing()
                    .structures
                    .destroy_acceleration_structure(structure, None),
                Garbage::Pipeline(pipeline) => device.destroy_pipeline(pipeline, None),
                Garbage::CommandPool(pool) => device.destroy_command_pool(pool, None),
                Garbage::QueryPool(pool) => device.destroy_query_pool(pool, None),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sampler() -> Garbage {
        Garbage::Sampler(vk::Sampler::null())
    }

    #[test]
    fn an_object_waits_for_the_submissions_before_it() {
        let mut timeline = Timeline {
            submitted: 3,
            ..Timeline::default()
        };
        timeline.discard(sampler());
        assert!(timeline.take_unused(2).is_none());
        assert!(timeline.take_unused(3).is_some());
        assert!(timeline.take_unused(3).is_none());
    }

    #[test]
    fn an_object_dropped_while_recording_waits_for_the_recording() {
        let mut timeline = Timeline {
            submitted: 3,
            open: 2,
            ..Timeline::default()
        };
        timeline.discard(sampler());
        timeline.submitted = 4;
        timeline.close_recording();
        assert!(
            timeline.take_unused(4).is_none(),
            "one recording is still open"
        );
        timeline.submitted = 5;
        timeline.close_recording();
        assert!(timeline.take_unused(4).is_none());
        assert!(timeline.take_unused(5).is_some());
    }
}
