//! Tests of the whole preparation.

use std::sync::Mutex;

use cairn_format::bounds::to_arrays;
use cairn_format::{Package, SectionKind, Writer};
use glam::{DMat4, DVec3, Vec3};

use super::testing::{Random, grid, node, normal_mapped, one_mesh};
use super::*;
use crate::scene::{Light, LightKind, Material, Mesh, Primitive};

fn prepared(scene: &Scene) -> Prepared {
    prepare(&mut scene.clone(), &|_| ()).expect("the scene is valid")
}

/// A scene of many meshes with all that geometry can have.
fn busy() -> Scene {
    let mut random = Random(11);
    let primitive = |cells: u32, material: Option<u32>, flat: bool| {
        let mut primitive = Primitive {
            material,
            ..grid(cells)
        };
        if flat {
            primitive.normals = None;
        }
        primitive
    };
    let meshes = (1..8u32).map(|index| Mesh {
        name: format!("mesh {index}"),
        primitives: vec![
            primitive(index, Some(index % 3), index % 2 == 0),
            primitive(index + 3, None, index % 3 == 0),
        ],
    });
    let mut world = || {
        let scale = random.vector() * 2.0;
        DMat4::from_scale_rotation_translation(scale, random.rotation(), random.vector() * 9.0)
    };
    Scene {
        name: "busy".into(),
        meshes: meshes.collect(),
        materials: vec![normal_mapped(0), normal_mapped(1), Material::default()],
        instances: (0..50).map(|index| node(index % 7, world())).collect(),
        lights: vec![Light {
            name: "sun".into(),
            kind: LightKind::Directional,
            color: Vec3::ONE,
            intensity: 1e5,
            position: DVec3::ZERO,
            direction: DVec3::NEG_Y,
        }],
        ..Scene::default()
    }
}

/// Writes what was prepared as a package and lets the format judge it.
fn assert_package(prepared: &Prepared) {
    let mut root = scene::Scene::empty("test");
    root.features = prepared.features;
    root.meshes = prepared.meshes.clone();
    root.primitives = prepared.primitives.clone();
    root.lights = prepared.lights.clone();
    root.cameras = prepared.cameras.clone();
    let material = gpu::Material {
        base_color_tex: gpu::NO_TEXTURE,
        emissive_tex: gpu::NO_TEXTURE,
        metallic_roughness_tex: gpu::NO_TEXTURE,
        normal_tex: gpu::NO_TEXTURE,
        occlusion_tex: gpu::NO_TEXTURE,
        ..bytemuck::Zeroable::zeroed()
    };
    for _ in &prepared.materials_used {
        root.materials.push(scene::MaterialInfo {
            name: String::new(),
        });
    }
    let materials = vec![material; prepared.materials_used.len()];
    let mut writer = Writer::new();
    writer.records(SectionKind::Vertices, &prepared.vertices);
    writer.bytes(
        SectionKind::Indices,
        bytemuck::cast_slice::<u32, u8>(&prepared.indices),
    );
    writer.records(SectionKind::Materials, &materials);
    writer.records(SectionKind::Instances, &prepared.instances);
    let bounds = to_arrays(&prepared.instance_bounds);
    writer.bytes(
        SectionKind::InstanceBounds,
        bytemuck::cast_slice::<f32, u8>(&bounds),
    );
    let clusters = to_arrays(&prepared.cluster_bounds);
    writer.bytes(
        SectionKind::ClusterBounds,
        bytemuck::cast_slice::<f32, u8>(&clusters),
    );
    writer.records(SectionKind::VertexColors, &prepared.colors);
    writer.records(SectionKind::EmissiveTriangles, &prepared.emissive_triangles);
    writer.records(SectionKind::DrawGroups, &prepared.draw_groups);
    writer.records(SectionKind::MeshInstances, &prepared.mesh_instances);
    writer.records(SectionKind::DirectionalLights, &prepared.directional_lights);
    let bytes = writer
        .to_vec(&root, "0.1.0")
        .expect("the package is writable");
    let package = Package::from_bytes(&bytes).expect("the package opens");
    package.verify().expect("the package is valid");
}

#[test]
fn the_format_accepts_a_busy_scene() {
    let prepared = prepared(&busy());
    assert_package(&prepared);
    let expected =
        features::MIRRORED | features::NORMAL_MAPS | features::UV1 | features::DIRECTIONAL_LIGHTS;
    assert_eq!(prepared.features, expected);
    assert_eq!(prepared.materials_used, [Some(1), None, Some(2), Some(0)]);
    let items: Vec<&str> = prepared
        .report
        .iter()
        .map(|row| row.item.as_str())
        .collect();
    let [cache, overdraw] = ["vertex cache", "overdraw"];
    let expected = [
        "tangents",
        cache,
        cache,
        cache,
        cache,
        overdraw,
        overdraw,
        "instance bounds",
    ];
    assert_eq!(items, expected);
    assert!(prepared.primitives.iter().all(|primitive| primitive.opaque));
    assert!(prepared.colors.is_empty() && prepared.emissive_triangles.is_empty());
    assert!(prepared.cluster_bounds.is_empty());
    assert!(
        prepared.stats.tangent_tilt < 1e-5,
        "{}",
        prepared.stats.tangent_tilt
    );
    for aabb in &prepared.instance_bounds {
        assert_eq!(prepared.bounds.union(*aabb), prepared.bounds);
    }
}

