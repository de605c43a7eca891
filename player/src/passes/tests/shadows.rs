//! Shadows against rays, analytic penumbrae, and themselves from other cameras.

use cairn_format::TextureFormat;
use cairn_format::gpu::{ALPHA_BLEND, ALPHA_MASK, Material};
use glam::{DMat4, DVec3, Mat4, Quat, Vec3};

use super::fixture::{Fixture, Object, casting, quad, row, sphere};
use super::{device, options, plain, shoot};
use crate::camera::{Camera, Projection};
use crate::cascade::Cascades;
use crate::gpu::Gpu;
use crate::headless::{HeadlessOptions, render_on};
use crate::settings::{Prepass, Quality, Settings, ShadowFilter};

const SIZE: [u32; 2] = [96, 96];
const HALF_PI: f32 = std::f32::consts::FRAC_PI_2;

fn matte() -> Material {
    Material {
        metallic_factor: 0.0,
        ..Material::default()
    }
}

/// Direct light alone, under a small shadow map.
fn settings() -> Settings {
    let mut settings = plain();
    settings.ibl_intensity = 0.0;
    settings.shadow.enabled = true;
    settings.shadow.resolution = 1024;
    settings
}

/// A square of `half` metres that faces up.
fn level(material: u32, height: f32, half: f32) -> Object {
    let turn = Mat4::from_rotation_x(-HALF_PI) * Mat4::from_scale(Vec3::splat(half));
    quad(
        material,
        vec![Mat4::from_translation(Vec3::Y * height) * turn],
    )
}

/// A level floor under `direction`'s light, and what stands on it.
fn scene(objects: Vec<Object>, direction: Vec3) -> Fixture {
    Fixture {
        objects,
        materials: vec![matte()],
        lights: vec![casting(direction)],
        ..Fixture::default()
    }
}

/// From `height` straight down: right is +X, up is -Z.
fn from_above(height: f32, half_height: f32) -> Camera {
    Camera {
        position: Vec3::Y * height,
        forward: Vec3::NEG_Y,
        up: Vec3::NEG_Z,
        projection: Projection::Orthographic { half_height },
        znear: 0.0,
        zfar: height + 5.0,
    }
}

/// What the light gives each pixel with shadows over what it gives without; none where it gives nothing.
fn visibility(
    gpu: &Gpu,
    fixture: &Fixture,
    camera: Camera,
    settings: &Settings,
) -> Vec<Option<f32>> {
    let red = |settings: Settings| -> Vec<f32> {
        let image = shoot(gpu, fixture, SIZE, camera, settings);
        let hdr = image.hdr.expect("read back");
        hdr.iter().map(|texel| texel[0]).collect()
    };
    let shadowed = red(settings.clone());
    let mut open = settings.clone();
    open.shadow.enabled = false;
    let share = |(lit, all): (f32, f32)| (all > 1e-3).then(|| lit / all);
    shadowed.into_iter().zip(red(open)).map(share).collect()
}

/// World triangles of a fixture.
fn triangles(fixture: &Fixture) -> Vec<[DVec3; 3]> {
    let mut found = Vec::new();
    for object in &fixture.objects {
        for model in &object.models {
            let model: DMat4 = model.as_dmat4();
            for corners in object.indices.chunks_exact(3) {
                found.push([0, 1, 2].map(|corner| {
                    let vertex = &object.vertices[corners[corner] as usize];
                    model.transform_point3(Vec3::from(vertex.position).as_dvec3())
                }));
            }
        }
    }
    found
}

/// Distance of the nearest hit beyond `least` (Moeller and Trumbore 1997).
fn hit(triangles: &[[DVec3; 3]], origin: DVec3, direction: DVec3, least: f64) -> Option<f64> {
    let distance = |[a, b, c]: &[DVec3; 3]| {
        let (u, v) = (*b - *a, *c - *a);
        let p = direction.cross(v);
        let determinant = u.dot(p);
        let from = origin - *a;
        let x = from.dot(p) / determinant;
        let q = from.cross(u);
        let y = direction.dot(q) / determinant;
        let t = v.dot(q) / determinant;
        (x >= 0.0 && y >= 0.0 && x + y <= 1.0 && t > least).then_some(t)
    };
    triangles.iter().filter_map(distance).min_by(f64::total_cmp)
}

