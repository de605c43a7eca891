//! Tests of instances and their draw groups.

use glam::{DMat4, DVec3};

use super::*;
use crate::prepare::geometry;
use crate::prepare::testing::{Random, grid, node, one_mesh};
use crate::scene::{Material, Mesh, Primitive};

fn placed(scene: &Scene) -> (Stored, Placed) {
    let stored = geometry::build(&mut scene.clone(), &crate::cache::Session::off(), &|_| ())
        .expect("the scene is valid");
    let placed = place(scene, &stored).expect("the scene is in range");
    (stored, placed)
}

/// Three meshes with every kind of material, and nodes of which some are mirrored.
fn mixed(nodes: usize) -> Scene {
    let material = |alpha_mode, double_sided| Material {
        alpha_mode,
        double_sided,
        ..Material::default()
    };
    let primitive = |material: Option<u32>| Primitive {
        material,
        ..grid(1)
    };
    let mesh = |materials: &[Option<u32>]| Mesh {
        name: String::new(),
        primitives: materials
            .iter()
            .map(|material| primitive(*material))
            .collect(),
    };
    let mut random = Random(4);
    let mut world = || {
        let scale = random.vector() + DVec3::splat(0.3);
        DMat4::from_scale_rotation_translation(scale, random.rotation(), random.vector() * 50.0)
    };
    Scene {
        meshes: vec![
            mesh(&[Some(0), Some(1), None]),
            Mesh::default(),
            mesh(&[Some(2), Some(3), Some(2)]),
            mesh(&[Some(1)]),
        ],
        materials: vec![
            material(AlphaMode::Blend, false),
            material(AlphaMode::Mask, true),
            material(AlphaMode::Opaque, true),
            material(AlphaMode::Opaque, false),
        ],
        instances: (0..nodes)
            .map(|index| node(index as u32 % 4, world()))
            .collect(),
        ..Scene::default()
    }
}

/// Asserts everything that draw groups promise.
fn assert_partition(scene: &Scene, stored: &Stored, placed: &Placed) {
    let mut next = 0;
    let mut keys = Vec::new();
    let mut distinct = std::collections::BTreeSet::new();
    for group in &placed.groups {
        assert_eq!(group.first_instance, next);
        assert!(group.instance_count > 0);
        next += group.instance_count;
        let primitive = &stored.primitives[group.primitive as usize];
        assert_eq!(group.first_index, primitive.first_index);
        assert_eq!(group.index_count, primitive.index_count);
        assert_eq!(group.vertex_offset, primitive.first_vertex);
        keys.push((
            group.alpha_mode,
            group.flags & DRAW_DOUBLE_SIDED,
            group.flags & DRAW_MIRRORED,
        ));
        assert!(
            distinct.insert((keys.last().copied(), group.primitive)),
            "no group twice"
        );
        let members = group.first_instance as usize..next as usize;
        for instance in &placed.instances[members] {
            assert_eq!(instance.material_index, primitive.material);
            let model = glam::Mat4::from_cols_array_2d(&instance.model).as_dmat4();
            assert_eq!(model.determinant() < 0.0, group.flags & DRAW_MIRRORED != 0);
        }
        let material = materials::get(scene, stored.materials[primitive.material as usize]);
        let double_sided = material.is_some_and(|material| material.double_sided);
        assert_eq!(double_sided, group.flags & DRAW_DOUBLE_SIDED != 0);
    }
    assert_eq!(next as usize, placed.instances.len());
    assert_eq!(placed.bounds.len(), placed.instances.len());
    assert!(keys.is_sorted(), "states are changed as rarely as can be");
}

#[test]
fn groups_partition_the_instances() {
    let scene = mixed(37);
    let (stored, placed) = placed(&scene);
    assert_partition(&scene, &stored, &placed);
    assert_eq!(placed.instances.len(), 10 * 3 + 9 * 3 + 9);
    assert_eq!(placed.mesh_instances.len(), 28);
    assert_eq!(
        placed.groups.len(),
        14,
        "seven primitives, mirrored and not"
    );
    assert!(placed.mirrored);
    assert_eq!(
        placed.stats.drawn_triangles,
        placed.instances.len() as u64 * 2
    );
}

