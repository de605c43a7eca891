//! What materials need of geometry.

use cairn_format::features;

use crate::scene::{AlphaMode, Material, Scene, TextureRef};

/// The textures of a material that can change what is seen: an unlit material shows its base colour alone
/// (`KHR_materials_unlit`), an emissive factor of zero hides its texture, and so does an occlusion strength
/// of zero.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MaterialUse {
    /// sRGB colour and alpha.
    pub base_color: Option<TextureRef>,
    /// G roughness, B metallic.
    pub metallic_roughness: Option<TextureRef>,
    /// Tangent-space normal.
    pub normal: Option<TextureRef>,
    /// R.
    pub occlusion: Option<TextureRef>,
    /// sRGB colour.
    pub emissive: Option<TextureRef>,
    /// Whether light leaves the material without falling on it.
    pub emits: bool,
}

impl MaterialUse {
    /// What `material` uses; the default material uses nothing.
    pub fn of(material: Option<&Material>) -> Self {
        let Some(material) = material else {
            return Self::default();
        };
        let base_color = material.base_color_texture;
        if material.unlit {
            return Self {
                base_color,
                ..Self::default()
            };
        }
        let emits = material.emissive.max_element() > 0.0;
        Self {
            base_color,
            metallic_roughness: material.metallic_roughness_texture,
            normal: material.normal_texture,
            occlusion: material
                .occlusion_texture
                .filter(|_| material.occlusion_strength > 0.0),
            emissive: material.emissive_texture.filter(|_| emits),
            emits,
        }
    }

    /// Whether some texture samples with coordinate set `set`.
    pub fn samples(&self, set: u32) -> bool {
        let textures = [
            self.base_color,
            self.metallic_roughness,
            self.normal,
            self.occlusion,
            self.emissive,
        ];
        textures
            .iter()
            .flatten()
            .any(|texture| texture.uv_set == set)
    }
}

/// The material that `index` names; `None` is glTF's default material.
pub(super) fn get(scene: &Scene, index: Option<u32>) -> Option<&Material> {
    scene.materials.get(index? as usize)
}

/// Feature bits of the materials `used`.
pub(super) fn features(scene: &Scene, used: &[Option<u32>]) -> u32 {
    let mut bits = 0;
    let mut set = |bit: u32, condition: bool| bits |= if condition { bit } else { 0 };
    for material in used.iter().filter_map(|index| get(scene, *index)) {
        let uses = MaterialUse::of(Some(material));
        set(features::MASK, material.alpha_mode == AlphaMode::Mask);
        set(features::BLEND, material.alpha_mode == AlphaMode::Blend);
        set(features::DOUBLE_SIDED, material.double_sided);
        set(features::UNLIT, material.unlit);
        set(features::NORMAL_MAPS, uses.normal.is_some());
        set(features::EMISSIVE, uses.emits);
        set(features::UV1, uses.samples(1));
    }
    bits
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn textured() -> Material {
        let texture = |uv_set| Some(TextureRef::new(0, uv_set));
        Material {
            base_color_texture: texture(0),
            normal_texture: texture(1),
            emissive_texture: texture(1),
            ..Material::default()
        }
    }

    fn bits(material: Material) -> u32 {
        let scene = Scene {
            materials: vec![material],
            ..Scene::default()
        };
        assert_eq!(features(&scene, &[None]), 0);
        features(&scene, &[Some(0)])
    }

    #[test]
    fn hidden_textures_are_not_used() {
        let uses = MaterialUse::of(Some(&textured()));
        assert!(uses.emissive.is_none() && uses.normal.is_some());
        assert!(uses.samples(0) && uses.samples(1));
        let unlit = MaterialUse::of(Some(&Material {
            unlit: true,
            emissive: Vec3::ONE,
            ..textured()
        }));
        assert!(unlit.samples(0) && !unlit.samples(1) && !unlit.emits);
        assert_eq!(MaterialUse::of(None), MaterialUse::default());
    }

    #[test]
    fn bits_follow_the_material() {
        assert_eq!(bits(Material::default()), 0);
        assert_eq!(bits(textured()), features::NORMAL_MAPS | features::UV1);
        let unlit = Material {
            unlit: true,
            double_sided: true,
            ..textured()
        };
        assert_eq!(bits(unlit), features::UNLIT | features::DOUBLE_SIDED);
        let emissive = Material {
            emissive: Vec3::X,
            alpha_mode: AlphaMode::Blend,
            ..Material::default()
        };
        assert_eq!(bits(emissive), features::EMISSIVE | features::BLEND);
    }
}
