//! Chooses a physical device by what it can do.

use std::ffi::CStr;

use ash::vk;

use super::blocks::Blocks;
use super::error::{GpuError, GpuResult};
use super::instance::{Instance, version_text};

/// A device with the reasons against it.
pub(super) struct Candidate {
    pub(super) raw: vk::PhysicalDevice,
    pub(super) name: String,
    pub(super) kind: vk::PhysicalDeviceType,
    /// Name and version of the driver; empty before the features were examined.
    pub(super) driver: String,
    pub(super) queue_family: u32,
    pub(super) timestamp_bits: u32,
    pub(super) anisotropy: bool,
    /// Families of block-compressed formats.
    pub(super) blocks: Blocks,
    /// `geometryShader`, with which fragment shaders may read `gl_PrimitiveID`.
    pub(super) primitive_id: bool,
    pub(super) integer_samples: vk::SampleCountFlags,
    /// Whether it can trace rays by pipelines.
    pub(super) ray_tracing: bool,
    pub(super) properties: vk::PhysicalDeviceProperties,
    /// What it lacks; empty where it is usable.
    pub(super) lacks: Vec<String>,
}

/// Whether a queue family of a device can present; absent in headless runs.
pub(super) type Presents<'a> = &'a dyn Fn(vk::PhysicalDevice, u32) -> bool;

/// The best usable device whose name contains `filter` (case is ignored).
///
/// # Errors
/// `NoDevice` with every device and what it lacks.
pub(super) fn select(
    instance: &Instance,
    filter: Option<&str>,
    presents: Option<Presents<'_>>,
) -> GpuResult<Candidate> {
    // SAFETY: the instance is alive.
    let devices = unsafe { instance.raw.enumerate_physical_devices() }
        .map_err(GpuError::of("vkEnumeratePhysicalDevices"))?;
    let mut candidates: Vec<Candidate> = devices
        .into_iter()
        .map(|device| examine(instance, device, presents))
        .collect();
    let best = choose(&candidates, filter)?;
    Ok(candidates.swap_remove(best))
}

/// Index of the best candidate: discrete, integrated, virtual, processor; the first of equals.
fn choose(candidates: &[Candidate], filter: Option<&str>) -> GpuResult<usize> {
    if candidates.is_empty() {
        return Err(GpuError::NoDriver);
    }
    let wanted = filter.map(str::to_lowercase);
    let matches = |candidate: &Candidate| {
        let name = candidate.name.to_lowercase();
        wanted.as_ref().is_none_or(|wanted| name.contains(wanted))
    };
    candidates
        .iter()
        .enumerate()
        .filter(|(_, candidate)| matches(candidate) && candidate.lacks.is_empty())
        .min_by_key(|(_, candidate)| rank(candidate.kind))
        .map(|(index, _)| index)
        .ok_or_else(|| GpuError::NoDevice(explain(candidates, filter, &matches)))
}

fn rank(kind: vk::PhysicalDeviceType) -> u32 {
    match kind {
        vk::PhysicalDeviceType::DISCRETE_GPU => 0,
        vk::PhysicalDeviceType::INTEGRATED_GPU => 1,
        vk::PhysicalDeviceType::VIRTUAL_GPU => 2,
        vk::PhysicalDeviceType::CPU => 3,
        _ => 4,
    }
}

fn explain(
    candidates: &[Candidate],
    filter: Option<&str>,
    matches: &dyn Fn(&Candidate) -> bool,
) -> String {
    let lines = candidates.iter().map(|candidate| {
        let mut reasons = candidate.lacks.clone();
        if !matches(candidate) {
            reasons.insert(0, format!("name lacks `{}`", filter.unwrap_or_default()));
        }
        format!("  {}: {}", candidate.name, reasons.join(", "))
    });
    lines.collect::<Vec<_>>().join("\n")
}

fn examine(
    instance: &Instance,
    device: vk::PhysicalDevice,
    presents: Option<Presents<'_>>,
) -> Candidate {
    // SAFETY: the device was enumerated from this living instance; also for the call below.
    let properties = unsafe { instance.raw.get_physical_device_properties(device) };
    let name = properties.device_name_as_c_str().unwrap_or(c"unnamed");
    let mut candidate = Candidate {
        raw: device,
        name: name.to_string_lossy().into_owned(),
        kind: properties.device_type,
        driver: String::new(),
        queue_family: 0,
        timestamp_bits: 0,
        anisotropy: false,
        blocks: Blocks::default(),
        primitive_id: false,
        integer_samples: vk::SampleCountFlags::TYPE_1,
        ray_tracing: false,
        properties,
        lacks: Vec::new(),
    };
    if properties.api_version < vk::API_VERSION_1_3 {
        let version = version_text(properties.api_version);
        candidate.lacks.push(format!("Vulkan 1.3 (has {version})"));
        return candidate;
    }
    (candidate.driver, candidate.integer_samples) = extended_properties(instance, device);
    examine_features(instance, &mut candidate);
    examine_queues(instance, &mut candidate, presents);
    if presents.is_some() && !has_extension(instance, device, ash::khr::swapchain::NAME) {
        candidate.lacks.push("VK_KHR_swapchain".into());
    }
    candidate
}

