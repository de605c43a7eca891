//! Scenes that the tests of the preparation share.

use glam::{DMat4, DQuat, DVec3};

use crate::scene::{Material, Mesh, MeshInstance, Primitive, Scene, TextureRef};

/// `cells` x `cells` squares on a wavy sheet with all attributes but tangents.
pub(super) fn grid(cells: u32) -> Primitive {
    let (mut positions, mut normals, mut uvs) = (Vec::new(), Vec::new(), Vec::new());
    for y in 0..=cells {
        for x in 0..=cells {
            let (u, v) = (x as f32 / cells as f32, y as f32 / cells as f32);
            let slope = 0.9 * libm::cosf(9.0 * u);
            positions.push([u, 1.0 - v, 0.1 * libm::sinf(9.0 * u)]);
            let length = (1.0 + slope * slope).sqrt();
            normals.push([-slope / length, 0.0, 1.0 / length]);
            uvs.push([u, v]);
        }
    }
    let mut indices = Vec::new();
    for y in 0..cells {
        for x in 0..cells {
            let a = y * (cells + 1) + x;
            let b = a + cells + 1;
            indices.extend([a, b, a + 1, a + 1, b, b + 1]);
        }
    }
    Primitive {
        positions,
        normals: Some(normals),
        tangents: None,
        uv1: Some(uvs.iter().map(|[u, v]| [u * 2.0, v * 3.0]).collect()),
        uv0: Some(uvs),
        colors: None,
        indices,
        material: None,
    }
}

pub(super) fn node(mesh: u32, world: DMat4) -> MeshInstance {
    MeshInstance {
        name: format!("node of mesh {mesh}"),
        mesh,
        world,
    }
}

/// A scene of `primitive` at the origin.
pub(super) fn one_mesh(primitive: Primitive) -> Scene {
    Scene {
        name: "one mesh".into(),
        meshes: vec![Mesh {
            name: "mesh".into(),
            primitives: vec![primitive],
        }],
        instances: vec![node(0, DMat4::IDENTITY)],
        ..Scene::default()
    }
}

/// A material with a normal map that samples with `uv_set`.
pub(super) fn normal_mapped(uv_set: u32) -> Material {
    Material {
        normal_texture: Some(TextureRef::new(0, uv_set)),
        ..Material::default()
    }
}

/// A small generator of test input (SplitMix64, Steele et al. 2014).
pub(super) struct Random(pub(super) u64);

impl Random {
    pub(super) fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Uniform in -1..1.
    pub(super) fn signed(&mut self) -> f64 {
        (self.bits() >> 11) as f64 * (2.0 / (1u64 << 53) as f64) - 1.0
    }

    pub(super) fn vector(&mut self) -> DVec3 {
        DVec3::new(self.signed(), self.signed(), self.signed())
    }

    /// A rotation.
    pub(super) fn rotation(&mut self) -> DQuat {
        let axis = self.vector();
        DQuat::from_axis_angle((axis + DVec3::splat(1e-9)).normalize(), 3.1 * self.signed())
    }
}
