//! Writes glTF 2.0 files from meshes, materials and nodes.

use base64::Engine;
use glam::{EulerRot, Quat, Vec3};
use serde_json::{Map, Value, json};

use crate::mesh::Mesh;

/// Index of a geometry: attribute and index accessors that several meshes may share.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Geometry(usize);

/// Index of a material.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Material(pub usize);

/// Where the binary buffer goes.
#[derive(Debug, Clone, Copy)]
pub enum BufferPlace<'a> {
    /// A file of this name beside the glTF.
    File(&'a str),
    /// A base64 data URI inside the glTF.
    Embedded,
}

/// Translation (metres), rotation and scale of a node.
#[derive(Debug, Clone, Copy)]
pub struct Placement {
    pub translation: Vec3,
    pub rotation: Quat,
    pub scale: Vec3,
}

impl Placement {
    pub fn at(x: f32, y: f32, z: f32) -> Self {
        Self {
            translation: Vec3::new(x, y, z),
            rotation: Quat::IDENTITY,
            scale: Vec3::ONE,
        }
    }

    /// Turned about +y by `degrees`, counter-clockwise seen from above.
    pub fn yaw(mut self, degrees: f32) -> Self {
        self.rotation = Quat::from_rotation_y(degrees.to_radians());
        self
    }

    pub fn scaled(mut self, x: f32, y: f32, z: f32) -> Self {
        self.scale = Vec3::new(x, y, z);
        self
    }

    /// A camera or light at `eye` whose -z axis points at `target`.
    pub fn looking(eye: Vec3, target: Vec3) -> Self {
        let direction = (target - eye).normalize();
        let yaw = libm::atan2f(-direction.x, -direction.z);
        let pitch = libm::asinf(direction.y);
        Self {
            translation: eye,
            rotation: Quat::from_euler(EulerRot::YXZ, yaw, pitch, 0.0),
            scale: Vec3::ONE,
        }
    }
}

/// The four vertex and index streams that every geometry shares.
#[derive(Debug, Clone, Copy)]
enum Stream {
    Index,
    Position,
    Normal,
    TexCoord,
}

impl Stream {
    const ALL: [(Self, &'static str, Option<usize>); 4] = [
        (Self::Index, "indices", None),
        (Self::Position, "positions", Some(12)),
        (Self::Normal, "normals", Some(12)),
        (Self::TexCoord, "texcoords", Some(8)),
    ];
}

/// Half-angles of a spot light in radians.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cone {
    pub inner: f32,
    pub outer: f32,
}

/// Collects a scene, then writes it.
#[derive(Debug, Default)]
pub struct Builder {
    streams: [Vec<u8>; 4],
    accessors: Vec<Value>,
    geometries: Vec<Value>,
    images: Vec<Value>,
    textures: Vec<Value>,
    materials: Vec<Value>,
    meshes: Vec<Value>,
    mesh_keys: Vec<(Geometry, Material)>,
    cameras: Vec<Value>,
    lights: Vec<Value>,
    nodes: Vec<Value>,
    extensions: Vec<&'static str>,
}

/// A number rounded to six decimals, so that the text stays short.
pub fn number(value: f32) -> Value {
    json!(libm::round(f64::from(value) * 1e6) / 1e6)
}

fn numbers(values: &[f32]) -> Value {
    values.iter().copied().map(number).collect()
}

impl Builder {
    fn accessor(&mut self, stream: Stream, bytes: &[u8], mut fields: Value) -> usize {
        let data = &mut self.streams[stream as usize];
        fields["bufferView"] = json!(stream as usize);
        fields["byteOffset"] = json!(data.len());
        data.extend_from_slice(bytes);
        self.accessors.push(fields);
        self.accessors.len() - 1
    }

