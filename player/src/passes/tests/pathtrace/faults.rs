//! Faults that other path tracers are known for: see `docs/w-list.md`.

use cairn_format::TextureFormat;
use cairn_format::gpu::{MATERIAL_DOUBLE_SIDED, Material};
use glam::{Mat4, Vec3};

use super::super::fixture::{Fixture, light, quad, row};
use super::super::screen::FORMAT;
use super::super::{device, towards_origin};
use super::{assert_close, mean, rough_black_core, samples, trace, traced, white, wide};
use crate::frame::frame_uniform;
use crate::gpu::{Buffer, BufferDesc, FrameTarget, Frames, Image, ImageDesc, Memory, Sync, vk};
use crate::headless::trace::TraceOptions;
use crate::plan::Plan;
use crate::scene::GpuScene;
use crate::settings::Settings;
use crate::tracer::Tracer;

/// A plane whose normal map leans as far as maps can, lit from below alone: by the sky, or by a light.
///
/// Above the plane nothing shines, so whatever it reflects has come through it.
#[test]
fn no_light_leaks_through_strong_normal_maps() {
    let Some(gpu) = device() else { return };
    for roughness in [0.05, 0.5, 1.0] {
        let bent = Material {
            normal_tex: 0,
            normal_scale: 1.0,
            ..white(0.5, roughness)
        };
        // X all to the right: 85 degrees.
        let map = row(TextureFormat::Rgba8Unorm, vec![[255, 128, 10, 255]]);
        let mut fixture = Fixture {
            objects: vec![wide(0, 1e3)],
            materials: vec![bent],
            textures: vec![map],
            environment: Some([[1.0; 3]; 6]),
            gradient: Some(|d| [if d.z < -0.05 { 5.0 } else { 0.0 }; 3]),
            lut: true,
            ..Fixture::default()
        };
        let camera = || towards_origin(Vec3::new(1.0, 0.3, 2.0));
        let image = trace(&gpu, &fixture, [16, 16], camera(), traced(), &samples(64));
        assert_eq!(mean(&image, 0), 0.0, "sky, roughness {roughness}");

        // Above the mapped normal's horizon, and below or above the plane's.
        fixture.gradient = Some(|_| [0.0; 3]);
        for (height, lit) in [(-0.05, false), (0.05, true)] {
            fixture.lights = vec![light(Vec3::new(-0.9, 0.0, -height), [1.0; 3], 10.0)];
            let image = trace(&gpu, &fixture, [16, 16], camera(), traced(), &samples(16));
            assert_eq!(
                mean(&image, 0) > 0.0,
                lit,
                "light at {height}, roughness {roughness}"
            );
        }
    }
    assert_eq!(gpu.close(), Vec::<String>::new());
}

