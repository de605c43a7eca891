//! Checks of the whole asset set: structure, ranges, size and the committed bytes.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::OnceLock;

use base64::Engine;
use glam::DVec3;
use serde_json::Value;

use crate::{OutputFile, generate, write_all};

const SCENES: [&str; 6] = [
    "hall/hall.gltf",
    "materials/materials.gltf",
    "lights/lights.gltf",
    "lobes/lobes.gltf",
    "box/box.gltf",
    "bumps/bumps.gltf",
];
const SIZE_BUDGET: usize = 3_000_000;
const SKY_BUDGET: usize = 400_000;

/// The generated set, made once for all tests.
fn generated() -> &'static [OutputFile] {
    static FILES: OnceLock<Vec<OutputFile>> = OnceLock::new();
    FILES.get_or_init(generate)
}

fn by_path() -> BTreeMap<String, Vec<u8>> {
    let files = generated().iter().cloned();
    let map: BTreeMap<_, _> = files.map(|f| (f.path, f.bytes)).collect();
    assert_eq!(map.len(), generated().len(), "every path is written once");
    map
}

fn int(value: &Value) -> usize {
    usize::try_from(value.as_u64().expect("an unsigned number")).expect("fits")
}

fn list<'a>(root: &'a Value, name: &str) -> &'a [Value] {
    root[name].as_array().map_or(&[], Vec::as_slice)
}

/// A parsed scene and its buffer.
struct Scene {
    root: Value,
    buffer: Vec<u8>,
}

impl Scene {
    fn load(files: &BTreeMap<String, Vec<u8>>, path: &str) -> Self {
        let root: Value = serde_json::from_slice(&files[path]).expect("JSON");
        let uri = root["buffers"][0]["uri"].as_str().expect("a buffer URI");
        let buffer = match uri.strip_prefix("data:application/octet-stream;base64,") {
            Some(text) => base64::engine::general_purpose::STANDARD
                .decode(text)
                .expect("base64"),
            None => files[&sibling(path, uri)].clone(),
        };
        assert_eq!(buffer.len(), int(&root["buffers"][0]["byteLength"]));
        Self { root, buffer }
    }

    /// The elements of an accessor as byte slices, with its ranges checked.
    fn elements(&self, accessor: usize) -> Vec<&[u8]> {
        let accessor = &self.root["accessors"][accessor];
        let view = &self.root["bufferViews"][int(&accessor["bufferView"])];
        let size = match (int(&accessor["componentType"]), accessor["type"].as_str()) {
            (5123, Some("SCALAR")) => 2,
            (5126, Some("VEC2")) => 8,
            (5126, Some("VEC3")) => 12,
            other => panic!("unexpected accessor {other:?}"),
        };
        let stride = view.get("byteStride").map_or(size, int);
        let start = int(&view["byteOffset"]) + int(&accessor["byteOffset"]);
        let view_end = int(&view["byteOffset"]) + int(&view["byteLength"]);
        let count = int(&accessor["count"]);
        assert_eq!(int(&view["byteOffset"]) % 4, 0);
        assert!(start + (count - 1) * stride + size <= view_end);
        assert!(view_end <= self.buffer.len());
        (0..count)
            .map(|i| &self.buffer[start + i * stride..][..size])
            .collect()
    }

    fn floats(&self, accessor: usize) -> Vec<Vec<f32>> {
        let read = |b: &[u8]| f32::from_le_bytes([b[0], b[1], b[2], b[3]]);
        self.elements(accessor)
            .into_iter()
            .map(|e| e.chunks(4).map(read).collect())
            .collect()
    }

