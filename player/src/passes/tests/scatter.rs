//! The surface model as the GPU evaluates and samples it: against its f64 twin, for energy, reciprocity, and densities
//! against histograms. All lobes, with and without compensation.

use cairn_format::Package;
use cairn_format::brdf_table::{BRDF_TABLE_SIZE, brdf_table_point};
use cairn_format::gpu::{LOBE_SHEEN, Material, MaterialExtension};
use glam::{DVec3, DVec4};

use super::fixture::Fixture;
use super::twin::{Lobes, Shading};
use super::{device, plain, towards_origin};
use crate::frame::frame_uniform;
use crate::gpu::{Buffer, BufferDesc, ComputePipeline, Gpu, Memory, SetIndex, Shader, Sync, vk};
use crate::scene::GpuScene;

const GROUP: usize = 64;

/// Records of `scatter.comp`.
type Query = [[f32; 4]; 6];
type Answer = [[f32; 4]; 3];

/// A material in all its lobes.
#[derive(Clone, Copy, Debug)]
struct Surface {
    base: DVec3,
    metallic: f64,
    roughness: f64,
    f0: DVec3,
    f90: f64,
    sheen: DVec3,
    sheen_roughness: f64,
    coat: f64,
    coat_roughness: f64,
    /// Of the coat's normal, radians.
    coat_tilt: f64,
}

/// A white dielectric.
const PLAIN: Surface = Surface {
    base: DVec3::ONE,
    metallic: 0.0,
    roughness: 0.5,
    f0: DVec3::splat(0.04),
    f90: 1.0,
    sheen: DVec3::ZERO,
    sheen_roughness: 0.5,
    coat: 0.0,
    coat_roughness: 0.2,
    coat_tilt: 0.0,
};

impl Surface {
    fn query(&self, view: DVec3, light: DVec3, place: [f64; 2]) -> Query {
        let four = |v: DVec3, w: f64| v.extend(w).as_vec4().to_array();
        let place = DVec4::new(place[0], place[1], self.coat_roughness, self.coat_tilt);
        [
            four(view, self.roughness),
            four(light, self.metallic),
            four(self.base, self.f90),
            four(self.f0, self.sheen_roughness),
            four(self.sheen, self.coat),
            place.as_vec4().to_array(),
        ]
    }

    fn twin(&self, view: DVec3, light: DVec3) -> Shading {
        Shading {
            normal: DVec3::Z,
            view,
            light,
            base: self.base,
            metallic: self.metallic,
            roughness: self.roughness,
            lobes: Lobes {
                dielectric_f0: self.f0,
                specular: self.f90,
                sheen: self.sheen,
                sheen_roughness: self.sheen_roughness,
                coat: self.coat,
                coat_roughness: self.coat_roughness,
            },
        }
    }
}

/// The table's roughness nearest to this one: lookups there are exact.
fn rough(near: f64) -> f64 {
    let rows = (0..BRDF_TABLE_SIZE).map(|row| brdf_table_point(0, row, BRDF_TABLE_SIZE)[1]);
    nearest(rows, near)
}

/// At the table's cosine nearest to this one, in the XZ plane.
fn view_at(near: f64) -> DVec3 {
    let columns =
        (0..BRDF_TABLE_SIZE).map(|column| brdf_table_point(column, 0, BRDF_TABLE_SIZE)[0]);
    let cosine = nearest(columns, near).max(1e-4);
    DVec3::new((1.0 - cosine * cosine).sqrt(), 0.0, cosine)
}

fn nearest(values: impl Iterator<Item = f64>, near: f64) -> f64 {
    let off = |value: f64| (value - near).abs();
    let closer = |best: f64, value: f64| if off(value) < off(best) { value } else { best };
    values.fold(f64::INFINITY, closer)
}

