//! Turns constant images into factors, and alpha modes that decide nothing into opaque, before anything else looks at
//! materials.

use std::collections::BTreeMap;

use glam::Vec3;
use rayon::prelude::*;

use crate::cache::{Inputs, Kind, Session};
use crate::diagnostic::Result;
use crate::encode::srgb::decode_f64;
use crate::import::{decode_image, image_header};
use crate::prepare::MaterialUse;
use crate::scene::{AlphaMode, Material, Scene, TextureRef};

/// Encoded bytes beyond which an image of so many texels is not searched for a constant: a constant one takes less in
/// every format but stored ones, and those are still reduced to one texel when they are encoded.
const LEAST_BYTES: u64 = 4096;
const TEXELS_PER_BYTE: u64 = 32;

/// What an image holds: the value of each channel that is constant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Facts {
    constant: [Option<u16>; 4],
}

/// Folds constants into the materials of `scene`.
///
/// # Errors
/// An image that is used and cannot be decoded.
pub fn fold(scene: &mut Scene, limit_pixels: u64, session: &Session) -> Result<()> {
    let translucent = translucent_vertices(scene);
    let facts = survey(scene, limit_pixels, session)?;
    let textures = &scene.textures;
    let of = |reference: &TextureRef| {
        let image = textures[reference.texture as usize].image;
        facts.get(&image).copied().unwrap_or_default()
    };
    for (index, material) in (0..).zip(&mut scene.materials) {
        fold_material(material, &of);
        if !translucent.contains(&Some(index)) {
            fold_alpha(material, &of);
        }
    }
    Ok(())
}

/// Materials of primitives whose vertex colours are not opaque.
fn translucent_vertices(scene: &Scene) -> Vec<Option<u32>> {
    let primitives = scene.meshes.iter().flat_map(|mesh| &mesh.primitives);
    let translucent = primitives.filter(|primitive| {
        let colors = primitive.colors.iter().flatten();
        colors.into_iter().any(|color| color[3] != 1.0)
    });
    translucent.map(|primitive| primitive.material).collect()
}

/// Facts of the images that may be constant, or whose alpha decides a mode.
fn survey(scene: &Scene, limit_pixels: u64, session: &Session) -> Result<BTreeMap<u32, Facts>> {
    // Whether alpha is asked for.
    let mut wanted: BTreeMap<u32, bool> = BTreeMap::new();
    for material in &scene.materials {
        let uses = MaterialUse::of(Some(material));
        let image = |texture: TextureRef| scene.textures[texture.texture as usize].image;
        for texture in uses.textures() {
            wanted.entry(image(texture)).or_default();
        }
        if let Some(texture) = uses.base_color
            && material.alpha_mode != AlphaMode::Opaque
        {
            wanted.insert(image(texture), true);
        }
    }
    let found: Vec<Result<(u32, Facts)>> = wanted
        .into_par_iter()
        .map(|(index, alpha)| {
            let image = &scene.images[index as usize];
            let header = image_header(image, limit_pixels)?;
            let texels = u64::from(header.width) * u64::from(header.height);
            let small = image.bytes.len() as u64 <= texels / TEXELS_PER_BYTE + LEAST_BYTES;
            let mut facts = Facts::default();
            if small || alpha && header.has_alpha {
                let inputs = || {
                    Inputs::new(Kind::ImageFacts, module_path!(), &image.name)
                        .content("image", &image.bytes)
                        .settings("limit", &limit_pixels)
                };
                facts.constant = session.fetch(inputs, || {
                    Ok(constant(&decode_image(image, limit_pixels)?.texels))
                })?;
            } else if !header.has_alpha {
                facts.constant[3] = Some(u16::MAX);
            }
            Ok((index, facts))
        })
        .collect();
    found.into_iter().collect()
}

/// The value of each channel that has only one.
pub fn constant(texels: &[[u16; 4]]) -> [Option<u16>; 4] {
    let Some(first) = texels.first() else {
        return [None; 4];
    };
    let mut same = [true; 4];
    for texel in texels {
        for channel in 0..4 {
            same[channel] &= texel[channel] == first[channel];
        }
        if same == [false; 4] {
            break;
        }
    }
    std::array::from_fn(|channel| same[channel].then_some(first[channel]))
}

fn unorm(value: u16) -> f32 {
    f32::from(value) / 65535.0
}