    fn check_primitive(&self, primitive: &Value) {
        let attributes = &primitive["attributes"];
        let positions = self.floats(int(&attributes["POSITION"]));
        let accessor = &self.root["accessors"][int(&attributes["POSITION"])];
        for axis in 0..3 {
            let low = positions.iter().map(|p| p[axis]).fold(f32::MAX, f32::min);
            let high = positions.iter().map(|p| p[axis]).fold(f32::MIN, f32::max);
            let bound = |name: &str| accessor[name][axis].as_f64().expect("a number") as f32;
            assert_eq!((bound("min"), bound("max")), (low, high));
        }
        let normals = self.floats(int(&attributes["NORMAL"]));
        assert_eq!(normals.len(), positions.len());
        for n in &normals {
            let length = n.iter().map(|c| f64::from(*c).powi(2)).sum::<f64>();
            assert!((length - 1.0).abs() < 1e-5, "normal {n:?}");
        }
        for name in ["TEXCOORD_0", "TEXCOORD_1"] {
            if let Some(accessor) = attributes.get(name) {
                let uvs = self.floats(int(accessor));
                assert_eq!(uvs.len(), positions.len());
                assert!(uvs.iter().flatten().all(|c| c.is_finite()));
            }
        }
        assert!(
            attributes.get("TANGENT").is_none(),
            "the bake makes tangents"
        );
        let indices = self.elements(int(&primitive["indices"]));
        assert_eq!(indices.len() % 3, 0);
        let index = |i: &[u8]| usize::from(u16::from_le_bytes([i[0], i[1]]));
        let point = |v: &[f32]| DVec3::new(v[0].into(), v[1].into(), v[2].into());
        for t in indices.chunks(3) {
            let corners = [index(t[0]), index(t[1]), index(t[2])];
            assert!(corners.iter().all(|&i| i < positions.len()));
            let [a, b, c] = corners.map(|i| point(&positions[i]));
            let face = (b - a).cross(c - a);
            assert!(face.length() > 1e-9, "a triangle without area");
            for i in corners {
                let agreement = face.normalize().dot(point(&normals[i]));
                assert!(agreement > 0.05, "normal against its face: {agreement}");
            }
        }
    }

    fn node_names(&self) -> Vec<&str> {
        list(&self.root, "nodes")
            .iter()
            .map(|n| n["name"].as_str().expect("every node is named"))
            .collect()
    }
}

fn sibling(path: &str, uri: &str) -> String {
    let directory = path.rsplit_once('/').map_or("", |p| p.0);
    format!("{directory}/{uri}")
}

#[test]
fn scenes_hold_together() {
    let files = by_path();
    for path in SCENES {
        let scene = Scene::load(&files, path);
        let root = &scene.root;
        for mesh in list(root, "meshes") {
            for primitive in list(mesh, "primitives") {
                scene.check_primitive(primitive);
                assert!(int(&primitive["material"]) < list(root, "materials").len());
            }
        }
        for node in list(root, "nodes") {
            for (key, table) in [("mesh", "meshes"), ("camera", "cameras")] {
                if let Some(index) = node.get(key) {
                    assert!(int(index) < list(root, table).len());
                }
            }
        }
        for image in list(root, "images") {
            let uri = image["uri"].as_str().expect("a URI");
            let png = &files[&sibling(path, uri)];
            let reader = png::Decoder::new(std::io::Cursor::new(png))
                .read_info()
                .expect("a PNG");
            assert!(reader.info().width <= 512 && reader.info().height <= 512);
        }
    }
}

#[test]
fn the_hall_has_what_the_player_is_shown_with() {
    let files = by_path();
    let scene = Scene::load(&files, "hall/hall.gltf");
    let names = scene.node_names();
    for name in ["hero", "detail", "plant", "mirrored carving", "ellipsoid"] {
        assert!(names.contains(&name), "{name}");
    }
    assert!(
        scene.root["extensions"]
            .get("KHR_lights_punctual")
            .is_none()
    );
    let modes: Vec<_> = list(&scene.root, "materials")
        .iter()
        .filter_map(|m| m["alphaMode"].as_str())
        .collect();
    assert!(modes.contains(&"MASK") && modes.contains(&"BLEND"));
    let mirrored = list(&scene.root, "nodes").iter().filter(|n| {
        n.get("scale")
            .is_some_and(|s| (0..3).filter_map(|k| s[k].as_f64()).product::<f64>() < 0.0)
    });
    assert!(mirrored.count() >= 2);
    let shared = list(&scene.root, "nodes").len() > 2 * list(&scene.root, "meshes").len();
    assert!(shared, "meshes are shared by nodes");
}

#[test]
fn the_set_fits_its_budget() {
    let files = by_path();
    let total: usize = files.values().map(Vec::len).sum();
    assert!(total < SIZE_BUDGET, "{total} bytes");
    assert!(files["hall/sky.hdr"].len() < SKY_BUDGET);
}

#[test]
fn regenerated_files_equal_the_committed_ones() {
    let root = tempfile::tempdir().expect("a temporary directory");
    let files = generated();
    write_all(root.path(), files).expect("the temporary directory takes files");
    let committed = Path::new(env!("CARGO_MANIFEST_DIR"));
    for file in files {
        let made = std::fs::read(root.path().join(&file.path)).expect("written above");
        let kept = std::fs::read(committed.join(&file.path)).unwrap_or_default();
        assert!(
            made == kept,
            "{} differs: run `cargo run -p cairn-assets` and commit the result",
            file.path
        );
    }
}
