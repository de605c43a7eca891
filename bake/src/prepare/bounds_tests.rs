//! Tests of the world bounds against f32 arithmetic in many forms.

use bytemuck::Zeroable;
use proptest::prelude::*;

use super::*;
use crate::prepare::testing::Random;

fn vertices(points: &[[f32; 3]]) -> Vec<Vertex> {
    let vertex = |position: &[f32; 3]| Vertex {
        position: *position,
        ..Vertex::zeroed()
    };
    points.iter().map(vertex).collect()
}

/// Flushes a subnormal, as a GPU may.
fn flushed(value: f32) -> f32 {
    if value.is_subnormal() { 0.0 } else { value }
}

/// The values that a row may give for a point: orders, association and fusing of the four terms, with and without
/// flushing.
fn evaluations(row: [f32; 4], point: [f32; 3]) -> Vec<f32> {
    const ORDERS: [[usize; 4]; 8] = [
        [0, 1, 2, 3],
        [3, 2, 1, 0],
        [3, 0, 1, 2],
        [2, 0, 3, 1],
        [1, 3, 0, 2],
        [0, 2, 1, 3],
        [1, 2, 0, 3],
        [2, 3, 1, 0],
    ];
    let point = [point[0], point[1], point[2], 1.0];
    let mut found = Vec::new();
    for flush in [|value: f32| value, flushed] {
        let (row, point) = (row.map(flush), point.map(flush));
        let product = |term: usize| flush(row[term] * point[term]);
        let fused = |sum: f32, term: usize| flush(row[term].mul_add(point[term], sum));
        for [a, b, c, d] in ORDERS {
            let add = |x: f32, y: f32| flush(x + y);
            found.push(add(
                add(add(product(a), product(b)), product(c)),
                product(d),
            ));
            found.push(add(
                add(product(a), product(b)),
                add(product(c), product(d)),
            ));
            found.push(fused(fused(fused(product(a), b), c), d));
            found.push(add(fused(product(a), b), fused(product(c), d)));
            found.push(add(fused(fused(product(a), b), c), product(d)));
        }
    }
    found
}

/// Asserts that the box holds every evaluation, and returns it.
fn check(model: &[[f32; 4]; 4], points: &[[f32; 3]]) -> WorldBounds {
    let vertices = vertices(points);
    let found = Cloud::new(&vertices).world_bounds(model).expect("in range");
    let limits = found
        .aabb
        .min
        .to_array()
        .into_iter()
        .zip(found.aabb.max.to_array());
    for (axis, (min, max)) in limits.enumerate() {
        let row: [f32; 4] = std::array::from_fn(|column| model[column][axis]);
        for point in points {
            for value in evaluations(row, *point) {
                assert!(
                    min <= value && value <= max,
                    "{value:e} outside {min:e}..{max:e}"
                );
            }
        }
    }
    found
}

fn cloud(random: &mut Random, count: usize, size: f64) -> Vec<[f32; 3]> {
    (0..count)
        .map(|_| (random.vector() * size).as_vec3().to_array())
        .collect()
}

fn random_model(random: &mut Random, scale: f64, translation: f64) -> [[f32; 4]; 4] {
    let mut column = |size: f64, w: f32| (random.vector() * size).as_vec3().extend(w).to_array();
    [
        column(scale, 0.0),
        column(scale, 0.0),
        column(scale, 0.0),
        column(translation, 1.0),
    ]
}

