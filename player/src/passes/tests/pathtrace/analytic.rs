//! Scenes with known answers, several independent runs each: the mean lies within three standard errors, and within 0.2 %.

use cairn_format::gpu::{LOBE_SPECULAR, Material, MaterialExtension};
use glam::{Mat4, Vec3};

use super::super::fixture::{Fixture, Object, light, sphere_of};
use super::super::{device, options, towards_origin};
use super::lights::{core, floor_radiance, glance, lit_floor};
use super::{samples, trace, traced, white, wide};
use crate::camera::{Camera, Projection};
use crate::gpu::Gpu;
use crate::headless::trace::trace_seeds;
use crate::settings::{Brdf, Settings};

/// Independent runs of a scene.
const RUNS: u32 = 8;
/// What half floats of the sky and the table round off, which more samples do not bring back.
const STORAGE: f64 = 3e-4;

/// What a furnace may be off by.
const FURNACE: f64 = 0.003;

/// Traces `RUNS` seeds and compares their mean with the answer.
#[track_caller]
fn check(
    gpu: &Gpu,
    name: &str,
    fixture: &Fixture,
    camera: Camera,
    settings: &Settings,
    count: u32,
    expected: f64,
) {
    let seeds: Vec<u32> = (0..RUNS).collect();
    let options = options([8, 8], camera, settings.clone());
    let pictures = trace_seeds(gpu, &fixture.package(), &options, count, &seeds).expect("traces");
    let means: Vec<f64> = pictures
        .iter()
        .map(|texels| {
            let sum: f64 = texels.iter().map(|texel| f64::from(texel[0])).sum();
            sum / texels.len() as f64
        })
        .collect();
    let runs = f64::from(RUNS);
    let found = means.iter().sum::<f64>() / runs;
    let variance: f64 = means.iter().map(|one| (one - found).powi(2)).sum::<f64>() / (runs - 1.0);
    let error = (variance / runs).sqrt() / expected;
    let off = (found / expected - 1.0).abs();
    println!(
        "{name}: {found:.6}, exactly {expected:.6}: off {off:.2e}, standard error {error:.2e}"
    );
    assert!(
        off <= 3.0 * error + STORAGE,
        "{name}: off by {off}, standard error {error}"
    );
    assert!(off <= 0.002, "{name}: off by {off}");
}

/// Lambert's lobe alone, under the specification's extension that takes the reflection away.
fn lambert(albedo: f32) -> (Material, MaterialExtension) {
    let material = Material {
        base_color_factor: [albedo, albedo, albedo, 1.0],
        ..white(0.0, 1.0)
    };
    let lobes = MaterialExtension {
        specular_factor: 0.0,
        lobes: LOBE_SPECULAR,
        ..MaterialExtension::default()
    };
    (material, lobes)
}

/// A unit sphere whose facets stray by less than 1e-4 from it.
fn ball() -> Object {
    sphere_of(96, 0, vec![Mat4::IDENTITY])
}

/// Parallel rays along `-from` onto the square of half-extent `half` about the sphere's middle.
fn parallel(from: Vec3, half: f32) -> Camera {
    let mut camera = towards_origin(from * 3.0);
    camera.projection = Projection::Orthographic { half_height: half };
    camera
}

/// Mean of the cosine between normal and view over what [`parallel`] sees.
fn mean_cosine(half: f64) -> f64 {
    const CELLS: u32 = 400;
    let at = |index: u32| ((f64::from(index) + 0.5) / f64::from(CELLS) * 2.0 - 1.0) * half;
    let cells = (0..CELLS * CELLS).map(|cell| {
        let (x, y) = (at(cell % CELLS), at(cell / CELLS));
        (1.0 - x * x - y * y).sqrt()
    });
    cells.sum::<f64>() / f64::from(CELLS * CELLS)
}

fn ball_scene(
    sky: fn(Vec3) -> [f32; 3],
    lights: Vec<cairn_format::gpu::DirectionalLight>,
) -> Fixture {
    let (material, lobes) = lambert(0.6);
    Fixture {
        objects: vec![ball()],
        materials: vec![material],
        lobes: vec![lobes],
        lights,
        environment: Some([[1.0; 3]; 6]),
        gradient: Some(sky),
        lut: true,
        ..Fixture::default()
    }
}

fn core_paths() -> Settings {
    Settings {
        brdf: Brdf::GltfCore,
        ..traced()
    }
}

