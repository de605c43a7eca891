//! What `open` promises of the root, the materials and the draw groups.

use crate::bounds::{CLUSTER, padded};
use crate::gpu::{ALPHA_BLEND, DRAW_DOUBLE_SIDED, DRAW_MIRRORED, DrawGroup};
use crate::header::ALIGNMENT;
use crate::package::Package;
use crate::scene::{ArchivedBounds, ArchivedImage, ArchivedPrimitive, ArchivedScene, natives};
use crate::section::SectionKind;
use crate::texture::{full_mip_count, mip_extent};

use super::{
    Flow, Found, MAX_IMAGE_EXTENT, environment, finite, given, range, records, root_error,
    section_error,
};

/// Everything that `open` promises of the root, the materials and the draw groups.
pub(crate) fn root(package: &Package, found: &mut Found) -> Flow {
    let scene = package.scene();
    counts(package, scene, found)?;
    meshes(scene, found)?;
    primitives(package, scene, found)?;
    images(package, scene, found)?;
    textures(scene, found)?;
    lights_and_cameras(scene, found)?;
    report(scene, found)?;
    environment::environment(package, scene, found)?;
    let materials = given(package.materials(), found)?;
    records::each_material(materials, scene.textures.len(), found)?;
    let extensions = given(package.material_extensions(), found)?;
    records::each_material_extension(extensions, scene.textures.len(), found)?;
    records::each_punctual_light(given(package.punctual_lights(), found)?, found)?;
    draw_groups(package, scene, found)
}

fn bounds(bounds: &ArchivedBounds) -> bool {
    let (min, max) = (natives(&bounds.min), natives(&bounds.max));
    finite(&min) && finite(&max) && min.iter().zip(&max).all(|(min, max)| min <= max)
}

fn counts(package: &Package, scene: &ArchivedScene, found: &mut Found) -> Flow {
    let materials = package.count(SectionKind::Materials);
    if materials != scene.materials.len() as u64 {
        let what = format!(
            "{} material names for {materials} records",
            scene.materials.len()
        );
        found(root_error(what))?;
    }
    let (instances, floats) = (
        package.count(SectionKind::Instances),
        package.count(SectionKind::InstanceBounds),
    );
    if instances > u64::from(u32::MAX) || padded(instances as usize) as u64 * 6 != floats {
        let what = format!("{floats} floats do not fit {instances} instances");
        found(section_error(SectionKind::InstanceBounds, 0, what))?;
    }
    optional_counts(package, scene, found)?;
    if scene.features.to_native() & !crate::features::ALL != 0 {
        found(root_error(format!(
            "unknown feature bits {:#x}",
            scene.features
        )))?;
    }
    if !bounds(&scene.bounds) {
        found(root_error("scene bounds are not finite and ordered"))?;
    }
    Flow::Continue(())
}

/// Sections that go along with another: absent, or of exactly its count.
fn optional_counts(package: &Package, scene: &ArchivedScene, found: &mut Found) -> Flow {
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
            found(section_error(
                kind,
                0,
                format!("{count} records, not {expected}"),
            ))?;
        }
    }
    Flow::Continue(())
}

fn meshes(scene: &ArchivedScene, found: &mut Found) -> Flow {
    let limit = scene.primitives.len() as u64;
    for (index, mesh) in scene.meshes.iter().enumerate() {
        let (first, count) = (
            mesh.first_primitive.to_native(),
            mesh.primitive_count.to_native(),
        );
        if range(first, count, limit).is_none() {
            found(root_error(format!(
                "mesh {index}: primitives {first}+{count} of {limit}"
            )))?;
        }
    }
    Flow::Continue(())
}

fn primitives(package: &Package, scene: &ArchivedScene, found: &mut Found) -> Flow {
    let indices = package.count(SectionKind::Indices);
    let vertices = package.count(SectionKind::Vertices);
    for (index, primitive) in scene.primitives.iter().enumerate() {
        let mut fail = |what: String| found(root_error(format!("primitive {index}: {what}")));
        let (first, count) = (
            primitive.first_index.to_native(),
            primitive.index_count.to_native(),
        );
        if range(first, count, indices).is_none() || count % 3 != 0 {
            fail(format!("indices {first}+{count} of {indices}"))?;
        }
        let traced = primitive.traced_index_count.to_native();
        if traced > count || traced % 3 != 0 {
            fail(format!("{traced} traced indices of {count}"))?;
        }
        let (first, count) = (
            primitive.first_vertex.to_native(),
            primitive.vertex_count.to_native(),
        );
        // Vulkan's vertex offset is signed.
        if range(first, count, vertices).is_none() || first > i32::MAX as u32 {
            fail(format!("vertices {first}+{count} of {vertices}"))?;
        }
        if primitive.material.to_native() as usize >= scene.materials.len() {
            fail(format!(
                "material {} of {}",
                primitive.material,
                scene.materials.len()
            ))?;
        }
        if !bounds(&primitive.bounds) {
            fail("bounds are not finite and ordered".into())?;
        }
    }
    Flow::Continue(())
}

