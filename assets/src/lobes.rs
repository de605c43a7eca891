//! Spheres with a clear coat, a dielectric reflection of their own, or sheen, on ground that a point light and two spot
//! lights shine on.

use glam::{DVec3, Vec3};
use serde_json::{Value, json};

use crate::OutputFile;
use crate::gltf::{BufferPlace, Builder, Cone, Placement};
use crate::mesh::Mesh;

/// The name of a row's materials, and the material of a step of 0..=1.
type Row = (&'static str, fn(f64) -> Value);

const STEPS: [f64; 4] = [0.0, 0.3, 0.6, 1.0];

fn surface(color: [f64; 3], roughness: f64, extensions: Value) -> Value {
    json!({"pbrMetallicRoughness": {
        "baseColorFactor": [color[0], color[1], color[2], 1.0],
        "metallicFactor": 0.0, "roughnessFactor": roughness}, "extensions": extensions})
}

/// Rough paint under coats of rising roughness.
fn coated(step: f64) -> Value {
    let coat = json!({"clearcoatFactor": 1.0, "clearcoatRoughnessFactor": step * 0.5});
    surface(
        [0.55, 0.03, 0.03],
        0.8,
        json!({"KHR_materials_clearcoat": coat}),
    )
}

/// Indices of refraction from air's on.
fn refracting(step: f64) -> Value {
    let ior = json!({"ior": 1.0 + step * 1.5});
    surface([0.03, 0.1, 0.35], 0.15, json!({"KHR_materials_ior": ior}))
}

/// Reflections of rising strength and tint.
fn tinted(step: f64) -> Value {
    let specular = json!({"specularFactor": step,
        "specularColorFactor": [1.0, 1.0 - step * 0.5, 1.0 - step]});
    let extensions = json!({"KHR_materials_specular": specular, "KHR_materials_ior": {"ior": 2.0}});
    surface([0.2, 0.2, 0.2], 0.25, extensions)
}

/// Cloth with sheen of rising roughness.
fn cloth(step: f64) -> Value {
    let sheen =
        json!({"sheenColorFactor": [0.9, 0.8, 0.6], "sheenRoughnessFactor": 0.2 + step * 0.8});
    surface(
        [0.05, 0.12, 0.08],
        1.0,
        json!({"KHR_materials_sheen": sheen}),
    )
}

/// `lobes/lobes.gltf` with its buffer.
pub fn generate() -> Vec<OutputFile> {
    let mut scene = Builder::default();
    let sphere = scene.geometry(&Mesh::sphere(0.45, 48, 24));
    let rows: [Row; 4] = [
        ("coat", coated),
        ("ior", refracting),
        ("specular", tinted),
        ("sheen", cloth),
    ];
    for (row, (name, fields)) in (0_u8..).zip(rows) {
        for (column, step) in (0_u8..).zip(STEPS) {
            let name = format!("{name} {step}");
            let material = scene.material(&name, fields(step));
            let (x, z) = (
                1.1 * (f32::from(column) - 1.5),
                1.1 * (f32::from(row) - 1.5),
            );
            scene.place(&name, sphere, material, Placement::at(x, 0.45, z));
        }
    }
    let mut plane = Mesh::default();
    plane.cuboid(DVec3::new(-4.0, -0.1, -4.0), DVec3::new(4.0, 0.0, 4.0), 1.0);
    let plane = scene.geometry(&plane);
    let grey = scene.material("ground", surface([0.4, 0.4, 0.4], 0.9, json!({})));
    scene.place("ground", plane, grey, Placement::at(0.0, 0.0, 0.0));
    lights(&mut scene);
    let eye = Vec3::new(0.8, 4.0, 5.0);
    let target = Vec3::new(0.0, 0.1, 0.1);
    scene.perspective("main", 40.0, Placement::looking(eye, target));
    let (text, buffer) = scene.finish("lobes", BufferPlace::File("lobes.bin"));
    vec![
        OutputFile::new("lobes/lobes.gltf", text),
        OutputFile::new("lobes/lobes.bin", buffer),
    ]
}

fn lights(scene: &mut Builder) {
    let lamp = Placement::at(-1.5, 2.0, 1.5);
    scene.punctual_light("lamp", 6.0, [1.0, 0.85, 0.6], 9.0, None, lamp);
    let cone = Cone {
        inner: 0.1,
        outer: 0.35,
    };
    for (name, color, from) in [
        ("blue spot", [0.4, 0.6, 1.0], Vec3::new(3.0, 3.0, -1.0)),
        ("green spot", [0.5, 1.0, 0.5], Vec3::new(-2.5, 3.0, -2.5)),
    ] {
        let at = Placement::looking(from, Vec3::new(from.x * 0.3, 0.0, from.z * 0.3));
        scene.punctual_light(name, 25.0, color, 0.0, Some(cone), at);
    }
}
