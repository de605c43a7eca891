//! Every validation rule of a package, one function each.

mod bulk;
mod environment;

use std::ops::Range;

use crate::bounds::{CLUSTER, padded};
use crate::error::{Error, Part, Result};
use crate::gpu::{
    ALPHA_BLEND, DRAW_DOUBLE_SIDED, DRAW_MIRRORED, DrawGroup, LOBE_CLEARCOAT, LOBE_SHEEN,
    LOBE_SPECULAR, MATERIAL_DOUBLE_SIDED, MATERIAL_UNLIT, Material, MaterialExtension, NO_TEXTURE,
    PunctualLight, TEXTURE_UV1,
};
use crate::header::{
    ALIGNMENT, ENTRY_BYTES, FORMAT_VERSION, HEADER_BYTES, Header, MAGIC, PAGE, SectionEntry,
    align_up,
};
use crate::package::Package;
use crate::scene::{ArchivedBounds, ArchivedImage, ArchivedPrimitive, ArchivedScene, natives};
use crate::section::SectionKind;
use crate::texture::{full_mip_count, mip_extent};

pub(crate) use bulk::{bulk, hashes_and_padding};
pub use bulk::{emissive, emits, indices, instances, mesh_instances, texture_transforms, vertices};
pub use environment::env_alias;

/// Largest width or height of an image.
pub const MAX_IMAGE_EXTENT: u32 = 1 << 16;

/// Header rules; returns the end of the root, which is at most `length`.
pub(crate) fn header(header: &Header, length: u64) -> Result<u64> {
    if header.magic != MAGIC {
        return Err(Error::NotAPackage);
    }
    if header.version != FORMAT_VERSION {
        return Err(Error::Version {
            found: header.version,
            supported: FORMAT_VERSION,
            tool: header.tool(),
        });
    }
    let expected = crate::schema::schema_hash();
    if header.schema_hash != expected {
        return Err(Error::Schema {
            found: header.schema_hash,
            expected,
            tool: header.tool(),
        });
    }
    if header.file_length != length {
        return Err(Error::Length {
            expected: header.file_length,
            actual: length,
        });
    }
    let fail = |offset, what: String| Err(Error::corrupt(Part::Header, offset, what));
    if header.section_count as usize > SectionKind::ALL.len() {
        return fail(12, format!("{} sections", header.section_count));
    }
    if header.reserved != [0; 32] {
        return fail(96, "reserved bytes are not zero".into());
    }
    let table_end = HEADER_BYTES + u64::from(header.section_count) * ENTRY_BYTES;
    if header.root_offset != align_up(table_end, ALIGNMENT) {
        return fail(
            32,
            format!("root offset {}, not behind the table", header.root_offset),
        );
    }
    match header.root_offset.checked_add(header.root_length) {
        Some(end) if end <= length => Ok(end),
        _ => fail(
            40,
            format!("root length {} leaves the file", header.root_length),
        ),
    }
}

/// The content hash over header, table and root.
pub(crate) fn content_hash(header: &Header, head: &[u8]) -> Result<()> {
    let table = &head[HEADER_BYTES as usize..header.root_offset as usize];
    let root = &head[header.root_offset as usize..];
    if crate::writer::content_hash(header, table, root) == header.content_hash {
        return Ok(());
    }
    let what = "header, section table or root differ from their BLAKE3 hash: the file is damaged";
    Err(Error::corrupt(Part::Header, 64, what))
}

/// Section table rules: known kinds in order, right strides, tight pages, nothing behind the last section.
pub(crate) fn table(header: &Header, table: &[SectionEntry]) -> Result<()> {
    let mut end = header.root_offset + header.root_length;
    let mut last_kind = 0;
    for (row, entry) in table.iter().enumerate() {
        let fail = |field: u64, what: String| {
            Err(Error::corrupt(
                Part::Table,
                row as u64 * ENTRY_BYTES + field,
                what,
            ))
        };
        let Some(kind) = SectionKind::from_u32(entry.kind).filter(|_| entry.kind > last_kind)
        else {
            return fail(0, format!("section kind {} after {last_kind}", entry.kind));
        };
        if entry.stride != kind.stride() {
            return fail(
                4,
                format!("stride {} of section {}", entry.stride, kind.name()),
            );
        }
        if entry.offset != align_up(end, PAGE) {
            return fail(
                8,
                format!("offset {}, expected {}", entry.offset, align_up(end, PAGE)),
            );
        }
        let length = entry.count.checked_mul(u64::from(entry.stride));
        if entry.count == 0 || length != Some(entry.length) {
            return fail(
                16,
                format!("length {} of {} records", entry.length, entry.count),
            );
        }
        end = match entry.offset.checked_add(entry.length) {
            Some(end) if end <= header.file_length => end,
            _ => return fail(16, format!("section {} leaves the file", kind.name())),
        };
        last_kind = entry.kind;
    }
    if end != header.file_length {
        let what = format!(
            "file length {}, but the last section ends at {end}",
            header.file_length
        );
        return Err(Error::corrupt(Part::Header, 16, what));
    }
    Ok(())
}