    /// Writes a mesh's streams once; u16 indices, float attributes, no tangents (the bake makes them).
    pub fn geometry(&mut self, mesh: &Mesh) -> Geometry {
        let count = mesh.positions.len();
        assert!(count <= usize::from(u16::MAX), "u16 indices");
        let (mut low, mut high) = (Vec3::MAX, Vec3::MIN);
        for &p in &mesh.positions {
            low = low.min(p);
            high = high.max(p);
        }
        let float = |kind: &str| json!({"componentType": 5126, "count": count, "type": kind});
        let mut position = float("VEC3");
        position["min"] = json!(low.to_array().map(f64::from));
        position["max"] = json!(high.to_array().map(f64::from));
        let bytes = bytemuck::cast_slice(&mesh.positions);
        let mut attributes = json!({"POSITION": self.accessor(Stream::Position, bytes, position)});
        let bytes = bytemuck::cast_slice(&mesh.normals);
        attributes["NORMAL"] = json!(self.accessor(Stream::Normal, bytes, float("VEC3")));
        let bytes = bytemuck::cast_slice(&mesh.uvs);
        attributes["TEXCOORD_0"] = json!(self.accessor(Stream::TexCoord, bytes, float("VEC2")));
        if !mesh.uvs1.is_empty() {
            let bytes = bytemuck::cast_slice(&mesh.uvs1);
            attributes["TEXCOORD_1"] = json!(self.accessor(Stream::TexCoord, bytes, float("VEC2")));
        }
        let fields = json!({"componentType": 5123, "count": mesh.indices.len(), "type": "SCALAR"});
        let bytes = bytemuck::cast_slice(&mesh.indices);
        let indices = self.accessor(Stream::Index, bytes, fields);
        self.geometries
            .push(json!({"attributes": attributes, "indices": indices}));
        Geometry(self.geometries.len() - 1)
    }

    /// A repeating, trilinear texture of the PNG at `uri`.
    pub fn texture(&mut self, name: &str, uri: &str) -> usize {
        self.images.push(json!({"name": name, "uri": uri}));
        self.textures
            .push(json!({"name": name, "sampler": 0, "source": self.images.len() - 1}));
        self.textures.len() - 1
    }

    /// Adds a material given as its glTF object.
    pub fn material(&mut self, name: &str, mut fields: Value) -> Material {
        fields["name"] = json!(name);
        if let Some(extensions) = fields.get("extensions").and_then(Value::as_object) {
            let known = [
                "KHR_materials_clearcoat",
                "KHR_materials_emissive_strength",
                "KHR_materials_ior",
                "KHR_materials_sheen",
                "KHR_materials_specular",
                "KHR_materials_unlit",
            ];
            for name in known {
                if extensions.contains_key(name) {
                    self.use_extension(name);
                }
            }
        }
        self.materials.push(fields);
        Material(self.materials.len() - 1)
    }

    fn use_extension(&mut self, name: &'static str) {
        if !self.extensions.contains(&name) {
            self.extensions.push(name);
            self.extensions.sort_unstable();
        }
    }

    fn mesh(&mut self, name: &str, geometry: Geometry, material: Material) -> usize {
        if let Some(known) = self
            .mesh_keys
            .iter()
            .position(|k| *k == (geometry, material))
        {
            return known;
        }
        let mut primitive = self.geometries[geometry.0].clone();
        primitive["material"] = json!(material.0);
        self.meshes
            .push(json!({"name": name, "primitives": [primitive]}));
        self.mesh_keys.push((geometry, material));
        self.meshes.len() - 1
    }

    fn node(&mut self, name: &str, placement: Placement, extra: (&str, Value)) {
        let mut node = json!({"name": name});
        node[extra.0] = extra.1;
        if placement.translation != Vec3::ZERO {
            node["translation"] = numbers(&placement.translation.to_array());
        }
        if placement.rotation != Quat::IDENTITY {
            node["rotation"] = numbers(&placement.rotation.normalize().to_array());
        }
        if placement.scale != Vec3::ONE {
            node["scale"] = numbers(&placement.scale.to_array());
        }
        self.nodes.push(node);
    }

