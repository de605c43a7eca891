//! Reads meshes: triangle lists with their attributes.

use gltf::json;
use gltf::json::mesh::{Mode, Semantic};
use gltf::json::validation::Checked;

use crate::diagnostic::Result;
use crate::scene::{Mesh, Primitive};

use super::accessor::{self, ANY_SMALL, IntegerTypes, SIGNED_NORMALIZED, UNSIGNED_NORMALIZED};
use super::context::Context;

/// Reads mesh `index`; primitives that are no triangle lists are left out with a warning.
///
/// # Errors
/// Data out of range, of the wrong type, or non-finite positions.
pub(super) fn read(context: &Context, index: u32) -> Result<Mesh> {
    let index = index as usize;
    let meshes = &context.document.meshes;
    let Some(mesh) = meshes.get(index) else {
        return Err(context.absent("/nodes", "mesh", index, meshes.len()));
    };
    let mut primitives = Vec::new();
    for (ordinal, primitive) in mesh.primitives.iter().enumerate() {
        let reader = Reader {
            context,
            primitive,
            pointer: format!("/meshes/{index}/primitives/{ordinal}"),
        };
        primitives.extend(reader.read()?);
    }
    Ok(Mesh {
        name: mesh.name.clone().unwrap_or_else(|| format!("mesh {index}")),
        primitives,
    })
}

struct Reader<'a> {
    context: &'a Context,
    primitive: &'a json::mesh::Primitive,
    pointer: String,
}