/// Everything that `open` promises of the root, the materials and the draw groups.
pub(crate) fn root(package: &Package) -> Result<()> {
    let scene = package.scene();
    counts(package, scene)?;
    meshes(scene)?;
    primitives(package, scene)?;
    images(package, scene)?;
    textures(scene)?;
    lights_and_cameras(scene)?;
    environment::environment(package, scene)?;
    materials(package.materials()?, scene.textures.len())?;
    material_extensions(package.material_extensions()?, scene.textures.len())?;
    punctual_lights(package.punctual_lights()?)?;
    draw_groups(package, scene)
}

fn root_error(what: impl Into<String>) -> Error {
    Error::corrupt(Part::Root, 0, what)
}

fn section_error(kind: SectionKind, record: usize, what: String) -> Error {
    let offset = record as u64 * u64::from(kind.stride());
    Error::corrupt(Part::Section(kind), offset, what)
}

/// `start..start + count` where it lies inside `0..limit`.
fn range(start: u32, count: u32, limit: u64) -> Option<Range<u64>> {
    let end = u64::from(start) + u64::from(count);
    (end <= limit).then_some(u64::from(start)..end)
}

fn finite(values: &[f32]) -> bool {
    values.iter().all(|value| value.is_finite())
}

fn bounds(bounds: &ArchivedBounds) -> bool {
    let (min, max) = (natives(&bounds.min), natives(&bounds.max));
    finite(&min) && finite(&max) && min.iter().zip(&max).all(|(min, max)| min <= max)
}

fn counts(package: &Package, scene: &ArchivedScene) -> Result<()> {
    let materials = package.count(SectionKind::Materials);
    if materials != scene.materials.len() as u64 {
        let what = format!(
            "{} material names for {materials} records",
            scene.materials.len()
        );
        return Err(root_error(what));
    }
    let (instances, floats) = (
        package.count(SectionKind::Instances),
        package.count(SectionKind::InstanceBounds),
    );
    if instances > u64::from(u32::MAX) || padded(instances as usize) as u64 * 6 != floats {
        let what = format!("{floats} floats do not fit {instances} instances");
        return Err(section_error(SectionKind::InstanceBounds, 0, what));
    }
    optional_counts(package, scene)?;
    if scene.features.to_native() & !crate::features::ALL != 0 {
        return Err(root_error(format!(
            "unknown feature bits {:#x}",
            scene.features
        )));
    }
    if !bounds(&scene.bounds) {
        return Err(root_error("scene bounds are not finite and ordered"));
    }
    Ok(())
}

/// Sections that go along with another: absent, or of exactly its count.
fn optional_counts(package: &Package, scene: &ArchivedScene) -> Result<()> {
    let clusters = package
        .count(SectionKind::Instances)
        .div_ceil(CLUSTER as u64) as usize;
    let expected = [
        (SectionKind::TextureTransforms, scene.textures.len() as u64),
        (
            SectionKind::VertexColors,
            package.count(SectionKind::Vertices),
        ),
        (SectionKind::ClusterBounds, padded(clusters) as u64 * 6),
        (
            SectionKind::MaterialExtensions,
            package.count(SectionKind::Materials),
        ),
    ];
    for (kind, expected) in expected {
        let count = package.count(kind);
        if package.entry(kind).is_some() && count != expected {
            return Err(section_error(
                kind,
                0,
                format!("{count} records, not {expected}"),
            ));
        }
    }
    Ok(())
}

fn meshes(scene: &ArchivedScene) -> Result<()> {
    let limit = scene.primitives.len() as u64;
    for (index, mesh) in scene.meshes.iter().enumerate() {
        let (first, count) = (
            mesh.first_primitive.to_native(),
            mesh.primitive_count.to_native(),
        );
        if range(first, count, limit).is_none() {
            return Err(root_error(format!(
                "mesh {index}: primitives {first}+{count} of {limit}"
            )));
        }
    }
    Ok(())
}