/// The ray through a pixel's centre.
fn primary(camera: &Camera, pixel: usize) -> (DVec3, DVec3) {
    let [width, height] = SIZE.map(f64::from);
    let (x, y) = (
        (pixel as u32 % SIZE[0]) as f64 + 0.5,
        (pixel as u32 / SIZE[0]) as f64 + 0.5,
    );
    let (x, y) = (x / width * 2.0 - 1.0, 1.0 - y / height * 2.0);
    let back = camera.view().as_dmat4().inverse();
    match camera.projection {
        Projection::Perspective { yfov } => {
            let slope = (f64::from(yfov) * 0.5).tan();
            let ray = DVec3::new(x * slope, y * slope, -1.0);
            (
                camera.position.as_dvec3(),
                back.transform_vector3(ray).normalize(),
            )
        }
        Projection::Orthographic { half_height } => {
            let half = f64::from(half_height);
            let origin = back.transform_point3(DVec3::new(x * half, y * half, 0.0));
            (origin, camera.forward.as_dvec3())
        }
    }
}

/// Share of pixels whose shadow a ray contradicts, and share of pixels in shadow.
fn contradictions(
    gpu: &Gpu,
    fixture: &Fixture,
    camera: Camera,
    direction: Vec3,
    settings: &Settings,
) -> (f32, f32) {
    let found = visibility(gpu, fixture, camera, settings);
    let triangles = triangles(fixture);
    let towards = -direction.normalize().as_dvec3();
    let (mut wrong, mut dark, mut all) = (0, 0, 0);
    for (pixel, lit) in found.iter().enumerate() {
        let Some(lit) = lit else { continue };
        let (origin, ray) = primary(&camera, pixel);
        let Some(distance) = hit(&triangles, origin, ray, 1e-6) else {
            continue;
        };
        let point = origin + ray * distance;
        let blocked = hit(&triangles, point, towards, 1e-4).is_some();
        all += 1;
        dark += u32::from(blocked);
        wrong += u32::from((*lit < 0.5) != blocked);
    }
    assert!(all > 1000, "{all} pixels are lit");
    (wrong as f32 / all as f32, dark as f32 / all as f32)
}

/// A floor with a sphere, a leaning sheet and a mirrored one.
fn clutter(direction: Vec3) -> Fixture {
    let sheets = vec![
        Mat4::from_translation(Vec3::new(-1.2, 0.6, 0.3)) * Mat4::from_rotation_y(0.5),
        Mat4::from_translation(Vec3::new(1.6, 0.8, -1.0))
            * Mat4::from_rotation_x(0.4)
            * Mat4::from_scale(Vec3::new(-0.5, 0.8, 1.0)),
    ];
    let ball =
        Mat4::from_translation(Vec3::new(0.3, 0.9, 0.6)) * Mat4::from_scale(Vec3::splat(0.5));
    scene(
        vec![level(0, 0.0, 5.0), quad(0, sheets), sphere(0, vec![ball])],
        direction,
    )
}

fn oblique() -> Camera {
    Camera::look_at(Vec3::new(1.5, 4.0, 5.0), Vec3::ZERO, Vec3::Y, 0.9).expect("a view")
}

#[test]
fn hard_shadows_agree_with_rays() {
    let Some(gpu) = device() else { return };
    let axes = [
        Vec3::new(0.5, -1.0, -0.4),
        Vec3::NEG_Y,
        Vec3::new(1e-4, -1.0, 0.0),
        Vec3::new(-1.0, -0.3, 0.0),
        Vec3::new(0.0, -0.5, 1.0),
    ];
    for direction in axes {
        let mut settings = settings();
        settings.shadow.pcf_radius = 0;
        let fixture = clutter(direction);
        let (wrong, dark) = contradictions(&gpu, &fixture, oblique(), direction, &settings);
        eprintln!(
            "{direction}: {:.2} % of the pixels contradict a ray",
            wrong * 100.0
        );
        assert!(dark > 0.02 && dark < 0.6, "{dark} in shadow");
        assert!(wrong < 0.01, "{direction}: {wrong} of the pixels are wrong");
    }
}

