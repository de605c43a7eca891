//! Derives texture slots, roles and material records from the materials that a scene uses.

use cairn_format::features;
use cairn_format::gpu;

use crate::encode::{AlphaUse, Role};
use crate::prepare::MaterialUse;
use crate::scene::{AlphaMode, Material, Sampler, Scene, TextureRef, UvTransform};

/// An image to encode: the same glTF image in two roles is two of these.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImageUse {
    /// Index into `Scene::images`.
    pub image: u32,
    /// Colour, data or normal: content decides how data is stored.
    pub role: Role,
    /// Bits of the channels that materials read: 1 is red, 8 is alpha.
    pub channels: u8,
    pub alpha: AlphaUse,
    /// The sampler whose wrap modes the mip filter follows.
    pub sampler: Sampler,
}

const RED: u8 = 1;
const GREEN: u8 = 2;
const BLUE: u8 = 4;
const ALPHA: u8 = 8;
const RGB: u8 = RED | GREEN | BLUE;

/// A texture slot: indices into [`Plan::images`] and [`Plan::samplers`], and what happens to the coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slot {
    pub image: u32,
    pub sampler: u32,
    pub transform: UvTransform,
}

/// What the materials of a package need.
#[derive(Debug, Default)]
pub struct Plan {
    pub images: Vec<ImageUse>,
    pub samplers: Vec<Sampler>,
    /// No two are equal.
    pub slots: Vec<Slot>,
    /// One per slot; empty where all are the identity.
    pub transforms: Vec<gpu::TextureTransform>,
    /// One record per used material.
    pub materials: Vec<gpu::Material>,
    /// One record per material; empty where no material has a further lobe.
    pub extensions: Vec<gpu::MaterialExtension>,
    pub names: Vec<String>,
    /// Feature bits that follow from textures.
    pub features: u32,
    /// Occlusion and metallic-roughness images that materials use together, and nothing uses otherwise.
    pub companions: Vec<[u32; 2]>,
}

/// Plans the records of `used`: indices into the scene's materials, `None` for glTF's default material.
pub fn plan(scene: &Scene, used: &[Option<u32>]) -> Plan {
    let mut plan = Plan::default();
    for index in used {
        let fallback = Material::default();
        let material = match index {
            Some(index) => &scene.materials[*index as usize],
            None => &fallback,
        };
        let record = plan.record(scene, material);
        plan.materials.push(record);
        let extension = plan.extension(scene, material);
        plan.extensions.push(extension);
        plan.names.push(material.name.clone());
    }
    if plan.extensions.iter().all(|extension| extension.lobes == 0) {
        plan.extensions.clear();
    }
    plan.keep_exclusive_companions();
    let moves = |slot: &Slot| slot.transform != UvTransform::IDENTITY;
    if plan.slots.iter().any(moves) {
        plan.transforms = plan.slots.iter().map(transform).collect();
        plan.features |= features::TEXTURE_TRANSFORMS;
    }
    plan
}

fn transform(slot: &Slot) -> gpu::TextureTransform {
    gpu::TextureTransform {
        matrix: slot.transform.matrix,
        offset: slot.transform.offset,
        pad_24: 0,
        pad_28: 0,
    }
}

impl Plan {
    fn record(&mut self, scene: &Scene, material: &Material) -> gpu::Material {
        let uses = MaterialUse::of(Some(material));
        let alpha = match material.alpha_mode {
            AlphaMode::Opaque => AlphaUse::Ignore,
            AlphaMode::Blend => AlphaUse::Blend,
            // The test is on factor times texture: as a threshold on the texture alone it is divided.
            AlphaMode::Mask => AlphaUse::Mask {
                cutoff: material.alpha_cutoff / material.base_color.w.max(f32::MIN_POSITIVE),
            },
        };
        let record = gpu::Material {
            base_color_factor: material.base_color.to_array(),
            emissive_factor: material.emissive.extend(0.0).to_array(),
            metallic_factor: material.metallic,
            roughness_factor: material.roughness,
            normal_scale: material.normal_scale,
            occlusion_strength: material.occlusion_strength,
            base_color_tex: self.color(scene, uses.base_color, alpha),
            emissive_tex: self.color(scene, uses.emissive, AlphaUse::Ignore),
            metallic_roughness_tex: self.data(scene, uses.metallic_roughness, GREEN | BLUE),
            normal_tex: self.normal(scene, uses.normal),
            occlusion_tex: self.data(scene, uses.occlusion, RED),
            alpha_cutoff: material.alpha_cutoff,
            alpha_mode: alpha_mode(material.alpha_mode),
            double_sided: flags(material),
        };
        if let [Some(occlusion), Some(roughness)] =
            [record.occlusion_tex, record.metallic_roughness_tex]
                .map(|texture| self.image_of(texture))
            && occlusion != roughness
        {
            find_or_push(&mut self.companions, [occlusion, roughness]);
        }
        record
    }

