//! Tone curves against f64, both ways into the target, and dithering.

use cairn_format::Package;
use glam::{DMat3, DVec3, Mat4, Vec3};

use super::fixture::{Fixture, colored, quad, unlit};
use super::{device, plain, towards_origin};
use crate::frame::Renderer;
use crate::gpu::{
    Buffer, BufferDesc, FrameTarget, Frames, Gpu, Image, ImageDesc, Memory, Sync, vk,
};
use crate::scene::GpuScene;
use crate::settings::{Settings, Tonemap};

const FRAGMENT: vk::Format = vk::Format::R8G8B8A8_SRGB;
const COMPUTE: vk::Format = vk::Format::R8G8B8A8_UNORM;
const CURVES: [Tonemap; 4] = [
    Tonemap::Aces,
    Tonemap::Linear,
    Tonemap::Agx,
    Tonemap::Neutral,
];
/// Pixels of a colour's square.
const CELL: u32 = 4;
const SIDE: u32 = 4;

/// From black to beyond what a half float holds, grey and coloured; negative channels, and one that is not finite in
/// 16 bits.
const COLORS: [[f32; 3]; 16] = [
    [0.0, 0.0, 0.0],
    [1e-5, 1e-5, 1e-5],
    [0.001, 0.002, 0.004],
    [0.02, 0.01, 0.03],
    [0.18, 0.18, 0.18],
    [0.5, 0.1, 0.02],
    [0.04, 0.3, 0.75],
    [0.76, 0.76, 0.76],
    [1.0, 0.5, 0.25],
    [0.0, 2.0, 0.0],
    [4.0, 4.0, 4.0],
    [30.0, 1.0, 0.1],
    [1000.0, 900.0, 800.0],
    [65504.0, 65504.0, 65504.0],
    [-1.0, 0.2, -1e30],
    [1e30, 0.5, 0.0],
];

/// One square per colour, seen from straight ahead.
fn chart() -> Fixture {
    let mut fixture = Fixture::default();
    for (index, [r, g, b]) in COLORS.into_iter().enumerate() {
        let (x, y) = (index as u32 % SIDE, index as u32 / SIDE);
        let center = Vec3::new(x as f32 - 1.5, 1.5 - y as f32, 0.0) * 0.5;
        let model = Mat4::from_translation(center) * Mat4::from_scale(Vec3::splat(0.25));
        fixture.objects.push(quad(index as u32, vec![model]));
        fixture.materials.push(unlit([r, g, b, 1.0]));
    }
    fixture
}

/// What a target of this format shows.
fn shown(gpu: &Gpu, package: &Package, format: vk::Format, settings: &Settings) -> Vec<[u8; 4]> {
    let size = [CELL * SIDE; 2];
    let scene = GpuScene::upload(gpu, package).expect("uploads");
    let mut renderer = Renderer::new(gpu, &scene, package, format, size, settings).expect("builds");
    let usage = match format {
        COMPUTE => vk::ImageUsageFlags::STORAGE,
        _ => vk::ImageUsageFlags::COLOR_ATTACHMENT,
    };
    let desc = ImageDesc {
        name: "target",
        format,
        extent: size,
        levels: 1,
        layers: 1,
        cube: false,
        array: false,
        samples: 1,
        usage: usage | vk::ImageUsageFlags::TRANSFER_SRC,
    };
    let target = Image::new(gpu, &desc).expect("target");
    let mut pixels = vec![[0; 4]; (size[0] * size[1]) as usize];
    let desc = BufferDesc {
        name: "readback",
        size: pixels.len() as u64 * 4,
        usage: vk::BufferUsageFlags::TRANSFER_DST,
        memory: Memory::Readback,
    };
    let buffer = Buffer::new(gpu, &desc).expect("buffer");
    let camera = towards_origin(Vec3::new(0.0, 0.0, 1.0 / (0.5_f32).tan()));
    let mut frames = Frames::new(gpu).expect("frames");
    let mut commands = frames.begin().expect("begins");
    let view = FrameTarget {
        image: target.view(),
        final_layout: vk::ImageLayout::TRANSFER_SRC_OPTIMAL,
        final_sync: Sync {
            stage: vk::PipelineStageFlags2::COPY,
            access: vk::AccessFlags2::TRANSFER_READ,
        },
    };
    renderer
        .record(&mut commands, &scene, package, &camera, settings, view)
        .expect("records");
    commands.copy_image_to_buffer(target.view(), 0, 0, &buffer, 0);
    let submission = frames.submit(commands).expect("submits");
    gpu.wait(submission).expect("finishes");
    buffer.read(0, &mut pixels).expect("reads");
    assert_eq!(gpu.validation_messages(), Vec::<String>::new());
    pixels
}

fn with(tonemap: Tonemap, ev: f32) -> Settings {
    Settings {
        tonemap,
        ev,
        ..plain()
    }
}

fn curve(tonemap: Tonemap, color: DVec3) -> DVec3 {
    let each = |f: fn(f64) -> f64| DVec3::from(color.to_array().map(f));
    match tonemap {
        Tonemap::Linear => color,
        Tonemap::Aces => each(|x| x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14)),
        Tonemap::Agx => agx(color),
        Tonemap::Neutral => neutral(color),
    }
}

