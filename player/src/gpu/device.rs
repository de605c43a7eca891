//! The logical device, its allocator and its queue.

use std::mem::ManuallyDrop;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use ash::vk;
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, Allocator, AllocatorCreateDesc};
use gpu_allocator::{AllocationError, AllocationSizes, AllocatorDebugSettings};

use super::blocks::{AllowedBlocks, Blocks};
use super::command::Commands;
use super::error::{GpuError, GpuResult};
use super::frame_sync::CommandMemory;
use super::image::attachment_samples;
use super::instance::Instance;
use super::pipeline_cache::PipelineCache;
use super::queue::{Submission, Timeline};
use super::raytracing::{self, RayTracing};
use super::select::{Candidate, Presents, select};

/// What to create.
#[derive(Clone, Debug, Default)]
pub struct GpuOptions {
    /// Core and synchronisation validation; messages are collected and printed.
    pub validation: bool,
    /// Part of the device's name; the best usable device where absent.
    pub device: Option<String>,
    /// Folder of compiled pipelines; none are kept where absent.
    pub cache: Option<std::path::PathBuf>,
    /// Families of block-compressed formats that may be used, of those that the device has.
    pub blocks: AllowedBlocks,
}

/// A Vulkan device, shared by everything made from it.
#[derive(Clone)]
pub struct Gpu {
    pub(super) shared: Arc<Shared>,
}

/// What every object of the device needs to be destroyed, and the device itself.
pub(super) struct Shared {
    pub(super) instance: Arc<Instance>,
    pub(super) physical: vk::PhysicalDevice,
    pub(super) device: ash::Device,
    pub(super) queue: vk::Queue,
    pub(super) queue_family: u32,
    /// Signalled by every submission with the next number.
    pub(super) semaphore: vk::Semaphore,
    pub(super) pipeline_cache: PipelineCache,
    pub(super) limits: vk::PhysicalDeviceLimits,
    pub(super) anisotropy: bool,
    /// Enabled families of block-compressed formats.
    pub(super) blocks: Blocks,
    /// `gl_PrimitiveID` in fragment shaders.
    pub(super) primitive_id: bool,
    /// Sample counts of integer colour targets.
    pub(super) integer_samples: vk::SampleCountFlags,
    /// A processor plays the GPU.
    pub(super) software: bool,
    pub(super) timestamp_bits: u32,
    pub(super) name: String,
    pub(super) driver: String,
    ray_tracing: Option<RayTracing>,
    debug: Option<ash::ext::debug_utils::Device>,
    allocator: ManuallyDrop<Mutex<Allocator>>,
    timeline: Mutex<Timeline>,
}

impl Gpu {
    /// Opens a device for rendering without a window.
    ///
    /// # Errors
    /// What is missing, as a [`GpuError`] with the remedy; never panics.
    pub fn new(options: &GpuOptions) -> GpuResult<Self> {
        let instance = Arc::new(Instance::new(options.validation, &[])?);
        Self::open(instance, options, None)
    }

    pub(super) fn open(
        instance: Arc<Instance>,
        options: &GpuOptions,
        presents: Option<Presents<'_>>,
    ) -> GpuResult<Self> {
        let mut candidate = select(&instance, options.device.as_deref(), presents)?;
        candidate.blocks = candidate.blocks.of(options.blocks);
        let device = create_device(&instance, &candidate, presents.is_some())?;
        let shared = Shared::new(instance, candidate, device, options.cache.as_deref())?;
        Ok(Self {
            shared: Arc::new(shared),
        })
    }

    /// Name of the device.
    pub fn device_name(&self) -> &str {
        &self.shared.name
    }

    /// Name and version of the driver.
    pub fn driver(&self) -> &str {
        &self.shared.driver
    }

    /// Whether the device traces rays: acceleration structures, ray-tracing pipelines, buffer addresses.
    pub fn traces_rays(&self) -> bool {
        self.shared.ray_tracing.is_some()
    }

