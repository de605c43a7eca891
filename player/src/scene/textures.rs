//! Images, samplers and their bindless slots.

use cairn_format::scene::{
    ArchivedImage, ArchivedMipFilter, ArchivedSampler, ArchivedSwizzle, ArchivedWrap,
};
use cairn_format::{Error, Package, Part, SectionKind, TextureFormat};

use super::EnvironmentSlots;
use super::transcode::Target;
use crate::PlayerError;
use crate::gpu::{
    DescriptorSet, Gpu, GpuResult, Image, ImageDesc, Sampler, SamplerDesc, Uploader, vk,
};

/// Bindings of set 1.
const BINDING_2D: u32 = 0;
const BINDING_CUBE: u32 = 1;

/// Cube slots, in the order of [`EnvironmentSlots`].
const CUBE_SLOTS: u32 = 3;

/// Every image of a package, and the samplers that read them.
pub(super) struct Textures {
    /// As in the package.
    pub(super) images: Vec<Image>,
    /// Distinct samplers.
    pub(super) samplers: Vec<Sampler>,
    /// Index into `samplers` of each of the package's.
    sampler_of: Vec<usize>,
    /// Reads the BRDF table; only where there is one.
    linear_clamp: Option<Sampler>,
    /// Reads the cubes; only where there are any.
    trilinear_clamp: Option<Sampler>,
}

impl Textures {
    pub(super) fn upload(
        gpu: &Gpu,
        uploader: &mut Uploader,
        package: &Package,
    ) -> Result<Self, PlayerError> {
        let scene = package.scene();
        let texels = package.texels()?;
        check_texel_bytes(package)?;
        let mut images = Vec::with_capacity(scene.images.len());
        for image in scene.images.iter() {
            images.push(upload_image(gpu, uploader, image, texels)?);
        }
        let (samplers, sampler_of) = samplers(gpu, package)?;
        let lut = scene.brdf_lut.as_ref();
        let linear = lut.map(|_| Sampler::new(gpu, "linear clamp", &SamplerDesc::LINEAR_CLAMP));
        let cubes = scene.environment.as_ref();
        let trilinear =
            cubes.map(|_| Sampler::new(gpu, "trilinear clamp", &SamplerDesc::TRILINEAR_CLAMP));
        Ok(Self {
            images,
            samplers,
            sampler_of,
            linear_clamp: linear.transpose()?,
            trilinear_clamp: trilinear.transpose()?,
        })
    }

    /// 2D and cube slots.
    pub(super) fn slot_counts(&self, package: &Package) -> (u32, u32) {
        let scene = package.scene();
        let lut = u32::from(scene.brdf_lut.is_some());
        let cubes = if scene.environment.is_some() {
            CUBE_SLOTS
        } else {
            0
        };
        (scene.textures.len() as u32 + lut, cubes)
    }

    /// Writes every slot of set 1.
    pub(super) fn bind(&self, package: &Package, set: &mut DescriptorSet) {
        let scene = package.scene();
        // Indices of the root were checked when the package was opened.
        let image = |index: u32| self.images[index as usize].view();
        for (slot, texture) in (0..).zip(scene.textures.iter()) {
            let sampler = self.sampler_of[texture.sampler.to_native() as usize];
            let sampler = &self.samplers[sampler];
            set.write_image(BINDING_2D, slot, image(texture.image.to_native()), sampler);
        }
        let lut = scene.brdf_lut.as_ref().zip(brdf_lut_slot(package));
        if let (Some((lut, slot)), Some(sampler)) = (lut, &self.linear_clamp) {
            set.write_image(BINDING_2D, slot, image(lut.to_native()), sampler);
        }
        let cubes = scene.environment.as_ref().zip(environment_slots(package));
        if let (Some((cubes, slots)), Some(sampler)) = (cubes, &self.trilinear_clamp) {
            let sky = image(cubes.sky.to_native());
            set.write_image(BINDING_CUBE, slots.sky, sky, sampler);
            let irradiance = image(cubes.irradiance.to_native());
            set.write_image(BINDING_CUBE, slots.irradiance, irradiance, sampler);
            let prefiltered = image(cubes.prefiltered.to_native());
            set.write_image(BINDING_CUBE, slots.prefiltered, prefiltered, sampler);
        }
    }
}

