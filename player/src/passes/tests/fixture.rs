//! Builds packages of a few triangles in memory.

use bytemuck::Zeroable;
use cairn_format::brdf_table::BRDF_TABLE_SIZE;
use cairn_format::gpu::{
    ALPHA_OPAQUE, DRAW_DOUBLE_SIDED, DRAW_MIRRORED, DirectionalLight, DrawGroup, Instance,
    MATERIAL_DOUBLE_SIDED, MATERIAL_UNLIT, Material, MaterialExtension, PunctualLight,
    TextureTransform, VertexColor,
};
use cairn_format::scene::{
    Bounds, Environment, Image, ImageRole, Level, MaterialInfo, Mesh, MipFilter, Primitive,
    Sampler, Scene, Texture, Wrap,
};
use cairn_format::{Aabb, Package, SectionKind, TextureFormat, Vertex, Writer, bounds, features};
use glam::{Mat3, Mat4, Vec3};

use super::traced::{self, Traced};
use super::twin;

/// A mesh, its material, and where it stands.
#[derive(Clone)]
pub struct Object {
    pub vertices: Vec<Vertex>,
    /// One per vertex, linear RGBA of 0..=1; or empty, which is white where another object has colours.
    pub colors: Vec<[f32; 4]>,
    pub indices: Vec<u32>,
    pub material: u32,
    pub models: Vec<Mat4>,
}

/// A texture without mips.
#[derive(Clone)]
pub struct Picture {
    pub format: TextureFormat,
    pub width: u32,
    /// Rows from the top.
    pub texels: Vec<[u8; 4]>,
}

/// A texture of one row.
pub fn row(format: TextureFormat, texels: Vec<[u8; 4]>) -> Picture {
    Picture {
        format,
        width: texels.len() as u32,
        texels,
    }
}

/// What a package is built from.
#[derive(Clone, Default)]
pub struct Fixture {
    pub objects: Vec<Object>,
    pub materials: Vec<Material>,
    pub textures: Vec<Picture>,
    /// One per texture, or none.
    pub transforms: Vec<TextureTransform>,
    pub lights: Vec<DirectionalLight>,
    pub punctual: Vec<PunctualLight>,
    /// One per material, or none.
    pub lobes: Vec<MaterialExtension>,
    /// Radiance of each face; all cubes hold it.
    pub environment: Option<[[f32; 3]; 6]>,
    /// Radiance of each level of a prefiltered cube of its own, largest level first.
    pub prefiltered: Vec<[f32; 3]>,
    pub lut: bool,
    /// Radiance of the sky by direction, in place of the faces'; `environment` is there too.
    pub gradient: Option<fn(Vec3) -> [f32; 3]>,
}

/// The object with one colour at all vertices.
pub fn colored(object: Object, color: [f32; 4]) -> Object {
    Object {
        colors: vec![color; object.vertices.len()],
        ..object
    }
}

/// A square of half-extent 1 in the XY plane, facing +Z. First texture coordinates are 0.25, second 0.75.
pub fn quad(material: u32, models: Vec<Mat4>) -> Object {
    let corner = |x: f32, y: f32| Vertex {
        position: [x, y, 0.0],
        normal: [0.0, 0.0, 1.0],
        tangent: [1.0, 0.0, 0.0, 1.0],
        uv0: [0.25, 0.5],
        uv1: [0.75, 0.5],
    };
    Object {
        vertices: vec![
            corner(-1.0, -1.0),
            corner(1.0, -1.0),
            corner(1.0, 1.0),
            corner(-1.0, 1.0),
        ],
        colors: Vec::new(),
        indices: vec![0, 1, 2, 0, 2, 3],
        material,
        models,
    }
}

/// A unit sphere with smooth normals.
pub fn sphere(material: u32, models: Vec<Mat4>) -> Object {
    sphere_of(16, material, models)
}

