//! Every record that a GPU reads, declared once.
//!
//! Fields are plain `f32`, `u32` and `u64` arrays, so that `repr(C)`, GLSL `scalar` and (for [`GlobalUniform`])
//! `std140` give the same offsets; padding is explicit and zero. The GLSL mirror is generated from these
//! declarations by [`crate::glsl`].

use bytemuck::Zeroable;

use crate::brdf_table::{BRDF_TABLE_SIZE, MIN_LIGHT_ROUGHNESS};

use crate::record::gpu_record;
pub use crate::record::{Field, FileField, FileType, GlslType, Record, RecordLayout};
pub use crate::tracing::*;

gpu_record! {
    /// Per-frame constants: set 0, binding 0, std140.
    pub struct GlobalUniform: 928 {
        /// World to view.
        pub view: [[f32; 4]; 4] = 0,
        /// View to clip, reverse-Z, infinite far plane.
        pub projection: [[f32; 4]; 4] = 64,
        /// World to clip.
        pub view_projection: [[f32; 4]; 4] = 128,
        /// Clip to world.
        pub inv_view_projection: [[f32; 4]; 4] = 192,
        /// xyz world position of the camera, w linear exposure `2^EV`.
        pub camera_position_and_exposure: [f32; 4] = 256,
        /// Render size in pixels.
        pub screen_size: [f32; 2] = 272,
        /// Seconds since start; 0 in headless runs.
        pub time: f32 = 280,
        /// Records in the directional light buffer.
        pub directional_light_count: u32 = 284,
        /// Multiplier of image-based light: the setting times the environment's scale.
        pub ibl_intensity: f32 = 288,
        /// Cubemap slot storing E/pi; [`NO_TEXTURE`] when absent.
        pub irradiance_cubemap_index: u32 = 292,
        /// Cubemap slot of the GGX-prefiltered chain.
        pub prefiltered_cubemap_index: u32 = 296,
        /// 2D slot of the BRDF table.
        pub brdf_lut_index: u32 = 300,
        /// Levels of the prefiltered chain; level = roughness * (count - 1).
        pub prefiltered_mip_count: u32 = 304,
        /// Cubemap slot of the sky.
        pub skybox_cubemap_index: u32 = 308,
        /// Sine of the environment's yaw.
        pub ibl_rotation_sin: f32 = 312,
        /// Cosine of the environment's yaw.
        pub ibl_rotation_cos: f32 = 316,
        /// Debug view; 0 is the full image.
        pub debug_render_mode: u32 = 320,
        /// Bits of the `FEATURE_*` constants.
        pub feature_flags: u32 = 324,
        /// Active cascades; 0 without shadows.
        pub shadow_cascade_count: u32 = 328,
        /// Normal offset in shadow texels.
        pub shadow_normal_offset: f32 = 332,
        /// 1 / shadow map resolution.
        pub shadow_texel_size: f32 = 336,
        /// Metres.
        pub shadow_max_distance: f32 = 340,
        /// Fraction of a split distance over which cascades blend.
        pub shadow_blend_width: f32 = 344,
        /// PCF radius in texels, 0..=5.
        pub shadow_pcf_radius: u32 = 348,
        /// World to light clip.
        pub cascade_view_proj: [[[f32; 4]; 4]; 4] = 352,
        /// Far boundary of each cascade, metres of view depth.
        pub cascade_splits: [f32; 4] = 608,
        /// Fraction of the distance over which shadows fade.
        pub shadow_distance_fade_width: f32 = 624,
        /// Zero.
        pub pad_628: u32 = 628,
        /// Zero.
        pub pad_632: u32 = 632,
        /// Zero.
        pub pad_636: u32 = 636,
        /// Metres per shadow texel of each cascade.
        pub cascade_texel_world_size: [f32; 4] = 640,
        /// 0 PCF, 1 PCSS.
        pub shadow_mode: u32 = 656,
        /// Bit 0: all-blockers early-out.
        pub pcss_flags: u32 = 660,
        /// Blocker search taps.
        pub pcss_blocker_samples: u32 = 664,
        /// Filter taps.
        pub pcss_pcf_samples: u32 = 668,
        /// Light size in shadow UV of each cascade.
        pub cascade_light_size_uv: [f32; 4] = 672,
        /// NDC depth difference to penumbra UV of each cascade.
        pub cascade_pcss_scale: [f32; 4] = 688,
        /// Width over height of each cascade.
        pub cascade_uv_scale_y: [f32; 4] = 704,
        /// Clip to view.
        pub inv_projection: [[f32; 4]; 4] = 720,
        /// World to clip of the previous frame.
        pub prev_view_projection: [[f32; 4]; 4] = 784,
        /// Frames since start.
        pub frame_index: u32 = 848,
        /// Specular occlusion: 0 Lagarde, 1 GTSO.
        pub ao_so_mode: u32 = 852,
        /// Zero.
        pub pad_856: u32 = 856,
        /// Zero.
        pub pad_860: u32 = 860,
        /// View to world.
        pub inv_view: [[f32; 4]; 4] = 864,
    }
}

