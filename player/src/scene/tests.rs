//! Uploads of small packages on a real device, under validation.

use cairn_format::brdf_table::BRDF_TABLE_SIZE;
use cairn_format::gpu::{DirectionalLight, Instance, Material, TextureTransform, VertexColor};
use cairn_format::scene::{
    Bounds, Environment, Image, ImageRole, Level, MaterialInfo, MipFilter, Primitive, Sampler,
    Scene, Texture, Wrap,
};
use cairn_format::{Error, Package, Part, SectionKind, TextureFormat, Vertex, Writer, bounds};

use super::*;
use crate::gpu::test_support::{close_clean, gpu};
use crate::gpu::{AllowedBlocks, GpuError, GpuOptions};
use crate::settings::Settings;

/// Sections of a package under construction.
struct Parts {
    scene: Scene,
    vertices: Vec<Vertex>,
    indices: Vec<u32>,
    instances: Vec<Instance>,
    materials: Vec<Material>,
    lights: Vec<DirectionalLight>,
    texels: Vec<u8>,
    transforms: Vec<TextureTransform>,
    colors: Vec<VertexColor>,
}

impl Parts {
    fn empty() -> Self {
        Self {
            scene: Scene::empty("test"),
            vertices: Vec::new(),
            indices: Vec::new(),
            instances: Vec::new(),
            materials: Vec::new(),
            lights: Vec::new(),
            texels: Vec::new(),
            transforms: Vec::new(),
            colors: Vec::new(),
        }
    }

    /// One triangle with one material and one instance.
    fn triangle() -> Self {
        let mut parts = Self::empty();
        parts.vertices = vec![<Vertex as bytemuck::Zeroable>::zeroed(); 3];
        parts.indices = vec![0, 1, 2];
        parts.instances = vec![<Instance as bytemuck::Zeroable>::zeroed()];
        parts.materials = vec![Material::default()];
        parts.scene.materials = vec![MaterialInfo { name: "m".into() }];
        parts.scene.primitives = vec![Primitive {
            first_index: 0,
            index_count: 3,
            traced_index_count: 3,
            opaque: true,
            first_vertex: 0,
            vertex_count: 3,
            material: 0,
            bounds: Bounds::ZERO,
        }];
        parts
    }

    /// A triangle with a colour per vertex and one transformed texture.
    fn with_optional_sections() -> Self {
        let mut parts = Self::triangle();
        let image = parts.image(TextureFormat::Rgba8Unorm, 4, 1);
        parts.scene.textures = vec![Texture { image, sampler: 0 }];
        parts.scene.samplers = vec![sampler(MipFilter::Linear)];
        parts.transforms = vec![<TextureTransform as bytemuck::Zeroable>::zeroed()];
        parts.colors = vec![<VertexColor as bytemuck::Zeroable>::zeroed(); 3];
        parts
    }

    /// Adds an image with a full chain of texels.
    fn image(&mut self, format: TextureFormat, size: u32, layers: u32) -> u32 {
        let count = cairn_format::texture::full_mip_count(size, size);
        let levels = (0..count).map(|level| {
            let size = cairn_format::texture::mip_extent(size, level);
            let length = format.level_bytes(size, size) * u64::from(layers);
            let offset = self.texels.len().next_multiple_of(16);
            self.texels.resize(offset + length as usize, 0x5a);
            Level {
                offset: offset as u64,
                length,
            }
        });
        let levels = levels.collect();
        self.scene.images.push(Image {
            name: format!("image {}", self.scene.images.len()),
            role: ImageRole::Color,
            format,
            swizzle: cairn_format::scene::IDENTITY_SWIZZLE,
            width: size,
            height: size,
            layers,
            levels,
        });
        self.scene.images.len() as u32 - 1
    }

    fn package(&self) -> Package {
        let mut writer = Writer::new();
        let boxes = vec![
            cairn_format::Aabb {
                min: glam::Vec3::ZERO,
                max: glam::Vec3::ZERO,
            };
            self.instances.len()
        ];
        let boxes = bounds::to_arrays(&boxes);
        writer
            .records(SectionKind::Vertices, &self.vertices)
            .bytes(
                SectionKind::Indices,
                bytemuck::cast_slice::<_, u8>(&self.indices),
            )
            .records(SectionKind::Instances, &self.instances)
            .bytes(
                SectionKind::InstanceBounds,
                bytemuck::cast_slice::<_, u8>(&boxes),
            )
            .records(SectionKind::Materials, &self.materials)
            .records(SectionKind::DirectionalLights, &self.lights)
            .bytes(SectionKind::Texels, self.texels.as_slice())
            .records(SectionKind::TextureTransforms, &self.transforms)
            .records(SectionKind::VertexColors, &self.colors);
        let bytes = writer.to_vec(&self.scene, "test").expect("written");
        Package::from_bytes(&bytes).expect("opens")
    }
}

fn sampler(mip: MipFilter) -> Sampler {
    Sampler {
        mag_linear: true,
        min_linear: true,
        mip,
        wrap_u: Wrap::Repeat,
        wrap_v: Wrap::MirroredRepeat,
    }
}