    /// Places a geometry with a material; equal pairs share one glTF mesh.
    pub fn place(&mut self, name: &str, geometry: Geometry, material: Material, at: Placement) {
        let mesh = self.mesh(name, geometry, material);
        self.node(name, at, ("mesh", json!(mesh)));
    }

    /// A perspective camera; `yfov` is in degrees.
    pub fn perspective(&mut self, name: &str, yfov: f32, at: Placement) {
        self.cameras
            .push(json!({"name": name, "type": "perspective", "perspective": {
            "aspectRatio": number(16.0 / 9.0), "yfov": number(yfov.to_radians()),
            "zfar": 200.0, "znear": 0.05}}));
        let camera = self.cameras.len() - 1;
        self.node(name, at, ("camera", json!(camera)));
    }

    /// An orthographic camera that shows `half_height` metres above and below its axis.
    pub fn orthographic(&mut self, name: &str, half_height: f32, at: Placement) {
        self.cameras.push(
            json!({"name": name, "type": "orthographic", "orthographic": {
            "xmag": number(half_height * 16.0 / 9.0), "ymag": number(half_height),
            "zfar": 200.0, "znear": 0.05}}),
        );
        let camera = self.cameras.len() - 1;
        self.node(name, at, ("camera", json!(camera)));
    }

    /// A directional light of `lux` (KHR_lights_punctual); it shines along its node's -z.
    pub fn directional_light(&mut self, name: &str, lux: f32, color: [f32; 3], at: Placement) {
        self.use_extension("KHR_lights_punctual");
        self.lights.push(json!({"name": name, "type": "directional",
            "color": numbers(&color), "intensity": number(lux)}));
        let light = json!({"KHR_lights_punctual": {"light": self.lights.len() - 1}});
        self.node(name, at, ("extensions", light));
    }

    /// A point light of `candela`, or a spot light where it has a cone; a range of 0 is unlimited.
    pub fn punctual_light(
        &mut self,
        name: &str,
        candela: f32,
        color: [f32; 3],
        range: f32,
        cone: Option<Cone>,
        at: Placement,
    ) {
        self.use_extension("KHR_lights_punctual");
        let kind = if cone.is_some() { "spot" } else { "point" };
        let mut light = json!({"name": name, "type": kind,
            "color": numbers(&color), "intensity": number(candela)});
        if range > 0.0 {
            light["range"] = number(range);
        }
        if let Some(cone) = cone {
            light["spot"] = json!({"innerConeAngle": number(cone.inner),
                "outerConeAngle": number(cone.outer)});
        }
        self.lights.push(light);
        let light = json!({"KHR_lights_punctual": {"light": self.lights.len() - 1}});
        self.node(name, at, ("extensions", light));
    }

    fn buffer(&self) -> (Vec<u8>, Vec<Value>) {
        let (mut bytes, mut views) = (Vec::new(), Vec::new());
        for (stream, name, stride) in Stream::ALL {
            let data = &self.streams[stream as usize];
            let mut view = json!({"buffer": 0, "byteLength": data.len(), "byteOffset": bytes.len(),
                "name": name, "target": if stride.is_some() { 34962 } else { 34963 }});
            if let Some(stride) = stride {
                view["byteStride"] = json!(stride);
            }
            views.push(view);
            bytes.extend_from_slice(data);
            bytes.resize(bytes.len().next_multiple_of(4), 0);
        }
        (bytes, views)
    }

