//! Reads the textures, samplers and images that materials use.

use std::collections::BTreeSet;

use gltf::json;
use gltf::json::texture::{MagFilter, MinFilter, WrappingMode};
use gltf::json::validation::Checked;

use crate::diagnostic::Result;
use crate::scene::{Sampler, Scene, Texture, Wrap};

use super::context::Context;
use super::{Renumber, image, slots};

/// Reads what the materials of `scene` refer to, in glTF order, and renumbers the references.
/// References to textures without a PNG or JPEG image are removed with a warning.
///
/// # Errors
/// A missing index, an unknown sampler enumerator, or an unreadable image.
pub(super) fn read_used(context: &Context, scene: &mut Scene) -> Result<()> {
    let mut used = BTreeSet::new();
    for slot in scene.materials.iter_mut().flat_map(slots) {
        if let Some(reference) = slot {
            if has_source(context, reference.texture)? {
                used.insert(reference.texture);
            } else {
                *slot = None;
            }
        }
    }
    let renumber = Renumber::new(&used);
    for reference in scene.materials.iter_mut().flat_map(slots).flatten() {
        reference.texture = renumber.get(reference.texture);
    }
    for &index in &used {
        let texture = &context.document.textures[index as usize];
        scene.textures.push(Texture {
            image: texture.source.value() as u32,
            sampler: sampler_index(context, index, texture)?,
        });
    }
    let images: BTreeSet<u32> = scene.textures.iter().map(|t| t.image).collect();
    for &index in &images {
        scene.images.push(image::read(context, index)?);
    }
    let samplers: BTreeSet<u32> = scene.textures.iter().filter_map(|t| t.sampler).collect();
    for &index in &samplers {
        scene.samplers.push(sampler(context, index)?);
    }
    let (images, samplers) = (Renumber::new(&images), Renumber::new(&samplers));
    for texture in &mut scene.textures {
        texture.image = images.get(texture.image);
        texture.sampler = texture.sampler.map(|index| samplers.get(index));
    }
    Ok(())
}

/// Whether a texture names an image in core glTF.
fn has_source(context: &Context, index: u32) -> Result<bool> {
    let texture = &context.document.textures[index as usize];
    let images = context.document.images.len();
    let source = texture.source.value();
    if source < images {
        return Ok(true);
    }
    // The typed JSON stands u32::MAX for an absent source.
    if source != u32::MAX as usize {
        let pointer = format!("/textures/{index}/source");
        return Err(context.absent(pointer, "image", source, images));
    }
    let extensions = texture.extensions.as_ref();
    let names: Vec<&str> = extensions
        .map(|extensions| extensions.others.keys().map(String::as_str).collect())
        .unwrap_or_default();
    let message = if names.is_empty() {
        "the texture names no image and is left out".into()
    } else {
        let names = names.join(", ");
        format!("the texture's image needs {names}, which is not supported; it is left out")
    };
    let group = names.join(",");
    context.warn_group(
        "texture-without-source",
        &group,
        format!("/textures/{index}"),
        message,
    );
    Ok(false)
}

fn sampler_index(context: &Context, index: u32, texture: &json::Texture) -> Result<Option<u32>> {
    let samplers = context.document.samplers.len();
    match texture.sampler.map(|sampler| sampler.value()) {
        Some(sampler) if sampler >= samplers => {
            let pointer = format!("/textures/{index}/sampler");
            Err(context.absent(pointer, "sampler", sampler, samplers))
        }
        sampler => Ok(sampler.map(|sampler| sampler as u32)),
    }
}

