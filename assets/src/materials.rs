//! A grid of spheres with quads, one for each material feature that a renderer must get right.

use glam::{Vec2, Vec3};
use serde_json::{Value, json};

use crate::OutputFile;
use crate::gltf::{BufferPlace, Builder, Geometry, Placement};
use crate::hall::textures;
use crate::mesh::Mesh;
use crate::noise::smoothstep;
use crate::texture::Image;

fn surface(color: [f64; 4], metallic: f64, roughness: f64) -> Value {
    json!({"pbrMetallicRoughness": {
        "baseColorFactor": color, "metallicFactor": metallic, "roughnessFactor": roughness}})
}

const WHITE: [f64; 4] = [0.9, 0.9, 0.9, 1.0];

/// Rounded studs about a ramp that rises up the image and to the right.
fn stud_height(u: f64, v: f64) -> f64 {
    let (x, y) = (u * 4.0, v * 4.0);
    let r = libm::hypot(x - libm::floor(x) - 0.5, y - libm::floor(y) - 0.5);
    let stud = 0.02 * (1.0 - smoothstep(0.12, 0.36, r));
    let inside = (0.25..0.75).contains(&u) && (0.25..0.75).contains(&v);
    let slope = 0.03 * smoothstep(0.0, 0.5, (u - 0.25) - (v - 0.75) - 0.5);
    if inside { slope } else { stud }
}

/// Squares of different colours, so that a wrong texture coordinate set shows.
fn checker() -> Image {
    Image::from_fn(128, 128, |u, v| {
        let (i, j) = ((u * 4.0) as u32, (v * 4.0) as u32);
        let odd = (i + j) % 2 == 1;
        let ramp = f64::from(i + 4 * j) / 15.0;
        if odd {
            [0.9, 0.88, 0.84]
        } else {
            [0.85 - 0.7 * ramp, 0.25, 0.15 + 0.7 * ramp]
        }
    })
}

/// `materials/materials.gltf`, its buffer and its textures.
pub fn generate() -> Vec<OutputFile> {
    let mut scene = Builder::default();
    let [leaf, studs, squares] =
        ["leaf", "studs_normal", "checker"].map(|n| scene.texture(n, &format!("textures/{n}.png")));
    spheres(&mut scene);
    let quad = scene.geometry(&Mesh::quad(0.9, 0.9, 1.0));
    let cutout = scene.material("masked", masked(leaf, false));
    scene.place("masked", quad, cutout, spot(0.0));
    let double = scene.material("double-sided leaf", masked(leaf, true));
    scene.place("leaf from behind", quad, double, spot(1.0).yaw(180.0));
    mirrored_pair(&mut scene, quad, studs);
    blend_stack(&mut scene, quad);
    let emissive = scene.material("emissive", emissive());
    scene.place("emissive", quad, emissive, low_spot(0.0));
    let unlit = scene.material("unlit", unlit());
    scene.place("unlit", quad, unlit, low_spot(1.0));
    second_uv(&mut scene, squares);
    cameras(&mut scene);
    let (text, buffer) = scene.finish("materials", BufferPlace::File("materials.bin"));
    let mut files = vec![
        OutputFile::new("materials/materials.gltf", text),
        OutputFile::new("materials/materials.bin", buffer),
    ];
    let images = [
        ("leaf", textures::leaf(128)),
        ("studs_normal", Image::normals_from_height(128, stud_height)),
        ("checker", checker()),
    ];
    for (name, image) in images {
        let path = format!("materials/textures/{name}.png");
        files.push(OutputFile::new(path, image.encode_png()));
    }
    files
}

/// The place of a quad in the third row.
fn spot(column: f32) -> Placement {
    Placement::at(1.1 * (column - 2.0), -0.55, 0.0)
}

/// The place of a quad in the fourth row.
fn low_spot(column: f32) -> Placement {
    Placement::at(1.1 * (column - 2.0), -1.65, 0.0)
}

