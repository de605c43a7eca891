//! Records the commands of a frame.

use std::ffi::CStr;
use std::sync::Arc;

use ash::vk;
use bytemuck::Pod;

use super::attachment::{ColorAttachment, DepthAttachment, color_info, depth_info};
use super::buffer::Buffer;
use super::descriptor::{DescriptorSet, Layouts, PUSH_CONSTANT_BYTES};
use super::device::Shared;
use super::error::{GpuError, GpuResult};
use super::image::ImageRef;
use super::pipeline::{ComputePipeline, GraphicsPipeline};
use super::query::PassTimer;
use super::queue::{Handshake, Submission};
use super::raytracing::RayPipeline;

/// Most colour attachments of a pass.
pub const MAX_COLORS: usize = 8;
/// Most barriers of one call.
pub const MAX_BARRIERS: usize = 16;

/// A command buffer in recording; dropped unsubmitted, its commands never run.
pub struct Commands {
    pub(super) shared: Arc<Shared>,
    pub(super) raw: vk::CommandBuffer,
    slot: usize,
    timer: PassTimer,
    /// Whether the current pass has a begin timestamp.
    timed: bool,
    submitted: bool,
}

/// What a submission leaves behind.
pub(super) struct Submitted {
    pub(super) submission: Submission,
    pub(super) timer: PassTimer,
}

/// One side of a barrier.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sync {
    /// Stages.
    pub stage: vk::PipelineStageFlags2,
    /// Accesses in these stages.
    pub access: vk::AccessFlags2,
}

impl Sync {
    /// Nothing to wait for, or nothing that waits.
    pub const NONE: Self = Self {
        stage: vk::PipelineStageFlags2::NONE,
        access: vk::AccessFlags2::NONE,
    };
}

/// A dependency and layout change of a whole image.
#[derive(Clone, Copy)]
pub struct ImageBarrier<'a> {
    /// Image.
    pub image: ImageRef<'a>,
    /// Layout before; `UNDEFINED` drops the content.
    pub old: vk::ImageLayout,
    /// Layout after.
    pub new: vk::ImageLayout,
    /// What must have finished.
    pub source: Sync,
    /// What waits.
    pub destination: Sync,
}

/// Where a frame ends: an image in layout `UNDEFINED`, and how its consumer wants it.
///
/// The first barrier's source stage must be `COLOR_ATTACHMENT_OUTPUT`, where the acquire semaphore is waited for.
#[derive(Clone, Copy)]
pub struct FrameTarget<'a> {
    /// Image that is written whole.
    pub image: ImageRef<'a>,
    /// Layout at the end.
    pub final_layout: vk::ImageLayout,
    /// What reads it afterwards.
    pub final_sync: Sync,
}

impl Commands {
    pub(super) fn new(
        shared: &Arc<Shared>,
        raw: vk::CommandBuffer,
        slot: usize,
        timer: PassTimer,
    ) -> Self {
        shared.open_recording();
        Self {
            shared: shared.clone(),
            raw,
            slot,
            timer,
            timed: false,
            submitted: false,
        }
    }

    /// Ends the recording and submits it.
    pub(super) fn submit(mut self, handshake: Option<&Handshake>) -> GpuResult<Submitted> {
        // SAFETY: the command buffer is recording.
        unsafe { self.shared.device.end_command_buffer(self.raw) }
            .map_err(GpuError::of("vkEndCommandBuffer"))?;
        self.submitted = true;
        let submission = self.shared.submit(self.raw, handshake)?;
        Ok(Submitted {
            submission,
            timer: self.timer,
        })
    }

    /// Which copy of per-frame buffers and sets to use: `0..FRAMES_IN_FLIGHT`.
    pub fn slot(&self) -> usize {
        self.slot
    }

    /// Begins a labelled and timed pass.
    pub fn pass_begin(&mut self, name: &'static CStr) {
        self.label_begin(name);
        let query = self.timer.begin(name);
        self.timed = query.is_some();
        self.write_timestamp(query);
    }

