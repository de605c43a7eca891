//! Times what the CPU does for a frame of 65,536 instances: culling, grouping, writing and recording.
//!
//! Prints one Markdown table. GPU work is waited for outside the measured part, so that a software device does not
//! compete for the cores. The package is a mapped file, as it is in use.

use std::time::Instant;

use bytemuck::Zeroable;
use cairn_format::bounds::{clusters, to_arrays};
use cairn_format::gpu::{ALPHA_OPAQUE, DirectionalLight, DrawGroup, Instance, Material};
use cairn_format::scene::{Bounds, MaterialInfo, Mesh, Primitive, Scene};
use cairn_format::{Aabb, Frustum, Package, SectionKind, Vertex, Writer};
use cairn_player::camera::Camera;
use cairn_player::draw::DrawList;
use cairn_player::gpu::{Gpu, GpuOptions};
use cairn_player::headless::Session;
use cairn_player::plan::Plan;
use cairn_player::scene::GpuScene;
use cairn_player::settings::Settings;
use glam::{Mat4, Vec3};

/// Instances along a side of the floor that they stand on, one a metre.
const SIDE: u32 = 256;
const INSTANCES: u32 = SIDE * SIDE;
/// Pixels of a side.
const SIZE: u32 = 16;
const FRAMES: u32 = 21;
const WARM_UP: u32 = 4;
const RUNS: u32 = 101;
/// Milliseconds that culling, grouping and recording may take.
const TARGET: f64 = 2.0;

fn main() {
    let gpu = Gpu::new(&GpuOptions::default()).expect("a device");
    let folder = tempfile::tempdir().expect("a folder");
    println!(
        "{}, median (least) ms; target {TARGET} ms\n",
        gpu.device_name()
    );
    println!(
        "| meshes x instances | visible | draws | `DrawList::build` | `Plan::new` | no shadows | 4 cascades held | 4 cascades redrawn |"
    );
    println!("|---|--:|--:|--:|--:|--:|--:|--:|");
    for meshes in [1, 256, 4096] {
        let path = folder.path().join(format!("{meshes}.cairn"));
        std::fs::write(&path, package(meshes)).expect("a file");
        let package = Package::open(&path).expect("opens");
        for back in [200.0, 0.0] {
            row(&gpu, &package, meshes, back);
        }
    }
}

/// Looks along the floor from `back` metres behind its middle.
fn camera(back: f32, turn: f32) -> Camera {
    let eye = Vec3::new(0.0, 40.0, back);
    let toward = Vec3::new(turn.sin(), -0.3, -turn.cos());
    Camera::look_at(eye, eye + toward, Vec3::Y, 1.2).expect("a direction")
}

fn row(gpu: &Gpu, package: &Package, meshes: u32, back: f32) {
    let mut list = DrawList::default();
    let build = measure(RUNS, || build(package, &camera(back, 0.0), &mut list));
    let stats = list.stats();
    let scene = GpuScene::upload(gpu, package).expect("uploads");
    let plan = measure(RUNS, || {
        Plan::new(gpu, &scene, package, &Settings::default()).expect("a plan");
    });
    drop(scene);
    let [off, held, redrawn] = [(false, 0.0), (true, 0.0), (true, 0.01)]
        .map(|(shadows, turn)| frames(gpu, package, back, shadows, turn));
    println!(
        "| {meshes} x {} | {:.0} % | {} | {build} | {plan} | {off} | {held} | {redrawn} |",
        INSTANCES / meshes,
        100.0 * f64::from(stats.visible_instances) / f64::from(INSTANCES),
        stats.draws,
    );
}

fn build(package: &Package, camera: &Camera, list: &mut DrawList) {
    let groups = package.draw_groups().expect("groups");
    let bounds = package.instance_bounds().expect("bounds");
    let clusters = package.cluster_bounds().expect("clusters");
    let frustum = Frustum::from_view_projection(&(camera.projection(1.0) * camera.view()));
    list.build(
        groups,
        &bounds,
        clusters.as_ref(),
        &frustum,
        camera.position,
    );
}

/// CPU times of recording; the camera turns by `turn` radians a frame, which moves every cascade.
fn frames(gpu: &Gpu, package: &Package, back: f32, shadows: bool, turn: f32) -> Times {
    let mut settings = Settings::default();
    settings.shadow.enabled = shadows;
    settings.shadow.cascades = 4;
    let mut session = Session::new(gpu, package, [SIZE; 2], &settings, false).expect("a session");
    let mut times = Times::default();
    for frame in 0..WARM_UP + FRAMES {
        let camera = camera(back, turn * frame as f32);
        let seconds = session.frame(&camera, &settings, false).expect("a frame");
        session.finish().expect("it finishes");
        if frame >= WARM_UP {
            times.0.push(seconds * 1e3);
        }
    }
    times
}

