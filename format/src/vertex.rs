//! The unified 56-byte vertex.

use crate::record::gpu_record;

gpu_record! {
    /// One vertex of the arena, object space, tightly packed (scalar layout, stride 56).
    pub struct Vertex: 56 {
        /// Metres.
        pub position: [f32; 3] = 0,
        /// Unit length, or zero where the source normal was zero.
        pub normal: [f32; 3] = 12,
        /// First texture coordinates, V pointing down as in glTF.
        pub uv0: [f32; 2] = 24,
        /// xyz unit tangent, w handedness (+1 or -1): bitangent = cross(normal, tangent.xyz) * w.
        /// All zero where no material of the mesh has a normal map.
        pub tangent: [f32; 4] = 32,
        /// Second texture coordinates.
        pub uv1: [f32; 2] = 48,
    }
}

/// One vertex input attribute: shader location, component count, byte offset. All components are f32.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Attribute {
    /// `layout(location = ...)` of the vertex shader.
    pub location: u32,
    /// Number of 32-bit float components.
    pub components: u32,
    /// Byte offset in [`Vertex`].
    pub offset: u32,
}

/// The vertex input of every raster pipeline, in location order.
pub const ATTRIBUTES: [Attribute; 5] = [
    attribute(0, 3, std::mem::offset_of!(Vertex, position)),
    attribute(1, 3, std::mem::offset_of!(Vertex, normal)),
    attribute(2, 2, std::mem::offset_of!(Vertex, uv0)),
    attribute(3, 4, std::mem::offset_of!(Vertex, tangent)),
    attribute(4, 2, std::mem::offset_of!(Vertex, uv1)),
];

const fn attribute(location: u32, components: u32, offset: usize) -> Attribute {
    Attribute {
        location,
        components,
        offset: offset as u32,
    }
}
