//! Point and spot lights against the formulas of `KHR_lights_punctual`.

use bytemuck::Zeroable;
use cairn_format::gpu::{Material, PunctualLight};
use glam::{DVec3, Mat4, Vec3};

use super::fixture::{Fixture, quad};
use super::twin::{Lobes, Shading};
use super::{assert_near, device, middle, plain, shoot, towards_origin};
use crate::gpu::Gpu;
use crate::settings::{LightSettings, LightSource, Settings};

const EYE: Vec3 = Vec3::new(0.4, 0.3, 2.0);
const COLOR: [f32; 3] = [8.0, 6.0, 2.0];

fn point(position: Vec3, range: f32) -> PunctualLight {
    PunctualLight {
        position_and_range: position.extend(range).to_array(),
        color_and_shadow: [COLOR[0], COLOR[1], COLOR[2], 1.0],
        spot_offset: 1.0,
        ..PunctualLight::zeroed()
    }
}

fn spot(position: Vec3, target: Vec3, [inner, outer]: [f32; 2]) -> PunctualLight {
    let scale = 1.0 / (inner.cos() - outer.cos());
    let direction = (target - position).normalize();
    PunctualLight {
        direction_and_spot_scale: direction.extend(scale).to_array(),
        spot_offset: -outer.cos() * scale,
        ..point(position, 0.0)
    }
}

fn material() -> Material {
    Material {
        base_color_factor: [0.8, 0.5, 0.25, 1.0],
        metallic_factor: 0.0,
        roughness_factor: 0.515_625,
        ..Material::default()
    }
}

/// The middle of a square at the origin that faces +Z.
fn seen(gpu: &Gpu, lights: Vec<PunctualLight>, settings: Settings) -> [f32; 3] {
    let fixture = Fixture {
        objects: vec![quad(0, vec![Mat4::IDENTITY])],
        materials: vec![material()],
        punctual: lights,
        lut: true,
        ..Fixture::default()
    };
    let settings = Settings {
        ibl_intensity: 0.0,
        ..settings
    };
    middle(&shoot(
        gpu,
        &fixture,
        [33, 33],
        towards_origin(EYE),
        settings,
    ))
}

/// What the square reflects of a light at `position` whose irradiance is `share` of the inverse square's.
fn expected(position: Vec3, share: f64) -> [f32; 3] {
    let to_light = position.as_dvec3();
    let shading = Shading {
        normal: DVec3::Z,
        view: EYE.as_dvec3().normalize(),
        light: to_light.normalize(),
        base: DVec3::new(0.8, 0.5, 0.25),
        metallic: 0.0,
        roughness: 0.515_625,
        lobes: Lobes::default(),
    };
    let irradiance = DVec3::from(COLOR.map(f64::from)) * (share / to_light.length_squared());
    (shading.reflected(true) * irradiance).as_vec3().to_array()
}

#[test]
fn point_lights_fall_off_with_the_square_and_end_at_their_range() {
    let Some(gpu) = device() else { return };
    let at = Vec3::new(0.5, -0.4, 1.5);
    let distance = f64::from(at.length());
    for range in [0.0, 100.0, 2.0, 1.0] {
        let window = match f64::from(range) {
            0.0 => 1.0,
            range => (1.0 - (distance / range).powi(4)).clamp(0.0, 1.0),
        };
        let found = seen(&gpu, vec![point(at, range)], plain());
        assert_near(found, expected(at, window), 5e-3);
    }
    let found = seen(&gpu, vec![point(at * 2.0, 0.0)], plain());
    assert_near(found, expected(at * 2.0, 1.0), 2e-3);
}

#[test]
fn spot_lights_fade_between_their_cones() {
    let Some(gpu) = device() else { return };
    let at = Vec3::new(0.0, 0.5, 1.5);
    for (aim, cones) in [
        (Vec3::ZERO, [0.1_f32, 0.2]),
        (Vec3::new(0.3, 0.0, 0.0), [0.1, 0.3]),
        (Vec3::new(0.9, 0.0, 0.0), [0.1, 0.3]),
    ] {
        let light = spot(at, aim, cones);
        let axis = (aim - at).as_dvec3().normalize();
        let cosine = axis.dot(-at.as_dvec3().normalize());
        let [inner, outer] = cones.map(|angle| f64::from(angle).cos());
        let cone = ((cosine - outer) / (inner - outer)).clamp(0.0, 1.0).powi(2);
        assert_near(seen(&gpu, vec![light], plain()), expected(at, cone), 5e-3);
    }
}

#[test]
fn several_lights_add_up() {
    let Some(gpu) = device() else { return };
    let places = [
        Vec3::new(0.5, -0.4, 1.5),
        Vec3::new(-0.5, 0.4, 1.0),
        Vec3::new(0.0, 0.0, -1.0),
    ];
    let lights = places.map(|place| point(place, 0.0)).to_vec();
    let [a, b, _] = places.map(|place| expected(place, 1.0));
    let sum = std::array::from_fn(|channel| a[channel] + b[channel]);
    assert_near(seen(&gpu, lights, plain()), sum, 2e-2);
}

#[test]
fn a_light_in_the_surface_stays_finite() {
    let Some(gpu) = device() else { return };
    // `shoot` asserts that every texel is finite.
    for height in [0.0, 1e-6, 1e-3] {
        seen(&gpu, vec![point(Vec3::new(0.0, 0.0, height), 0.0)], plain());
    }
}

#[test]
fn without_lights_of_the_scene_they_are_off() {
    let Some(gpu) = device() else { return };
    let lights = || vec![point(Vec3::Z, 0.0)];
    let with = |source| Settings {
        light: LightSettings {
            source,
            ..LightSettings::default()
        },
        ..plain()
    };
    assert_eq!(seen(&gpu, lights(), with(LightSource::None)), [0.0; 3]);
    assert!(seen(&gpu, lights(), with(LightSource::Scene))[0] > 0.5);
}