/// Every lobe alone and together. Roughnesses are rows of the table.
fn surfaces() -> Vec<(&'static str, Surface)> {
    let tinted = DVec3::new(0.9, 0.5, 0.1);
    let metal = Surface {
        base: tinted,
        metallic: 1.0,
        roughness: rough(0.32),
        ..PLAIN
    };
    let sheen = Surface {
        base: tinted,
        roughness: 1.0,
        sheen: DVec3::new(0.7, 0.4, 0.2),
        sheen_roughness: rough(0.52),
        ..PLAIN
    };
    let coat = Surface {
        base: tinted,
        roughness: rough(0.77),
        coat: 0.8,
        coat_roughness: rough(0.26),
        ..PLAIN
    };
    vec![
        (
            "dielectric",
            Surface {
                base: tinted,
                roughness: rough(0.52),
                ..PLAIN
            },
        ),
        (
            "rough dielectric",
            Surface {
                base: tinted,
                roughness: 1.0,
                ..PLAIN
            },
        ),
        ("metal", metal),
        (
            "rough metal",
            Surface {
                roughness: 1.0,
                ..metal
            },
        ),
        (
            "half metal",
            Surface {
                metallic: 0.5,
                roughness: rough(0.65),
                ..metal
            },
        ),
        (
            "specular and ior",
            Surface {
                metallic: 0.0,
                f0: DVec3::new(0.12, 0.05, 0.02),
                f90: 0.6,
                roughness: rough(0.39),
                ..metal
            },
        ),
        ("sheen", sheen),
        ("coat", coat),
        (
            "sheen under a coat, half metal",
            Surface {
                metallic: 0.5,
                roughness: rough(0.65),
                sheen: sheen.sheen,
                sheen_roughness: rough(0.65),
                ..coat
            },
        ),
    ]
}

/// The pipeline with a package whose BRDF table it reads.
struct Bench<'a> {
    gpu: &'a Gpu,
    scene: GpuScene,
    uniform: Buffer,
    pipeline: ComputePipeline,
}

impl<'a> Bench<'a> {
    fn new(gpu: &'a Gpu, package: &Package, energy: bool) -> Self {
        let scene = GpuScene::upload(gpu, package).expect("uploads");
        let shader = Shader {
            spirv: cairn_shaders::SCATTER_COMP.spirv,
            // A table, compensation or none, clear coat, specular, sheen.
            constants: &[(3, 1), (5, u32::from(energy)), (8, 1), (9, 1), (10, 1)],
        };
        let pipeline =
            ComputePipeline::new(gpu, &scene.layouts, "scatter", &shader).expect("a pipeline");
        let camera = towards_origin(glam::Vec3::Z);
        let uniform = frame_uniform(&camera, [1, 1], &scene, &plain());
        let usage = vk::BufferUsageFlags::UNIFORM_BUFFER;
        let mut buffer =
            Buffer::upload(gpu, "uniform", size_of_val(&uniform), usage).expect("a buffer");
        buffer.write(0, &[uniform]).expect("written");
        Self {
            gpu,
            scene,
            uniform: buffer,
            pipeline,
        }
    }

