use super::*;
use glam::{Mat3, Quat, Vec4};
use proptest::prelude::*;

const ASPECT: f32 = 1.5;

fn hall() -> Aabb {
    Aabb {
        min: Vec3::new(-12.0, 0.0, -30.0),
        max: Vec3::new(9.0, 7.0, 25.0),
    }
}

fn camera(position: Vec3, turn: Quat) -> Camera {
    Camera {
        position,
        forward: turn * Vec3::NEG_Z,
        up: turn * Vec3::Y,
        znear: 0.05,
        ..Camera::default()
    }
}

fn fit(camera: &Camera, direction: Vec3, settings: &ShadowSettings) -> Cascades {
    Cascades::fit(camera, ASPECT, direction, hall(), settings)
}

fn linear(matrix: &Mat4) -> Mat3 {
    Mat3::from_mat4(*matrix)
}

/// Asserts that both cascades cut the scene into the same texels.
fn same_grid(a: &Cascade, b: &Cascade, resolution: u32) {
    assert_eq!((a.texel, a.end), (b.texel, b.end));
    assert_eq!(linear(&a.matrix), linear(&b.matrix));
    let texels = (a.matrix.w_axis - b.matrix.w_axis) * 0.5 * resolution as f32;
    for shift in [texels.x, texels.y] {
        assert!((shift - shift.round()).abs() < 0.02, "{shift} texels");
    }
    assert_eq!(texels.z, 0.0, "the depth range is the scene's");
}

fn turns() -> impl Strategy<Value = Quat> {
    (-3.2_f32..3.2, -1.5_f32..1.5, -3.2_f32..3.2)
        .prop_map(|(y, x, z)| Quat::from_euler(glam::EulerRot::YXZ, y, x, z))
}

fn positions() -> impl Strategy<Value = Vec3> {
    let Aabb { min, max } = hall();
    (min.x..max.x, min.y..max.y, min.z..max.z).prop_map(Vec3::from)
}

fn directions() -> impl Strategy<Value = Vec3> {
    let axes = [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, -Vec3::Y, -Vec3::Z];
    prop_oneof![
        turns().prop_map(|turn| turn * Vec3::NEG_Z),
        prop::sample::select(axes.to_vec()),
        (-1e-4_f32..1e-4).prop_map(|tilt| Vec3::new(tilt, -1.0, tilt * 0.5).normalize()),
    ]
}

fn all_settings() -> impl Strategy<Value = ShadowSettings> {
    let resolution = prop::sample::select(vec![512_u32, 1024, 2048, 4096]);
    (1_u32..=4, resolution, 0.0_f32..=1.0, 0_u32..=5).prop_map(
        |(cascades, resolution, lambda, pcf_radius)| ShadowSettings {
            cascades,
            resolution,
            lambda,
            pcf_radius,
            ..ShadowSettings::default()
        },
    )
}

/// The point at `depth` along the view and `x`, `y` of -1..=1 across the image.
fn seen(camera: &Camera, x: f32, y: f32, depth: f32) -> Vec3 {
    let Projection::Perspective { yfov } = camera.projection else {
        unreachable!("these tests look in perspective")
    };
    let slope = (yfov * 0.5).tan();
    let across = Vec3::new(x * slope * ASPECT, y * slope, -1.0) * depth;
    camera.view().inverse().transform_point3(across)
}