/// Under a sky of 1 every point of a convex diffuse body reflects its albedo.
#[test]
fn a_sphere_under_a_constant_sky_reflects_its_albedo() {
    let Some(gpu) = device() else { return };
    let fixture = ball_scene(|_| [1.0; 3], Vec::new());
    let camera = parallel(Vec3::new(0.3, 0.5, 0.8).normalize(), 0.6);
    check(
        &gpu,
        "constant sky",
        &fixture,
        camera,
        &core_paths(),
        64,
        0.6,
    );
    assert_eq!(gpu.close(), Vec::<String>::new());
}

/// L = 1 + y: a diffuse point with the normal n reflects albedo times 1 + 2/3 n.y; the mean normal is the view's
/// direction times the mean cosine.
#[test]
fn a_sphere_under_a_gradient_sky_reflects_its_integral() {
    let Some(gpu) = device() else { return };
    let fixture = ball_scene(|d| [1.0 + d.y; 3], Vec::new());
    let view = Vec3::new(0.3, 0.7, 0.6).normalize();
    let half = 0.5;
    let expected = 0.6 * (1.0 + 2.0 / 3.0 * f64::from(view.y) * mean_cosine(half));
    let camera = parallel(view, half as f32);
    check(
        &gpu,
        "gradient sky",
        &fixture,
        camera,
        &core_paths(),
        128,
        expected,
    );
    assert_eq!(gpu.close(), Vec::<String>::new());
}

/// A directional light from the viewer's side: albedo / pi times irradiance times the mean cosine.
#[test]
fn a_sphere_under_a_directional_light_has_its_cosine() {
    let Some(gpu) = device() else { return };
    let view = Vec3::new(0.2, 0.4, 0.9).normalize();
    let lights = vec![light(-view, [1.0; 3], 3.0)];
    let fixture = ball_scene(|_| [0.0; 3], lights);
    let half = 0.5;
    let expected = 0.6 / std::f64::consts::PI * 3.0 * mean_cosine(half);
    let camera = parallel(view, half as f32);
    check(
        &gpu,
        "directional light",
        &fixture,
        camera,
        &core_paths(),
        64,
        expected,
    );
    assert_eq!(gpu.close(), Vec::<String>::new());
}

/// A square lamp over a plane, by quadrature of the twin BRDF.
#[test]
fn an_area_light_over_a_plane_is_its_quadrature() {
    let Some(gpu) = device() else { return };
    let (camera, view) = glance();
    let expected = floor_radiance(view);
    check(
        &gpu,
        "area light",
        &lit_floor(false),
        camera,
        &core(),
        128,
        expected,
    );
    assert_eq!(gpu.close(), Vec::<String>::new());
}

/// Energy mode: a white plane in a white furnace, whatever its roughness and metallic, and however it is seen.
#[test]
fn white_furnaces_close_for_all_materials() {
    let Some(gpu) = device() else { return };
    let patches: Vec<(f32, f32)> = [0.0, 0.5, 1.0]
        .into_iter()
        .flat_map(|metallic| [0.0, 0.1, 0.25, 0.5, 0.75, 1.0].map(|rough| (metallic, rough)))
        .collect();
    let mut worst = 0.0_f64;
    for degrees in [0.0, 40.0, 75.0] {
        // One row of squares, each a pixel and more: their borders are as white.
        let mut fixture = Fixture {
            environment: Some([[1.0; 3]; 6]),
            lut: true,
            ..Fixture::default()
        };
        for (index, (metallic, roughness)) in patches.iter().enumerate() {
            fixture.materials.push(white(*metallic, *roughness));
            let across = (index as f32 - 8.5) * 2.0;
            let mut square = wide(index as u32, 1.0);
            square.models = vec![
                Mat4::from_translation(Vec3::Y * across)
                    * Mat4::from_scale(Vec3::new(50.0, 1.0, 1.0)),
            ];
            fixture.objects.push(square);
        }
        let mut camera = super::at_angle(degrees);
        camera.projection = Projection::Orthographic { half_height: 18.0 };
        camera.up = Vec3::Y;
        let image = trace(&gpu, &fixture, [4, 18], camera, traced(), &samples(8192));
        let hdr = image.hdr.as_ref().expect("read back");
        for (row, texels) in hdr.chunks(4).enumerate() {
            let found: f64 = texels.iter().map(|texel| f64::from(texel[0])).sum::<f64>() / 4.0;
            println!("{:?} at {degrees} degrees: {found}", patches[17 - row]);
            worst = worst.max((found - 1.0).abs());
        }
    }
    assert!(worst <= FURNACE, "{worst}");
    assert_eq!(gpu.close(), Vec::<String>::new());
}