gpu_record! {
    /// Set 0, binding 1.
    pub struct DirectionalLight: 32 {
        /// xyz direction of travel (light to scene, unit), w intensity in lux.
        pub direction_and_intensity: [f32; 4] = 0,
        /// xyz linear colour, w 1 where the light casts shadows, else 0.
        pub color_and_shadow: [f32; 4] = 16,
    }
}

gpu_record! {
    /// A point or spot light (`KHR_lights_punctual`): set 0, binding 11. At distance `d` it irradiates with
    /// `color / d^2 * max(0, min(1, 1 - (d / range)^4)) * clamp(spot_scale * c + spot_offset, 0, 1)^2`, where `c` is
    /// the cosine between the light's direction and that to the receiver; a point light has scale 0 and offset 1.
    pub struct PunctualLight: 64 {
        /// xyz world position, w range in metres; 0 is unlimited.
        pub position_and_range: [f32; 4] = 0,
        /// xyz direction of travel (unit), w factor of the cosine.
        pub direction_and_spot_scale: [f32; 4] = 16,
        /// xyz linear colour times candela, w 1 where the light casts shadows, else 0.
        pub color_and_shadow: [f32; 4] = 32,
        /// Added to the scaled cosine.
        pub spot_offset: f32 = 48,
        /// Zero.
        pub pad_52: u32 = 52,
        /// Zero.
        pub pad_56: u32 = 56,
        /// Zero.
        pub pad_60: u32 = 60,
    }
}

gpu_record! {
    /// Set 0, binding 2. A texture reference is a 2D slot in the low 31 bits; bit 31 ([`TEXTURE_UV1`]) selects
    /// the second texture coordinates; [`NO_TEXTURE`] is "no texture": the factor alone counts.
    pub struct Material: 80 {
        /// Linear RGBA.
        pub base_color_factor: [f32; 4] = 0,
        /// Linear RGB with the emissive strength folded in; w is zero.
        pub emissive_factor: [f32; 4] = 16,
        /// 0..=1.
        pub metallic_factor: f32 = 32,
        /// Perceptual, 0..=1.
        pub roughness_factor: f32 = 36,
        /// Scales the x and y of the normal map.
        pub normal_scale: f32 = 40,
        /// 0..=1.
        pub occlusion_strength: f32 = 44,
        /// Texture reference, sRGB colour and linear alpha.
        pub base_color_tex: u32 = 48,
        /// Texture reference, sRGB colour.
        pub emissive_tex: u32 = 52,
        /// Texture reference, G roughness and B metallic.
        pub metallic_roughness_tex: u32 = 56,
        /// Texture reference, x and y; z is rebuilt.
        pub normal_tex: u32 = 60,
        /// Texture reference, R.
        pub occlusion_tex: u32 = 64,
        /// Alpha below this is cut in mode 1.
        pub alpha_cutoff: f32 = 68,
        /// 0 opaque, 1 mask, 2 blend.
        pub alpha_mode: u32 = 72,
        /// Bits of the `MATERIAL_*` constants; a double-sided lit material holds 1.
        pub double_sided: u32 = 76,
    }
}

