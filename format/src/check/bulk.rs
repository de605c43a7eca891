//! Rules of bulk data: what a GPU follows, and what the hashes cover.

use crate::error::{Error, Part, Result};
use crate::gpu::{
    DRAW_DOUBLE_SIDED, DRAW_MIRRORED, EmissiveAliasEntry, EmissiveAliasHeader, Instance,
    MATERIAL_UNLIT, Material, MeshInstance, NO_EMISSION, TextureTransform,
};
use crate::package::Package;
use crate::scene::{ArchivedPrimitive, ArchivedScene};
use crate::section::SectionKind;
use crate::vertex::Vertex;

use super::{finite, section_error};

/// Section hashes, and zero padding between sections.
pub(crate) fn hashes_and_padding(package: &Package) -> Result<()> {
    let file = package.file_bytes()?;
    let mut end = package.header().root_offset + package.header().root_length;
    for entry in package.table() {
        let Some(kind) = SectionKind::from_u32(entry.kind) else {
            continue;
        };
        let padding = &file[end as usize..entry.offset as usize];
        if padding.iter().any(|byte| *byte != 0) {
            let what = format!("padding before it, from file byte {end}, is not zero");
            return Err(Error::corrupt(Part::Section(kind), 0, what));
        }
        end = entry.offset + entry.length;
        if crate::writer::section_hash(&file[entry.offset as usize..end as usize]) != entry.hash {
            let what = "content differs from its BLAKE3 hash: the file is damaged";
            return Err(Error::corrupt(Part::Section(kind), 0, what));
        }
    }
    Ok(())
}

/// All bulk data that a GPU follows.
pub(crate) fn bulk(package: &Package) -> Result<()> {
    vertices(package.vertices()?, 0)?;
    let all = package.indices()?;
    for primitive in package.scene().primitives.iter() {
        let first = primitive.first_index.to_native();
        let end = first as usize + primitive.index_count.to_native() as usize;
        indices(
            &all[first as usize..end],
            first as usize,
            primitive.vertex_count.to_native(),
        )?;
    }
    let materials = package.count(SectionKind::Materials) as u32;
    instances(package.instances()?, 0, materials)?;
    mesh_instances(package.mesh_instances()?, package.scene())?;
    emissive(package)?;
    instance_bounds(package)?;
    super::env_alias(package.section(SectionKind::EnvAlias)?)?;
    texture_transforms(package.texture_transforms()?)
}

/// Emissive triangles are finite, their table draws only what is there, and each mesh instance's triangles are
/// listed.
pub fn emissive(package: &Package) -> Result<()> {
    let triangles = package.emissive_triangles()?;
    let materials = package.count(SectionKind::Materials) as u32;
    for (index, triangle) in triangles.iter().enumerate() {
        let fail = |what: &str| {
            let what = format!("triangle {index} {what}");
            Err(section_error(SectionKind::EmissiveTriangles, index, what))
        };
        let values = [triangle.v0, triangle.v1, triangle.v2, triangle.emission];
        let coordinates = [triangle.uv0, triangle.uv1, triangle.uv2];
        if !finite(values.as_flattened()) || !finite(coordinates.as_flattened()) {
            return fail("is not finite");
        }
        if !(triangle.power.is_finite() && triangle.power >= 0.0 && triangle.area >= 0.0) {
            return fail("has no power or area");
        }
        if triangle.material_index >= materials {
            return fail("has no material");
        }
    }
    emissive_table(package.emissive_alias()?, triangles.len())?;
    let scene = package.scene();
    for (index, instance) in package.mesh_instances()?.iter().enumerate() {
        let Some(mesh) = scene.meshes.get(instance.mesh as usize) else {
            continue;
        };
        let first = mesh.first_primitive.to_native() as usize;
        let primitives =
            &scene.primitives[first..first + mesh.primitive_count.to_native() as usize];
        let listed: u64 = primitives
            .iter()
            .map(|primitive| emitted(package, primitive))
            .sum::<Result<u64>>()?;
        let start = u64::from(instance.first_emissive);
        if instance.first_emissive != NO_EMISSION && start + listed > triangles.len() as u64 {
            let what = format!("{listed} emissive triangles from {start} on");
            return Err(section_error(SectionKind::MeshInstances, index, what));
        }
    }
    Ok(())
}

/// Triangles of a primitive that an instance lists as emissive.
fn emitted(package: &Package, primitive: &ArchivedPrimitive) -> Result<u64> {
    let material = package.materials()?[primitive.material.to_native() as usize];
    let triangles = u64::from(primitive.traced_index_count.to_native() / 3);
    Ok(if emits(&material) && primitive.opaque {
        triangles
    } else {
        0
    })
}

/// Whether light leaves a material by itself, and is sampled.
pub fn emits(material: &Material) -> bool {
    let shines = material.emissive_factor[..3]
        .iter()
        .any(|factor| *factor > 0.0);
    shines && material.double_sided & MATERIAL_UNLIT == 0
}

