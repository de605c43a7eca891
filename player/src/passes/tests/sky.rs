//! The sky, its orientation, and its reflection.

use cairn_format::gpu::Material;
use glam::{Mat4, Quat, Vec3};

use super::fixture::{Fixture, quad};
use super::{along, assert_near, device, middle, plain, shoot, texel, towards_origin};
use crate::camera::Projection;
use crate::settings::Settings;

/// A colour for each of +X -X +Y -Y +Z -Z.
const FACES: [[f32; 3]; 6] = [
    [1.0, 0.0, 0.0],
    [0.0, 1.0, 0.0],
    [0.0, 0.0, 1.0],
    [1.0, 1.0, 0.0],
    [0.0, 1.0, 1.0],
    [1.0, 0.0, 1.0],
];
const AXES: [Vec3; 6] = [
    Vec3::X,
    Vec3::NEG_X,
    Vec3::Y,
    Vec3::NEG_Y,
    Vec3::Z,
    Vec3::NEG_Z,
];
const WIDE: Projection = Projection::Perspective { yfov: 2.7 };

fn sky() -> Fixture {
    Fixture {
        environment: Some(FACES),
        lut: true,
        ..Fixture::default()
    }
}

#[test]
fn every_direction_shows_its_face() {
    let Some(gpu) = device() else { return };
    for (axis, face) in AXES.into_iter().zip(FACES) {
        for projection in [
            Projection::Perspective { yfov: 0.3 },
            Projection::Orthographic { half_height: 9.0 },
        ] {
            let image = shoot(&gpu, &sky(), [7, 5], along(axis, projection), plain());
            assert_near(middle(&image), face, 1e-3);
        }
    }
}

#[test]
fn the_sides_of_the_image_are_where_they_should_be() {
    let Some(gpu) = device() else { return };
    let image = shoot(&gpu, &sky(), [65, 65], along(Vec3::NEG_Z, WIDE), plain());
    // Seamless filtering of one-texel faces blends at their borders: the largest channel tells.
    let edges = [(64, 32, 0), (0, 32, 1), (32, 0, 2), (32, 64, 3)];
    for (x, y, face) in edges {
        let found = Vec3::from(texel(&image, x, y));
        let distance = |color: &[f32; 3]| found.distance_squared(Vec3::from(*color));
        let nearest = (0..6).min_by(|a, b| distance(&FACES[*a]).total_cmp(&distance(&FACES[*b])));
        assert_eq!(nearest, Some(face), "pixel {x},{y} is {found}");
    }
}

#[test]
fn far_from_the_origin_the_sky_stands_still() {
    let Some(gpu) = device() else { return };
    let near = along(Vec3::NEG_Z, WIDE);
    let far = crate::camera::Camera {
        position: Vec3::splat(1e7),
        ..near
    };
    let images = [near, far].map(|camera| shoot(&gpu, &sky(), [33, 33], camera, plain()).hdr);
    assert_eq!(images[0], images[1]);
}

#[test]
fn yaw_turns_sky_and_reflection_together() {
    let Some(gpu) = device() else { return };
    let settings = Settings {
        ibl_yaw: std::f32::consts::FRAC_PI_2,
        ..plain()
    };
    // rotate(0, 0, 1) = (sin, 0, cos): +Z shows what the panorama has at +X.
    let narrow = Projection::Perspective { yfov: 0.3 };
    let image = shoot(
        &gpu,
        &sky(),
        [5, 5],
        along(Vec3::Z, narrow),
        settings.clone(),
    );
    assert_near(middle(&image), FACES[0], 1e-3);
    let mirror = mirror(Quat::IDENTITY);
    let camera = towards_origin(Vec3::new(0.0, 0.0, 3.0));
    let image = shoot(&gpu, &mirror, [5, 5], camera, settings);
    assert_near(middle(&image), FACES[0], 0.01);
}

/// A white mirror in front of the camera at +Z, turned by `turn`.
fn mirror(turn: Quat) -> Fixture {
    Fixture {
        objects: vec![quad(0, vec![Mat4::from_quat(turn)])],
        materials: vec![Material {
            roughness_factor: 0.0,
            ..Material::default()
        }],
        ..sky()
    }
}

#[test]
fn mirrors_show_what_is_behind_the_camera_or_beside_it() {
    let Some(gpu) = device() else { return };
    let quarter = std::f32::consts::FRAC_PI_4;
    for (turn, face) in [
        (Quat::IDENTITY, 4),
        (Quat::from_rotation_y(quarter), 0),
        (Quat::from_rotation_y(-quarter), 1),
        (Quat::from_rotation_x(-quarter), 2),
        (Quat::from_rotation_x(quarter), 3),
    ] {
        let camera = towards_origin(Vec3::new(0.0, 0.0, 3.0));
        let image = shoot(&gpu, &mirror(turn), [9, 9], camera, plain());
        assert_near(middle(&image), FACES[face], 0.01);
    }
}

#[test]
fn the_sky_can_be_off() {
    let Some(gpu) = device() else { return };
    let settings = Settings {
        skybox: false,
        ..plain()
    };
    let image = shoot(&gpu, &sky(), [4, 4], along(Vec3::Z, WIDE), settings);
    assert_eq!(middle(&image), [0.0; 3]);
    assert!(image.passes.iter().all(|pass| pass.name != "skybox"));
}