/// A unit sphere of `rows` rows of facets, and twice as many columns.
pub fn sphere_of(rows: u32, material: u32, models: Vec<Mat4>) -> Object {
    let columns = 2 * rows;
    let mut object = Object {
        vertices: Vec::new(),
        colors: Vec::new(),
        indices: Vec::new(),
        material,
        models,
    };
    for row in 0..=rows {
        for column in 0..=columns {
            let (theta, phi) = (
                row as f32 / rows as f32 * std::f32::consts::PI,
                column as f32 / columns as f32 * std::f32::consts::TAU,
            );
            let normal = [
                theta.sin() * phi.cos(),
                theta.cos(),
                theta.sin() * phi.sin(),
            ];
            object.vertices.push(Vertex {
                position: normal,
                normal,
                ..Vertex::zeroed()
            });
            if row < rows && column < columns {
                let at = row * (columns + 1) + column;
                let below = at + columns + 1;
                let faces = [at, at + 1, below, at + 1, below + 1, below];
                object.indices.extend(faces);
            }
        }
    }
    object
}

/// A material that shows its base colour.
pub fn unlit(color: [f32; 4]) -> Material {
    Material {
        base_color_factor: color,
        double_sided: MATERIAL_UNLIT,
        ..Material::default()
    }
}

/// A directional light travelling along `direction`.
pub fn light(direction: Vec3, color: [f32; 3], intensity: f32) -> DirectionalLight {
    DirectionalLight {
        direction_and_intensity: direction.normalize().extend(intensity).to_array(),
        color_and_shadow: [color[0], color[1], color[2], 0.0],
    }
}

/// A light that casts shadows.
pub fn casting(direction: Vec3) -> DirectionalLight {
    DirectionalLight {
        color_and_shadow: [1.0; 4],
        ..light(direction, [1.0; 3], 3.0)
    }
}

impl Fixture {
    /// The package.
    pub fn package(&self) -> Package {
        let mut scene = Scene::empty("fixture");
        let mut arenas = Arenas::default();
        self.add_objects(&mut scene, &mut arenas);
        self.add_images(&mut scene, &mut arenas.texels);
        let arrays = bounds::to_arrays(&arenas.bounds);
        if !arenas.bounds.is_empty() {
            let all = arenas.bounds.iter().copied().fold(Aabb::EMPTY, Aabb::union);
            scene.bounds = Bounds {
                min: all.min.to_array(),
                max: all.max.to_array(),
            };
        }
        let colored = self.objects.iter().any(|object| !object.colors.is_empty());
        if colored {
            scene.features |= features::VERTEX_COLORS;
            arenas.colors = self.objects.iter().flat_map(colors).collect();
        }
        if !self.transforms.is_empty() {
            scene.features |= features::TEXTURE_TRANSFORMS;
        }
        let mut writer = Writer::new();
        writer.records(SectionKind::Vertices, &arenas.vertices);
        writer.bytes(SectionKind::Indices, bytemuck::cast_slice(&arenas.indices));
        writer.records(SectionKind::Instances, &arenas.instances);
        writer.bytes(SectionKind::InstanceBounds, bytemuck::cast_slice(&arrays));
        writer.records(SectionKind::DrawGroups, &arenas.groups);
        writer.records(SectionKind::Materials, &self.materials);
        writer.records(SectionKind::DirectionalLights, &self.lights);
        writer.bytes(SectionKind::Texels, arenas.texels.as_slice());
        writer.records(SectionKind::TextureTransforms, &self.transforms);
        writer.records(SectionKind::VertexColors, &arenas.colors);
        writer.records(SectionKind::PunctualLights, &self.punctual);
        writer.records(SectionKind::MaterialExtensions, &self.lobes);
        let traced = Traced::of(self);
        writer.records(SectionKind::MeshInstances, &traced.mesh_instances);
        writer.records(SectionKind::EmissiveTriangles, &traced.emissive_triangles);
        writer.bytes(SectionKind::EmissiveAlias, traced.emissive_alias.as_slice());
        writer.bytes(SectionKind::EnvAlias, traced.env_alias.as_slice());
        let bytes = writer.to_vec(&scene, "test").expect("fixture is written");
        let package = Package::from_bytes(&bytes).expect("fixture opens");
        package.verify().expect("fixture is sound");
        package
    }

