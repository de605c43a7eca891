//! From radiance to 8 bits, odd sizes, empty packages, and equal images for equal input.

use glam::{Mat4, Vec3};

use super::fixture::{Fixture, light, quad, sphere, unlit};
use super::{device, middle, options, plain, shoot, towards_origin};
use crate::PlayerError;
use crate::headless::render_on;
use crate::settings::{Settings, Tonemap};

const FRONT: Vec3 = Vec3::new(0.0, 0.0, 3.0);

fn card(color: [f32; 3]) -> Fixture {
    Fixture {
        objects: vec![quad(0, vec![Mat4::IDENTITY])],
        materials: vec![unlit([color[0], color[1], color[2], 1.0])],
        ..Fixture::default()
    }
}

fn encode(linear: f64) -> f64 {
    let linear = linear.clamp(0.0, 1.0);
    let encoded = if linear <= 0.003_130_8 {
        linear * 12.92
    } else {
        1.055 * linear.powf(1.0 / 2.4) - 0.055
    };
    encoded * 255.0
}

fn aces(x: f64) -> f64 {
    x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14)
}

fn pixel(fixture: &Fixture, settings: Settings) -> Option<[u8; 4]> {
    let gpu = device()?;
    let image = shoot(&gpu, fixture, [3, 3], towards_origin(FRONT), settings);
    image.rgba8.as_chunks().0.get(4).copied()
}

#[test]
fn tone_curves_match_their_formulas() {
    let color = [0.05, 0.5, 3.0];
    for (tonemap, ev) in [
        (Tonemap::Aces, 0.0),
        (Tonemap::Aces, 1.5),
        (Tonemap::Linear, -2.0),
    ] {
        let settings = Settings {
            tonemap,
            ev,
            ..Settings::default()
        };
        let Some(found) = pixel(&card(color), settings) else {
            return;
        };
        for (channel, value) in color.into_iter().enumerate() {
            let exposed = f64::from(value) * f64::from(ev).exp2();
            let curved = if tonemap == Tonemap::Aces {
                aces(exposed)
            } else {
                exposed
            };
            let difference = (f64::from(found[channel]) - encode(curved)).abs();
            assert!(difference <= 1.0, "{tonemap:?} {ev}: {found:?} for {value}");
        }
        assert_eq!(found[3], 255);
    }
}

#[test]
fn negative_and_huge_radiance_stays_in_range() {
    let Some(gpu) = device() else { return };
    let image = shoot(
        &gpu,
        &card([-1.0, 1e30, 7e4]),
        [3, 3],
        towards_origin(FRONT),
        plain(),
    );
    assert_eq!(middle(&image), [0.0, 65504.0, 65504.0]);
    assert_eq!(image.rgba8[16..19], [0, 255, 255]);
}

#[test]
fn debug_views_pass_exposure_by() {
    let settings = |debug_view: u32| Settings {
        debug_view,
        ev: 3.0,
        ..Settings::default()
    };
    let Some(found) = pixel(&card([1.0; 3]), settings(4)) else {
        return;
    };
    let half = encode(0.5);
    let near = found[..2]
        .iter()
        .all(|channel| (f64::from(*channel) - half).abs() <= 1.0);
    assert!(near && found[2..] == [255, 255], "normal +Z is {found:?}");
    for view in [13, 1000] {
        assert_eq!(
            pixel(&card([1.0; 3]), settings(view)),
            Some([255, 0, 255, 255])
        );
    }
}

#[test]
fn a_package_of_nothing_is_black() {
    let Some(gpu) = device() else { return };
    for size in [[1, 1], [17, 3]] {
        let image = shoot(
            &gpu,
            &Fixture::default(),
            size,
            towards_origin(FRONT),
            plain(),
        );
        let black = image
            .rgba8
            .as_chunks()
            .0
            .iter()
            .all(|pixel| *pixel == [0, 0, 0, 255]);
        assert!(black && image.rgba8.len() == (size[0] * size[1] * 4) as usize);
        assert_eq!((image.draws.draws, image.draws.triangles), (0, 0));
    }
}