    /// Families of block-compressed formats that images may have.
    pub fn blocks(&self) -> Blocks {
        self.shared.blocks
    }

    /// Limits of the device.
    pub fn limits(&self) -> &vk::PhysicalDeviceLimits {
        &self.shared.limits
    }

    /// The most samples per pixel that the device's targets can have, up to `wanted`.
    pub fn samples(&self, wanted: u32) -> u32 {
        let counts = attachment_samples(&self.shared);
        let usable = [8, 4, 2].into_iter().filter(|count| counts & count != 0);
        usable.filter(|count| *count <= wanted).max().unwrap_or(1)
    }

    /// As [`Gpu::samples`], for targets of integers too.
    pub fn integer_samples(&self, wanted: u32) -> u32 {
        let limits = &self.shared.limits;
        let counts = attachment_samples(&self.shared)
            & limits.sampled_image_integer_sample_counts.as_raw()
            & self.shared.integer_samples.as_raw();
        let usable = [8, 4, 2].into_iter().filter(|count| counts & count != 0);
        usable.filter(|count| *count <= wanted).max().unwrap_or(1)
    }

    /// Whether fragments know the number of their triangle.
    pub fn numbers_triangles(&self) -> bool {
        self.shared.primitive_id
    }

    /// Whether the processor plays the GPU.
    pub fn is_software(&self) -> bool {
        self.shared.software
    }

    /// Everything the validation layer reported so far; empty is clean.
    pub fn validation_messages(&self) -> Vec<String> {
        let messages = &self.shared.instance.messages;
        messages
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .clone()
    }

    /// Drops this handle and returns what the validation layer reported, objects that outlived the device
    /// included where this was the last user of it.
    pub fn close(self) -> Vec<String> {
        let messages = self.shared.instance.messages.clone();
        drop(self);
        let messages = messages.lock().unwrap_or_else(PoisonError::into_inner);
        messages.clone()
    }

    /// Blocks until the queue is empty.
    pub fn wait_idle(&self) -> GpuResult<()> {
        self.shared.wait_idle()
    }

    /// Blocks until a submission has finished.
    pub fn wait(&self, submission: Submission) -> GpuResult<()> {
        self.shared.wait(submission)
    }

    /// Records commands, submits them, and blocks until they have finished.
    pub fn once(&self, record: impl FnOnce(&mut Commands) -> GpuResult<()>) -> GpuResult<()> {
        let memory = CommandMemory::new(&self.shared)?;
        let mut commands = memory.begin(0, None)?;
        record(&mut commands)?;
        let submission = commands.submit(None)?.submission;
        self.wait(submission)?;
        self.shared.collect()
    }

    /// Whether optimally tiled images of `format` have all of `features`.
    ///
    /// # Errors
    /// `Format` where they have not.
    pub fn check_format(
        &self,
        format: vk::Format,
        features: vk::FormatFeatureFlags,
    ) -> GpuResult<()> {
        // SAFETY: the physical device belongs to the living instance.
        let properties = unsafe {
            let instance = &self.shared.instance.raw;
            instance.get_physical_device_format_properties(self.shared.physical, format)
        };
        if properties.optimal_tiling_features.contains(features) {
            return Ok(());
        }
        Err(GpuError::Format {
            device: self.shared.name.clone(),
            format: format!("{format:?}"),
            usage: format!("{features:?}"),
        })
    }
}

