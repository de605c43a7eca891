//! Meshes of a package as slices of its arenas, their indices checked.

use cairn_format::check;
use cairn_format::gpu::VertexColor;
use cairn_format::{Package, Result, Vertex};

/// A mesh.
#[derive(Clone, Debug)]
pub struct MeshView<'a> {
    /// glTF name.
    pub name: &'a str,
    /// Its primitives, in order.
    pub primitives: Vec<PrimitiveView<'a>>,
}

/// A primitive: triangles of one material. Every index is below the vertex count.
#[derive(Clone, Copy, Debug)]
pub struct PrimitiveView<'a> {
    /// Place of its material.
    pub material: u32,
    /// Relative to its own vertices, three a triangle.
    pub indices: &'a [u32],
    /// Its vertices.
    pub vertices: &'a [Vertex],
    /// One a vertex; empty where the package has none.
    pub colors: &'a [VertexColor],
}

/// All meshes, in order.
///
/// # Errors
/// An index that leaves its primitive, or a file that changes meanwhile.
pub fn meshes(package: &Package) -> Result<Vec<MeshView<'_>>> {
    (0..package.scene().meshes.len())
        .map(|index| mesh(package, index))
        .collect()
}

/// The mesh at an index.
///
/// # Errors
/// As [`meshes`].
///
/// # Panics
/// Where there is no such mesh.
pub fn mesh(package: &Package, index: usize) -> Result<MeshView<'_>> {
    let (vertices, indices) = (package.vertices()?, package.indices()?);
    let colors = package.vertex_colors()?;
    let mesh = &package.scene().meshes[index];
    let first = mesh.first_primitive.to_native() as usize;
    let range = first..first + mesh.primitive_count.to_native() as usize;
    let mut primitives = Vec::with_capacity(range.len());
    for primitive in &package.scene().primitives[range] {
        let at = primitive.first_index.to_native() as usize;
        let run = &indices[at..at + primitive.index_count.to_native() as usize];
        check::indices(run, at, primitive.vertex_count.to_native())?;
        let start = primitive.first_vertex.to_native() as usize;
        let span = start..start + primitive.vertex_count.to_native() as usize;
        primitives.push(PrimitiveView {
            material: primitive.material.to_native(),
            indices: run,
            vertices: &vertices[span.clone()],
            colors: colors.get(span).unwrap_or_default(),
        });
    }
    Ok(MeshView {
        name: mesh.name.as_str(),
        primitives,
    })
}