proptest! {
    /// W-15: neither translation nor rotation of the camera moves the grid of texels.
    #[test]
    fn texels_stay_where_they_are(
        from in positions(), to in positions(), a in turns(), b in turns(),
        direction in directions(), settings in all_settings(),
    ) {
        let first = fit(&camera(from, a), direction, &settings);
        let second = fit(&camera(to, b), direction, &settings);
        prop_assert_eq!(first.count(), second.count());
        for (a, b) in first.iter().zip(second.iter()) {
            same_grid(a, b, settings.resolution);
        }
    }

    /// What is seen lies in its cascade, a filter's border away from the edge.
    #[test]
    fn a_cascade_holds_its_slice(
        eye in positions(), turn in turns(), direction in directions(), settings in all_settings(),
        x in -1.0_f32..=1.0, y in -1.0_f32..=1.0, t in 0.0_f32..=1.0,
    ) {
        let camera = camera(eye, turn);
        let cascades = fit(&camera, direction, &settings);
        let mut begin = camera.znear;
        for cascade in cascades.iter() {
            let point = seen(&camera, x, y, begin + (cascade.end - begin) * t);
            let bounds = hall();
            begin = cascade.end;
            if point.cmplt(bounds.min).any() || point.cmpgt(bounds.max).any() {
                continue;
            }
            let ndc = cascade.matrix.project_point3(point);
            let border = f64::from(border(&settings)) - 1.0;
            let limit = 1.0 - 2.0 * border / f64::from(settings.resolution);
            let across = ndc.truncate().abs().max_element();
            prop_assert!(f64::from(across) <= limit, "{} of {}", across, limit);
            prop_assert!(ndc.z > 0.0 && ndc.z < 1.0, "depth {}", ndc.z);
        }
    }

    /// Whatever stands between a seen point and the light is among its cascade's casters.
    #[test]
    fn casters_reach_up_to_the_light(
        eye in positions(), turn in turns(), direction in directions(), settings in all_settings(),
        x in -1.0_f32..=1.0, y in -1.0_f32..=1.0, t in 0.0_f32..=1.0, towards in 0.0_f32..60.0,
    ) {
        let camera = camera(eye, turn);
        let cascades = fit(&camera, direction, &settings);
        let mut begin = camera.znear;
        for cascade in cascades.iter() {
            let point = seen(&camera, x, y, begin + (cascade.end - begin) * t);
            let blocker = point - direction * towards;
            begin = cascade.end;
            let bounds = hall();
            let inside = |p: Vec3| p.cmpge(bounds.min).all() && p.cmple(bounds.max).all();
            if inside(point) && inside(blocker) {
                let aabb = Aabb { min: blocker, max: blocker };
                prop_assert!(cascade.caster_frustum().may_see(&aabb));
            }
        }
    }

    /// W-16: one texel is as long along one axis as along the other.
    #[test]
    fn texels_are_square(eye in positions(), turn in turns(), direction in directions()) {
        let settings = ShadowSettings::default();
        let cascades = fit(&camera(eye, turn), direction, &settings);
        for cascade in cascades.iter() {
            let rows = linear(&cascade.matrix).transpose();
            for row in [rows.x_axis, rows.y_axis] {
                let texel = 2.0 / (row.length() * settings.resolution as f32);
                prop_assert!((texel / cascade.texel - 1.0).abs() < 1e-5);
            }
            prop_assert!((1.0 / rows.z_axis.length() / cascades.depth_range - 1.0).abs() < 1e-5);
            prop_assert!(rows.z_axis.dot(-direction) > 0.0, "depth grows towards the light");
        }
    }
}

#[test]
fn the_slices_adjoin_and_end_at_the_reach() {
    let settings = ShadowSettings::default();
    let camera = camera(Vec3::new(0.0, 2.0, 0.0), Quat::IDENTITY);
    let cascades = fit(&camera, Vec3::NEG_Y, &settings);
    let ends: Vec<f32> = cascades.iter().map(|cascade| cascade.end).collect();
    assert!(
        ends.is_sorted_by(|a, b| a < b) && ends.len() >= 3,
        "{ends:?}"
    );
    assert_eq!(ends.last(), Some(&cascades.max_distance));
    let reach = 1.5 * hall().diagonal();
    assert!((cascades.max_distance - reach).abs() < 1e-3 * reach);
}

#[test]
fn lambda_goes_from_even_to_logarithmic() {
    let ends = |lambda| [1, 2, 3, 4].map(|index| split(1.0, 81.0, lambda, index, 4));
    for (found, expected) in ends(0.0).into_iter().zip([21.0, 41.0, 61.0, 81.0]) {
        assert!((found - expected).abs() < 1e-9);
    }
    for (found, expected) in ends(1.0).into_iter().zip([3.0, 9.0, 27.0, 81.0]) {
        assert!((found - expected).abs() < 1e-9);
    }
}

#[test]
fn one_cascade_reaches_to_the_end() {
    let settings = ShadowSettings {
        cascades: 1,
        max_distance: 20.0,
        ..ShadowSettings::default()
    };
    let camera = camera(Vec3::new(0.0, 2.0, 0.0), Quat::IDENTITY);
    let cascades = fit(&camera, Vec3::new(0.6, -0.8, 0.0), &settings);
    assert_eq!(cascades.count(), 1);
    assert!(cascades.iter().all(|cascade| cascade.end == 20.0));
}