impl Reader<'_> {
    fn read(&self) -> Result<Option<Primitive>> {
        if !self.is_triangle_list()? {
            return Ok(None);
        }
        let Some(positions) = self.attribute(&Semantic::Positions) else {
            let message = "a primitive without POSITION is skipped; it has no shape";
            self.warn("primitive-without-position", message);
            return Ok(None);
        };
        self.check_compression(positions)?;
        let referrer = self.referrer(&Semantic::Positions);
        let vertices = accessor::count(self.context, positions, &referrer)?;
        if vertices == 0 || self.index_count()? == Some(0) {
            self.warn(
                "primitive-empty",
                "a primitive without triangles is dropped",
            );
            return Ok(None);
        }
        self.note_unused_features();
        let positions = self.positions(positions, &referrer)?;
        let count = positions.len();
        Ok(Some(Primitive {
            normals: self.vectors(&Semantic::Normals, count, SIGNED_NORMALIZED)?,
            tangents: self.vectors(&Semantic::Tangents, count, SIGNED_NORMALIZED)?,
            uv0: self.texture_coordinates(0, count)?,
            uv1: self.texture_coordinates(1, count)?,
            colors: None,
            indices: self.indices(count)?,
            material: self.material()?,
            positions,
        }))
    }

    fn warn(&self, code: &'static str, message: &str) {
        self.context.warn(code, &self.pointer, message);
    }

    /// JSON pointer of an attribute.
    fn referrer(&self, semantic: &Semantic) -> String {
        format!("{}/attributes/{}", self.pointer, semantic.to_string())
    }

    fn attribute(&self, semantic: &Semantic) -> Option<usize> {
        let key = Checked::Valid(semantic.clone());
        Some(self.primitive.attributes.get(&key)?.value())
    }

    /// Whether the primitive is a triangle list; warns where it is something else.
    fn is_triangle_list(&self) -> Result<bool> {
        let name = match self.primitive.mode {
            Checked::Valid(Mode::Triangles) => return Ok(true),
            Checked::Valid(Mode::Points) => "POINTS",
            Checked::Valid(Mode::Lines) => "LINES",
            Checked::Valid(Mode::LineLoop) => "LINE_LOOP",
            Checked::Valid(Mode::LineStrip) => "LINE_STRIP",
            Checked::Valid(Mode::TriangleStrip) => "TRIANGLE_STRIP",
            Checked::Valid(Mode::TriangleFan) => "TRIANGLE_FAN",
            Checked::Invalid => {
                let pointer = format!("{}/mode", self.pointer);
                let message = "the primitive mode is none of 0 to 6; export again";
                return Err(self.context.error("primitive-mode", pointer, message));
            }
        };
        let message =
            format!("a primitive of mode {name} is skipped; export it as a triangle list");
        self.context
            .warn_group("primitive-mode", name, &self.pointer, message);
        Ok(false)
    }

    /// Refuses Draco data without the uncompressed fallback, which would read as zeros.
    fn check_compression(&self, positions: usize) -> Result<()> {
        let draco = self
            .primitive
            .extensions
            .as_ref()
            .is_some_and(|extensions| extensions.others.contains_key("KHR_draco_mesh_compression"));
        let accessor = self.context.document.accessors.get(positions);
        let empty = accessor.is_some_and(|a| a.buffer_view.is_none() && a.sparse.is_none());
        if draco && empty {
            let message = "the primitive has only Draco-compressed data, which is not supported; \
                           export without KHR_draco_mesh_compression";
            return Err(self.context.error("draco-only", &self.pointer, message));
        }
        Ok(())
    }

    fn note_unused_features(&self) {
        if self.attribute(&Semantic::Colors(0)).is_some() {
            self.warn("vertex-color-ignored", "COLOR_0 is not applied");
        }
        if self
            .primitive
            .targets
            .as_ref()
            .is_some_and(|t| !t.is_empty())
        {
            let message = "morph targets are ignored; the base shape is used";
            self.warn("morph-target-ignored", message);
        }
    }

    /// Number of indices, where the primitive has an index accessor.
    fn index_count(&self) -> Result<Option<u64>> {
        let referrer = format!("{}/indices", self.pointer);
        let count = |index: &json::Index<json::Accessor>| {
            accessor::count(self.context, index.value(), &referrer)
        };
        self.primitive.indices.as_ref().map(count).transpose()
    }

    fn positions(&self, index: usize, referrer: &str) -> Result<Vec<[f32; 3]>> {
        let types = self.quantized(ANY_SMALL, &[]);
        let positions = accessor::floats::<3>(self.context, index, referrer, types)?;
        let finite = |position: &[f32; 3]| position.iter().all(|value| value.is_finite());
        if let Some(vertex) = positions.iter().position(|position| !finite(position)) {
            let pointer = format!("/accessors/{index}");
            let message = format!(
                "position {vertex} of {referrer} is not finite: {:?}; repair the mesh",
                positions[vertex]
            );
            let code = "non-finite-position";
            return Err(self.context.error(code, pointer, message));
        }
        Ok(positions)
    }

    /// `extended` where the file declares quantised attributes, `core` otherwise.
    fn quantized(&self, extended: IntegerTypes, core: IntegerTypes) -> IntegerTypes {
        if self.context.document.quantized() {
            extended
        } else {
            core
        }
    }

    /// An attribute that only quantisation may store as integers.
    fn vectors<const N: usize>(
        &self,
        semantic: &Semantic,
        count: usize,
        extended: IntegerTypes,
    ) -> Result<Option<Vec<[f32; N]>>> {
        self.optional(semantic, count, self.quantized(extended, &[]))
    }

    fn texture_coordinates(&self, set: u32, count: usize) -> Result<Option<Vec<[f32; 2]>>> {
        let types = self.quantized(ANY_SMALL, UNSIGNED_NORMALIZED);
        self.optional(&Semantic::TexCoords(set), count, types)
    }

    /// An attribute that may be absent, has `count` elements, and gets zeros for non-finite values.
    fn optional<const N: usize>(
        &self,
        semantic: &Semantic,
        count: usize,
        types: IntegerTypes,
    ) -> Result<Option<Vec<[f32; N]>>> {
        let Some(index) = self.attribute(semantic) else {
            return Ok(None);
        };
        let referrer = self.referrer(semantic);
        let found = accessor::count(self.context, index, &referrer)?;
        if found != count as u64 {
            let message = format!("{found} elements for {count} positions; export again");
            let code = "attribute-count";
            return Err(self.context.error(code, referrer, message));
        }
        let mut values = accessor::floats::<N>(self.context, index, &referrer, types)?;
        let mut replaced = 0u64;
        for value in values.as_flattened_mut() {
            if !value.is_finite() {
                *value = 0.0;
                replaced += 1;
            }
        }
        if replaced > 0 {
            let name = semantic.to_string();
            let message = format!("{replaced} non-finite values of {name} were set to zero");
            self.context
                .warn_group("non-finite-attribute", &referrer, &referrer, message);
        }
        Ok(Some(values))
    }

    fn indices(&self, vertices: usize) -> Result<Vec<u32>> {
        let pointer = format!("{}/indices", self.pointer);
        let Some(accessor) = &self.primitive.indices else {
            let count = u32::try_from(vertices).ok().filter(|count| count % 3 == 0);
            let Some(count) = count else {
                let message = format!(
                    "{vertices} vertices without indices are no whole number of triangles; export again"
                );
                return Err(self.context.error("index-count", &self.pointer, message));
            };
            return Ok((0..count).collect());
        };
        let index = accessor.value();
        let accessor::Indices { values, restart } =
            accessor::indices(self.context, index, &pointer)?;
        let fault = |code, message: String| {
            let message = format!("{message} (indices of {}); export again", self.pointer);
            Err(self
                .context
                .error(code, format!("/accessors/{index}"), message))
        };
        if values.len() % 3 != 0 {
            let message = format!("{} indices are no whole number of triangles", values.len());
            return fault("index-count", message);
        }
        let bad = |&value: &u32| value == restart || value as usize >= vertices;
        match values.iter().position(bad) {
            None => Ok(values),
            Some(at) if values[at] == restart => {
                let message = format!("index {at} is the reserved restart value {restart}");
                fault("index-restart", message)
            }
            Some(at) => {
                let message = format!("index {at} is {}, for {vertices} vertices", values[at]);
                fault("index-out-of-range", message)
            }
        }
    }

    fn material(&self) -> Result<Option<u32>> {
        let materials = self.context.document.materials.len();
        match self.primitive.material.map(|material| material.value()) {
            Some(index) if index >= materials => {
                let pointer = format!("{}/material", self.pointer);
                Err(self.context.absent(pointer, "material", index, materials))
            }
            index => Ok(index.map(|index| index as u32)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::testing::{context, data_uri, fault};

    /// One mesh over a buffer of floats followed by `tail`; accessor 0 holds `vertices` VEC3.
    fn scene(floats: &[f32], tail: &[u8], accessors: &str, primitives: &str) -> Context {
        let mut bytes: Vec<u8> = floats.iter().flat_map(|v| v.to_le_bytes()).collect();
        let split = bytes.len();
        bytes.extend(tail);
        context(&format!(
            r#""buffers":[{{"byteLength":{},"uri":"{}"}}],
            "bufferViews":[{{"buffer":0,"byteLength":{split}}},
                {{"buffer":0,"byteOffset":{split},"byteLength":{}}}],
            "accessors":[{accessors}],"meshes":[{{"primitives":[{primitives}]}}]"#,
            bytes.len(),
            data_uri(&bytes),
            tail.len(),
        ))
    }

    const TRIANGLE: [f32; 9] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    const POSITIONS: &str = r#"{"bufferView":0,"componentType":5126,"type":"VEC3","count":3}"#;
    const PLAIN: &str = r#"{"attributes":{"POSITION":0}}"#;
    const INDEXED: &str = r#"{"attributes":{"POSITION":0},"indices":1}"#;

    fn indexed(component: u32, count: usize, tail: &[u8]) -> Result<Mesh> {
        let accessors = format!(
            r#"{POSITIONS},{{"bufferView":1,"componentType":{component},"type":"SCALAR","count":{count}}}"#
        );
        read(&scene(&TRIANGLE, tail, &accessors, INDEXED), 0)
    }

    fn warnings(context: Context) -> Vec<&'static str> {
        context
            .finish()
            .1
            .iter()
            .map(|warning| warning.code)
            .collect()
    }

    #[test]
    fn triangles_are_read_with_and_without_indices() {
        let mesh = read(&scene(&TRIANGLE, &[], POSITIONS, PLAIN), 0).unwrap();
        assert_eq!(mesh.primitives[0].indices, [0, 1, 2]);
        assert_eq!(mesh.primitives[0].positions[1], [1.0, 0.0, 0.0]);
        let mesh = indexed(5121, 3, &[2, 1, 0]).unwrap();
        assert_eq!(mesh.primitives[0].indices, [2, 1, 0]);
        let mesh = indexed(5123, 3, &[2, 0, 1, 0, 0, 0]).unwrap();
        assert_eq!(mesh.primitives[0].indices, [2, 1, 0]);
    }

    #[test]
    fn bad_indices_are_refused() {
        let error = fault(indexed(5121, 3, &[0, 1, 3]));
        assert_eq!(
            (error.code, error.place.as_str()),
            ("index-out-of-range", "/accessors/1")
        );
        assert!(error.message.contains("index 2 is 3"), "{}", error.message);
        for (component, tail) in [
            (5121, &[0, 1, 0xff][..]),
            (5123, &[0, 0, 1, 0, 0xff, 0xff]),
            (5125, &[0, 0, 0, 0, 1, 0, 0, 0, 0xff, 0xff, 0xff, 0xff]),
        ] {
            assert_eq!(fault(indexed(component, 3, tail)).code, "index-restart");
        }
        assert_eq!(fault(indexed(5121, 2, &[0, 1])).code, "index-count");
        let four = POSITIONS.replace("\"count\":3", "\"count\":4");
        let context = scene(&[0.0; 12], &[], &four, PLAIN);
        assert_eq!(fault(read(&context, 0)).code, "index-count");
    }

    #[test]
    fn non_finite_values_are_refused_in_positions_and_zeroed_elsewhere() {
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let mut floats = TRIANGLE;
            floats[4] = bad;
            let error = fault(read(&scene(&floats, &[], POSITIONS, PLAIN), 0));
            assert_eq!(error.code, "non-finite-position");
            assert!(error.message.contains("position 1 "));
        }
        let mut floats = [TRIANGLE, TRIANGLE].concat();
        floats[9] = f32::NAN;
        floats[13] = f32::INFINITY;
        let normals = POSITIONS.replace("\"count\"", "\"byteOffset\":36,\"count\"");
        let primitive = r#"{"attributes":{"POSITION":0,"NORMAL":1}}"#;
        let context = scene(&floats, &[], &format!("{POSITIONS},{normals}"), primitive);
        let mesh = read(&context, 0).unwrap();
        assert_eq!(
            mesh.primitives[0].normals.as_ref().unwrap()[..2],
            [[0.0; 3], [1.0, 0.0, 0.0]]
        );
        let (_, diagnostics) = context.finish();
        assert!(
            diagnostics[0]
                .message
                .starts_with("2 non-finite values of NORMAL")
        );
    }

    #[test]
    fn other_modes_are_skipped_and_counted() {
        let modes = [0, 1, 2, 3, 5, 6, 5]
            .map(|mode| format!(r#"{{"attributes":{{"POSITION":0}},"mode":{mode}}}"#));
        let context = scene(&TRIANGLE, &[], POSITIONS, &modes.join(","));
        assert!(read(&context, 0).unwrap().primitives.is_empty());
        let (_, diagnostics) = context.finish();
        assert_eq!(diagnostics.len(), 6);
        assert!(
            diagnostics[4].message.contains("the first of 2"),
            "{}",
            diagnostics[4]
        );
        let context = scene(
            &TRIANGLE,
            &[],
            POSITIONS,
            r#"{"attributes":{"POSITION":0},"mode":7}"#,
        );
        assert_eq!(fault(read(&context, 0)).code, "primitive-mode");
    }

    #[test]
    fn empty_and_shapeless_primitives_are_dropped() {
        let none = POSITIONS.replace("\"count\":3", "\"count\":0");
        let primitives = format!(r#"{PLAIN},{{"attributes":{{}}}}"#);
        let context = scene(&TRIANGLE, &[], &none, &primitives);
        assert!(read(&context, 0).unwrap().primitives.is_empty());
        assert_eq!(
            warnings(context),
            ["primitive-empty", "primitive-without-position"]
        );
        assert!(indexed(5121, 0, &[]).unwrap().primitives.is_empty());
    }

    #[test]
    fn attribute_faults_are_refused() {
        let code = |accessor: &str, semantic: &str| {
            let primitive = format!(r#"{{"attributes":{{"POSITION":0,"{semantic}":1}}}}"#);
            let accessors = format!("{POSITIONS},{accessor}");
            fault(read(&scene(&TRIANGLE, &[], &accessors, &primitive), 0)).code
        };
        let two = r#"{"componentType":5126,"type":"VEC3","count":2}"#;
        assert_eq!(code(two, "NORMAL"), "attribute-count");
        let short = r#"{"componentType":5122,"type":"VEC3","count":3,"normalized":true}"#;
        assert_eq!(code(short, "NORMAL"), "accessor-type");
        let plain = r#"{"componentType":5121,"type":"VEC2","count":3}"#;
        assert_eq!(code(plain, "TEXCOORD_0"), "accessor-type");
        let vec2 = POSITIONS.replace("VEC3", "VEC2");
        assert_eq!(
            fault(read(&scene(&TRIANGLE, &[], &vec2, PLAIN), 0)).code,
            "accessor-type"
        );
        let material = r#"{"attributes":{"POSITION":0},"material":4}"#;
        let context = scene(&TRIANGLE, &[], POSITIONS, material);
        assert_eq!(
            fault(read(&context, 0)).place,
            "/meshes/0/primitives/0/material"
        );
    }

    #[test]
    fn ignored_features_are_warned_of_once() {
        let primitive = r#"{"attributes":{"POSITION":0,"COLOR_0":9},"targets":[{"POSITION":9}]}"#;
        let context = scene(
            &TRIANGLE,
            &[],
            POSITIONS,
            &format!("{primitive},{primitive}"),
        );
        assert_eq!(read(&context, 0).unwrap().primitives.len(), 2);
        assert_eq!(
            warnings(context),
            ["vertex-color-ignored", "morph-target-ignored"]
        );
    }
}
