//! Reads meshes: triangle lists with their attributes.

mod pose;

use gltf::json;
use gltf::json::mesh::{Mode, Semantic};
use gltf::json::validation::Checked;

use crate::diagnostic::Result;
use crate::scene::{Mesh, Primitive};

use super::accessor::{self, ANY_SMALL, IntegerTypes, SIGNED_NORMALIZED, UNSIGNED_NORMALIZED};
use super::context::Context;
use super::draco;
use super::topology::{self, Topology};
use super::uv_sets::UvSets;

pub(super) use pose::{Pose, is_skinnable};

/// Reads mesh `index` in a pose; primitives without triangles are left out with a warning.
///
/// # Errors
/// Data out of range, of the wrong type, damaged, or non-finite positions.
pub(super) fn read(context: &Context, index: u32, pose: &Pose) -> Result<Mesh> {
    let index = index as usize;
    let meshes = &context.document.meshes;
    let Some(mesh) = meshes.get(index) else {
        return Err(context.absent("/nodes", "mesh", index, meshes.len()));
    };
    let mut primitives = Vec::new();
    for (ordinal, primitive) in mesh.primitives.iter().enumerate() {
        let mut reader = Reader {
            context,
            primitive,
            pointer: format!("/meshes/{index}/primitives/{ordinal}"),
            draco: None,
        };
        primitives.extend(reader.read(pose)?);
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
    draco: Option<draco::Geometry>,
}

impl Reader<'_> {
    fn read(&mut self, pose: &Pose) -> Result<Option<Primitive>> {
        let Some(topology) = self.topology()? else {
            return Ok(None);
        };
        let Some(positions) = self.attribute(&Semantic::Positions) else {
            let message = "a primitive without POSITION is skipped; it has no shape";
            self.warn("primitive-without-position", message);
            return Ok(None);
        };
        let referrer = self.referrer(&Semantic::Positions);
        let vertices = accessor::count(self.context, positions, &referrer)?;
        let corners = self.index_count()?.unwrap_or(vertices);
        let short = topology != Topology::List && corners < 3;
        if vertices == 0 || corners == 0 || short {
            self.warn(
                "primitive-empty",
                "a primitive without triangles is dropped",
            );
            return Ok(None);
        }
        let triangles = match topology {
            Topology::List => corners / 3,
            Topology::Strip | Topology::Fan => corners - 2,
        };
        self.context.charge_triangles(triangles, &self.pointer)?;
        let material = self.material()?;
        let UvSets { sets, .. } = UvSets::of(self.context, material)?;
        self.draco = draco::decode(self.context, self.primitive, &self.pointer)?;
        self.check_draco_counts(topology, vertices, corners)?;
        self.note_unused_features();
        let positions = self.positions(positions, &referrer)?;
        let count = positions.len();
        let mut primitive = Primitive {
            normals: self.vectors(&Semantic::Normals, count, SIGNED_NORMALIZED)?,
            tangents: self.vectors(&Semantic::Tangents, count, SIGNED_NORMALIZED)?,
            uv0: self.texture_coordinates(sets[0], count)?,
            uv1: self.texture_coordinates(sets[1], count)?,
            colors: self.colors(count)?,
            indices: self.indices(topology, count)?,
            material,
            positions,
        };
        self.pose(&mut primitive, pose)?;
        Ok(Some(primitive))
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

    /// How the vertices form triangles; warns where they form something else.
    fn topology(&self) -> Result<Option<Topology>> {
        let name = match self.primitive.mode {
            Checked::Valid(Mode::Triangles) => return Ok(Some(Topology::List)),
            Checked::Valid(Mode::TriangleStrip) => return Ok(Some(Topology::Strip)),
            Checked::Valid(Mode::TriangleFan) => return Ok(Some(Topology::Fan)),
            Checked::Valid(Mode::Points) => "POINTS",
            Checked::Valid(Mode::Lines) => "LINES",
            Checked::Valid(Mode::LineLoop) => "LINE_LOOP",
            Checked::Valid(Mode::LineStrip) => "LINE_STRIP",
            Checked::Invalid => {
                let pointer = format!("{}/mode", self.pointer);
                let message = "the primitive mode is none of 0 to 6; export again";
                return Err(self.context.error("primitive-mode", pointer, message));
            }
        };
        let message = format!("a primitive of mode {name} is skipped; it has no triangles");
        self.context
            .warn_group("primitive-mode", name, &self.pointer, message);
        Ok(None)
    }

    /// Checks that the compressed data has the vertices and indices that the accessors declare.
    /// It holds a list whatever the mode, so the indices of a strip cannot be compared.
    fn check_draco_counts(&self, topology: Topology, vertices: u64, corners: u64) -> Result<()> {
        let Some(draco) = &self.draco else {
            return Ok(());
        };
        let points = draco.points() as u64;
        let found = draco.triangles() as u64 * 3;
        let indices = topology == Topology::List && self.primitive.indices.is_some();
        if points == vertices && (!indices || found == corners) {
            return Ok(());
        }
        let message = format!(
            "the Draco data has {points} vertices and {found} indices, the accessors declare \
             {vertices} and {corners}; export again"
        );
        Err(self.context.error("draco-count", &self.pointer, message))
    }

    fn note_unused_features(&self) {
        let further = |semantic: &Checked<Semantic>| {
            matches!(semantic, Checked::Valid(Semantic::Colors(1..)))
        };
        if self.primitive.attributes.keys().any(further) {
            let message = "colours after COLOR_0 are not applied";
            self.warn("vertex-color-ignored", message);
        }
        if self
            .primitive
            .targets
            .as_ref()
            .is_some_and(|t| !t.is_empty())
        {
            let message = "morph targets do not move; the default weights are applied";
            self.warn("morph-target-static", message);
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
        let positions = self.floats::<3>(&Semantic::Positions, index, referrer, types)?;
        if let Some(vertex) = positions.iter().position(|position| !is_finite(position)) {
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

    /// The elements of an attribute, from the compressed data where that has the attribute.
    fn floats<const N: usize>(
        &self,
        semantic: &Semantic,
        index: usize,
        referrer: &str,
        types: IntegerTypes,
    ) -> Result<Vec<[f32; N]>> {
        let name = semantic.to_string();
        let packed = match &self.draco {
            Some(draco) => draco.packed(self.context, &name, index, referrer)?,
            None => None,
        };
        accessor::floats_from(self.context, index, referrer, types, packed.as_deref())
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

    fn texture_coordinates(&self, set: Option<u32>, count: usize) -> Result<Option<Vec<[f32; 2]>>> {
        let Some(set) = set else {
            return Ok(None);
        };
        let types = self.quantized(ANY_SMALL, UNSIGNED_NORMALIZED);
        self.optional(&Semantic::TexCoords(set), count, types)
    }

    /// `COLOR_0` as linear RGBA within 0 to 1.
    fn colors(&self, count: usize) -> Result<Option<Vec<[f32; 4]>>> {
        let semantic = Semantic::Colors(0);
        let Some(index) = self.attribute(&semantic) else {
            return Ok(None);
        };
        let referrer = self.referrer(&semantic);
        let (_, components) = accessor::layout(self.context, index, &referrer)?;
        let colors = if components == 3 {
            let colors = self.optional::<3>(&semantic, count, UNSIGNED_NORMALIZED)?;
            colors.map(|colors| colors.iter().map(|&[r, g, b]| [r, g, b, 1.0]).collect())
        } else {
            self.optional::<4>(&semantic, count, UNSIGNED_NORMALIZED)?
        };
        Ok(colors.map(|mut colors: Vec<[f32; 4]>| {
            let mut clamped = 0u64;
            for value in colors.as_flattened_mut() {
                let within = value.clamp(0.0, 1.0);
                clamped += u64::from(within != *value);
                *value = within;
            }
            if clamped > 0 {
                let message = format!("{clamped} values of COLOR_0 were clamped to 0..=1");
                self.context
                    .warn_group("vertex-color-range", &referrer, &referrer, message);
            }
            colors
        }))
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
        self.check_count(index, count, &referrer)?;
        let mut values = self.floats::<N>(semantic, index, &referrer, types)?;
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

    /// Checks that an accessor has one element per position.
    fn check_count(&self, index: usize, count: usize, referrer: &str) -> Result<()> {
        let found = accessor::count(self.context, index, referrer)?;
        if found == count as u64 {
            return Ok(());
        }
        let message = format!("{found} elements for {count} positions; export again");
        Err(self.context.error("attribute-count", referrer, message))
    }

    /// The corners of the triangles.
    fn indices(&self, topology: Topology, vertices: usize) -> Result<Vec<u32>> {
        let (corners, topology) = match (&self.draco, &self.primitive.indices) {
            (Some(draco), _) => (
                self.checked_indices(draco.indices(), None, vertices, &self.pointer)?,
                Topology::List,
            ),
            (None, Some(index)) => (self.indexed(index.value(), vertices)?, topology),
            (None, None) => match u32::try_from(vertices) {
                Ok(count) => ((0..count).collect(), topology),
                Err(_) => unreachable!("a scene has fewer vertices than u32 can count"),
            },
        };
        if !topology.accepts(corners.len()) {
            let (count, what) = match &self.primitive.indices {
                Some(_) => (corners.len(), "indices"),
                None => (vertices, "vertices without indices"),
            };
            let message = format!("{count} {what} are no whole number of triangles; export again");
            return Err(self.context.error("index-count", &self.pointer, message));
        }
        let triangles = topology.triangles(corners);
        if topology != Topology::List {
            let stitches = topology::degenerate(&triangles);
            if stitches > 0 {
                let message = format!(
                    "{stitches} triangles of a strip or fan name a vertex twice; they have no area"
                );
                self.warn("degenerate-triangles", &message);
            }
        }
        Ok(triangles)
    }

    /// The values of an index accessor.
    fn indexed(&self, index: usize, vertices: usize) -> Result<Vec<u32>> {
        let referrer = format!("{}/indices", self.pointer);
        let accessor::Indices { values, restart } =
            accessor::indices(self.context, index, &referrer)?;
        let pointer = format!("/accessors/{index}");
        self.checked_indices(values, Some(restart), vertices, &pointer)
    }

    /// `values`, all of which name a vertex.
    fn checked_indices(
        &self,
        values: Vec<u32>,
        restart: Option<u32>,
        vertices: usize,
        pointer: &str,
    ) -> Result<Vec<u32>> {
        let fault = |code, message: String| {
            let message = format!("{message} (indices of {}); export again", self.pointer);
            Err(self.context.error(code, pointer, message))
        };
        let bad = |&value: &u32| Some(value) == restart || value as usize >= vertices;
        match values.iter().position(bad) {
            None => Ok(values),
            Some(at) if Some(values[at]) == restart => {
                let message = format!("index {at} is the reserved restart value {}", values[at]);
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

fn is_finite(vector: &[f32; 3]) -> bool {
    vector.iter().all(|value| value.is_finite())
}

#[cfg(test)]
mod tests;