    fn add_objects(&self, scene: &mut Scene, arenas: &mut Arenas) {
        for _ in &self.materials {
            scene.materials.push(MaterialInfo {
                name: String::new(),
            });
        }
        for (index, object) in self.objects.iter().enumerate() {
            scene.meshes.push(Mesh {
                name: String::new(),
                first_primitive: index as u32,
                primitive_count: 1,
            });
            scene.primitives.push(Primitive {
                first_index: arenas.indices.len() as u32,
                index_count: object.indices.len() as u32,
                traced_index_count: object.indices.len() as u32,
                opaque: self.materials[object.material as usize].alpha_mode == ALPHA_OPAQUE,
                first_vertex: arenas.vertices.len() as u32,
                vertex_count: object.vertices.len() as u32,
                material: object.material,
                bounds: Bounds::ZERO,
            });
            arenas.vertices.extend(&object.vertices);
            arenas.indices.extend(&object.indices);
        }
        for alpha_mode in 0..3 {
            for (index, object) in self.objects.iter().enumerate() {
                let material = &self.materials[object.material as usize];
                if material.alpha_mode == alpha_mode {
                    for mirrored in [false, true] {
                        arenas.add_group(
                            &scene.primitives[index],
                            index,
                            object,
                            material,
                            mirrored,
                        );
                    }
                }
            }
        }
    }

    fn add_images(&self, scene: &mut Scene, texels: &mut Vec<u8>) {
        for picture in &self.textures {
            let bytes: Vec<u8> = picture.texels.as_flattened().to_vec();
            let extent = [
                picture.width,
                picture.texels.len() as u32 / picture.width,
                1,
            ];
            let image = add_image(scene, texels, picture.format, extent, &bytes);
            scene.textures.push(Texture { image, sampler: 0 });
        }
        if !self.textures.is_empty() {
            scene.samplers.push(Sampler {
                mag_linear: false,
                min_linear: false,
                mip: MipFilter::None,
                wrap_u: Wrap::Repeat,
                wrap_v: Wrap::Repeat,
            });
        }
        if self.lut {
            let bytes: Vec<u8> = twin::table_texels(!self.lobes.is_empty())
                .iter()
                .flat_map(|texel| halves(*texel))
                .collect();
            let extent = [BRDF_TABLE_SIZE, BRDF_TABLE_SIZE, 1];
            let format = TextureFormat::Rgba16Float;
            scene.brdf_lut = Some(add_image(scene, texels, format, extent, &bytes));
        }
        if let Some(faces) = self.environment {
            let bytes: Vec<u8> = faces
                .iter()
                .flat_map(|face| halves([face[0], face[1], face[2], 1.0]))
                .collect();
            let format = TextureFormat::Rgba16Float;
            let cube = add_image(scene, texels, format, [1, 1, 6], &bytes);
            let sky = self.gradient.map(|sky| {
                let bytes = traced::sky_texels(sky);
                let size = [traced::SKY_SIZE, traced::SKY_SIZE, 6];
                add_image(scene, texels, format, size, &bytes)
            });
            let prefiltered = if self.prefiltered.is_empty() {
                cube
            } else {
                add_chain(scene, texels, &self.prefiltered)
            };
            let levels = scene.images[prefiltered as usize].levels.len();
            scene.environment = Some(Environment {
                sky: sky.unwrap_or(cube),
                irradiance: cube,
                prefiltered,
                prefiltered_roughness: (0..levels)
                    .map(|level| level as f32 / (levels - 1).max(1) as f32)
                    .collect(),
                scale: 1.0,
                sun: None,
                irradiance_sh: [[0.0; 3]; 9],
                source_width: 2,
                source_height: 1,
                replaced_texels: 0,
                clamped_texels: 0,
            });
        }
    }
}

#[derive(Default)]
struct Arenas {
    vertices: Vec<Vertex>,
    colors: Vec<VertexColor>,
    indices: Vec<u32>,
    instances: Vec<Instance>,
    bounds: Vec<Aabb>,
    groups: Vec<DrawGroup>,
    texels: Vec<u8>,
}