fn fold_material(material: &mut Material, of: &dyn Fn(&TextureRef) -> Facts) {
    let value = |slot: &mut Option<TextureRef>, channel: usize| {
        let value = of(slot.as_ref()?).constant[channel]?;
        *slot = None;
        Some(unorm(value))
    };
    let color = |slot: &mut Option<TextureRef>| {
        let [r, g, b, _] = of(slot.as_ref()?).constant;
        let linear = |value: u16| decode_f64(f64::from(value) / 65535.0) as f32;
        let color = Vec3::new(linear(r?), linear(g?), linear(b?));
        *slot = None;
        Some(color)
    };
    let flat = |slot: &mut Option<TextureRef>| {
        if slot.as_ref().is_some_and(|slot| is_flat(of(slot))) {
            *slot = None;
        }
    };
    let alpha = match (material.alpha_mode, &material.base_color_texture) {
        (AlphaMode::Opaque, _) | (_, None) => Some(1.0),
        (_, Some(slot)) => of(slot).constant[3].map(unorm),
    };
    if let Some(alpha) = alpha
        && let Some(rgb) = color(&mut material.base_color_texture)
    {
        material.base_color *= rgb.extend(alpha);
    }
    if let Some(rgb) = color(&mut material.emissive_texture) {
        material.emissive *= rgb;
    }
    if let Some(slot) = &material.metallic_roughness_texture
        && let [_, Some(roughness), Some(metallic), _] = of(slot).constant
    {
        material.roughness *= unorm(roughness);
        material.metallic *= unorm(metallic);
        material.metallic_roughness_texture = None;
    }
    // No factor stands for occlusion, but full light needs none.
    if let Some(slot) = &material.occlusion_texture
        && of(slot).constant[0] == Some(u16::MAX)
    {
        material.occlusion_texture = None;
    }
    flat(&mut material.normal_texture);
    let lobes = &mut material.lobes;
    flat(&mut lobes.clearcoat_normal_texture);
    lobes.clearcoat *= value(&mut lobes.clearcoat_texture, 0).unwrap_or(1.0);
    lobes.clearcoat_roughness *= value(&mut lobes.clearcoat_roughness_texture, 1).unwrap_or(1.0);
    lobes.specular *= value(&mut lobes.specular_texture, 3).unwrap_or(1.0);
    lobes.specular_color *= color(&mut lobes.specular_color_texture).unwrap_or(Vec3::ONE);
    lobes.sheen_color *= color(&mut lobes.sheen_color_texture).unwrap_or(Vec3::ONE);
    lobes.sheen_roughness *= value(&mut lobes.sheen_roughness_texture, 3).unwrap_or(1.0);
}

/// Whether a normal map holds the plain surface alone, as near as its bits can: 8-bit codes have no zero, and files
/// write 127 or 128.
fn is_flat(facts: Facts) -> bool {
    let zero =
        |value: Option<u16>| value.is_some_and(|value| (127 * 257..=128 * 257).contains(&value));
    zero(facts.constant[0]) && zero(facts.constant[1]) && facts.constant[2] > Some(0xc000)
}

