//! The rkyv root: everything of a package that is not bulk data.

use rkyv::{Archive, Deserialize, Serialize};

use crate::record::{FileField, FileType};
use crate::texture::TextureFormat;

/// A type of the root: the text from which the schema hash is made, and its archived layout.
pub(crate) trait RootType {
    const TEXT: &'static str;
    const LAYOUT: FileType;
}

/// Declares a root struct and records its field names, types and archived layout.
macro_rules! root_struct {
    (
        $(#[doc = $doc:literal])*
        pub struct $name:ident {
            $($(#[doc = $field_doc:literal])* pub $field:ident : $ty:ty,)*
        }
    ) => {
        $(#[doc = $doc])*
        #[derive(Archive, Serialize, Deserialize, Clone, Debug, PartialEq)]
        #[rkyv(attr(allow(missing_docs)))]
        pub struct $name {
            $($(#[doc = $field_doc])* pub $field: $ty,)*
        }

        impl RootType for $name {
            const TEXT: &'static str = concat!(
                stringify!($name), "{", $(stringify!($field), ":", stringify!($ty), ";",)* "}"
            );
            const LAYOUT: FileType = FileType {
                name: stringify!($name),
                bytes: size_of::<<$name as Archive>::Archived>(),
                doc: concat!($($doc),*),
                fields: &[$(FileField {
                    name: stringify!($field),
                    ty: stringify!($ty),
                    offset: std::mem::offset_of!(<$name as Archive>::Archived, $field),
                    bytes: size_of::<<$ty as Archive>::Archived>(),
                    doc: concat!($($field_doc),*),
                },)*],
                variants: &[],
            };
        }
    };
}

/// Declares a fieldless root enum and records its variants.
macro_rules! root_enum {
    (
        $(#[doc = $doc:literal])*
        pub enum $name:ident {
            $($(#[doc = $variant_doc:literal])* $variant:ident = $value:literal,)*
        }
    ) => {
        $(#[doc = $doc])*
        #[derive(Archive, Serialize, Deserialize, Clone, Copy, Debug, PartialEq, Eq)]
        #[rkyv(attr(allow(missing_docs)), derive(Clone, Copy, Debug, PartialEq, Eq))]
        #[repr(u8)]
        pub enum $name {
            $($(#[doc = $variant_doc])* $variant = $value,)*
        }

        impl RootType for $name {
            const TEXT: &'static str = concat!(
                stringify!($name), "(", $(stringify!($variant), "=", stringify!($value), ";",)* ")"
            );
            const LAYOUT: FileType = FileType {
                name: stringify!($name),
                bytes: size_of::<<$name as Archive>::Archived>(),
                doc: concat!($($doc),*),
                fields: &[],
                variants: &[$((stringify!($variant), $value, concat!($($variant_doc),*)),)*],
            };
        }
    };
}

root_struct! {
    /// The root.
    pub struct Scene {
        /// File stem of the source.
        pub name: String,
        /// Bits of [`crate::features`]: what the scene contains.
        pub features: u32,
        /// World bounds of all instances; all zero in a scene without any.
        pub bounds: Bounds,
        /// glTF meshes; each is one bottom-level acceleration structure.
        pub meshes: Vec<Mesh>,
        /// Primitives, contiguous per mesh; each is one geometry.
        pub primitives: Vec<Primitive>,
        /// One per record of the material section.
        pub materials: Vec<MaterialInfo>,
        /// Bindless 2D slots: slot = index.
        pub textures: Vec<Texture>,
        /// Images, 2D and cube.
        pub images: Vec<Image>,
        /// Samplers.
        pub samplers: Vec<Sampler>,
        /// Every light of the source; directional ones also have a GPU record.
        pub lights: Vec<Light>,
        /// Cameras of the source, names unique.
        pub cameras: Vec<Camera>,
        /// Image-based light.
        pub environment: Option<Environment>,
        /// Index of the BRDF table in `images`; present where a light, an emitter or an environment is.
        pub brdf_lut: Option<u32>,
        /// What the package was made from.
        pub provenance: Provenance,
        /// The error of every lossy step. Times are not stored: they would make bytes differ between runs.
        pub report: Vec<ReportRow>,
    }
}

root_struct! {
    /// An axis-aligned box, metres.
    pub struct Bounds {
        /// Least corner.
        pub min: [f32; 3],
        /// Greatest corner.
        pub max: [f32; 3],
    }
}

root_struct! {
    /// A glTF mesh.
    pub struct Mesh {
        /// glTF name.
        pub name: String,
        /// First of its primitives.
        pub first_primitive: u32,
        /// Its primitives.
        pub primitive_count: u32,
    }
}

root_struct! {
    /// A triangle list with one material.
    pub struct Primitive {
        /// First index in the index arena.
        pub first_index: u32,
        /// Indices, a multiple of three.
        pub index_count: u32,
        /// Leading indices whose triangles have an area: the acceleration structure takes only these.
        pub traced_index_count: u32,
        /// First vertex in the vertex arena; indices are relative to it.
        pub first_vertex: u32,
        /// Vertices.
        pub vertex_count: u32,
        /// Material record.
        pub material: u32,
        /// Whether every ray that hits it stops: the geometry's `OPAQUE` flag.
        pub opaque: bool,
        /// Object-space bounds.
        pub bounds: Bounds,
    }
}

root_struct! {
    /// What the GPU does not need of a material.
    pub struct MaterialInfo {
        /// glTF name.
        pub name: String,
    }
}

root_struct! {
    /// An image seen through a sampler.
    pub struct Texture {
        /// Index into the images; a 2D image.
        pub image: u32,
        /// Index into the samplers.
        pub sampler: u32,
    }
}

root_enum! {
    /// What an image is used for.
    pub enum ImageRole {
        /// Base colour or emission.
        Color = 0,
        /// Linear data: metallic-roughness, occlusion.
        Data = 1,
        /// Tangent-space normals.
        Normal = 2,
        /// A product of the environment, or the BRDF table.
        Environment = 3,
    }
}

/// Every component is the channel of its name.
pub const IDENTITY_SWIZZLE: [Swizzle; 4] =
    [Swizzle::Red, Swizzle::Green, Swizzle::Blue, Swizzle::Alpha];

root_enum! {
    /// What a shader reads as one component of a texel.
    pub enum Swizzle {
        /// The first stored channel.
        Red = 0,
        /// The second.
        Green = 1,
        /// The third.
        Blue = 2,
        /// The fourth.
        Alpha = 3,
        /// 0.
        Zero = 4,
        /// 1.
        One = 5,
    }
}

root_struct! {
    /// An image with its mip chain in the texel section.
    pub struct Image {
        /// glTF name or product name.
        pub name: String,
        /// What it is used for.
        pub role: ImageRole,
        /// Storage format.
        pub format: TextureFormat,
        /// What shaders read as red, green, blue and alpha; [`IDENTITY_SWIZZLE`] unless channels were moved together.
        pub swizzle: [Swizzle; 4],
        /// Texels of level 0.
        pub width: u32,
        /// Texels of level 0.
        pub height: u32,
        /// 1 for a 2D image, 6 for a cube (+X -X +Y -Y +Z -Z).
        pub layers: u32,
        /// Levels, largest first; each holds all layers one behind the other.
        pub levels: Vec<Level>,
    }
}

root_struct! {
    /// One mip level in the texel section.
    pub struct Level {
        /// Byte offset in the section, a multiple of 16.
        pub offset: u64,
        /// Bytes of all layers.
        pub length: u64,
    }
}

root_enum! {
    /// Texture coordinate wrapping.
    pub enum Wrap {
        /// `REPEAT`.
        Repeat = 0,
        /// `MIRRORED_REPEAT`.
        MirroredRepeat = 1,
        /// `CLAMP_TO_EDGE`.
        ClampToEdge = 2,
    }
}

root_enum! {
    /// How levels are chosen.
    pub enum MipFilter {
        /// Only level 0 is read.
        None = 0,
        /// The nearest level.
        Nearest = 1,
        /// Between two levels.
        Linear = 2,
    }
}

root_struct! {
    /// A glTF sampler, defaults filled in.
    pub struct Sampler {
        /// Linear magnification.
        pub mag_linear: bool,
        /// Linear minification.
        pub min_linear: bool,
        /// Filter between levels.
        pub mip: MipFilter,
        /// Wrapping along U.
        pub wrap_u: Wrap,
        /// Wrapping along V.
        pub wrap_v: Wrap,
    }
}

root_enum! {
    /// Kinds of `KHR_lights_punctual`.
    pub enum LightKind {
        /// Intensity in lux.
        Directional = 0,
        /// Intensity in candela.
        Point = 1,
        /// Intensity in candela.
        Spot = 2,
    }
}

root_struct! {
    /// A light placed in the world.
    pub struct Light {
        /// Name of the light.
        pub name: String,
        /// Its kind.
        pub kind: LightKind,
        /// Linear RGB.
        pub color: [f32; 3],
        /// Lux or candela.
        pub intensity: f32,
        /// World position, metres.
        pub position: [f32; 3],
        /// Unit direction of travel.
        pub direction: [f32; 3],
        /// Metres; 0 is unlimited.
        pub range: f32,
        /// Half-angle of the full cone, radians (spot).
        pub inner_angle: f32,
        /// Half-angle where the cone ends, radians (spot).
        pub outer_angle: f32,
    }
}

root_enum! {
    /// Kinds of projection.
    pub enum ProjectionKind {
        /// `extent` is the vertical field of view in radians.
        Perspective = 0,
        /// `extent` is half the height in metres.
        Orthographic = 1,
    }
}

root_struct! {
    /// A camera placed in the world.
    pub struct Camera {
        /// Unique name.
        pub name: String,
        /// Kind of projection.
        pub projection: ProjectionKind,
        /// Vertical field of view in radians, or half the height in metres.
        pub extent: f32,
        /// Metres.
        pub znear: f32,
        /// Metres; 0 is infinite.
        pub zfar: f32,
        /// World position.
        pub position: [f32; 3],
        /// Unit view direction.
        pub forward: [f32; 3],
        /// Unit up direction.
        pub up: [f32; 3],
    }
}

root_struct! {
    /// Image-based light. Directions: u = 0.5 + atan2(z, x) / 2 pi and v = acos(y) / pi of the source panorama.
    pub struct Environment {
        /// Cube image of the sky's radiance.
        pub sky: u32,
        /// Cube image of irradiance divided by pi.
        pub irradiance: u32,
        /// Cube image of GGX-prefiltered radiance.
        pub prefiltered: u32,
        /// Perceptual roughness of each level of the prefiltered cube: level i of n is i / (n - 1).
        pub prefiltered_roughness: Vec<f32>,
        /// Stored cubes times this are radiance (irradiance / pi); 1 unless the sky leaves half range.
        pub scale: f32,
        /// The sun that the bake took out of all cubes, of the coefficients and of the importance table.
        pub sun: Option<Sun>,
        /// Irradiance / pi, unscaled, as the polynomial of [`crate::harmonics::evaluate`].
        pub irradiance_sh: [[f32; 3]; 9],
        /// Width of the source panorama.
        pub source_width: u32,
        /// Height of the source panorama.
        pub source_height: u32,
        /// Source texels that were NaN, infinite or negative, and were replaced.
        pub replaced_texels: u64,
        /// Sky texels above the largest half float, and clamped to it.
        pub clamped_texels: u64,
    }
}

root_struct! {
    /// A disc of constant radiance `color * illuminance / (pi sin^2(angular_radius))` at infinity.
    pub struct Sun {
        /// Unit vector from the scene to the sun, in the environment's space.
        pub direction: [f32; 3],
        /// Linear RGB, largest channel 1.
        pub color: [f32; 3],
        /// Irradiance of `color`'s largest channel on a plane facing the sun: radiance units times steradians.
        pub illuminance: f32,
        /// Half of the disc's apparent angle, radians.
        pub angular_radius: f32,
    }
}

root_struct! {
    /// What a package was made from and with.
    pub struct Provenance {
        /// `cairn-bake` and its version.
        pub tool: String,
        /// Every setting that shapes the bytes.
        pub settings: Vec<Setting>,
        /// Every file read.
        pub sources: Vec<SourceFile>,
    }
}

root_struct! {
    /// A setting as text.
    pub struct Setting {
        /// Long flag without dashes.
        pub name: String,
        /// Value.
        pub value: String,
    }
}

root_struct! {
    /// An input file.
    pub struct SourceFile {
        /// Path relative to the scene file's folder.
        pub path: String,
        /// Bytes.
        pub bytes: u64,
        /// BLAKE3 of the content.
        pub hash: [u8; 32],
    }
}

root_struct! {
    /// The error of one lossy step.
    pub struct ReportRow {
        /// Stage, such as `texture`.
        pub stage: String,
        /// Object, such as an image's name.
        pub item: String,
        /// Setting or preset.
        pub setting: String,
        /// Name and unit of the metric, such as `psnr dB`.
        pub metric: String,
        /// Value of the metric.
        pub error: f64,
        /// Bytes produced.
        pub bytes: u64,
    }
}

impl Scene {
    /// A scene of nothing.
    pub fn empty(name: &str) -> Self {
        Self {
            name: name.to_owned(),
            features: 0,
            bounds: Bounds::ZERO,
            meshes: Vec::new(),
            primitives: Vec::new(),
            materials: Vec::new(),
            textures: Vec::new(),
            images: Vec::new(),
            samplers: Vec::new(),
            lights: Vec::new(),
            cameras: Vec::new(),
            environment: None,
            brdf_lut: None,
            provenance: Provenance {
                tool: String::new(),
                settings: Vec::new(),
                sources: Vec::new(),
            },
            report: Vec::new(),
        }
    }
}

impl Bounds {
    /// A box of no extent at the origin.
    pub const ZERO: Self = Self {
        min: [0.0; 3],
        max: [0.0; 3],
    };
}

/// An archived array of floats as native ones.
pub fn natives<const N: usize>(values: &[rkyv::rend::f32_le; N]) -> [f32; N] {
    values.map(|value| value.to_native())
}

/// Applies a constant of [`RootType`] to all root types, in declaration order.
macro_rules! root_types {
    ($constant:ident) => {
        [
            Scene::$constant,
            Bounds::$constant,
            Mesh::$constant,
            Primitive::$constant,
            MaterialInfo::$constant,
            Texture::$constant,
            ImageRole::$constant,
            Swizzle::$constant,
            Image::$constant,
            Level::$constant,
            Wrap::$constant,
            MipFilter::$constant,
            Sampler::$constant,
            LightKind::$constant,
            Light::$constant,
            ProjectionKind::$constant,
            Camera::$constant,
            Environment::$constant,
            Sun::$constant,
            Provenance::$constant,
            Setting::$constant,
            SourceFile::$constant,
            ReportRow::$constant,
        ]
    };
}

/// Names and types of all root types, in declaration order.
pub(crate) fn schema_text() -> String {
    root_types!(TEXT).concat()
}

/// Archived layouts of all root types, in declaration order.
pub fn layouts() -> Vec<FileType> {
    root_types!(LAYOUT).into()
}
