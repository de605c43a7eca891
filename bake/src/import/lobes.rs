//! Reads the extensions that add lobes to a material: clearcoat, specular, ior, sheen.

use glam::Vec3;
use gltf::json;
use gltf::json::material::NormalTexture;
use serde::Deserialize;
use serde::de::DeserializeOwned;

use crate::diagnostic::Result;
use crate::scene::Lobes;

use super::context::Context;
use super::extension;

/// `KHR_materials_clearcoat`.
#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Clearcoat {
    clearcoat_factor: f32,
    pub clearcoat_texture: Option<json::texture::Info>,
    clearcoat_roughness_factor: f32,
    pub clearcoat_roughness_texture: Option<json::texture::Info>,
    pub clearcoat_normal_texture: Option<NormalTexture>,
}

/// `KHR_materials_specular`.
#[derive(Debug, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Specular {
    specular_factor: f32,
    pub specular_texture: Option<json::texture::Info>,
    specular_color_factor: [f32; 3],
    pub specular_color_texture: Option<json::texture::Info>,
}

impl Default for Specular {
    fn default() -> Self {
        Self {
            specular_factor: 1.0,
            specular_texture: None,
            specular_color_factor: [1.0; 3],
            specular_color_texture: None,
        }
    }
}

/// `KHR_materials_ior`.
#[derive(Debug, Deserialize)]
#[serde(default)]
struct Ior {
    ior: f32,
}

impl Default for Ior {
    fn default() -> Self {
        Self { ior: 1.5 }
    }
}

/// `KHR_materials_sheen`.
#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Sheen {
    sheen_color_factor: [f32; 3],
    pub sheen_color_texture: Option<json::texture::Info>,
    sheen_roughness_factor: f32,
    pub sheen_roughness_texture: Option<json::texture::Info>,
}

/// The extensions of one material; absent ones have their defaults, which change nothing.
#[derive(Debug, Default)]
pub(super) struct LobesJson {
    pub clearcoat: Clearcoat,
    pub specular: Specular,
    ior: Ior,
    pub sheen: Sheen,
}

impl LobesJson {
    /// Reads the extensions of material `index`. An unlit material has none (`KHR_materials_unlit`).
    ///
    /// # Errors
    /// A property of the wrong type.
    pub fn read(context: &Context, index: u32) -> Result<Self> {
        let material = &context.document.materials[index as usize];
        let Some(extensions) = &material.extensions else {
            return Ok(Self::default());
        };
        if extensions.unlit.is_some() {
            return Ok(Self::default());
        }
        let others = &extensions.others;
        Ok(Self {
            clearcoat: parse(context, index, others, "KHR_materials_clearcoat")?,
            specular: parse(context, index, others, "KHR_materials_specular")?,
            ior: parse(context, index, others, "KHR_materials_ior")?,
            sheen: parse(context, index, others, "KHR_materials_sheen")?,
        })
    }

    /// Every number, brought into range by `within(property, value, low, high)`; no textures.
    pub fn factors(&self, within: &dyn Fn(&str, f32, f32, f32) -> f32) -> Lobes {
        let unit = |property: &str, value| within(property, value, 0.0, 1.0);
        let (coat, specular, sheen) = (&self.clearcoat, &self.specular, &self.sheen);
        let color = |property, color: [f32; 3], high| {
            Vec3::from_array(color.map(|value| within(property, value, 0.0, high)))
        };
        Lobes {
            clearcoat: unit("clearcoatFactor", coat.clearcoat_factor),
            clearcoat_roughness: unit("clearcoatRoughnessFactor", coat.clearcoat_roughness_factor),
            clearcoat_normal_scale: coat.clearcoat_normal_texture.as_ref().map_or(1.0, |map| {
                within(
                    "clearcoatNormalTexture/scale",
                    map.scale,
                    f32::MIN,
                    f32::MAX,
                )
            }),
            // Zero is allowed: it makes the dielectric reflect everything.
            ior: match self.ior.ior {
                0.0 => 0.0,
                ior => within("ior", ior, 1.0, f32::MAX),
            },
            specular: unit("specularFactor", specular.specular_factor),
            specular_color: color(
                "specularColorFactor",
                specular.specular_color_factor,
                f32::MAX,
            ),
            sheen_color: color("sheenColorFactor", sheen.sheen_color_factor, 1.0),
            sheen_roughness: unit("sheenRoughnessFactor", sheen.sheen_roughness_factor),
            ..Lobes::default()
        }
    }
}