/// A lit surface, and single-sided walls before it that show the camera their backs: what it sees through them, and with
/// which weights, is what it sees without them. No bounce is used up, and guides are of what is seen.
#[test]
fn passing_back_faces_changes_nothing() {
    let Some(gpu) = device() else { return };
    let lamp = Material {
        base_color_factor: [0.5, 0.5, 0.5, 1.0],
        emissive_factor: [1.5, 1.5, 1.5, 0.0],
        metallic_factor: 0.0,
        ..Material::default()
    };
    let shoot = |walls: &[f32], bounces: u32| {
        // Facing away from the camera, which looks down from +Z.
        let wall = |z: &f32| {
            Mat4::from_translation(Vec3::Z * *z)
                * Mat4::from_rotation_x(std::f32::consts::PI)
                * Mat4::from_scale(Vec3::splat(2.0))
        };
        let mut objects = vec![wide(0, 9.0)];
        if !walls.is_empty() {
            objects.push(quad(1, walls.iter().map(wall).collect()));
        }
        let fixture = Fixture {
            objects,
            // The walls are black, so that they change the light only where they hide it.
            materials: vec![
                lamp,
                Material {
                    base_color_factor: [0.0, 0.0, 0.0, 1.0],
                    ..white(1.0, 1.0)
                },
            ],
            // From the side, below the lowest wall.
            lights: vec![light(Vec3::new(-1.0, 0.0, -0.1), [1.0; 3], 9.0)],
            environment: Some([[0.0; 3]; 6]),
            lut: true,
            ..Fixture::default()
        };
        let mut settings = traced();
        settings.path.bounces = bounces;
        let limits = TraceOptions {
            guides: true,
            ..samples(16)
        };
        let camera = towards_origin(Vec3::new(0.0, 0.0, 3.0));
        trace(&gpu, &fixture, [8, 8], camera, settings, &limits)
    };
    let open = shoot(&[], 0);
    assert!(mean(&open, 0) > 1.6, "emission and light");
    for walls in [&[1.0][..], &[0.5, 1.0, 1.5, 2.0]] {
        let through = shoot(walls, 0);
        assert_close(mean(&through, 0), mean(&open, 0), 1e-4);
        let [albedo, normal] = through.guides.as_ref().expect("guides");
        let [expected, facing] = open.guides.as_ref().expect("guides");
        for (found, expected) in albedo.iter().zip(expected).chain(normal.iter().zip(facing)) {
            for channel in 0..3 {
                assert!((found[channel] - expected[channel]).abs() < 1e-3);
            }
        }
    }
    assert_eq!(gpu.close(), Vec::<String>::new());
}

/// A lamp behind a wall's back: neither sampling it nor meeting it by chance gets through.
#[test]
fn back_faces_hide_lamps_from_every_ray_but_the_cameras() {
    let Some(gpu) = device() else { return };
    let lamp = Material {
        base_color_factor: [0.0, 0.0, 0.0, 1.0],
        emissive_factor: [5.0, 5.0, 5.0, 0.0],
        ..white(0.0, 1.0)
    };
    let up = |z: f32, half: f32| {
        Mat4::from_translation(Vec3::Z * z) * Mat4::from_scale(Vec3::splat(half))
    };
    let down = |z: f32, half: f32| up(z, half) * Mat4::from_rotation_x(std::f32::consts::PI);
    let fixture = Fixture {
        // Floor, lamp that shines down on it, and between them a wall that shows the floor its back.
        objects: vec![
            wide(0, 10.0),
            quad(1, vec![down(2.0, 0.5)]),
            quad(2, vec![up(1.0, 50.0)]),
        ],
        materials: vec![rough_black_core(), lamp, white(0.0, 1.0)],
        environment: Some([[0.0; 3]; 6]),
        lut: true,
        ..Fixture::default()
    };
    let camera = || towards_origin(Vec3::new(0.3, 0.0, 0.8));
    for sampled in [true, false] {
        let mut settings = traced();
        settings.path.sample_emitters = sampled;
        let image = trace(&gpu, &fixture, [8, 8], camera(), settings, &samples(64));
        assert_eq!(mean(&image, 0), 0.0, "sampled: {sampled}");
    }
    assert_eq!(gpu.close(), Vec::<String>::new());
}

/// Layers hide the floor from a light as often as from the camera: each ray and layer has a number of its own.
#[test]
fn layers_multiply_in_shadows_too() {
    let Some(gpu) = device() else { return };
    let veil = Material {
        base_color_factor: [0.0, 0.0, 0.0, 0.5],
        alpha_mode: cairn_format::gpu::ALPHA_BLEND,
        double_sided: MATERIAL_DOUBLE_SIDED,
        ..white(1.0, 1.0)
    };
    let layer = |x: f32| {
        Mat4::from_translation(Vec3::X * x)
            * Mat4::from_rotation_y(std::f32::consts::FRAC_PI_2)
            * Mat4::from_scale(Vec3::splat(4.0))
    };
    let shoot = |layers: Vec<Mat4>| {
        let fixture = Fixture {
            objects: vec![wide(0, 9.0), quad(1, layers)],
            materials: vec![rough_black_core(), veil],
            lights: vec![light(Vec3::new(-1.0, 0.0, -0.4), [1.0; 3], 3.0)],
            environment: Some([[0.0; 3]; 6]),
            lut: true,
            ..Fixture::default()
        };
        let mut settings = traced();
        settings.path.bounces = 0;
        // Steep, so that no camera ray meets a layer.
        let mut camera = towards_origin(Vec3::new(0.0, 0.1, 3.0));
        camera.projection = crate::camera::Projection::Perspective { yfov: 0.1 };
        mean(
            &trace(&gpu, &fixture, [24, 24], camera, settings, &samples(64)),
            0,
        )
    };
    let open = shoot(vec![layer(-8.0)]);
    let veiled = shoot(vec![layer(1.0), layer(1.3), layer(1.6)]);
    assert_close(veiled, open * 0.125, 0.04);
    assert_eq!(gpu.close(), Vec::<String>::new());
}