/// Sobotka's curve as its generator has it: a sigmoid through a pivot of slope 2, scaled so that the ends of the range
/// meet 0 and 1.
fn agx(color: DVec3) -> DVec3 {
    let inset = DMat3::from_cols(
        DVec3::new(0.842_401_071, 0.042_401_071, 0.042_401_071),
        DVec3::new(0.078_436_502, 0.878_436_502, 0.078_436_502),
        DVec3::new(0.079_162_427, 0.079_162_427, 0.879_162_427),
    );
    // 10 stops below middle grey, which is the pivot, and 6.5 above.
    let middle = 0.18_f64.log2();
    let stops = [middle - 10.0, middle + 6.5];
    let pivot = 10.0 / 16.5;
    let sigmoid = |x: f64| {
        let (power, end) = if x < pivot {
            (3.0, pivot)
        } else {
            (3.25, 1.0 - pivot)
        };
        // The scale with which the curve meets 0 or 1 at the end of the range.
        let slope: f64 = 2.0;
        let reach = (slope * end / 0.5).powf(power) - 1.0;
        let scale = ((slope * end).powf(-power) * reach).powf(-1.0 / power);
        let term = slope * (x - pivot).abs() / scale;
        let height = scale * term / (1.0 + term.powf(power)).powf(1.0 / power);
        0.5 + height.copysign(x - pivot)
    };
    let log = |x: f64| (x.max(1e-10).log2() - stops[0]) / (stops[1] - stops[0]);
    let encoded = (inset * color)
        .to_array()
        .map(|x| sigmoid(log(x).clamp(0.0, 1.0)));
    let outset = inset.inverse() * DVec3::from(encoded);
    DVec3::from(outset.to_array().map(|x| x.max(0.0).powf(2.2)))
}

fn neutral(color: DVec3) -> DVec3 {
    let least = color.min_element();
    let color = color
        - if least < 0.08 {
            least - 6.25 * least * least
        } else {
            0.04
        };
    let (peak, start) = (color.max_element(), 0.76);
    if peak < start {
        return color;
    }
    let room = 1.0 - start;
    let shown = 1.0 - room * room / (peak + room - start);
    let white = 1.0 - 1.0 / (0.15 * (peak - shown) + 1.0);
    (color * shown / peak).lerp(DVec3::splat(shown), white)
}

fn encode(linear: f64) -> f64 {
    let linear = linear.clamp(0.0, 1.0);
    if linear <= 0.003_130_8 {
        return linear * 12.92 * 255.0;
    }
    (1.055 * linear.powf(1.0 / 2.4) - 0.055) * 255.0
}

#[test]
fn every_curve_equals_its_f64_twin_in_both_targets() {
    let Some(gpu) = device() else { return };
    let package = chart().package();
    for (tonemap, ev) in CURVES.into_iter().zip([0.0_f32, -1.0, 0.5, 1.0]) {
        let images =
            [COMPUTE, FRAGMENT].map(|format| shown(&gpu, &package, format, &with(tonemap, ev)));
        for (index, color) in COLORS.iter().enumerate() {
            let (x, y) = (index as u32 % SIDE, index as u32 / SIDE);
            let at = ((y * CELL + 1) * CELL * SIDE + x * CELL + 2) as usize;
            // The HDR image holds half floats: 0 to 65504, 11 bits.
            let stored = DVec3::from(color.map(|value| f64::from(value.clamp(0.0, 65504.0))));
            let exposed = (stored * f64::from(ev).exp2()).min(DVec3::splat(65504.0));
            let expected = curve(tonemap, exposed).to_array().map(encode);
            for image in &images {
                let [found @ .., alpha] = image[at];
                let near = (0..3).all(|i| (f64::from(found[i]) - expected[i]).abs() <= 1.01);
                assert!(
                    near,
                    "{tonemap:?} of {color:?}: {found:?}, not {expected:?}"
                );
                assert_eq!(alpha, 255);
            }
        }
        for (a, b) in images[0].iter().zip(&images[1]) {
            let close = (0..4).all(|i| a[i].abs_diff(b[i]) <= 1);
            assert!(close, "{tonemap:?}: compute {a:?}, fragment {b:?}");
        }
    }
}

/// Grey steps far finer than 8 bits keep their mean, and exact codes stay.
#[test]
fn dithering_keeps_the_mean_and_exact_codes() {
    let Some(gpu) = device() else { return };
    let full = |code: f32| {
        let linear = ((code / 255.0 + 0.055) / 1.055).powf(2.4);
        let card = quad(0, vec![Mat4::IDENTITY]);
        Fixture {
            objects: vec![colored(card, [1.0; 4])],
            materials: vec![unlit([linear, linear, linear, 1.0])],
            ..Fixture::default()
        }
        .package()
    };
    // The HDR image's 11 bits are up to a tenth of a code.
    for code in [100.25, 180.5, 37.75, 128.0] {
        for format in [COMPUTE, FRAGMENT] {
            let pixels = shown(&gpu, &full(code), format, &with(Tonemap::Linear, 0.0));
            let mean = pixels.iter().map(|pixel| f32::from(pixel[0])).sum::<f32>();
            let mean = mean / pixels.len() as f32;
            assert!((mean - code).abs() < 0.12, "{mean} for {code}");
        }
    }
    let white = shown(&gpu, &full(255.0), COMPUTE, &with(Tonemap::Linear, 0.0));
    assert!(white.iter().all(|pixel| *pixel == [255; 4]));
}