#[test]
fn a_package_of_nothing_gets_dummies_and_the_fallback_light() {
    let Some(gpu) = gpu() else { return };
    let scene = GpuScene::upload(&gpu, &Parts::empty().package()).expect("uploads");
    assert!(scene.vertices.is_none() && scene.indices.is_none());
    assert!(!scene.has_environment() && scene.brdf_lut_slot.is_none());
    let (lights, casts) = scene.lights.count(&Settings::default());
    assert_eq!((lights, casts), (1, true));
    assert_eq!((scene.stats.images, scene.stats.samplers), (0, 0));
    drop(scene);
    close_clean(gpu);
}

#[test]
fn every_part_of_a_package_gets_its_slot() {
    let Some(gpu) = gpu() else { return };
    let mut parts = Parts::triangle();
    let formats = [
        TextureFormat::Bc7Unorm,
        TextureFormat::Bc7Srgb,
        TextureFormat::Bc5Unorm,
        TextureFormat::Bc4Unorm,
        TextureFormat::Rgba8Unorm,
        TextureFormat::Rgba8Srgb,
        TextureFormat::Rgba16Float,
        TextureFormat::Rgb9e5Ufloat,
        TextureFormat::Rgba16Unorm,
    ];
    for (index, format) in formats.into_iter().enumerate() {
        let image = parts.image(format, 20, 1);
        parts.scene.textures.push(Texture {
            image,
            sampler: index as u32 % 3,
        });
    }
    let mips = [MipFilter::Linear, MipFilter::None, MipFilter::Linear];
    parts.scene.samplers = mips.map(sampler).to_vec();
    let cube = |parts: &mut Parts, size| parts.image(TextureFormat::Bc6hUfloat, size, 6);
    parts.scene.environment = Some(Environment {
        sky: cube(&mut parts, 16),
        irradiance: cube(&mut parts, 4),
        prefiltered: cube(&mut parts, 8),
        prefiltered_roughness: (0..4).map(|level| level as f32 / 3.0).collect(),
        scale: 2.0,
        sun: None,
        irradiance_sh: [[0.0; 3]; 9],
        source_width: 64,
        source_height: 32,
        replaced_texels: 0,
        clamped_texels: 0,
    });
    parts.scene.brdf_lut = Some(parts.image(TextureFormat::Rgba16Unorm, BRDF_TABLE_SIZE, 1));
    let scene = GpuScene::upload(&gpu, &parts.package()).expect("uploads");
    assert!(scene.vertices.is_some() && scene.indices.is_some());
    assert_eq!(scene.brdf_lut_slot, Some(9));
    let slots = EnvironmentSlots {
        sky: 0,
        irradiance: 1,
        prefiltered: 2,
        prefiltered_levels: 4,
        scale: 2.0,
    };
    assert_eq!(scene.environment, Some(slots));
    assert_eq!(
        scene.lights.count(&Settings::default()),
        (0, false),
        "an environment replaces the fallback light"
    );
    assert_eq!((scene.stats.images, scene.stats.samplers), (13, 2));
    assert_eq!((scene.stats.texture_slots, scene.stats.cube_slots), (10, 3));
    drop(scene);
    close_clean(gpu);
}

#[test]
fn optional_sections_become_buffers_where_they_are_drawn() {
    let Some(gpu) = gpu() else { return };
    let mut parts = Parts::with_optional_sections();
    let scene = GpuScene::upload(&gpu, &parts.package()).expect("uploads");
    let sizes = [&scene.vertex_colors, &scene.texture_transforms];
    assert_eq!(
        sizes.map(|buffer| buffer.as_ref().map(Buffer::size)),
        [Some(24), Some(32)]
    );
    let stats = &scene.stats;
    assert_eq!(
        (stats.vertex_color_bytes, stats.texture_transform_bytes),
        (24, 32)
    );
    parts.indices.clear();
    parts.scene.primitives.clear();
    let scene = GpuScene::upload(&gpu, &parts.package()).expect("uploads");
    assert!(scene.vertices.is_none() && scene.vertex_colors.is_none());
    drop(scene);
    let scene = GpuScene::upload(&gpu, &Parts::triangle().package()).expect("uploads");
    assert!(scene.vertex_colors.is_none() && scene.texture_transforms.is_none());
    drop(scene);
    gpu.wait_idle().expect("idle");
    close_clean(gpu);
}

fn refused(parts: &Parts, part: SectionKind) {
    let Some(gpu) = gpu() else { return };
    match GpuScene::upload(&gpu, &parts.package()).err() {
        Some(PlayerError::Package(Error::Corrupt { part: found, .. })) => {
            assert_eq!(found, Part::Section(part));
        }
        other => panic!("{other:?}"),
    }
    gpu.wait_idle().expect("idle");
    close_clean(gpu);
}

