//! The records of ray tracing: acceleration structures, what emits, importance tables.

use crate::record::gpu_record;

gpu_record! {
    /// One geometry of a bottom-level acceleration structure: set 0, binding 5.
    pub struct GeometryInfo: 24 {
        /// Device address of the geometry's first [`crate::Vertex`].
        pub vertex_buffer_address: u64 = 0,
        /// Device address of the geometry's first u32 index.
        pub index_buffer_address: u64 = 8,
        /// Index into the material records.
        pub material_buffer_offset: u32 = 16,
        /// First emissive triangle of this geometry behind its instance's [`MeshInstance::first_emissive`];
        /// [`NO_EMISSION`](crate::gpu::NO_EMISSION) where it emits nothing.
        pub emissive_offset: u32 = 20,
    }
}

gpu_record! {
    /// One cell of the environment's importance table: set 0, binding 6, behind the header.
    ///
    /// Cells form an equirectangular grid in the panorama's orientation (see
    /// [`crate::scene::Environment`]), row 0 at +Y. A cell is drawn with probability
    /// `luminance * solid angle / total_luminance`; a direction within it uniformly in longitude and in
    /// `y`, so that the density per steradian is `luminance / total_luminance`. The sun is not in the table.
    pub struct EnvAliasEntry: 12 {
        /// Probability of keeping this entry.
        pub prob: f32 = 0,
        /// Entry taken otherwise.
        pub alias_index: u32 = 4,
        /// Mean Rec. 709 luminance of the cell's radiance, scale applied, without the solid-angle weight.
        pub luminance: f32 = 8,
    }
}

gpu_record! {
    /// Head of the environment's importance table.
    pub struct EnvAliasHeader: 16 {
        /// Sum of luminance times steradians; above 0.
        pub total_luminance: f32 = 0,
        /// `width * height`.
        pub entry_count: u32 = 4,
        /// Columns of the table.
        pub width: u32 = 8,
        /// Rows of the table.
        pub height: u32 = 12,
    }
}

gpu_record! {
    /// One emissive triangle in world space, its corners counter-clockwise seen from the front: set 0, binding 7.
    pub struct EmissiveTriangle: 96 {
        /// First corner.
        pub v0: [f32; 3] = 0,
        /// Zero.
        pub pad_12: u32 = 12,
        /// Second corner.
        pub v1: [f32; 3] = 16,
        /// Zero.
        pub pad_28: u32 = 28,
        /// Third corner.
        pub v2: [f32; 3] = 32,
        /// Zero.
        pub pad_44: u32 = 44,
        /// Linear RGB factor.
        pub emission: [f32; 3] = 48,
        /// Square metres.
        pub area: f32 = 60,
        /// Index into the material records.
        pub material_index: u32 = 64,
        /// Weight in the alias table: luminance of the emission, its texture's mean over the triangle included, times
        /// area times pi, twice that where both sides emit. Zero is never sampled.
        pub power: f32 = 68,
        /// Texture coordinates of the first corner.
        pub uv0: [f32; 2] = 72,
        /// Texture coordinates of the second corner.
        pub uv1: [f32; 2] = 80,
        /// Texture coordinates of the third corner.
        pub uv2: [f32; 2] = 88,
    }
}

gpu_record! {
    /// One entry of the emissive triangles' alias table: set 0, binding 8, behind the header.
    pub struct EmissiveAliasEntry: 8 {
        /// Probability of keeping this entry.
        pub prob: f32 = 0,
        /// Entry taken otherwise.
        pub alias_index: u32 = 4,
    }
}

gpu_record! {
    /// Head of the emissive triangles' alias table.
    pub struct EmissiveAliasHeader: 8 {
        /// Triangles.
        pub count: u32 = 0,
        /// Sum of the triangles' [`EmissiveTriangle::power`].
        pub total_power: f32 = 4,
    }
}

gpu_record! {
    /// Push constants of the path tracer. Positions that it traces are relative to `center`.
    pub struct PathTracePush: 112 {
        /// Device address of the [`MeshInstance`] records, their transforms relative to `center`.
        pub mesh_instances: u64 = 0,
        /// Unit, from the scene to the environment's sun.
        pub sun_direction: [f32; 3] = 8,
        /// Squared sine of the sun's angular radius; 0 without one.
        pub sun_sin2: f32 = 20,
        /// Radiance of the sun's disc.
        pub sun_radiance: [f32; 3] = 24,
        /// Firefly clamp of indirect light by its largest channel; 0 is off.
        pub max_clamp: f32 = 36,
        /// Middle of the scene, metres.
        pub center: [f32; 3] = 40,
        /// Width of a pixel's ray cone per metre.
        pub cone_spread: f32 = 52,
        /// Longest path, in surface hits after the camera's.
        pub max_bounces: u32 = 56,
        /// Samples that each pixel has from earlier dispatches.
        pub first_sample: u32 = 60,
        /// Samples that each pixel gets now.
        pub sample_count: u32 = 64,
        /// Dispatches accumulated before.
        pub batch: u32 = 68,
        /// Bits of the `LIGHT_*` constants: what is sampled directly.
        pub sampled_lights: u32 = 72,
        /// Point and spot lights.
        pub punctual_light_count: u32 = 76,
        /// Reach of the ambient occlusion view, metres.
        pub occlusion_distance: f32 = 80,
        /// Seed of the run.
        pub seed: u32 = 84,
        /// 1 where the environment is seen behind the scene.
        pub show_sky: u32 = 88,
        /// Directional lights; the environment's sun is none of them.
        pub directional_light_count: u32 = 92,
        /// Device address of the vertex arena.
        pub vertices: u64 = 96,
        /// Emissive triangles in the alias table.
        pub emissive_count: u32 = 104,
        /// Geometries of top-level instance 0, the merged structure: each has a [`MeshInstance`] record of its own, and
        /// those of the other instances follow. 0 where nothing is merged.
        pub merged_geometries: u32 = 108,
    }
}

gpu_record! {
    /// One top-level instance: a node that carries a mesh (one bottom-level structure per mesh).
    pub struct MeshInstance: 64 {
        /// Rows of the object-to-world matrix, as `VkTransformMatrixKHR`.
        pub transform: [[f32; 4]; 3] = 0,
        /// Index into the root's meshes.
        pub mesh: u32 = 48,
        /// First geometry of the mesh in the geometry table: `gl_InstanceCustomIndexEXT`.
        pub first_geometry: u32 = 52,
        /// Bits of the `DRAW_*` constants.
        pub flags: u32 = 56,
        /// Its first emissive triangle: those of its emitting primitives follow in order, one per triangle traced.
        /// [`NO_EMISSION`](crate::gpu::NO_EMISSION) where it has none.
        pub first_emissive: u32 = 60,
    }
}