#[test]
fn one_cascade_is_enough_for_a_small_scene() {
    let Some(gpu) = device() else { return };
    let direction = Vec3::new(0.5, -1.0, -0.4);
    let mut settings = settings();
    settings.shadow.cascades = 1;
    let (wrong, _) = contradictions(&gpu, &clutter(direction), oblique(), direction, &settings);
    assert!(wrong < 0.015, "{wrong}");
}

/// No filter finds shadow on a bare plane, however low the sun.
#[test]
fn a_plane_lit_at_one_degree_has_no_acne() {
    let Some(gpu) = device() else { return };
    for (degrees, turn) in [(1.0_f32, 0.3), (1.0, 0.0), (20.0, 0.8), (90.0, 0.0)] {
        let (rise, along) = degrees.to_radians().sin_cos();
        let direction = Quat::from_rotation_y(turn) * Vec3::new(along, -rise, 0.0);
        let fixture = scene(vec![level(0, 0.0, 20.0)], direction);
        let eye = Vec3::new(0.0, 1.5, 10.0);
        let camera = Camera::look_at(eye, Vec3::ZERO, Vec3::Y, 0.9).expect("a view");
        for (filter, radius) in [
            (ShadowFilter::Pcf, 0),
            (ShadowFilter::Pcf, 1),
            (ShadowFilter::Pcf, 5),
            (ShadowFilter::Pcss, 0),
        ] {
            let mut settings = settings();
            settings.shadow.resolution = 512;
            (settings.shadow.filter, settings.shadow.pcf_radius) = (filter, radius);
            let found = visibility(&gpu, &fixture, camera, &settings);
            let lit: Vec<f32> = found.into_iter().flatten().collect();
            let least = lit.iter().copied().fold(1.0, f32::min);
            assert!(lit.len() > 1000, "{} pixels", lit.len());
            assert!(
                least > 0.99,
                "{degrees} degrees, {filter:?} {radius}: {least}"
            );
        }
    }
}

/// The floor behind a sheet is dark up to the sheet, at any height of the sun.
#[test]
fn a_thin_wall_lets_no_light_through() {
    let Some(gpu) = device() else { return };
    for degrees in [5.0_f32, 45.0, 75.0] {
        let (rise, along) = degrees.to_radians().sin_cos();
        // The wall stands at z = 0, three metres high, and the sun behind it, at +Z.
        let wall =
            Mat4::from_translation(Vec3::Y * 1.5) * Mat4::from_scale(Vec3::new(8.0, 1.5, 1.0));
        let objects = vec![level(0, 0.0, 10.0), quad(0, vec![wall])];
        let fixture = scene(objects, Vec3::new(0.0, -rise, -along));
        let length = (3.0 * along / rise).min(3.0) * 0.8;
        let half = length * 0.5;
        let camera = Camera {
            position: Vec3::new(0.0, 4.0, -half - 0.01),
            ..from_above(4.0, half)
        };
        for filter in [ShadowFilter::Pcf, ShadowFilter::Pcss] {
            let mut settings = settings();
            settings.shadow.filter = filter;
            let found = visibility(&gpu, &fixture, camera, &settings);
            let lit: Vec<f32> = found.into_iter().flatten().collect();
            let most = lit.iter().copied().fold(0.0, f32::max);
            assert!(lit.len() > 1000, "{} pixels", lit.len());
            assert!(most < 0.01, "{degrees} degrees, {filter:?}: {most} leaks");
        }
    }
}

/// The mean visibility left and right of the middle, a margin aside.
fn halves(found: &[Option<f32>]) -> [f32; 2] {
    let column = |index: usize| index % SIZE[0] as usize;
    let mean = |range: std::ops::Range<usize>| {
        let inside =
            |(index, lit): (usize, &Option<f32>)| lit.filter(|_| range.contains(&column(index)));
        let lit: Vec<f32> = found.iter().enumerate().filter_map(inside).collect();
        lit.iter().sum::<f32>() / lit.len() as f32
    };
    [mean(4..44), mean(52..92)]
}

