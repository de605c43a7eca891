//! Meshes in the polygon file format, binary and little-endian ("The PLY Polygon File Format", Turk 1994).

use crate::look::mesh::MeshView;
use crate::look::printable;

/// A mesh with all that its vertices hold: position, normal, both texture coordinates (V pointing down), tangent with
/// handedness, linear 16-bit colours where there are any; and the material's index of each triangle. `materials` are
/// all names of the package.
pub fn ply(mesh: &MeshView, materials: &[&str]) -> Vec<u8> {
    let primitives = &mesh.primitives;
    let vertices: usize = primitives
        .iter()
        .map(|primitive| primitive.vertices.len())
        .sum();
    let triangles: usize = primitives
        .iter()
        .map(|primitive| primitive.indices.len() / 3)
        .sum();
    let colored = primitives
        .iter()
        .any(|primitive| !primitive.colors.is_empty());
    let mut head = format!(
        "ply\nformat binary_little_endian 1.0\ncomment {} of {}\n",
        printable(mesh.name),
        crate::pipeline::tool()
    );
    for primitive in primitives {
        let name = materials.get(primitive.material as usize).unwrap_or(&"");
        head += &format!(
            "comment material {} {}\n",
            primitive.material,
            printable(name)
        );
    }
    head += &format!("element vertex {vertices}\n");
    for property in [
        "x", "y", "z", "nx", "ny", "nz", "s", "t", "tx", "ty", "tz", "tw", "s1", "t1",
    ] {
        head += &format!("property float {property}\n");
    }
    if colored {
        for property in ["red", "green", "blue", "alpha"] {
            head += &format!("property ushort {property}\n");
        }
    }
    head += &format!("element face {triangles}\n");
    head += "property list uchar uint vertex_indices\nproperty uint material\nend_header\n";

    let mut out = head.into_bytes();
    for primitive in primitives {
        for (index, vertex) in primitive.vertices.iter().enumerate() {
            // The record's own order is that of the properties.
            out.extend_from_slice(bytemuck::bytes_of(vertex));
            if colored {
                let white = cairn_format::gpu::VertexColor {
                    red_green: u32::MAX,
                    blue_alpha: u32::MAX,
                };
                let color = primitive.colors.get(index).unwrap_or(&white);
                out.extend_from_slice(bytemuck::bytes_of(color));
            }
        }
    }
    let mut first = 0;
    for primitive in primitives {
        for triangle in primitive.indices.as_chunks::<3>().0 {
            out.push(3);
            for index in triangle {
                out.extend((first + index).to_le_bytes());
            }
            out.extend(primitive.material.to_le_bytes());
        }
        first += primitive.vertices.len() as u32;
    }
    out
}
