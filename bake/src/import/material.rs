//! Reads materials (glTF 2.0 section 3.9) with their values brought into range.

use glam::{Vec3, Vec4};
use gltf::json;
use gltf::json::extensions::texture::TextureTransform;
use gltf::json::material::AlphaMode as AlphaModeJson;
use gltf::json::validation::Checked;

use crate::diagnostic::Result;
use crate::scene::{AlphaMode, Lobes, Material, TextureRef, UvTransform};

use super::context::Context;
use super::extension;
use super::lobes::LobesJson;
use super::uv_sets::UvSets;

/// The places of textures in a material, in the order of `super::slots`.
const SLOTS: [&str; 12] = [
    "pbrMetallicRoughness/baseColorTexture",
    "pbrMetallicRoughness/metallicRoughnessTexture",
    "normalTexture",
    "occlusionTexture",
    "emissiveTexture",
    "extensions/KHR_materials_clearcoat/clearcoatTexture",
    "extensions/KHR_materials_clearcoat/clearcoatRoughnessTexture",
    "extensions/KHR_materials_clearcoat/clearcoatNormalTexture",
    "extensions/KHR_materials_specular/specularTexture",
    "extensions/KHR_materials_specular/specularColorTexture",
    "extensions/KHR_materials_sheen/sheenColorTexture",
    "extensions/KHR_materials_sheen/sheenRoughnessTexture",
];

/// Position of the clear coat's normal map in [`SLOTS`].
const CLEARCOAT_NORMAL: usize = 7;

/// A texture as the file names it: glTF indices, `KHR_texture_transform` applied to the set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Slot {
    texture: usize,
    /// `n` of `TEXCOORD_n`.
    pub uv_set: u32,
    transform: UvTransform,
}

/// The texture slots of material `index`, in the order of `super::slots`.
///
/// # Errors
/// A malformed extension.
pub(super) fn texture_slots(context: &Context, index: u32) -> Result<[Option<Slot>; 12]> {
    const TRANSFORM: &str = "KHR_texture_transform";
    let material = &context.document.materials[index as usize];
    let pbr = &material.pbr_metallic_roughness;
    let info = |info: Option<&json::texture::Info>| {
        let info = info?;
        let extensions = info.extensions.as_ref();
        let transform = extensions.and_then(|extensions| extensions.texture_transform.as_ref());
        Some(slot(info.index, info.tex_coord, transform))
    };
    let free = |ordinal: usize, texture, set, others: Option<&serde_json::Map<_, _>>| {
        let value = others.and_then(|others| others.get(TRANSFORM));
        let pointer = format!(
            "/materials/{index}/{}/extensions/{TRANSFORM}",
            SLOTS[ordinal]
        );
        let parse = |value| extension::parse(context, value, &pointer);
        let transform: Option<TextureTransform> = value.map(parse).transpose()?;
        Ok::<_, crate::BakeError>(slot(texture, set, transform.as_ref()))
    };
    let normal = material.normal_texture.as_ref().map(|t| {
        let others = t.extensions.as_ref().map(|extensions| &extensions.others);
        free(2, t.index, t.tex_coord, others)
    });
    let occlusion = material.occlusion_texture.as_ref().map(|t| {
        let others = t.extensions.as_ref().map(|extensions| &extensions.others);
        free(3, t.index, t.tex_coord, others)
    });
    let lobes = LobesJson::read(context, index)?;
    let coat_normal = lobes.clearcoat.clearcoat_normal_texture.as_ref().map(|t| {
        let others = t.extensions.as_ref().map(|extensions| &extensions.others);
        free(CLEARCOAT_NORMAL, t.index, t.tex_coord, others)
    });
    Ok([
        info(pbr.base_color_texture.as_ref()),
        info(pbr.metallic_roughness_texture.as_ref()),
        normal.transpose()?,
        occlusion.transpose()?,
        info(material.emissive_texture.as_ref()),
        info(lobes.clearcoat.clearcoat_texture.as_ref()),
        info(lobes.clearcoat.clearcoat_roughness_texture.as_ref()),
        coat_normal.transpose()?,
        info(lobes.specular.specular_texture.as_ref()),
        info(lobes.specular.specular_color_texture.as_ref()),
        info(lobes.sheen.sheen_color_texture.as_ref()),
        info(lobes.sheen.sheen_roughness_texture.as_ref()),
    ])
}

fn slot(
    texture: json::Index<json::Texture>,
    set: u32,
    transform: Option<&TextureTransform>,
) -> Slot {
    Slot {
        texture: texture.value(),
        uv_set: transform.and_then(|t| t.tex_coord).unwrap_or(set),
        transform: transform.map_or(UvTransform::IDENTITY, |t| {
            UvTransform::new(t.offset.0, t.rotation.0, t.scale.0)
        }),
    }
}

