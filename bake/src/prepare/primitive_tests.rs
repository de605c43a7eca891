//! Tests of one primitive from source to arenas.

use super::*;
use crate::prepare::testing::{Random, grid, normal_mapped};
use crate::scene::{Material, TextureRef};

fn base_colored(uv_set: u32) -> Material {
    Material {
        base_color_texture: Some(TextureRef::new(0, uv_set)),
        ..Material::default()
    }
}

fn built(primitive: &Primitive, material: &Material) -> Built {
    let uses = MaterialUse::of(Some(material));
    build(primitive.clone(), &uses, Policy::default())
}

/// The same, with the triangles in the order of the source.
fn in_order(primitive: &Primitive, material: &Material) -> Built {
    let policy = Policy {
        keep: true,
        ..Policy::default()
    };
    let uses = MaterialUse::of(Some(material));
    build(primitive.clone(), &uses, policy)
}

/// The vertex that each corner draws.
fn soup(built: &Built) -> Vec<Vertex> {
    built
        .indices
        .iter()
        .map(|index| built.vertices[*index as usize])
        .collect()
}

fn bits(vertex: &Vertex) -> [u32; 14] {
    bytemuck::cast(*vertex)
}

/// Asserts that vertices are distinct, all used, and in order of first appearance.
fn assert_welded(built: &Built) {
    let mut next = 0;
    for index in &built.indices {
        assert!(*index <= next);
        next = next.max(index + 1);
    }
    assert_eq!(next as usize, built.vertices.len());
    let distinct: std::collections::BTreeSet<_> = built.vertices.iter().map(bits).collect();
    assert_eq!(distinct.len(), built.vertices.len());
}

#[test]
fn attributes_are_copied_bit_for_bit() {
    let mut source = grid(5);
    source.positions[3] = [-0.0, f32::from_bits(1), 1e-6];
    source.positions[4] = [1e7, -1e7, 0.1];
    source.normals.as_mut().expect("grid has normals")[7] = [0.0, -3.5, 0.0];
    let mut material = base_colored(0);
    material.occlusion_texture = Some(TextureRef::new(0, 1));
    let built = in_order(&source, &material);
    assert_welded(&built);
    for (vertex, index) in soup(&built).iter().zip(&source.indices) {
        let index = *index as usize;
        assert_eq!(
            vertex.position.map(f32::to_bits),
            source.positions[index].map(f32::to_bits)
        );
        assert_eq!(
            Some(vertex.normal),
            source.normals.as_ref().map(|values| values[index])
        );
        assert_eq!(
            Some(vertex.uv0),
            source.uv0.as_ref().map(|values| values[index])
        );
        assert_eq!(
            Some(vertex.uv1),
            source.uv1.as_ref().map(|values| values[index])
        );
        assert_eq!(vertex.tangent, [0.0; 4]);
    }
    assert_eq!(built.stats.vertices_out, source.positions.len() as u64);
}

#[test]
fn coordinates_that_nothing_samples_are_absent() {
    let source = grid(3);
    let stored = |material: &Material| {
        let vertices = built(&source, material).vertices;
        let some = |uv: fn(&Vertex) -> [f32; 2]| vertices.iter().any(|v| uv(v) != [0.0; 2]);
        (some(|vertex| vertex.uv0), some(|vertex| vertex.uv1))
    };
    assert_eq!(stored(&Material::default()), (false, false));
    assert_eq!(stored(&base_colored(0)), (true, false));
    assert_eq!(stored(&base_colored(1)), (false, true));
    assert_eq!(stored(&normal_mapped(1)), (false, true));
}

