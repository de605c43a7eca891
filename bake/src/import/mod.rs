//! Decodes input files: glTF 2.0 scenes, their images, environment images.

mod accessor;
mod buffer;
mod camera;
mod context;
mod document;
mod draco;
mod environment;
mod extension;
mod glb;
mod image;
mod instancing;
mod integers;
mod light;
mod lobes;
mod material;
mod mesh;
mod meshopt;
mod node;
mod radiance;
mod skin;
mod sniff;
#[cfg(test)]
mod testing;
mod texture;
mod topology;
mod uri;
mod uv_sets;

use std::collections::BTreeSet;
use std::path::Path;

use crate::diagnostic::Result;
use crate::scene::{Material, Mesh, Scene};

pub use environment::{
    EnvironmentImage, ReplacedTexels, decode_environment, environment_pixels, load_environment,
    read_environment,
};
pub use image::{DecodedImage, ImageHeader, Universal, decode_image, image_header};

pub(crate) use context::read_file;
pub use context::{DEFAULT_LIMIT_TRIANGLES, Rules};

use context::Context;
use node::Placed;

/// Reads a `.gltf` or `.glb` file with everything its scene needs (glTF 2.0 specification).
///
/// The container is recognised by its content, not by its name. Only what the default scene
/// reaches is read: other meshes, materials and images may be broken or missing, and do not
/// appear in the result.
///
/// # Errors
/// `BakeError::Io` where the scene file itself cannot be read, `BakeError::Input` with the JSON
/// pointer or byte offset of the fault otherwise.
pub fn import(path: &Path) -> Result<Scene> {
    import_with(path, &Rules::default())
}

/// As [`import`], under other rules.
///
/// # Errors
/// As there.
pub fn import_with(path: &Path, rules: &Rules) -> Result<Scene> {
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    let mut context = Context::open(path)?;
    context.rules = rules.clone();
    assemble(context, name.into_owned())
}

/// Reads everything that the scene of an opened file reaches.
fn assemble(context: Context, name: String) -> Result<Scene> {
    context.note_ignored_features();
    let mut placed = node::place(&context)?;
    let mut scene = Scene {
        name,
        meshes: read_meshes(&context, &mut placed)?,
        instances: placed.instances,
        lights: placed.lights,
        cameras: placed.cameras,
        ..Scene::default()
    };
    read_materials(&context, &mut scene)?;
    texture::read_used(&context, &mut scene)?;
    (scene.sources, scene.diagnostics) = context.finish();
    Ok(scene)
}

/// Reads the meshes that instances name, in glTF order, and renumbers the instances.
fn read_meshes(context: &Context, placed: &mut Placed) -> Result<Vec<Mesh>> {
    let mut order: Vec<usize> = (0..placed.shapes.len()).collect();
    order.sort_by_key(|&number| &placed.shapes[number]);
    let mut ranks = vec![0; order.len()];
    let mut meshes = Vec::with_capacity(order.len());
    for (rank, &number) in order.iter().enumerate() {
        ranks[number] = rank as u32;
        let shape = &placed.shapes[number];
        let joints = shape
            .skin
            .map(|skin| skin::joint_matrices(context, skin, &placed.worlds));
        let pose = mesh::Pose {
            weights: shape.weights(),
            joints: joints.transpose()?,
        };
        meshes.push(mesh::read(context, shape.mesh, &pose)?);
    }
    for instance in &mut placed.instances {
        instance.mesh = ranks[instance.mesh as usize];
    }
    Ok(meshes)
}

/// Reads the materials that primitives name, in glTF order, and renumbers the primitives.
fn read_materials(context: &Context, scene: &mut Scene) -> Result<()> {
    let primitives = || scene.meshes.iter().flat_map(|m| &m.primitives);
    let used: BTreeSet<u32> = primitives().filter_map(|p| p.material).collect();
    let renumber = Renumber::new(&used);
    for &index in &used {
        scene.materials.push(material::read(context, index)?);
    }
    for primitive in scene.meshes.iter_mut().flat_map(|m| &mut m.primitives) {
        primitive.material = primitive.material.map(|index| renumber.get(index));
    }
    Ok(())
}

/// The texture slots of a material, in a fixed order.
fn slots(material: &mut Material) -> [&mut Option<crate::scene::TextureRef>; 12] {
    [
        &mut material.base_color_texture,
        &mut material.metallic_roughness_texture,
        &mut material.normal_texture,
        &mut material.occlusion_texture,
        &mut material.emissive_texture,
        &mut material.lobes.clearcoat_texture,
        &mut material.lobes.clearcoat_roughness_texture,
        &mut material.lobes.clearcoat_normal_texture,
        &mut material.lobes.specular_texture,
        &mut material.lobes.specular_color_texture,
        &mut material.lobes.sheen_color_texture,
        &mut material.lobes.sheen_roughness_texture,
    ]
}

