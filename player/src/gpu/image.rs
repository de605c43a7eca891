//! Images with their memory and view, and the samplers that read them.

use std::marker::PhantomData;
use std::sync::Arc;

use ash::vk;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, AllocationScheme};

use super::device::{Gpu, Shared};
use super::error::{GpuError, GpuResult};
use super::queue::Garbage;

/// Anisotropy asked for, where the device has any.
const MAX_ANISOTROPY: f32 = 16.0;

/// What to create.
#[derive(Clone, Copy, Debug)]
pub struct ImageDesc<'a> {
    /// Name in messages and debuggers.
    pub name: &'a str,
    /// Texel format.
    pub format: vk::Format,
    /// Width and height of level 0.
    pub extent: [u32; 2],
    /// Mip levels.
    pub levels: u32,
    /// Layers; six for a cube.
    pub layers: u32,
    /// Whether the view is a cube.
    pub cube: bool,
    /// Whether the view is an array, of one layer too.
    pub array: bool,
    /// Samples per texel: 1, 2, 4 or 8.
    pub samples: u32,
    /// What the GPU does with it.
    pub usage: vk::ImageUsageFlags,
}

/// A 2D image, a 2D array or a cube with one view of the whole; an array that can be attached also has a view of
/// each layer.
pub struct Image {
    shared: Arc<Shared>,
    raw: vk::Image,
    view: vk::ImageView,
    layer_views: Vec<vk::ImageView>,
    /// Taken when dropped.
    allocation: Option<Allocation>,
    format: vk::Format,
    extent: [u32; 2],
    levels: u32,
    layers: u32,
}

/// A borrowed image: an [`Image`] or one of the swapchain's.
#[derive(Clone, Copy)]
pub struct ImageRef<'a> {
    pub(super) raw: vk::Image,
    pub(super) view: vk::ImageView,
    format: vk::Format,
    extent: [u32; 2],
    owner: PhantomData<&'a ()>,
}

impl ImageRef<'_> {
    pub(super) fn new(
        raw: vk::Image,
        view: vk::ImageView,
        format: vk::Format,
        extent: [u32; 2],
    ) -> Self {
        Self {
            raw,
            view,
            format,
            extent,
            owner: PhantomData,
        }
    }

    /// Texel format.
    pub fn format(&self) -> vk::Format {
        self.format
    }

    /// The view, to tell images apart.
    pub fn raw_view(&self) -> vk::ImageView {
        self.view
    }

    /// Width and height of level 0.
    pub fn extent(&self) -> [u32; 2] {
        self.extent
    }

    /// Colour or depth.
    pub fn aspect(&self) -> vk::ImageAspectFlags {
        aspect(self.format)
    }

    /// All levels and layers.
    pub(super) fn whole(&self) -> vk::ImageSubresourceRange {
        whole(self.format)
    }
}

impl Image {
    /// Allocates an image; its layout is undefined.
    ///
    /// # Errors
    /// `Format` or `Limit` where the device cannot have such an image, `OutOfMemory` with the image's name.
    pub fn new(gpu: &Gpu, desc: &ImageDesc<'_>) -> GpuResult<Self> {
        Self::with_components(gpu, desc, vk::ComponentMapping::default())
    }

    /// As [`Image::new`], with a view that shows its channels as `components`. Such an image can only be sampled.
    ///
    /// # Errors
    /// Those of [`Image::new`].
    pub fn with_components(
        gpu: &Gpu,
        desc: &ImageDesc<'_>,
        components: vk::ComponentMapping,
    ) -> GpuResult<Self> {
        let shared = &gpu.shared;
        check_support(shared, desc)?;
        // SAFETY: the device is alive and supports images of this kind.
        let raw = unsafe { shared.device.create_image(&image_info(desc), None) }
            .map_err(GpuError::of("vkCreateImage"))?;
        let allocation = bind(shared, raw, desc).inspect_err(|_| {
            // SAFETY: the image was never used.
            unsafe { shared.device.destroy_image(raw, None) };
        })?;
        let view = match create_view(shared, raw, desc, components) {
            Ok(view) => view,
            Err(error) => {
                // SAFETY: the image was never used.
                unsafe { shared.device.destroy_image(raw, None) };
                shared.free(allocation);
                return Err(error);
            }
        };
        shared.set_name(raw, desc.name);
        shared.set_name(view, desc.name);
        let mut image = Self {
            shared: shared.clone(),
            raw,
            view,
            layer_views: Vec::new(),
            allocation: Some(allocation),
            format: desc.format,
            extent: desc.extent,
            levels: desc.levels,
            layers: desc.layers,
        };
        if desc.array && desc.usage.intersects(ATTACHMENT) {
            for layer in 0..desc.layers {
                let view = create_layer_view(shared, raw, desc, layer)?;
                shared.set_name(view, desc.name);
                image.layer_views.push(view);
            }
        }
        Ok(image)
    }

