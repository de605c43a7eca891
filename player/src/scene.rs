//! Copies a package to the GPU, and checks every record that the GPU will follow on the way.

mod merge;
mod segments;
mod textures;
pub mod trace;
mod transcode;

use cairn_format::gpu::{Instance, Material};
use cairn_format::scene::natives;
use cairn_format::{Aabb, Package, SectionKind, Vertex, check};

use crate::PlayerError;
use crate::gpu::{
    Buffer, BufferDesc, DescriptorSet, Gpu, GpuResult, Layouts, Memory, SetIndex, UploadStats,
    Uploader, vk,
};
use crate::lights::SceneLights;
use segments::Segments;
use textures::Textures;

/// Bytes of the buffer that stands for a section the package does not have: at least one record of every kind.
const DUMMY_BYTES: usize = 256;

/// A package on the GPU. What the package does not have is not created.
pub struct GpuScene {
    /// Vertex arena; absent where there is nothing to draw.
    pub vertices: Option<Buffer>,
    /// Index arena; absent where there is nothing to draw.
    pub indices: Option<Buffer>,
    /// Instance records; a dummy where the package has none, as the next two.
    pub instances: Buffer,
    /// Material records.
    pub materials: Buffer,
    /// The directional lights to choose from.
    pub lights: SceneLights,
    /// One colour per vertex of the arena; absent where the package has none.
    pub vertex_colors: Option<Buffer>,
    /// One record per 2D texture slot, the BRDF table's excepted; absent where all are the identity.
    pub texture_transforms: Option<Buffer>,
    /// Point and spot light records; absent where the package has none.
    pub punctual_lights: Option<Buffer>,
    /// Draw group records; absent where there is nothing to draw.
    pub draw_groups: Option<Buffer>,
    /// Records in `draw_groups`.
    pub draw_group_count: u32,
    /// Records in `punctual_lights`.
    pub punctual_light_count: u32,
    /// Further lobes, one record per material; absent where no material has any.
    pub material_extensions: Option<Buffer>,
    /// Layouts for this package's number of textures.
    pub layouts: Layouts,
    /// Set 1, written.
    pub bindless: DescriptorSet,
    /// 2D slot of the BRDF table.
    pub brdf_lut_slot: Option<u32>,
    /// Cube slots.
    pub environment: Option<EnvironmentSlots>,
    /// What was copied.
    pub stats: SceneStats,
    /// Keeps what `bindless` refers to.
    _textures: Textures,
}

/// Cube slots of the image-based light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EnvironmentSlots {
    /// Radiance.
    pub sky: u32,
    /// Irradiance divided by pi.
    pub irradiance: u32,
    /// GGX-prefiltered radiance.
    pub prefiltered: u32,
    /// Levels of the prefiltered chain.
    pub prefiltered_levels: u32,
    /// Cube texels times this are radiance.
    pub scale: f32,
}

/// What an upload copied, and how fast.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct SceneStats {
    /// Bytes of each kind.
    pub vertex_bytes: u64,
    pub index_bytes: u64,
    pub instance_bytes: u64,
    pub material_bytes: u64,
    pub light_bytes: u64,
    pub vertex_color_bytes: u64,
    pub texture_transform_bytes: u64,
    pub punctual_light_bytes: u64,
    pub material_extension_bytes: u64,
    pub texel_bytes: u64,
    /// Objects made.
    pub images: u32,
    pub samplers: u32,
    pub texture_slots: u32,
    pub cube_slots: u32,
    /// All bytes copied.
    pub bytes: u64,
    /// Submissions of the staging ring.
    pub submissions: u32,
    /// From the first byte to the last copy's end.
    pub seconds: f64,
    /// `bytes` over `seconds`, in units of 10^6 bytes.
    pub megabytes_per_second: f64,
}

