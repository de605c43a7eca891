//! Tests of the emissive triangles against f64.

use glam::{DVec3, Vec3};

use super::*;
use crate::prepare::testing::{Random, grid, node, one_mesh};
use crate::prepare::{Prepared, prepare};
use crate::scene::{AlphaMode, Material, Primitive, UvTransform};

fn lamp() -> Material {
    Material {
        emissive: Vec3::new(2.0, 0.5, 0.0),
        emissive_texture: Some(TextureRef {
            transform: UvTransform::new([0.25, 0.5], 0.0, [2.0, -1.0]),
            ..TextureRef::new(0, 1)
        }),
        ..Material::default()
    }
}

fn lit(primitive: Primitive, worlds: &[DMat4]) -> Scene {
    let mut scene = one_mesh(Primitive {
        material: Some(0),
        ..primitive
    });
    scene.materials = vec![lamp()];
    scene.instances = worlds.iter().map(|world| node(0, *world)).collect();
    scene
}

fn prepared(scene: &Scene) -> Prepared {
    prepare(&mut scene.clone(), &|_| ()).expect("the scene is valid")
}

#[test]
fn areas_and_places_follow_f64() {
    let mut random = Random(21);
    let worlds: Vec<DMat4> = (0..6)
        .map(|_| {
            let scale = random.vector() * 4.0;
            DMat4::from_scale_rotation_translation(scale, random.rotation(), random.vector() * 99.0)
        })
        .collect();
    let scene = lit(grid(5), &worlds);
    let prepared = prepared(&scene);
    let listed = &prepared.emissive_triangles;
    assert_eq!(listed.len(), worlds.len() * 50);
    assert_eq!(listed.len() as u64, prepared.stats.drawn_triangles);
    let corners = prepared.indices.chunks_exact(3);
    let expected = worlds
        .iter()
        .flat_map(|world| corners.clone().map(move |triangle| (world, triangle)));
    for (found, (world, triangle)) in listed.iter().zip(expected) {
        let model = world.as_mat4().as_dmat4();
        let mirrored = model.determinant() < 0.0;
        let corners = if mirrored { [0, 2, 1] } else { [0, 1, 2] };
        let vertices = corners.map(|corner| prepared.vertices[triangle[corner] as usize]);
        let [a, b, c] = vertices
            .map(|vertex| model.transform_point3(DVec3::from(vertex.position.map(f64::from))));
        let area = (b - a).cross(c - a).length() / 2.0;
        assert!((f64::from(found.area) - area).abs() <= area * 1e-7);
        assert_eq!(found.v0, a.as_vec3().to_array());
        assert_eq!(found.v1, b.as_vec3().to_array());
        assert_eq!(found.v2, c.as_vec3().to_array());
        let [u, v] = vertices[1].uv1;
        assert_eq!(found.uv1, [2.0 * u + 0.25, -v + 0.5]);
        assert_eq!(found.emission, [2.0, 0.5, 0.0]);
        assert_eq!(found.material_index, 0);
    }
}

/// A hit finds its triangle's record by counting, so no record may be missing.
#[test]
fn triangles_that_a_transform_flattens_keep_their_place() {
    let mut sheet = grid(2);
    sheet.indices.extend([0, 0, 1]);
    let flat = DMat4::from_scale(DVec3::new(0.0, 1.0, 0.0));
    let found = prepared(&lit(sheet, &[flat, DMat4::IDENTITY]));
    let areas: Vec<bool> = found
        .emissive_triangles
        .iter()
        .map(|one| one.area > 0.0)
        .collect();
    assert_eq!(areas.len(), 16);
    assert!(areas[8..].iter().all(|has| *has));
    let firsts: Vec<u32> = found
        .mesh_instances
        .iter()
        .map(|instance| instance.first_emissive)
        .collect();
    assert_eq!(firsts, [0, 8]);
}

#[test]
fn only_light_is_listed() {
    let mut scene = lit(grid(2), &[DMat4::IDENTITY]);
    for change in [
        |material: &mut Material| material.unlit = true,
        |material: &mut Material| material.emissive = Vec3::ZERO,
    ] {
        let lamp = scene.materials[0].clone();
        change(&mut scene.materials[0]);
        assert!(prepared(&scene).emissive_triangles.is_empty());
        scene.materials[0] = lamp;
    }
    scene.materials[0].alpha_mode = AlphaMode::Mask;
    let masked = prepared(&scene);
    assert!(masked.emissive_triangles.is_empty());
    assert_eq!(masked.mesh_instances[0].first_emissive, NO_EMISSION);
    scene.materials[0].alpha_mode = AlphaMode::Opaque;
    assert_eq!(prepared(&scene).emissive_triangles.len(), 8);
}

#[test]
fn too_long_a_list_is_a_warning() {
    let worlds = vec![DMat4::IDENTITY; MAX_TRIANGLES as usize / 20_000 + 1];
    let found = prepared(&lit(grid(100), &worlds));
    assert!(found.emissive_triangles.is_empty());
    assert_eq!(found.diagnostics.len(), 1);
    assert_eq!(found.diagnostics[0].code, "emissive-triangles");
}