fn parse<T: Default + DeserializeOwned>(
    context: &Context,
    index: u32,
    others: &serde_json::Map<String, serde_json::Value>,
    name: &str,
) -> Result<T> {
    let Some(value) = others.get(name) else {
        return Ok(T::default());
    };
    let pointer = format!("/materials/{index}/extensions/{name}");
    extension::parse(context, value, &pointer)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::material::read;
    use crate::import::testing::{context, fault};
    use crate::scene::TextureRef;

    fn material(extensions: &str) -> Context {
        context(&format!(
            r#""textures":[{{}},{{}}],"materials":[{{"extensions":{{{extensions}}}}}]"#
        ))
    }

    #[test]
    fn every_property_is_read() {
        let context = material(
            r#""KHR_materials_clearcoat":{"clearcoatFactor":0.5,"clearcoatTexture":{"index":1},
            "clearcoatRoughnessFactor":0.25,"clearcoatRoughnessTexture":{"index":0,"texCoord":1},
            "clearcoatNormalTexture":{"index":1,"scale":2,"extensions":{"KHR_texture_transform":{"scale":[2,2]}}}},
            "KHR_materials_specular":{"specularFactor":0.75,"specularTexture":{"index":0},
            "specularColorFactor":[1,2,0.5],"specularColorTexture":{"index":1}},
            "KHR_materials_ior":{"ior":1.25},
            "KHR_materials_sheen":{"sheenColorFactor":[0.5,0.25,1],"sheenColorTexture":{"index":0},
            "sheenRoughnessFactor":0.3,"sheenRoughnessTexture":{"index":1}}"#,
        );
        let lobes = read(&context, 0).unwrap().lobes;
        let texture = |index, set| Some(TextureRef::new(index, set));
        let expected = Lobes {
            clearcoat: 0.5,
            clearcoat_roughness: 0.25,
            clearcoat_normal_scale: 2.0,
            ior: 1.25,
            specular: 0.75,
            specular_color: Vec3::new(1.0, 2.0, 0.5),
            sheen_color: Vec3::new(0.5, 0.25, 1.0),
            sheen_roughness: 0.3,
            clearcoat_texture: texture(1, 0),
            clearcoat_roughness_texture: texture(0, 1),
            clearcoat_normal_texture: lobes.clearcoat_normal_texture,
            specular_texture: texture(0, 0),
            specular_color_texture: texture(1, 0),
            sheen_color_texture: texture(0, 0),
            sheen_roughness_texture: texture(1, 0),
        };
        assert_eq!(lobes, expected);
        let transform = lobes.clearcoat_normal_texture.unwrap().transform;
        assert_eq!(transform.matrix, [2.0, 0.0, 0.0, 2.0]);
        assert!(context.finish().1.is_empty());
    }

    #[test]
    fn values_are_clamped_with_a_warning() {
        let context = material(
            r#""KHR_materials_clearcoat":{"clearcoatFactor":7},"KHR_materials_ior":{"ior":0.5},
            "KHR_materials_specular":{"specularColorFactor":[-1,1,9]}"#,
        );
        let lobes = read(&context, 0).unwrap().lobes;
        assert_eq!((lobes.clearcoat, lobes.ior), (1.0, 1.0));
        assert_eq!(lobes.specular_color, Vec3::new(0.0, 1.0, 9.0));
        assert_eq!(context.finish().1.len(), 3);
        let mirror = material(r#""KHR_materials_ior":{"ior":0}"#);
        assert_eq!(read(&mirror, 0).unwrap().lobes.ior, 0.0);
        assert!(mirror.finish().1.is_empty());
    }

    #[test]
    fn unlit_materials_have_no_lobes() {
        let context = material(
            r#""KHR_materials_unlit":{},"KHR_materials_clearcoat":{"clearcoatFactor":1,
            "clearcoatTexture":{"index":0}}"#,
        );
        assert_eq!(read(&context, 0).unwrap().lobes, Lobes::default());
    }

    #[test]
    fn malformed_extensions_are_refused() {
        let context = material(r#""KHR_materials_sheen":{"sheenRoughnessFactor":"soft"}"#);
        let error = fault(read(&context, 0));
        assert_eq!(error.code, "extension-schema");
        assert_eq!(error.place, "/materials/0/extensions/KHR_materials_sheen");
        let context = material(r#""KHR_materials_clearcoat":{"clearcoatTexture":{"index":9}}"#);
        let error = fault(read(&context, 0));
        assert_eq!(
            error.place,
            "/materials/0/extensions/KHR_materials_clearcoat/clearcoatTexture/index"
        );
    }
}