#[test]
fn mesh_instances_are_nodes() {
    let scene = mixed(8);
    let (stored, placed) = placed(&scene);
    let sources = scene.instances.iter().filter(|instance| instance.mesh != 1);
    for (found, source) in placed.mesh_instances.iter().zip(sources) {
        let number = stored.mesh_numbers[source.mesh as usize].expect("stored");
        assert_eq!(found.mesh, number);
        assert_eq!(
            found.first_geometry,
            stored.meshes[number as usize].first_primitive
        );
        assert_eq!(
            found.flags == DRAW_MIRRORED,
            source.world.determinant() < 0.0
        );
        let rows = source.world.as_mat4().transpose().to_cols_array_2d();
        assert_eq!(found.transform, [rows[0], rows[1], rows[2]]);
    }
}

/// Ten thousand sheets in a cube, in random order, of one mesh each or of one mesh all.
fn cloud(shared: bool) -> Scene {
    let mut random = Random(77);
    let mut scene = one_mesh(grid(1));
    if !shared {
        scene.meshes = vec![scene.meshes[0].clone(); 10_000];
    }
    let mut at = |index| {
        let mesh = if shared { 0 } else { index };
        node(mesh, DMat4::from_translation(random.vector() * 100.0))
    };
    scene.instances = (0..10_000).map(&mut at).collect();
    scene
}

#[test]
fn neighbours_in_the_list_are_neighbours_in_space() {
    for shared in [true, false] {
        let scene = cloud(shared);
        let (stored, placed) = placed(&scene);
        assert_partition(&scene, &stored, &placed);
        let again = self::placed(&scene).1;
        assert!(
            bytemuck::cast_slice::<_, u8>(&placed.instances)
                == bytemuck::cast_slice::<_, u8>(&again.instances)
        );
        // A cube of side 200 with 157 clusters: 37 a side each, were they cubes; diagonals are 64 then.
        let clusters = cairn_format::bounds::clusters(&placed.bounds);
        let sum: f32 = clusters.iter().map(|aabb| aabb.diagonal()).sum();
        let mean = sum / clusters.len() as f32;
        assert!(mean < 110.0, "{mean}");
    }
}

#[test]
fn ten_thousand_instances_keep_their_order() {
    let mut scene = one_mesh(grid(1));
    let at = |index: usize| node(0, DMat4::from_translation(DVec3::X * index as f64));
    scene.instances = (0..10_000).map(at).collect();
    let (stored, placed) = placed(&scene);
    assert_partition(&scene, &stored, &placed);
    assert_eq!((placed.groups.len(), stored.vertices.len()), (1, 4));
    for (index, instance) in placed.instances.iter().enumerate() {
        assert_eq!(instance.model[3], [index as f32, 0.0, 0.0, 1.0]);
    }
}

#[test]
fn overflow_names_the_node() {
    let mut scene = one_mesh(grid(1));
    for scale in [1e39, 3.4e38] {
        scene.instances[0].name = "giant".into();
        scene.instances[0].world =
            DMat4::from_scale(DVec3::splat(scale)) * DMat4::from_rotation_z(0.8);
        let stored = geometry::build(&mut scene.clone(), &crate::cache::Session::off(), &|_| ())
            .expect("the mesh is fine");
        let error = place(&scene, &stored).expect_err("the world position overflows");
        assert!(error.to_string().contains("node `giant`"), "{error}");
    }
}

#[test]
fn singular_scale_is_finite() {
    let mut scene = one_mesh(grid(2));
    for scale in [
        DVec3::ZERO,
        DVec3::new(1.0, 0.0, 1.0),
        DVec3::new(-2.0, 0.0, 0.0),
    ] {
        scene.instances[0].world = DMat4::from_rotation_y(0.4) * DMat4::from_scale(scale);
        let (stored, placed) = placed(&scene);
        assert_partition(&scene, &stored, &placed);
        let matrix = placed.instances[0].normal_matrix;
        assert!(matrix.as_flattened().iter().all(|value| value.is_finite()));
        assert!(matrix.as_flattened().iter().any(|value| *value != 0.0));
        assert!(placed.bounds[0].min.is_finite() && !placed.bounds[0].is_empty());
    }
}