/// The slot behind the package's textures.
pub(super) fn brdf_lut_slot(package: &Package) -> Option<u32> {
    let scene = package.scene();
    let textures = scene.textures.len() as u32;
    scene.brdf_lut.as_ref().map(|_| textures)
}

/// The first three cube slots.
pub(super) fn environment_slots(package: &Package) -> Option<EnvironmentSlots> {
    let scene = package.scene();
    let environment = scene.environment.as_ref()?;
    let prefiltered = scene
        .images
        .get(environment.prefiltered.to_native() as usize)?;
    Some(EnvironmentSlots {
        sky: 0,
        irradiance: 1,
        prefiltered: 2,
        prefiltered_levels: prefiltered.levels.len() as u32,
        scale: environment.scale.to_native(),
    })
}

/// Images that share texels could ask for any amount of GPU memory.
fn check_texel_bytes(package: &Package) -> Result<(), PlayerError> {
    let levels = package
        .scene()
        .images
        .iter()
        .flat_map(|image| image.levels.iter());
    let mut total = 0u64;
    for level in levels {
        total = total.saturating_add(level.length.to_native());
    }
    let stored = package.count(SectionKind::Texels);
    if total > stored {
        let what = format!("images of {total} bytes share {stored} bytes");
        return Err(Error::corrupt(Part::Section(SectionKind::Texels), 0, what).into());
    }
    Ok(())
}

fn upload_image(
    gpu: &Gpu,
    uploader: &mut Uploader,
    image: &ArchivedImage,
    texels: &[u8],
) -> Result<Image, PlayerError> {
    let format = image.format.native();
    let layers = image.layers.to_native();
    let target = Target::of(gpu.blocks());
    let desc = ImageDesc {
        name: &image.name,
        format: if format.is_universal() {
            target.vulkan(format.is_srgb())
        } else {
            vulkan_format(format)
        },
        extent: [image.width.to_native(), image.height.to_native()],
        levels: image.levels.len() as u32,
        layers,
        cube: layers == 6,
        array: false,
        samples: 1,
        usage: vk::ImageUsageFlags::SAMPLED | vk::ImageUsageFlags::TRANSFER_DST,
    };
    let device_image = Image::with_components(gpu, &desc, components(&image.swizzle))?;
    // Ranges and lengths of levels were checked when the package was opened.
    let levels = image.levels.iter().map(|level| {
        let start = level.offset.to_native() as usize;
        &texels[start..start + level.length.to_native() as usize]
    });
    if !format.is_universal() {
        uploader.upload_image(&device_image, format, levels)?;
        return Ok(device_image);
    }
    let transcode = |stored: &[u8], staged: &mut [u8], extent| {
        let done = target.transcode(stored, staged, extent, format.is_srgb());
        done.map_err(|block| {
            let what = format!("image `{}`: block {block} is not UASTC", image.name);
            PlayerError::from(Error::corrupt(Part::Section(SectionKind::Texels), 0, what))
        })
    };
    uploader.convert_image(&device_image, [format, target.layout()], levels, transcode)?;
    Ok(device_image)
}

fn components(swizzle: &[ArchivedSwizzle; 4]) -> vk::ComponentMapping {
    let [r, g, b, a] = swizzle.map(|channel| match channel {
        ArchivedSwizzle::Red => vk::ComponentSwizzle::R,
        ArchivedSwizzle::Green => vk::ComponentSwizzle::G,
        ArchivedSwizzle::Blue => vk::ComponentSwizzle::B,
        ArchivedSwizzle::Alpha => vk::ComponentSwizzle::A,
        ArchivedSwizzle::Zero => vk::ComponentSwizzle::ZERO,
        ArchivedSwizzle::One => vk::ComponentSwizzle::ONE,
    });
    vk::ComponentMapping { r, g, b, a }
}

