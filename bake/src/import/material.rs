//! Reads materials (glTF 2.0 section 3.9) with their values brought into range.

use glam::{Vec3, Vec4};
use gltf::json;
use gltf::json::material::AlphaMode as AlphaModeJson;
use gltf::json::validation::Checked;

use crate::diagnostic::Result;
use crate::scene::{AlphaMode, Material, TextureRef, UvTransform};

use super::context::Context;

/// Reads material `index`. Texture references still carry glTF indices.
///
/// # Errors
/// A missing texture or an unknown alpha mode.
pub(super) fn read(context: &Context, index: u32) -> Result<Material> {
    let material = &context.document.materials[index as usize];
    let reader = Reader {
        context,
        pointer: format!("/materials/{index}"),
    };
    let pbr = &material.pbr_metallic_roughness;
    let normal = material.normal_texture.as_ref();
    let occlusion = material.occlusion_texture.as_ref();
    let extensions = material.extensions.as_ref();
    let in_pbr = |name: &str| format!("pbrMetallicRoughness/{name}");
    Ok(Material {
        name: material
            .name
            .clone()
            .unwrap_or_else(|| format!("material {index}")),
        base_color: Vec4::from_array(
            pbr.base_color_factor
                .0
                .map(|value| reader.within("baseColorFactor", value, 0.0, 1.0)),
        ),
        emissive: reader.emissive(material),
        metallic: reader.within("metallicFactor", pbr.metallic_factor.0, 0.0, 1.0),
        roughness: reader.within("roughnessFactor", pbr.roughness_factor.0, 0.0, 1.0),
        normal_scale: normal.map_or(1.0, |texture| {
            reader.within("normalTexture/scale", texture.scale, f32::MIN, f32::MAX)
        }),
        occlusion_strength: occlusion.map_or(1.0, |texture| {
            reader.within("occlusionTexture/strength", texture.strength.0, 0.0, 1.0)
        }),
        alpha_mode: reader.alpha_mode(&material.alpha_mode)?,
        alpha_cutoff: material.alpha_cutoff.map_or(0.5, |cutoff| {
            reader.within("alphaCutoff", cutoff.0, 0.0, f32::MAX)
        }),
        double_sided: material.double_sided,
        unlit: extensions.is_some_and(|extensions| extensions.unlit.is_some()),
        base_color_texture: reader
            .texture(&in_pbr("baseColorTexture"), pbr.base_color_texture.as_ref())?,
        metallic_roughness_texture: reader.texture(
            &in_pbr("metallicRoughnessTexture"),
            pbr.metallic_roughness_texture.as_ref(),
        )?,
        normal_texture: normal
            .map(|t| reader.slot("normalTexture", t.index, t.tex_coord))
            .transpose()?,
        occlusion_texture: occlusion
            .map(|t| reader.slot("occlusionTexture", t.index, t.tex_coord))
            .transpose()?,
        emissive_texture: reader.texture("emissiveTexture", material.emissive_texture.as_ref())?,
    })
}

struct Reader<'a> {
    context: &'a Context,
    pointer: String,
}

