//! Parses the JSON of a glTF file into typed form.

use gltf::json;
use gltf::json::extensions::scene::khr_lights_punctual::Light;
use serde::Deserialize;
use serde::de::IgnoredAny;

use super::integers;

/// The parts of a glTF file that import reads. Unlike `gltf::json::Root` it lets what is not read
/// (animations) have any shape, and a scene have no nodes, as the specification does.
#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Document {
    pub extensions_used: Vec<String>,
    pub extensions_required: Vec<String>,
    pub accessors: Vec<json::Accessor>,
    pub animations: Vec<IgnoredAny>,
    pub buffers: Vec<json::Buffer>,
    pub buffer_views: Vec<json::buffer::View>,
    pub cameras: Vec<json::Camera>,
    pub images: Vec<json::Image>,
    pub materials: Vec<json::Material>,
    pub meshes: Vec<json::Mesh>,
    pub nodes: Vec<json::Node>,
    pub samplers: Vec<json::texture::Sampler>,
    pub scene: Option<u32>,
    pub scenes: Vec<Scene>,
    /// Free-form: only the skins of placed meshes are read.
    pub skins: Vec<serde_json::Value>,
    pub textures: Vec<json::Texture>,
    pub extensions: Option<json::extensions::root::Root>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Scene {
    pub nodes: Vec<u32>,
}

/// Only the version, so that a glTF 1.0 file is named as such and not by its first odd property.
#[derive(Deserialize)]
struct Probe {
    asset: Option<Asset>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Asset {
    version: String,
    min_version: Option<String>,
}

/// Why a JSON text is refused: stable code, place (`line 3 column 7` or a JSON pointer), message.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Refusal {
    pub code: &'static str,
    pub place: String,
    pub message: String,
}

/// Extensions that import honours.
const SUPPORTED: [&str; 16] = [
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "EXT_texture_webp",
    "KHR_draco_mesh_compression",
    "KHR_lights_punctual",
    "KHR_materials_clearcoat",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_unlit",
    "KHR_mesh_quantization",
    "KHR_meshopt_compression",
    "KHR_texture_basisu",
    "KHR_texture_transform",
    "MSFT_texture_dds",
];

impl Document {
    /// Parses JSON text.
    ///
    /// # Errors
    /// Broken syntax, a property of the wrong type, another glTF version, or a required extension
    /// that is not supported.
    pub fn parse(text: &[u8]) -> Result<Self, Refusal> {
        let text = text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(text);
        if text.trim_ascii_start().first() != Some(&b'{') {
            let message = "this is neither glTF JSON nor a .glb; export the scene as glTF 2.0";
            return Err(refuse("not-gltf", "", message));
        }
        let probe: Probe = serde_json::from_slice(text).map_err(malformed)?;
        check_version(probe.asset)?;
        let document = typed(text).or_else(|refusal| match integral(text) {
            Some(rewritten) => typed(&rewritten).map_err(|_| refusal),
            None => Err(refusal),
        })?;
        for (index, name) in document.extensions_required.iter().enumerate() {
            if !SUPPORTED.contains(&name.as_str()) {
                let message = format!(
                    "the scene requires the extension {name}, which is not supported; \
                     export without it"
                );
                let place = format!("/extensionsRequired/{index}");
                return Err(refuse("extension-required", place, message));
            }
        }
        Ok(document)
    }

    /// Kind and name of the top-level element that a JSON pointer leads into, such as "mesh `Wheel`"; empty
    /// where it leads elsewhere or the element has no name.
    pub fn object_at(&self, pointer: &str) -> String {
        let mut parts = pointer.split('/').skip(1);
        let (Some(array), Some(index)) = (parts.next(), parts.next()) else {
            return String::new();
        };
        let Ok(index) = index.parse::<usize>() else {
            return String::new();
        };
        macro_rules! named {
            ($($array:literal $kind:literal $field:ident),*) => {
                match array {
                    $($array => (
                        $kind,
                        self.$field.get(index).and_then(|element| element.name.as_deref()),
                    ),)*
                    _ => ("", None),
                }
            };
        }
        let (kind, name) = named!(
            "accessors" "accessor" accessors,
            "buffers" "buffer" buffers,
            "bufferViews" "buffer view" buffer_views,
            "cameras" "camera" cameras,
            "images" "image" images,
            "materials" "material" materials,
            "meshes" "mesh" meshes,
            "nodes" "node" nodes,
            "samplers" "sampler" samplers,
            "textures" "texture" textures
        );
        name.filter(|name| !name.is_empty())
            .map_or(String::new(), |name| format!("{kind} `{name}`"))
    }