/// One sampler for each distinct description: a file may repeat them, and devices have few.
fn samplers(gpu: &Gpu, package: &Package) -> GpuResult<(Vec<Sampler>, Vec<usize>)> {
    let mut descs: Vec<SamplerDesc> = Vec::new();
    let mut indices = Vec::new();
    for sampler in package.scene().samplers.iter() {
        let desc = sampler_desc(sampler);
        let known = descs.iter().position(|other| *other == desc);
        indices.push(known.unwrap_or_else(|| {
            descs.push(desc);
            descs.len() - 1
        }));
    }
    let samplers: GpuResult<Vec<Sampler>> = descs
        .iter()
        .map(|desc| Sampler::new(gpu, "texture", desc))
        .collect();
    Ok((samplers?, indices))
}

fn sampler_desc(sampler: &ArchivedSampler) -> SamplerDesc {
    let filter = |linear| {
        if linear {
            vk::Filter::LINEAR
        } else {
            vk::Filter::NEAREST
        }
    };
    let (mip, max_lod) = match sampler.mip {
        // A quarter keeps the choice between both filters, yet rounds to level 0.
        ArchivedMipFilter::None => (vk::SamplerMipmapMode::NEAREST, 0.25),
        ArchivedMipFilter::Nearest => (vk::SamplerMipmapMode::NEAREST, vk::LOD_CLAMP_NONE),
        ArchivedMipFilter::Linear => (vk::SamplerMipmapMode::LINEAR, vk::LOD_CLAMP_NONE),
    };
    SamplerDesc {
        mag: filter(sampler.mag_linear),
        min: filter(sampler.min_linear),
        mip,
        max_lod,
        wrap: [address_mode(sampler.wrap_u), address_mode(sampler.wrap_v)],
        // Anisotropic filtering is linear: where the file asks for texels, it gets texels.
        anisotropy: sampler.min_linear
            && sampler.mag_linear
            && sampler.mip == ArchivedMipFilter::Linear,
        compare: None,
    }
}

fn address_mode(wrap: ArchivedWrap) -> vk::SamplerAddressMode {
    match wrap {
        ArchivedWrap::Repeat => vk::SamplerAddressMode::REPEAT,
        ArchivedWrap::MirroredRepeat => vk::SamplerAddressMode::MIRRORED_REPEAT,
        ArchivedWrap::ClampToEdge => vk::SamplerAddressMode::CLAMP_TO_EDGE,
    }
}

/// The Vulkan format of a package's format.
fn vulkan_format(format: TextureFormat) -> vk::Format {
    match format {
        TextureFormat::Bc7Unorm => vk::Format::BC7_UNORM_BLOCK,
        TextureFormat::Bc7Srgb => vk::Format::BC7_SRGB_BLOCK,
        TextureFormat::Bc5Unorm => vk::Format::BC5_UNORM_BLOCK,
        TextureFormat::Bc4Unorm => vk::Format::BC4_UNORM_BLOCK,
        TextureFormat::Bc6hUfloat => vk::Format::BC6H_UFLOAT_BLOCK,
        TextureFormat::Rgba8Unorm => vk::Format::R8G8B8A8_UNORM,
        TextureFormat::Rgba8Srgb => vk::Format::R8G8B8A8_SRGB,
        TextureFormat::Rgba16Float => vk::Format::R16G16B16A16_SFLOAT,
        TextureFormat::Rgb9e5Ufloat => vk::Format::E5B9G9R9_UFLOAT_PACK32,
        TextureFormat::Rgba16Unorm => vk::Format::R16G16B16A16_UNORM,
        TextureFormat::UastcUnorm | TextureFormat::UastcSrgb => {
            unreachable!("universal blocks are transcoded")
        }
    }
}