impl Shared {
    fn new(
        instance: Arc<Instance>,
        candidate: Candidate,
        device: ash::Device,
        cache: Option<&std::path::Path>,
    ) -> GpuResult<Self> {
        let debug = instance
            .debug_utils
            .then(|| ash::ext::debug_utils::Device::new(&instance.raw, &device));
        let objects = match DeviceObjects::new(&instance, &candidate, &device, cache) {
            Ok(objects) => objects,
            Err(error) => {
                // SAFETY: the device has no objects left.
                unsafe { device.destroy_device(None) };
                return Err(error);
            }
        };
        // SAFETY: the device was created with one queue of this family.
        let queue = unsafe { device.get_device_queue(candidate.queue_family, 0) };
        Ok(Self {
            physical: candidate.raw,
            queue,
            queue_family: candidate.queue_family,
            semaphore: objects.semaphore,
            pipeline_cache: objects.pipeline_cache,
            limits: candidate.properties.limits,
            anisotropy: candidate.anisotropy,
            blocks: candidate.blocks,
            primitive_id: candidate.primitive_id,
            integer_samples: candidate.integer_samples,
            software: candidate.kind == vk::PhysicalDeviceType::CPU,
            ray_tracing: candidate
                .ray_tracing
                .then(|| RayTracing::new(&instance.raw, candidate.raw, &device)),
            timestamp_bits: candidate.timestamp_bits,
            name: candidate.name,
            driver: candidate.driver,
            debug,
            allocator: ManuallyDrop::new(Mutex::new(objects.allocator)),
            timeline: Mutex::default(),
            device,
            instance,
        })
    }

    /// Functions and limits of ray tracing.
    ///
    /// # Panics
    /// Where the device cannot trace rays: callers ask [`Gpu::traces_rays`] first.
    pub(super) fn ray_tracing(&self) -> &RayTracing {
        match &self.ray_tracing {
            Some(tracing) => tracing,
            None => panic!("{} cannot trace rays", self.name),
        }
    }

    /// Locks the timeline, and with it the queue.
    pub(super) fn timeline(&self) -> MutexGuard<'_, Timeline> {
        self.timeline.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn allocate(
        &self,
        desc: &AllocationCreateDesc<'_>,
    ) -> Result<Allocation, AllocationError> {
        let mut allocator = self
            .allocator
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        allocator.allocate(desc)
    }

    /// Gives memory back; whatever was bound to it must be destroyed.
    pub(super) fn free(&self, allocation: Allocation) {
        let mut allocator = self
            .allocator
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        // Only an allocation of another allocator can be refused, which would be a bug.
        if let Err(error) = allocator.free(allocation) {
            debug_assert!(false, "free: {error}");
        }
    }

    /// The label functions, where the loader has them.
    pub(super) fn debug(&self) -> Option<&ash::ext::debug_utils::Device> {
        self.debug.as_ref()
    }

    /// Names an object for validation messages and debuggers.
    pub(super) fn set_name(&self, object: impl vk::Handle, name: &str) {
        let Some(debug) = &self.debug else { return };
        let bytes: Vec<u8> = name.bytes().filter(|byte| *byte != 0).collect();
        let Ok(name) = std::ffi::CString::new(bytes) else {
            return;
        };
        let info = vk::DebugUtilsObjectNameInfoEXT::default()
            .object_handle(object)
            .object_name(&name);
        // SAFETY: the object belongs to this device and no other thread uses it yet. A failure only loses a name.
        let _ = unsafe { debug.set_debug_utils_object_name(&info) };
    }
}

impl Drop for Shared {
    fn drop(&mut self) {
        // A lost device is idle as well.
        let _ = self.wait_idle();
        self.destroy_all();
        // SAFETY: all objects that held an `Arc` of this are gone, and the queue is empty. The allocator is taken
        // once, here, before its device.
        unsafe {
            self.pipeline_cache.close(&self.device);
            self.device.destroy_semaphore(self.semaphore, None);
            ManuallyDrop::drop(&mut self.allocator);
            self.device.destroy_device(None);
        }
    }
}

/// Objects that live as long as the device.
struct DeviceObjects {
    semaphore: vk::Semaphore,
    pipeline_cache: PipelineCache,
    allocator: Allocator,
}