fn images(package: &Package, scene: &ArchivedScene, found: &mut Found) -> Flow {
    let texels = package.count(SectionKind::Texels);
    for (index, image) in scene.images.iter().enumerate() {
        let mut fail = |what: String| {
            found(root_error(format!(
                "image {index} `{}`: {what}",
                image.name
            )))
        };
        let (width, height) = (image.width.to_native(), image.height.to_native());
        if !(1..=MAX_IMAGE_EXTENT).contains(&width) || !(1..=MAX_IMAGE_EXTENT).contains(&height) {
            fail(format!("{width} x {height} texels"))?;
            continue;
        }
        let layers = image.layers.to_native();
        if layers != 1 && (layers != 6 || width != height) {
            fail(format!("{layers} layers of {width} x {height}"))?;
            continue;
        }
        let count = image.levels.len() as u32;
        if count == 0 || count > full_mip_count(width, height) {
            fail(format!("{count} levels for {width} x {height} texels"))?;
            continue;
        }
        if let Some(level) = (0..count).find(|level| !level_fits(image, *level, texels)) {
            fail(format!(
                "level {level} has a wrong length, or leaves the texel section"
            ))?;
        }
    }
    Flow::Continue(())
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

fn textures(scene: &ArchivedScene, found: &mut Found) -> Flow {
    for (index, texture) in scene.textures.iter().enumerate() {
        let image = scene.images.get(texture.image.to_native() as usize);
        let sampler = texture.sampler.to_native() as usize;
        if image.is_none_or(|image| image.layers != 1) || sampler >= scene.samplers.len() {
            let what = format!(
                "texture {index}: image {}, sampler {sampler}",
                texture.image
            );
            found(root_error(what))?;
        }
    }
    Flow::Continue(())
}

fn lights_and_cameras(scene: &ArchivedScene, found: &mut Found) -> Flow {
    for (index, light) in scene.lights.iter().enumerate() {
        let scalars = [
            light.intensity,
            light.range,
            light.inner_angle,
            light.outer_angle,
        ];
        let vectors = [light.color, light.position, light.direction];
        if !finite(&natives(&scalars)) || !vectors.iter().all(|vector| finite(&natives(vector))) {
            found(root_error(format!(
                "light {index} `{}` is not finite",
                light.name
            )))?;
        }
    }
    for (index, camera) in scene.cameras.iter().enumerate() {
        let scalars = [camera.extent, camera.znear, camera.zfar];
        let vectors = [camera.position, camera.forward, camera.up];
        if !finite(&natives(&scalars)) || !vectors.iter().all(|vector| finite(&natives(vector))) {
            found(root_error(format!(
                "camera {index} `{}` is not finite",
                camera.name
            )))?;
        }
    }
    Flow::Continue(())
}

/// The errors that the bake states are numbers.
fn report(scene: &ArchivedScene, found: &mut Found) -> Flow {
    for (index, row) in scene.report.iter().enumerate() {
        if !row.error.to_native().is_finite() {
            let what = format!(
                "report row {index}, {} of {}, is not finite",
                row.metric, row.item
            );
            found(root_error(what))?;
        }
    }
    Flow::Continue(())
}

fn draw_groups(package: &Package, scene: &ArchivedScene, found: &mut Found) -> Flow {
    let instances = package.count(SectionKind::Instances);
    let mut last_mode = 0;
    for (index, group) in given(package.draw_groups(), found)?.iter().enumerate() {
        let mut fail = |what: String| found(section_error(SectionKind::DrawGroups, index, what));
        let Some(primitive) = scene.primitives.get(group.primitive as usize) else {
            fail(format!(
                "primitive {} of {}",
                group.primitive,
                scene.primitives.len()
            ))?;
            continue;
        };
        if !draws(group, primitive) {
            fail(format!(
                "ranges differ from those of primitive {}",
                group.primitive
            ))?;
        }
        if range(group.first_instance, group.instance_count, instances).is_none() {
            fail(format!(
                "instances {}+{} of {instances}",
                group.first_instance, group.instance_count
            ))?;
        }
        if group.alpha_mode > ALPHA_BLEND || group.alpha_mode < last_mode {
            fail(format!("alpha mode {} after {last_mode}", group.alpha_mode))?;
        }
        if group.flags & !(DRAW_DOUBLE_SIDED | DRAW_MIRRORED) != 0 {
            fail(format!("flags {:#x}", group.flags))?;
        }
        last_mode = group.alpha_mode;
    }
    Flow::Continue(())
}

fn draws(group: &DrawGroup, primitive: &ArchivedPrimitive) -> bool {
    group.first_index == primitive.first_index
        && group.index_count == primitive.index_count
        && group.vertex_offset == primitive.first_vertex
}