/// Above the floor lies a sheet whose right half is cut away, or blended.
#[test]
fn cut_casters_cast_what_is_left_and_blended_ones_nothing() {
    let Some(gpu) = device() else { return };
    let found = |alpha_mode| {
        let mut sheet = level(1, 2.0, 3.0);
        for vertex in &mut sheet.vertices {
            vertex.uv0 = [vertex.position[0] * 0.5 + 0.5, 0.5];
        }
        let cut = Material {
            base_color_tex: 0,
            alpha_mode,
            ..matte()
        };
        let texels = vec![[255, 255, 255, 255], [255, 255, 255, 0]];
        let fixture = Fixture {
            materials: vec![matte(), cut],
            textures: vec![row(TextureFormat::Rgba8Unorm, texels)],
            ..scene(vec![level(0, 0.0, 5.0), sheet], Vec3::NEG_Y)
        };
        // Between floor and sheet.
        halves(&visibility(
            &gpu,
            &fixture,
            from_above(1.0, 2.0),
            &settings(),
        ))
    };
    assert_eq!(found(0), [0.0, 0.0]);
    assert_eq!(found(ALPHA_MASK), [0.0, 1.0]);
    assert_eq!(found(ALPHA_BLEND), [1.0, 1.0]);
}

/// Debug view 8 shows, in each pixel, the cascade that the split distances give.
#[test]
fn the_cascade_view_follows_the_splits() {
    let Some(gpu) = device() else { return };
    let direction = Vec3::new(0.3, -1.0, 0.2);
    let fixture = scene(vec![level(0, 0.0, 60.0)], direction);
    let eye = Vec3::new(0.0, 2.0, 50.0);
    let camera = Camera::look_at(eye, Vec3::new(0.0, 0.0, 30.0), Vec3::Y, 0.9).expect("a view");
    let mut settings = settings();
    settings.debug_view = 8;
    settings.shadow.max_distance = 80.0;
    let hdr = shoot(&gpu, &fixture, SIZE, camera, settings.clone())
        .hdr
        .expect("read back");
    let package = fixture.package();
    let bounds = crate::scene::bounds(&package);
    let cascades = Cascades::fit(
        &camera,
        1.0,
        direction.normalize(),
        bounds,
        &settings.shadow,
    );
    let ends: Vec<f32> = cascades.iter().map(|cascade| cascade.end).collect();
    let colors = [
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0],
        [1.0, 1.0, 0.0],
    ];
    let triangles = triangles(&fixture);
    let mut seen = [0; 4];
    for (pixel, found) in hdr.iter().enumerate() {
        let (origin, ray) = primary(&camera, pixel);
        let Some(distance) = hit(&triangles, origin, ray, 1e-6) else {
            continue;
        };
        let depth = (distance * ray.dot(camera.forward.as_dvec3())) as f32;
        let index = ends
            .iter()
            .position(|end| depth < *end)
            .unwrap_or(ends.len() - 1);
        if ends.iter().any(|end| (depth / end - 1.0).abs() < 1e-3) {
            continue;
        }
        assert_eq!(
            found[..3],
            colors[index],
            "pixel {pixel} at {depth} m, splits {ends:?}"
        );
        seen[index] += 1;
    }
    assert!(
        seen[..ends.len()].iter().all(|count| *count > 10) && ends.len() == 4,
        "{seen:?}"
    );
}

