//! Directional light on flat surfaces against the f64 twin, pixel by pixel.

use cairn_format::gpu::{LOBE_CLEARCOAT, LOBE_SHEEN, LOBE_SPECULAR, Material, MaterialExtension};
use glam::{DMat3, DVec3, Mat4, Quat, Vec3};

use super::fixture::{Fixture, light, quad};
use super::twin::{Lobes, Shading};
use super::{device, plain, shoot, texel, towards_origin};
use crate::camera::{Camera, Projection};
use crate::settings::{Brdf, Settings};

const SIZE: u32 = 33;
const EYE: Vec3 = Vec3::new(0.3, -0.2, 2.5);
const TRAVEL: Vec3 = Vec3::new(0.2, -0.35, -0.8);
const COLOR: [f32; 3] = [1.0, 0.9, 0.7];
const INTENSITY: f32 = 2.5;

/// View direction from the point of the plane through the origin that a pixel's centre shows.
fn seen_from(camera: &Camera, normal: DVec3, x: u32, y: u32) -> Option<(DVec3, DVec3)> {
    let ndc = |pixel: u32| (f64::from(pixel) + 0.5) / f64::from(SIZE) * 2.0 - 1.0;
    let (forward, up) = (camera.forward.as_dvec3(), camera.up.as_dvec3());
    let right = forward.cross(up).normalize();
    let Projection::Perspective { yfov } = camera.projection else {
        return None;
    };
    let tangent = (f64::from(yfov) * 0.5).tan();
    let ray = forward + right * ndc(x) * tangent - right.cross(forward) * ndc(y) * tangent;
    let eye = camera.position.as_dvec3();
    let point = eye - ray * (eye.dot(normal) / ray.dot(normal));
    (point.length() < 0.9).then(|| (point, (eye - point).normalize()))
}

fn compare(material: Material, tilt: Quat, brdf: Brdf, tolerance: f64) {
    compare_within(1.0, material, tilt, brdf, tolerance);
}

/// Compares every pixel of an image that spans `yfov` radians.
fn compare_within(yfov: f32, material: Material, tilt: Quat, brdf: Brdf, tolerance: f64) {
    let lobes = MaterialExtension::default();
    compare_lobes(yfov, material, lobes, tilt, brdf, tolerance);
}

fn twin_lobes(lobes: &MaterialExtension) -> Lobes {
    let vector = |v: [f32; 3]| DVec3::from(v.map(f64::from));
    let f0 = vector(lobes.specular_color) * f64::from(lobes.dielectric_f0);
    Lobes {
        dielectric_f0: f0.min(DVec3::ONE) * f64::from(lobes.specular_factor),
        specular: f64::from(lobes.specular_factor),
        sheen: vector(lobes.sheen_color),
        sheen_roughness: f64::from(lobes.sheen_roughness),
        coat: f64::from(lobes.clearcoat_factor),
        coat_roughness: f64::from(lobes.clearcoat_roughness),
    }
}

fn compare_lobes(
    yfov: f32,
    material: Material,
    lobes: MaterialExtension,
    tilt: Quat,
    brdf: Brdf,
    tolerance: f64,
) {
    let Some(gpu) = device() else { return };
    let fixture = Fixture {
        objects: vec![quad(0, vec![Mat4::from_quat(tilt)])],
        materials: vec![material],
        lobes: vec![lobes],
        lights: vec![light(TRAVEL, COLOR, INTENSITY)],
        lut: true,
        ..Fixture::default()
    };
    let settings = Settings {
        brdf,
        ibl_intensity: 0.0,
        ..plain()
    };
    let camera = Camera {
        projection: Projection::Perspective { yfov },
        ..towards_origin(EYE)
    };
    let image = shoot(&gpu, &fixture, [SIZE, SIZE], camera, settings);
    let normal = DMat3::from_quat(tilt.as_dquat()) * DVec3::Z;
    let mut compared = 0;
    for (x, y) in (0..SIZE * SIZE).map(|index| (index % SIZE, index / SIZE)) {
        let Some((_, view)) = seen_from(&camera, normal, x, y) else {
            continue;
        };
        let base = material.base_color_factor.map(f64::from);
        let shading = Shading {
            normal,
            view,
            light: -TRAVEL.as_dvec3().normalize(),
            base: DVec3::new(base[0], base[1], base[2]),
            metallic: f64::from(material.metallic_factor),
            roughness: f64::from(material.roughness_factor),
            lobes: twin_lobes(&lobes),
        };
        let irradiance = DVec3::from(COLOR.map(f64::from)) * f64::from(INTENSITY);
        let expected = shading.reflected(brdf == Brdf::Energy) * irradiance;
        let found = DVec3::from(texel(&image, x, y).map(f64::from));
        let error = ((found - expected) / (expected.abs() + 1e-4))
            .abs()
            .max_element();
        assert!(
            error < tolerance,
            "pixel {x},{y}: {found} for {expected} ({error})"
        );
        compared += 1;
    }
    assert!(compared > 50, "{compared} pixels show the square");
}

