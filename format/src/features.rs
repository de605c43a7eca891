//! Bits of `Scene::features`: what a scene contains, so that a player builds nothing else.

/// Some material cuts by alpha.
pub const MASK: u32 = 1 << 0;
/// Some material blends.
pub const BLEND: u32 = 1 << 1;
/// Some material is double-sided.
pub const DOUBLE_SIDED: u32 = 1 << 2;
/// Some instance has a negative determinant.
pub const MIRRORED: u32 = 1 << 3;
/// Some material has a normal map; tangents are present where it is used.
pub const NORMAL_MAPS: u32 = 1 << 4;
/// Some material emits.
pub const EMISSIVE: u32 = 1 << 5;
/// Some material samples with the second texture coordinates.
pub const UV1: u32 = 1 << 6;
/// The directional light section is present.
pub const DIRECTIONAL_LIGHTS: u32 = 1 << 7;
/// An environment is present.
pub const ENVIRONMENT: u32 = 1 << 8;
/// Some material has a texture.
pub const TEXTURES: u32 = 1 << 9;
/// Some material is unlit.
pub const UNLIT: u32 = 1 << 10;

/// The texture transform section is present.
pub const TEXTURE_TRANSFORMS: u32 = 1 << 11;
/// The vertex colour section is present.
pub const VERTEX_COLORS: u32 = 1 << 12;

/// The section of point and spot lights is present.
pub const PUNCTUAL_LIGHTS: u32 = 1 << 13;
/// Some material has a clear coat.
pub const CLEARCOAT: u32 = 1 << 14;
/// The reflection of some dielectric is not glTF's default.
pub const SPECULAR: u32 = 1 << 15;
/// Some material has sheen.
pub const SHEEN: u32 = 1 << 16;

/// The environment's sun was taken out of its cubes.
pub const SUN: u32 = 1 << 17;

/// Name of every bit, lowest first.
pub const NAMES: [(u32, &str); 18] = [
    (MASK, "mask"),
    (BLEND, "blend"),
    (DOUBLE_SIDED, "double-sided"),
    (MIRRORED, "mirrored"),
    (NORMAL_MAPS, "normal-maps"),
    (EMISSIVE, "emissive"),
    (UV1, "uv1"),
    (DIRECTIONAL_LIGHTS, "directional-lights"),
    (ENVIRONMENT, "environment"),
    (TEXTURES, "textures"),
    (UNLIT, "unlit"),
    (TEXTURE_TRANSFORMS, "texture-transforms"),
    (VERTEX_COLORS, "vertex-colors"),
    (PUNCTUAL_LIGHTS, "punctual-lights"),
    (CLEARCOAT, "clearcoat"),
    (SPECULAR, "specular"),
    (SHEEN, "sheen"),
    (SUN, "sun"),
];

/// Bits that have a meaning.
pub const ALL: u32 = (1 << NAMES.len()) - 1;

/// Names of the bits set in `bits`.
pub fn names(bits: u32) -> Vec<&'static str> {
    let set = NAMES.iter().filter(|(bit, _)| bits & bit != 0);
    set.map(|(_, name)| *name).collect()
}
