//! Uploads through a staging ring of fixed size: the GPU copies one slot while the CPU fills the other.

use std::time::Instant;

use ash::vk;
use cairn_format::TextureFormat;
use cairn_format::texture::mip_extent;

use super::buffer::{Buffer, BufferDesc, Memory};
use super::command::{Commands, ImageBarrier, Sync};
use super::device::Gpu;
use super::error::{GpuError, GpuResult};
use super::frame_sync::{FRAMES_IN_FLIGHT, Frames};
use super::image::Image;
use super::queue::Submission;

/// Bytes of one slot; the ring has [`FRAMES_IN_FLIGHT`].
pub const SLOT_BYTES: u64 = 16 << 20;
/// Alignment of everything in a slot: a whole texel block of every format, and every record.
const ALIGNMENT: u64 = 16;
/// Bytes copied before they are checked: they are still in the CPU's cache then.
const WINDOW: usize = 128 << 10;

const COPY_WRITE: Sync = Sync {
    stage: vk::PipelineStageFlags2::COPY,
    access: vk::AccessFlags2::TRANSFER_WRITE,
};
const ANY_READ: Sync = Sync {
    stage: vk::PipelineStageFlags2::ALL_COMMANDS,
    access: vk::AccessFlags2::MEMORY_READ,
};

/// What an upload cost.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct UploadStats {
    /// Bytes copied.
    pub bytes: u64,
    /// Submissions made.
    pub submissions: u32,
    /// From the first byte to the last copy's end.
    pub seconds: f64,
}

/// An upload in progress.
pub struct Uploader {
    gpu: Gpu,
    frames: Frames,
    slots: [Buffer; FRAMES_IN_FLIGHT],
    /// The slot being filled.
    open: Option<Commands>,
    /// First free byte of it.
    cursor: u64,
    last: Option<Submission>,
    stats: UploadStats,
    begin: Instant,
}

impl Uploader {
    /// A ring of slots of [`SLOT_BYTES`].
    pub fn new(gpu: &Gpu) -> GpuResult<Self> {
        Self::with_slot_bytes(gpu, SLOT_BYTES)
    }

    /// A ring of smaller or larger slots.
    pub fn with_slot_bytes(gpu: &Gpu, slot_bytes: u64) -> GpuResult<Self> {
        let slot = || {
            Buffer::new(
                gpu,
                &BufferDesc {
                    name: "staging",
                    size: slot_bytes,
                    usage: vk::BufferUsageFlags::TRANSFER_SRC,
                    // Cached memory: the bytes are checked where the GPU will read them, not in the file, which
                    // may change meanwhile.
                    memory: Memory::Readback,
                },
            )
        };
        Ok(Self {
            gpu: gpu.clone(),
            frames: Frames::new(gpu)?,
            slots: [slot()?, slot()?],
            open: None,
            cursor: 0,
            last: None,
            stats: UploadStats::default(),
            begin: Instant::now(),
        })
    }

    /// Copies `bytes`, which are whole records of `record` bytes, to `buffer` from its beginning. `check` sees
    /// every record once, in order, in runs of whole records, with the byte offset of the run.
    ///
    /// # Errors
    /// Those of `check` and of Vulkan; a record larger than a slot is a `Limit`.
    pub fn upload_buffer<E: From<GpuError>>(
        &mut self,
        buffer: &Buffer,
        bytes: &[u8],
        record: usize,
        mut check: impl FnMut(&[u8], u64) -> Result<(), E>,
    ) -> Result<(), E> {
        let mut done = 0;
        while done < bytes.len() {
            let (slot, room) = self.room(record as u64, "a record")?;
            let take = (room as usize / record * record).min(bytes.len() - done);
            let source = &bytes[done..done + take];
            self.fill_checked(slot, source, done as u64, record, &mut check)?;
            let (cursor, staging) = (self.cursor, &self.slots[slot]);
            if let Some(commands) = &mut self.open {
                commands.copy_buffer(staging, cursor, buffer, done as u64, take as u64);
            }
            self.advance(take as u64);
            done += take;
        }
        Ok(())
    }

    fn fill_checked<E: From<GpuError>>(
        &mut self,
        slot: usize,
        source: &[u8],
        offset: u64,
        record: usize,
        check: &mut impl FnMut(&[u8], u64) -> Result<(), E>,
    ) -> Result<(), E> {
        let start = self.cursor as usize;
        let mapped = &mut self.slots[slot].mapped_mut()?[start..][..source.len()];
        let window = (WINDOW / record).max(1) * record;
        let runs = mapped.chunks_mut(window).zip(source.chunks(window));
        for (index, (to, from)) in runs.enumerate() {
            to.copy_from_slice(from);
            check(to, offset + (index * window) as u64)?;
        }
        Ok(())
    }