gpu_record! {
    /// What `KHR_materials_clearcoat`, `specular`, `ior` and `sheen` add to the material of the same index: set 0,
    /// binding 12. Texture references as in [`Material`].
    pub struct MaterialExtension: 80 {
        /// Linear RGB, 0..=1; black is no sheen.
        pub sheen_color: [f32; 3] = 0,
        /// Perceptual, 0..=1.
        pub sheen_roughness: f32 = 12,
        /// Linear RGB; tints the dielectric's reflection at normal incidence.
        pub specular_color: [f32; 3] = 16,
        /// Strength of the dielectric's reflection, 0..=1.
        pub specular_factor: f32 = 28,
        /// Reflectance of the dielectric at normal incidence, `((ior - 1) / (ior + 1))^2`.
        pub dielectric_f0: f32 = 32,
        /// 0..=1; 0 is no coat.
        pub clearcoat_factor: f32 = 36,
        /// Perceptual, 0..=1.
        pub clearcoat_roughness: f32 = 40,
        /// Scales the x and y of the coat's normal map.
        pub clearcoat_normal_scale: f32 = 44,
        /// Texture reference, R.
        pub clearcoat_tex: u32 = 48,
        /// Texture reference, G.
        pub clearcoat_roughness_tex: u32 = 52,
        /// Texture reference, x and y; z is rebuilt.
        pub clearcoat_normal_tex: u32 = 56,
        /// Texture reference, A.
        pub specular_tex: u32 = 60,
        /// Texture reference, sRGB colour.
        pub specular_color_tex: u32 = 64,
        /// Texture reference, sRGB colour.
        pub sheen_color_tex: u32 = 68,
        /// Texture reference, A.
        pub sheen_roughness_tex: u32 = 72,
        /// Bits of the `LOBE_*` constants.
        pub lobes: u32 = 76,
    }
}

gpu_record! {
    /// One drawn primitive of one node: set 0, binding 3.
    pub struct Instance: 128 {
        /// Object to world.
        pub model: [[f32; 4]; 4] = 0,
        /// Columns of the normal matrix: cofactors of the model matrix's 3x3 times the sign of its
        /// determinant, scaled to a largest element of 1; w is zero.
        pub normal_matrix: [[f32; 4]; 3] = 64,
        /// Index into the material records.
        pub material_index: u32 = 112,
        /// Zero.
        pub pad_116: u32 = 116,
        /// Zero.
        pub pad_120: u32 = 120,
        /// Zero.
        pub pad_124: u32 = 124,
    }
}

gpu_record! {
    /// Push constants of the shadow pass.
    pub struct ShadowPush: 4 {
        /// Cascade drawn.
        pub cascade_index: u32 = 0,
    }
}

gpu_record! {
    /// Push constants of GTAO.
    pub struct GtaoPush: 12 {
        /// Metres.
        pub radius: f32 = 0,
        /// How much farther an occluder counts that stands out towards the camera: it may be thin.
        pub thin_compensation: f32 = 4,
        /// 0..64, or 0 without a filter over time.
        pub noise_frame: u32 = 8,
    }
}

gpu_record! {
    /// Push constants of the temporal AO filter.
    pub struct AoTemporalPush: 8 {
        /// Largest weight of the history, below 1.
        pub weight: f32 = 0,
        /// 1 where the last frame wrote the history.
        pub valid: u32 = 4,
    }
}

gpu_record! {
    /// Push constants of contact shadows.
    pub struct ContactPush: 12 {
        /// Longest ray, metres.
        pub reach: f32 = 0,
        /// How far behind a surface a ray is still taken to be inside of it, metres.
        pub thickness: f32 = 4,
        /// Steps per ray.
        pub steps: u32 = 8,
    }
}

gpu_record! {
    /// One indexed draw of the static scene; instances of a group are contiguous.
    pub struct DrawGroup: 32 {
        /// First index in the index arena.
        pub first_index: u32 = 0,
        /// Indices, a multiple of three.
        pub index_count: u32 = 4,
        /// Added to every index.
        pub vertex_offset: u32 = 8,
        /// First record in the instance section.
        pub first_instance: u32 = 12,
        /// Instances.
        pub instance_count: u32 = 16,
        /// Index into the root's primitives.
        pub primitive: u32 = 20,
        /// 0 opaque, 1 mask, 2 blend.
        pub alpha_mode: u32 = 24,
        /// Bits of the `DRAW_*` constants.
        pub flags: u32 = 28,
    }
}

gpu_record! {
    /// Transform of the texture coordinates of one 2D slot: set 0, binding 9 (`KHR_texture_transform`).
    pub struct TextureTransform: 32 {
        /// Columns of a 2x2 matrix: `uv' = matrix * uv + offset`.
        pub matrix: [f32; 4] = 0,
        /// Added after the matrix.
        pub offset: [f32; 2] = 16,
        /// Zero.
        pub pad_24: u32 = 24,
        /// Zero.
        pub pad_28: u32 = 28,
    }
}

