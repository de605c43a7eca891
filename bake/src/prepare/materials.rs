//! What materials need of geometry.

use cairn_format::{features, gpu};

use crate::scene::{AlphaMode, Lobes, Material, Scene, TextureRef};

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
    /// R.
    pub clearcoat: Option<TextureRef>,
    /// G.
    pub clearcoat_roughness: Option<TextureRef>,
    /// Tangent-space normal of the coat.
    pub clearcoat_normal: Option<TextureRef>,
    /// A.
    pub specular: Option<TextureRef>,
    /// sRGB colour.
    pub specular_color: Option<TextureRef>,
    /// sRGB colour.
    pub sheen_color: Option<TextureRef>,
    /// A.
    pub sheen_roughness: Option<TextureRef>,
    /// Bits of the `LOBE_*` constants of [`gpu`].
    pub lobes: u32,
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
            ..Self::of_lobes(material)
        }
    }

    /// A factor of zero hides a lobe with its textures, and a metal has no dielectric reflection.
    fn of_lobes(material: &Material) -> Self {
        let Lobes {
            clearcoat_texture,
            clearcoat_roughness_texture,
            clearcoat_normal_texture,
            specular_texture,
            specular_color_texture,
            sheen_color_texture,
            sheen_roughness_texture,
            ..
        } = material.lobes;
        let lobes = lobes(material);
        let shown = |bit: u32, texture: Option<TextureRef>| texture.filter(|_| lobes & bit != 0);
        Self {
            clearcoat: shown(gpu::LOBE_CLEARCOAT, clearcoat_texture),
            clearcoat_roughness: shown(gpu::LOBE_CLEARCOAT, clearcoat_roughness_texture),
            clearcoat_normal: shown(gpu::LOBE_CLEARCOAT, clearcoat_normal_texture),
            specular: shown(gpu::LOBE_SPECULAR, specular_texture)
                .filter(|_| material.lobes.specular > 0.0),
            specular_color: shown(gpu::LOBE_SPECULAR, specular_color_texture)
                .filter(|_| material.lobes.specular > 0.0),
            sheen_color: shown(gpu::LOBE_SHEEN, sheen_color_texture),
            sheen_roughness: shown(gpu::LOBE_SHEEN, sheen_roughness_texture),
            lobes,
            ..Self::default()
        }
    }

    /// The texture in whose coordinates tangents are made: the normal map, else the coat's.
    pub fn tangent_space(&self) -> Option<TextureRef> {
        self.normal.or(self.clearcoat_normal)
    }

    /// Every texture that is used.
    pub fn textures(&self) -> impl Iterator<Item = TextureRef> {
        let textures = [
            self.base_color,
            self.metallic_roughness,
            self.normal,
            self.occlusion,
            self.emissive,
            self.clearcoat,
            self.clearcoat_roughness,
            self.clearcoat_normal,
            self.specular,
            self.specular_color,
            self.sheen_color,
            self.sheen_roughness,
        ];
        textures.into_iter().flatten()
    }

    /// Whether some texture samples with coordinate set `set`.
    pub fn samples(&self, set: u32) -> bool {
        self.textures().any(|texture| texture.uv_set == set)
    }
}

/// Bits of the lobes of a lit material that can be seen.
fn lobes(material: &Material) -> u32 {
    let lobes = &material.lobes;
    let reflects = Lobes {
        ior: lobes.ior,
        specular: lobes.specular,
        specular_color: lobes.specular_color,
        specular_texture: lobes.specular_texture,
        specular_color_texture: lobes.specular_color_texture,
        ..Lobes::default()
    };
    let metal = material.metallic == 1.0 && material.metallic_roughness_texture.is_none();
    let bit = |bit: u32, condition: bool| if condition { bit } else { 0 };
    bit(gpu::LOBE_CLEARCOAT, lobes.clearcoat > 0.0)
        | bit(gpu::LOBE_SPECULAR, !metal && reflects != Lobes::default())
        | bit(gpu::LOBE_SHEEN, lobes.sheen_color.max_element() > 0.0)
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
        set(features::NORMAL_MAPS, uses.tangent_space().is_some());
        set(features::CLEARCOAT, uses.lobes & gpu::LOBE_CLEARCOAT != 0);
        set(features::SPECULAR, uses.lobes & gpu::LOBE_SPECULAR != 0);
        set(features::SHEEN, uses.lobes & gpu::LOBE_SHEEN != 0);
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
    fn lobes_without_effect_are_not_used() {
        let texture = Some(TextureRef::new(0, 1));
        let mut material = Material {
            lobes: Lobes {
                clearcoat_texture: texture,
                sheen_roughness_texture: texture,
                specular_texture: texture,
                ior: 1.1,
                ..Lobes::default()
            },
            ..Material::default()
        };
        assert_eq!(MaterialUse::of(Some(&material)), MaterialUse::default());
        material.metallic = 0.5;
        let uses = MaterialUse::of(Some(&material));
        assert_eq!(uses.lobes, gpu::LOBE_SPECULAR);
        assert_eq!((uses.specular, uses.clearcoat), (texture, None));
        material.lobes.clearcoat = 0.5;
        material.lobes.sheen_color.y = 0.1;
        material.lobes.clearcoat_normal_texture = texture;
        let uses = MaterialUse::of(Some(&material));
        assert_eq!(uses.tangent_space(), texture);
        assert_eq!((uses.sheen_roughness, uses.clearcoat), (texture, texture));
        let all = features::CLEARCOAT | features::SPECULAR | features::SHEEN;
        assert_eq!(bits(material), all | features::UV1 | features::NORMAL_MAPS);
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