/// A scene that is seen whole from outside needs one cascade, whose size and place are the scene's.
#[test]
fn a_framed_scene_takes_one_cascade() {
    let settings = ShadowSettings::default();
    let camera = Camera::framing(hall(), ASPECT);
    let cascades = fit(&camera, Vec3::new(0.6, -0.8, 0.0), &settings);
    assert_eq!(cascades.count(), 1);
    let width = hall().diagonal() * 2048.0 / (2048.0 - 6.0);
    let texel = cascades.iter().next().map(|cascade| cascade.texel);
    assert!((texel.unwrap_or(0.0) * 2048.0 / width - 1.0).abs() < 1e-5);
    let farthest = (camera.position - hall().min).length();
    assert!(cascades.max_distance > farthest);
}

#[test]
fn a_scene_of_one_point_has_a_shadow_map() {
    for point in [Vec3::ZERO, Vec3::splat(1e4)] {
        let bounds = Aabb {
            min: point,
            max: point,
        };
        let camera = Camera::framing(bounds, ASPECT);
        let settings = ShadowSettings::default();
        let cascades = Cascades::fit(&camera, ASPECT, Vec3::NEG_Y, bounds, &settings);
        assert!(cascades.count() >= 1);
        for cascade in cascades.iter() {
            assert!(cascade.matrix.is_finite() && cascade.texel > 0.0);
            let ndc = cascade.matrix.project_point3(point);
            assert!(ndc.abs().max_element() < 1.0, "{ndc}");
        }
    }
}

#[test]
fn nothing_to_cover_gives_no_cascade() {
    let settings = ShadowSettings::default();
    let found = |bounds| Cascades::fit(&Camera::default(), ASPECT, Vec3::NEG_Y, bounds, &settings);
    assert_eq!(found(Aabb::EMPTY).count(), 0);
    assert_eq!(found(Aabb::EVERYWHERE).count(), 0);
}

/// A near plane of a hundred-thousandth of the reach leaves the first cascade a useful size.
#[test]
fn a_tiny_near_plane_wastes_no_cascade() {
    let settings = ShadowSettings::default();
    let camera = Camera {
        znear: 1e-5,
        ..camera(Vec3::new(0.0, 2.0, 0.0), Quat::IDENTITY)
    };
    let cascades = fit(&camera, Vec3::NEG_Y, &settings);
    let first = cascades.iter().next().map_or(0.0, |cascade| cascade.end);
    assert!(first > 0.01 * cascades.max_distance, "{first}");
}

#[test]
fn orthographic_views_are_covered() {
    let camera = Camera {
        projection: Projection::Orthographic { half_height: 4.0 },
        znear: 0.0,
        zfar: 40.0,
        position: Vec3::new(0.0, 3.0, 20.0),
        ..Camera::default()
    };
    let settings = ShadowSettings::default();
    let cascades = fit(&camera, Vec3::new(0.6, -0.8, 0.0), &settings);
    assert_eq!(cascades.max_distance, 40.0);
    let mut begin = 0.0;
    for cascade in cascades.iter() {
        for (x, y) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
            for depth in [begin, cascade.end] {
                let across = Vec4::new(x * 4.0 * ASPECT, y * 4.0, -depth, 1.0);
                let ndc = cascade.matrix * (camera.view().inverse() * across);
                assert!(ndc.truncate().truncate().abs().max_element() < 1.0);
            }
        }
        begin = cascade.end;
    }
}

/// The factors give the penumbra of a disc light: its width is the blocker's distance times `2 tan(diameter / 2)`.
#[test]
fn penumbra_factors_are_metric() {
    let settings = ShadowSettings::default();
    let camera = camera(Vec3::new(0.0, 2.0, 0.0), Quat::IDENTITY);
    let direction = Vec3::new(0.6, -0.8, 0.0);
    let cascades = fit(&camera, direction, &settings);
    let mut uniform = GlobalUniform::default();
    cascades.fill(&mut uniform, &settings, 0.02);
    assert_eq!(uniform.shadow_cascade_count, cascades.count());
    for (index, cascade) in cascades.iter().enumerate() {
        let receiver = Vec3::new(0.0, 1.0, -1.0);
        let depth = |point| cascade.matrix.project_point3(point).z;
        let difference = depth(receiver - direction * 3.0) - depth(receiver);
        let texels = difference * uniform.cascade_pcss_scale[index] / uniform.shadow_texel_size;
        let metres = texels * uniform.cascade_texel_world_size[index];
        let expected = 3.0 * 2.0 * 0.01_f32.tan();
        assert!(
            (metres / expected - 1.0).abs() < 1e-3,
            "{metres} {expected}"
        );
    }
}
