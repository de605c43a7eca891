//! The surface model in f32 on the GPU against its f64 twin, where rounding hurts: roughness 0 and 1, grazing view and
//! light down to cosines of 1e-6, mirror directions, light along the axes.

use glam::{DVec3, DVec4};

use super::device;
use super::twin::{
    Lobes, Shading, multi_bounce, sheen, specular_occlusion_cones, specular_occlusion_lagarde,
};
use crate::gpu::{
    Buffer, BufferDesc, ComputePipeline, Gpu, Layouts, Memory, SetIndex, Shader, Sync, vk,
};

const GROUP: usize = 64;

/// Records of `brdf.comp`.
type Case = [[f32; 4]; 6];
type Answer = [[f32; 4]; 2];

fn four(v: DVec3, w: f64) -> [f32; 4] {
    v.extend(w).as_vec4().to_array()
}

fn record(shading: &Shading) -> Case {
    let lobes = &shading.lobes;
    [
        four(shading.normal, 0.0),
        four(shading.view, 0.0),
        four(shading.light, shading.roughness),
        four(shading.base, shading.metallic),
        four(lobes.sheen, lobes.sheen_roughness),
        // Any share that differs from case to case.
        [
            lobes.coat as f32,
            lobes.coat_roughness as f32,
            (shading.light.x * 0.5 + 0.5) as f32,
            0.0,
        ],
    ]
}

/// The twin's inputs as the GPU gets them: the rounded directions, so that what is compared is arithmetic alone.
fn rounded(case: &Case) -> Shading {
    let vector = |row: usize| DVec4::from_array(case[row].map(f64::from));
    let [normal, view, light, base, sheen, coat] = std::array::from_fn(vector);
    Shading {
        normal: normal.truncate().normalize(),
        view: view.truncate().normalize(),
        light: light.truncate().normalize(),
        base: base.truncate(),
        metallic: base.w,
        roughness: light.w,
        lobes: Lobes {
            sheen: sheen.truncate(),
            sheen_roughness: sheen.w,
            coat: coat.x,
            coat_roughness: coat.y,
            ..Lobes::default()
        },
    }
}

fn evaluate(gpu: &Gpu, cases: &[Case]) -> Vec<Answer> {
    let layouts = Layouts::new(gpu, 1, 1).expect("layouts");
    let shader = Shader {
        spirv: cairn_shaders::BRDF_COMP.spirv,
        // Without a table, the specification's lobes, with a coat.
        constants: &[(3, 0), (5, 0), (8, 1), (10, 1)],
    };
    let pipeline = ComputePipeline::new(gpu, &layouts, "brdf", &shader).expect("pipeline");
    let buffer = |usage, size: usize, memory| {
        let desc = BufferDesc {
            name: "brdf",
            size: size as u64,
            usage,
            memory,
        };
        Buffer::new(gpu, &desc).expect("buffer")
    };
    let storage = vk::BufferUsageFlags::STORAGE_BUFFER;
    let mut input = buffer(storage, size_of_val(cases), Memory::Upload);
    input.write(0, cases).expect("write");
    let results = buffer(storage, cases.len() * size_of::<Answer>(), Memory::Readback);
    let uniform = buffer(vk::BufferUsageFlags::UNIFORM_BUFFER, 928, Memory::Upload);
    let mut frame = layouts.allocate(SetIndex::Frame, "frame").expect("set");
    frame.write_buffer(0, &uniform).expect("write");
    for binding in 1..=3 {
        frame.write_buffer(binding, &results).expect("write");
    }
    let bindless = layouts.allocate(SetIndex::Bindless, "none").expect("set");
    let mut pass = layouts.allocate(SetIndex::Pass, "brdf").expect("set");
    pass.write_buffer(8, &input).expect("write");
    pass.write_buffer(9, &results).expect("write");
    gpu.once(|commands| {
        commands.bind_compute(&pipeline);
        let sets = [&frame, &bindless];
        commands.bind_sets(&layouts, vk::PipelineBindPoint::COMPUTE, &sets);
        commands.bind_sets(&layouts, vk::PipelineBindPoint::COMPUTE, &[&pass]);
        commands.dispatch([cases.len().div_ceil(GROUP) as u32, 1, 1]);
        let written = Sync {
            stage: vk::PipelineStageFlags2::COMPUTE_SHADER,
            access: vk::AccessFlags2::SHADER_STORAGE_WRITE,
        };
        let read = Sync {
            stage: vk::PipelineStageFlags2::HOST,
            access: vk::AccessFlags2::HOST_READ,
        };
        commands.memory_barrier(written, read);
        Ok(())
    })
    .expect("run");
    let mut out = vec![[[0.0; 4]; 2]; cases.len()];
    results.read(0, &mut out).expect("read");
    out
}