/// A test that all texels pass, and a blend that covers all, are opaque.
fn fold_alpha(material: &mut Material, of: &dyn Fn(&TextureRef) -> Facts) {
    let opaque = |slot: &TextureRef| of(slot).constant[3] == Some(u16::MAX);
    if !material.base_color_texture.as_ref().is_none_or(opaque) {
        return;
    }
    let alpha = material.base_color.w;
    let decided = match material.alpha_mode {
        AlphaMode::Opaque => false,
        AlphaMode::Mask => alpha >= material.alpha_cutoff,
        AlphaMode::Blend => alpha >= 1.0,
    };
    if decided {
        material.alpha_mode = AlphaMode::Opaque;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Image, Mesh, Primitive, Texture};
    use ::image::codecs::png::PngEncoder;
    use ::image::{ExtendedColorType, ImageEncoder};
    use glam::Vec4;

    const RED: [u8; 4] = [255, 0, 0, 255];
    const HALF: [u8; 4] = [0, 51, 102, 204];
    const FLAT: [u8; 4] = [128, 127, 255, 255];

    /// A scene of one material and an image of four texels of each kind: even ones constant, odd ones not.
    fn scene(material: impl FnOnce(fn(u32) -> Option<TextureRef>) -> Material) -> Scene {
        let image = |texels: [[u8; 4]; 4]| {
            let mut bytes = Vec::new();
            let encoder = PngEncoder::new(&mut bytes);
            let color = ExtendedColorType::Rgba8;
            encoder
                .write_image(texels.as_flattened(), 2, 2, color)
                .expect("a PNG");
            Image {
                bytes,
                ..Image::default()
            }
        };
        let varied = [[9, 200, 0, 255], [1, 2, 0, 255], RED, RED];
        Scene {
            images: [[RED; 4], [HALF; 4], [FLAT; 4], varied].map(image).to_vec(),
            textures: (0..4)
                .map(|image| Texture {
                    image,
                    sampler: None,
                })
                .collect(),
            materials: vec![material(|texture| Some(TextureRef::new(texture, 0)))],
            ..Scene::default()
        }
    }

    fn folded(mut scene: Scene) -> Material {
        fold(&mut scene, 1 << 20, &Session::off()).expect("images that decode");
        scene.materials.remove(0)
    }

    #[test]
    fn constants_become_factors() {
        let material = folded(scene(|texture| Material {
            base_color: Vec4::splat(0.5),
            base_color_texture: texture(0),
            emissive: Vec3::splat(2.0),
            emissive_texture: texture(1),
            metallic_roughness_texture: texture(1),
            normal_texture: texture(2),
            occlusion_texture: texture(0),
            ..Material::default()
        }));
        assert_eq!(MaterialUse::of(Some(&material)).textures().count(), 0);
        assert_eq!(material.base_color, Vec4::new(0.5, 0.0, 0.0, 0.5));
        assert_eq!((material.roughness, material.metallic), (0.2, 0.4));
        let emitted = decode_f64(0.4) as f32 * 2.0;
        assert_eq!(material.emissive.z, emitted);
    }

    #[test]
    fn what_varies_stays() {
        let material = folded(scene(|texture| Material {
            base_color_texture: texture(3),
            metallic_roughness_texture: texture(3),
            normal_texture: texture(1),
            occlusion_texture: texture(1),
            emissive: Vec3::ONE,
            emissive_texture: texture(3),
            ..Material::default()
        }));
        assert_eq!(MaterialUse::of(Some(&material)).textures().count(), 5);
        assert_eq!((material.roughness, material.base_color), (1.0, Vec4::ONE));
    }

    #[test]
    fn alpha_that_decides_nothing_is_opaque() {
        let mode = |alpha_mode, texture, alpha| {
            let scene = scene(|reference| Material {
                alpha_mode,
                base_color: Vec4::new(1.0, 1.0, 1.0, alpha),
                base_color_texture: reference(texture),
                ..Material::default()
            });
            folded(scene).alpha_mode
        };
        assert_eq!(mode(AlphaMode::Blend, 3, 1.0), AlphaMode::Opaque);
        assert_eq!(mode(AlphaMode::Blend, 3, 0.5), AlphaMode::Blend);
        assert_eq!(mode(AlphaMode::Blend, 1, 1.0), AlphaMode::Blend);
        assert_eq!(mode(AlphaMode::Mask, 3, 0.5), AlphaMode::Opaque);
        assert_eq!(mode(AlphaMode::Mask, 3, 0.4), AlphaMode::Mask);
        assert_eq!(mode(AlphaMode::Mask, 1, 1.0), AlphaMode::Opaque);
    }

    #[test]
    fn translucent_vertices_keep_the_mode() {
        let mut scene = scene(|_| Material {
            alpha_mode: AlphaMode::Blend,
            ..Material::default()
        });
        scene.meshes = vec![Mesh {
            primitives: vec![Primitive {
                colors: Some(vec![[1.0, 1.0, 1.0, 0.5]]),
                material: Some(0),
                ..Primitive::default()
            }],
            ..Mesh::default()
        }];
        assert_eq!(folded(scene.clone()).alpha_mode, AlphaMode::Blend);
        scene.meshes.clear();
        assert_eq!(folded(scene).alpha_mode, AlphaMode::Opaque);
    }

    #[test]
    fn constant_channels_are_found_one_by_one() {
        let texels = [[1, 2, 3, 4], [1, 9, 3, 4], [1, 2, 3, 5]];
        assert_eq!(constant(&texels), [Some(1), None, Some(3), None]);
        assert_eq!(constant(&[]), [None; 4]);
    }
}
