//! Decodes input files: glTF 2.0 scenes, their images, environment images.

mod accessor;
mod buffer;
mod camera;
mod context;
mod document;
mod environment;
mod glb;
mod image;
mod integers;
mod light;
mod material;
mod mesh;
mod node;
mod radiance;
mod sniff;
#[cfg(test)]
mod testing;
mod texture;
mod uri;

use std::collections::BTreeSet;
use std::path::Path;

use crate::diagnostic::Result;
use crate::scene::{Material, Scene};

pub use environment::{EnvironmentImage, ReplacedTexels, load_environment};
pub use image::{DecodedImage, decode_image};

use context::Context;

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
    let context = Context::open(path)?;
    context.note_ignored_features();
    let placed = node::place(&context)?;
    let mut scene = Scene {
        name: path
            .file_stem()
            .map(|stem| stem.to_string_lossy().into_owned())
            .unwrap_or_default(),
        instances: placed.instances,
        lights: placed.lights,
        cameras: placed.cameras,
        ..Scene::default()
    };
    read_meshes(&context, &mut scene)?;
    read_materials(&context, &mut scene)?;
    texture::read_used(&context, &mut scene)?;
    (scene.sources, scene.diagnostics) = context.finish();
    Ok(scene)
}

/// Reads the meshes that instances name, in glTF order, and renumbers the instances.
fn read_meshes(context: &Context, scene: &mut Scene) -> Result<()> {
    let used: BTreeSet<u32> = scene.instances.iter().map(|i| i.mesh).collect();
    let renumber = Renumber::new(&used);
    for &index in &used {
        scene.meshes.push(mesh::read(context, index)?);
    }
    for instance in &mut scene.instances {
        instance.mesh = renumber.get(instance.mesh);
    }
    Ok(())
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
fn slots(material: &mut Material) -> [&mut Option<crate::scene::TextureRef>; 5] {
    [
        &mut material.base_color_texture,
        &mut material.metallic_roughness_texture,
        &mut material.normal_texture,
        &mut material.occlusion_texture,
        &mut material.emissive_texture,
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