    /// Ends the pass.
    pub fn pass_end(&mut self) {
        if std::mem::take(&mut self.timed) {
            self.write_timestamp(self.timer.end());
        }
        self.label_end();
    }

    fn write_timestamp(&mut self, query: Option<(vk::QueryPool, u32)>) {
        let Some((pool, query)) = query else { return };
        let stage = vk::PipelineStageFlags2::ALL_COMMANDS;
        // SAFETY: the command buffer is recording, and the query was reset at its beginning.
        unsafe {
            let device = &self.shared.device;
            device.cmd_write_timestamp2(self.raw, stage, pool, query);
        }
    }

    /// Begins a label for debuggers.
    pub fn label_begin(&mut self, name: &CStr) {
        if let Some(debug) = self.shared.debug() {
            let label = vk::DebugUtilsLabelEXT::default().label_name(name);
            // SAFETY: the command buffer is recording.
            unsafe { debug.cmd_begin_debug_utils_label(self.raw, &label) };
        }
    }

    /// Ends the innermost label.
    pub fn label_end(&mut self) {
        if let Some(debug) = self.shared.debug() {
            // SAFETY: the command buffer is recording and a label is open.
            unsafe { debug.cmd_end_debug_utils_label(self.raw) };
        }
    }

    /// As [`Commands::begin_rendering`], to the part of the attachments from `[x, y]` to `[x, y]`; nothing else is
    /// cleared or drawn. Sets the scissor too.
    pub fn begin_rendering_part(
        &mut self,
        [left, top, right, bottom]: [u32; 4],
        colors: &[ColorAttachment<'_>],
        depth: Option<DepthAttachment<'_>>,
    ) {
        let part = vk::Rect2D {
            offset: vk::Offset2D {
                x: left as i32,
                y: top as i32,
            },
            ..area([right - left, bottom - top])
        };
        self.begin(part, colors, depth);
        // SAFETY: the command buffer is recording.
        unsafe { self.shared.device.cmd_set_scissor(self.raw, 0, &[part]) };
    }

    /// Begins rendering to the upper left `extent` of the attachments; [`MAX_COLORS`] at most.
    pub fn begin_rendering(
        &mut self,
        extent: [u32; 2],
        colors: &[ColorAttachment<'_>],
        depth: Option<DepthAttachment<'_>>,
    ) {
        self.begin(area(extent), colors, depth);
    }

    fn begin(
        &mut self,
        part: vk::Rect2D,
        colors: &[ColorAttachment<'_>],
        depth: Option<DepthAttachment<'_>>,
    ) {
        let mut infos = [vk::RenderingAttachmentInfo::default(); MAX_COLORS];
        for (info, color) in infos[..colors.len()].iter_mut().zip(colors) {
            *info = color_info(color);
        }
        let depth = depth.map(|depth| depth_info(&depth));
        let mut info = vk::RenderingInfo::default()
            .render_area(part)
            .layer_count(1)
            .color_attachments(&infos[..colors.len()]);
        if let Some(depth) = &depth {
            info = info.depth_attachment(depth);
        }
        // SAFETY: the command buffer is recording outside of rendering; views are alive.
        unsafe { self.shared.device.cmd_begin_rendering(self.raw, &info) };
    }

    /// Ends rendering.
    pub fn end_rendering(&mut self) {
        // SAFETY: the command buffer is recording, inside of rendering.
        unsafe { self.shared.device.cmd_end_rendering(self.raw) };
    }

    /// Sets the viewport, depth 0 to 1; `flipped` makes clip space's Y point up.
    pub fn set_viewport(&mut self, extent: [u32; 2], flipped: bool) {
        let [width, height] = extent.map(|size| size as f32);
        let viewport = vk::Viewport {
            x: 0.0,
            y: if flipped { height } else { 0.0 },
            width,
            height: if flipped { -height } else { height },
            min_depth: 0.0,
            max_depth: 1.0,
        };
        // SAFETY: the command buffer is recording.
        unsafe {
            self.shared
                .device
                .cmd_set_viewport(self.raw, 0, &[viewport])
        };
    }

    /// Sets the scissor to the upper left `extent`.
    pub fn set_scissor(&mut self, extent: [u32; 2]) {
        // SAFETY: the command buffer is recording.
        unsafe {
            self.shared
                .device
                .cmd_set_scissor(self.raw, 0, &[area(extent)])
        };
    }

    /// Sets the scissor to `[left, top, width, height]`.
    pub fn set_scissor_at(&mut self, [x, y, width, height]: [u32; 4]) {
        let scissor = vk::Rect2D {
            offset: vk::Offset2D {
                x: x as i32,
                y: y as i32,
            },
            extent: vk::Extent2D { width, height },
        };
        // SAFETY: the command buffer is recording.
        unsafe { self.shared.device.cmd_set_scissor(self.raw, 0, &[scissor]) };
    }

    /// Sets which faces are dropped.
    pub fn set_cull_mode(&mut self, mode: vk::CullModeFlags) {
        // SAFETY: the command buffer is recording.
        unsafe { self.shared.device.cmd_set_cull_mode(self.raw, mode) };
    }

    /// Sets which winding is the front.
    pub fn set_front_face(&mut self, face: vk::FrontFace) {
        // SAFETY: the command buffer is recording.
        unsafe { self.shared.device.cmd_set_front_face(self.raw, face) };
    }

    /// Sets the bias of pipelines that have one: constant in units of the format, clamp, and per slope.
    pub fn set_depth_bias(&mut self, constant: f32, clamp: f32, slope: f32) {
        // SAFETY: the command buffer is recording; `depthBiasClamp` is enabled.
        unsafe {
            let device = &self.shared.device;
            device.cmd_set_depth_bias(self.raw, constant, clamp, slope);
        }
    }

    /// Binds a graphics pipeline.
    pub fn bind_graphics(&mut self, pipeline: &GraphicsPipeline) {
        self.bind(vk::PipelineBindPoint::GRAPHICS, pipeline.raw());
    }

    /// Binds a compute pipeline.
    pub fn bind_compute(&mut self, pipeline: &ComputePipeline) {
        self.bind(vk::PipelineBindPoint::COMPUTE, pipeline.raw());
    }

    fn bind(&mut self, point: vk::PipelineBindPoint, pipeline: vk::Pipeline) {
        // SAFETY: the command buffer is recording, the pipeline is alive.
        unsafe {
            self.shared
                .device
                .cmd_bind_pipeline(self.raw, point, pipeline)
        };
    }

    /// Binds each set at its own index.
    pub fn bind_sets(
        &mut self,
        layouts: &Layouts,
        point: vk::PipelineBindPoint,
        sets: &[&DescriptorSet],
    ) {
        for set in sets {
            // SAFETY: the command buffer is recording; the set was allocated with the layout at this index.
            unsafe {
                self.shared.device.cmd_bind_descriptor_sets(
                    self.raw,
                    point,
                    layouts.pipeline(),
                    set.index() as u32,
                    &[set.raw()],
                    &[],
                );
            }
        }
    }

    /// Binds a vertex buffer from a byte offset on.
    pub fn bind_vertex_buffer(&mut self, binding: u32, buffer: &Buffer, byte_offset: u64) {
        let (buffers, offsets) = ([buffer.raw], [byte_offset]);
        // SAFETY: the command buffer is recording, the buffer is alive.
        unsafe {
            let device = &self.shared.device;
            device.cmd_bind_vertex_buffers(self.raw, binding, &buffers, &offsets);
        }
    }

    /// Binds u32 indices.
    pub fn bind_index_buffer(&mut self, buffer: &Buffer) {
        // SAFETY: the command buffer is recording, the buffer is alive.
        unsafe {
            let device = &self.shared.device;
            device.cmd_bind_index_buffer(self.raw, buffer.raw, 0, vk::IndexType::UINT32);
        }
    }

    /// Draws without indices.
    pub fn draw(&mut self, vertices: u32, instances: u32) {
        // SAFETY: the command buffer is recording, inside of rendering, with everything bound.
        unsafe {
            self.shared
                .device
                .cmd_draw(self.raw, vertices, instances, 0, 0)
        };
    }

    /// Draws with indices.
    pub fn draw_indexed(
        &mut self,
        index_count: u32,
        instance_count: u32,
        first_index: u32,
        vertex_offset: i32,
        first_instance: u32,
    ) {
        // SAFETY: the command buffer is recording, inside of rendering, with everything bound.
        unsafe {
            self.shared.device.cmd_draw_indexed(
                self.raw,
                index_count,
                instance_count,
                first_index,
                vertex_offset,
                first_instance,
            );
        }
    }

    /// Runs workgroups.
    pub fn dispatch(&mut self, groups: [u32; 3]) {
        // SAFETY: the command buffer is recording, outside of rendering, with everything bound.
        unsafe {
            let device = &self.shared.device;
            device.cmd_dispatch(self.raw, groups[0], groups[1], groups[2]);
        }
    }

    /// Binds a ray-tracing pipeline.
    pub fn bind_ray_tracing(&mut self, pipeline: &RayPipeline) {
        self.bind(vk::PipelineBindPoint::RAY_TRACING_KHR, pipeline.raw());
    }

    /// Runs a ray generation shader for each pixel of `extent`.
    pub fn trace_rays(&mut self, pipeline: &RayPipeline, extent: [u32; 2]) {
        let [raygen, miss, hit] = pipeline.regions();
        let none = vk::StridedDeviceAddressRegionKHR::default();
        // SAFETY: the command buffer is recording, outside of rendering, with everything bound; the table is alive.
        unsafe {
            self.shared
                .ray_tracing()
                .pipelines
                .cmd_trace_rays(self.raw, raygen, miss, hit, &none, extent[0], extent[1], 1);
        }
    }

    /// Fills a buffer with zeros.
    pub fn clear_buffer(&mut self, buffer: &Buffer) {
        // SAFETY: the command buffer is recording outside of rendering; the buffer is alive.
        unsafe {
            let device = &self.shared.device;
            device.cmd_fill_buffer(self.raw, buffer.raw, 0, vk::WHOLE_SIZE, 0);
        }
    }

    /// Sets the push constants of all stages, from offset 0.
    ///
    /// # Panics
    /// Where they are larger than the layout's range.
    pub fn push_constants<T: Pod>(&mut self, layouts: &Layouts, value: &T) {
        let bytes = bytemuck::bytes_of(value);
        assert!(bytes.len() <= PUSH_CONSTANT_BYTES as usize && bytes.len().is_multiple_of(4));
        // SAFETY: the command buffer is recording; the range is inside that of the layout.
        unsafe {
            self.shared.device.cmd_push_constants(
                self.raw,
                layouts.pipeline(),
                layouts.stages(),
                0,
                bytes,
            );
        }
    }

    /// Orders accesses to images and changes their layouts; [`MAX_BARRIERS`] at most.
    pub fn image_barriers(&mut self, barriers: &[ImageBarrier<'_>]) {
        let mut infos = [vk::ImageMemoryBarrier2::default(); MAX_BARRIERS];
        for (info, barrier) in infos[..barriers.len()].iter_mut().zip(barriers) {
            *info = barrier_info(barrier);
        }
        let infos = &infos[..barriers.len()];
        if infos.is_empty() {
            return;
        }
        let info = vk::DependencyInfo::default().image_memory_barriers(infos);
        // SAFETY: the command buffer is recording outside of rendering; images are alive.
        unsafe { self.shared.device.cmd_pipeline_barrier2(self.raw, &info) };
    }

    /// Orders accesses to all memory.
    pub fn memory_barrier(&mut self, source: Sync, destination: Sync) {
        let barriers = [vk::MemoryBarrier2::default()
            .src_stage_mask(source.stage)
            .src_access_mask(source.access)
            .dst_stage_mask(destination.stage)
            .dst_access_mask(destination.access)];
        let info = vk::DependencyInfo::default().memory_barriers(&barriers);
        // SAFETY: the command buffer is recording outside of rendering.
        unsafe { self.shared.device.cmd_pipeline_barrier2(self.raw, &info) };
    }

    /// Copies bytes between buffers.
    pub fn copy_buffer(
        &mut self,
        source: &Buffer,
        source_offset: u64,
        destination: &Buffer,
        destination_offset: u64,
        size: u64,
    ) {
        let regions = [vk::BufferCopy {
            src_offset: source_offset,
            dst_offset: destination_offset,
            size,
        }];
        // SAFETY: the command buffer is recording outside of rendering; buffers are alive.
        unsafe {
            let device = &self.shared.device;
            device.cmd_copy_buffer(self.raw, source.raw, destination.raw, &regions);
        }
    }

    /// Copies blocks of one level from a buffer, tightly packed, to an image in `TRANSFER_DST_OPTIMAL`.
    pub(super) fn copy_buffer_to_image(
        &mut self,
        buffer: &Buffer,
        image: ImageRef<'_>,
        region: &vk::BufferImageCopy,
    ) {
        let layout = vk::ImageLayout::TRANSFER_DST_OPTIMAL;
        let regions = [*region];
        // SAFETY: the command buffer is recording outside of rendering; buffer and image are alive.
        unsafe {
            let device = &self.shared.device;
            device.cmd_copy_buffer_to_image(self.raw, buffer.raw, image.raw, layout, &regions);
        }
    }

    /// Copies a level of a layer, tightly packed, from an image in `TRANSFER_SRC_OPTIMAL`. The host may read the
    /// buffer once the submission has finished.
    pub fn copy_image_to_buffer(
        &mut self,
        image: ImageRef<'_>,
        level: u32,
        layer: u32,
        buffer: &Buffer,
        byte_offset: u64,
    ) {
        let size = |axis: usize| cairn_format::texture::mip_extent(image.extent()[axis], level);
        let regions = [vk::BufferImageCopy::default()
            .buffer_offset(byte_offset)
            .image_subresource(vk::ImageSubresourceLayers {
                aspect_mask: image.aspect(),
                mip_level: level,
                base_array_layer: layer,
                layer_count: 1,
            })
            .image_extent(vk::Extent3D {
                width: size(0),
                height: size(1),
                depth: 1,
            })];
        let layout = vk::ImageLayout::TRANSFER_SRC_OPTIMAL;
        // SAFETY: the command buffer is recording outside of rendering; image and buffer are alive.
        unsafe {
            let device = &self.shared.device;
            device.cmd_copy_image_to_buffer(self.raw, image.raw, layout, buffer.raw, &regions);
        }
        self.memory_barrier(
            Sync {
                stage: vk::PipelineStageFlags2::COPY,
                access: vk::AccessFlags2::TRANSFER_WRITE,
            },
            Sync {
                stage: vk::PipelineStageFlags2::HOST,
                access: vk::AccessFlags2::HOST_READ,
            },
        );
    }
}

impl Drop for Commands {
    fn drop(&mut self) {
        if !self.submitted {
            self.shared.abandon_recording();
        }
    }
}

fn area(extent: [u32; 2]) -> vk::Rect2D {
    vk::Rect2D {
        offset: vk::Offset2D::default(),
        extent: vk::Extent2D {
            width: extent[0],
            height: extent[1],
        },
    }
}

fn barrier_info(barrier: &ImageBarrier<'_>) -> vk::ImageMemoryBarrier2<'static> {
    vk::ImageMemoryBarrier2::default()
        .image(barrier.image.raw)
        .subresource_range(barrier.image.whole())
        .old_layout(barrier.old)
        .new_layout(barrier.new)
        .src_stage_mask(barrier.source.stage)
        .src_access_mask(barrier.source.access)
        .dst_stage_mask(barrier.destination.stage)
        .dst_access_mask(barrier.destination.access)
        .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
        .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
}