    /// Extensions that are used but have no effect here, with their place in `extensionsUsed`.
    pub fn ignored_extensions(&self) -> impl Iterator<Item = (usize, &str)> {
        let names = self.extensions_used.iter().map(String::as_str);
        names
            .enumerate()
            .filter(|(index, name)| {
                let first = self.extensions_used.iter().position(|other| other == name);
                !SUPPORTED.contains(name) && first == Some(*index)
            })
            .take(64)
    }

    /// Whether attributes may have the types that `KHR_mesh_quantization` adds.
    pub fn quantized(&self) -> bool {
        let names = self.extensions_used.iter().chain(&self.extensions_required);
        names
            .into_iter()
            .any(|name| name == "KHR_mesh_quantization")
    }

    /// The lights of `KHR_lights_punctual`.
    pub fn lights(&self) -> &[Light] {
        self.extensions
            .as_ref()
            .and_then(|extensions| extensions.khr_lights_punctual.as_ref())
            .map_or(&[], |extension| &extension.lights)
    }
}

/// Parses once, without tolerance for integers written as floats.
fn typed(text: &[u8]) -> Result<Document, Refusal> {
    if let Some((place, value)) = integers::find_oversized(text).map_err(malformed)? {
        let message = format!("{value} is out of range for an index; correct or re-export it");
        return Err(refuse("index-out-of-range", place, message));
    }
    serde_json::from_slice(text).map_err(malformed)
}

/// The JSON with every integral float (`3.0`, `2e0`, which glTF allows for integers) written as an
/// integer.
fn integral(text: &[u8]) -> Option<Vec<u8>> {
    let mut value: serde_json::Value = serde_json::from_slice(text).ok()?;
    make_integral(&mut value)
        .then(|| serde_json::to_vec(&value).ok())
        .flatten()
}

/// Writes every integral float as an integer; whether there was one.
pub(super) fn make_integral(value: &mut serde_json::Value) -> bool {
    let mut changed = false;
    let mut rest = vec![value];
    while let Some(value) = rest.pop() {
        match value {
            serde_json::Value::Array(elements) => rest.extend(elements),
            serde_json::Value::Object(members) => rest.extend(members.values_mut()),
            serde_json::Value::Number(number) if number.is_f64() => {
                const EXACT: f64 = (1u64 << 53) as f64;
                let integral = |float: &f64| float.fract() == 0.0 && (0.0..=EXACT).contains(float);
                if let Some(float) = number.as_f64().filter(integral) {
                    *number = (float as u64).into();
                    changed = true;
                }
            }
            _ => {}
        }
    }
    changed
}

fn refuse(code: &'static str, place: impl Into<String>, message: impl Into<String>) -> Refusal {
    Refusal {
        code,
        place: place.into(),
        message: message.into(),
    }
}

/// Restates a JSON error with its line and column as the place.
fn malformed(error: serde_json::Error) -> Refusal {
    let place = format!("line {} column {}", error.line(), error.column());
    let text = error.to_string();
    let what = text.split(" at line ").next().unwrap_or_default();
    let code = match error.classify() {
        serde_json::error::Category::Data => "gltf-schema",
        _ if what == "number out of range" => "number-range",
        _ => "json-syntax",
    };
    refuse(
        code,
        place,
        format!("{what}; correct the file or export it again"),
    )
}