impl Reader<'_> {
    /// Clamps a factor, with a warning where that changes it.
    fn within(&self, property: &str, value: f32, low: f32, high: f32) -> f32 {
        let clamped = value.clamp(low, high);
        if clamped != value {
            let pointer = format!("{}/{property}", self.pointer);
            let message = format!("{value} is out of range; {clamped} is used");
            self.context
                .warn_group("material-value", property, pointer, message);
        }
        clamped
    }

    fn emissive(&self, material: &json::Material) -> Vec3 {
        let extensions = material.extensions.as_ref();
        let strength = extensions
            .and_then(|extensions| extensions.emissive_strength.as_ref())
            .map_or(1.0, |extension| extension.emissive_strength.0);
        let strength = self.within("emissiveStrength", strength, 0.0, f32::MAX);
        let factor = material.emissive_factor.0;
        let color = factor.map(|value| self.within("emissiveFactor", value, 0.0, 1.0));
        Vec3::from_array(color) * strength
    }

    fn alpha_mode(&self, mode: &Checked<AlphaModeJson>) -> Result<AlphaMode> {
        match mode {
            Checked::Valid(AlphaModeJson::Opaque) => Ok(AlphaMode::Opaque),
            Checked::Valid(AlphaModeJson::Mask) => Ok(AlphaMode::Mask),
            Checked::Valid(AlphaModeJson::Blend) => Ok(AlphaMode::Blend),
            Checked::Invalid => {
                let pointer = format!("{}/alphaMode", self.pointer);
                let message = "the alpha mode is none of OPAQUE, MASK, BLEND; export again";
                Err(self.context.error("material-alpha-mode", pointer, message))
            }
        }
    }

    fn texture(
        &self,
        property: &str,
        texture: Option<&json::texture::Info>,
    ) -> Result<Option<TextureRef>> {
        texture
            .map(|texture| self.slot(property, texture.index, texture.tex_coord))
            .transpose()
    }

    fn slot(
        &self,
        property: &str,
        texture: json::Index<json::Texture>,
        set: u32,
    ) -> Result<TextureRef> {
        let pointer = format!("{}/{property}", self.pointer);
        let textures = self.context.document.textures.len();
        if texture.value() >= textures {
            let pointer = format!("{pointer}/index");
            return Err(self
                .context
                .absent(pointer, "texture", texture.value(), textures));
        }
        if set > 1 {
            let message = format!("TEXCOORD_{set} is not supported; TEXCOORD_0 is used");
            self.context
                .warn("texcoord-set", format!("{pointer}/texCoord"), message);
        }
        Ok(TextureRef {
            texture: texture.value() as u32,
            uv_set: if set == 1 { 1 } else { 0 },
            transform: UvTransform::IDENTITY,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::testing::{context, fault};

    #[test]
    fn defaults_are_those_of_the_specification() {
        let material = read(&context(r#""materials":[{"name":""}]"#), 0).unwrap();
        let expected = Material::default();
        assert_eq!(format!("{material:?}"), format!("{expected:?}"));
    }

    #[test]
    fn values_are_clamped_with_a_warning() {
        let context = context(
            r#""materials":[{"alphaMode":"MASK","alphaCutoff":-1,"emissiveFactor":[2,0.5,-1],
            "pbrMetallicRoughness":{"metallicFactor":7,"roughnessFactor":-0.5,
                "baseColorFactor":[1,1e39,0,0.25]},
            "extensions":{"KHR_materials_emissive_strength":{"emissiveStrength":10},
                "KHR_materials_unlit":{}}}]"#,
        );
        let material = read(&context, 0).unwrap();
        assert_eq!((material.metallic, material.roughness), (1.0, 0.0));
        assert_eq!(material.base_color, Vec4::new(1.0, 1.0, 0.0, 0.25));
        assert_eq!(material.emissive, Vec3::new(10.0, 5.0, 0.0));
        assert_eq!(
            (material.alpha_mode, material.alpha_cutoff),
            (AlphaMode::Mask, 0.0)
        );
        assert!(material.unlit);
        assert_eq!(context.finish().1.len(), 5);
    }

    #[test]
    fn texture_slots_are_read_and_checked() {
        let body = |index: u32, set: u32| {
            format!(
                r#""textures":[{{}}],"materials":[{{"normalTexture":{{"index":{index},"texCoord":{set},"scale":2}},
                "occlusionTexture":{{"index":0,"texCoord":1,"strength":0.5}}}}]"#
            )
        };
        let context_of = |index, set| context(&body(index, set));
        let context = context_of(0, 2);
        let material = read(&context, 0).unwrap();
        let slot = |uv_set| Some(TextureRef::new(0, uv_set));
        assert_eq!(material.normal_texture, slot(0));
        assert_eq!(material.occlusion_texture, slot(1));
        assert_eq!(
            (material.normal_scale, material.occlusion_strength),
            (2.0, 0.5)
        );
        assert_eq!(context.finish().1[0].code, "texcoord-set");
        let error = fault(read(&context_of(1, 0), 0));
        assert_eq!(error.place, "/materials/0/normalTexture/index");
    }

    #[test]
    fn unknown_alpha_modes_are_refused() {
        let context = context(r#""materials":[{"alphaMode":"SOFT"}]"#);
        assert_eq!(fault(read(&context, 0)).code, "material-alpha-mode");
    }
}