/// Reads material `index`. Texture references still carry glTF indices.
///
/// # Errors
/// A missing texture, a malformed extension or an unknown alpha mode.
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
    let [
        base_color,
        metallic_roughness,
        normal_map,
        occlusion_map,
        emissive,
        clearcoat_texture,
        clearcoat_roughness_texture,
        clearcoat_normal_texture,
        specular_texture,
        specular_color_texture,
        sheen_color_texture,
        sheen_roughness_texture,
    ] = reader.textures(index)?;
    let within = |property: &str, value, low, high| reader.within(property, value, low, high);
    let factors = LobesJson::read(context, index)?.factors(&within);
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
        base_color_texture: base_color,
        metallic_roughness_texture: metallic_roughness,
        normal_texture: normal_map,
        occlusion_texture: occlusion_map,
        emissive_texture: emissive,
        lobes: Lobes {
            clearcoat_texture,
            clearcoat_roughness_texture,
            clearcoat_normal_texture,
            specular_texture,
            specular_color_texture,
            sheen_color_texture,
            sheen_roughness_texture,
            ..factors
        },
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

    /// The texture slots of material `index`, their sets mapped to `uv0` and `uv1`.
    fn textures(&self, index: u32) -> Result<[Option<TextureRef>; 12]> {
        let slots = texture_slots(self.context, index)?;
        let sets = UvSets::of(self.context, Some(index))?;
        if sets.surplus > 0 {
            let message = format!(
                "the textures use {} sets of coordinates; those after the second read TEXCOORD_{}",
                2 + sets.surplus,
                sets.sets[0].unwrap_or_default()
            );
            self.context.warn("texcoord-set", &self.pointer, message);
        }
        let mut references = [None; 12];
        for ((reference, slot), property) in references.iter_mut().zip(slots).zip(SLOTS) {
            *reference = slot
                .map(|slot| self.reference(property, slot, &sets))
                .transpose()?;
        }
        Ok(references)
    }

    fn reference(&self, property: &str, slot: Slot, sets: &UvSets) -> Result<TextureRef> {
        let pointer = format!("{}/{property}", self.pointer);
        let textures = self.context.document.textures.len();
        if slot.texture >= textures {
            let pointer = format!("{pointer}/index");
            return Err(self
                .context
                .absent(pointer, "texture", slot.texture, textures));
        }
        let mut transform = slot.transform;
        let values = transform.matrix.iter().chain(&transform.offset);
        if !values.into_iter().all(|value| value.is_finite()) {
            let message = "KHR_texture_transform is not finite and is left out";
            self.context.warn("texture-transform", pointer, message);
            transform = UvTransform::IDENTITY;
        }
        Ok(TextureRef {
            texture: slot.texture as u32,
            uv_set: sets.slot(slot.uv_set),
            transform,
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
                "baseColorFactor":[1,1e38,0,0.25]},
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
        let material = read(&context_of(0, 0), 0).unwrap();
        let slot = |uv_set| Some(TextureRef::new(0, uv_set));
        assert_eq!(material.normal_texture, slot(0));
        assert_eq!(material.occlusion_texture, slot(1));
        let material = read(&context_of(0, 2), 0).unwrap();
        assert_eq!(material.normal_texture, slot(1));
        assert_eq!(material.occlusion_texture, slot(0));
        assert_eq!(
            (material.normal_scale, material.occlusion_strength),
            (2.0, 0.5)
        );
        let error = fault(read(&context_of(1, 0), 0));
        assert_eq!(error.place, "/materials/0/normalTexture/index");
    }

    #[test]
    fn a_third_set_of_coordinates_falls_back_to_the_first() {
        let context = context(
            r#""textures":[{}],"materials":[{"normalTexture":{"index":0,"texCoord":5},
            "occlusionTexture":{"index":0,"texCoord":3},"emissiveTexture":{"index":0,"texCoord":9}}]"#,
        );
        let material = read(&context, 0).unwrap();
        let set = |texture: Option<TextureRef>| texture.unwrap().uv_set;
        assert_eq!(set(material.occlusion_texture), 0);
        assert_eq!(set(material.normal_texture), 1);
        assert_eq!(set(material.emissive_texture), 0);
        let warning = &context.finish().1[0];
        assert_eq!(warning.code, "texcoord-set");
        assert!(warning.message.contains("3 sets"), "{}", warning.message);
        assert!(warning.message.ends_with("TEXCOORD_3"));
    }

    #[test]
    fn every_slot_has_a_transform_that_may_override_the_set() {
        let slot = |number: u32| {
            format!(
                r#"{{"index":0,"texCoord":7,"extensions":{{"KHR_texture_transform":
                {{"offset":[{number},0.5],"rotation":0.25,"scale":[2,3],"texCoord":{}}}}}}}"#,
                number % 2
            )
        };
        let context = context(&format!(
            r#""textures":[{{}}],"materials":[{{"pbrMetallicRoughness":{{"baseColorTexture":{},
            "metallicRoughnessTexture":{}}},"normalTexture":{},"occlusionTexture":{},
            "emissiveTexture":{}}}]"#,
            slot(0),
            slot(1),
            slot(2),
            slot(3),
            slot(4)
        ));
        let mut material = read(&context, 0).unwrap();
        for (number, slot) in (0..5).zip(crate::import::slots(&mut material)) {
            let expected = TextureRef {
                texture: 0,
                uv_set: number % 2,
                transform: UvTransform::new([number as f32, 0.5], 0.25, [2.0, 3.0]),
            };
            assert_eq!(*slot, Some(expected));
        }
        assert!(context.finish().1.is_empty());
    }

    #[test]
    fn faulty_transforms_are_refused_or_left_out() {
        let with = |transform: &str| {
            context(&format!(
                r#""textures":[{{}}],"materials":[{{"normalTexture":{{"index":0,
                "extensions":{{"KHR_texture_transform":{transform}}}}}}}]"#
            ))
        };
        let error = fault(read(&with(r#"{"rotation":"left"}"#), 0));
        assert_eq!(error.code, "extension-schema");
        assert_eq!(
            error.place,
            "/materials/0/normalTexture/extensions/KHR_texture_transform"
        );
        let context = with(r#"{"scale":[1e39,1]}"#);
        let reference = read(&context, 0).unwrap().normal_texture;
        assert_eq!(reference, Some(TextureRef::new(0, 0)));
        assert_eq!(context.finish().1[0].code, "texture-transform");
    }

    #[test]
    fn unknown_alpha_modes_are_refused() {
        let context = context(r#""materials":[{"alphaMode":"SOFT"}]"#);
        assert_eq!(fault(read(&context, 0)).code, "material-alpha-mode");
    }
}