    /// The image behind a texture reference.
    fn image_of(&self, reference: u32) -> Option<u32> {
        let slot = self.slots.get((reference & !gpu::TEXTURE_UV1) as usize)?;
        (reference != gpu::NO_TEXTURE).then_some(slot.image)
    }

    /// Leaves the pairs whose images have one companion each, are read by nothing else, and wrap alike.
    fn keep_exclusive_companions(&mut self) {
        let all = std::mem::take(&mut self.companions);
        let lonely = |[occlusion, roughness]: &[u32; 2]| {
            let images = [occlusion, roughness].map(|&image| self.images[image as usize]);
            let wraps = images.map(|image| (image.sampler.wrap_u, image.sampler.wrap_v));
            let shares = |other: &&[u32; 2]| other[0] == *occlusion || other[1] == *roughness;
            images.map(|image| image.channels) == [RED, GREEN | BLUE]
                && wraps[0] == wraps[1]
                && all.iter().filter(shares).count() == 1
        };
        self.companions = all.iter().filter(|pair| lonely(pair)).copied().collect();
    }

    fn color(&mut self, scene: &Scene, texture: Option<TextureRef>, alpha: AlphaUse) -> u32 {
        let channels = if alpha == AlphaUse::Ignore {
            RGB
        } else {
            RGB | ALPHA
        };
        self.reference(scene, texture, Role::Color, channels, alpha)
    }

    fn data(&mut self, scene: &Scene, texture: Option<TextureRef>, channels: u8) -> u32 {
        let alpha = data_alpha(channels);
        self.reference(scene, texture, Role::Data, channels, alpha)
    }

    fn normal(&mut self, scene: &Scene, texture: Option<TextureRef>) -> u32 {
        self.reference(scene, texture, Role::Normal, RGB, AlphaUse::Ignore)
    }

    fn extension(&mut self, scene: &Scene, material: &Material) -> gpu::MaterialExtension {
        let uses = MaterialUse::of(Some(material));
        let lobes = &material.lobes;
        let mut record = gpu::MaterialExtension {
            lobes: uses.lobes,
            ..gpu::MaterialExtension::default()
        };
        if uses.lobes & gpu::LOBE_CLEARCOAT != 0 {
            record.clearcoat_factor = lobes.clearcoat;
            record.clearcoat_roughness = lobes.clearcoat_roughness;
            record.clearcoat_normal_scale = lobes.clearcoat_normal_scale;
            record.clearcoat_tex = self.data(scene, uses.clearcoat, RED);
            record.clearcoat_roughness_tex = self.data(scene, uses.clearcoat_roughness, GREEN);
            record.clearcoat_normal_tex = self.normal(scene, uses.clearcoat_normal);
        }
        if uses.lobes & gpu::LOBE_SPECULAR != 0 {
            record.specular_factor = lobes.specular;
            record.specular_color = lobes.specular_color.to_array();
            record.dielectric_f0 = dielectric_f0(lobes.ior);
            record.specular_tex = self.data(scene, uses.specular, ALPHA);
            record.specular_color_tex = self.color(scene, uses.specular_color, AlphaUse::Ignore);
        }
        if uses.lobes & gpu::LOBE_SHEEN != 0 {
            record.sheen_color = lobes.sheen_color.to_array();
            record.sheen_roughness = lobes.sheen_roughness;
            record.sheen_color_tex = self.color(scene, uses.sheen_color, AlphaUse::Ignore);
            record.sheen_roughness_tex = self.data(scene, uses.sheen_roughness, ALPHA);
        }
        record
    }

    fn reference(
        &mut self,
        scene: &Scene,
        texture: Option<TextureRef>,
        role: Role,
        channels: u8,
        alpha: AlphaUse,
    ) -> u32 {
        let Some(reference) = texture else {
            return gpu::NO_TEXTURE;
        };
        let texture = scene.textures[reference.texture as usize];
        let sampler = texture
            .sampler
            .map_or_else(Sampler::default, |index| scene.samplers[index as usize]);
        let image = self.image(ImageUse {
            image: texture.image,
            role,
            channels,
            alpha,
            sampler,
        });
        let slot = Slot {
            image,
            sampler: find_or_push(&mut self.samplers, sampler),
            transform: reference.transform,
        };
        let slot = find_or_push(&mut self.slots, slot);
        self.features |= features::TEXTURES;
        if reference.uv_set == 0 {
            return slot;
        }
        self.features |= features::UV1;
        slot | gpu::TEXTURE_UV1
    }