fn primitives(package: &Package, scene: &ArchivedScene) -> Result<()> {
    let indices = package.count(SectionKind::Indices);
    let vertices = package.count(SectionKind::Vertices);
    for (index, primitive) in scene.primitives.iter().enumerate() {
        let fail = |what: String| Err(root_error(format!("primitive {index}: {what}")));
        let (first, count) = (
            primitive.first_index.to_native(),
            primitive.index_count.to_native(),
        );
        if range(first, count, indices).is_none() || count % 3 != 0 {
            return fail(format!("indices {first}+{count} of {indices}"));
        }
        let traced = primitive.traced_index_count.to_native();
        if traced > count || traced % 3 != 0 {
            return fail(format!("{traced} traced indices of {count}"));
        }
        let (first, count) = (
            primitive.first_vertex.to_native(),
            primitive.vertex_count.to_native(),
        );
        // Vulkan's vertex offset is signed.
        if range(first, count, vertices).is_none() || first > i32::MAX as u32 {
            return fail(format!("vertices {first}+{count} of {vertices}"));
        }
        if primitive.material.to_native() as usize >= scene.materials.len() {
            return fail(format!(
                "material {} of {}",
                primitive.material,
                scene.materials.len()
            ));
        }
        if !bounds(&primitive.bounds) {
            return fail("bounds are not finite and ordered".into());
        }
    }
    Ok(())
}

fn images(package: &Package, scene: &ArchivedScene) -> Result<()> {
    let texels = package.count(SectionKind::Texels);
    for (index, image) in scene.images.iter().enumerate() {
        let fail = |what: String| {
            Err(root_error(format!(
                "image {index} `{}`: {what}",
                image.name
            )))
        };
        let (width, height) = (image.width.to_native(), image.height.to_native());
        if !(1..=MAX_IMAGE_EXTENT).contains(&width) || !(1..=MAX_IMAGE_EXTENT).contains(&height) {
            return fail(format!("{width} x {height} texels"));
        }
        let layers = image.layers.to_native();
        if layers != 1 && (layers != 6 || width != height) {
            return fail(format!("{layers} layers of {width} x {height}"));
        }
        let count = image.levels.len() as u32;
        if count == 0 || count > full_mip_count(width, height) {
            return fail(format!("{count} levels for {width} x {height} texels"));
        }
        if let Some(level) = (0..count).find(|level| !level_fits(image, *level, texels)) {
            return fail(format!(
                "level {level} has a wrong length, or leaves the texel section"
            ));
        }
    }
    Ok(())
}

fn level_fits(image: &ArchivedImage, level: u32, texels: u64) -> bool {
    let extents = (
        mip_extent(image.width.to_native(), level),
        mip_extent(image.height.to_native(), level),
    );
    let expected = image.format.native().level_bytes(extents.0, extents.1)
        * u64::from(image.layers.to_native());
    let stored = &image.levels[level as usize];
    let (offset, length) = (stored.offset.to_native(), stored.length.to_native());
    let end = offset.checked_add(length);
    length == expected && offset % ALIGNMENT == 0 && end.is_some_and(|end| end <= texels)
}

fn textures(scene: &ArchivedScene) -> Result<()> {
    for (index, texture) in scene.textures.iter().enumerate() {
        let image = scene.images.get(texture.image.to_native() as usize);
        let sampler = texture.sampler.to_native() as usize;
        if image.is_none_or(|image| image.layers != 1) || sampler >= scene.samplers.len() {
            let what = format!(
                "texture {index}: image {}, sampler {sampler}",
                texture.image
            );
            return Err(root_error(what));
        }
    }
    Ok(())
}

fn lights_and_cameras(scene: &ArchivedScene) -> Result<()> {
    for (index, light) in scene.lights.iter().enumerate() {
        let scalars = [
            light.intensity,
            light.range,
            light.inner_angle,
            light.outer_angle,
        ];
        let vectors = [light.color, light.position, light.direction];
        if !finite(&natives(&scalars)) || !vectors.iter().all(|vector| finite(&natives(vector))) {
            return Err(root_error(format!(
                "light {index} `{}` is not finite",
                light.name
            )));
        }
    }
    for (index, camera) in scene.cameras.iter().enumerate() {
        let scalars = [camera.extent, camera.znear, camera.zfar];
        let vectors = [camera.position, camera.forward, camera.up];
        if !finite(&natives(&scalars)) || !vectors.iter().all(|vector| finite(&natives(vector))) {
            return Err(root_error(format!(
                "camera {index} `{}` is not finite",
                camera.name
            )));
        }
    }
    Ok(())
}