/// Accepts glTF 2.x files that a 2.0 reader may read.
fn check_version(asset: Option<Asset>) -> Result<(), Refusal> {
    let Some(asset) = asset else {
        let message = "the required property `asset` is absent, so this is not glTF 2.0; export it as glTF 2.0";
        return Err(refuse("gltf-version", "", message));
    };
    let major_minor = |version: &str| -> Option<(u32, u32)> {
        let (major, minor) = version.split_once('.')?;
        Some((major.parse().ok()?, minor.parse().ok()?))
    };
    let (place, version, supported) = match &asset.min_version {
        Some(version) => {
            let supported = major_minor(version) == Some((2, 0));
            ("/asset/minVersion", version, supported)
        }
        None => {
            let major = major_minor(&asset.version).map(|(major, _)| major);
            ("/asset/version", &asset.version, major == Some(2))
        }
    };
    if supported {
        return Ok(());
    }
    let message =
        format!("glTF version `{version}`, only 2.0 is supported; convert it to glTF 2.0");
    Err(refuse("gltf-version", place, message))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refusal(text: &str) -> Refusal {
        Document::parse(text.as_bytes()).expect_err(text)
    }

    #[test]
    fn minimal_documents_parse() {
        let text = b"\xef\xbb\xbf{\"asset\":{\"version\":\"2.0\"},\"scenes\":[{}]}";
        assert!(Document::parse(text).unwrap().scenes[0].nodes.is_empty());
        let text = br#"{"asset":{"version":"2.1"},"animations":[{"channels":[{"target":{}}]}]}"#;
        assert_eq!(Document::parse(text).unwrap().animations.len(), 1);
    }

    #[test]
    fn objects_are_named() {
        let text = br#"{"asset":{"version":"2.0"},"nodes":[{"name":"Hall"},{},{"name":""}],
            "meshes":[{"name":"Wheel","primitives":[]}]}"#;
        let document = Document::parse(text).expect("a document");
        for (pointer, object) in [
            ("/nodes/0", "node `Hall`"),
            ("/meshes/0/primitives/3/attributes", "mesh `Wheel`"),
            ("/nodes/1", ""),
            ("/nodes/2", ""),
            ("/nodes/9", ""),
            ("/nodes/x", ""),
            ("/asset/version", ""),
            ("byte 12", ""),
            ("", ""),
        ] {
            assert_eq!(document.object_at(pointer), object, "{pointer}");
        }
    }

    #[test]
    fn versions_are_checked_first() {
        let old = r#"{"asset":{"version":"1.0"},"accessors":{"a":{}}}"#;
        assert_eq!(refusal(old).code, "gltf-version");
        assert_eq!(refusal("{}").code, "gltf-version");
        assert_eq!(refusal(r#"{"asset":{"version":"2"}}"#).code, "gltf-version");
        let newer = r#"{"asset":{"version":"2.0","minVersion":"2.1"}}"#;
        assert_eq!(refusal(newer).place, "/asset/minVersion");
    }

    #[test]
    fn faults_carry_their_place() {
        let syntax = refusal("{\n \"asset\": {\"version\": \"2.0\"},\n }");
        assert_eq!(
            (syntax.code, syntax.place.as_str()),
            ("json-syntax", "line 3 column 2")
        );
        let schema = refusal("{\"asset\":{\"version\":\"2.0\"},\n\"nodes\":[{\"mesh\":\"a\"}]}");
        assert_eq!(schema.code, "gltf-schema");
        assert!(schema.place.starts_with("line 2 "));
        let index = refusal(r#"{"asset":{"version":"2.0"},"nodes":[{"mesh":4294967296}]}"#);
        assert_eq!(index.place, "/nodes/0/mesh");
    }

    #[test]
    fn integers_may_be_written_as_floats() {
        let text =
            br#"{"asset":{"version":"2.0"},"nodes":[{"mesh":2.0},{"mesh":30e-1}],"scene":0.0}"#;
        let document = Document::parse(text).unwrap();
        assert_eq!(document.nodes[1].mesh.unwrap().value(), 3);
        let fraction =
            refusal(r#"{"asset":{"version":"2.0"},"nodes":[{"mesh":2.5},{"mesh":3.0}]}"#);
        assert_eq!(fraction.code, "gltf-schema");
        assert!(fraction.place.starts_with("line 1 "));
        let huge = refusal(r#"{"asset":{"version":"2.0"},"nodes":[{"mesh":4294967296.0}]}"#);
        assert_eq!(huge.code, "gltf-schema");
    }

    #[test]
    fn other_files_are_not_gltf() {
        for text in ["", "  ", "Kaydara FBX Binary", "[]", "glT"] {
            assert_eq!(refusal(text).code, "not-gltf", "{text}");
        }
    }

    #[test]
    fn required_extensions_are_named() {
        let text =
            r#"{"asset":{"version":"2.0"},"extensionsRequired":["KHR_mesh_quantization","EXT_x"]}"#;
        let fault = refusal(text);
        assert_eq!(fault.place, "/extensionsRequired/1");
        assert!(fault.message.contains("EXT_x"));
    }

    #[test]
    fn ignored_extensions_are_listed_once() {
        let text =
            br#"{"asset":{"version":"2.0"},"extensionsUsed":["A","KHR_materials_unlit","A","B"]}"#;
        let document = Document::parse(text).unwrap();
        let ignored: Vec<_> = document.ignored_extensions().collect();
        assert_eq!(ignored, [(0, "A"), (3, "B")]);
    }
}
