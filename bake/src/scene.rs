//! The plain scene that import produces: decoded attributes, resolved references, nothing GPU-shaped yet.

use std::path::PathBuf;

use glam::{DMat4, DVec3, Vec3, Vec4};

use crate::diagnostic::Diagnostic;

/// One imported glTF scene. Every index below is in range of the vector it points into.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// File stem of the glTF file.
    pub name: String,
    pub meshes: Vec<Mesh>,
    pub materials: Vec<Material>,
    /// Image and sampler pairs, in glTF order; `TextureRef::texture` points here.
    pub textures: Vec<Texture>,
    pub images: Vec<Image>,
    pub samplers: Vec<Sampler>,
    /// One per node that carries a mesh, and per instance of `EXT_mesh_gpu_instancing`, in depth-first scene order.
    pub instances: Vec<MeshInstance>,
    pub lights: Vec<Light>,
    pub cameras: Vec<Camera>,
    /// Every file that was read, in the order of reading.
    pub sources: Vec<Source>,
    pub diagnostics: Vec<Diagnostic>,
}

impl Scene {
    /// A place in the scene file: a JSON pointer, or empty.
    pub fn origin(&self, pointer: impl Into<String>) -> Origin {
        let file = self
            .sources
            .first()
            .map_or(&self.name, |source| &source.path);
        Origin {
            file: file.clone(),
            pointer: pointer.into(),
        }
    }
}

/// A file the bake depends on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Source {
    /// Path relative to the scene file's folder, `/`-separated; of an absolute path its last name.
    pub path: String,
    /// Where it was read; no part of a package.
    pub location: PathBuf,
    pub bytes: u64,
    /// BLAKE3 of the content.
    pub hash: [u8; 32],
}

#[derive(Clone, Debug, Default)]
pub struct Mesh {
    pub name: String,
    pub primitives: Vec<Primitive>,
}

/// A triangle list. All present attribute vectors have the length of `positions`;
/// `indices.len()` is a multiple of three and each index is below `positions.len()`.
#[derive(Clone, Debug, Default)]
pub struct Primitive {
    pub positions: Vec<[f32; 3]>,
    pub normals: Option<Vec<[f32; 3]>>,
    /// xyz and handedness, as authored.
    pub tangents: Option<Vec<[f32; 4]>>,
    pub uv0: Option<Vec<[f32; 2]>>,
    pub uv1: Option<Vec<[f32; 2]>>,
    /// `COLOR_0`, linear RGBA; RGB colours have alpha 1.
    pub colors: Option<Vec<[f32; 4]>>,
    pub indices: Vec<u32>,
    /// Index into `Scene::materials`; `None` is glTF's default material.
    pub material: Option<u32>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AlphaMode {
    Opaque,
    Mask,
    Blend,
}

/// A texture as a material slot uses it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TextureRef {
    /// Index into `Scene::textures`.
    pub texture: u32,
    /// 0 or 1: `uv0` or `uv1`.
    pub uv_set: u32,
    /// `KHR_texture_transform`.
    pub transform: UvTransform,
}

impl TextureRef {
    /// A texture without a transform.
    pub fn new(texture: u32, uv_set: u32) -> Self {
        Self {
            texture,
            uv_set,
            transform: UvTransform::IDENTITY,
        }
    }
}

/// An affine map of texture coordinates: scale, then rotation, then offset (`KHR_texture_transform`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UvTransform {
    /// Columns of the 2x2 matrix.
    pub matrix: [f32; 4],
    pub offset: [f32; 2],
}

impl UvTransform {
    pub const IDENTITY: Self = Self {
        matrix: [1.0, 0.0, 0.0, 1.0],
        offset: [0.0; 2],
    };

    /// The transform of the extension: offset, counter-clockwise rotation in radians, scale.
    pub fn new(offset: [f32; 2], rotation: f32, scale: [f32; 2]) -> Self {
        let (sine, cosine) = (
            libm::sin(f64::from(rotation)) as f32,
            libm::cos(f64::from(rotation)) as f32,
        );
        Self {
            matrix: [
                cosine * scale[0],
                -sine * scale[0],
                sine * scale[1],
                cosine * scale[1],
            ],
            offset,
        }
    }

    /// The transformed coordinates.
    pub fn apply(&self, [u, v]: [f32; 2]) -> [f32; 2] {
        let [a, b, c, d] = self.matrix;
        [
            a * u + c * v + self.offset[0],
            b * u + d * v + self.offset[1],
        ]
    }
}