#[test]
fn only_the_passes_that_a_package_needs_are_recorded() {
    let Some(gpu) = device() else { return };
    let names = |fixture: &Fixture| -> Vec<String> {
        let image = shoot(&gpu, fixture, [4, 4], towards_origin(FRONT), plain());
        image.passes.into_iter().map(|pass| pass.name).collect()
    };
    let plain_names = names(&card([1.0; 3]));
    if plain_names.is_empty() {
        eprintln!("SKIPPED: the device has no timestamps");
        return;
    }
    assert_eq!(plain_names, ["forward", "tonemap", "copy hdr"]);
    let mut full = card([1.0; 3]);
    full.materials[0].alpha_mode = cairn_format::gpu::ALPHA_BLEND;
    full.environment = Some([[1.0; 3]; 6]);
    full.lut = true;
    let all = ["forward", "skybox", "transparent", "tonemap", "copy hdr"];
    assert_eq!(names(&full), all);
}

#[test]
fn equal_input_gives_equal_images_whatever_the_frame_count() {
    let Some(gpu) = device() else { return };
    let fixture = Fixture {
        objects: vec![sphere(0, vec![Mat4::IDENTITY])],
        materials: vec![cairn_format::gpu::Material::default()],
        lights: vec![light(Vec3::new(0.3, -1.0, -0.5), [1.0; 3], 2.0)],
        environment: Some([[0.5; 3]; 6]),
        lut: true,
        ..Fixture::default()
    };
    let render = |frames: u32| {
        let options = crate::headless::HeadlessOptions {
            frames,
            ..options([31, 17], towards_origin(FRONT), Settings::default())
        };
        let image = render_on(&gpu, &fixture.package(), &options).expect("renders");
        assert_eq!(image.validation, Vec::<String>::new());
        (image.rgba8, image.hdr)
    };
    let first = render(1);
    assert_eq!(first, render(1));
    assert_eq!(first, render(7));
}

#[test]
fn impossible_sizes_are_input_errors() {
    let Some(gpu) = device() else { return };
    let package = Fixture::default().package();
    for size in [[0, 4], [4, 0], [u32::MAX, 1]] {
        let options = options(size, towards_origin(FRONT), plain());
        let result = render_on(&gpu, &package, &options);
        assert!(matches!(result, Err(PlayerError::Input(_))), "{size:?}");
    }
}

#[test]
fn the_processor_shows_radiance_as_the_shader_does() {
    let Some(gpu) = device() else { return };
    let colors = [
        [0.02, 0.5, 3.0],
        [0.9, 0.18, 0.001],
        [12.0, 10.0, 11.0],
        [0.3, 0.3, 0.3],
    ];
    let objects = colors.iter().enumerate().map(|(index, _)| {
        let place = Vec3::new(index as f32 * 0.5 - 0.75, 0.0, 0.0);
        quad(
            index as u32,
            vec![Mat4::from_translation(place) * Mat4::from_scale(Vec3::splat(0.25))],
        )
    });
    let fixture = Fixture {
        objects: objects.collect(),
        materials: colors
            .iter()
            .map(|[r, g, b]| unlit([*r, *g, *b, 1.0]))
            .collect(),
        ..Fixture::default()
    };
    for tonemap in [
        Tonemap::Aces,
        Tonemap::Linear,
        Tonemap::Agx,
        Tonemap::Neutral,
    ] {
        let settings = Settings {
            tonemap,
            ev: 0.5,
            ..plain()
        };
        let image = shoot(
            &gpu,
            &fixture,
            [64, 32],
            towards_origin(Vec3::Z * 2.0),
            settings.clone(),
        );
        let hdr = image.hdr.as_ref().expect("read back");
        let radiance = crate::metrics::Picture::from_rgba(64, 32, hdr);
        let shown = crate::metrics::display::display(&radiance, &settings).to_srgb8();
        let worst = shown
            .iter()
            .zip(&image.rgba8)
            .map(|(a, b)| a.abs_diff(*b))
            .max();
        // One step of rounding, one of dithering.
        assert!(worst <= Some(2), "{tonemap:?}: {worst:?}");
        let bright = shown.chunks_exact(4).filter(|texel| texel[0] > 100).count();
        assert!(bright > 20, "{tonemap:?}: nothing was drawn");
    }
}