/// A denoiser's guides are means over all samples: of a checker finer than pixels they show its grey. Metals have the
/// albedo of their reflection.
#[test]
fn guides_are_means_and_metals_are_not_black() {
    let Some(gpu) = device() else { return };
    let checker = Material {
        base_color_tex: 0,
        ..white(1.0, 0.5)
    };
    let mut plane = wide(0, 8.0);
    for vertex in &mut plane.vertices {
        vertex.uv0 = [vertex.position[0] * 300.0, 0.5];
    }
    let fixture = Fixture {
        objects: vec![plane],
        materials: vec![checker],
        textures: vec![row(
            TextureFormat::Rgba8Unorm,
            vec![[255, 255, 255, 255], [51, 51, 51, 255]],
        )],
        environment: Some([[1.0; 3]; 6]),
        lut: true,
        ..Fixture::default()
    };
    let mut settings = traced();
    settings.path.lod = false;
    let guides_of = |count: u32| {
        let limits = TraceOptions {
            guides: true,
            ..samples(count)
        };
        let camera = towards_origin(Vec3::new(0.0, 0.0, 3.0));
        let image = trace(&gpu, &fixture, [8, 8], camera, settings.clone(), &limits);
        image.guides.expect("guides")[0].clone()
    };
    let spread = |albedo: &[[f32; 4]]| {
        let off = albedo.iter().map(|texel| (texel[0] - 0.6).abs());
        off.fold(0.0, f32::max)
    };
    let (one, many) = (guides_of(1), guides_of(256));
    assert!(spread(&one) > 0.3, "a single sample is one of both colours");
    assert!(spread(&many) < 0.04, "{}", spread(&many));
    assert_eq!(gpu.close(), Vec::<String>::new());
}

const SIZE: [u32; 2] = [8, 8];

/// A tracer that draws view after view, as a window does.
struct Sequence<'a> {
    gpu: &'a crate::gpu::Gpu,
    package: &'a cairn_format::Package,
    scene: GpuScene,
    plan: Plan,
    tracer: Tracer,
    frames: Frames,
    target: Image,
}

impl<'a> Sequence<'a> {
    fn new(
        gpu: &'a crate::gpu::Gpu,
        package: &'a cairn_format::Package,
        settings: &Settings,
    ) -> Self {
        let scene = GpuScene::upload(gpu, package).expect("uploads");
        let plan = Plan::new(gpu, &scene, package, settings).expect("plans");
        let (format, variant) = (FORMAT, plan.variant);
        let mut tracer =
            Tracer::new(gpu, &scene, package, variant, format, SIZE, settings).expect("builds");
        tracer.with_guides = true;
        let desc = ImageDesc {
            name: "target",
            format,
            extent: SIZE,
            levels: 1,
            layers: 1,
            cube: false,
            array: false,
            samples: 1,
            usage: vk::ImageUsageFlags::COLOR_ATTACHMENT | vk::ImageUsageFlags::SAMPLED,
        };
        Self {
            gpu,
            package,
            scene,
            plan,
            tracer,
            frames: Frames::new(gpu).expect("frames"),
            target: Image::new(gpu, &desc).expect("a target"),
        }
    }