    /// One layer of an array that can be attached.
    ///
    /// # Panics
    /// Where the image has no such layer view.
    pub fn layer(&self, layer: u32) -> ImageRef<'_> {
        let view = self.layer_views[layer as usize];
        ImageRef::new(self.raw, view, self.format, self.extent)
    }

    /// Borrows image and view.
    pub fn view(&self) -> ImageRef<'_> {
        ImageRef::new(self.raw, self.view, self.format, self.extent)
    }

    /// Texel format.
    pub fn format(&self) -> vk::Format {
        self.format
    }

    /// Width and height of level 0.
    pub fn extent(&self) -> [u32; 2] {
        self.extent
    }

    /// Mip levels.
    pub fn levels(&self) -> u32 {
        self.levels
    }

    /// Layers.
    pub fn layers(&self) -> u32 {
        self.layers
    }
}

impl Drop for Image {
    fn drop(&mut self) {
        for view in self.layer_views.drain(..) {
            self.shared.discard(Garbage::View(view));
        }
        if let Some(allocation) = self.allocation.take() {
            self.shared
                .discard(Garbage::Image(self.raw, self.view, allocation));
        }
    }
}

/// Usages as attachment.
const ATTACHMENT: vk::ImageUsageFlags = vk::ImageUsageFlags::from_raw(
    vk::ImageUsageFlags::COLOR_ATTACHMENT.as_raw()
        | vk::ImageUsageFlags::DEPTH_STENCIL_ATTACHMENT.as_raw(),
);

fn aspect(format: vk::Format) -> vk::ImageAspectFlags {
    match format {
        vk::Format::D16_UNORM | vk::Format::D32_SFLOAT => vk::ImageAspectFlags::DEPTH,
        _ => vk::ImageAspectFlags::COLOR,
    }
}

fn whole(format: vk::Format) -> vk::ImageSubresourceRange {
    vk::ImageSubresourceRange::default()
        .aspect_mask(aspect(format))
        .level_count(vk::REMAINING_MIP_LEVELS)
        .layer_count(vk::REMAINING_ARRAY_LAYERS)
}

fn create_flags(desc: &ImageDesc<'_>) -> vk::ImageCreateFlags {
    if desc.cube {
        vk::ImageCreateFlags::CUBE_COMPATIBLE
    } else {
        vk::ImageCreateFlags::empty()
    }
}

