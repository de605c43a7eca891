//! What a device can trace with, ray-tracing pipelines and their shader binding tables.

use std::sync::Arc;

use ash::vk;

use super::buffer::{Buffer, BufferDesc, Memory};
use super::descriptor::Layouts;
use super::device::{Gpu, Shared};
use super::error::{GpuError, GpuResult};
use super::pipeline::{Constants, Module, Shader};
use super::queue::Garbage;

/// Extensions that ray tracing needs.
pub(super) const EXTENSIONS: [&std::ffi::CStr; 3] = [
    ash::khr::acceleration_structure::NAME,
    ash::khr::ray_tracing_pipeline::NAME,
    ash::khr::deferred_host_operations::NAME,
];

/// Functions and limits of a device that traces rays.
pub(super) struct RayTracing {
    pub(super) structures: ash::khr::acceleration_structure::Device,
    pub(super) pipelines: ash::khr::ray_tracing_pipeline::Device,
    pub(super) limits: TraceLimits,
}

/// Limits that builds and binding tables keep.
#[derive(Clone, Copy, Debug)]
pub(super) struct TraceLimits {
    pub(super) max_geometries: u64,
    pub(super) max_primitives: u64,
    pub(super) max_instances: u64,
    pub(super) scratch_alignment: u64,
    pub(super) handle_size: u32,
    pub(super) handle_alignment: u32,
    pub(super) base_alignment: u32,
}

impl RayTracing {
    pub(super) fn new(
        instance: &ash::Instance,
        physical: vk::PhysicalDevice,
        device: &ash::Device,
    ) -> Self {
        let mut structures = vk::PhysicalDeviceAccelerationStructurePropertiesKHR::default();
        let mut pipelines = vk::PhysicalDeviceRayTracingPipelinePropertiesKHR::default();
        let mut properties = vk::PhysicalDeviceProperties2::default()
            .push_next(&mut structures)
            .push_next(&mut pipelines);
        // SAFETY: the physical device belongs to the living instance and has both extensions.
        unsafe { instance.get_physical_device_properties2(physical, &mut properties) };
        Self {
            limits: TraceLimits {
                max_geometries: structures.max_geometry_count,
                max_primitives: structures.max_primitive_count,
                max_instances: structures.max_instance_count,
                scratch_alignment: u64::from(
                    structures
                        .min_acceleration_structure_scratch_offset_alignment
                        .max(1),
                ),
                handle_size: pipelines.shader_group_handle_size,
                handle_alignment: pipelines.shader_group_handle_alignment,
                base_alignment: pipelines.shader_group_base_alignment,
            },
            structures: ash::khr::acceleration_structure::Device::new(instance, device),
            pipelines: ash::khr::ray_tracing_pipeline::Device::new(instance, device),
        }
    }
}

/// What to create: recursion depth 1, rays from the ray generation shader alone.
#[derive(Clone, Copy)]
pub struct RayPipelineDesc<'a> {
    /// Name in messages and debuggers.
    pub name: &'a str,
    /// Ray generation.
    pub raygen: Shader<'a>,
    /// Miss shader 0.
    pub miss: Shader<'a>,
    /// The only hit group's closest hit.
    pub closest_hit: Shader<'a>,
    /// The hit group's any hit; absent where all geometry is opaque.
    pub any_hit: Option<Shader<'a>>,
}

/// A ray-tracing pipeline with its shader binding table.
pub struct RayPipeline {
    shared: Arc<Shared>,
    raw: vk::Pipeline,
    regions: [vk::StridedDeviceAddressRegionKHR; 3],
    _table: Buffer,
    _layouts: Layouts,
}

impl Drop for RayPipeline {
    fn drop(&mut self) {
        self.shared.discard(Garbage::Pipeline(self.raw));
    }
}

impl RayPipeline {
    /// Compiles a pipeline and fills its table.
    ///
    /// # Panics
    /// Where the device cannot trace rays.
    pub fn new(gpu: &Gpu, layouts: &Layouts, desc: &RayPipelineDesc<'_>) -> GpuResult<Self> {
        let shared = &gpu.shared;
        let tracing = shared.ray_tracing();
        let raw = create(shared, layouts, desc)?;
        shared.set_name(raw, desc.name);
        let limits = tracing.limits;
        let stride = u64::from(limits.handle_size.next_multiple_of(limits.handle_alignment));
        // One group a region: each begins at the base alignment.
        let region = stride.next_multiple_of(u64::from(limits.base_alignment));
        let built = table(gpu, raw, region).map(|table| {
            let base = table
                .device_address()
                .next_multiple_of(u64::from(limits.base_alignment));
            let regions = std::array::from_fn(|index| vk::StridedDeviceAddressRegionKHR {
                device_address: base + region * index as u64,
                // A ray generation region's stride is its size.
                stride: if index == 0 { region } else { stride },
                size: region,
            });
            (table, regions)
        });
        match built {
            Ok((table, regions)) => Ok(Self {
                shared: shared.clone(),
                raw,
                regions,
                _table: table,
                _layouts: layouts.clone(),
            }),
            Err(error) => {
                shared.discard(Garbage::Pipeline(raw));
                Err(error)
            }
        }
    }