/// Mean difference, in 255ths, between what one camera sees and what another sees of the same places.
fn shimmer(gpu: &Gpu, cameras: [Camera; 2], settings: [&Settings; 2]) -> f32 {
    let fixture = clutter(Vec3::new(0.5, -1.0, -0.4));
    let images = [0, 1].map(|index| visibility(gpu, &fixture, cameras[index], settings[index]));
    let triangles = triangles(&fixture);
    let [width, height] = SIZE.map(|size| size as f32);
    let matrix = cameras[1].projection(1.0) * cameras[1].view();
    let (mut sum, mut count) = (0.0, 0);
    for (pixel, first) in images[0].iter().enumerate() {
        let Some(first) = first else { continue };
        let (origin, ray) = primary(&cameras[0], pixel);
        let Some(distance) = hit(&triangles, origin, ray, 1e-6) else {
            continue;
        };
        let point = origin + ray * distance;
        // The floor alone: silhouettes hide other places from other cameras.
        if point.y.abs() > 1e-6 {
            continue;
        }
        let ndc = matrix.project_point3(point.as_vec3());
        let (x, y) = (
            (ndc.x * 0.5 + 0.5) * width - 0.5,
            (0.5 - ndc.y * 0.5) * height - 0.5,
        );
        if x < 0.0 || y < 0.0 || x >= width - 1.0 || y >= height - 1.0 {
            continue;
        }
        let at = |dx: u32, dy: u32| images[1][((y as u32 + dy) * SIZE[0] + x as u32 + dx) as usize];
        let (Some(a), Some(b), Some(c), Some(d)) = (at(0, 0), at(1, 0), at(0, 1), at(1, 1)) else {
            continue;
        };
        let (u, v) = (x.fract(), y.fract());
        let second = (a * (1.0 - u) + b * u) * (1.0 - v) + (c * (1.0 - u) + d * u) * v;
        // The other camera sees something else here.
        let hidden = {
            let (origin, ray) = (
                cameras[1].position.as_dvec3(),
                point - cameras[1].position.as_dvec3(),
            );
            hit(&triangles, origin, ray.normalize(), 1e-6)
                .is_none_or(|nearest| nearest < ray.length() - 1e-2)
        };
        if !hidden {
            sum += (first - second).abs();
            count += 1;
        }
    }
    assert!(count > 1000, "{count} places");
    sum / count as f32 * 255.0
}

/// W-15. The shadows are wide enough that comparing pixels of two cameras costs little.
#[test]
fn shadows_stand_still_under_camera_motion() {
    let Some(gpu) = device() else { return };
    let mut soft = settings();
    soft.shadow.resolution = 512;
    soft.shadow.pcf_radius = 5;
    (soft.shadow.cascades, soft.shadow.max_distance) = (1, 12.0);
    let camera = Camera {
        projection: Projection::Perspective { yfov: 0.3 },
        ..Camera::look_at(
            Vec3::new(0.5, 3.0, 4.0),
            Vec3::new(0.0, 0.0, -0.3),
            Vec3::Y,
            0.5,
        )
        .expect("a view")
    };
    let turned = |angle: f32| Camera {
        forward: Quat::from_rotation_y(angle) * camera.forward,
        up: Quat::from_rotation_y(angle) * camera.up,
        ..camera
    };
    let moved = Camera {
        position: camera.position + Vec3::new(0.013, 0.0, 0.021),
        ..camera
    };
    for other in [turned(0.004), turned(0.05), moved] {
        let difference = shimmer(&gpu, [camera, other], [&soft, &soft]);
        eprintln!("shimmer: {difference:.3} of 255");
        assert!(difference < 0.5, "{difference} of 255");
    }
    // The measure sees a grid that changes.
    let mut other = soft.clone();
    other.shadow.max_distance = 6.5;
    let difference = shimmer(&gpu, [camera, turned(0.004)], [&soft, &other]);
    assert!(difference > 0.5, "{difference} of 255");
}

/// The edge of a wide sheet under a disc light: visibility is the share of the disc beyond the edge.
#[test]
fn a_penumbra_is_as_wide_as_the_light() {
    let Some(gpu) = device() else { return };
    let mut sheet = level(0, 2.0, 3.0);
    for vertex in &mut sheet.vertices {
        // From x = -6 to 0.
        vertex.position[0] -= 1.0;
    }
    let fixture = scene(vec![level(0, 0.0, 5.0), sheet], Vec3::NEG_Y);
    for diameter in [0.05_f32, 0.2] {
        let mut settings = settings();
        settings.shadow.filter = ShadowFilter::Pcss;
        settings.shadow.quality = Quality::High;
        settings.shadow.angular_diameter = diameter;
        let radius = 2.0 * (diameter * 0.5).tan();
        let half = radius * 1.5;
        let found = visibility(&gpu, &fixture, from_above(1.0, half), &settings);
        let columns = SIZE[0] as usize;
        let mut error = 0.0;
        for column in 0..columns {
            let lit = found.iter().skip(column).step_by(columns).flatten();
            let mean = lit.sum::<f32>() / SIZE[1] as f32;
            let x = ((column as f32 + 0.5) / columns as f32 * 2.0 - 1.0) * half;
            let t = (x / radius).clamp(-1.0, 1.0);
            let expected = 0.5 + (t * (1.0 - t * t).sqrt() + t.asin()) / std::f32::consts::PI;
            error += (mean - expected).abs() / columns as f32;
        }
        eprintln!("{diameter} rad: mean error of the penumbra {error:.4}");
        assert!(error < 0.02, "{diameter} rad: mean error {error}");
    }
}