fn sampler(context: &Context, index: u32) -> Result<Sampler> {
    let sampler = &context.document.samplers[index as usize];
    let fault = |property: &str| {
        let pointer = format!("/samplers/{index}/{property}");
        let message = "the value is none that glTF 2.0 knows; export again";
        context.error("sampler-value", pointer, message)
    };
    let wrap = |mode: &Checked<WrappingMode>, property| match mode {
        Checked::Valid(WrappingMode::Repeat) => Ok(Wrap::Repeat),
        Checked::Valid(WrappingMode::MirroredRepeat) => Ok(Wrap::MirroredRepeat),
        Checked::Valid(WrappingMode::ClampToEdge) => Ok(Wrap::ClampToEdge),
        Checked::Invalid => Err(fault(property)),
    };
    let mag_linear = match sampler.mag_filter {
        None | Some(Checked::Valid(MagFilter::Linear)) => true,
        Some(Checked::Valid(MagFilter::Nearest)) => false,
        Some(Checked::Invalid) => return Err(fault("magFilter")),
    };
    let min = match sampler.min_filter {
        None => MinFilter::LinearMipmapLinear,
        Some(Checked::Valid(filter)) => filter,
        Some(Checked::Invalid) => return Err(fault("minFilter")),
    };
    let (min_linear, mip_linear) = match min {
        MinFilter::Nearest => (false, None),
        MinFilter::Linear => (true, None),
        MinFilter::NearestMipmapNearest => (false, Some(false)),
        MinFilter::LinearMipmapNearest => (true, Some(false)),
        MinFilter::NearestMipmapLinear => (false, Some(true)),
        MinFilter::LinearMipmapLinear => (true, Some(true)),
    };
    Ok(Sampler {
        mag_linear,
        min_linear,
        mip_linear,
        wrap_u: wrap(&sampler.wrap_s, "wrapS")?,
        wrap_v: wrap(&sampler.wrap_t, "wrapT")?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::testing::{context, data_uri, fault};
    use crate::scene::{Material, TextureRef};

    /// A scene whose one material uses the given textures in its first slots.
    fn using<const N: usize>(textures: [u32; N]) -> Scene {
        let mut material = Material::default();
        for (slot, texture) in slots(&mut material).into_iter().zip(textures) {
            *slot = Some(TextureRef::new(texture, 0));
        }
        Scene {
            materials: vec![material],
            ..Scene::default()
        }
    }

    #[test]
    fn only_used_images_are_read() {
        let context = context(&format!(
            r#""images":[{{"uri":"absent.png"}},{{"uri":"{}","name":"used"}}],
            "samplers":[{{}},{{"magFilter":9728,"minFilter":9985,"wrapS":33071,"wrapT":33648}}],
            "textures":[{{"source":0}},{{"source":1,"sampler":1}},{{"source":1}}]"#,
            data_uri(b"x")
        ));
        let mut scene = using([2, 1]);
        read_used(&context, &mut scene).unwrap();
        assert_eq!(scene.images.len(), 1);
        assert_eq!(scene.images[0].name, "used");
        assert_eq!(scene.images[0].origin.pointer, "/images/1");
        let texture = |sampler| Texture { image: 0, sampler };
        assert_eq!(scene.textures, [texture(Some(0)), texture(None)]);
        assert_eq!(scene.materials[0].base_color_texture.unwrap().texture, 1);
        let expected = Sampler {
            mag_linear: false,
            min_linear: true,
            mip_linear: Some(false),
            wrap_u: Wrap::ClampToEdge,
            wrap_v: Wrap::MirroredRepeat,
        };
        assert_eq!(scene.samplers, [expected]);
        let error = fault(read_used(&context, &mut using([0])));
        assert_eq!(
            (error.code, error.place.as_str()),
            ("file-missing", "/images/0")
        );
        assert!(error.message.contains("absent.png"));
    }

    #[test]
    fn textures_without_a_core_image_are_dropped() {
        let context = context(
            r#""images":[{"uri":"a.webp"}],
            "textures":[{"extensions":{"EXT_texture_webp":{"source":0}}},{}]"#,
        );
        let mut scene = using([0, 1]);
        read_used(&context, &mut scene).unwrap();
        assert!(scene.textures.is_empty() && scene.images.is_empty());
        assert_eq!(scene.materials[0].base_color_texture, None);
        let (_, diagnostics) = context.finish();
        assert!(diagnostics[0].message.contains("EXT_texture_webp"));
        assert_eq!(diagnostics.len(), 2);
    }

    #[test]
    fn faults_are_refused() {
        let code = |body: &str| {
            let images = format!(r#""images":[{{"uri":"{}"}},{{}}]"#, data_uri(b"x"));
            let error = fault(read_used(
                &context(&format!("{images},{body}")),
                &mut using([0]),
            ));
            (error.code, error.place)
        };
        let out = |place: &str| ("index-out-of-range", place.to_owned());
        assert_eq!(
            code(r#""textures":[{"source":2}]"#),
            out("/textures/0/source")
        );
        assert_eq!(
            code(r#""textures":[{"source":0,"sampler":0}]"#),
            out("/textures/0/sampler")
        );
        assert_eq!(code(r#""textures":[{"source":1}]"#).0, "image-source");
        for property in ["magFilter", "minFilter", "wrapS", "wrapT"] {
            let body = format!(
                r#""textures":[{{"source":0,"sampler":0}}],"samplers":[{{"{property}":1}}]"#
            );
            let place = format!("/samplers/0/{property}");
            assert_eq!(code(&body), ("sampler-value", place));
        }
    }
}
