//! Buffers with their memory.

use std::sync::Arc;

use ash::vk;
use bytemuck::Pod;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, AllocationScheme};

use super::device::{Gpu, Shared};
use super::error::{GpuError, GpuResult};
use super::queue::Garbage;

/// Who reads and writes a buffer. Mapped memory is always coherent: the allocator takes no other kind, and Vulkan
/// guarantees that one exists.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Memory {
    /// Only the GPU.
    Device,
    /// The CPU writes, the GPU reads. Reading it back may be slow.
    Upload,
    /// The GPU writes, the CPU reads; cached where the device has such memory.
    Readback,
}

impl Memory {
    fn location(self) -> MemoryLocation {
        match self {
            Self::Device => MemoryLocation::GpuOnly,
            Self::Upload => MemoryLocation::CpuToGpu,
            Self::Readback => MemoryLocation::GpuToCpu,
        }
    }
}

/// What to create.
#[derive(Clone, Copy, Debug)]
pub struct BufferDesc<'a> {
    /// Name in messages and debuggers.
    pub name: &'a str,
    /// Bytes, at least one.
    pub size: u64,
    /// What the GPU does with it.
    pub usage: vk::BufferUsageFlags,
    /// Where it lies.
    pub memory: Memory,
}

/// A buffer with memory bound to it.
pub struct Buffer {
    shared: Arc<Shared>,
    pub(super) raw: vk::Buffer,
    /// Taken when dropped.
    allocation: Option<Allocation>,
    size: u64,
    addressable: bool,
}

impl Buffer {
    /// A buffer of `size` bytes, one where that is none, that the CPU fills and the GPU reads.
    ///
    /// # Errors
    /// As [`Buffer::new`].
    pub fn upload(
        gpu: &Gpu,
        name: &str,
        size: usize,
        usage: vk::BufferUsageFlags,
    ) -> GpuResult<Self> {
        let desc = BufferDesc {
            name,
            size: size.max(1) as u64,
            usage,
            memory: Memory::Upload,
        };
        Self::new(gpu, &desc)
    }

    /// Allocates a buffer; its content is undefined.
    ///
    /// # Errors
    /// `OutOfMemory` with the buffer's name.
    pub fn new(gpu: &Gpu, desc: &BufferDesc<'_>) -> GpuResult<Self> {
        let shared = &gpu.shared;
        let info = vk::BufferCreateInfo::default()
            .size(desc.size)
            .usage(desc.usage)
            .sharing_mode(vk::SharingMode::EXCLUSIVE);
        // SAFETY: the device is alive.
        let raw = unsafe { shared.device.create_buffer(&info, None) }
            .map_err(GpuError::of("vkCreateBuffer"))?;
        match bind(shared, raw, desc) {
            Ok(allocation) => {
                shared.set_name(raw, desc.name);
                Ok(Self {
                    shared: shared.clone(),
                    raw,
                    allocation: Some(allocation),
                    size: desc.size,
                    addressable: desc
                        .usage
                        .contains(vk::BufferUsageFlags::SHADER_DEVICE_ADDRESS),
                })
            }
            Err(error) => {
                // SAFETY: the buffer was never used.
                unsafe { shared.device.destroy_buffer(raw, None) };
                Err(error)
            }
        }
    }

    /// Bytes.
    pub fn size(&self) -> u64 {
        self.size
    }

    /// Where shaders find it.
    ///
    /// # Panics
    /// Where it was made without `SHADER_DEVICE_ADDRESS` (in debug builds).
    pub fn device_address(&self) -> vk::DeviceAddress {
        debug_assert!(self.addressable, "a buffer without an address");
        let info = vk::BufferDeviceAddressInfo::default().buffer(self.raw);
        // SAFETY: the buffer is alive and was made with an address.
        unsafe { self.shared.device.get_buffer_device_address(&info) }
    }

    /// Writes records at a byte offset of mapped memory.
    ///
    /// # Panics
    /// Where they do not fit.
    ///
    /// # Errors
    /// `Vulkan` where the memory is not mapped.
    pub fn write<T: Pod>(&mut self, byte_offset: u64, values: &[T]) -> GpuResult<()> {
        let bytes: &[u8] = bytemuck::cast_slice(values);
        let start = usize::try_from(byte_offset).unwrap_or(usize::MAX);
        self.mapped_mut()?[start..][..bytes.len()].copy_from_slice(bytes);
        Ok(())
    }

    /// Reads records at a byte offset of mapped memory, after the writing submission has finished.
    ///
    /// # Panics
    /// Where they lie outside.
    ///
    /// # Errors
    /// `Vulkan` where the memory is not mapped.
    pub fn read<T: Pod>(&self, byte_offset: u64, out: &mut [T]) -> GpuResult<()> {
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(out);
        let start = usize::try_from(byte_offset).unwrap_or(usize::MAX);
        let mapped = self.allocation.as_ref().and_then(Allocation::mapped_slice);
        let mapped = &mapped.ok_or_else(not_mapped)?[..self.size as usize];
        bytes.copy_from_slice(&mapped[start..][..bytes.len()]);
        Ok(())
    }

    /// The mapped bytes.
    pub(super) fn mapped_mut(&mut self) -> GpuResult<&mut [u8]> {
        let size = self.size as usize;
        let mapped = self
            .allocation
            .as_mut()
            .and_then(Allocation::mapped_slice_mut);
        Ok(&mut mapped.ok_or_else(not_mapped)?[..size])
    }
}

impl Drop for Buffer {
    fn drop(&mut self) {
        if let Some(allocation) = self.allocation.take() {
            self.shared.discard(Garbage::Buffer(self.raw, allocation));
        }
    }
}

fn not_mapped() -> GpuError {
    GpuError::of("mapping a buffer")(vk::Result::ERROR_MEMORY_MAP_FAILED)
}

fn bind(shared: &Shared, raw: vk::Buffer, desc: &BufferDesc<'_>) -> GpuResult<Allocation> {
    // SAFETY: the buffer belongs to this device.
    let requirements = unsafe { shared.device.get_buffer_memory_requirements(raw) };
    let allocation = shared
        .allocate(&AllocationCreateDesc {
            name: desc.name,
            requirements,
            location: desc.memory.location(),
            linear: true,
            allocation_scheme: AllocationScheme::GpuAllocatorManaged,
        })
        .map_err(|error| GpuError::allocation(desc.name, requirements.size, &error))?;
    // SAFETY: the memory was allocated for this buffer's requirements and nothing is bound to this range.
    let bound = unsafe {
        shared
            .device
            .bind_buffer_memory(raw, allocation.memory(), allocation.offset())
    };
    match bound {
        Ok(()) => Ok(allocation),
        Err(result) => {
            shared.free(allocation);
            Err(GpuError::of("vkBindBufferMemory")(result))
        }
    }
}