fn brute_force(model: &[[f32; 4]; 4], points: &[[f32; 3]]) -> Aabb {
    let vertices = vertices(points);
    let cloud = Cloud::new(&vertices);
    let intervals: [Interval; 3] = std::array::from_fn(|axis| {
        let row = Row::new(model, axis, &cloud);
        let mut interval = Interval::EMPTY;
        for point in points {
            interval.include(&row, point.map(f64::from));
        }
        interval
    });
    let [x, y, z] = intervals.map(|interval| interval.rounded());
    Aabb {
        min: Vec3::new(x.0, y.0, z.0),
        max: Vec3::new(x.1, y.1, z.1),
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, ..ProptestConfig::default() })]

    #[test]
    fn every_evaluation_lies_inside(
        seed in any::<u64>(),
        scale in -8i32..=8,
        size in prop_oneof![Just(-6i32), Just(0), Just(7)],
        translation in -8i32..=8,
        singular in 0usize..6,
    ) {
        let mut random = Random(seed);
        let power = |exponent: i32| libm::pow(10.0, exponent.into());
        let points = cloud(&mut random, 40, power(size));
        let mut model = random_model(&mut random, power(scale), power(translation));
        match singular {
            0 => model[1] = [0.0; 4],
            1 => model[2] = model[0],
            2 => for column in &mut model { column[0] = 0.0; },
            3 => model[0] = model[0].map(|value| -value),
            4 => model[3] = [0.0, 0.0, 0.0, 1.0],
            _ => (),
        }
        check(&model, &points);
    }

    #[test]
    fn skipping_blocks_changes_nothing(seed in any::<u64>(), count in 1usize..2000) {
        let mut random = Random(seed);
        let points = cloud(&mut random, count, 10.0);
        let model = random_model(&mut random, 3.0, 100.0);
        let vertices = vertices(&points);
        let found = Cloud::new(&vertices).world_bounds(&model).expect("in range");
        prop_assert_eq!(found.aabb, brute_force(&model, &points));
    }

    #[test]
    fn without_cancellation_the_slack_is_four_ulp(seed in any::<u64>(), exponent in -20i32..20) {
        let mut random = Random(seed);
        let positive = |values: [f32; 3]| values.map(f32::abs);
        let points: Vec<_> = cloud(&mut random, 30, 5.0).into_iter().map(positive).collect();
        let size = libm::exp2(exponent.into());
        let model = random_model(&mut random, size, size).map(|column| column.map(f32::abs));
        let found = check(&model, &points);
        prop_assert!(found.slack_ulp <= 4.0, "{}", found.slack_ulp);
    }

    #[test]
    fn tiny_numbers_survive_flushing(seed in any::<u64>()) {
        let mut random = Random(seed);
        let points = cloud(&mut random, 20, 1e-38);
        check(&random_model(&mut random, 1.0, 1e-38), &points);
        check(&random_model(&mut random, 1e-38, 1e-39), &points);
        let points = cloud(&mut random, 20, 1e30);
        check(&random_model(&mut random, 1e-38, 0.0), &points);
    }
}

#[test]
fn identity_and_mirrors_are_exact() {
    let points = cloud(&mut Random(1), 100, 7.0);
    let exact = points
        .iter()
        .fold(Aabb::EMPTY, |aabb, point| aabb.include(Vec3::from(*point)));
    let mut model = glam::Mat4::IDENTITY.to_cols_array_2d();
    let found = check(&model, &points);
    assert_eq!((found.aabb, found.slack_ulp), (exact, 0.0));
    model[0][0] = -1.0;
    let found = check(&model, &points);
    assert_eq!(
        (found.aabb.min.x, found.aabb.max.x),
        (-exact.max.x, -exact.min.x)
    );
}

#[test]
fn one_vertex_and_a_zero_matrix_are_bounded() {
    let point = [[1.0, -2.0, 3.0]];
    let zero = glam::Mat4::from_cols(
        glam::Vec4::ZERO,
        glam::Vec4::ZERO,
        glam::Vec4::ZERO,
        glam::Vec4::W,
    );
    let found = check(&zero.to_cols_array_2d(), &point);
    assert_eq!((found.aabb.min, found.aabb.max), (Vec3::ZERO, Vec3::ZERO));
    let found = check(&glam::Mat4::from_rotation_x(0.3).to_cols_array_2d(), &point);
    assert!(!found.aabb.is_empty() && found.aabb.diagonal() < 1e-5);
}

#[test]
fn a_far_node_stays_tight() {
    let points = cloud(&mut Random(2), 50, 1.0);
    let model = glam::Mat4::from_translation(Vec3::new(1e7, -1e7, 0.0)).to_cols_array_2d();
    let found = check(&model, &points);
    assert!(found.slack_ulp <= 4.0, "{}", found.slack_ulp);
}

#[test]
fn overflow_is_noticed() {
    let vertices = vertices(&[[1e20, 0.0, 0.0], [0.0; 3]]);
    let cloud = Cloud::new(&vertices);
    assert!(
        cloud
            .world_bounds(&glam::Mat4::from_scale(Vec3::splat(1e18)).to_cols_array_2d())
            .is_some()
    );
    assert!(
        cloud
            .world_bounds(&glam::Mat4::from_scale(Vec3::splat(1e19)).to_cols_array_2d())
            .is_none()
    );
}