/// Unit vectors at these cosines to Z, and on the way to the mirror direction of one another.
fn cases() -> Vec<Case> {
    const COSINES: [f64; 9] = [1e-6, 1e-5, 1e-4, 1e-3, 0.05, 0.3, 0.7, 0.999, 1.0];
    const AZIMUTHS: [f64; 5] = [0.0, 1e-4, 1.0, 3.1, std::f64::consts::PI];
    const SURFACES: [(f64, f64); 6] = [
        (0.0, 0.0),
        (0.0, 1.0),
        (1.0, 0.0),
        (1.0, 1.0),
        (0.5, 0.5),
        (0.3, 0.045),
    ];
    let at = |cosine: f64, azimuth: f64| {
        let sine = (1.0 - cosine * cosine).sqrt();
        DVec3::new(sine * azimuth.cos(), sine * azimuth.sin(), cosine)
    };
    let mut cases = Vec::new();
    for (metallic, roughness) in SURFACES {
        for (v, l) in COSINES.iter().flat_map(|v| COSINES.map(|l| (*v, l))) {
            for azimuth in AZIMUTHS {
                cases.push(record(&Shading {
                    normal: DVec3::Z,
                    view: at(v, 0.0),
                    light: at(l, azimuth),
                    base: DVec3::new(0.9, 0.5, 0.1),
                    metallic,
                    roughness,
                    lobes: Lobes {
                        sheen: DVec3::new(0.6, 0.3, 0.0),
                        sheen_roughness: 1.0 - roughness,
                        coat: 1.0 - metallic,
                        coat_roughness: roughness * 0.5,
                        ..Lobes::default()
                    },
                }));
            }
        }
    }
    // Light along the axes, on normals beside them.
    for axis in [DVec3::Y, DVec3::NEG_Y, DVec3::X, DVec3::NEG_X] {
        for tilt in [0.0, 1e-6, 1e-3, 0.4, 1.5] {
            for roughness in [0.0, 1.0] {
                let normal = (axis + DVec3::Z * tilt).normalize();
                cases.push(record(&Shading {
                    normal,
                    view: normal,
                    light: axis,
                    base: DVec3::splat(0.8),
                    metallic: 1.0,
                    roughness,
                    lobes: Lobes::default(),
                }));
            }
        }
    }
    cases
}

/// What occlusion does to light from the surroundings.
fn check_occlusion(case: &Case, shading: &Shading, found: [f32; 4]) {
    let visibility = f64::from(case[5][2]);
    let n_dot_v = shading.normal.dot(shading.view).clamp(1e-4, 1.0);
    let reflected = 2.0 * shading.normal.dot(shading.view) * shading.normal - shading.view;
    let between = shading.light.dot(reflected).clamp(-1.0, 1.0).acos();
    let expected = [
        multi_bounce(visibility, shading.base.x),
        specular_occlusion_lagarde(n_dot_v, visibility, shading.roughness),
        specular_occlusion_cones(between, visibility, shading.roughness),
    ];
    // Arc cosines near 1 have an error of the root of the rounding, and the narrowest lobe is 0.01 wide.
    for ((found, expected), tolerance) in found.into_iter().zip(expected).zip([1e-5, 1e-4, 0.08]) {
        let error = (f64::from(found) - expected).abs();
        assert!(
            error < tolerance,
            "{found} {expected} of {shading:?} with {visibility}"
        );
    }
}

#[test]
fn f32_equals_f64_at_the_corners() {
    let Some(gpu) = device() else { return };
    let cases = cases();
    let found = evaluate(&gpu, &cases);
    let mut worst = [0.0_f64; 2];
    for (case, answer) in cases.iter().zip(&found) {
        let finite = answer.as_flattened().iter().all(|value| value.is_finite());
        assert!(finite, "{case:?}");
        let shading = rounded(case);
        check_occlusion(case, &shading, answer[1]);
        let found = answer[0];
        let expected = shading.without_sheen();
        let n_dot_l = shading.normal.dot(shading.light);
        // Rounding also shifts small cosines: an absolute part, of the energy that such light carries.
        let scale = expected.abs().max_element().max(n_dot_l * 0.3) + 1e-6;
        let difference = DVec3::new(
            f64::from(found[0]) - expected.x,
            f64::from(found[1]) - expected.y,
            f64::from(found[2]) - expected.z,
        );
        let error = difference.abs().max_element() / scale;
        // The half vector turns by the input's rounding over |v + l|, and the lobe changes by that over alpha.
        let alpha = shading.roughness.max(0.045).powi(2);
        let turn = 1.2e-7 / (shading.view + shading.light).length();
        let tolerance = 2e-4 + turn / alpha;
        assert!(
            error < tolerance,
            "{error}: {found:?} {expected} of {shading:?}"
        );
        let white = sheen(
            shading.normal,
            shading.view,
            shading.light,
            shading.lobes.sheen_roughness,
        );
        // Half vectors of grazing pairs turn by 1e-4 with the rounding of their input.
        let sheen_error = (f64::from(found[3]) - white).abs() / white.max(0.05);
        assert!(sheen_error < 5e-3, "{found:?} {white} of {shading:?}");
        worst = [worst[0].max(error / tolerance), worst[1].max(sheen_error)];
    }
    println!("{} cases, worst errors {worst:?}", cases.len());
    assert_eq!(gpu.close(), Vec::<String>::new());
}