gpu_record! {
    /// Colour of one vertex, four 16-bit unsigned normalised channels: set 0, binding 10.
    pub struct VertexColor: 8 {
        /// Red in the low half, green in the high half; linear.
        pub red_green: u32 = 0,
        /// Blue in the low half, alpha in the high half.
        pub blue_alpha: u32 = 4,
    }
}

gpu_record! {
    /// Push constants of the spatial AO filter.
    pub struct AoSpatialPush: 4 {
        /// Exponent of the visibility.
        pub intensity: f32 = 0,
    }
}

gpu_record! {
    /// Push constants of what shades from the visibility target.
    pub struct VisiblePush: 20 {
        /// Records in the draw group buffer, in ascending order of their instances.
        pub draw_groups: u32 = 0,
        /// Pixels that the layer of blended surfaces covers: left, top, right, bottom; all 0 without one.
        pub layer: [u32; 4] = 4,
    }
}

/// A texture reference that names no texture.
pub const NO_TEXTURE: u32 = u32::MAX;
/// Bit of a texture reference: sample with the second texture coordinates.
pub const TEXTURE_UV1: u32 = 1 << 31;
/// Bit of [`Material::double_sided`]: no back-face culling.
pub const MATERIAL_DOUBLE_SIDED: u32 = 1;
/// Bit of [`Material::double_sided`]: base colour is emitted as it is, without light.
pub const MATERIAL_UNLIT: u32 = 2;
/// Bit of [`MaterialExtension::lobes`]: there is a clear coat.
pub const LOBE_CLEARCOAT: u32 = 1;
/// Bit of [`MaterialExtension::lobes`]: the dielectric's reflection is not glTF's default.
pub const LOBE_SPECULAR: u32 = 2;
/// Bit of [`MaterialExtension::lobes`]: there is sheen.
pub const LOBE_SHEEN: u32 = 4;
/// `alpha_mode` of opaque materials.
pub const ALPHA_OPAQUE: u32 = 0;
/// `alpha_mode` of materials cut at a threshold.
pub const ALPHA_MASK: u32 = 1;
/// `alpha_mode` of blended materials.
pub const ALPHA_BLEND: u32 = 2;
/// Bit of draw flags: no back-face culling.
pub const DRAW_DOUBLE_SIDED: u32 = 1;
/// Bit of draw flags: negative determinant, front faces are clockwise.
pub const DRAW_MIRRORED: u32 = 2;
/// A mesh instance or geometry that lists no emissive triangle.
pub const NO_EMISSION: u32 = u32::MAX;
/// Bit of [`PathTracePush::sampled_lights`]: the environment.
pub const LIGHT_ENVIRONMENT: u32 = 1;
/// Bit of [`PathTracePush::sampled_lights`]: the environment's sun.
pub const LIGHT_SUN: u32 = 2;
/// Bit of [`PathTracePush::sampled_lights`]: directional, point and spot lights.
pub const LIGHT_PUNCTUAL: u32 = 4;
/// Bit of [`PathTracePush::sampled_lights`]: emissive triangles.
pub const LIGHT_EMITTERS: u32 = 8;
/// Bit of [`GlobalUniform::feature_flags`]: shadow maps are valid.
pub const FEATURE_SHADOWS: u32 = 1;
/// Bit of [`GlobalUniform::feature_flags`]: ambient occlusion is valid.
pub const FEATURE_AO: u32 = 2;
/// Bit of [`GlobalUniform::feature_flags`]: the contact shadow mask is valid.
pub const FEATURE_CONTACT_SHADOWS: u32 = 4;