    /// The glTF text, then the buffer's bytes (empty where it is embedded).
    pub fn finish(self, scene: &str, place: BufferPlace<'_>) -> (Vec<u8>, Vec<u8>) {
        let (bytes, views) = self.buffer();
        let mut buffer = json!({"byteLength": bytes.len()});
        let file = match place {
            BufferPlace::File(name) => {
                buffer["uri"] = json!(name);
                bytes
            }
            BufferPlace::Embedded => {
                let text = base64::engine::general_purpose::STANDARD.encode(&bytes);
                buffer["uri"] = json!(format!("data:application/octet-stream;base64,{text}"));
                Vec::new()
            }
        };
        let nodes: Vec<usize> = (0..self.nodes.len()).collect();
        let mut root = json!({
            "asset": {"copyright": "CC0 1.0", "generator": "cairn-assets", "version": "2.0"},
            "scene": 0,
            "scenes": [{"name": scene, "nodes": nodes}],
            "buffers": [buffer],
        });
        let samplers = vec![
            json!({"magFilter": 9729, "minFilter": 9987, "wrapS": 10497, "wrapT": 10497});
            usize::from(!self.textures.is_empty())
        ];
        let lists = [
            ("accessors", self.accessors),
            ("bufferViews", views),
            ("cameras", self.cameras),
            ("images", self.images),
            ("materials", self.materials),
            ("meshes", self.meshes),
            ("nodes", self.nodes),
            ("samplers", samplers),
            ("textures", self.textures),
        ];
        for (name, list) in lists {
            if !list.is_empty() {
                root[name] = Value::Array(list);
            }
        }
        if !self.lights.is_empty() {
            root["extensions"] = json!({"KHR_lights_punctual": {"lights": self.lights}});
        }
        if !self.extensions.is_empty() {
            root["extensionsUsed"] = json!(self.extensions);
        }
        let mut text = String::new();
        write_value(&root, 0, &mut text);
        text.push('\n');
        (text.into_bytes(), file)
    }
}

/// Writes JSON with sorted keys, one line per element of the first levels.
///
/// serde_json's own key order depends on a feature that any crate of the build may switch on.
fn write_value(value: &Value, depth: usize, out: &mut String) {
    const SPREAD: usize = 2;
    let newline = |out: &mut String, level: usize| {
        if depth < SPREAD {
            out.push('\n');
            out.extend(std::iter::repeat_n(' ', level));
        }
    };
    match value {
        Value::Object(map) => {
            out.push('{');
            for (i, (key, child)) in sorted(map).into_iter().enumerate() {
                if i > 0 {
                    out.push(',');
                }
                newline(out, depth + 1);
                out.push_str(&Value::from(key).to_string());
                out.push(':');
                write_value(child, depth + 1, out);
            }
            newline(out, depth);
            out.push('}');
        }
        Value::Array(list) => {
            out.push('[');
            for (i, child) in list.iter().enumerate() {
                if i > 0 {
                    out.push(',');
                }
                newline(out, depth + 1);
                write_value(child, depth + 1, out);
            }
            newline(out, depth);
            out.push(']');
        }
        leaf => out.push_str(&leaf.to_string()),
    }
}

fn sorted(map: &Map<String, Value>) -> Vec<(&str, &Value)> {
    let mut entries: Vec<(&str, &Value)> = map.iter().map(|(k, v)| (k.as_str(), v)).collect();
    entries.sort_unstable_by_key(|entry| entry.0);
    entries
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn looking_points_minus_z_at_the_target() {
        let eye = Vec3::new(1.0, 2.0, 3.0);
        for target in [
            Vec3::ZERO,
            Vec3::new(4.0, 5.0, -6.0),
            Vec3::new(1.0, 0.0, 9.0),
        ] {
            let at = Placement::looking(eye, target);
            let forward = at.rotation * Vec3::NEG_Z;
            assert!(
                forward.abs_diff_eq((target - eye).normalize(), 1e-5),
                "{forward}"
            );
            assert!((at.rotation * Vec3::X).y.abs() < 1e-6, "no roll");
        }
    }

    #[test]
    fn keys_are_sorted_whatever_their_order() {
        let mut text = String::new();
        write_value(&json!({"b": 1, "a": [1.5, "x\"y"], "c": {}}), 3, &mut text);
        assert_eq!(text, r#"{"a":[1.5,"x\"y"],"b":1,"c":{}}"#);
    }
}
