//! Decodes the primitives of `KHR_draco_mesh_compression`.

use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};

use draco_core::{
    DataType, DecodeLimits, DecoderBuffer, DracoError, Mesh, MeshDecoder, PointIndex,
};
use gltf::json;
use gltf::json::accessor::ComponentType;
use serde::Deserialize;

use crate::diagnostic::Result;

use super::context::Context;
use super::{accessor, buffer, extension};

const NAME: &str = "KHR_draco_mesh_compression";

/// The most points and the most triangles of one compressed primitive.
const COUNT_LIMIT: u64 = 1 << 26;

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct Extension {
    buffer_view: usize,
    attributes: BTreeMap<String, u32>,
}

/// A decoded primitive.
pub(super) struct Geometry {
    mesh: Mesh,
    /// Draco's unique identifiers by glTF semantic.
    attributes: BTreeMap<String, u32>,
    pointer: String,
}

/// Decodes the compressed form of the primitive at `pointer`, where it has one.
///
/// # Errors
/// Damaged data, data of another number of points or triangles than the accessors declare, or a
/// scene over its limit. A panic of the decoder is reported as damaged data.
pub(super) fn decode(
    context: &Context,
    primitive: &json::mesh::Primitive,
    pointer: &str,
) -> Result<Option<Geometry>> {
    let extensions = primitive.extensions.as_ref();
    let Some(value) = extensions.and_then(|extensions| extensions.others.get(NAME)) else {
        return Ok(None);
    };
    let pointer = format!("{pointer}/extensions/{NAME}");
    let extension: Extension = extension::parse(context, value, &pointer)?;
    let referrer = format!("{pointer}/bufferView");
    let bytes = buffer::view(context, extension.buffer_view, &referrer)?.bytes;
    let limits = DecodeLimits::default()
        .with_max_points(COUNT_LIMIT)
        .with_max_faces(COUNT_LIMIT)
        .with_max_decoded_bytes(context.decodable());
    let mesh = guarded(|| {
        let mut mesh = Mesh::new();
        MeshDecoder::new().decode(
            &mut DecoderBuffer::new(bytes).with_limits(limits),
            &mut mesh,
        )?;
        Ok(mesh)
    });
    let mesh = mesh.map_err(|error| {
        let message = format!("the Draco data cannot be decoded: {error}; export again");
        context.error("draco", &pointer, message)
    })?;
    let geometry = Geometry {
        mesh,
        attributes: extension.attributes,
        pointer,
    };
    context.charge_decoded(geometry.size(), &geometry.pointer)?;
    Ok(Some(geometry))
}

/// Runs the decoder, a panic of which must not end the bake: the last resort against damaged data.
fn guarded(decode: impl FnOnce() -> Result<Mesh, DracoError>) -> Result<Mesh, String> {
    match catch_unwind(AssertUnwindSafe(decode)) {
        Ok(result) => result.map_err(|error| error.to_string()),
        Err(_) => Err("the decoder failed".into()),
    }
}

impl Geometry {
    /// Bytes of the indices and attribute values.
    fn size(&self) -> u64 {
        let attributes = (0..self.mesh.num_attributes())
            .filter_map(|index| self.mesh.try_attribute(index).ok())
            .map(|attribute| attribute.buffer().data_size() as u64);
        attributes.sum::<u64>() + self.mesh.num_faces() as u64 * 12
    }

    /// Number of vertices.
    pub fn points(&self) -> usize {
        self.mesh.num_points()
    }

    pub fn triangles(&self) -> usize {
        self.mesh.num_faces()
    }

    /// The corners of the triangles.
    pub fn indices(&self) -> Vec<u32> {
        let faces = self.mesh.faces().iter();
        faces.flat_map(|face| face.map(|point| point.0)).collect()
    }

    /// The compressed attribute `semantic` as tight elements of the accessor's type, one per
    /// point; `None` where the attribute is not compressed.
    ///
    /// # Errors
    /// An identifier or a value that is absent, or another type than the accessor's.
    pub fn packed(
        &self,
        context: &Context,
        semantic: &str,
        accessor: usize,
        referrer: &str,
    ) -> Result<Option<Vec<u8>>> {
        let Some(&identifier) = self.attributes.get(semantic) else {
            return Ok(None);
        };
        let fault = |message: String| {
            let pointer = format!("{}/attributes/{semantic}", self.pointer);
            context.error(
                "draco-attribute",
                pointer,
                format!("{message}; export again"),
            )
        };
        let Some(attribute) = self.mesh.attribute_by_unique_id(identifier) else {
            return Err(fault(format!(
                "the Draco data has no attribute {identifier}"
            )));
        };
        let (component, components) = accessor::layout(context, accessor, referrer)?;
        let found = (attribute.data_type(), attribute.num_components() as usize);
        if found != (data_type(component), components) {
            return Err(fault(format!(
                "the Draco data has {} {:?} components, accessor {accessor} has {components} {component:?}",
                found.1, found.0
            )));
        }
        let size = components * component.size();
        let (data, stride) = (attribute.buffer().data(), attribute.byte_stride());
        let stride = usize::try_from(stride).unwrap_or_default();
        let mut packed = Vec::with_capacity(size * self.points());
        for point in 0..self.points() {
            let value = attribute.mapped_index(PointIndex(point as u32)).0 as usize;
            let start = value.checked_mul(stride);
            let Some(bytes) = start.and_then(|start| data.get(start..)?.get(..size)) else {
                return Err(fault(format!("point {point} has no value")));
            };
            packed.extend_from_slice(bytes);
        }
        Ok(Some(packed))
    }
}

fn data_type(component: ComponentType) -> DataType {
    match component {
        ComponentType::I8 => DataType::Int8,
        ComponentType::U8 => DataType::Uint8,
        ComponentType::I16 => DataType::Int16,
        ComponentType::U16 => DataType::Uint16,
        ComponentType::U32 => DataType::Uint32,
        ComponentType::F32 => DataType::Float32,
    }
}

#[cfg(test)]
mod tests;