fn spheres(scene: &mut Builder) {
    let sphere = scene.geometry(&Mesh::sphere(0.45, 48, 24));
    for (row, metallic) in [(0.0, 0.0), (1.0, 1.0)] {
        for step in 0..5_u8 {
            let roughness = f64::from(step) * 0.25;
            let name = format!("metallic {metallic} roughness {roughness}");
            let material = scene.material(&name, surface(WHITE, metallic, roughness));
            let (x, y) = (1.1 * (f32::from(step) - 2.0), 1.65 - 1.1 * row as f32);
            scene.place(&name, sphere, material, Placement::at(x, y, 0.0));
        }
    }
}

fn masked(texture: usize, double_sided: bool) -> Value {
    let mut fields = surface([1.0; 4], 0.0, 0.6);
    fields["pbrMetallicRoughness"]["baseColorTexture"] = json!({"index": texture});
    fields["alphaMode"] = json!("MASK");
    fields["alphaCutoff"] = json!(0.5);
    if double_sided {
        fields["doubleSided"] = json!(true);
    }
    fields
}

/// The same normal-mapped mesh twice, the second time with a node that mirrors it.
fn mirrored_pair(scene: &mut Builder, quad: Geometry, studs: usize) {
    let mut fields = surface([0.6, 0.55, 0.5, 1.0], 0.0, 0.4);
    fields["normalTexture"] = json!({"index": studs});
    let material = scene.material("studs", fields);
    scene.place("studs", quad, material, spot(2.0));
    let mirrored = spot(3.0).scaled(-1.0, 1.0, 1.0);
    scene.place("mirrored studs", quad, material, mirrored);
}

/// Three panes one behind the other, from the front red, green, blue.
fn blend_stack(scene: &mut Builder, quad: Geometry) {
    let colors = [
        ("red pane", [0.9, 0.1, 0.1, 0.4]),
        ("green pane", [0.1, 0.8, 0.2, 0.4]),
        ("blue pane", [0.1, 0.2, 0.9, 0.4]),
    ];
    for (i, (name, color)) in colors.into_iter().enumerate() {
        let mut fields = surface(color, 0.0, 0.1);
        fields["alphaMode"] = json!("BLEND");
        let material = scene.material(name, fields);
        let mut at = spot(4.0);
        let offset = 0.15 * (i as f32 - 1.0);
        at.translation += Vec3::new(offset, offset, -0.3 * (i as f32 - 1.0));
        scene.place(name, quad, material, at.scaled(0.65, 0.65, 1.0));
    }
}

fn emissive() -> Value {
    let mut fields = surface([0.0, 0.0, 0.0, 1.0], 0.0, 1.0);
    fields["emissiveFactor"] = json!([1.0, 0.5, 0.1]);
    fields["extensions"] = json!({"KHR_materials_emissive_strength": {"emissiveStrength": 4.0}});
    fields
}

fn unlit() -> Value {
    let mut fields = surface([0.2, 0.5, 0.8, 1.0], 0.0, 1.0);
    fields["extensions"] = json!({"KHR_materials_unlit": {}});
    fields
}

/// A quad whose first coordinates are useless (all one point), with its texture on the second.
fn second_uv(scene: &mut Builder, squares: usize) {
    let mut mesh = Mesh::quad(0.9, 0.9, 1.0);
    mesh.uvs1 = mesh.uvs.clone();
    mesh.uvs.fill(Vec2::splat(0.125));
    let geometry = scene.geometry(&mesh);
    let mut fields = surface([1.0; 4], 0.0, 0.7);
    fields["pbrMetallicRoughness"]["baseColorTexture"] = json!({"index": squares, "texCoord": 1});
    fields["occlusionTexture"] = json!({"index": squares, "texCoord": 1, "strength": 0.5});
    let material = scene.material("second uv", fields);
    scene.place("second uv", geometry, material, low_spot(2.0));
    let mut fields = surface([1.0; 4], 0.0, 0.7);
    fields["pbrMetallicRoughness"]["baseColorTexture"] = json!({"index": squares});
    let material = scene.material("first uv", fields);
    scene.place("first uv", geometry, material, low_spot(3.0));
}

fn cameras(scene: &mut Builder) {
    let at = Placement::at(0.0, 0.0, 6.0);
    scene.orthographic("ortho", 2.3, at);
    let eye = Vec3::new(0.9, 0.4, 6.2);
    scene.perspective("persp", 42.0, Placement::looking(eye, Vec3::ZERO));
}
