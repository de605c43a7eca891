//! Rules of single records: what they refer to is there, their numbers are finite.

use crate::error::Result;
use crate::gpu::{
    ALPHA_BLEND, DRAW_DOUBLE_SIDED, DRAW_MIRRORED, Instance, LOBE_CLEARCOAT, LOBE_SHEEN,
    LOBE_SPECULAR, MATERIAL_DOUBLE_SIDED, MATERIAL_UNLIT, Material, MaterialExtension,
    MeshInstance, NO_TEXTURE, PunctualLight, TEXTURE_UV1, TextureTransform,
};
use crate::scene::ArchivedScene;
use crate::section::SectionKind;
use crate::vertex::Vertex;

use super::{Flow, Found, finite, section_error};

/// Material records: modes, flags and texture references in range, factors finite.
///
/// # Errors
/// The first broken rule.
pub fn materials(materials: &[Material], textures: usize) -> Result<()> {
    super::first(|found| each_material(materials, textures, found))
}

/// Material extension records: bits known, texture references in range, factors finite.
///
/// # Errors
/// The first broken rule.
pub fn material_extensions(records: &[MaterialExtension], textures: usize) -> Result<()> {
    super::first(|found| each_material_extension(records, textures, found))
}

/// Point and spot lights are finite.
///
/// # Errors
/// The first broken rule.
pub fn punctual_lights(lights: &[PunctualLight]) -> Result<()> {
    super::first(|found| each_punctual_light(lights, found))
}

/// Texture transforms are finite.
///
/// # Errors
/// The first broken rule.
pub fn texture_transforms(transforms: &[TextureTransform]) -> Result<()> {
    super::first(|found| each_texture_transform(transforms, found))
}

/// Vertices are finite. `first` is the index of the first one, for messages.
///
/// # Errors
/// The first broken rule.
pub fn vertices(vertices: &[Vertex], first: usize) -> Result<()> {
    super::first(|found| each_vertex(vertices, first, found))
}

/// Indices are below the primitive's vertex count. `first` is the arena position of the first one.
///
/// # Errors
/// The first broken rule.
pub fn indices(indices: &[u32], first: usize, vertex_count: u32) -> Result<()> {
    super::first(|found| each_index(indices, first, vertex_count, found))
}

/// Instance records: matrices finite, material in range. `first` is the index of the first one.
///
/// # Errors
/// The first broken rule.
pub fn instances(instances: &[Instance], first: usize, materials: u32) -> Result<()> {
    super::first(|found| each_instance(instances, first, materials, found))
}

/// Top-level instances: meshes in range, matrices finite.
///
/// # Errors
/// The first broken rule.
pub fn mesh_instances(instances: &[MeshInstance], scene: &ArchivedScene) -> Result<()> {
    super::first(|found| each_mesh_instance(instances, scene, found))
}

pub(super) fn each_material(materials: &[Material], textures: usize, found: &mut Found) -> Flow {
    for (index, material) in materials.iter().enumerate() {
        let mut fail = |what: String| found(section_error(SectionKind::Materials, index, what));
        if material.alpha_mode > ALPHA_BLEND {
            fail(format!("alpha mode {}", material.alpha_mode))?;
        }
        if material.double_sided & !(MATERIAL_DOUBLE_SIDED | MATERIAL_UNLIT) != 0 {
            fail(format!("flags {:#x}", material.double_sided))?;
        }
        let references = [
            material.base_color_tex,
            material.emissive_tex,
            material.metallic_roughness_tex,
            material.normal_tex,
            material.occlusion_tex,
        ];
        if let Some(what) = dangling(&references, textures) {
            fail(what)?;
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
            fail("a factor is not finite".into())?;
        }
    }
    Flow::Continue(())
}

/// What is wrong with the first reference that names no texture of the package.
fn dangling(references: &[u32], textures: usize) -> Option<String> {
    let bad = |reference: &&u32| {
        **reference != NO_TEXTURE && (**reference & !TEXTURE_UV1) >= textures as u32
    };
    let bad = references.iter().find(bad)?;
    Some(format!("texture reference {bad:#x} of {textures} textures"))
}

