//! Spheres of hammered and scratched metal, lacquer and clear coats, whose normal maps show from near and are too fine
//! from afar.

use glam::Vec3;
use serde_json::{Value, json};

use crate::OutputFile;
use crate::gltf::{BufferPlace, Builder, Placement};
use crate::mesh::Mesh;
use crate::noise::{fbm, hash01, smoothstep};
use crate::texture::Image;

const SIZE: usize = 256;
const ROUGHNESS: [f64; 4] = [0.05, 0.15, 0.3, 0.5];

/// Dents a few texels wide; slopes of about 0.25.
fn hammered() -> Image {
    Image::normals_from_height(SIZE, |u, v| 0.0042 * fbm(u, v, 32, 2, 5))
}

/// Scratches across a flat surface; most of it has none.
fn scratched() -> Image {
    Image::normals_from_height(SIZE, |u, v| {
        let mut depth = 0.0;
        for line in 0..14 {
            let at = |step: i64| hash01(line, step, 9);
            // Along u they repeat once, so that the map tiles.
            let wave = 0.02 * libm::sin(std::f64::consts::TAU * (u + at(1)));
            let apart = (v - at(0) - wave + 1.5).fract() - 0.5;
            depth -= 0.002 * (1.0 - smoothstep(0.0, 0.006, apart.abs()));
        }
        depth
    })
}

/// Roughness in green, from a third to all of the factor; no metal in blue.
fn worn() -> Image {
    Image::from_fn(SIZE / 2, SIZE / 2, |u, v| {
        let value = 0.66 + 0.34 * fbm(u, v, 6, 3, 21);
        [1.0, value, 0.0]
    })
}

/// A material over a normal map.
fn surface(normal: usize, color: [f64; 3], metallic: f64, roughness: f64) -> Value {
    json!({"normalTexture": {"index": normal}, "pbrMetallicRoughness": {
        "baseColorFactor": [color[0], color[1], color[2], 1.0],
        "metallicFactor": metallic, "roughnessFactor": roughness}})
}

/// `bumps/bumps.gltf` with its buffer and textures.
pub fn generate() -> Vec<OutputFile> {
    let mut scene = Builder::default();
    let sphere = scene.geometry(&Mesh::sphere(0.45, 48, 24));
    let images = [
        ("hammered", hammered()),
        ("scratched", scratched()),
        ("worn", worn()),
    ];
    let [hammered, scratched, worn] = [0, 1, 2].map(|index: usize| {
        scene.texture(
            images[index].0,
            &format!("textures/{}.png", images[index].0),
        )
    });
    let gold = [0.9, 0.6, 0.25];
    for (column, roughness) in (0_u8..).zip(ROUGHNESS) {
        let mut lacquer = surface(hammered, [0.25, 0.03, 0.03], 1.0, roughness);
        lacquer["pbrMetallicRoughness"]["metallicRoughnessTexture"] = json!({"index": worn});
        let mut coated = surface(hammered, [0.03, 0.1, 0.3], 0.0, 0.6);
        coated["extensions"] = json!({"KHR_materials_clearcoat": {
            "clearcoatFactor": 1.0, "clearcoatRoughnessFactor": roughness,
            "clearcoatNormalTexture": {"index": hammered}}});
        let rows = [
            ("hammered", surface(hammered, gold, 1.0, roughness)),
            ("scratched", surface(scratched, gold, 1.0, roughness)),
            ("lacquer", lacquer),
            ("coated", coated),
        ];
        for (row, (name, fields)) in (0_u8..).zip(rows) {
            let name = format!("{name} {roughness}");
            let material = scene.material(&name, fields);
            let (x, y) = (
                1.1 * (f32::from(column) - 1.5),
                1.1 * (1.5 - f32::from(row)),
            );
            scene.place(&name, sphere, material, Placement::at(x, y, 0.0));
        }
    }
    let looking = |eye: Vec3| Placement::looking(eye, Vec3::ZERO);
    scene.perspective("near", 40.0, looking(Vec3::new(0.0, 0.0, 6.2)));
    scene.perspective("far", 40.0, looking(Vec3::new(0.0, 0.0, 25.0)));
    let (text, buffer) = scene.finish("bumps", BufferPlace::File("bumps.bin"));
    let mut files = vec![
        OutputFile::new("bumps/bumps.gltf", text),
        OutputFile::new("bumps/bumps.bin", buffer),
    ];
    for (name, image) in images {
        let path = format!("bumps/textures/{name}.png");
        files.push(OutputFile::new(path, image.encode_png()));
    }
    files
}
