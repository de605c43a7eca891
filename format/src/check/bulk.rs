//! Rules of bulk data: what a GPU follows, and what the hashes cover.

use crate::error::{Error, Part, Result};
use crate::gpu::{DRAW_DOUBLE_SIDED, DRAW_MIRRORED, Instance, MeshInstance, TextureTransform};
use crate::package::Package;
use crate::scene::ArchivedScene;
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
    instance_bounds(package)?;
    super::env_alias(package.section(SectionKind::EnvAlias)?)?;
    texture_transforms(package.texture_transforms()?)
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

fn mesh_instances(instances: &[MeshInstance], scene: &ArchivedScene) -> Result<()> {
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
