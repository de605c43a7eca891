//! Rules of bulk data: what a GPU follows, every float, every zero, and what the hashes cover.

use crate::bounds::BoundsView;
use crate::error::{Error, Part};
use crate::gpu::Field;
use crate::package::Package;
use crate::scene::ArchivedImage;
use crate::section::SectionKind;
use crate::texture::{TextureFormat, mip_extent};

use super::{Flow, Found, emission, environment, given, records, section_error};

/// Section hashes, and zero padding between sections.
pub(crate) fn hashes_and_padding(package: &Package, found: &mut Found) -> Flow {
    let file = given(package.file_bytes(), found)?;
    let mut end = package.header().root_offset + package.header().root_length;
    for entry in package.table() {
        let Some(kind) = SectionKind::from_u32(entry.kind) else {
            continue;
        };
        let padding = &file[end as usize..entry.offset as usize];
        if padding.iter().any(|byte| *byte != 0) {
            let what = format!("padding before it, from file byte {end}, is not zero");
            found(Error::corrupt(Part::Section(kind), 0, what))?;
        }
        end = entry.offset + entry.length;
        if crate::writer::section_hash(&file[entry.offset as usize..end as usize]) != entry.hash {
            let what = "content differs from its BLAKE3 hash: the file is damaged";
            found(Error::corrupt(Part::Section(kind), 0, what))?;
        }
    }
    Flow::Continue(())
}

/// What can be checked of the bulk data without the root.
pub(crate) fn rootless(package: &Package, found: &mut Found) -> Flow {
    records::each_vertex(given(package.vertices(), found)?, 0, found)?;
    let transforms = given(package.texture_transforms(), found)?;
    records::each_texture_transform(transforms, found)?;
    let env_alias = given(package.section(SectionKind::EnvAlias), found)?;
    environment::each_env_alias(env_alias, found)?;
    for entry in package.table() {
        if let Some(kind) = SectionKind::from_u32(entry.kind) {
            record_fields(kind, given(package.section(kind), found)?, found)?;
        }
    }
    Flow::Continue(())
}

/// All bulk data that a GPU follows, where the root is sound.
pub(crate) fn bulk(package: &Package, found: &mut Found) -> Flow {
    rootless(package, found)?;
    let all = given(package.indices(), found)?;
    for primitive in package.scene().primitives.iter() {
        let first = primitive.first_index.to_native() as usize;
        let run = &all[first..first + primitive.index_count.to_native() as usize];
        records::each_index(run, first, primitive.vertex_count.to_native(), found)?;
    }
    let materials = package.count(SectionKind::Materials) as u32;
    let instances = given(package.instances(), found)?;
    records::each_instance(instances, 0, materials, found)?;
    let mesh_instances = given(package.mesh_instances(), found)?;
    records::each_mesh_instance(mesh_instances, package.scene(), found)?;
    emission::each_emissive(package, found)?;
    let view = given(package.instance_bounds(), found)?;
    boxes(SectionKind::InstanceBounds, "instance", &view, found)?;
    if let Some(view) = given(package.cluster_bounds(), found)? {
        boxes(SectionKind::ClusterBounds, "cluster", &view, found)?;
    }
    let texels = given(package.texels(), found)?;
    for image in package.scene().images.iter() {
        half_texels(image, texels, found)?;
    }
    Flow::Continue(())
}

/// Padding of plain records is zero. Floats are finite: those of directional lights here, those of other records by
/// rules of their own.
fn record_fields(kind: SectionKind, bytes: &[u8], found: &mut Found) -> Flow {
    let Some(layout) = kind.record() else {
        return Flow::Continue(());
    };
    let wanted = |field: &&Field| {
        let float = field.is_float() && kind == SectionKind::DirectionalLights;
        float || field.name.starts_with("pad_")
    };
    let fields: Vec<&Field> = layout.fields.iter().filter(wanted).collect();
    if fields.is_empty() {
        return Flow::Continue(());
    }
    for (index, record) in bytes.chunks_exact(layout.bytes).enumerate() {
        for field in &fields {
            let words: &[u32] = bytemuck::cast_slice(&record[field.offset..][..field.bytes()]);
            let what = match field.is_float() {
                true if words.iter().any(|bits| !f32::from_bits(*bits).is_finite()) => {
                    "is not finite"
                }
                false if words.iter().any(|word| *word != 0) => "is not zero",
                _ => continue,
            };
            let offset = (index * layout.bytes + field.offset) as u64;
            let what = format!("{} of {} {index} {what}", field.name, layout.name);
            found(Error::corrupt(Part::Section(kind), offset, what))?;
        }
    }
    Flow::Continue(())
}

fn boxes(kind: SectionKind, of: &str, view: &BoundsView, found: &mut Found) -> Flow {
    for index in 0..view.len() {
        let aabb = view.get(index);
        if aabb.is_empty() || !aabb.min.is_finite() || !aabb.max.is_finite() {
            let what = format!("bounds of {of} {index} are not finite and ordered");
            found(section_error(kind, index, what))?;
        }
    }
    Flow::Continue(())
}

/// Half floats are finite: one infinite texel of a sky is a white frame. Block formats hold nothing infinite.
fn half_texels(image: &ArchivedImage, texels: &[u8], found: &mut Found) -> Flow {
    if image.format.native() != TextureFormat::Rgba16Float {
        return Flow::Continue(());
    }
    for (number, level) in image.levels.iter().enumerate() {
        let (offset, length) = (level.offset.to_native(), level.length.to_native());
        let bytes = &texels[offset as usize..(offset + length) as usize];
        let halves: &[[u8; 2]] = bytemuck::cast_slice(bytes);
        // All bits of the exponent set: infinite, or no number.
        let bad = |half: &[u8; 2]| half[1] & 0x7c == 0x7c;
        if let Some(at) = halves.iter().position(bad) {
            let width = mip_extent(image.width.to_native(), number as u32) as usize;
            let (name, x, y) = (&image.name, at / 4 % width, at / 4 / width);
            let what = format!("texel {x},{y} of image `{name}`, level {number}, is not finite");
            let at = offset + 2 * at as u64;
            found(Error::corrupt(Part::Section(SectionKind::Texels), at, what))?;
        }
    }
    Flow::Continue(())
}