    pub(super) fn raw(&self) -> vk::Pipeline {
        self.raw
    }

    /// Ray generation, miss, hit.
    pub(super) fn regions(&self) -> &[vk::StridedDeviceAddressRegionKHR; 3] {
        &self.regions
    }
}

fn create(
    shared: &Arc<Shared>,
    layouts: &Layouts,
    desc: &RayPipelineDesc<'_>,
) -> GpuResult<vk::Pipeline> {
    let shaders = [
        Some((desc.raygen, vk::ShaderStageFlags::RAYGEN_KHR)),
        Some((desc.miss, vk::ShaderStageFlags::MISS_KHR)),
        Some((desc.closest_hit, vk::ShaderStageFlags::CLOSEST_HIT_KHR)),
        desc.any_hit
            .map(|shader| (shader, vk::ShaderStageFlags::ANY_HIT_KHR)),
    ];
    let shaders: Vec<_> = shaders.into_iter().flatten().collect();
    let modules: GpuResult<Vec<Module>> = shaders
        .iter()
        .map(|(shader, _)| Module::new(shared, shader.spirv))
        .collect();
    let modules = modules?;
    let constants: Vec<Constants> = shaders
        .iter()
        .map(|(shader, _)| Constants::new(shader.constants))
        .collect();
    let infos: Vec<_> = constants.iter().map(Constants::info).collect();
    let stages: Vec<_> = modules
        .iter()
        .zip(&shaders)
        .zip(&infos)
        .map(|((module, (_, stage)), info)| module.stage(*stage, info))
        .collect();
    let general = |index: u32| {
        vk::RayTracingShaderGroupCreateInfoKHR::default()
            .ty(vk::RayTracingShaderGroupTypeKHR::GENERAL)
            .general_shader(index)
            .closest_hit_shader(vk::SHADER_UNUSED_KHR)
            .any_hit_shader(vk::SHADER_UNUSED_KHR)
            .intersection_shader(vk::SHADER_UNUSED_KHR)
    };
    let any_hit = desc.any_hit.map_or(vk::SHADER_UNUSED_KHR, |_| 3);
    let hit = vk::RayTracingShaderGroupCreateInfoKHR::default()
        .ty(vk::RayTracingShaderGroupTypeKHR::TRIANGLES_HIT_GROUP)
        .general_shader(vk::SHADER_UNUSED_KHR)
        .closest_hit_shader(2)
        .any_hit_shader(any_hit)
        .intersection_shader(vk::SHADER_UNUSED_KHR);
    let groups = [general(0), general(1), hit];
    let info = vk::RayTracingPipelineCreateInfoKHR::default()
        .stages(&stages)
        .groups(&groups)
        .max_pipeline_ray_recursion_depth(1)
        .layout(layouts.pipeline());
    // SAFETY: modules, layout and cache are alive, and `info` points to locals of this function.
    let result = unsafe {
        shared.ray_tracing().pipelines.create_ray_tracing_pipelines(
            vk::DeferredOperationKHR::null(),
            shared.pipeline_cache.raw,
            &[info],
            None,
        )
    };
    let pipelines =
        result.map_err(|(_, result)| GpuError::of("vkCreateRayTracingPipelinesKHR")(result))?;
    Ok(pipelines.first().copied().unwrap_or_default())
}

/// The three groups' handles, one a region, behind an aligned address.
fn table(gpu: &Gpu, pipeline: vk::Pipeline, region: u64) -> GpuResult<Buffer> {
    let tracing = gpu.shared.ray_tracing();
    let size = tracing.limits.handle_size as usize;
    // SAFETY: the pipeline is alive and has three groups.
    let handles = unsafe {
        tracing
            .pipelines
            .get_ray_tracing_shader_group_handles(pipeline, 0, 3, size * 3)
    }
    .map_err(GpuError::of("vkGetRayTracingShaderGroupHandlesKHR"))?;
    let alignment = u64::from(tracing.limits.base_alignment);
    let mut buffer = Buffer::new(
        gpu,
        &BufferDesc {
            name: "shader binding table",
            size: region * 3 + alignment,
            usage: vk::BufferUsageFlags::SHADER_BINDING_TABLE_KHR
                | vk::BufferUsageFlags::SHADER_DEVICE_ADDRESS,
            memory: Memory::Upload,
        },
    )?;
    let address = buffer.device_address();
    let shift = address.next_multiple_of(alignment) - address;
    for (index, handle) in handles.chunks_exact(size).enumerate() {
        buffer.write(shift + region * index as u64, handle)?;
    }
    Ok(buffer)
}