    /// Copies all levels of an image, each holding all layers one behind the other, and leaves the image in
    /// `SHADER_READ_ONLY_OPTIMAL`.
    ///
    /// # Panics
    /// Where a level's length is not that of its extent.
    ///
    /// # Errors
    /// Those of Vulkan; a row of blocks larger than a slot is a `Limit`.
    pub fn upload_image<'a>(
        &mut self,
        image: &Image,
        format: TextureFormat,
        levels: impl IntoIterator<Item = &'a [u8]>,
    ) -> GpuResult<()> {
        let copy = |stored: &[u8], staged: &mut [u8], _| {
            staged.copy_from_slice(stored);
            Ok(())
        };
        self.convert_image(image, [format; 2], levels, copy)
    }

    /// As [`Uploader::upload_image`], from blocks of one format to another: `convert` turns whole rows of stored
    /// blocks into the staged texels of that many rows, in the staging memory itself. `formats` are the stored one
    /// and one of the layout of the image's.
    ///
    /// # Panics
    /// Where a level's length is not that of its extent.
    ///
    /// # Errors
    /// Those of `convert` and of Vulkan; a row of blocks larger than a slot is a `Limit`.
    pub fn convert_image<'a, E: From<GpuError>>(
        &mut self,
        image: &Image,
        formats: [TextureFormat; 2],
        levels: impl IntoIterator<Item = &'a [u8]>,
        mut convert: impl FnMut(&[u8], &mut [u8], [u32; 2]) -> Result<(), E>,
    ) -> Result<(), E> {
        self.room(1, "nothing")?;
        let all = ImageBarrier {
            image: image.view(),
            old: vk::ImageLayout::UNDEFINED,
            new: vk::ImageLayout::TRANSFER_DST_OPTIMAL,
            source: Sync::NONE,
            destination: COPY_WRITE,
        };
        self.barrier(all);
        for (level, bytes) in (0..).zip(levels) {
            self.upload_level(image, formats, level, bytes, &mut convert)?;
        }
        self.room(1, "nothing")?;
        self.barrier(ImageBarrier {
            old: vk::ImageLayout::TRANSFER_DST_OPTIMAL,
            new: vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL,
            source: COPY_WRITE,
            destination: ANY_READ,
            ..all
        });
        Ok(())
    }

    /// Copies whole rows of blocks, as many as fit into the slot, layer by layer.
    fn upload_level<E: From<GpuError>>(
        &mut self,
        image: &Image,
        [stored, staged]: [TextureFormat; 2],
        level: u32,
        bytes: &[u8],
        convert: &mut impl FnMut(&[u8], &mut [u8], [u32; 2]) -> Result<(), E>,
    ) -> Result<(), E> {
        let [width, height] = image.extent().map(|size| mip_extent(size, level));
        // Texel rows that are converted together.
        let block = stored.block_extent().max(staged.block_extent());
        let stored_row = stored.level_bytes(width, block);
        let staged_row = staged.level_bytes(width, block);
        let rows = height.div_ceil(block);
        let layer_bytes = stored.level_bytes(width, height);
        let expected = layer_bytes * u64::from(image.layers());
        assert_eq!(bytes.len() as u64, expected, "level {level}");
        for (layer, bytes) in (0..).zip(bytes.chunks(layer_bytes as usize)) {
            let mut row = 0;
            while row < rows {
                let (slot, room) = self.room(staged_row, "a row of texel blocks")?;
                let count = ((room / staged_row) as u32).min(rows - row);
                let first = row * block;
                let extent = [width, (count * block).min(height - first)];
                let start = (u64::from(row) * stored_row) as usize;
                let source = &bytes[start..][..stored.level_bytes(width, extent[1]) as usize];
                let length = staged.level_bytes(width, extent[1]);
                let cursor = self.cursor as usize;
                let target = &mut self.slots[slot].mapped_mut()?[cursor..][..length as usize];
                convert(source, target, extent)?;
                let region = region(self.cursor, level, layer, first, extent);
                let staging = &self.slots[slot];
                if let Some(commands) = &mut self.open {
                    commands.copy_buffer_to_image(staging, image.view(), &region);
                }
                self.advance(length);
                row += count;
            }
        }
        Ok(())
    }

    /// Waits for all copies.
    pub fn finish(mut self) -> GpuResult<UploadStats> {
        self.flush()?;
        if let Some(last) = self.last {
            self.gpu.wait(last)?;
        }
        self.stats.seconds = self.begin.elapsed().as_secs_f64();
        Ok(self.stats)
    }

    /// Bytes copied so far.
    pub fn bytes(&self) -> u64 {
        self.stats.bytes
    }

    /// The slot being filled and its free bytes, at least `needed`.
    fn room(&mut self, needed: u64, what: &str) -> GpuResult<(usize, u64)> {
        let size = self.slots[0].size();
        if needed > size {
            return Err(GpuError::Limit {
                what: format!("the size of {what}"),
                needed,
                limit: size,
                device: "the staging ring".into(),
            });
        }
        if self.cursor + needed > size {
            self.flush()?;
        }
        let commands = match &mut self.open {
            Some(commands) => commands,
            closed => {
                self.cursor = 0;
                closed.insert(self.frames.begin()?)
            }
        };
        Ok((commands.slot(), size - self.cursor))
    }

    fn advance(&mut self, bytes: u64) {
        self.stats.bytes += bytes;
        self.cursor = (self.cursor + bytes).next_multiple_of(ALIGNMENT);
    }

    fn barrier(&mut self, barrier: ImageBarrier<'_>) {
        if let Some(commands) = &mut self.open {
            commands.image_barriers(&[barrier]);
        }
    }

    fn flush(&mut self) -> GpuResult<()> {
        if let Some(mut commands) = self.open.take() {
            commands.memory_barrier(COPY_WRITE, ANY_READ);
            self.last = Some(self.frames.submit(commands)?);
            self.stats.submissions += 1;
        }
        self.cursor = 0;
        Ok(())
    }
}

fn region(
    offset: u64,
    level: u32,
    layer: u32,
    first_row: u32,
    extent: [u32; 2],
) -> vk::BufferImageCopy {
    vk::BufferImageCopy::default()
        .buffer_offset(offset)
        .image_subresource(vk::ImageSubresourceLayers {
            aspect_mask: vk::ImageAspectFlags::COLOR,
            mip_level: level,
            base_array_layer: layer,
            layer_count: 1,
        })
        .image_offset(vk::Offset3D {
            x: 0,
            y: first_row as i32,
            z: 0,
        })
        .image_extent(vk::Extent3D {
            width: extent[0],
            height: extent[1],
            depth: 1,
        })
}