impl Default for UvTransform {
    fn default() -> Self {
        Self::IDENTITY
    }
}

#[derive(Clone, Debug)]
pub struct Material {
    pub name: String,
    /// Linear RGBA.
    pub base_color: Vec4,
    /// Linear RGB, `KHR_materials_emissive_strength` folded in.
    pub emissive: Vec3,
    pub metallic: f32,
    pub roughness: f32,
    pub normal_scale: f32,
    pub occlusion_strength: f32,
    pub alpha_mode: AlphaMode,
    pub alpha_cutoff: f32,
    pub double_sided: bool,
    /// `KHR_materials_unlit`.
    pub unlit: bool,
    pub base_color_texture: Option<TextureRef>,
    pub metallic_roughness_texture: Option<TextureRef>,
    pub normal_texture: Option<TextureRef>,
    pub occlusion_texture: Option<TextureRef>,
    pub emissive_texture: Option<TextureRef>,
    pub lobes: Lobes,
}

/// What `KHR_materials_clearcoat`, `specular`, `ior` and `sheen` add to metallic-roughness; the default adds nothing.
#[derive(Clone, Debug, PartialEq)]
pub struct Lobes {
    /// 0..=1; 0 is no coat.
    pub clearcoat: f32,
    /// Perceptual, 0..=1.
    pub clearcoat_roughness: f32,
    pub clearcoat_normal_scale: f32,
    /// At least 1, or 0: a dielectric that reflects everything.
    pub ior: f32,
    /// 0..=1.
    pub specular: f32,
    /// Linear RGB, not negative.
    pub specular_color: Vec3,
    /// Linear RGB, 0..=1; black is no sheen.
    pub sheen_color: Vec3,
    /// Perceptual, 0..=1.
    pub sheen_roughness: f32,
    pub clearcoat_texture: Option<TextureRef>,
    pub clearcoat_roughness_texture: Option<TextureRef>,
    pub clearcoat_normal_texture: Option<TextureRef>,
    pub specular_texture: Option<TextureRef>,
    pub specular_color_texture: Option<TextureRef>,
    pub sheen_color_texture: Option<TextureRef>,
    pub sheen_roughness_texture: Option<TextureRef>,
}

impl Default for Lobes {
    fn default() -> Self {
        Self {
            clearcoat: 0.0,
            clearcoat_roughness: 0.0,
            clearcoat_normal_scale: 1.0,
            ior: 1.5,
            specular: 1.0,
            specular_color: Vec3::ONE,
            sheen_color: Vec3::ZERO,
            sheen_roughness: 0.0,
            clearcoat_texture: None,
            clearcoat_roughness_texture: None,
            clearcoat_normal_texture: None,
            specular_texture: None,
            specular_color_texture: None,
            sheen_color_texture: None,
            sheen_roughness_texture: None,
        }
    }
}