#[test]
fn vertices_are_welded_once_coordinates_are_gone() {
    let mut source = grid(1);
    source.positions = vec![[0.0; 3], [0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    source.normals = Some(vec![[0.0, 0.0, 1.0]; 4]);
    source.indices = vec![0, 2, 3, 1, 2, 3];
    let welded = built(&source, &Material::default());
    assert_eq!(
        (welded.vertices.len(), welded.indices),
        (3, vec![0, 1, 2, 0, 1, 2])
    );
    assert_eq!(built(&source, &base_colored(0)).vertices.len(), 4);
}

#[test]
fn unreferenced_vertices_are_dropped() {
    let mut source = grid(4);
    source.positions[0] = [500.0; 3];
    source.indices.retain(|index| *index != 0);
    source.indices.truncate(source.indices.len() / 3 * 3);
    let built = built(&source, &Material::default());
    assert_welded(&built);
    assert!(built.bounds.max.max_element() < 2.0);
}

#[test]
fn absent_normals_are_flat_and_drop_authored_tangents() {
    let mut source = grid(6);
    source.tangents = Some(vec![[0.0, 0.0, 1.0, 1.0]; source.positions.len()]);
    source.normals = None;
    for material in [Material::default(), normal_mapped(0)] {
        let built = built(&source, &material);
        assert_welded(&built);
        assert_eq!(built.stats.flat_primitives, 1);
        for triangle in soup(&built).chunks_exact(3) {
            let [a, b, c] =
                [0, 1, 2].map(|corner| Vec3::from(triangle[corner].position).as_dvec3());
            let expected = (b - a).cross(c - a).normalize();
            for vertex in triangle {
                let normal = Vec3::from(vertex.normal).as_dvec3();
                assert!(normal.cross(expected).length() < 1e-6 && normal.dot(expected) > 0.0);
                assert_ne!(
                    [vertex.tangent[0], vertex.tangent[1], vertex.tangent[2]],
                    [0.0, 0.0, 1.0]
                );
            }
        }
    }
}

#[test]
fn authored_tangents_are_kept() {
    let mut source = grid(3);
    let mut random = Random(8);
    let mut tangent = || {
        (random.vector().as_vec3() + Vec3::Y * 3.0)
            .extend(-0.5)
            .to_array()
    };
    let mut tangents: Vec<_> = source.positions.iter().map(|_| tangent()).collect();
    tangents[0] = [0.0; 4];
    source.tangents = Some(tangents.clone());
    let mapped = in_order(&source, &normal_mapped(0));
    assert_welded(&mapped);
    assert_eq!(mapped.stats.tangent_fallbacks, 1);
    assert_eq!(
        (
            mapped.stats.generated_tangents,
            mapped.stats.mixed_handedness
        ),
        (0, 1)
    );
    for (vertex, index) in soup(&mapped).iter().zip(&source.indices) {
        let [x, y, z, _] = tangents[*index as usize];
        if *index > 0 {
            assert_eq!(vertex.tangent, [x, y, z, -1.0]);
        } else {
            assert_eq!(vertex.tangent[3], 1.0);
        }
    }
    let plain = in_order(&source, &base_colored(0));
    assert!(
        plain
            .vertices
            .iter()
            .all(|vertex| vertex.tangent == [0.0; 4])
    );
}

#[test]
fn a_mirrored_seam_shared_by_index_is_split() {
    let mut source = grid(2);
    for uv in source.uv0.as_mut().expect("grid has uv0") {
        uv[0] = (uv[0] - 0.5).abs();
    }
    let built = built(&source, &normal_mapped(0));
    assert_welded(&built);
    assert_eq!(
        built.vertices.len(),
        9 + 3,
        "the three vertices of the middle line are doubled"
    );
    assert_eq!(
        (built.stats.mixed_handedness, built.stats.tangent_fallbacks),
        (0, 0)
    );
    let middle: Vec<_> = built
        .vertices
        .iter()
        .filter(|vertex| vertex.uv0[0] == 0.0)
        .collect();
    assert_eq!(middle.len(), 6);
    assert_eq!(
        middle.iter().map(|vertex| vertex.tangent[3]).sum::<f32>(),
        0.0
    );
}

#[test]
fn tangents_follow_the_coordinates_of_the_normal_map() {
    let mut source = grid(2);
    let turned = |uvs: &Vec<[f32; 2]>| uvs.iter().map(|[u, v]| [*v, -*u]).collect();
    source.uv1 = source.uv0.as_ref().map(turned);
    let first = built(&source, &normal_mapped(0)).vertices;
    let second = built(&source, &normal_mapped(1)).vertices;
    assert!(first.iter().all(|vertex| vertex.tangent[0].abs() > 0.5));
    assert!(second.iter().all(|vertex| vertex.tangent[1].abs() > 0.5));
    source.uv1 = None;
    let absent = built(&source, &normal_mapped(1));
    assert!(absent.warning.is_some());
    assert_eq!(
        (
            absent.stats.missing_normal_uvs,
            absent.stats.generated_tangents
        ),
        (1, 0)
    );
    assert_eq!(absent.stats.tangent_fallbacks, source.indices.len() as u64);
    assert!(
        absent
            .vertices
            .iter()
            .all(|vertex| vertex.tangent == tangents::fallback(vertex.normal))
    );
}

#[test]
fn tangents_follow_the_transformed_coordinates() {
    let source = grid(4);
    let transformed = |scale: [f32; 2], rotation: f32| {
        let transform = UvTransform::new([0.5, -3.0], rotation, scale);
        let mut material = normal_mapped(0);
        material.normal_texture = Some(TextureRef {
            transform,
            ..TextureRef::new(0, 0)
        });
        let found = in_order(&source, &material);
        let mut baked = source.clone();
        for uv in baked.uv0.as_mut().expect("grid has uv0") {
            *uv = transform.apply(*uv);
        }
        let expected = in_order(&baked, &normal_mapped(0));
        let corners = || soup(&found).into_iter().zip(soup(&expected));
        for (found, expected) in corners() {
            assert_eq!(
                found.tangent.map(f32::to_bits),
                expected.tangent.map(f32::to_bits)
            );
        }
        for (vertex, index) in soup(&found).iter().zip(&source.indices) {
            let raw = source.uv0.as_ref().map(|uvs| uvs[*index as usize]);
            assert_eq!(Some(vertex.uv0), raw, "stored as they are");
        }
        found.vertices
    };
    let plain = transformed([3.0, 3.0], 0.0);
    assert!(
        plain
            .iter()
            .all(|vertex| vertex.tangent[3] == 1.0 && vertex.tangent[0] > 0.5)
    );
    let mirrored = transformed([-1.0, 1.0], 0.0);
    assert!(
        mirrored
            .iter()
            .all(|vertex| vertex.tangent[3] == -1.0 && vertex.tangent[0] < -0.5)
    );
    let turned = transformed([1.0, 1.0], std::f32::consts::FRAC_PI_2);
    assert!(turned.iter().all(|vertex| vertex.tangent[1].abs() > 0.9));
}

#[test]
fn transforms_leave_authored_tangents_alone() {
    let mut source = grid(2);
    source.tangents = Some(vec![[0.0, 1.0, 0.0, 1.0]; source.positions.len()]);
    let mut material = normal_mapped(0);
    let texture = material.normal_texture.as_mut().expect("mapped");
    texture.transform = UvTransform::new([0.0; 2], 0.0, [-1.0, 1.0]);
    let vertices = built(&source, &material).vertices;
    assert!(
        vertices
            .iter()
            .all(|vertex| vertex.tangent == [0.0, 1.0, 0.0, 1.0])
    );
}

#[test]
fn transforms_beyond_f32_give_stand_ins() {
    let mut material = normal_mapped(0);
    let texture = material.normal_texture.as_mut().expect("mapped");
    texture.transform = UvTransform::new([f32::MAX; 2], 0.0, [f32::MAX; 2]);
    let built = built(&grid(2), &material);
    assert!(built.warning.is_some_and(|why| why.contains("transform")));
    assert_eq!(built.stats.generated_tangents, 0);
}

#[test]
fn colors_split_and_follow_their_vertices() {
    let mut source = grid(6);
    source.normals = None;
    let plain = built(&source, &Material::default());
    assert!(plain.colors.is_empty());
    let shade = |index: usize| [index as f32 / 255.0, 0.5, 1.0, 1.0];
    source.colors = Some((0..source.positions.len()).map(shade).collect());
    let colored = built(&source, &Material::default());
    assert_eq!(colored.colors.len(), colored.vertices.len());
    assert!(colored.stats.color_error > 0.0 && colored.stats.color_error < 1e-5);
    for (vertex, color) in colored.vertices.iter().zip(&colored.colors) {
        let index = source
            .positions
            .iter()
            .position(|found| *found == vertex.position);
        let red = index.map(|index| (index * 257) as u32);
        assert_eq!(Some(color.red_green & 0xFFFF), red);
        assert_eq!(color.blue_alpha, u32::MAX);
    }
    // Two vertices that differ in colour alone.
    source.indices = vec![0, 1, 2, 3, 1, 2];
    source.normals = Some(vec![[0.0, 0.0, 1.0]; source.positions.len()]);
    source.positions[3] = source.positions[0];
    assert_eq!(built(&source, &Material::default()).vertices.len(), 4);
    source.colors = None;
    assert_eq!(built(&source, &Material::default()).vertices.len(), 3);
}

#[test]
fn welding_and_ordering_keep_the_triangles() {
    let mut random = Random(31);
    for round in 0..20 {
        let mut source = grid(7);
        for index in &mut source.indices {
            if random.bits().is_multiple_of(9) {
                *index = (random.bits() % 64) as u32;
            }
        }
        let shade = |_| [random.signed().abs() as f32, 0.0, 0.0, 1.0];
        if round % 2 == 0 {
            source.colors = Some((0..64).map(shade).collect());
        }
        if round % 3 == 0 {
            source.normals = None;
        }
        let material = normal_mapped(round % 2);
        let (kept, moved) = (in_order(&source, &material), built(&source, &material));
        assert_welded(&moved);
        assert_eq!(kept.traced, moved.traced);
        assert_eq!(
            kept.indices.len() - kept.traced,
            3 * kept.stats.degenerate_triangles as usize
        );
        assert_eq!(
            rotated(&kept, 0..kept.traced),
            rotated(&moved, 0..kept.traced)
        );
        let behind = kept.traced..kept.indices.len();
        assert_eq!(rotated(&kept, behind.clone()), rotated(&moved, behind));
    }
}

/// Triangles whose corners are turned so that the least comes first, sorted.
fn rotated(built: &Built, indices: std::ops::Range<usize>) -> Vec<[Vec<u32>; 3]> {
    let corner = |index: u32| {
        let mut key = bits(&built.vertices[index as usize]).to_vec();
        if let Some(color) = built.colors.get(index as usize) {
            key.extend([color.red_green, color.blue_alpha]);
        }
        key
    };
    let turned = |triangle: &[u32]| {
        let [a, b, c] = [0, 1, 2].map(|place| corner(triangle[place]));
        let turns = [
            [a.clone(), b.clone(), c.clone()],
            [b.clone(), c.clone(), a.clone()],
            [c, a, b],
        ];
        turns.into_iter().min().unwrap_or_default()
    };
    let mut triangles: Vec<_> = built.indices[indices].chunks_exact(3).map(turned).collect();
    triangles.sort();
    triangles
}

#[test]
fn degenerate_triangles_are_counted_and_kept() {
    let mut source = grid(2);
    let count = source.indices.len() as u64 / 3;
    source.indices.extend([0, 0, 1, 0, 1, 2, 4, 4, 4]);
    source.normals = None;
    for material in [Material::default(), normal_mapped(0)] {
        let built = built(&source, &material);
        assert_eq!(
            (built.stats.triangles, built.stats.degenerate_triangles),
            (count + 3, 2)
        );
        assert_eq!(built.indices.len(), source.indices.len());
        assert_eq!(built.traced as u64, (count + 1) * 3);
        for vertex in &built.vertices {
            assert!(
                bytemuck::cast::<Vertex, [f32; 14]>(*vertex)
                    .iter()
                    .all(|value| value.is_finite())
            );
        }
    }
}

#[test]
fn a_single_point_is_a_primitive() {
    let source = Primitive {
        positions: vec![[1.0, 2.0, 3.0]],
        indices: vec![0; 9],
        ..Primitive::default()
    };
    let built = built(&source, &normal_mapped(0));
    assert_eq!((built.vertices.len(), built.indices), (1, vec![0; 9]));
    assert_eq!((built.stats.degenerate_triangles, built.traced), (3, 0));
    assert_eq!(built.bounds.min, built.bounds.max);
    assert_eq!(built.vertices[0].normal, normals::FALLBACK);
}

/// Prints the time of tangents; run it alone with `--ignored --nocapture`.
#[test]
#[ignore = "a measurement"]
fn time_of_200k_triangles() {
    let source = grid(316);
    for material in [base_colored(0), normal_mapped(0)] {
        let start = std::time::Instant::now();
        let built = built(&source, &material);
        let triangles = built.stats.triangles;
        eprintln!(
            "{triangles} triangles: {:?}, {} tangents",
            start.elapsed(),
            built.stats.generated_tangents
        );
        assert_eq!(built.stats.vertices_out, source.positions.len() as u64);
    }
}
