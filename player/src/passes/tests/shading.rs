//! Shading in compute shows what shading in fragments shows.

use cairn_format::TextureFormat;
use cairn_format::gpu::{ALPHA_BLEND, ALPHA_MASK, Material};
use glam::{Mat4, Vec3};

use super::fixture::{Fixture, colored, light, quad, row, sphere};
use super::{device, plain, shoot, towards_origin};
use crate::headless::HeadlessImage;
use crate::settings::{Settings, Shading};

/// Opaque, cut, blended, mirrored, coloured, textured and overlapping, with triangles that cross the near plane.
fn busy(blended: bool) -> Fixture {
    let textured = Material {
        base_color_tex: 0,
        normal_tex: 1,
        ..Material::default()
    };
    let leaf = Material {
        base_color_tex: 2,
        alpha_mode: ALPHA_MASK,
        alpha_cutoff: 0.5,
        double_sided: 1,
        ..Material::default()
    };
    let glass = Material {
        base_color_factor: [0.2, 0.9, 0.4, 0.5],
        alpha_mode: ALPHA_BLEND,
        ..Material::default()
    };
    let mirrored = Mat4::from_translation(Vec3::new(-0.9, 0.1, 0.2))
        * Mat4::from_scale(Vec3::new(-0.7, 0.5, 0.7));
    let floor = Mat4::from_translation(Vec3::new(0.0, -0.7, 0.0))
        * Mat4::from_rotation_x(-std::f32::consts::FRAC_PI_2)
        * Mat4::from_scale(Vec3::splat(40.0));
    let mut cut = quad(1, vec![Mat4::from_rotation_y(0.7)]);
    for vertex in &mut cut.vertices {
        vertex.uv0 = [vertex.position[0] * 3.0, 0.5];
    }
    let mut objects = vec![
        sphere(0, vec![Mat4::IDENTITY, mirrored]),
        colored(quad(0, vec![floor]), [0.9, 0.5, 0.3, 1.0]),
        cut,
    ];
    if blended {
        objects.push(quad(2, vec![Mat4::from_translation(Vec3::Z)]));
    }
    Fixture {
        objects,
        materials: vec![textured, leaf, glass],
        textures: vec![
            row(
                TextureFormat::Rgba8Unorm,
                vec![[200, 100, 50, 255], [90, 200, 30, 255]],
            ),
            row(TextureFormat::Rgba8Unorm, vec![[150, 110, 255, 255]]),
            row(
                TextureFormat::Rgba8Unorm,
                vec![[200, 100, 50, 255], [0, 90, 0, 0]],
            ),
        ],
        lights: vec![light(Vec3::new(0.3, -1.0, -0.5), [1.0; 3], 2.0)],
        environment: Some([
            [0.5, 0.6, 0.7],
            [0.2, 0.1, 0.1],
            [1.0, 1.0, 1.2],
            [0.1, 0.1, 0.1],
            [0.4, 0.4, 0.4],
            [0.6, 0.5, 0.4],
        ]),
        lut: true,
        ..Fixture::default()
    }
}

/// Share of texels that differ by more than a hundredth, and the mean difference.
fn difference(a: &HeadlessImage, b: &HeadlessImage) -> (f64, f64) {
    let (a, b) = (a.hdr.as_ref().expect("read"), b.hdr.as_ref().expect("read"));
    let mut differing = 0_u32;
    let mut sum = 0.0;
    for (a, b) in a.iter().zip(b) {
        let largest = (0..3).map(|c| (a[c] - b[c]).abs()).fold(0.0, f32::max);
        differing += u32::from(largest > 0.01);
        sum += f64::from(largest);
    }
    let count = a.len() as f64;
    (f64::from(differing) / count, sum / count)
}

#[test]
fn compute_shades_as_fragments_do() {
    let Some(gpu) = device() else { return };
    for (msaa, blended) in [(1, false), (1, true), (4, false), (4, true)] {
        let shot = |shading| {
            let settings = Settings {
                msaa,
                shading,
                ..plain()
            };
            let camera = towards_origin(Vec3::new(0.5, 0.4, 3.0));
            shoot(&gpu, &busy(blended), [96, 64], camera, settings)
        };
        let (forward, compute) = (shot(Shading::Forward), shot(Shading::Compute));
        assert!(compute.passes.iter().any(|pass| pass.name == "shade"));
        assert!(forward.passes.iter().all(|pass| pass.name != "shade"));
        let (differing, mean) = difference(&forward, &compute);
        // Edges of texels, and under multisampling where in the pixel a fragment is shaded.
        let allowed = if msaa == 1 { 0.005 } else { 0.05 };
        assert!(
            differing < allowed && mean < allowed * 0.1,
            "{msaa} samples, blended {blended}: {differing} differ, mean {mean}"
        );
    }
}

#[test]
fn screen_passes_see_the_same_surfaces() {
    let Some(gpu) = device() else { return };
    for msaa in [1, 4] {
        let shot = |shading| {
            let mut settings = Settings {
                msaa,
                shading,
                debug_view: 4,
                ..plain()
            };
            settings.ao.enabled = true;
            let camera = towards_origin(Vec3::new(0.5, 0.4, 3.0));
            shoot(&gpu, &busy(false), [96, 64], camera, settings)
        };
        let (differing, _) = difference(&shot(Shading::Forward), &shot(Shading::Compute));
        assert!(differing < 0.05, "{msaa} samples: {differing}");
    }
}