fn material(metallic: f32, roughness: f32) -> Material {
    Material {
        base_color_factor: [0.8, 0.5, 0.25, 1.0],
        metallic_factor: metallic,
        roughness_factor: roughness,
        ..Material::default()
    }
}

#[test]
fn gltf_core_equals_the_twin() {
    let tilts = [
        Quat::IDENTITY,
        Quat::from_rotation_x(0.5),
        Quat::from_rotation_y(-0.7),
    ];
    let surfaces = [(0.0, 0.3), (1.0, 0.2), (0.5, 0.7), (0.0, 1.0)];
    for (tilt, (metallic, roughness)) in tilts.into_iter().cycle().zip(surfaces) {
        compare(material(metallic, roughness), tilt, Brdf::GltfCore, 2e-3);
    }
}

#[test]
fn energy_equals_the_twin_within_the_tables_error() {
    for (metallic, roughness) in [(0.0, 0.515_625), (1.0, 0.765_625)] {
        let tilt = Quat::from_rotation_x(0.4);
        compare(material(metallic, roughness), tilt, Brdf::Energy, 0.02);
    }
}

#[test]
fn partly_metallic_surfaces_mix_two_brdfs() {
    let tilt = Quat::from_rotation_x(0.4);
    for brdf in [Brdf::GltfCore, Brdf::Energy] {
        compare(material(0.5, 0.515_625), tilt, brdf, 0.02);
    }
}

/// At table centres, so that what is compared is the shader and not the interpolation.
const CENTER: f32 = 0.515_625;

#[test]
fn coats_equal_the_twin() {
    let lobes = MaterialExtension {
        clearcoat_factor: 0.8,
        clearcoat_roughness: CENTER,
        lobes: LOBE_CLEARCOAT,
        ..MaterialExtension::default()
    };
    for brdf in [Brdf::GltfCore, Brdf::Energy] {
        let tilt = Quat::from_rotation_x(0.4);
        compare_lobes(1.0, material(0.0, CENTER), lobes, tilt, brdf, 0.02);
    }
}

#[test]
fn dielectrics_of_other_indices_equal_the_twin() {
    let lobes = MaterialExtension {
        specular_factor: 0.7,
        specular_color: [1.0, 0.5, 2.0],
        dielectric_f0: 0.3,
        lobes: LOBE_SPECULAR,
        ..MaterialExtension::default()
    };
    for (metallic, brdf) in [
        (0.0, Brdf::GltfCore),
        (0.0, Brdf::Energy),
        (0.5, Brdf::Energy),
    ] {
        let tilt = Quat::from_rotation_y(-0.7);
        compare_lobes(1.0, material(metallic, CENTER), lobes, tilt, brdf, 0.02);
    }
}

#[test]
fn sheen_equals_the_twin() {
    for (roughness, brdf) in [(CENTER, Brdf::GltfCore), (0.765_625, Brdf::Energy)] {
        let lobes = MaterialExtension {
            sheen_color: [0.9, 0.5, 0.2],
            sheen_roughness: roughness,
            clearcoat_factor: 0.5,
            clearcoat_roughness: CENTER,
            lobes: LOBE_SHEEN | LOBE_CLEARCOAT,
            ..MaterialExtension::default()
        };
        let tilt = Quat::from_rotation_x(0.9);
        compare_lobes(1.0, material(0.0, CENTER), lobes, tilt, brdf, 0.02);
    }
}

#[test]
fn a_mirrors_highlight_keeps_its_shape() {
    // Tilted so that the light's mirror image falls on the middle of the square, and seen so close that the
    // highlight of the least roughness fills the image: N.H is within 4e-6 of 1 everywhere.
    let half = (EYE.normalize() - TRAVEL.normalize()).normalize();
    let tilt = Quat::from_rotation_arc(Vec3::Z, half);
    compare_within(0.01, material(1.0, 0.0), tilt, Brdf::GltfCore, 0.01);
    compare(material(1.0, 0.0), tilt, Brdf::GltfCore, 0.02);
}

#[test]
fn roughness_and_metallic_are_clamped() {
    compare_clamped(material(3.0, 7.0), material(1.0, 1.0));
    compare_clamped(material(-1.0, -2.0), material(0.0, 0.0));
}

fn compare_clamped(outside: Material, inside: Material) {
    let Some(gpu) = device() else { return };
    let render = |material: Material| {
        let fixture = Fixture {
            objects: vec![quad(0, vec![Mat4::IDENTITY])],
            materials: vec![material],
            lights: vec![light(TRAVEL, COLOR, INTENSITY)],
            lut: true,
            ..Fixture::default()
        };
        shoot(&gpu, &fixture, [9, 9], towards_origin(EYE), plain()).hdr
    };
    assert_eq!(render(outside), render(inside));
}
