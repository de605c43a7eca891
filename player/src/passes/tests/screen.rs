//! Draws frames one after another and reads ambient occlusion back.

use cairn_format::Package;
use glam::{Vec2, Vec3};

use crate::camera::Camera;
use crate::frame::Renderer;
use crate::gpu::{
    Buffer, BufferDesc, Commands, FrameTarget, Frames, Gpu, Image, ImageDesc, Memory, Sync, vk,
};
use crate::graph::Usage;
use crate::scene::GpuScene;
use crate::settings::Settings;

pub const FORMAT: vk::Format = vk::Format::R8G8B8A8_SRGB;

/// A texel of ambient occlusion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Texel {
    pub visibility: f32,
    /// World space, unit.
    pub bent: Vec3,
    /// Nothing is there.
    pub sky: bool,
    /// Frames of history.
    pub frames: u32,
}

impl Texel {
    fn unpack([x, y]: [u32; 2]) -> Self {
        let at = Vec2::new((y & 0xfff) as f32, (y >> 12 & 0xfff) as f32) / 4095.0 * 2.0 - 1.0;
        let mut bent = at.extend(1.0 - at.x.abs() - at.y.abs());
        let fold = (-bent.z).max(0.0);
        bent.x -= fold.copysign(bent.x);
        bent.y -= fold.copysign(bent.y);
        Self {
            visibility: (x & 0xffff) as f32 / 65535.0,
            bent: bent.normalize(),
            sky: x >> 16 == 0xffff,
            frames: y >> 24,
        }
    }
}

/// A renderer with its target.
pub struct Screen<'a> {
    package: &'a Package,
    scene: &'a GpuScene,
    gpu: &'a Gpu,
    frames: Frames,
    pub renderer: Renderer,
    size: [u32; 2],
    target: Image,
    buffer: Buffer,
}

impl<'a> Screen<'a> {
    pub fn new(
        gpu: &'a Gpu,
        scene: &'a GpuScene,
        package: &'a Package,
        size: [u32; 2],
        settings: &Settings,
    ) -> Self {
        let desc = ImageDesc {
            name: "target",
            format: FORMAT,
            extent: size,
            levels: 1,
            layers: 1,
            cube: false,
            array: false,
            samples: 1,
            usage: vk::ImageUsageFlags::COLOR_ATTACHMENT | vk::ImageUsageFlags::SAMPLED,
        };
        let readback = BufferDesc {
            name: "readback",
            size: u64::from(size[0] * size[1]) * 8,
            usage: vk::BufferUsageFlags::TRANSFER_DST,
            memory: Memory::Readback,
        };
        Self {
            package,
            scene,
            gpu,
            frames: Frames::new(gpu).expect("frames"),
            renderer: Renderer::new(gpu, scene, package, FORMAT, size, settings).expect("builds"),
            size,
            target: Image::new(gpu, &desc).expect("target"),
            buffer: Buffer::new(gpu, &readback).expect("buffer"),
        }
    }

    /// Draws a frame; its ambient occlusion, rows from the top.
    pub fn frame(&mut self, camera: &Camera, settings: &Settings) -> Vec<Texel> {
        self.record(camera, settings, true);
        let mut words = vec![[0_u32; 2]; (self.size[0] * self.size[1]) as usize];
        self.buffer.read(0, &mut words).expect("reads");
        words.into_iter().map(Texel::unpack).collect()
    }

    /// Draws a frame that may have no ambient occlusion.
    pub fn draw(&mut self, camera: &Camera, settings: &Settings) {
        self.record(camera, settings, false);
    }

    fn record(&mut self, camera: &Camera, settings: &Settings, copy: bool) {
        let mut commands = self.frames.begin().expect("begins");
        let target = FrameTarget {
            image: self.target.view(),
            final_layout: vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL,
            final_sync: Sync::NONE,
        };
        let (scene, package) = (self.scene, self.package);
        self.renderer
            .record(&mut commands, scene, package, camera, settings, target)
            .expect("records");
        if copy {
            copy_ao(&mut self.renderer, &mut commands, &self.buffer);
        }
        let submission = self.frames.submit(commands).expect("submits");
        self.gpu.wait(submission).expect("finishes");
    }

    /// The last of `count` frames.
    pub fn settle(&mut self, camera: &Camera, settings: &Settings, count: u32) -> Vec<Texel> {
        let mut last = Vec::new();
        for _ in 0..count {
            last = self.frame(camera, settings);
        }
        last
    }
}

fn copy_ao(renderer: &mut Renderer, commands: &mut Commands, buffer: &Buffer) {
    let ao = renderer.targets.ao.expect("ambient occlusion is on");
    let ao = ao.ao.current;
    let mut frame = renderer.graph.begin(commands, None);
    let uses = [(ao, Usage::CopySource)];
    frame.pass(c"copy ao", &uses, |commands, images| {
        commands.copy_image_to_buffer(images.get(ao), 0, 0, buffer, 0);
    });
}