impl GpuScene {
    /// Copies everything that rasterisation needs.
    ///
    /// # Errors
    /// `Package` for a record that breaks a rule or a file that changed, `Gpu` where the device lacks a format,
    /// a limit or memory.
    pub fn upload(gpu: &Gpu, package: &Package) -> Result<Self, PlayerError> {
        let mut uploader = Uploader::new(gpu)?;
        let mut copy = Copy {
            gpu,
            uploader: &mut uploader,
        };
        let (vertices, indices) = geometry(&mut copy, package)?;
        let instances = instances(&mut copy, package)?;
        let materials = materials(&mut copy, package)?;
        let lights = SceneLights::new(package)?;
        let vertex_colors = vertex_colors(&mut copy, package, vertices.is_some())?;
        let texture_transforms = texture_transforms(&mut copy, package)?;
        let punctual_lights = punctual_lights(&mut copy, package)?;
        let draw_groups = draw_groups(&mut copy, package)?;
        let material_extensions = material_extensions(&mut copy, package)?;
        let buffer_bytes = copy.uploader.bytes();
        let textures = Textures::upload(gpu, &mut uploader, package)?;
        let stats = SceneStats {
            texel_bytes: uploader.bytes() - buffer_bytes,
            images: textures.images.len() as u32,
            samplers: textures.samplers.len() as u32,
            ..buffer_stats(package)
        };
        let (texture_slots, cube_slots) = textures.slot_counts(package);
        let layouts = Layouts::new(gpu, texture_slots, cube_slots)?;
        let mut bindless = layouts.allocate(SetIndex::Bindless, "bindless textures")?;
        textures.bind(package, &mut bindless);
        let stats = SceneStats {
            texture_slots,
            cube_slots,
            ..with_upload(stats, uploader.finish()?)
        };
        Ok(Self {
            vertices,
            indices,
            instances,
            materials,
            lights,
            vertex_colors,
            texture_transforms,
            punctual_lights,
            draw_groups,
            draw_group_count: package.count(SectionKind::DrawGroups) as u32,
            punctual_light_count: package.count(SectionKind::PunctualLights) as u32,
            material_extensions,
            layouts,
            bindless,
            brdf_lut_slot: textures::brdf_lut_slot(package),
            environment: textures::environment_slots(package),
            stats,
            _textures: textures,
        })
    }

    /// Writes the bindings of set 0 that hold this scene, a frame's uniform and its directional lights.
    ///
    /// # Errors
    /// `Limit` where a buffer is larger than a shader may see.
    pub fn bind(
        &self,
        set: &mut DescriptorSet,
        uniform: &Buffer,
        lights: &Buffer,
    ) -> GpuResult<()> {
        set.write_buffer(0, uniform)?;
        set.write_buffer(1, lights)?;
        set.write_buffer(2, &self.materials)?;
        set.write_buffer(3, &self.instances)?;
        let optional = [
            (9, &self.texture_transforms),
            (10, &self.vertex_colors),
            (11, &self.punctual_lights),
            (12, &self.material_extensions),
        ];
        for (binding, buffer) in optional {
            if let Some(buffer) = buffer {
                set.write_buffer(binding, buffer)?;
            }
        }
        let arenas = [
            (13, &self.vertices),
            (14, &self.indices),
            (15, &self.draw_groups),
        ];
        for (binding, arena) in arenas {
            // A plan shades in compute only where all three fit.
            if let Some(arena) = arena.as_ref().filter(|arena| set.takes(arena)) {
                set.write_buffer(binding, arena)?;
            }
        }
        Ok(())
    }

    /// Whether the package has image-based light.
    pub fn has_environment(&self) -> bool {
        self.environment.is_some()
    }
}

/// World bounds of everything that a package draws.
pub fn bounds(package: &Package) -> Aabb {
    let bounds = &package.scene().bounds;
    Aabb {
        min: natives(&bounds.min).into(),
        max: natives(&bounds.max).into(),
    }
}

/// Diagonal of [`bounds`], metres; 1 where the scene has no extent.
pub fn diagonal(package: &Package) -> f32 {
    let diagonal = bounds(package).diagonal();
    if diagonal.is_finite() && diagonal > 0.0 {
        diagonal
    } else {
        1.0
    }
}

impl std::fmt::Display for SceneStats {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "{:.1} MB in {:.1} ms ({:.0} MB/s): {} images, {} samplers",
            self.bytes as f64 / 1e6,
            self.seconds * 1e3,
            self.megabytes_per_second,
            self.images,
            self.samplers
        )
    }
}