    /// Uses that differ only in what the mip filter ignores share an image, and so do those that read different
    /// channels of data.
    fn image(&mut self, wanted: ImageUse) -> u32 {
        let same = |have: &ImageUse| {
            have.image == wanted.image
                && have.role == wanted.role
                && (have.alpha == wanted.alpha || wanted.role == Role::Data)
                && have.sampler.wrap_u == wanted.sampler.wrap_u
                && have.sampler.wrap_v == wanted.sampler.wrap_v
        };
        match self.images.iter().position(same) {
            Some(index) => {
                let have = &mut self.images[index];
                have.channels |= wanted.channels;
                if have.role == Role::Data {
                    have.alpha = data_alpha(have.channels);
                }
                index as u32
            }
            None => {
                self.images.push(wanted);
                self.images.len() as u32 - 1
            }
        }
    }
}

/// What data has in alpha.
fn data_alpha(channels: u8) -> AlphaUse {
    if channels & ALPHA == 0 {
        AlphaUse::Ignore
    } else {
        AlphaUse::Value
    }
}

/// Reflectance at normal incidence of a dielectric in air (`KHR_materials_ior`); 1 for an index of 0.
fn dielectric_f0(ior: f32) -> f32 {
    let ior = f64::from(ior);
    ((ior - 1.0) / (ior + 1.0)).powi(2) as f32
}

/// `alpha_mode` of a material record.
pub fn alpha_mode(mode: AlphaMode) -> u32 {
    match mode {
        AlphaMode::Opaque => gpu::ALPHA_OPAQUE,
        AlphaMode::Mask => gpu::ALPHA_MASK,
        AlphaMode::Blend => gpu::ALPHA_BLEND,
    }
}

fn flags(material: &Material) -> u32 {
    let double_sided = if material.double_sided {
        gpu::MATERIAL_DOUBLE_SIDED
    } else {
        0
    };
    let unlit = if material.unlit {
        gpu::MATERIAL_UNLIT
    } else {
        0
    };
    double_sided | unlit
}

