//! Kinds of raw sections: what each holds, its record size.

use crate::gpu::{self, Record, RecordLayout};

/// A raw section of plain records. Discriminants are part of the file format; sections lie in this order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u32)]
pub enum SectionKind {
    /// The vertex arena: [`crate::Vertex`].
    Vertices = 1,
    /// The index arena: u32, relative to the primitive's first vertex.
    Indices = 2,
    /// [`crate::gpu::Instance`], contiguous per draw group.
    Instances = 3,
    /// World bounds of the instances, structure of arrays: see [`crate::bounds::BoundsView`].
    InstanceBounds = 4,
    /// [`crate::gpu::DrawGroup`]: opaque, then mask, then blend.
    DrawGroups = 5,
    /// [`crate::gpu::MeshInstance`].
    MeshInstances = 6,
    /// [`crate::gpu::Material`].
    Materials = 7,
    /// [`crate::gpu::DirectionalLight`].
    DirectionalLights = 8,
    /// Texel blocks of every image: bytes, each level at a multiple of 16.
    Texels = 9,
    /// [`crate::gpu::EnvAliasHeader`] and entries, 4-byte words.
    EnvAlias = 10,
    /// [`crate::gpu::EmissiveTriangle`].
    EmissiveTriangles = 11,
    /// [`crate::gpu::EmissiveAliasHeader`] and entries, 4-byte words.
    EmissiveAlias = 12,
    /// [`crate::gpu::TextureTransform`], one per 2D slot; absent where all are the identity.
    TextureTransforms = 13,
    /// [`crate::gpu::VertexColor`], one per vertex of the arena; absent where no primitive has colours.
    VertexColors = 14,
    /// World bounds of every 64 consecutive instances, structure of arrays as the instances' own.
    ClusterBounds = 15,
    /// [`crate::gpu::PunctualLight`].
    PunctualLights = 16,
    /// [`crate::gpu::MaterialExtension`], one per material; absent where no material has a further lobe.
    MaterialExtensions = 17,
}

impl SectionKind {
    /// Every kind, in file order.
    pub const ALL: [Self; 17] = [
        Self::Vertices,
        Self::Indices,
        Self::Instances,
        Self::InstanceBounds,
        Self::DrawGroups,
        Self::MeshInstances,
        Self::Materials,
        Self::DirectionalLights,
        Self::Texels,
        Self::EnvAlias,
        Self::EmissiveTriangles,
        Self::EmissiveAlias,
        Self::TextureTransforms,
        Self::VertexColors,
        Self::ClusterBounds,
        Self::PunctualLights,
        Self::MaterialExtensions,
    ];

    /// The kind of a discriminant read from a file.
    pub fn from_u32(value: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| *kind as u32 == value)
    }

    /// Bytes of one record.
    pub const fn stride(self) -> u32 {
        match self {
            Self::Vertices => 56,
            Self::Instances => 128,
            Self::Indices
            | Self::InstanceBounds
            | Self::EnvAlias
            | Self::EmissiveAlias
            | Self::ClusterBounds => 4,
            Self::DrawGroups | Self::DirectionalLights | Self::TextureTransforms => 32,
            Self::VertexColors => 8,
            Self::MeshInstances | Self::PunctualLights => 64,
            Self::Materials | Self::MaterialExtensions => 80,
            Self::Texels => 1,
            Self::EmissiveTriangles => 96,
        }
    }

    /// Name in messages, reports and JSON.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Vertices => "vertices",
            Self::Indices => "indices",
            Self::Instances => "instances",
            Self::InstanceBounds => "instance-bounds",
            Self::DrawGroups => "draw-groups",
            Self::MeshInstances => "mesh-instances",
            Self::Materials => "materials",
            Self::DirectionalLights => "directional-lights",
            Self::Texels => "texels",
            Self::EnvAlias => "env-alias",
            Self::EmissiveTriangles => "emissive-triangles",
            Self::EmissiveAlias => "emissive-alias",
            Self::TextureTransforms => "texture-transforms",
            Self::VertexColors => "vertex-colors",
            Self::ClusterBounds => "cluster-bounds",
            Self::PunctualLights => "punctual-lights",
            Self::MaterialExtensions => "material-extensions",
        }
    }

    /// The record that the section is an array of; `None` where it is words, floats or bytes.
    pub fn record(self) -> Option<RecordLayout> {
        const fn of<T: Record>() -> Option<RecordLayout> {
            Some(RecordLayout::of::<T>())
        }
        match self {
            Self::Vertices => of::<crate::Vertex>(),
            Self::Instances => of::<gpu::Instance>(),
            Self::DrawGroups => of::<gpu::DrawGroup>(),
            Self::MeshInstances => of::<gpu::MeshInstance>(),
            Self::Materials => of::<gpu::Material>(),
            Self::DirectionalLights => of::<gpu::DirectionalLight>(),
            Self::EmissiveTriangles => of::<gpu::EmissiveTriangle>(),
            Self::TextureTransforms => of::<gpu::TextureTransform>(),
            Self::VertexColors => of::<gpu::VertexColor>(),
            Self::PunctualLights => of::<gpu::PunctualLight>(),
            Self::MaterialExtensions => of::<gpu::MaterialExtension>(),
            Self::Indices
            | Self::InstanceBounds
            | Self::Texels
            | Self::EnvAlias
            | Self::EmissiveAlias
            | Self::ClusterBounds => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strides_are_those_of_the_records() {
        for kind in SectionKind::ALL {
            if let Some(record) = kind.record() {
                assert_eq!(record.bytes, kind.stride() as usize, "{}", record.name);
            }
        }
    }
}