fn image_info(desc: &ImageDesc<'_>) -> vk::ImageCreateInfo<'static> {
    vk::ImageCreateInfo::default()
        .flags(create_flags(desc))
        .image_type(vk::ImageType::TYPE_2D)
        .format(desc.format)
        .extent(vk::Extent3D {
            width: desc.extent[0],
            height: desc.extent[1],
            depth: 1,
        })
        .mip_levels(desc.levels)
        .array_layers(desc.layers)
        .samples(vk::SampleCountFlags::from_raw(desc.samples))
        .tiling(vk::ImageTiling::OPTIMAL)
        .usage(desc.usage)
        .sharing_mode(vk::SharingMode::EXCLUSIVE)
        .initial_layout(vk::ImageLayout::UNDEFINED)
}

fn check_support(shared: &Shared, desc: &ImageDesc<'_>) -> GpuResult<()> {
    if let Some(family) = shared.blocks.lacks(desc.format) {
        return Err(GpuError::NoBlocks {
            device: shared.name.clone(),
            family,
            image: desc.name.to_owned(),
        });
    }
    // SAFETY: the physical device belongs to the living instance.
    let result = unsafe {
        shared
            .instance
            .raw
            .get_physical_device_image_format_properties(
                shared.physical,
                desc.format,
                vk::ImageType::TYPE_2D,
                vk::ImageTiling::OPTIMAL,
                desc.usage,
                create_flags(desc),
            )
    };
    let allowed = match result {
        Ok(properties) => properties,
        Err(vk::Result::ERROR_FORMAT_NOT_SUPPORTED) => {
            return Err(GpuError::Format {
                device: shared.name.clone(),
                format: format!("{:?}", desc.format),
                usage: format!("image `{}` ({:?})", desc.name, desc.usage),
            });
        }
        Err(other) => {
            return Err(GpuError::of("vkGetPhysicalDeviceImageFormatProperties")(
                other,
            ));
        }
    };
    // What both image and attachments can have; counts are powers of two.
    let usable = match desc.samples {
        1 => 1,
        _ => attachment_samples(shared),
    };
    let sizes = [
        ("width", desc.extent[0], allowed.max_extent.width),
        ("height", desc.extent[1], allowed.max_extent.height),
        ("level count", desc.levels, allowed.max_mip_levels),
        ("layer count", desc.layers, allowed.max_array_layers),
        (
            "sample count",
            desc.samples,
            highest_bit(allowed.sample_counts.as_raw() & usable),
        ),
    ];
    match sizes.iter().find(|(_, needed, limit)| needed > limit) {
        Some((size, needed, limit)) => Err(GpuError::Limit {
            what: format!("the {size} of image `{}`", desc.name),
            needed: u64::from(*needed),
            limit: u64::from(*limit),
            device: shared.name.clone(),
        }),
        None => Ok(()),
    }
}

/// Sample counts, as bits, that colour, depth and sampled multisample images all have.
pub(super) fn attachment_samples(shared: &Shared) -> u32 {
    let limits = &shared.limits;
    let counts = limits.framebuffer_color_sample_counts
        & limits.framebuffer_depth_sample_counts
        & limits.sampled_image_color_sample_counts
        & limits.sampled_image_depth_sample_counts;
    counts.as_raw()
}

fn highest_bit(bits: u32) -> u32 {
    1 << (31 - bits.max(1).leading_zeros())
}

fn bind(shared: &Shared, raw: vk::Image, desc: &ImageDesc<'_>) -> GpuResult<Allocation> {
    // SAFETY: the image belongs to this device.
    let requirements = unsafe { shared.device.get_image_memory_requirements(raw) };
    let allocation = shared
        .allocate(&AllocationCreateDesc {
            name: desc.name,
            requirements,
            location: MemoryLocation::GpuOnly,
            linear: false,
            allocation_scheme: AllocationScheme::GpuAllocatorManaged,
        })
        .map_err(|error| GpuError::allocation(desc.name, requirements.size, &error))?;
    // SAFETY: the memory was allocated for this image's requirements and nothing is bound to this range.
    let bound = unsafe {
        shared
            .device
            .bind_image_memory(raw, allocation.memory(), allocation.offset())
    };
    match bound {
        Ok(()) => Ok(allocation),
        Err(result) => {
            shared.free(allocation);
            Err(GpuError::of("vkBindImageMemory")(result))
        }
    }
}

fn create_view(
    shared: &Shared,
    raw: vk::Image,
    desc: &ImageDesc<'_>,
    components: vk::ComponentMapping,
) -> GpuResult<vk::ImageView> {
    let kind = match (desc.cube, desc.array) {
        (true, _) => vk::ImageViewType::CUBE,
        (false, false) => vk::ImageViewType::TYPE_2D,
        (false, true) => vk::ImageViewType::TYPE_2D_ARRAY,
    };
    let info = vk::ImageViewCreateInfo::default()
        .image(raw)
        .view_type(kind)
        .format(desc.format)
        .components(components)
        .subresource_range(whole(desc.format));
    // SAFETY: the image has memory bound and was created for views of this kind.
    unsafe { shared.device.create_image_view(&info, None) }
        .map_err(GpuError::of("vkCreateImageView"))
}

fn create_layer_view(
    shared: &Shared,
    raw: vk::Image,
    desc: &ImageDesc<'_>,
    layer: u32,
) -> GpuResult<vk::ImageView> {
    let info = vk::ImageViewCreateInfo::default()
        .image(raw)
        .view_type(vk::ImageViewType::TYPE_2D)
        .format(desc.format)
        .subresource_range(vk::ImageSubresourceRange {
            level_count: 1,
            base_array_layer: layer,
            layer_count: 1,
            ..whole(desc.format)
        });
    // SAFETY: the image has memory bound and has this layer.
    unsafe { shared.device.create_image_view(&info, None) }
        .map_err(GpuError::of("vkCreateImageView"))
}

/// How texels are filtered and addressed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SamplerDesc {
    /// Magnification.
    pub mag: vk::Filter,
    /// Minification.
    pub min: vk::Filter,
    /// Between levels.
    pub mip: vk::SamplerMipmapMode,
    /// Highest level read; [`vk::LOD_CLAMP_NONE`] for all.
    pub max_lod: f32,
    /// Along U and V.
    pub wrap: [vk::SamplerAddressMode; 2],
    /// As much anisotropy as the device has, 16 at most.
    pub anisotropy: bool,
    /// Comparison of the reference (left) with the texel; the lookup gives how much of it holds.
    pub compare: Option<vk::CompareOp>,
}