/// Where copies go.
struct Copy<'a> {
    gpu: &'a Gpu,
    uploader: &'a mut Uploader,
}

impl Copy<'_> {
    /// A device buffer with `bytes`, which are records of `record` bytes, checked as they are copied.
    fn buffer(
        &mut self,
        name: &str,
        usage: vk::BufferUsageFlags,
        bytes: &[u8],
        record: usize,
        check: impl FnMut(&[u8], u64) -> Result<(), PlayerError>,
    ) -> Result<Buffer, PlayerError> {
        let buffer = self.allocate(name, usage, bytes.len() as u64)?;
        self.uploader.upload_buffer(&buffer, bytes, record, check)?;
        Ok(buffer)
    }

    /// A storage buffer, of zeros where there are no records.
    fn storage(
        &mut self,
        kind: SectionKind,
        bytes: &[u8],
        check: impl FnMut(&[u8], u64) -> Result<(), PlayerError>,
    ) -> Result<Buffer, PlayerError> {
        let usage = vk::BufferUsageFlags::STORAGE_BUFFER;
        if bytes.is_empty() {
            let zeros = [0; DUMMY_BYTES];
            let unchecked = |_: &[u8], _| Ok(());
            return self.buffer(kind.name(), usage, &zeros, DUMMY_BYTES, unchecked);
        }
        self.buffer(kind.name(), usage, bytes, kind.stride() as usize, check)
    }

    /// A storage buffer; none where there are no records, or where they are not `wanted`.
    fn optional(
        &mut self,
        kind: SectionKind,
        bytes: &[u8],
        wanted: bool,
        check: impl FnMut(&[u8], u64) -> Result<(), PlayerError>,
    ) -> Result<Option<Buffer>, PlayerError> {
        if bytes.is_empty() || !wanted {
            return Ok(None);
        }
        self.storage(kind, bytes, check).map(Some)
    }

    fn allocate(&self, name: &str, usage: vk::BufferUsageFlags, size: u64) -> GpuResult<Buffer> {
        let desc = BufferDesc {
            name,
            size,
            usage: usage | vk::BufferUsageFlags::TRANSFER_DST,
            memory: Memory::Device,
        };
        Buffer::new(self.gpu, &desc)
    }
}

type Geometry = (Option<Buffer>, Option<Buffer>);

/// Vertex and index arenas; neither where one is missing.
fn geometry(copy: &mut Copy<'_>, package: &Package) -> Result<Geometry, PlayerError> {
    let vertices: &[u8] = bytemuck::cast_slice(package.vertices()?);
    let indices: &[u8] = bytemuck::cast_slice(package.indices()?);
    if vertices.is_empty() || indices.is_empty() {
        return Ok((None, None));
    }
    let check_vertices = |bytes: &[u8], offset| {
        let first = offset as usize / size_of::<Vertex>();
        Ok(check::vertices(bytemuck::cast_slice(bytes), first)?)
    };
    let traced = traced_usage(copy.gpu);
    let usage = vk::BufferUsageFlags::VERTEX_BUFFER | traced | vk::BufferUsageFlags::STORAGE_BUFFER;
    let record = size_of::<Vertex>();
    let vertices = copy.buffer("vertices", usage, vertices, record, check_vertices)?;
    let mut segments = Segments::new(package);
    let check_indices =
        |bytes: &[u8], offset| Ok(segments.check(bytemuck::cast_slice(bytes), offset / 4)?);
    let usage = vk::BufferUsageFlags::INDEX_BUFFER | traced | vk::BufferUsageFlags::STORAGE_BUFFER;
    let indices = copy.buffer("indices", usage, indices, 4, check_indices)?;
    Ok((Some(vertices), Some(indices)))
}

/// What acceleration structures ask of vertices and indices.
fn traced_usage(gpu: &Gpu) -> vk::BufferUsageFlags {
    if gpu.traces_rays() {
        vk::BufferUsageFlags::SHADER_DEVICE_ADDRESS
            | vk::BufferUsageFlags::ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_KHR
    } else {
        vk::BufferUsageFlags::empty()
    }
}