/// Name and version of the driver, as it calls itself; sample counts of integer colour targets.
fn extended_properties(
    instance: &Instance,
    device: vk::PhysicalDevice,
) -> (String, vk::SampleCountFlags) {
    let mut driver = vk::PhysicalDeviceVulkan12Properties::default();
    let mut properties = vk::PhysicalDeviceProperties2::default().push_next(&mut driver);
    // SAFETY: the device was enumerated and knows Vulkan 1.3, so the chained structure is known to it.
    unsafe {
        instance
            .raw
            .get_physical_device_properties2(device, &mut properties);
    }
    let text = |value: Result<&std::ffi::CStr, _>| match value {
        Ok(text) => text.to_string_lossy().into_owned(),
        Err(std::ffi::FromBytesUntilNulError { .. }) => String::new(),
    };
    let name = text(driver.driver_name_as_c_str());
    let info = text(driver.driver_info_as_c_str());
    let samples = driver.framebuffer_integer_color_sample_counts;
    (format!("{name} {info}").trim().to_owned(), samples)
}

fn examine_features(instance: &Instance, candidate: &mut Candidate) {
    let mut v12 = vk::PhysicalDeviceVulkan12Features::default();
    let mut v13 = vk::PhysicalDeviceVulkan13Features::default();
    let mut features = vk::PhysicalDeviceFeatures2::default()
        .push_next(&mut v12)
        .push_next(&mut v13);
    // SAFETY: the device was enumerated and knows Vulkan 1.3, so every chained structure is known to it.
    unsafe {
        instance
            .raw
            .get_physical_device_features2(candidate.raw, &mut features);
    }
    let v10 = features.features;
    candidate.ray_tracing = v10.shader_int64 == vk::TRUE
        && v12.buffer_device_address == vk::TRUE
        && traces_rays(instance, candidate.raw);
    // Software drivers spend most of a frame on anisotropic lookups, and lavapipe (Mesa 25.0) returns NaN from
    // them where the coordinates do not change at all, as on palette textures.
    let in_hardware = candidate.kind != vk::PhysicalDeviceType::CPU;
    candidate.blocks = Blocks {
        bc: v10.texture_compression_bc == vk::TRUE,
        astc: v10.texture_compression_astc_ldr == vk::TRUE,
    };
    candidate.primitive_id = v10.geometry_shader == vk::TRUE;
    candidate.anisotropy = in_hardware && v10.sampler_anisotropy == vk::TRUE;
    let needed = [
        (v10.depth_clamp, "depthClamp"),
        (v10.depth_bias_clamp, "depthBiasClamp"),
        (
            v10.shader_storage_image_extended_formats,
            "shaderStorageImageExtendedFormats",
        ),
        (
            v10.shader_sampled_image_array_dynamic_indexing,
            "shaderSampledImageArrayDynamicIndexing",
        ),
        (v12.runtime_descriptor_array, "runtimeDescriptorArray"),
        (
            v12.descriptor_binding_partially_bound,
            "descriptorBindingPartiallyBound",
        ),
        (
            v12.shader_sampled_image_array_non_uniform_indexing,
            "shaderSampledImageArrayNonUniformIndexing",
        ),
        (v12.scalar_block_layout, "scalarBlockLayout"),
        (v12.timeline_semaphore, "timelineSemaphore"),
        (v13.dynamic_rendering, "dynamicRendering"),
        (v13.synchronization2, "synchronization2"),
        (
            v13.shader_demote_to_helper_invocation,
            "shaderDemoteToHelperInvocation",
        ),
        (v13.shader_terminate_invocation, "shaderTerminateInvocation"),
        (v13.maintenance4, "maintenance4"),
    ];
    let missing = needed.iter().filter(|(value, _)| *value != vk::TRUE);
    candidate
        .lacks
        .extend(missing.map(|(_, name)| (*name).to_owned()));
}