/// Material records: modes, flags and texture references in range, factors finite.
pub fn materials(materials: &[Material], textures: usize) -> Result<()> {
    for (index, material) in materials.iter().enumerate() {
        let fail = |what: String| Err(section_error(SectionKind::Materials, index, what));
        if material.alpha_mode > ALPHA_BLEND {
            return fail(format!("alpha mode {}", material.alpha_mode));
        }
        if material.double_sided & !(MATERIAL_DOUBLE_SIDED | MATERIAL_UNLIT) != 0 {
            return fail(format!("flags {:#x}", material.double_sided));
        }
        let references = [
            material.base_color_tex,
            material.emissive_tex,
            material.metallic_roughness_tex,
            material.normal_tex,
            material.occlusion_tex,
        ];
        if let Some(what) = dangling(&references, textures) {
            return fail(what);
        }
        let scalars = [
            material.metallic_factor,
            material.roughness_factor,
            material.normal_scale,
            material.occlusion_strength,
            material.alpha_cutoff,
        ];
        if !finite(&material.base_color_factor)
            || !finite(&material.emissive_factor)
            || !finite(&scalars)
        {
            return fail("a factor is not finite".into());
        }
    }
    Ok(())
}

/// What is wrong with the first reference that names no texture of the package.
fn dangling(references: &[u32], textures: usize) -> Option<String> {
    let bad = |reference: &&u32| {
        **reference != NO_TEXTURE && (**reference & !TEXTURE_UV1) >= textures as u32
    };
    let bad = references.iter().find(bad)?;
    Some(format!("texture reference {bad:#x} of {textures} textures"))
}

/// Material extension records: bits known, texture references in range, factors finite.
pub fn material_extensions(records: &[MaterialExtension], textures: usize) -> Result<()> {
    for (index, record) in records.iter().enumerate() {
        let fail = |what: String| Err(section_error(SectionKind::MaterialExtensions, index, what));
        if record.lobes & !(LOBE_CLEARCOAT | LOBE_SPECULAR | LOBE_SHEEN) != 0 {
            return fail(format!("lobes {:#x}", record.lobes));
        }
        let references = [
            record.clearcoat_tex,
            record.clearcoat_roughness_tex,
            record.clearcoat_normal_tex,
            record.specular_tex,
            record.specular_color_tex,
            record.sheen_color_tex,
            record.sheen_roughness_tex,
        ];
        if let Some(what) = dangling(&references, textures) {
            return fail(what);
        }
        let scalars = [
            record.sheen_roughness,
            record.specular_factor,
            record.dielectric_f0,
            record.clearcoat_factor,
            record.clearcoat_roughness,
            record.clearcoat_normal_scale,
        ];
        if !finite(&record.sheen_color) || !finite(&record.specular_color) || !finite(&scalars) {
            return fail("a factor is not finite".into());
        }
    }
    Ok(())
}

/// Point and spot lights are finite.
pub fn punctual_lights(lights: &[PunctualLight]) -> Result<()> {
    let sound = |light: &PunctualLight| {
        finite(&light.position_and_range)
            && finite(&light.direction_and_spot_scale)
            && finite(&light.color_and_shadow)
            && light.spot_offset.is_finite()
    };
    match lights.iter().position(|light| !sound(light)) {
        Some(index) => {
            let what = format!("light {index} is not finite");
            Err(section_error(SectionKind::PunctualLights, index, what))
        }
        None => Ok(()),
    }
}

fn draw_groups(package: &Package, scene: &ArchivedScene) -> Result<()> {
    let instances = package.count(SectionKind::Instances);
    let mut last_mode = 0;
    for (index, group) in package.draw_groups()?.iter().enumerate() {
        let fail = |what: String| Err(section_error(SectionKind::DrawGroups, index, what));
        let Some(primitive) = scene.primitives.get(group.primitive as usize) else {
            return fail(format!(
                "primitive {} of {}",
                group.primitive,
                scene.primitives.len()
            ));
        };
        if !draws(group, primitive) {
            return fail(format!(
                "ranges differ from those of primitive {}",
                group.primitive
            ));
        }
        if range(group.first_instance, group.instance_count, instances).is_none() {
            return fail(format!(
                "instances {}+{} of {instances}",
                group.first_instance, group.instance_count
            ));
        }
        if group.alpha_mode > ALPHA_BLEND || group.alpha_mode < last_mode {
            return fail(format!("alpha mode {} after {last_mode}", group.alpha_mode));
        }
        if group.flags & !(DRAW_DOUBLE_SIDED | DRAW_MIRRORED) != 0 {
            return fail(format!("flags {:#x}", group.flags));
        }
        last_mode = group.alpha_mode;
    }
    Ok(())
}

fn draws(group: &DrawGroup, primitive: &ArchivedPrimitive) -> bool {
    group.first_index == primitive.first_index
        && group.index_count == primitive.index_count
        && group.vertex_offset == primitive.first_vertex
}