    fn run(&self, queries: &[Query]) -> Vec<Answer> {
        let storage = vk::BufferUsageFlags::STORAGE_BUFFER;
        let buffer = |size: usize, memory| {
            let desc = BufferDesc {
                name: "scatter",
                size: size as u64,
                usage: storage,
                memory,
            };
            Buffer::new(self.gpu, &desc).expect("a buffer")
        };
        let mut input = buffer(size_of_val(queries), Memory::Upload);
        input.write(0, queries).expect("written");
        let output = buffer(queries.len() * size_of::<Answer>(), Memory::Readback);
        let layouts = &self.scene.layouts;
        let mut frame = layouts.allocate(SetIndex::Frame, "frame").expect("a set");
        self.scene
            .bind(&mut frame, &self.uniform, &input)
            .expect("bound");
        let mut pass = layouts.allocate(SetIndex::Pass, "scatter").expect("a set");
        pass.write_buffer(8, &input).expect("bound");
        pass.write_buffer(9, &output).expect("bound");
        self.gpu
            .once(|commands| {
                let compute = vk::PipelineBindPoint::COMPUTE;
                commands.bind_compute(&self.pipeline);
                commands.bind_sets(layouts, compute, &[&frame, &self.scene.bindless]);
                commands.bind_sets(layouts, compute, &[&pass]);
                commands.dispatch([queries.len().div_ceil(GROUP) as u32, 1, 1]);
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
            .expect("runs");
        let mut answers: Vec<Answer> = vec![[[0.0; 4]; 3]; queries.len()];
        output.read(0, &mut answers).expect("reads");
        for answer in &answers {
            assert!(answer.as_flattened().iter().all(|value| value.is_finite()));
        }
        answers
    }
}

fn table_package() -> Package {
    let fixture = Fixture {
        materials: vec![Material::default()],
        // Sheen makes the table hold its albedo.
        lobes: vec![MaterialExtension {
            sheen_color: [1.0; 3],
            lobes: LOBE_SHEEN,
            ..MaterialExtension::default()
        }],
        environment: Some([[1.0; 3]; 6]),
        lut: true,
        ..Fixture::default()
    };
    fixture.package()
}

fn rgb(row: [f32; 4]) -> DVec3 {
    DVec4::from_array(row.map(f64::from)).truncate()
}

/// Centres of even parts of the hemisphere of the given sides, each of the same solid angle.
fn hemisphere(rings: u32, spokes: u32) -> Vec<DVec3> {
    let part = |index: u32, of: u32| (f64::from(index) + 0.5) / f64::from(of);
    let direction = |index: u32| {
        let cosine = part(index / spokes, rings);
        let phi = part(index % spokes, spokes) * std::f64::consts::TAU;
        let sine = (1.0 - cosine * cosine).sqrt();
        DVec3::new(sine * phi.cos(), sine * phi.sin(), cosine)
    };
    (0..rings * spokes).map(direction).collect()
}

#[test]
fn every_lobe_equals_its_twin() {
    let Some(gpu) = device() else { return };
    let package = table_package();
    for energy in [false, true] {
        let bench = Bench::new(&gpu, &package, energy);
        for (name, surface) in surfaces() {
            let mut worst: f64 = 0.0;
            for cosine in [0.04, 0.27, 0.65, 1.0] {
                let view = view_at(cosine);
                let lights = hemisphere(4, 8);
                let queries: Vec<Query> = lights
                    .iter()
                    .map(|light| surface.query(view, *light, [0.5; 2]))
                    .collect();
                for (light, answer) in lights.iter().zip(bench.run(&queries)) {
                    let expected = surface.twin(view, *light).reflected(energy);
                    let found = rgb(answer[0]);
                    let scale = expected.max_element().max(1e-2);
                    worst = worst.max((found - expected).abs().max_element() / scale);
                }
            }
            println!("{name}, energy {energy}: off by {worst:.1e}");
            // Half floats of the table, and of sheen its interpolation towards the light.
            let tolerance = if surface.sheen == DVec3::ZERO {
                3e-3
            } else {
                2e-2
            };
            assert!(worst < tolerance, "{name}, energy {energy}: {worst}");
        }
    }
    assert_eq!(gpu.close(), Vec::<String>::new());
}

/// What light from `l` gives towards `v` it gives from `v` towards `l`. Coats weigh by the view alone, as their
/// extension says, and so does compensation: these are as asymmetric as their twins, no more.
#[test]
fn lobes_of_the_specification_are_reciprocal() {
    let Some(gpu) = device() else { return };
    let package = table_package();
    let bench = Bench::new(&gpu, &package, false);
    for (name, surface) in surfaces() {
        let directions = hemisphere(4, 6);
        let mut queries = Vec::new();
        let mut pairs = Vec::new();
        for (index, a) in directions.iter().enumerate() {
            for b in &directions[..index] {
                pairs.push((*a, *b));
                queries.push(surface.query(*a, *b, [0.5; 2]));
                queries.push(surface.query(*b, *a, [0.5; 2]));
            }
        }
        let answers = bench.run(&queries);
        let mut worst: f64 = 0.0;
        for ((a, b), both) in pairs.iter().zip(answers.as_chunks::<2>().0) {
            let there = rgb(both[0][0]) / b.z;
            let back = rgb(both[1][0]) / a.z;
            let asymmetry = if surface.coat > 0.0 {
                let twin = |view: &DVec3, light: &DVec3| {
                    surface.twin(*view, *light).reflected(false) / light.z
                };
                twin(a, b) - twin(b, a)
            } else {
                DVec3::ZERO
            };
            let off = (there - back - asymmetry).abs().max_element();
            worst = worst.max(off / there.max_element().max(1e-2));
        }
        println!("{name}: reciprocal within {worst:.1e}");
        let tolerance = if surface.coat > 0.0 { 2e-2 } else { 2e-4 };
        assert!(worst < tolerance, "{name}: {worst}");
    }
    assert_eq!(gpu.close(), Vec::<String>::new());
}

/// Means of f / pdf over a rank-1 lattice: what a surface reflects of white surroundings.
fn sampled_albedo(bench: &Bench<'_>, surface: &Surface, view: DVec3, count: u32) -> DVec3 {
    let place = |index: u32| {
        let along = (f64::from(index) + 0.5) / f64::from(count);
        [along, (f64::from(index) * 0.618_033_988_749_894_8).fract()]
    };
    let queries: Vec<Query> = (0..count)
        .map(|index| surface.query(view, DVec3::Z, place(index)))
        .collect();
    let sum: DVec3 = bench
        .run(&queries)
        .iter()
        .filter(|answer| answer[1][2] > 0.0 && answer[1][3] > 0.0)
        .map(|answer| rgb(answer[2]) / f64::from(answer[1][3]))
        .sum();
    sum / f64::from(count)
}

/// With compensation no surface reflects more than comes, and white ones all of it; and sampling finds what a sum over
/// all directions finds.
#[test]
fn energy_is_kept_and_sampling_finds_it() {
    let Some(gpu) = device() else { return };
    let package = table_package();
    let lights = hemisphere(64, 128);
    for energy in [false, true] {
        let bench = Bench::new(&gpu, &package, energy);
        for (name, surface) in surfaces() {
            for cosine in [0.1, 0.4, 0.93] {
                let view = view_at(cosine);
                let sampled = sampled_albedo(&bench, &surface, view, 1 << 14);
                // The specification's diffuse lobe loses by V.H, less than its reflection takes at grazing views.
                let most = if energy { 1.004 } else { 1.02 };
                assert!(
                    sampled.max_element() < most,
                    "{name}, energy {energy}: {sampled}"
                );
                // A sum over directions resolves wide lobes alone.
                if surface
                    .roughness
                    .min(if surface.coat > 0.0 { 0.0 } else { 1.0 })
                    < 0.4
                {
                    continue;
                }
                let queries: Vec<Query> = lights
                    .iter()
                    .map(|light| surface.query(view, *light, [0.5; 2]))
                    .collect();
                let sum: DVec3 = bench
                    .run(&queries)
                    .iter()
                    .map(|answer| rgb(answer[0]))
                    .sum();
                let summed = sum * std::f64::consts::TAU / lights.len() as f64;
                let off = (sampled - summed).abs().max_element();
                assert!(off < 0.01, "{name}, energy {energy}: {sampled} {summed}");
            }
        }
        if !energy {
            continue;
        }
        for (metallic, roughness, coat) in [
            (0.0, 0.0, 0.0),
            (0.0, 0.5, 0.0),
            (0.0, 1.0, 0.0),
            (1.0, 0.0, 0.0),
            (1.0, 0.5, 0.0),
            (1.0, 1.0, 0.0),
            (0.5, 0.65, 0.0),
            (0.0, 1.0, 1.0),
            (1.0, 0.65, 1.0),
        ] {
            let surface = Surface {
                metallic,
                roughness: rough(roughness),
                coat,
                coat_roughness: rough(0.26),
                ..PLAIN
            };
            for cosine in [0.07, 0.4, 1.0] {
                let albedo = sampled_albedo(&bench, &surface, view_at(cosine), 1 << 14);
                let off = (albedo - DVec3::ONE).abs().max_element();
                assert!(off < 0.004, "{surface:?} at {cosine}: {albedo}");
            }
        }
    }
    assert_eq!(gpu.close(), Vec::<String>::new());
}

/// Sampled directions fall into parts of the sphere as often as the density says (Pearson's chi-squared), and the density
/// integrates to the share of them above the horizon.
#[test]
fn densities_are_those_of_the_samples() {
    const RINGS: u32 = 8;
    const SPOKES: u32 = 12;
    const FINE: u32 = 24;
    const COUNT: u32 = 1 << 16;
    let Some(gpu) = device() else { return };
    let package = table_package();
    let bench = Bench::new(&gpu, &package, true);
    let mut state = 1u64;
    let mut random = || {
        // SplitMix64 (Steele et al. 2014), to 24 bits.
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 40) as f64 / 16_777_216.0
    };
    let fine = hemisphere(RINGS * FINE, SPOKES * FINE);
    let part = |ring: u32, spoke: u32| (ring * SPOKES + spoke) as usize;
    let tilted = Surface {
        coat_tilt: 0.3,
        ..surfaces()[7].1
    };
    let mut cases = surfaces();
    cases.push(("tilted coat", tilted));
    for (name, surface) in cases {
        let view = view_at(0.5);
        let queries: Vec<Query> = fine
            .iter()
            .map(|light| surface.query(view, *light, [0.5; 2]))
            .collect();
        let mut expected = vec![0.0; (RINGS * SPOKES) as usize];
        for (index, answer) in (0..).zip(bench.run(&queries)) {
            let (ring, spoke) = (
                index / (SPOKES * FINE) / FINE,
                index % (SPOKES * FINE) / FINE,
            );
            let angle = std::f64::consts::TAU / fine.len() as f64;
            expected[part(ring, spoke)] += f64::from(answer[0][3]) * angle * f64::from(COUNT);
        }
        let queries: Vec<Query> = (0..COUNT)
            .map(|_| surface.query(view, DVec3::Z, [random(), random()]))
            .collect();
        let mut found = vec![0.0; expected.len()];
        let mut above = 0.0;
        for answer in bench.run(&queries) {
            let l = rgb(answer[1]);
            if l.z > 0.0 {
                let ring = ((l.z * f64::from(RINGS)) as u32).min(RINGS - 1);
                let turn = l.y.atan2(l.x).rem_euclid(std::f64::consts::TAU) / std::f64::consts::TAU;
                let spoke = ((turn * f64::from(SPOKES)) as u32).min(SPOKES - 1);
                found[part(ring, spoke)] += 1.0;
                above += 1.0;
            }
        }
        let total: f64 = expected.iter().sum();
        let share = (total - above) / f64::from(COUNT);
        assert!(
            share.abs() < 0.006,
            "{name}: {total} expected above the horizon, {above} found"
        );
        let mut statistic = 0.0;
        let mut freedom = 0.0_f64;
        for (expected, found) in expected.iter().zip(&found) {
            if *expected >= 20.0 {
                statistic += (found - expected).powi(2) / expected;
                freedom += 1.0;
            }
        }
        let limit = freedom + 5.0 * f64::sqrt(2.0 * freedom);
        println!("{name}: chi-squared {statistic:.0} of {freedom} parts, below {limit:.0}");
        assert!(
            freedom > 20.0 && statistic < limit,
            "{name}: {statistic} of {freedom}"
        );
    }
    assert_eq!(gpu.close(), Vec::<String>::new());
}