/// The busy scene with colours, lamps and enough nodes for clusters.
fn busier() -> Scene {
    let mut scene = busy();
    scene.instances.extend(scene.instances.clone());
    let sheet = &mut scene.meshes[2].primitives[0];
    sheet.colors = Some(vec![[0.5, 0.25, 1.0, 1.0]; sheet.positions.len()]);
    scene.materials[2].emissive = Vec3::X;
    scene.materials[1].alpha_mode = crate::scene::AlphaMode::Blend;
    scene
}

#[test]
fn what_a_scene_has_is_stored() {
    let prepared = prepared(&busier());
    assert_package(&prepared);
    assert!(prepared.features & features::VERTEX_COLORS != 0);
    assert_eq!(prepared.colors.len(), prepared.vertices.len());
    let white = |color: &&gpu::VertexColor| **color == colors::WHITE;
    let tinted = prepared.colors.iter().filter(|color| !white(color)).count();
    assert_eq!(tinted, 16, "one sheet of three by three cells");
    assert!(
        prepared
            .report
            .iter()
            .any(|row| row.item == "vertex colors")
    );
    assert_eq!(prepared.instances.len(), 200);
    assert_eq!(prepared.cluster_bounds, clusters(&prepared.instance_bounds));
    assert!(!prepared.emissive_triangles.is_empty());
    for primitive in &prepared.primitives {
        let material = prepared.materials_used[primitive.material as usize];
        assert_eq!(primitive.opaque, material != Some(1));
    }
    let names: Vec<&str> = prepared.steps.iter().map(|step| step.name).collect();
    assert_eq!(names.len(), 9, "{names:?}");
}

#[test]
fn the_scene_gives_its_primitives_away() {
    let mut scene = busy();
    prepare(&mut scene, &|_| ()).expect("valid");
    assert!(scene.meshes.iter().all(|mesh| mesh.primitives.is_empty()));
}

#[test]
fn threads_change_nothing() {
    let scene = busier();
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.expect("a pool starts").install(|| prepared(&scene))
    };
    let (one, four) = (run(1), run(4));
    let bytes = |prepared: &Prepared| {
        let mut bytes = bytemuck::cast_slice::<_, u8>(&prepared.vertices).to_vec();
        bytes.extend_from_slice(bytemuck::cast_slice(&prepared.indices));
        bytes.extend_from_slice(bytemuck::cast_slice(&prepared.instances));
        bytes.extend_from_slice(bytemuck::cast_slice(&prepared.colors));
        bytes.extend_from_slice(bytemuck::cast_slice(&prepared.emissive_triangles));
        bytes.extend_from_slice(bytemuck::cast_slice(&prepared.draw_groups));
        bytes.extend_from_slice(bytemuck::cast_slice(&to_arrays(&prepared.instance_bounds)));
        bytes
    };
    assert!(bytes(&one) == bytes(&four));
    assert_eq!((one.stats, one.report), (four.stats, four.report));
}

#[test]
fn empty_scenes_are_empty() {
    let no_triangles = one_mesh(Primitive::default());
    let mut undrawn = busy();
    undrawn.instances.clear();
    undrawn.lights.clear();
    for scene in [Scene::default(), no_triangles, undrawn] {
        let prepared = prepared(&scene);
        assert_package(&prepared);
        assert!(prepared.vertices.is_empty() && prepared.indices.is_empty());
        assert!(prepared.meshes.is_empty() && prepared.primitives.is_empty());
        assert!(prepared.instances.is_empty() && prepared.mesh_instances.is_empty());
        assert!(prepared.draw_groups.is_empty() && prepared.materials_used.is_empty());
        assert_eq!((prepared.bounds, prepared.features), (Aabb::EMPTY, 0));
        assert!(prepared.report.is_empty() && prepared.diagnostics.is_empty());
    }
}

#[test]
fn tiny_and_huge_coordinates_pass() {
    for scale in [1e-6f32, 1e7, 1e-30, 1e30] {
        let mut primitive = grid(6);
        for value in primitive.positions.as_flattened_mut() {
            *value *= scale;
        }
        primitive.normals = None;
        primitive.material = Some(0);
        let mut scene = one_mesh(primitive);
        scene.materials = vec![normal_mapped(0)];
        let prepared = prepared(&scene);
        assert_package(&prepared);
        assert_eq!(prepared.stats.degenerate_triangles, 0);
        let unit = |vertex: &Vertex| (Vec3::from(vertex.normal).length() - 1.0).abs() < 1e-6;
        assert!(prepared.vertices.iter().all(unit));
    }
}

#[test]
fn all_degenerate_primitives_pass() {
    let mut primitive = grid(8);
    primitive.positions.fill([3.0, 4.0, 5.0]);
    primitive.material = Some(0);
    let mut scene = one_mesh(primitive);
    scene.materials = vec![normal_mapped(0)];
    for normals in [true, false] {
        if !normals {
            scene.meshes[0].primitives[0].normals = None;
        }
        let prepared = prepared(&scene);
        assert_package(&prepared);
        assert_eq!(
            prepared.stats.degenerate_triangles,
            prepared.stats.triangles
        );
        assert_eq!(
            prepared.stats.tangent_fallbacks,
            prepared.indices.len() as u64
        );
    }
}

#[test]
fn progress_ends_in_one() {
    let seen = Mutex::new(Vec::new());
    prepare(&mut busy(), &|done| {
        seen.lock().expect("no panic").push(done)
    })
    .expect("valid");
    let seen = seen.into_inner().expect("no panic");
    assert_eq!(seen.last(), Some(&1.0));
    assert_eq!(seen.len(), 14 + 1);
    assert!(seen.iter().all(|done| (0.0..=1.0).contains(done)));
}