#[test]
fn an_index_beyond_its_primitive_is_refused() {
    let mut parts = Parts::triangle();
    parts.indices[1] = 3;
    refused(&parts, SectionKind::Indices);
}

#[test]
fn a_vertex_that_is_not_finite_is_refused() {
    let mut parts = Parts::triangle();
    parts.vertices[2].uv1[1] = f32::NAN;
    refused(&parts, SectionKind::Vertices);
}

#[test]
fn an_instance_of_no_material_is_refused() {
    let mut parts = Parts::triangle();
    parts.instances[0].material_index = 1;
    refused(&parts, SectionKind::Instances);
}

#[test]
fn a_light_that_is_not_finite_is_refused() {
    let mut parts = Parts::triangle();
    let light = DirectionalLight {
        direction_and_intensity: [0.0, -1.0, 0.0, 3.0],
        color_and_shadow: [1.0; 4],
    };
    parts.lights = vec![light; 2];
    parts.lights[1].color_and_shadow[0] = f32::INFINITY;
    refused(&parts, SectionKind::DirectionalLights);
}

#[test]
fn a_texture_transform_that_is_not_finite_is_refused() {
    let mut parts = Parts::with_optional_sections();
    parts.transforms[0].offset[1] = f32::NAN;
    refused(&parts, SectionKind::TextureTransforms);
}

#[test]
fn images_that_share_texels_are_refused() {
    let mut parts = Parts::empty();
    parts.image(TextureFormat::Rgba8Unorm, 64, 1);
    let copy = parts.scene.images[0].clone();
    parts.scene.images.push(copy);
    refused(&parts, SectionKind::Texels);
}

/// A device that may use `blocks` alone.
fn gpu_with(blocks: AllowedBlocks) -> Gpu {
    let options = GpuOptions {
        validation: true,
        blocks,
        ..GpuOptions::default()
    };
    Gpu::new(&options).expect("a device")
}

/// Sampled by what the device has: 16 bytes a block of the 20 x 20 chain, or 4 bytes a texel.
#[test]
fn universal_blocks_upload_on_any_device() {
    if gpu().is_none() {
        return;
    }
    let mut parts = Parts::triangle();
    let image = parts.image(TextureFormat::UastcSrgb, 20, 1);
    let image2 = parts.image(TextureFormat::UastcUnorm, 20, 1);
    use cairn_format::scene::Swizzle::{Alpha, One, Red, Zero};
    parts.scene.images[1].swizzle = [Red, Alpha, Zero, One];
    parts.scene.textures = [image, image2]
        .map(|image| Texture { image, sampler: 0 })
        .to_vec();
    parts.scene.samplers = vec![sampler(MipFilter::Linear)];
    for blocks in [AllowedBlocks::All, AllowedBlocks::Astc, AllowedBlocks::None] {
        let gpu = gpu_with(blocks);
        let has = gpu.blocks();
        let scene = GpuScene::upload(&gpu, &parts.package()).expect("uploads");
        let chain = if has.bc || has.astc {
            16 * (25 + 9 + 4 + 1 + 1)
        } else {
            4 * (400 + 100 + 25 + 4 + 1)
        };
        assert_eq!(scene.stats.texel_bytes, 2 * chain, "{blocks:?}: {has:?}");
        assert!(blocks != AllowedBlocks::None || has == Default::default());
        assert!(blocks != AllowedBlocks::Astc || !has.bc);
        drop(scene);
        close_clean(gpu);
    }
    // A reserved mode.
    parts.texels.fill(0x45);
    refused(&parts, SectionKind::Texels);
}

#[test]
fn a_device_without_bc_refuses_bc_and_says_what_to_bake() {
    if gpu().is_none() {
        return;
    }
    let gpu = gpu_with(AllowedBlocks::None);
    let mut parts = Parts::triangle();
    parts.image(TextureFormat::Bc7Srgb, 20, 1);
    match GpuScene::upload(&gpu, &parts.package()).err() {
        Some(PlayerError::Gpu(error @ GpuError::NoBlocks { family: "BC", .. })) => {
            let text = error.to_string();
            assert!(
                text.contains("--target portable") && text.contains("image 0"),
                "{text}"
            );
        }
        other => panic!("{other:?}"),
    }
    gpu.wait_idle().expect("idle");
    close_clean(gpu);
}

/// The view has the stored levels only, so that no lookup reaches past the last.
#[test]
fn chains_may_end_early() {
    let Some(gpu) = gpu() else { return };
    let mut parts = Parts::triangle();
    let image = parts.image(TextureFormat::Bc7Srgb, 64, 1);
    parts.scene.images[0].levels.truncate(3);
    parts.scene.textures = vec![Texture { image, sampler: 0 }];
    parts.scene.samplers = vec![sampler(MipFilter::Linear)];
    let scene = GpuScene::upload(&gpu, &parts.package()).expect("uploads");
    assert_eq!(scene._textures.images[0].levels(), 3);
    assert_eq!(scene.stats.texel_bytes, 16 * (256 + 64 + 16));
    drop(scene);
    close_clean(gpu);
}