pub(super) fn each_material_extension(
    records: &[MaterialExtension],
    textures: usize,
    found: &mut Found,
) -> Flow {
    for (index, record) in records.iter().enumerate() {
        let mut fail =
            |what: String| found(section_error(SectionKind::MaterialExtensions, index, what));
        if record.lobes & !(LOBE_CLEARCOAT | LOBE_SPECULAR | LOBE_SHEEN) != 0 {
            fail(format!("lobes {:#x}", record.lobes))?;
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
            fail(what)?;
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
            fail("a factor is not finite".into())?;
        }
    }
    Flow::Continue(())
}

pub(super) fn each_punctual_light(lights: &[PunctualLight], found: &mut Found) -> Flow {
    for (index, light) in lights.iter().enumerate() {
        let sound = finite(&light.position_and_range)
            && finite(&light.direction_and_spot_scale)
            && finite(&light.color_and_shadow)
            && light.spot_offset.is_finite();
        if !sound {
            let what = format!("light {index} is not finite");
            found(section_error(SectionKind::PunctualLights, index, what))?;
        }
    }
    Flow::Continue(())
}

pub(super) fn each_texture_transform(transforms: &[TextureTransform], found: &mut Found) -> Flow {
    for (index, transform) in transforms.iter().enumerate() {
        if !finite(&transform.matrix) || !finite(&transform.offset) {
            let what = format!("transform {index} is not finite");
            found(section_error(SectionKind::TextureTransforms, index, what))?;
        }
    }
    Flow::Continue(())
}

pub(super) fn each_vertex(vertices: &[Vertex], first: usize, found: &mut Found) -> Flow {
    for (index, vertex) in vertices.iter().enumerate() {
        let values: &[f32; 14] = bytemuck::cast_ref(vertex);
        if !finite(values) {
            let what = format!("vertex {} is not finite", first + index);
            found(section_error(SectionKind::Vertices, first + index, what))?;
        }
    }
    Flow::Continue(())
}

pub(super) fn each_index(
    indices: &[u32],
    first: usize,
    vertex_count: u32,
    found: &mut Found,
) -> Flow {
    let largest = indices.iter().copied().max();
    if largest.is_none_or(|largest| largest < vertex_count) {
        return Flow::Continue(());
    }
    let bad = indices.iter().enumerate();
    for (at, index) in bad.filter(|(_, index)| **index >= vertex_count) {
        let what = format!("index {index} of a primitive with {vertex_count} vertices");
        found(section_error(SectionKind::Indices, first + at, what))?;
    }
    Flow::Continue(())
}

pub(super) fn each_instance(
    instances: &[Instance],
    first: usize,
    materials: u32,
    found: &mut Found,
) -> Flow {
    for (index, instance) in instances.iter().enumerate() {
        let mut fail =
            |what: String| found(section_error(SectionKind::Instances, first + index, what));
        if instance.material_index >= materials {
            fail(format!(
                "material {} of {materials}",
                instance.material_index
            ))?;
        }
        let matrices = [
            instance.model.as_flattened(),
            instance.normal_matrix.as_flattened(),
        ];
        if !matrices.iter().all(|matrix| finite(matrix)) {
            fail("a matrix is not finite".into())?;
        }
    }
    Flow::Continue(())
}

pub(super) fn each_mesh_instance(
    instances: &[MeshInstance],
    scene: &ArchivedScene,
    found: &mut Found,
) -> Flow {
    for (index, instance) in instances.iter().enumerate() {
        let mut fail = |what: String| found(section_error(SectionKind::MeshInstances, index, what));
        let Some(mesh) = scene.meshes.get(instance.mesh as usize) else {
            fail(format!("mesh {} of {}", instance.mesh, scene.meshes.len()))?;
            continue;
        };
        if instance.first_geometry != mesh.first_primitive {
            fail(format!("first geometry {}", instance.first_geometry))?;
        }
        // VkAccelerationStructureInstanceKHR::instanceCustomIndex has 24 bits.
        if instance.first_geometry >= 1 << 24 {
            fail(format!(
                "first geometry {} of 24 bits",
                instance.first_geometry
            ))?;
        }
        if instance.flags & !(DRAW_DOUBLE_SIDED | DRAW_MIRRORED) != 0 {
            fail(format!("flags {:#x}", instance.flags))?;
        }
        if !finite(instance.transform.as_flattened()) {
            fail("the matrix is not finite".into())?;
        }
    }
    Flow::Continue(())
}
