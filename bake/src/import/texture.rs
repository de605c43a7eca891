//! Reads the textures, samplers and images that materials use.

use std::collections::{BTreeMap, BTreeSet};

use gltf::json;
use gltf::json::texture::{MagFilter, MinFilter, WrappingMode};
use gltf::json::validation::Checked;

use crate::diagnostic::Result;
use crate::scene::{Sampler, Scene, Texture, Wrap};

use super::context::Context;
use super::{Renumber, extension, image, slots};

/// Extensions by which a texture names an image of another format, in the order in which they are followed. A
/// core image beside them is the fallback of readers that do not know them.
const SOURCES: [&str; 3] = ["KHR_texture_basisu", "EXT_texture_webp", "MSFT_texture_dds"];

/// Reads what the materials of `scene` refer to, in glTF order, and renumbers the references; images of equal bytes
/// become one. References to textures without an image are removed with a warning.
///
/// # Errors
/// A missing index, an unknown sampler enumerator, or an unreadable image.
pub(super) fn read_used(context: &Context, scene: &mut Scene) -> Result<()> {
    let mut sources = BTreeMap::new();
    for slot in scene.materials.iter_mut().flat_map(slots) {
        let Some(reference) = slot else { continue };
        match source(context, reference.texture)? {
            Some(image) => {
                sources.insert(reference.texture, image);
            }
            None => *slot = None,
        }
    }
    let renumber = Renumber::new(&sources.keys().copied().collect());
    for reference in scene.materials.iter_mut().flat_map(slots).flatten() {
        reference.texture = renumber.get(reference.texture);
    }
    let images = read_images(context, scene, &sources)?;
    for (&index, image) in &sources {
        let texture = &context.document.textures[index as usize];
        scene.textures.push(Texture {
            image: images[image],
            sampler: sampler_index(context, index, texture)?,
        });
    }
    let samplers: BTreeSet<u32> = scene.textures.iter().filter_map(|t| t.sampler).collect();
    for &index in &samplers {
        scene.samplers.push(sampler(context, index)?);
    }
    let samplers = Renumber::new(&samplers);
    for texture in &mut scene.textures {
        texture.sampler = texture.sampler.map(|index| samplers.get(index));
    }
    name_users(scene);
    Ok(())
}

/// Reads the images of the textures, each content once; the scene's index of each glTF index.
fn read_images(
    context: &Context,
    scene: &mut Scene,
    sources: &BTreeMap<u32, u32>,
) -> Result<BTreeMap<u32, u32>> {
    let mut contents = BTreeMap::new();
    let mut ranks = BTreeMap::new();
    for &index in sources.values().collect::<BTreeSet<_>>() {
        let image = image::read(context, index)?;
        let hash = *blake3::hash(&image.bytes).as_bytes();
        let rank = *contents.entry(hash).or_insert_with(|| {
            scene.images.push(image);
            scene.images.len() as u32 - 1
        });
        ranks.insert(index, rank);
    }
    Ok(ranks)
}

/// Names the first material that uses each image.
fn name_users(scene: &mut Scene) {
    for material in &mut scene.materials {
        let name = material.name.clone();
        for reference in slots(material).into_iter().flatten() {
            let texture = scene.textures[reference.texture as usize];
            let image = &mut scene.images[texture.image as usize];
            if image.material.is_empty() {
                image.material.clone_from(&name);
            }
        }
    }
}

/// The glTF index of a texture's image.
fn source(context: &Context, index: u32) -> Result<Option<u32>> {
    let texture = &context.document.textures[index as usize];
    let images = context.document.images.len();
    let in_range = |source: usize, pointer: String| {
        if source < images {
            Ok(Some(source as u32))
        } else {
            Err(context.absent(pointer, "image", source, images))
        }
    };
    let others = texture
        .extensions
        .as_ref()
        .map(|extensions| &extensions.others);
    for name in SOURCES {
        if let Some(value) = others.and_then(|others| others.get(name)) {
            let pointer = format!("/textures/{index}/extensions/{name}");
            let found: ExtensionSource = extension::parse(context, value, &pointer)?;
            if let Some(source) = found.source {
                return in_range(source, format!("{pointer}/source"));
            }
        }
    }
    // The typed JSON stands u32::MAX for an absent source.
    if texture.source.value() != u32::MAX as usize {
        return in_range(texture.source.value(), format!("/textures/{index}/source"));
    }
    let names: Vec<&str> = others
        .map(|others| others.keys().map(String::as_str).collect())
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
    Ok(None)
}