impl Arenas {
    fn add_group(
        &mut self,
        primitive: &Primitive,
        index: usize,
        object: &Object,
        material: &Material,
        mirrored: bool,
    ) {
        let first_instance = self.instances.len() as u32;
        for model in &object.models {
            if (model.determinant() < 0.0) == mirrored {
                self.instances.push(instance(model, object.material));
                let corners = object
                    .vertices
                    .iter()
                    .map(|vertex| Vec3::from(vertex.position));
                self.bounds.push(corners.fold(Aabb::EMPTY, |aabb, corner| {
                    aabb.include(model.transform_point3(corner))
                }));
            }
        }
        let double_sided = material.double_sided & MATERIAL_DOUBLE_SIDED != 0;
        let instance_count = self.instances.len() as u32 - first_instance;
        if instance_count > 0 {
            self.groups.push(DrawGroup {
                first_index: primitive.first_index,
                index_count: primitive.index_count,
                vertex_offset: primitive.first_vertex,
                first_instance,
                instance_count,
                primitive: index as u32,
                alpha_mode: material.alpha_mode,
                flags: if double_sided { DRAW_DOUBLE_SIDED } else { 0 }
                    | if mirrored { DRAW_MIRRORED } else { 0 },
            });
        }
    }
}

/// The record of each vertex of an object.
fn colors(object: &Object) -> Vec<VertexColor> {
    let half = |value: f32| (value * 65535.0).round() as u32;
    let record = |[r, g, b, a]: [f32; 4]| VertexColor {
        red_green: half(r) | half(g) << 16,
        blue_alpha: half(b) | half(a) << 16,
    };
    if object.colors.is_empty() {
        return vec![record([1.0; 4]); object.vertices.len()];
    }
    assert_eq!(object.colors.len(), object.vertices.len());
    object.colors.iter().copied().map(record).collect()
}

fn instance(model: &Mat4, material: u32) -> Instance {
    let linear = Mat3::from_mat4(*model);
    let normal = linear.inverse().transpose();
    let largest = normal
        .to_cols_array()
        .iter()
        .fold(0.0_f32, |m, x| m.max(x.abs()));
    let column = |axis: usize| (normal.col(axis) / largest).extend(0.0).to_array();
    Instance {
        model: model.to_cols_array_2d(),
        normal_matrix: [column(0), column(1), column(2)],
        material_index: material,
        ..Instance::zeroed()
    }
}

fn add_image(
    scene: &mut Scene,
    texels: &mut Vec<u8>,
    format: TextureFormat,
    [width, height, layers]: [u32; 3],
    bytes: &[u8],
) -> u32 {
    texels.resize(texels.len().next_multiple_of(16), 0);
    let offset = texels.len() as u64;
    texels.extend(bytes);
    scene.images.push(Image {
        name: String::new(),
        role: ImageRole::Data,
        format,
        swizzle: cairn_format::scene::IDENTITY_SWIZZLE,
        width,
        height,
        layers,
        levels: vec![Level {
            offset,
            length: bytes.len() as u64,
        }],
    });
    scene.images.len() as u32 - 1
}

/// A cube with one radiance per level.
fn add_chain(scene: &mut Scene, texels: &mut Vec<u8>, levels: &[[f32; 3]]) -> u32 {
    let extent = |level: usize| 1_u32 << (levels.len() - 1 - level);
    let bytes = |level: usize| {
        let [r, g, b] = levels[level];
        halves([r, g, b, 1.0]).repeat((extent(level) * extent(level) * 6) as usize)
    };
    let size = [extent(0), extent(0), 6];
    let image = add_image(scene, texels, TextureFormat::Rgba16Float, size, &bytes(0));
    for level in 1..levels.len() {
        let (offset, length) = (texels.len() as u64, bytes(level).len() as u64);
        texels.extend(bytes(level));
        scene.images[image as usize]
            .levels
            .push(Level { offset, length });
    }
    image
}

/// Normal positive half floats, rounded to nearest; smaller values become 0.
pub(super) fn halves(values: [f32; 4]) -> Vec<u8> {
    let half = |value: f32| -> u16 {
        assert!((0.0..=65504.0).contains(&value));
        if value < 6.2e-5 {
            return 0;
        }
        ((value.to_bits() + 0x1000 - (112 << 23)) >> 13) as u16
    };
    values
        .into_iter()
        .flat_map(|value| half(value).to_le_bytes())
        .collect()
}