impl Default for Material {
    /// glTF 2.0 section 3.9: the default material.
    fn default() -> Self {
        Self {
            name: String::new(),
            base_color: Vec4::ONE,
            emissive: Vec3::ZERO,
            metallic: 1.0,
            roughness: 1.0,
            normal_scale: 1.0,
            occlusion_strength: 1.0,
            alpha_mode: AlphaMode::Opaque,
            alpha_cutoff: 0.5,
            double_sided: false,
            unlit: false,
            base_color_texture: None,
            metallic_roughness_texture: None,
            normal_texture: None,
            occlusion_texture: None,
            emissive_texture: None,
            lobes: Lobes::default(),
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Texture {
    /// Index into `Scene::images`.
    pub image: u32,
    /// Index into `Scene::samplers`; `None` is linear filtering and repeat.
    pub sampler: Option<u32>,
}

/// An encoded image, decoded only when a material uses it.
#[derive(Clone, Debug, Default)]
pub struct Image {
    /// The glTF name, else the file stem of its URI, else `image N`.
    pub name: String,
    /// The first material that uses it, for messages; empty where it has no name.
    pub material: String,
    pub bytes: Vec<u8>,
    /// Where it came from, for messages: file, and JSON pointer such as `/images/3`.
    pub origin: Origin,
}

/// A place in an input file, for messages.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Origin {
    pub file: String,
    pub pointer: String,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Wrap {
    Repeat,
    MirroredRepeat,
    ClampToEdge,
}

/// A glTF sampler with the defaults filled in (linear, trilinear, repeat).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Sampler {
    pub mag_linear: bool,
    pub min_linear: bool,
    /// `None`: the minification filter names no mipmaps, only level 0 is read.
    pub mip_linear: Option<bool>,
    pub wrap_u: Wrap,
    pub wrap_v: Wrap,
}

impl Default for Sampler {
    fn default() -> Self {
        Self {
            mag_linear: true,
            min_linear: true,
            mip_linear: Some(true),
            wrap_u: Wrap::Repeat,
            wrap_v: Wrap::Repeat,
        }
    }
}

#[derive(Clone, Debug)]
pub struct MeshInstance {
    /// Name of the node.
    pub name: String,
    /// Index into `Scene::meshes`.
    pub mesh: u32,
    /// Object to world, composed in f64. The upper 3x3 may be singular, sheared or mirrored; it is finite.
    pub world: DMat4,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LightKind {
    /// Intensity in lux.
    Directional,
    /// Intensity in candela; `range` in metres, infinite where absent.
    Point { range: f32 },
    /// As point, with cone half-angles in radians.
    Spot { range: f32, inner: f32, outer: f32 },
}

/// `KHR_lights_punctual`, placed in the world.
#[derive(Clone, Debug)]
pub struct Light {
    pub name: String,
    pub kind: LightKind,
    /// Linear RGB.
    pub color: Vec3,
    pub intensity: f32,
    /// World position, metres.
    pub position: DVec3,
    /// World direction of travel (the node's -Z), unit length.
    pub direction: DVec3,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Projection {
    /// Vertical field of view in radians, distances in metres; `zfar` absent is infinite.
    Perspective {
        yfov: f32,
        znear: f32,
        zfar: Option<f32>,
    },
    /// Half extents in metres.
    Orthographic {
        xmag: f32,
        ymag: f32,
        znear: f32,
        zfar: f32,
    },
}

/// A camera of the scene, placed in the world.
#[derive(Clone, Debug)]
pub struct Camera {
    /// The camera's name, else its node's, else `camera N`; unique in the scene.
    pub name: String,
    pub projection: Projection,
    /// World position.
    pub position: DVec3,
    /// Unit view direction (the node's -Z).
    pub forward: DVec3,
    /// Unit up direction (the node's +Y).
    pub up: DVec3,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn assert_near(found: [f32; 2], expected: [f32; 2]) {
        let distance = (found[0] - expected[0]).hypot(found[1] - expected[1]);
        assert!(distance < 1e-5, "{found:?} is not {expected:?}");
    }

    /// The extension's example: offset (0, 1), a quarter turn and scale 0.5 use the lower left
    /// quadrant of the image, whose v runs down.
    #[test]
    fn a_quarter_turn_reads_the_lower_left_quadrant() {
        let quarter = std::f32::consts::FRAC_PI_2;
        let transform = UvTransform::new([0.0, 1.0], quarter, [0.5, 0.5]);
        assert_near(transform.apply([0.0, 0.0]), [0.0, 1.0]);
        assert_near(transform.apply([1.0, 0.0]), [0.0, 0.5]);
        assert_near(transform.apply([0.0, 1.0]), [0.5, 1.0]);
    }

    /// Khronos TextureTransformTest: an arrow drawn along u = v, turned by 22.5 degrees, must
    /// point to the marker "correct" (0.421, 1.016 below the corner) and not to "error".
    #[test]
    fn the_arrow_of_the_conformance_model_points_to_its_mark() {
        let rotation = std::f32::consts::FRAC_PI_8;
        let transform = UvTransform::new([0.0; 2], rotation, [1.0; 2]);
        let [u, v] = transform.apply([0.420_951_8, 1.016_267_5]);
        assert!((u - v).abs() < 1e-3, "{u} {v}");
        let [u, v] = transform.apply([1.016_267_5, 0.420_951_8]);
        assert!((u - v).abs() > 0.5, "{u} {v}");
    }

    /// Scale comes before rotation, so a non-uniform one does not shear the image.
    #[test]
    fn scale_comes_first_and_offset_last() {
        let transform = UvTransform::new([10.0, 20.0], std::f32::consts::FRAC_PI_2, [2.0, 3.0]);
        assert_near(transform.apply([1.0, 0.0]), [10.0, 18.0]);
        assert_near(transform.apply([0.0, 1.0]), [13.0, 20.0]);
        assert_eq!(
            UvTransform::new([0.0; 2], 0.0, [1.0; 2]),
            UvTransform::IDENTITY
        );
    }
}