    /// Adds a sample of what `camera` sees; guides afterwards.
    fn frame(&mut self, camera: &crate::camera::Camera, settings: &Settings) -> [Vec<[f32; 4]>; 2] {
        let buffers: [Buffer; 2] = std::array::from_fn(|_| {
            let desc = BufferDesc {
                name: "guide",
                size: u64::from(SIZE[0] * SIZE[1]) * 16,
                usage: vk::BufferUsageFlags::TRANSFER_DST,
                memory: Memory::Readback,
            };
            Buffer::new(self.gpu, &desc).expect("a buffer")
        });
        let mut commands = self.frames.begin().expect("begins");
        let target = FrameTarget {
            image: self.target.view(),
            final_layout: vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL,
            final_sync: Sync::NONE,
        };
        let uniform = frame_uniform(camera, SIZE, &self.scene, settings);
        let (scene, package) = (&self.scene, self.package);
        self.tracer
            .record(
                &mut commands,
                scene,
                package,
                self.plan.variant,
                &uniform,
                settings,
                1,
                target,
                None,
            )
            .expect("records");
        self.tracer
            .copy_guides(&mut commands, [&buffers[0], &buffers[1]]);
        let submission = self.frames.submit(commands).expect("submits");
        self.gpu.wait(submission).expect("finishes");
        buffers.map(|buffer| {
            let mut texels = vec![[0.0f32; 4]; (SIZE[0] * SIZE[1]) as usize];
            buffer.read(0, texels.as_flattened_mut()).expect("reads");
            texels
        })
    }
}

/// After the camera has turned from a surface to the sky, no guide knows of the surface.
#[test]
fn guides_of_the_sky_are_empty_after_a_turn() {
    let Some(gpu) = device() else { return };
    let fixture = Fixture {
        objects: vec![wide(0, 50.0)],
        materials: vec![white(0.0, 0.5)],
        environment: Some([[1.0; 3]; 6]),
        lut: true,
        ..Fixture::default()
    };
    let package = fixture.package();
    let settings = traced();
    let mut sequence = Sequence::new(&gpu, &package, &settings);
    let surface = towards_origin(Vec3::new(0.0, 0.5, 3.0));
    let sky = crate::camera::Camera::look_at(
        Vec3::new(0.0, 0.5, 3.0),
        Vec3::new(0.0, 0.5, 9.0),
        Vec3::Y,
        1.0,
    )
    .expect("a view");
    for _ in 0..3 {
        let [albedo, normal] = sequence.frame(&surface, &settings);
        assert!(albedo.iter().all(|texel| texel[0] > 0.5));
        assert!(normal.iter().all(|texel| texel[2] > 0.9));
    }
    assert_eq!(sequence.tracer.progress(), (3, 3));
    let [albedo, normal] = sequence.frame(&sky, &settings);
    assert_eq!(sequence.tracer.progress(), (1, 1), "a new mean");
    for texel in albedo.iter().chain(&normal) {
        assert_eq!(texel[..3], [0.0; 3]);
    }
    drop(sequence);
    assert_eq!(gpu.close(), Vec::<String>::new());
}

/// Rays start in ray generation alone, which is what a recursion depth of 1 allows.
#[test]
fn only_ray_generation_traces() {
    /// `OpTraceRayKHR`.
    const TRACE: u32 = 4445;
    let traces = |spirv: &[u32]| {
        let mut at = 5;
        let mut count = 0;
        while at < spirv.len() {
            count += u32::from(spirv[at] & 0xffff == TRACE);
            at += (spirv[at] >> 16) as usize;
        }
        count
    };
    assert!(traces(cairn_shaders::PATHTRACE_RGEN.spirv) >= 2);
    for shader in [
        &cairn_shaders::PATHTRACE_RCHIT,
        &cairn_shaders::PATHTRACE_RAHIT,
        &cairn_shaders::PATHTRACE_RMISS,
    ] {
        assert_eq!(traces(shader.spirv), 0, "{}", shader.name);
    }
}