impl DeviceObjects {
    fn new(
        instance: &Instance,
        candidate: &Candidate,
        device: &ash::Device,
        cache: Option<&std::path::Path>,
    ) -> GpuResult<Self> {
        let allocator = Allocator::new(&AllocatorCreateDesc {
            instance: instance.raw.clone(),
            device: device.clone(),
            physical_device: candidate.raw,
            debug_settings: AllocatorDebugSettings::default(),
            buffer_device_address: candidate.ray_tracing,
            allocation_sizes: AllocationSizes::default(),
        })
        .map_err(|error| GpuError::allocation("the allocator", 0, &error))?;
        let mut kind = vk::SemaphoreTypeCreateInfo::default()
            .semaphore_type(vk::SemaphoreType::TIMELINE)
            .initial_value(0);
        let info = vk::SemaphoreCreateInfo::default().push_next(&mut kind);
        // SAFETY: the device is alive and has timeline semaphores enabled.
        let semaphore = unsafe { device.create_semaphore(&info, None) }
            .map_err(GpuError::of("vkCreateSemaphore"))?;
        let pipeline_cache =
            PipelineCache::new(device, &candidate.properties, cache).inspect_err(|_| {
                // SAFETY: the semaphore was never used.
                unsafe { device.destroy_semaphore(semaphore, None) };
            })?;
        Ok(Self {
            semaphore,
            pipeline_cache,
            allocator,
        })
    }
}

fn create_device(
    instance: &Instance,
    candidate: &Candidate,
    presents: bool,
) -> GpuResult<ash::Device> {
    let priorities = [1.0];
    let queues = [vk::DeviceQueueCreateInfo::default()
        .queue_family_index(candidate.queue_family)
        .queue_priorities(&priorities)];
    let swapchain = [ash::khr::swapchain::NAME.as_ptr()];
    let mut extensions = swapchain[..usize::from(presents)].to_vec();
    if candidate.ray_tracing {
        extensions.extend(raytracing::EXTENSIONS.map(std::ffi::CStr::as_ptr));
    }
    let mut structures =
        vk::PhysicalDeviceAccelerationStructureFeaturesKHR::default().acceleration_structure(true);
    let mut pipelines =
        vk::PhysicalDeviceRayTracingPipelineFeaturesKHR::default().ray_tracing_pipeline(true);
    let mut v12 = vk::PhysicalDeviceVulkan12Features::default()
        .runtime_descriptor_array(true)
        .descriptor_binding_partially_bound(true)
        .shader_sampled_image_array_non_uniform_indexing(true)
        .scalar_block_layout(true)
        .timeline_semaphore(true)
        .buffer_device_address(candidate.ray_tracing);
    let mut v13 = vk::PhysicalDeviceVulkan13Features::default()
        .dynamic_rendering(true)
        .synchronization2(true)
        .shader_demote_to_helper_invocation(true)
        .shader_terminate_invocation(true)
        .maintenance4(true);
    let v10 = vk::PhysicalDeviceFeatures::default()
        .texture_compression_bc(candidate.blocks.bc)
        .texture_compression_astc_ldr(candidate.blocks.astc)
        .depth_clamp(true)
        .depth_bias_clamp(true)
        .shader_storage_image_extended_formats(true)
        .shader_sampled_image_array_dynamic_indexing(true)
        .shader_int64(candidate.ray_tracing)
        .geometry_shader(candidate.primitive_id)
        .sampler_anisotropy(candidate.anisotropy);
    let mut info = vk::DeviceCreateInfo::default()
        .queue_create_infos(&queues)
        .enabled_extension_names(&extensions)
        .enabled_features(&v10)
        .push_next(&mut v12)
        .push_next(&mut v13);
    if candidate.ray_tracing {
        info = info.push_next(&mut structures).push_next(&mut pipelines);
    }
    // SAFETY: the candidate was found to have the queue, the extension and all features; `info` outlives the call.
    unsafe { instance.raw.create_device(candidate.raw, &info, None) }
        .map_err(GpuError::of("vkCreateDevice"))
}