fn find_or_push<T: PartialEq>(list: &mut Vec<T>, value: T) -> u32 {
    let index = list
        .iter()
        .position(|have| *have == value)
        .unwrap_or_else(|| {
            list.push(value);
            list.len() - 1
        });
    index as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Image, Lobes, Texture};
    use glam::Vec3;

    fn textured() -> Scene {
        let reference = |uv_set| Some(TextureRef::new(0, uv_set));
        Scene {
            images: vec![Image::default()],
            textures: vec![Texture {
                image: 0,
                sampler: None,
            }],
            materials: vec![Material {
                base_color_texture: reference(0),
                metallic_roughness_texture: reference(1),
                emissive_texture: reference(0),
                ..Material::default()
            }],
            ..Scene::default()
        }
    }

    #[test]
    fn one_image_in_two_roles_is_encoded_twice() {
        let plan = plan(&textured(), &[Some(0)]);
        assert_eq!(plan.images.len(), 2);
        assert_eq!(plan.samplers.len(), 1);
        assert_eq!(plan.materials[0].base_color_tex, 0);
        assert_eq!(
            plan.materials[0].metallic_roughness_tex,
            1 | gpu::TEXTURE_UV1
        );
        assert_eq!(plan.features, features::TEXTURES | features::UV1);
    }

    #[test]
    fn channels_are_those_that_materials_read() {
        let mut scene = textured();
        scene.materials[0].occlusion_texture = Some(TextureRef::new(0, 0));
        let shared = plan(&scene, &[Some(0)]);
        assert_eq!(
            shared.images.len(),
            2,
            "occlusion shares the image of the other data"
        );
        assert_eq!(shared.images[1].channels, RGB);
        assert!(shared.companions.is_empty());
        scene.images.push(Image::default());
        scene.textures.push(Texture {
            image: 1,
            sampler: None,
        });
        scene.materials[0].occlusion_texture = Some(TextureRef::new(1, 0));
        let apart = plan(&scene, &[Some(0)]);
        let channels: Vec<u8> = apart.images.iter().map(|image| image.channels).collect();
        assert_eq!(channels, [RGB, GREEN | BLUE, RED]);
        assert_eq!(apart.companions, [[2, 1]]);
        // A second companion of the same image leaves no pair.
        scene.images.push(Image::default());
        scene.textures.push(Texture {
            image: 2,
            sampler: None,
        });
        let mut other = scene.materials[0].clone();
        other.occlusion_texture = Some(TextureRef::new(2, 0));
        scene.materials.push(other);
        assert!(plan(&scene, &[Some(0), Some(1)]).companions.is_empty());
    }

    #[test]
    fn textures_without_effect_are_left_out() {
        let mut scene = textured();
        assert_eq!(
            plan(&scene, &[Some(0)]).materials[0].emissive_tex,
            gpu::NO_TEXTURE
        );
        scene.materials[0].emissive = Vec3::ONE;
        assert_eq!(plan(&scene, &[Some(0)]).materials[0].emissive_tex, 0);
        scene.materials[0].unlit = true;
        let unlit = plan(&scene, &[Some(0)]);
        assert_eq!(unlit.images.len(), 1);
        assert_eq!(unlit.materials[0].double_sided, gpu::MATERIAL_UNLIT);
    }

    #[test]
    fn transforms_make_slots_of_their_own() {
        let mut scene = textured();
        assert!(plan(&scene, &[Some(0)]).transforms.is_empty());
        let turned = UvTransform::new([0.5, 0.0], 1.0, [2.0, -1.0]);
        let mut moved = scene.materials[0].clone();
        for reference in [
            &mut moved.base_color_texture,
            &mut moved.metallic_roughness_texture,
        ] {
            reference.as_mut().expect("textured").transform = turned;
        }
        scene.materials.push(moved);
        let plan = plan(&scene, &[Some(0), Some(1)]);
        assert_eq!(plan.images.len(), 2, "the mip filter ignores the transform");
        assert_eq!((plan.slots.len(), plan.transforms.len()), (4, 4));
        assert_eq!(plan.materials[1].base_color_tex, 2);
        assert_eq!(
            plan.materials[1].metallic_roughness_tex,
            3 | gpu::TEXTURE_UV1
        );
        assert_eq!(plan.transforms[1].matrix, [1.0, 0.0, 0.0, 1.0]);
        assert_eq!(plan.transforms[2].matrix, turned.matrix);
        assert_eq!(plan.transforms[3].offset, [0.5, 0.0]);
        assert!(plan.features & features::TEXTURE_TRANSFORMS != 0);
    }

    #[test]
    fn lobes_have_records_where_a_material_uses_one() {
        let mut scene = textured();
        scene.materials[0].metallic = 0.0;
        scene.materials.push(scene.materials[0].clone());
        assert!(plan(&scene, &[Some(0), Some(1)]).extensions.is_empty());
        let texture = Some(TextureRef::new(0, 0));
        scene.materials[1].lobes = Lobes {
            specular: 0.5,
            specular_texture: texture,
            specular_color_texture: texture,
            clearcoat_texture: texture,
            ior: 0.0,
            ..Lobes::default()
        };
        let plan = plan(&scene, &[Some(0), Some(1)]);
        assert_eq!(plan.extensions.len(), 2);
        assert_eq!(plan.extensions[0], gpu::MaterialExtension::default());
        let record = plan.extensions[1];
        assert_eq!(record.lobes, gpu::LOBE_SPECULAR);
        assert_eq!((record.specular_factor, record.dielectric_f0), (0.5, 1.0));
        assert_eq!(record.clearcoat_tex, gpu::NO_TEXTURE);
        let image = |slot: u32| plan.images[plan.slots[slot as usize].image as usize];
        let specular = image(record.specular_tex);
        assert_eq!(
            (specular.role, specular.alpha),
            (Role::Data, AlphaUse::Value)
        );
        assert_eq!(record.specular_color_tex, plan.materials[0].base_color_tex);
    }

    #[test]
    fn indices_of_refraction_give_their_reflectance() {
        for (ior, expected) in [(1.5, 0.04), (1.0, 0.0), (0.0, 1.0), (2.0, 1.0 / 9.0)] {
            assert_eq!(dielectric_f0(ior), expected as f32, "{ior}");
        }
    }

    #[test]
    fn the_default_material_has_no_texture() {
        let plan = plan(&Scene::default(), &[None]);
        assert!(plan.images.is_empty() && plan.slots.is_empty());
        assert_eq!(plan.materials[0], gpu::Material::default());
    }
}