/// Maps sparse glTF indices to their rank among the used ones.
struct Renumber(Vec<u32>);

impl Renumber {
    fn new(used: &BTreeSet<u32>) -> Self {
        Self(used.iter().copied().collect())
    }

    /// The rank of `index`, which was in the set that the map was made from.
    fn get(&self, index: u32) -> u32 {
        match self.0.binary_search(&index) {
            Ok(rank) => rank as u32,
            Err(_) => unreachable!("index {index} was not collected"),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;
    use crate::diagnostic::BakeError;

    /// A triangle with indices, a material, a texture, a light and a camera.
    fn tiny_glb() -> Vec<u8> {
        let mut json = r#"{"asset":{"version":"2.0"},"extensionsUsed":["KHR_lights_punctual"],
            "extensions":{"KHR_lights_punctual":{"lights":[{"type":"point"}]}},
            "buffers":[{"byteLength":44}],
            "bufferViews":[{"buffer":0,"byteLength":36},{"buffer":0,"byteOffset":36,"byteLength":8}],
            "accessors":[{"bufferView":0,"componentType":5126,"type":"VEC3","count":3},
                {"bufferView":1,"componentType":5123,"type":"SCALAR","count":3}],
            "images":[{"bufferView":1,"mimeType":"image/png"}],"samplers":[{"wrapS":33071}],
            "textures":[{"source":0,"sampler":0}],
            "materials":[{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}],
            "meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1,"material":0}]}],
            "cameras":[{"type":"perspective","perspective":{"yfov":1,"znear":1}}],
            "nodes":[{"mesh":0,"children":[1]},
                {"camera":0,"extensions":{"KHR_lights_punctual":{"light":0}}}],
            "scenes":[{"nodes":[0]}],"scene":0}"#
            .replace("            ", "");
        while !json.len().is_multiple_of(4) {
            json.push(' ');
        }
        let positions = [0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        let mut bin: Vec<u8> = positions.iter().flat_map(|v| v.to_le_bytes()).collect();
        bin.extend([0, 0, 1, 0, 2, 0, 0, 0]);
        let word = |value: usize| (value as u32).to_le_bytes();
        let total = 12 + 8 + json.len() + 8 + bin.len();
        let header = [&b"glTF"[..], &word(2), &word(total)].concat();
        let json = [&word(json.len())[..], b"JSON", json.as_bytes()].concat();
        let bin = [&word(bin.len())[..], b"BIN\0", &bin].concat();
        [header, json, bin].concat()
    }

    fn read(bytes: Vec<u8>) -> Result<Scene> {
        let source = context::describe("tiny.glb".into(), &bytes);
        let folder = PathBuf::from("/nonexistent");
        assemble(
            Context::parse("tiny.glb".into(), folder, bytes, source)?,
            "tiny".into(),
        )
    }

    #[test]
    fn a_tiny_scene_is_read_whole() {
        let scene = read(tiny_glb()).unwrap();
        assert_eq!(scene.meshes[0].primitives[0].indices, [0, 1, 2]);
        assert_eq!(scene.meshes[0].primitives[0].material, Some(0));
        assert_eq!(scene.images[0].bytes, [0, 0, 1, 0, 2, 0, 0, 0]);
        assert_eq!((scene.lights.len(), scene.cameras.len()), (1, 1));
        assert_eq!(scene.sources[0].hash, *blake3::hash(&tiny_glb()).as_bytes());
        assert!(scene.diagnostics.is_empty());
    }

    #[test]
    fn truncation_at_every_byte_is_an_input_error() {
        let bytes = tiny_glb();
        for length in 0..bytes.len() {
            let result = read(bytes[..length].to_vec());
            assert!(matches!(result, Err(BakeError::Input(_))), "{length}");
        }
    }

    #[test]
    fn changed_bytes_never_panic() {
        let bytes = tiny_glb();
        let (mut read_whole, mut refused) = (0, 0);
        for position in 0..bytes.len() {
            for value in [0, b'-', b'0', b'1', b'9', b'"', b'{', b' ', 0x7f, 0xff] {
                let mut bytes = bytes.clone();
                bytes[position] = value;
                match read(bytes) {
                    Ok(_) => read_whole += 1,
                    Err(BakeError::Input(_)) => refused += 1,
                    Err(other) => panic!("{other}"),
                }
            }
        }
        assert!(read_whole > 100 && refused > 1000, "{read_whole} {refused}");
    }
}