/// W-19: without a filter over time, what is drawn depends on no frame number.
#[test]
fn the_noise_stands_still() {
    let Some(gpu) = device() else { return };
    let package = clutter(Vec3::new(0.5, -1.0, -0.4)).package();
    let mut settings = settings();
    settings.shadow.filter = ShadowFilter::Pcss;
    settings.shadow.angular_diameter = 0.1;
    let after = |frames| {
        let options = HeadlessOptions {
            frames,
            ..options(SIZE, oblique(), settings.clone())
        };
        render_on(&gpu, &package, &options).expect("renders").hdr
    };
    assert!(after(1) == after(6));
}

/// The shadow pass and map are there only where something casts.
#[test]
fn nothing_casts_no_pass() {
    let Some(gpu) = device() else { return };
    let has_pass = |fixture: &Fixture, settings: Settings| {
        let image = shoot(&gpu, fixture, [8, 8], oblique(), settings);
        image.passes.iter().any(|pass| pass.name == "shadow")
    };
    let direction = Vec3::new(0.5, -1.0, -0.4);
    let fixture = clutter(direction);
    assert!(!has_pass(&fixture, plain()));
    let mut silent = fixture.clone();
    silent.lights[0].color_and_shadow[3] = 0.0;
    assert!(!has_pass(&silent, settings()));
    let mut glass = fixture;
    glass.materials[0].alpha_mode = ALPHA_BLEND;
    assert!(!has_pass(&glass, settings()));
}

#[test]
fn a_prepass_leaves_shadows_as_they_are() {
    let Some(gpu) = device() else { return };
    let fixture = clutter(Vec3::new(0.5, -1.0, -0.4));
    let shot = |prepass| {
        let settings = Settings {
            prepass,
            ..settings()
        };
        shoot(&gpu, &fixture, SIZE, oblique(), settings).hdr
    };
    assert_eq!(shot(Prepass::Off), shot(Prepass::On));
}

/// Lookups start from the triangle's normal: a map that bends the shaded one moves no shadow.
#[test]
fn normal_maps_do_not_move_shadows() {
    let Some(gpu) = device() else { return };
    let direction = Vec3::new(0.5, -1.0, 0.3);
    let shadows = |map: [u8; 4]| {
        let ball = sphere(0, vec![Mat4::from_translation(Vec3::Y)]);
        let mut fixture = scene(vec![level(1, 0.0, 6.0), ball], direction);
        fixture.materials.push(Material {
            normal_tex: 0,
            ..matte()
        });
        fixture.textures = vec![row(TextureFormat::Rgba8Unorm, vec![map])];
        visibility(&gpu, &fixture, from_above(9.0, 3.0), &settings())
    };
    let flat = shadows([128, 128, 255, 255]);
    assert!(flat.iter().flatten().any(|share| *share < 0.1));
    assert!(flat.iter().flatten().any(|share| *share > 0.99));
    // Bent by 50 degrees to either side.
    for map in [
        [226, 128, 210, 255],
        [30, 128, 210, 255],
        [128, 226, 210, 255],
    ] {
        let bent = shadows(map);
        let pairs = flat
            .iter()
            .zip(&bent)
            .filter_map(|(a, b)| Some(((*a)?, (*b)?)));
        let off: Vec<f32> = pairs.map(|(a, b)| (a - b).abs()).collect();
        assert!(off.len() > flat.len() / 2, "most of it is lit");
        let worst = off.iter().copied().fold(0.0, f32::max);
        assert!(worst < 0.01, "{map:?}: {worst}");
    }
    assert_eq!(gpu.close(), Vec::<String>::new());
}