fn emissive_table(words: &[u32], triangles: usize) -> Result<()> {
    const HEADER: usize = size_of::<EmissiveAliasHeader>() / 4;
    const ENTRY: usize = size_of::<EmissiveAliasEntry>() / 4;
    if words.is_empty() {
        return Ok(());
    }
    let fail =
        |index: usize, what: String| Err(section_error(SectionKind::EmissiveAlias, index, what));
    if words.len() != HEADER + triangles * ENTRY || words[0] as usize != triangles {
        let what = format!("{} words for {triangles} triangles", words.len());
        return fail(0, what);
    }
    let total = f32::from_bits(words[1]);
    if !(total.is_finite() && total > 0.0) {
        return fail(1, format!("total power {total}"));
    }
    let entries: &[EmissiveAliasEntry] = bytemuck::cast_slice(&words[HEADER..]);
    for (index, entry) in entries.iter().enumerate() {
        if entry.alias_index as usize >= triangles || !(0.0..=1.0).contains(&entry.prob) {
            return fail(
                HEADER + index * ENTRY,
                format!("entry {index} of {triangles}"),
            );
        }
    }
    Ok(())
}

/// Texture transforms are finite.
pub fn texture_transforms(transforms: &[TextureTransform]) -> Result<()> {
    let bad = transforms
        .iter()
        .position(|transform| !finite(&transform.matrix) || !finite(&transform.offset));
    match bad {
        Some(index) => {
            let what = format!("transform {index} is not finite");
            Err(section_error(SectionKind::TextureTransforms, index, what))
        }
        None => Ok(()),
    }
}

/// Vertices are finite. `first` is the index of the first one, for messages.
pub fn vertices(vertices: &[Vertex], first: usize) -> Result<()> {
    for (index, vertex) in vertices.iter().enumerate() {
        let values: &[f32; 14] = bytemuck::cast_ref(vertex);
        if !finite(values) {
            let what = format!("vertex {} is not finite", first + index);
            return Err(section_error(SectionKind::Vertices, first + index, what));
        }
    }
    Ok(())
}

/// Indices are below the primitive's vertex count. `first` is the arena position of the first one.
pub fn indices(indices: &[u32], first: usize, vertex_count: u32) -> Result<()> {
    let largest = indices.iter().copied().max();
    if largest.is_none_or(|largest| largest < vertex_count) {
        return Ok(());
    }
    let bad = indices
        .iter()
        .position(|index| *index >= vertex_count)
        .unwrap_or(0);
    let what = format!(
        "index {} of a primitive with {vertex_count} vertices",
        indices[bad]
    );
    Err(section_error(SectionKind::Indices, first + bad, what))
}

/// Instance records: matrices finite, material in range. `first` is the index of the first one.
pub fn instances(instances: &[Instance], first: usize, materials: u32) -> Result<()> {
    for (index, instance) in instances.iter().enumerate() {
        let fail = |what: String| Err(section_error(SectionKind::Instances, first + index, what));
        if instance.material_index >= materials {
            return fail(format!(
                "material {} of {materials}",
                instance.material_index
            ));
        }
        let matrices = [
            instance.model.as_flattened(),
            instance.normal_matrix.as_flattened(),
        ];
        if !matrices.iter().all(|matrix| finite(matrix)) {
            return fail("a matrix is not finite".into());
        }
    }
    Ok(())
}

/// Top-level instances: meshes in range, matrices finite.
pub fn mesh_instances(instances: &[MeshInstance], scene: &ArchivedScene) -> Result<()> {
    for (index, instance) in instances.iter().enumerate() {
        let fail = |what: String| Err(section_error(SectionKind::MeshInstances, index, what));
        let Some(mesh) = scene.meshes.get(instance.mesh as usize) else {
            return fail(format!("mesh {} of {}", instance.mesh, scene.meshes.len()));
        };
        if instance.first_geometry != mesh.first_primitive {
            return fail(format!("first geometry {}", instance.first_geometry));
        }
        if instance.flags & !(DRAW_DOUBLE_SIDED | DRAW_MIRRORED) != 0 {
            return fail(format!("flags {:#x}", instance.flags));
        }
        if !finite(instance.transform.as_flattened()) {
            return fail("the matrix is not finite".into());
        }
    }
    Ok(())
}

fn instance_bounds(package: &Package) -> Result<()> {
    let view = package.instance_bounds()?;
    match (0..view.len()).find(|index| {
        let aabb = view.get(*index);
        aabb.is_empty() || !aabb.min.is_finite() || !aabb.max.is_finite()
    }) {
        Some(index) => {
            let what = format!("bounds of instance {index} are not finite and ordered");
            Err(section_error(SectionKind::InstanceBounds, index, what))
        }
        None => Ok(()),
    }
}