/// Name and value of every constant that shaders share.
pub const CONSTANTS: &[(&str, u32)] = &[
    ("NO_TEXTURE", NO_TEXTURE),
    ("TEXTURE_UV1", TEXTURE_UV1),
    ("MATERIAL_DOUBLE_SIDED", MATERIAL_DOUBLE_SIDED),
    ("MATERIAL_UNLIT", MATERIAL_UNLIT),
    ("LOBE_CLEARCOAT", LOBE_CLEARCOAT),
    ("LOBE_SPECULAR", LOBE_SPECULAR),
    ("LOBE_SHEEN", LOBE_SHEEN),
    ("ALPHA_OPAQUE", ALPHA_OPAQUE),
    ("ALPHA_MASK", ALPHA_MASK),
    ("ALPHA_BLEND", ALPHA_BLEND),
    ("DRAW_DOUBLE_SIDED", DRAW_DOUBLE_SIDED),
    ("DRAW_MIRRORED", DRAW_MIRRORED),
    ("NO_EMISSION", NO_EMISSION),
    ("LIGHT_ENVIRONMENT", LIGHT_ENVIRONMENT),
    ("LIGHT_SUN", LIGHT_SUN),
    ("LIGHT_PUNCTUAL", LIGHT_PUNCTUAL),
    ("LIGHT_EMITTERS", LIGHT_EMITTERS),
    ("FEATURE_SHADOWS", FEATURE_SHADOWS),
    ("FEATURE_AO", FEATURE_AO),
    ("FEATURE_CONTACT_SHADOWS", FEATURE_CONTACT_SHADOWS),
    ("BRDF_TABLE_SIZE", BRDF_TABLE_SIZE),
];

/// Name and value of every number with a fraction that shaders share.
pub const NUMBERS: &[(&str, f32)] = &[("MIN_LIGHT_ROUGHNESS", MIN_LIGHT_ROUGHNESS)];

/// Name, size and fields of every record, in declaration order.
pub fn records() -> Vec<(&'static str, usize, &'static [Field])> {
    fn row<T: Record>() -> (&'static str, usize, &'static [Field]) {
        (T::NAME, size_of::<T>(), T::FIELDS)
    }
    vec![
        row::<crate::Vertex>(),
        row::<GlobalUniform>(),
        row::<DirectionalLight>(),
        row::<Material>(),
        row::<Instance>(),
        row::<GeometryInfo>(),
        row::<EnvAliasEntry>(),
        row::<EnvAliasHeader>(),
        row::<EmissiveTriangle>(),
        row::<EmissiveAliasEntry>(),
        row::<EmissiveAliasHeader>(),
        row::<ShadowPush>(),
        row::<GtaoPush>(),
        row::<AoTemporalPush>(),
        row::<ContactPush>(),
        row::<PathTracePush>(),
        row::<DrawGroup>(),
        row::<MeshInstance>(),
        row::<TextureTransform>(),
        row::<VertexColor>(),
        row::<PunctualLight>(),
        row::<MaterialExtension>(),
        row::<AoSpatialPush>(),
        row::<VisiblePush>(),
    ]
}

impl Default for GlobalUniform {
    fn default() -> Self {
        Self::zeroed()
    }
}

impl Default for Material {
    /// glTF's default material without textures.
    fn default() -> Self {
        Self {
            base_color_factor: [1.0; 4],
            emissive_factor: [0.0; 4],
            metallic_factor: 1.0,
            roughness_factor: 1.0,
            normal_scale: 1.0,
            occlusion_strength: 1.0,
            base_color_tex: NO_TEXTURE,
            emissive_tex: NO_TEXTURE,
            metallic_roughness_tex: NO_TEXTURE,
            normal_tex: NO_TEXTURE,
            occlusion_tex: NO_TEXTURE,
            alpha_cutoff: 0.5,
            alpha_mode: ALPHA_OPAQUE,
            double_sided: 0,
        }
    }
}

impl Default for MaterialExtension {
    /// No coat, no sheen, an index of refraction of 1.5.
    fn default() -> Self {
        Self {
            sheen_color: [0.0; 3],
            sheen_roughness: 0.0,
            specular_color: [1.0; 3],
            specular_factor: 1.0,
            dielectric_f0: 0.04,
            clearcoat_factor: 0.0,
            clearcoat_roughness: 0.0,
            clearcoat_normal_scale: 1.0,
            clearcoat_tex: NO_TEXTURE,
            clearcoat_roughness_tex: NO_TEXTURE,
            clearcoat_normal_tex: NO_TEXTURE,
            specular_tex: NO_TEXTURE,
            specular_color_tex: NO_TEXTURE,
            sheen_color_tex: NO_TEXTURE,
            sheen_roughness_tex: NO_TEXTURE,
            lobes: 0,
        }
    }
}
