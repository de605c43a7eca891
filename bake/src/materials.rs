//! Derives texture slots, roles and material records from the materials that a scene uses.

use cairn_format::features;
use cairn_format::gpu;

use crate::encode::{AlphaUse, Role};
use crate::prepare::MaterialUse;
use crate::scene::{AlphaMode, Material, Sampler, Scene, TextureRef, UvTransform, Wrap};

mod widening;

use widening::{Layer, alike, sampler};

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
    /// Whether green is roughness that normals widen.
    pub widening: Option<Widening>,
}

/// Normals that widen the roughness of a material (`EncodeOptions::toksvig`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Widening {
    /// Index into `Scene::images`.
    pub normal: u32,
    pub normal_wrap: [Wrap; 2],
    pub normal_scale: f32,
    /// Roughness is the green of the image times this, which the material's record then has no more.
    pub factor: f32,
    /// Whether the material has a roughness image. If not, it is 1 everywhere, and the image is that of the normals.
    pub textured: bool,
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
    /// Materials whose normals and roughness have other coordinates, so that none widens the other: indices into
    /// `Scene::materials`.
    pub unpaired: Vec<u32>,
    /// Whether normals widen roughness.
    widen: bool,
}

/// Plans the records of `used`: indices into the scene's materials, `None` for glTF's default material. `widen`: whether
/// normals widen roughness.
pub fn plan(scene: &Scene, used: &[Option<u32>], widen: bool) -> Plan {
    let mut plan = Plan {
        widen,
        ..Plan::default()
    };
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
        let uses = MaterialUse::of(Some(material));
        if widen && (base(&uses, material).is_unpaired() || coat(&uses, material).is_unpaired()) {
            plan.unpaired.extend(index);
        }
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

/// The base of a material.
fn base(uses: &MaterialUse, material: &Material) -> Layer {
    Layer {
        normal: uses.normal,
        normal_scale: material.normal_scale,
        roughness: uses.metallic_roughness,
        factor: material.roughness,
    }
}

/// The coat of a material.
fn coat(uses: &MaterialUse, material: &Material) -> Layer {
    Layer {
        normal: uses.clearcoat_normal,
        normal_scale: material.lobes.clearcoat_normal_scale,
        roughness: uses.clearcoat_roughness,
        factor: material.lobes.clearcoat_roughness,
    }
}

fn transform(slot: &Slot) -> gpu::TextureTransform {
    gpu::TextureTransform {
        matrix: slot.transform.matrix,
        offset: slot.transform.offset,
        pad_24: 0,
        pad_28: 0,
    }
}

/// What a material reads of a texture.
struct Read {
    role: Role,
    channels: u8,
    alpha: AlphaUse,
    widening: Option<Widening>,
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
        // The order of these is that of images in packages.
        let base_color_tex = self.color(scene, uses.base_color, alpha);
        let emissive_tex = self.color(scene, uses.emissive, AlphaUse::Ignore);
        let (metallic_roughness_tex, roughness_factor, widening) =
            self.roughness(scene, base(&uses, material), GREEN | BLUE);
        let normal_tex = self.normal(scene, uses.normal);
        // One image holds both where the file has it so.
        let image = |texture: TextureRef| scene.textures[texture.texture as usize].image;
        let shared = matches!((uses.occlusion, uses.metallic_roughness), (Some(one), Some(other))
            if image(one) == image(other) && alike(one, other));
        let occlusion_tex = self.data(scene, uses.occlusion, RED, widening.filter(|_| shared));
        let record = gpu::Material {
            base_color_factor: material.base_color.to_array(),
            emissive_factor: material.emissive.extend(0.0).to_array(),
            metallic_factor: material.metallic,
            roughness_factor,
            normal_scale: material.normal_scale,
            occlusion_strength: material.occlusion_strength,
            base_color_tex,
            emissive_tex,
            metallic_roughness_tex,
            normal_tex,
            occlusion_tex,
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
        let read = Read {
            role: Role::Color,
            channels,
            alpha,
            widening: None,
        };
        self.reference(scene, texture, read)
    }

    fn data(
        &mut self,
        scene: &Scene,
        texture: Option<TextureRef>,
        channels: u8,
        widening: Option<Widening>,
    ) -> u32 {
        let read = Read {
            role: Role::Data,
            channels,
            alpha: data_alpha(channels),
            widening,
        };
        self.reference(scene, texture, read)
    }

    fn normal(&mut self, scene: &Scene, texture: Option<TextureRef>) -> u32 {
        let read = Read {
            role: Role::Normal,
            channels: RGB,
            alpha: AlphaUse::Ignore,
            widening: None,
        };
        self.reference(scene, texture, read)
    }

    /// The texture and the factor of a roughness, and what widens it.
    fn roughness(
        &mut self,
        scene: &Scene,
        layer: Layer,
        channels: u8,
    ) -> (u32, f32, Option<Widening>) {
        match layer.widening(scene).filter(|_| self.widen) {
            Some((texture, widening)) => {
                let texture = self.data(scene, Some(texture), channels, Some(widening));
                (texture, 1.0, Some(widening))
            }
            None => {
                let texture = self.data(scene, layer.roughness, channels, None);
                (texture, layer.factor, None)
            }
        }
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
            record.clearcoat_normal_scale = lobes.clearcoat_normal_scale;
            record.clearcoat_tex = self.data(scene, uses.clearcoat, RED, None);
            (
                record.clearcoat_roughness_tex,
                record.clearcoat_roughness,
                _,
            ) = self.roughness(scene, coat(&uses, material), GREEN);
            record.clearcoat_normal_tex = self.normal(scene, uses.clearcoat_normal);
        }
        if uses.lobes & gpu::LOBE_SPECULAR != 0 {
            record.specular_factor = lobes.specular;
            record.specular_color = lobes.specular_color.to_array();
            record.dielectric_f0 = dielectric_f0(lobes.ior);
            record.specular_tex = self.data(scene, uses.specular, ALPHA, None);
            record.specular_color_tex = self.color(scene, uses.specular_color, AlphaUse::Ignore);
        }
        if uses.lobes & gpu::LOBE_SHEEN != 0 {
            record.sheen_color = lobes.sheen_color.to_array();
            record.sheen_roughness = lobes.sheen_roughness;
            record.sheen_color_tex = self.color(scene, uses.sheen_color, AlphaUse::Ignore);
            record.sheen_roughness_tex = self.data(scene, uses.sheen_roughness, ALPHA, None);
        }
        record
    }

    fn reference(&mut self, scene: &Scene, texture: Option<TextureRef>, read: Read) -> u32 {
        let Some(reference) = texture else {
            return gpu::NO_TEXTURE;
        };
        let sampler = sampler(scene, reference);
        let Read {
            role,
            channels,
            alpha,
            widening,
        } = read;
        let image = self.image(ImageUse {
            image: scene.textures[reference.texture as usize].image,
            role,
            channels,
            alpha,
            sampler,
            widening,
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
                && have.widening == wanted.widening
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
mod tests;