/// Whether the ray-tracing extensions are there, and their features on.
fn traces_rays(instance: &Instance, device: vk::PhysicalDevice) -> bool {
    let extensions = super::raytracing::EXTENSIONS;
    if !extensions
        .iter()
        .all(|name| has_extension(instance, device, name))
    {
        return false;
    }
    let mut structures = vk::PhysicalDeviceAccelerationStructureFeaturesKHR::default();
    let mut pipelines = vk::PhysicalDeviceRayTracingPipelineFeaturesKHR::default();
    let mut features = vk::PhysicalDeviceFeatures2::default()
        .push_next(&mut structures)
        .push_next(&mut pipelines);
    // SAFETY: the device was enumerated and has both extensions, so it knows their structures.
    unsafe {
        instance
            .raw
            .get_physical_device_features2(device, &mut features);
    }
    structures.acceleration_structure == vk::TRUE && pipelines.ray_tracing_pipeline == vk::TRUE
}

fn examine_queues(instance: &Instance, candidate: &mut Candidate, presents: Option<Presents<'_>>) {
    // SAFETY: the device was enumerated from this living instance.
    let families = unsafe {
        instance
            .raw
            .get_physical_device_queue_family_properties(candidate.raw)
    };
    let needed = vk::QueueFlags::GRAPHICS | vk::QueueFlags::COMPUTE;
    let able = |(index, family): &(u32, &vk::QueueFamilyProperties)| {
        family.queue_flags.contains(needed)
            && presents.is_none_or(|presents| presents(candidate.raw, *index))
    };
    match (0..).zip(&families).find(able) {
        Some((index, family)) => {
            candidate.queue_family = index;
            candidate.timestamp_bits = family.timestamp_valid_bits;
        }
        None if presents.is_some() => candidate
            .lacks
            .push("a graphics queue that can present to this window".into()),
        None => candidate.lacks.push("a graphics and compute queue".into()),
    }
}

fn has_extension(instance: &Instance, device: vk::PhysicalDevice, name: &CStr) -> bool {
    // SAFETY: the device was enumerated from this living instance.
    let extensions = unsafe { instance.raw.enumerate_device_extension_properties(device) };
    extensions.is_ok_and(|extensions| {
        extensions
            .iter()
            .any(|extension| extension.extension_name_as_c_str() == Ok(name))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn candidate(name: &str, kind: vk::PhysicalDeviceType, lacks: &[&str]) -> Candidate {
        Candidate {
            raw: vk::PhysicalDevice::null(),
            name: name.into(),
            kind,
            queue_family: 0,
            timestamp_bits: 0,
            driver: String::new(),
            anisotropy: false,
            blocks: Blocks::default(),
            primitive_id: false,
            integer_samples: vk::SampleCountFlags::TYPE_1,
            ray_tracing: false,
            properties: vk::PhysicalDeviceProperties::default(),
            lacks: lacks.iter().map(|text| (*text).to_owned()).collect(),
        }
    }

    fn machine() -> Vec<Candidate> {
        vec![
            candidate("llvmpipe", vk::PhysicalDeviceType::CPU, &[]),
            candidate(
                "Old Card",
                vk::PhysicalDeviceType::DISCRETE_GPU,
                &["scalarBlockLayout"],
            ),
            candidate("Iris", vk::PhysicalDeviceType::INTEGRATED_GPU, &[]),
            candidate("Card A", vk::PhysicalDeviceType::DISCRETE_GPU, &[]),
            candidate("Card B", vk::PhysicalDeviceType::DISCRETE_GPU, &[]),
        ]
    }

    #[test]
    fn the_first_usable_discrete_device_wins() {
        assert_eq!(choose(&machine(), None).ok(), Some(3));
    }

    #[test]
    fn a_name_selects_without_case() {
        assert_eq!(choose(&machine(), Some("LLVM")).ok(), Some(0));
        assert_eq!(choose(&machine(), Some("card b")).ok(), Some(4));
    }

    #[test]
    fn the_error_lists_every_device_and_its_lacks() {
        let Err(error) = choose(&machine()[1..3], Some("old")) else {
            panic!("a device without scalarBlockLayout was chosen");
        };
        let text = error.to_string();
        assert!(text.contains("Old Card: scalarBlockLayout"), "{text}");
        assert!(text.contains("Iris: name lacks `old`"), "{text}");
    }

    #[test]
    fn no_device_at_all_means_no_driver() {
        assert!(matches!(choose(&[], None), Err(GpuError::NoDriver)));
    }
}