/// Milliseconds of each run.
#[derive(Default)]
struct Times(Vec<f64>);

impl std::fmt::Display for Times {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let mut sorted = self.0.clone();
        sorted.sort_by(f64::total_cmp);
        write!(
            formatter,
            "{:.3} ({:.3})",
            sorted[sorted.len() / 2],
            sorted[0]
        )
    }
}

fn measure(runs: u32, mut call: impl FnMut()) -> Times {
    call();
    let time = |_| {
        let start = Instant::now();
        call();
        start.elapsed().as_secs_f64() * 1e3
    };
    Times((0..runs).map(time).collect())
}

/// Position on the Z-order curve (Morton 1966): column and row of the floor.
fn place(code: u32) -> [u32; 2] {
    let gather = |code: u32| (0..8).fold(0, |cell, bit| cell | (code >> (2 * bit) & 1) << bit);
    [gather(code), gather(code >> 1)]
}

/// Triangles on a floor, `meshes` kinds of them, each all over the floor and sorted in space.
fn package(meshes: u32) -> Vec<u8> {
    let mut scene = Scene::empty("floor");
    scene.materials.push(MaterialInfo {
        name: String::new(),
    });
    let (mut vertices, mut indices) = (Vec::new(), Vec::<u32>::new());
    let (mut instances, mut bounds, mut groups) = (Vec::new(), Vec::new(), Vec::new());
    let each = INSTANCES / meshes;
    for mesh in 0..meshes {
        let primitive = Primitive {
            first_index: indices.len() as u32,
            index_count: 3,
            traced_index_count: 3,
            opaque: true,
            first_vertex: vertices.len() as u32,
            vertex_count: 3,
            material: 0,
            bounds: Bounds::ZERO,
        };
        groups.push(DrawGroup {
            first_index: primitive.first_index,
            index_count: 3,
            vertex_offset: primitive.first_vertex,
            first_instance: instances.len() as u32,
            instance_count: each,
            primitive: mesh,
            alpha_mode: ALPHA_OPAQUE,
            flags: 0,
        });
        vertices.extend([[0.0, 0.0], [0.5, 0.0], [0.0, 0.5]].map(corner));
        indices.extend([0, 1, 2]);
        scene.meshes.push(Mesh {
            name: String::new(),
            first_primitive: mesh,
            primitive_count: 1,
        });
        scene.primitives.push(primitive);
        for index in 0..each {
            let [x, z] = place(index * meshes + mesh).map(|cell| cell as f32 - 0.5 * SIDE as f32);
            let low = Vec3::new(x, 0.0, z);
            instances.push(Instance {
                model: Mat4::from_translation(low).to_cols_array_2d(),
                normal_matrix: [
                    [1.0, 0.0, 0.0, 0.0],
                    [0.0, 1.0, 0.0, 0.0],
                    [0.0, 0.0, 1.0, 0.0],
                ],
                ..Instance::zeroed()
            });
            bounds.push(Aabb {
                min: low,
                max: low + Vec3::new(0.5, 0.5, 0.0),
            });
        }
    }
    let all = bounds.iter().copied().fold(Aabb::EMPTY, Aabb::union);
    scene.bounds = Bounds {
        min: all.min.to_array(),
        max: all.max.to_array(),
    };
    let light = DirectionalLight {
        direction_and_intensity: Vec3::new(0.4, -1.0, -0.2)
            .normalize()
            .extend(3.0)
            .to_array(),
        color_and_shadow: [1.0; 4],
    };
    let (arrays, around) = (to_arrays(&bounds), to_arrays(&clusters(&bounds)));
    let (materials, lights) = ([Material::default()], [light]);
    let mut writer = Writer::new();
    writer.records(SectionKind::Vertices, &vertices);
    writer.bytes(SectionKind::Indices, bytemuck::cast_slice(&indices));
    writer.records(SectionKind::Instances, &instances);
    writer.bytes(SectionKind::InstanceBounds, bytemuck::cast_slice(&arrays));
    writer.bytes(SectionKind::ClusterBounds, bytemuck::cast_slice(&around));
    writer.records(SectionKind::DrawGroups, &groups);
    writer.records(SectionKind::Materials, &materials);
    writer.records(SectionKind::DirectionalLights, &lights);
    writer.to_vec(&scene, "bench").expect("it is written")
}

fn corner([x, y]: [f32; 2]) -> Vertex {
    Vertex {
        position: [x, y, 0.0],
        normal: [0.0, 0.0, 1.0],
        tangent: [1.0, 0.0, 0.0, 1.0],
        ..Vertex::zeroed()
    }
}
