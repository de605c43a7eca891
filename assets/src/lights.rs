//! A scene lit by one directional light of its own, without textures.

use glam::{DVec3, Vec3};
use serde_json::{Value, json};

use crate::OutputFile;
use crate::gltf::{BufferPlace, Builder, Placement};
use crate::mesh::Mesh;

fn matte(color: [f64; 3], roughness: f64, metallic: f64) -> Value {
    json!({"pbrMetallicRoughness": {
        "baseColorFactor": [color[0], color[1], color[2], 1.0],
        "metallicFactor": metallic, "roughnessFactor": roughness}})
}

/// `lights/lights.gltf` with its buffer.
pub fn generate() -> Vec<OutputFile> {
    let mut scene = Builder::default();
    let mut plane = Mesh::default();
    plane.cuboid(DVec3::new(-5.0, -0.1, -5.0), DVec3::new(5.0, 0.0, 5.0), 1.0);
    let mut cube = Mesh::default();
    cube.cuboid(DVec3::new(-0.5, 0.0, -0.5), DVec3::new(0.5, 1.0, 0.5), 1.0);
    let plane = scene.geometry(&plane);
    let cube = scene.geometry(&cube);
    let sphere = scene.geometry(&Mesh::sphere(0.5, 40, 20));

    let grey = scene.material("grey", matte([0.5, 0.5, 0.5], 0.9, 0.0));
    let red = scene.material("red", matte([0.6, 0.08, 0.05], 0.5, 0.0));
    let blue = scene.material("blue", matte([0.05, 0.12, 0.5], 0.35, 0.0));
    let white = scene.material("white", matte([0.8, 0.8, 0.8], 0.2, 0.0));
    let steel = scene.material("steel", matte([0.56, 0.57, 0.58], 0.3, 1.0));

    scene.place("ground", plane, grey, Placement::at(0.0, 0.0, 0.0));
    let tower = Placement::at(-1.6, 0.0, -0.8).yaw(20.0);
    scene.place("tower", cube, red, tower.scaled(0.8, 2.2, 0.8));
    let block = Placement::at(1.7, 0.0, -1.4).yaw(-35.0);
    scene.place("block", cube, blue, block.scaled(1.4, 0.8, 0.9));
    scene.place("white ball", sphere, white, Placement::at(0.1, 0.5, 0.4));
    scene.place("steel ball", sphere, steel, Placement::at(1.3, 0.5, 0.9));
    let small = Placement::at(-0.9, 0.25, 1.3);
    scene.place("small ball", sphere, blue, small.scaled(0.5, 0.5, 0.5));

    let from = Vec3::new(-3.0, 4.5, 2.5);
    let light = Placement::looking(from, Vec3::ZERO);
    scene.directional_light("sun", 3.0, [1.0, 0.96, 0.9], light);
    let eye = Vec3::new(0.6, 2.4, 5.2);
    let target = Vec3::new(0.0, 0.55, 0.0);
    scene.perspective("main", 42.0, Placement::looking(eye, target));

    let (text, buffer) = scene.finish("lights", BufferPlace::File("lights.bin"));
    vec![
        OutputFile::new("lights/lights.gltf", text),
        OutputFile::new("lights/lights.bin", buffer),
    ]
}
