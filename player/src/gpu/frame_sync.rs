//! Frames in flight: command memory that is reused once the GPU has finished with it.

use std::sync::Arc;

use ash::vk;

use super::command::Commands;
use super::device::{Gpu, Shared};
use super::error::{GpuError, GpuResult};
use super::query::{MAX_PASSES, PassTime, PassTimer, QueryPool};
use super::queue::{Garbage, Handshake, Submission};

/// Frames that the CPU may be ahead of the GPU.
pub const FRAMES_IN_FLIGHT: usize = 2;

/// A command pool with one command buffer.
pub(super) struct CommandMemory {
    shared: Arc<Shared>,
    pool: vk::CommandPool,
    buffer: vk::CommandBuffer,
}

impl CommandMemory {
    pub(super) fn new(shared: &Arc<Shared>) -> GpuResult<Self> {
        let info = vk::CommandPoolCreateInfo::default()
            .flags(vk::CommandPoolCreateFlags::TRANSIENT)
            .queue_family_index(shared.queue_family);
        // SAFETY: the device is alive and has this queue family.
        let pool = unsafe { shared.device.create_command_pool(&info, None) }
            .map_err(GpuError::of("vkCreateCommandPool"))?;
        let mut memory = Self {
            shared: shared.clone(),
            pool,
            buffer: vk::CommandBuffer::null(),
        };
        let info = vk::CommandBufferAllocateInfo::default()
            .command_pool(pool)
            .level(vk::CommandBufferLevel::PRIMARY)
            .command_buffer_count(1);
        // SAFETY: the pool is alive.
        let buffers = unsafe { shared.device.allocate_command_buffers(&info) }
            .map_err(GpuError::of("vkAllocateCommandBuffers"))?;
        memory.buffer = buffers.first().copied().unwrap_or_default();
        Ok(memory)
    }

    /// Begins to record; the commands recorded before must have finished.
    pub(super) fn begin(&self, slot: usize, queries: Option<&QueryPool>) -> GpuResult<Commands> {
        let device = &self.shared.device;
        let info = vk::CommandBufferBeginInfo::default()
            .flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: nothing recorded from this pool is pending.
        unsafe {
            device
                .reset_command_pool(self.pool, vk::CommandPoolResetFlags::empty())
                .map_err(GpuError::of("vkResetCommandPool"))?;
            device
                .begin_command_buffer(self.buffer, &info)
                .map_err(GpuError::of("vkBeginCommandBuffer"))?;
        }
        let timer = queries.map_or(PassTimer::NONE, |queries| queries.start(self.buffer));
        Ok(Commands::new(&self.shared, self.buffer, slot, timer))
    }
}

impl Drop for CommandMemory {
    fn drop(&mut self) {
        self.shared.discard(Garbage::CommandPool(self.pool));
    }
}

/// One frame in flight.
struct Slot {
    commands: CommandMemory,
    queries: Option<QueryPool>,
    /// The last submission, and its passes where they were not read yet.
    submission: Option<Submission>,
    timer: Option<PassTimer>,
}

/// A ring of frames.
pub struct Frames {
    shared: Arc<Shared>,
    slots: [Slot; FRAMES_IN_FLIGHT],
    /// Slot of the next frame.
    next: usize,
    timings: Vec<PassTime>,
}

impl Frames {
    /// A ring with nothing in flight.
    pub fn new(gpu: &Gpu) -> GpuResult<Self> {
        let slot = || -> GpuResult<Slot> {
            Ok(Slot {
                commands: CommandMemory::new(&gpu.shared)?,
                queries: QueryPool::new(&gpu.shared)?,
                submission: None,
                timer: None,
            })
        };
        Ok(Self {
            shared: gpu.shared.clone(),
            slots: [slot()?, slot()?],
            next: 0,
            timings: Vec::with_capacity(MAX_PASSES),
        })
    }

    /// Waits for the frame that used this slot before, reads its times, and begins to record.
    pub fn begin(&mut self) -> GpuResult<Commands> {
        self.finish(self.next)?;
        self.shared.collect()?;
        let slot = &self.slots[self.next];
        slot.commands.begin(self.next, slot.queries.as_ref())
    }

    /// Submits a frame that is not presented.
    pub fn submit(&mut self, commands: Commands) -> GpuResult<Submission> {
        self.submit_with(commands, None)
    }

    pub(super) fn submit_with(
        &mut self,
        commands: Commands,
        handshake: Option<&Handshake>,
    ) -> GpuResult<Submission> {
        let index = commands.slot();
        let submitted = commands.submit(handshake)?;
        let slot = &mut self.slots[index];
        slot.submission = Some(submitted.submission);
        slot.timer = Some(submitted.timer);
        self.next = (index + 1) % FRAMES_IN_FLIGHT;
        Ok(submitted.submission)
    }

    /// Waits for the newest submitted frame and reads its times.
    pub fn collect(&mut self) -> GpuResult<()> {
        let newest = (self.next + FRAMES_IN_FLIGHT - 1) % FRAMES_IN_FLIGHT;
        self.finish(newest)
    }

    /// Times of the last frame that was read, in pass order; empty where the queue has no timestamps.
    pub fn timings(&self) -> &[PassTime] {
        &self.timings
    }

    fn finish(&mut self, index: usize) -> GpuResult<()> {
        let slot = &mut self.slots[index];
        if let Some(submission) = slot.submission {
            self.shared.wait(submission)?;
        }
        if let (Some(timer), Some(queries)) = (slot.timer.take(), &slot.queries) {
            queries.read(&timer, &mut self.timings)?;
        }
        Ok(())
    }
}
