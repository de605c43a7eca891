//! Tests of the order of triangles and vertices.

use std::collections::BTreeSet;

use bytemuck::Zeroable;
use proptest::prelude::*;

use super::*;
use crate::prepare::testing::{Random, grid};

type Corner = ([u32; 14], Option<[u32; 2]>);

fn corner(mesh: &Welded, index: u32) -> Corner {
    let color = mesh.colors.get(index as usize);
    (
        bytemuck::cast(mesh.vertices[index as usize]),
        color.map(|color| [color.red_green, color.blue_alpha]),
    )
}

/// The triangles of `indices`, each turned so that its least corner comes first, sorted.
fn triangles(mesh: &Welded, indices: &[u32]) -> Vec<[Corner; 3]> {
    let mut triangles: Vec<[Corner; 3]> = indices
        .chunks_exact(3)
        .map(|triangle| {
            let mut corners = [0, 1, 2].map(|place| corner(mesh, triangle[place]));
            let turns = [0, 1, 2].map(|turn| {
                let mut turned = corners;
                turned.rotate_left(turn);
                turned
            });
            corners = turns.into_iter().min().unwrap_or(corners);
            corners
        })
        .collect();
    triangles.sort();
    triangles
}

fn vertex(number: usize) -> Vertex {
    Vertex {
        position: [number as f32, (number * number % 17) as f32, 1.0],
        ..Vertex::zeroed()
    }
}

/// A mesh whose vertices are all used, in order of first use, with `count` colours.
fn mesh(mut indices: Vec<u32>, colored: bool) -> Welded {
    let mut numbers = std::collections::BTreeMap::new();
    for index in &mut indices {
        let next = numbers.len() as u32;
        *index = *numbers.entry(*index).or_insert(next);
    }
    let count = numbers.len();
    let color = |number: usize| VertexColor {
        red_green: number as u32,
        blue_alpha: 7,
    };
    Welded {
        vertices: (0..count).map(vertex).collect(),
        colors: if colored {
            (0..count).map(color).collect()
        } else {
            Vec::new()
        },
        indices,
    }
}

fn run(mesh: &Welded, degenerate: &[bool], policy: Policy) -> (Welded, usize, GeometryStats) {
    let mut result = mesh.clone();
    let mut stats = GeometryStats::default();
    let mut steps = Steps::default();
    let traced = optimize(&mut result, degenerate, policy, &mut stats, &mut steps);
    (result, traced, stats)
}

proptest! {
    #[test]
    fn triangles_survive_and_the_traced_ones_lead(
        corners in prop::collection::vec(prop::array::uniform3(0u32..60), 1..200),
        colored: bool,
        keep: bool,
    ) {
        let source = mesh(corners.concat(), colored);
        let degenerate: Vec<bool> = corners
            .iter()
            .map(|[a, b, c]| a == b || b == c || c == a)
            .collect();
        let policy = Policy { keep, measure_overdraw: true };
        let (result, traced, _) = run(&source, &degenerate, policy);
        let sound: Vec<u32> = source
            .indices
            .chunks_exact(3)
            .zip(&degenerate)
            .filter(|(_, degenerate)| !**degenerate)
            .flat_map(|(triangle, _)| triangle.to_vec())
            .collect();
        prop_assert_eq!(traced, sound.len());
        prop_assert_eq!(
            triangles(&result, &result.indices[..traced]),
            triangles(&source, &sound)
        );
        prop_assert_eq!(
            triangles(&result, &result.indices),
            triangles(&source, &source.indices)
        );
        let mut next = 0;
        for index in &result.indices {
            prop_assert!(*index <= next, "vertices lie in order of first use");
            next = next.max(*index + 1);
        }
        prop_assert_eq!(next as usize, result.vertices.len());
        if keep {
            let order = |mesh: &Welded| -> Vec<Corner> {
                mesh.indices[..traced].iter().map(|index| corner(mesh, *index)).collect()
            };
            let kept: Vec<Corner> = sound.iter().map(|index| corner(&source, *index)).collect();
            prop_assert_eq!(order(&result), kept);
        }
    }
}

/// The triangles of a sheet in random order.
fn shuffled(cells: u32) -> Welded {
    let sheet = grid(cells);
    let mut triangles: Vec<[u32; 3]> = bytemuck::cast_slice(&sheet.indices).to_vec();
    let mut random = Random(9);
    for last in (1..triangles.len()).rev() {
        let other = (random.bits() % (last as u64 + 1)) as usize;
        triangles.swap(last, other);
    }
    let vertices = sheet.positions.iter().map(|position| Vertex {
        position: *position,
        ..Vertex::zeroed()
    });
    Welded {
        vertices: vertices.collect(),
        colors: Vec::new(),
        indices: triangles.concat(),
    }
}

#[test]
fn a_shuffled_sheet_becomes_cheap() {
    let source = shuffled(40);
    let degenerate = vec![false; source.indices.len() / 3];
    let policy = Policy {
        keep: false,
        measure_overdraw: true,
    };
    let (_, _, stats) = run(&source, &degenerate, policy);
    let per_triangle = |count: u64| count as f64 / degenerate.len() as f64;
    assert!(per_triangle(stats.transformed_before) > 2.0);
    assert!(per_triangle(stats.transformed_after) < 0.8);
    assert!(stats.pixels_covered > 0);
    assert!(stats.pixels_shaded_after >= stats.pixels_covered);
}

#[test]
fn what_cannot_improve_is_left_alone() {
    let source = mesh(vec![0, 1, 2, 2, 1, 3], false);
    let mut steps = Steps::default();
    let mut stats = GeometryStats::default();
    let mut result = source.clone();
    let policy = Policy::default();
    optimize(&mut result, &[false; 2], policy, &mut stats, &mut steps);
    assert_eq!(result.indices, source.indices);
    let ran: Vec<&str> = steps.list().iter().map(|step| step.name).collect();
    assert_eq!(ran, ["analysis"]);
    assert_eq!((stats.transformed_before, stats.transformed_after), (4, 4));
}

#[test]
fn a_wide_fan_takes_linear_time() {
    let count = 300_000;
    let fan: Vec<u32> = (1..=count)
        .flat_map(|rim| [0, rim, rim % count + 1])
        .collect();
    let source = mesh(fan, false);
    let degenerate = vec![false; count as usize];
    let (result, traced, _) = run(&source, &degenerate, Policy::default());
    assert_eq!(traced, result.indices.len());
    let rim: BTreeSet<u32> = result.indices.iter().copied().collect();
    assert_eq!(rim.len(), count as usize + 1);
    assert_eq!(triangles(&result, &result.indices).len(), count as usize);
}

#[test]
fn extreme_sizes_keep_their_triangles() {
    for scale in [0.0, 1e-40, 1e-20, 1e20, 3e38f32] {
        let mut source = shuffled(8);
        for vertex in &mut source.vertices {
            vertex.position = vertex.position.map(|value| value * scale);
        }
        let degenerate = vec![false; source.indices.len() / 3];
        let policy = Policy {
            keep: false,
            measure_overdraw: true,
        };
        let (result, _, _) = run(&source, &degenerate, policy);
        assert_eq!(
            triangles(&result, &result.indices),
            triangles(&source, &source.indices)
        );
    }
}