impl SamplerDesc {
    /// Linear in all three, all levels, clamped to the edge.
    pub const TRILINEAR_CLAMP: Self = Self {
        mag: vk::Filter::LINEAR,
        min: vk::Filter::LINEAR,
        mip: vk::SamplerMipmapMode::LINEAR,
        max_lod: vk::LOD_CLAMP_NONE,
        wrap: [vk::SamplerAddressMode::CLAMP_TO_EDGE; 2],
        anisotropy: false,
        compare: None,
    };
    /// Linear mix of four comparisons in reverse-Z: lit where the reference is at least as near, and outside.
    pub const SHADOW_COMPARE: Self = Self {
        compare: Some(vk::CompareOp::GREATER_OR_EQUAL),
        wrap: [vk::SamplerAddressMode::CLAMP_TO_BORDER; 2],
        ..Self::LINEAR_CLAMP
    };
    /// The nearest texel of level 0, and zero outside: infinitely far in reverse-Z.
    pub const SHADOW_DEPTH: Self = Self {
        wrap: [vk::SamplerAddressMode::CLAMP_TO_BORDER; 2],
        ..Self::NEAREST_CLAMP
    };
    /// Linear in level 0, clamped to the edge.
    pub const LINEAR_CLAMP: Self = Self {
        mip: vk::SamplerMipmapMode::NEAREST,
        max_lod: 0.0,
        ..Self::TRILINEAR_CLAMP
    };
    /// The nearest texel of level 0, clamped to the edge.
    pub const NEAREST_CLAMP: Self = Self {
        mag: vk::Filter::NEAREST,
        min: vk::Filter::NEAREST,
        ..Self::LINEAR_CLAMP
    };
}

/// A sampler.
pub struct Sampler {
    shared: Arc<Shared>,
    pub(super) raw: vk::Sampler,
}

impl Sampler {
    /// Creates a sampler.
    pub fn new(gpu: &Gpu, name: &str, desc: &SamplerDesc) -> GpuResult<Self> {
        let shared = &gpu.shared;
        let info = vk::SamplerCreateInfo::default()
            .mag_filter(desc.mag)
            .min_filter(desc.min)
            .mipmap_mode(desc.mip)
            .max_lod(desc.max_lod)
            .address_mode_u(desc.wrap[0])
            .address_mode_v(desc.wrap[1])
            .address_mode_w(vk::SamplerAddressMode::CLAMP_TO_EDGE)
            .border_color(vk::BorderColor::FLOAT_TRANSPARENT_BLACK)
            .compare_enable(desc.compare.is_some())
            .compare_op(desc.compare.unwrap_or_default())
            .anisotropy_enable(desc.anisotropy && shared.anisotropy)
            .max_anisotropy(MAX_ANISOTROPY.min(shared.limits.max_sampler_anisotropy));
        // SAFETY: the device is alive, and anisotropy is enabled only where it has it.
        let raw = unsafe { shared.device.create_sampler(&info, None) }
            .map_err(GpuError::of("vkCreateSampler"))?;
        shared.set_name(raw, name);
        Ok(Self {
            shared: shared.clone(),
            raw,
        })
    }
}

impl Drop for Sampler {
    fn drop(&mut self) {
        self.shared.discard(Garbage::Sampler(self.raw));
    }
}
