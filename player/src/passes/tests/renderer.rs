//! A renderer that lives through changes draws what a fresh one draws.

use cairn_format::Package;
use cairn_format::gpu::{ALPHA_BLEND, Material};
use glam::{Mat4, Vec3};

use super::fixture::{Fixture, casting, light, quad, sphere};
use super::{device, plain, towards_origin};
use crate::frame::Renderer;
use crate::gpu::{
    Buffer, BufferDesc, FrameTarget, Frames, Gpu, Image, ImageDesc, Memory, Sync, vk,
};
use crate::scene::GpuScene;
use crate::settings::{Brdf, LightSource, Settings, ShadowFilter};

const FORMAT: vk::Format = vk::Format::R8G8B8A8_SRGB;

pub(super) struct Stage<'a> {
    pub gpu: &'a Gpu,
    pub package: &'a Package,
    pub scene: &'a GpuScene,
    pub frames: Frames,
}

impl Stage<'_> {
    pub fn renderer(&self, size: [u32; 2], settings: &Settings) -> Renderer {
        Renderer::new(self.gpu, self.scene, self.package, FORMAT, size, settings).expect("builds")
    }

    /// Draws two frames into one target; the half floats of the last.
    pub fn draw(
        &mut self,
        renderer: &mut Renderer,
        size: [u32; 2],
        settings: &Settings,
    ) -> Vec<u16> {
        let target = Image::new(
            self.gpu,
            &ImageDesc {
                name: "target",
                format: FORMAT,
                extent: size,
                levels: 1,
                layers: 1,
                cube: false,
                array: false,
                samples: 1,
                usage: vk::ImageUsageFlags::COLOR_ATTACHMENT | vk::ImageUsageFlags::SAMPLED,
            },
        )
        .expect("target");
        let mut halves = vec![0; (size[0] * size[1] * 4) as usize];
        let buffer = Buffer::new(
            self.gpu,
            &BufferDesc {
                name: "readback",
                size: halves.len() as u64 * 2,
                usage: vk::BufferUsageFlags::TRANSFER_DST,
                memory: Memory::Readback,
            },
        )
        .expect("buffer");
        let camera = towards_origin(Vec3::new(0.5, 0.4, 3.0));
        let mut last = None;
        for _ in 0..2 {
            let mut commands = self.frames.begin().expect("begins");
            let target = FrameTarget {
                image: target.view(),
                final_layout: vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL,
                final_sync: Sync::NONE,
            };
            let (scene, package) = (self.scene, self.package);
            renderer
                .record(&mut commands, scene, package, &camera, settings, target)
                .expect("records");
            renderer.copy_hdr(&mut commands, &buffer);
            last = Some(self.frames.submit(commands).expect("submits"));
        }
        self.gpu.wait(last.expect("two frames")).expect("finishes");
        buffer.read(0, &mut halves).expect("reads");
        halves
    }
}

#[test]
fn resizing_and_changing_settings_leave_no_trace() {
    let Some(gpu) = device() else { return };
    let blended = Material {
        base_color_factor: [0.2, 0.9, 0.4, 0.5],
        alpha_mode: ALPHA_BLEND,
        roughness_factor: 0.6,
        ..Material::default()
    };
    let package = Fixture {
        objects: vec![
            sphere(0, vec![Mat4::IDENTITY]),
            quad(1, vec![Mat4::from_translation(Vec3::Z)]),
        ],
        materials: vec![Material::default(), blended],
        lights: vec![light(Vec3::new(0.3, -1.0, -0.5), [1.0; 3], 2.0)],
        environment: Some([[0.5, 0.6, 0.7]; 6]),
        lut: true,
        ..Fixture::default()
    }
    .package();
    let scene = GpuScene::upload(&gpu, &package).expect("uploads");
    let mut stage = Stage {
        gpu: &gpu,
        package: &package,
        scene: &scene,
        frames: Frames::new(&gpu).expect("frames"),
    };
    let settings = |brdf: Brdf| Settings { brdf, ..plain() };
    let mut lasting = stage.renderer([8, 8], &settings(Brdf::Energy));
    let mut images = Vec::new();
    for (size, brdf) in [
        ([8, 8], Brdf::Energy),
        ([31, 17], Brdf::GltfCore),
        ([1, 1], Brdf::GltfCore),
        ([31, 17], Brdf::Energy),
    ] {
        let settings = settings(brdf);
        lasting.resize(&gpu, size).expect("resizes");
        let found = stage.draw(&mut lasting, size, &settings);
        let mut fresh = stage.renderer(size, &settings);
        assert_eq!(
            found,
            stage.draw(&mut fresh, size, &settings),
            "{size:?} {brdf:?}"
        );
        images.push(found);
    }
    assert_ne!(images[1], images[3], "the BRDF setting shows");
    drop((lasting, stage));
    drop(scene);
    assert_eq!(gpu.close(), Vec::<String>::new());
}

/// Maps of other sizes, other filters, other lights, and a way back: no layer keeps what is no longer true.
#[test]
fn changing_shadows_leaves_no_trace() {
    let Some(gpu) = device() else { return };
    let floor = Mat4::from_translation(-Vec3::Y)
        * Mat4::from_rotation_x(-std::f32::consts::FRAC_PI_2)
        * Mat4::from_scale(Vec3::splat(20.0));
    let package = Fixture {
        objects: vec![sphere(0, vec![Mat4::IDENTITY]), quad(0, vec![floor])],
        materials: vec![Material::default()],
        lights: vec![casting(Vec3::new(0.3, -1.0, -0.5))],
        ..Fixture::default()
    }
    .package();
    let scene = GpuScene::upload(&gpu, &package).expect("uploads");
    let mut stage = Stage {
        gpu: &gpu,
        package: &package,
        scene: &scene,
        frames: Frames::new(&gpu).expect("frames"),
    };
    let mut settings = plain();
    settings.shadow.enabled = true;
    settings.shadow.resolution = 512;
    let size = [24, 24];
    let mut lasting = stage.renderer(size, &settings);
    let changes: [fn(&mut Settings); 10] = [
        |_| {},
        |settings| settings.shadow.resolution = 1024,
        |settings| settings.shadow.cascades = 1,
        |settings| settings.shadow.filter = ShadowFilter::Pcss,
        |settings| settings.shadow.enabled = false,
        |settings| settings.shadow.enabled = true,
        |settings| settings.light.source = LightSource::Fallback,
        |settings| settings.light.yaw = 2.0,
        |settings| settings.shadow.slope_bias = 0.0,
        |settings| settings.shadow.cascades = 4,
    ];
    let mut images = Vec::new();
    for (index, change) in changes.into_iter().enumerate() {
        change(&mut settings);
        let found = stage.draw(&mut lasting, size, &settings);
        let mut fresh = stage.renderer(size, &settings);
        assert!(
            found == stage.draw(&mut fresh, size, &settings),
            "change {index}"
        );
        images.push(found);
    }
    assert_ne!(images[3], images[4], "shadows show");
    assert_ne!(images[6], images[7], "the light's angle shows");
    drop((lasting, stage));
    drop(scene);
    assert_eq!(gpu.close(), Vec::<String>::new());
}
