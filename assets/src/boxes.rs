//! The smallest scene: one untextured box whose buffer is a data URI.

use glam::{DVec3, Vec3};
use serde_json::json;

use crate::OutputFile;
use crate::gltf::{BufferPlace, Builder, Placement};
use crate::mesh::Mesh;

/// `box/box.gltf`.
pub fn generate() -> Vec<OutputFile> {
    let mut scene = Builder::default();
    let mut mesh = Mesh::default();
    mesh.cuboid(DVec3::splat(-0.5), DVec3::splat(0.5), 1.0);
    let geometry = scene.geometry(&mesh);
    let clay = scene.material(
        "clay",
        json!({"pbrMetallicRoughness":
            {"baseColorFactor": [0.7, 0.32, 0.2, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.6}}),
    );
    scene.place("box", geometry, clay, Placement::at(0.0, 0.0, 0.0));
    let eye = Vec3::new(1.6, 1.3, 2.4);
    scene.perspective("main", 40.0, Placement::looking(eye, Vec3::ZERO));
    let (text, _) = scene.finish("box", BufferPlace::Embedded);
    vec![OutputFile::new("box/box.gltf", text)]
}