fn instances(copy: &mut Copy<'_>, package: &Package) -> Result<Buffer, PlayerError> {
    let materials = package.count(SectionKind::Materials) as u32;
    let bytes = bytemuck::cast_slice(package.instances()?);
    copy.storage(SectionKind::Instances, bytes, |bytes, offset| {
        let first = offset as usize / size_of::<Instance>();
        let records = bytemuck::cast_slice(bytes);
        Ok(check::instances(records, first, materials)?)
    })
}

fn materials(copy: &mut Copy<'_>, package: &Package) -> Result<Buffer, PlayerError> {
    let textures = package.scene().textures.len();
    let bytes = bytemuck::cast_slice(package.materials()?);
    copy.storage(SectionKind::Materials, bytes, |bytes, _| {
        let records: &[Material] = bytemuck::cast_slice(bytes);
        Ok(check::materials(records, textures)?)
    })
}

/// Any bits are a colour, so nothing is checked; that the section has one for each vertex was when it was opened.
fn vertex_colors(
    copy: &mut Copy<'_>,
    package: &Package,
    drawn: bool,
) -> Result<Option<Buffer>, PlayerError> {
    let bytes = bytemuck::cast_slice(package.vertex_colors()?);
    copy.optional(SectionKind::VertexColors, bytes, drawn, |_, _| Ok(()))
}

/// That the section has one transform for each slot was checked when it was opened.
fn texture_transforms(
    copy: &mut Copy<'_>,
    package: &Package,
) -> Result<Option<Buffer>, PlayerError> {
    let kind = SectionKind::TextureTransforms;
    let bytes = bytemuck::cast_slice(package.texture_transforms()?);
    copy.optional(kind, bytes, true, |bytes, _| {
        Ok(check::texture_transforms(bytemuck::cast_slice(bytes))?)
    })
}

/// That every group is in range was checked when the package was opened.
fn draw_groups(copy: &mut Copy<'_>, package: &Package) -> Result<Option<Buffer>, PlayerError> {
    let bytes = bytemuck::cast_slice(package.draw_groups()?);
    copy.optional(SectionKind::DrawGroups, bytes, true, |_, _| Ok(()))
}

fn punctual_lights(copy: &mut Copy<'_>, package: &Package) -> Result<Option<Buffer>, PlayerError> {
    let kind = SectionKind::PunctualLights;
    let bytes = bytemuck::cast_slice(package.punctual_lights()?);
    copy.optional(kind, bytes, true, |bytes, _| {
        Ok(check::punctual_lights(bytemuck::cast_slice(bytes))?)
    })
}

/// That the section has one record for each material was checked when it was opened.
fn material_extensions(
    copy: &mut Copy<'_>,
    package: &Package,
) -> Result<Option<Buffer>, PlayerError> {
    let kind = SectionKind::MaterialExtensions;
    let textures = package.scene().textures.len();
    let bytes = bytemuck::cast_slice(package.material_extensions()?);
    copy.optional(kind, bytes, true, |bytes, _| {
        Ok(check::material_extensions(
            bytemuck::cast_slice(bytes),
            textures,
        )?)
    })
}

fn buffer_stats(package: &Package) -> SceneStats {
    let bytes = |kind: SectionKind| package.count(kind) * u64::from(kind.stride());
    SceneStats {
        vertex_bytes: bytes(SectionKind::Vertices),
        index_bytes: bytes(SectionKind::Indices),
        instance_bytes: bytes(SectionKind::Instances),
        material_bytes: bytes(SectionKind::Materials),
        light_bytes: bytes(SectionKind::DirectionalLights),
        vertex_color_bytes: bytes(SectionKind::VertexColors),
        texture_transform_bytes: bytes(SectionKind::TextureTransforms),
        punctual_light_bytes: bytes(SectionKind::PunctualLights),
        material_extension_bytes: bytes(SectionKind::MaterialExtensions),
        ..SceneStats::default()
    }
}

fn with_upload(stats: SceneStats, upload: UploadStats) -> SceneStats {
    SceneStats {
        bytes: upload.bytes,
        submissions: upload.submissions,
        seconds: upload.seconds,
        megabytes_per_second: upload.bytes as f64 / 1e6 / upload.seconds.max(1e-9),
        ..stats
    }
}

#[cfg(test)]
mod tests;
