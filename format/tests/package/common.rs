//! A tiny package with every kind of content.

use bytemuck::Zeroable;
use cairn_format::bounds::to_arrays;
use cairn_format::gpu::{
    DrawGroup, Instance, Material, MaterialExtension, MeshInstance, PunctualLight,
};
use cairn_format::scene::{
    Bounds, IDENTITY_SWIZZLE, Image, ImageRole, Level, MaterialInfo, Mesh, MipFilter, Primitive,
    Sampler, Scene, Texture, Wrap,
};
use cairn_format::{Aabb, SectionKind, TextureFormat, Vertex, Writer};
use glam::Vec3;

/// The bulk data of the tiny package.
#[derive(Clone)]
pub struct Content {
    pub vertices: Vec<Vertex>,
    pub indices: Vec<u32>,
    pub instances: Vec<Instance>,
    pub bounds: Vec<f32>,
    pub draw_groups: Vec<DrawGroup>,
    pub mesh_instances: Vec<MeshInstance>,
    pub materials: Vec<Material>,
    pub punctual_lights: Vec<PunctualLight>,
    pub material_extensions: Vec<MaterialExtension>,
    pub texels: Vec<u8>,
    pub env_alias: Vec<u8>,
}

const UNIT: Bounds = Bounds {
    min: [0.0; 3],
    max: [1.0, 1.0, 0.0],
};

const IDENTITY: [[f32; 4]; 4] = [
    [1.0, 0.0, 0.0, 0.0],
    [0.0, 1.0, 0.0, 0.0],
    [0.0, 0.0, 1.0, 0.0],
    [0.0, 0.0, 0.0, 1.0],
];

/// One textured triangle, drawn once.
pub fn tiny() -> (Scene, Content) {
    let corner = |x: f32, y: f32| Vertex {
        position: [x, y, 0.0],
        normal: [0.0, 0.0, 1.0],
        uv0: [x, 1.0 - y],
        ..Vertex::zeroed()
    };
    let content = Content {
        vertices: vec![corner(0.0, 0.0), corner(1.0, 0.0), corner(0.0, 1.0)],
        indices: vec![0, 1, 2],
        instances: vec![Instance {
            model: IDENTITY,
            normal_matrix: [IDENTITY[0], IDENTITY[1], IDENTITY[2]],
            ..Instance::zeroed()
        }],
        bounds: to_arrays(&[Aabb {
            min: Vec3::ZERO,
            max: Vec3::new(1.0, 1.0, 0.0),
        }]),
        draw_groups: vec![DrawGroup {
            index_count: 3,
            instance_count: 1,
            ..DrawGroup::zeroed()
        }],
        mesh_instances: vec![MeshInstance {
            transform: [IDENTITY[0], IDENTITY[1], IDENTITY[2]],
            ..MeshInstance::zeroed()
        }],
        materials: vec![Material {
            base_color_tex: 0,
            ..Material::default()
        }],
        punctual_lights: Vec::new(),
        material_extensions: Vec::new(),
        texels: [[255, 0, 0, 255], [0, 255, 0, 255]]
            .concat()
            .into_iter()
            .chain([0; 8])
            .chain([128; 4])
            .collect(),
        env_alias: Vec::new(),
    };
    (scene(), content)
}

fn scene() -> Scene {
    let level = |offset, length| Level { offset, length };
    Scene {
        features: cairn_format::features::TEXTURES,
        bounds: UNIT,
        meshes: vec![Mesh {
            name: "triangle".into(),
            first_primitive: 0,
            primitive_count: 1,
        }],
        primitives: vec![Primitive {
            first_index: 0,
            index_count: 3,
            traced_index_count: 3,
            first_vertex: 0,
            vertex_count: 3,
            material: 0,
            opaque: true,
            bounds: UNIT,
        }],
        materials: vec![MaterialInfo {
            name: "paint".into(),
        }],
        textures: vec![Texture {
            image: 0,
            sampler: 0,
        }],
        images: vec![Image {
            name: "two texels".into(),
            role: ImageRole::Color,
            format: TextureFormat::Rgba8Srgb,
            swizzle: IDENTITY_SWIZZLE,
            width: 2,
            height: 1,
            layers: 1,
            levels: vec![level(0, 8), level(16, 4)],
        }],
        samplers: vec![Sampler {
            mag_linear: true,
            min_linear: true,
            mip: MipFilter::Linear,
            wrap_u: Wrap::Repeat,
            wrap_v: Wrap::Repeat,
        }],
        ..Scene::empty("tiny")
    }
}

/// The package of `scene` and `content`.
pub fn package(scene: &Scene, content: &Content) -> Vec<u8> {
    let mut writer = Writer::new();
    writer
        .records(SectionKind::Vertices, &content.vertices)
        .bytes(
            SectionKind::Indices,
            bytemuck::cast_slice::<_, u8>(&content.indices),
        )
        .records(SectionKind::Instances, &content.instances)
        .bytes(
            SectionKind::InstanceBounds,
            bytemuck::cast_slice::<_, u8>(&content.bounds),
        )
        .records(SectionKind::DrawGroups, &content.draw_groups)
        .records(SectionKind::MeshInstances, &content.mesh_instances)
        .records(SectionKind::Materials, &content.materials)
        .records(SectionKind::PunctualLights, &content.punctual_lights)
        .records(
            SectionKind::MaterialExtensions,
            &content.material_extensions,
        )
        .bytes(SectionKind::Texels, content.texels.as_slice())
        .bytes(SectionKind::EnvAlias, content.env_alias.as_slice());
    writer.to_vec(scene, "0.1.0").expect("writing to memory")
}

/// The tiny package.
pub fn tiny_bytes() -> Vec<u8> {
    let (scene, content) = tiny();
    package(&scene, &content)
}