/// The object of all extensions of [`SOURCES`].
#[derive(serde::Deserialize)]
struct ExtensionSource {
    source: Option<usize>,
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
    fn textures_without_a_known_image_are_dropped() {
        let context = context(
            r#""images":[{"uri":"a.avif"}],
            "textures":[{"extensions":{"EXT_texture_avif":{"source":0}}},{}]"#,
        );
        let mut scene = using([0, 1]);
        read_used(&context, &mut scene).unwrap();
        assert!(scene.textures.is_empty() && scene.images.is_empty());
        assert_eq!(scene.materials[0].base_color_texture, None);
        let (_, diagnostics) = context.finish();
        assert!(diagnostics[0].message.contains("EXT_texture_avif"));
        assert_eq!(diagnostics.len(), 2);
    }

    #[test]
    fn extensions_name_the_image_before_the_core() {
        let images: Vec<String> = (b'a'..=b'd')
            .map(|name| format!(r#"{{"uri":"{}"}}"#, data_uri(&[name])))
            .collect();
        let context = context(&format!(
            r#""images":[{}],"textures":[
            {{"source":0,"extensions":{{"EXT_texture_webp":{{"source":1}}}}}},
            {{"source":0,"extensions":{{"EXT_texture_webp":{{"source":1}},"KHR_texture_basisu":{{"source":2}}}}}},
            {{"extensions":{{"MSFT_texture_dds":{{"source":3.0}}}}}}, {{"source":0}}]"#,
            images.join(",")
        ));
        let mut scene = using([0, 1, 2, 3]);
        scene.materials[0].name = "wood".into();
        read_used(&context, &mut scene).unwrap();
        let bytes = |texture: usize| &scene.images[scene.textures[texture].image as usize].bytes;
        let read: Vec<&[u8]> = (0..4).map(|texture| bytes(texture).as_slice()).collect();
        assert_eq!(read, [b"b", b"c", b"d", b"a"]);
        assert_eq!(scene.images[0].material, "wood");
    }

    #[test]
    fn equal_content_is_one_image() {
        let same = data_uri(b"x");
        let context = context(&format!(
            r#""images":[{{"uri":"{same}"}},{{"uri":"{}"}},{{"uri":"{same}","name":"copy"}}],
            "textures":[{{"source":0}},{{"source":1}},{{"source":2}}]"#,
            data_uri(b"y")
        ));
        let mut scene = using([0, 1, 2]);
        read_used(&context, &mut scene).unwrap();
        let images: Vec<u32> = scene.textures.iter().map(|texture| texture.image).collect();
        assert_eq!((images.as_slice(), scene.images.len()), (&[0, 1, 0][..], 2));
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
        let basisu = |source: &str| {
            code(&format!(
                r#""textures":[{{"extensions":{{"KHR_texture_basisu":{{"source":{source}}}}}}}]"#
            ))
        };
        let place = "/textures/0/extensions/KHR_texture_basisu";
        assert_eq!(basisu("2"), out(&format!("{place}/source")));
        assert_eq!(basisu("-1"), ("extension-schema", place.into()));
        for property in ["magFilter", "minFilter", "wrapS", "wrapT"] {
            let body = format!(
                r#""textures":[{{"source":0,"sampler":0}}],"samplers":[{{"{property}":1}}]"#
            );
            let place = format!("/samplers/0/{property}");
            assert_eq!(code(&body), ("sampler-value", place));
        }
    }
}
