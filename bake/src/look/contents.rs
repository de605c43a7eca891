//! What is in a package, as a tree of plain rows: the form that text, JSON, pages and comparisons are made of.

use cairn_format::gpu::{Material, MaterialExtension, NO_TEXTURE, Record, TEXTURE_UV1};
use cairn_format::scene::{ArchivedReportRow, natives};
use cairn_format::{Package, SectionKind, features};
use serde::Serialize;
use serde_json::{Map, Value, json};

use super::fields::{float, record_values};
use crate::pipeline::hex;

/// Everything but bulk data.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Contents {
    /// File stem of the scene.
    pub name: String,
    /// [`cairn_format::header::FORMAT_VERSION`] of the file.
    pub format_version: u32,
    /// Name and version of the tool that wrote it.
    pub tool: String,
    /// Bytes of the file.
    pub bytes: u64,
    /// BLAKE3 of header, section table and root, which holds the hash of every section.
    pub content_hash: String,
    /// Names of what the scene contains.
    pub features: Vec<&'static str>,
    /// Least and greatest corner, metres.
    pub bounds: [[f32; 3]; 2],
    /// Triangles of all primitives, each once.
    pub triangles: u64,
    /// Vertices of all primitives.
    pub vertices: u64,
    /// Drawn primitives of all nodes.
    pub instances: u64,
    /// Indexed draws.
    pub draw_groups: u64,
    /// Sections, in file order.
    pub sections: Vec<SectionRow>,
    /// Meshes, in order.
    pub meshes: Vec<MeshRow>,
    /// Materials, in order.
    pub materials: Vec<MaterialRow>,
    /// Images, in order, those of the environment included.
    pub images: Vec<ImageRow>,
    /// Lights, in order.
    pub lights: Vec<Item>,
    /// Cameras, in order.
    pub cameras: Vec<Item>,
    /// Fields of the environment, where there is one.
    pub environment: Option<Map<String, Value>>,
    /// Names and values of the settings that shaped the bytes.
    pub settings: Vec<[String; 2]>,
    /// Every file that was read.
    pub sources: Vec<SourceRow>,
    /// The error of every lossy step.
    pub report: Vec<ErrorRow>,
}

/// A section of the file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct SectionRow {
    /// Name of its kind.
    pub name: &'static str,
    /// Records.
    pub records: u64,
    /// Bytes of a record.
    pub stride: u32,
    /// Byte offset in the file.
    pub offset: u64,
    /// Bytes.
    pub bytes: u64,
    /// BLAKE3 in hexadecimal.
    pub hash: String,
}

/// A mesh and its primitives.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MeshRow {
    /// glTF name.
    pub name: String,
    /// Nodes that carry it.
    pub instances: u64,
    /// Triangles of its primitives.
    pub triangles: u64,
    /// Vertices of its primitives.
    pub vertices: u64,
    /// Its primitives, in order.
    pub primitives: Vec<PrimitiveRow>,
}

/// A primitive of a mesh.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PrimitiveRow {
    /// Triangles.
    pub triangles: u32,
    /// Triangles that have an area.
    pub traced_triangles: u32,
    /// Vertices.
    pub vertices: u32,
    /// Name of its material.
    pub material: String,
    /// Place of its material.
    pub material_index: u32,
    /// Whether every ray that hits it stops.
    pub opaque: bool,
    /// Object space, metres.
    pub bounds: [[f32; 3]; 2],
}

/// A material: its record's fields by name, without the references to textures.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MaterialRow {
    /// glTF name.
    pub name: String,
    /// Fields of its record, and of its further lobes.
    pub values: Map<String, Value>,
    /// Its textures, in the order of the record.
    pub textures: Vec<TextureUse>,
}

/// A texture where a material uses it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TextureUse {
    /// Field of the record, such as `base_color_tex`.
    pub slot: &'static str,
    /// Name of the image.
    pub image: String,
    /// Place of the image.
    pub image_index: u32,
    /// Set of texture coordinates.
    pub uv: u32,
    /// Filters and wrapping.
    pub sampler: Map<String, Value>,
    /// Columns of the matrix and the offset, where the coordinates are transformed.
    pub transform: Option<Map<String, Value>>,
}

/// An image with its mip chain.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ImageRow {
    /// glTF name, or name of the product.
    pub name: String,
    /// `color`, `data`, `normal` or `environment`.
    pub role: String,
    /// Name of the [`cairn_format::TextureFormat`].
    pub format: String,
    /// Texels of level 0.
    pub width: u32,
    /// Texels of level 0.
    pub height: u32,
    /// 6 of a cube, else 1.
    pub layers: u32,
    /// Levels.
    pub levels: u32,
    /// Bytes of all levels.
    pub bytes: u64,
    /// Rows of the report that are about it.
    pub errors: Vec<ErrorRow>,
}

/// A light or a camera: its fields by name.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Item {
    /// Its name.
    pub name: String,
    /// Its other fields.
    pub values: Map<String, Value>,
}

/// A file that the package was made of.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct SourceRow {
    /// Relative to the scene's folder.
    pub path: String,
    /// Bytes.
    pub bytes: u64,
    /// BLAKE3 of the content.
    pub hash: String,
}

/// The error of one lossy step.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ErrorRow {
    /// Such as `texture`.
    pub stage: String,
    /// Object, such as an image's name.
    pub item: String,
    /// Setting or preset.
    pub setting: String,
    /// Name and unit of the metric.
    pub metric: String,
    /// Value of the metric; 999 dB stands for no error.
    pub error: f64,
    /// Bytes produced.
    pub bytes: u64,
}

impl ErrorRow {
    /// The metric without its level, and the level, of a metric such as `alpha coverage delta, mip 3, one texel`.
    pub fn level(&self) -> Option<(&str, &str)> {
        let (metric, level) = self.metric.split_once(", mip ")?;
        level
            .starts_with(|digit: char| digit.is_ascii_digit())
            .then_some((metric, level))
    }
}

impl Contents {
    /// Reads a package.
    ///
    /// # Errors
    /// Where the file changes meanwhile, or a top-level instance refers to no mesh.
    pub fn of(package: &Package) -> cairn_format::Result<Self> {
        let scene = package.scene();
        let header = package.header();
        let report: Vec<ErrorRow> = scene.report.iter().map(error_row).collect();
        Ok(Self {
            name: scene.name.to_string(),
            format_version: header.version,
            tool: scene.provenance.tool.to_string(),
            bytes: header.file_length,
            content_hash: hex(&header.content_hash),
            features: features::names(scene.features.to_native()),
            bounds: [natives(&scene.bounds.min), natives(&scene.bounds.max)],
            triangles: package.count(SectionKind::Indices) / 3,
            vertices: package.count(SectionKind::Vertices),
            instances: package.count(SectionKind::Instances),
            draw_groups: package.count(SectionKind::DrawGroups),
            sections: sections(package),
            meshes: meshes(package)?,
            materials: materials(package)?,
            images: images(package, &report),
            lights: lights(package),
            cameras: cameras(package),
            environment: environment(package),
            settings: scene
                .provenance
                .settings
                .iter()
                .map(|setting| [setting.name.to_string(), setting.value.to_string()])
                .collect(),
            sources: sources(package),
            report,
        })
    }
}

fn sections(package: &Package) -> Vec<SectionRow> {
    let rows = package.table().iter().filter_map(|entry| {
        let kind = SectionKind::from_u32(entry.kind)?;
        Some(SectionRow {
            name: kind.name(),
            records: entry.count,
            stride: entry.stride,
            offset: entry.offset,
            bytes: entry.length,
            hash: hex(&entry.hash),
        })
    });
    rows.collect()
}

fn meshes(package: &Package) -> cairn_format::Result<Vec<MeshRow>> {
    let scene = package.scene();
    let instances = package.mesh_instances()?;
    cairn_format::check::mesh_instances(instances, scene)?;
    let mut counts = vec![0_u64; scene.meshes.len()];
    for instance in instances {
        counts[instance.mesh as usize] += 1;
    }
    let rows = scene.meshes.iter().zip(counts).map(|(mesh, instances)| {
        let first = mesh.first_primitive.to_native() as usize;
        let range = first..first + mesh.primitive_count.to_native() as usize;
        let primitives: Vec<PrimitiveRow> = scene.primitives[range]
            .iter()
            .map(|primitive| PrimitiveRow {
                triangles: primitive.index_count.to_native() / 3,
                traced_triangles: primitive.traced_index_count.to_native() / 3,
                vertices: primitive.vertex_count.to_native(),
                material: scene.materials[primitive.material.to_native() as usize]
                    .name
                    .to_string(),
                material_index: primitive.material.to_native(),
                opaque: primitive.opaque,
                bounds: [
                    natives(&primitive.bounds.min),
                    natives(&primitive.bounds.max),
                ],
            })
            .collect();
        MeshRow {
            name: mesh.name.to_string(),
            instances,
            triangles: primitives.iter().map(|row| u64::from(row.triangles)).sum(),
            vertices: primitives.iter().map(|row| u64::from(row.vertices)).sum(),
            primitives,
        }
    });
    Ok(rows.collect())
}

fn materials(package: &Package) -> cairn_format::Result<Vec<MaterialRow>> {
    let extensions = package.material_extensions()?;
    let names = package.scene().materials.iter();
    let mut rows = Vec::new();
    for (index, (material, name)) in package.materials()?.iter().zip(names).enumerate() {
        let mut values = record_values(Material::FIELDS, bytemuck::bytes_of(material));
        let mut fields: Vec<&'static str> =
            Material::FIELDS.iter().map(|field| field.name).collect();
        if let Some(extension) = extensions.get(index).filter(|record| record.lobes != 0) {
            let more = record_values(MaterialExtension::FIELDS, bytemuck::bytes_of(extension));
            values.extend(more);
            fields.extend(MaterialExtension::FIELDS.iter().map(|field| field.name));
        }
        let mut textures = Vec::new();
        for slot in fields.into_iter().filter(|name| name.ends_with("_tex")) {
            let reference = values.remove(slot).and_then(|value| value.as_u64());
            let reference = reference.map_or(NO_TEXTURE, |reference| reference as u32);
            if reference != NO_TEXTURE {
                textures.push(texture_use(package, slot, reference)?);
            }
        }
        rows.push(MaterialRow {
            name: name.name.to_string(),
            values,
            textures,
        });
    }
    Ok(rows)
}

fn texture_use(
    package: &Package,
    slot: &'static str,
    reference: u32,
) -> cairn_format::Result<TextureUse> {
    let scene = package.scene();
    let index = (reference & !TEXTURE_UV1) as usize;
    let texture = &scene.textures[index];
    let image_index = texture.image.to_native();
    let sampler = &scene.samplers[texture.sampler.to_native() as usize];
    let transform = package.texture_transforms()?.get(index);
    let sampler = [
        ("mag_linear", Value::from(sampler.mag_linear)),
        ("min_linear", Value::from(sampler.min_linear)),
        ("mip", debug(&sampler.mip)),
        ("wrap_u", debug(&sampler.wrap_u)),
        ("wrap_v", debug(&sampler.wrap_v)),
    ];
    Ok(TextureUse {
        slot,
        image: scene.images[image_index as usize].name.to_string(),
        image_index,
        uv: u32::from(reference & TEXTURE_UV1 != 0),
        sampler: object(sampler),
        transform: transform.map(|transform| {
            let fields = cairn_format::gpu::TextureTransform::FIELDS;
            record_values(fields, bytemuck::bytes_of(transform))
        }),
    })
}

fn images(package: &Package, report: &[ErrorRow]) -> Vec<ImageRow> {
    let rows = package.scene().images.iter().map(|image| {
        let name = image.name.to_string();
        // Products of the environment have rows such as `prefiltered level 3`.
        let about = |row: &&ErrorRow| {
            let rest = row.item.strip_prefix(name.as_str());
            match row.stage.as_str() {
                "environment" => rest.is_some_and(|rest| rest.is_empty() || rest.starts_with(' ')),
                _ => rest == Some(""),
            }
        };
        ImageRow {
            errors: report.iter().filter(about).cloned().collect(),
            role: format!("{:?}", image.role).to_lowercase(),
            format: format!("{:?}", image.format),
            width: image.width.to_native(),
            height: image.height.to_native(),
            layers: image.layers.to_native(),
            levels: image.levels.len() as u32,
            bytes: image
                .levels
                .iter()
                .map(|level| level.length.to_native())
                .sum(),
            name,
        }
    });
    rows.collect()
}

fn lights(package: &Package) -> Vec<Item> {
    let rows = package.scene().lights.iter().map(|light| Item {
        name: light.name.to_string(),
        values: object([
            ("kind", debug(&light.kind)),
            ("color", floats(&natives(&light.color))),
            ("intensity", float(light.intensity.to_native())),
            ("position", floats(&natives(&light.position))),
            ("direction", floats(&natives(&light.direction))),
            ("range", float(light.range.to_native())),
            ("inner_angle", float(light.inner_angle.to_native())),
            ("outer_angle", float(light.outer_angle.to_native())),
        ]),
    });
    rows.collect()
}

fn cameras(package: &Package) -> Vec<Item> {
    let rows = package.scene().cameras.iter().map(|camera| Item {
        name: camera.name.to_string(),
        values: object([
            ("projection", debug(&camera.projection)),
            ("extent", float(camera.extent.to_native())),
            ("znear", float(camera.znear.to_native())),
            ("zfar", float(camera.zfar.to_native())),
            ("position", floats(&natives(&camera.position))),
            ("forward", floats(&natives(&camera.forward))),
            ("up", floats(&natives(&camera.up))),
        ]),
    });
    rows.collect()
}

fn environment(package: &Package) -> Option<Map<String, Value>> {
    let scene = package.scene();
    let environment = scene.environment.as_ref()?;
    let image = |index: u32| Value::from(scene.images[index as usize].name.as_str());
    let sh: Vec<Value> = environment
        .irradiance_sh
        .iter()
        .map(|rgb| floats(&natives(rgb)))
        .collect();
    let sun = environment.sun.as_ref().map(|sun| {
        json!({
            "direction": floats(&natives(&sun.direction)),
            "color": floats(&natives(&sun.color)),
            "illuminance": float(sun.illuminance.to_native()),
            "angular_radius": float(sun.angular_radius.to_native()),
        })
    });
    Some(object([
        ("sky", image(environment.sky.to_native())),
        ("irradiance", image(environment.irradiance.to_native())),
        ("prefiltered", image(environment.prefiltered.to_native())),
        ("scale", float(environment.scale.to_native())),
        ("sun", sun.into()),
        ("irradiance_sh", sh.into()),
        ("source_width", environment.source_width.to_native().into()),
        (
            "source_height",
            environment.source_height.to_native().into(),
        ),
        (
            "replaced_texels",
            environment.replaced_texels.to_native().into(),
        ),
        (
            "clamped_texels",
            environment.clamped_texels.to_native().into(),
        ),
    ]))
}

fn sources(package: &Package) -> Vec<SourceRow> {
    let sources = package.scene().provenance.sources.iter();
    sources
        .map(|source| SourceRow {
            path: source.path.to_string(),
            bytes: source.bytes.to_native(),
            hash: hex(&source.hash),
        })
        .collect()
}

fn error_row(row: &ArchivedReportRow) -> ErrorRow {
    ErrorRow {
        stage: row.stage.to_string(),
        item: row.item.to_string(),
        setting: row.setting.to_string(),
        metric: row.metric.to_string(),
        error: row.error.to_native(),
        bytes: row.bytes.to_native(),
    }
}

fn debug(value: &dyn std::fmt::Debug) -> Value {
    format!("{value:?}").to_lowercase().into()
}

fn floats(values: &[f32]) -> Value {
    values.iter().map(|value| float(*value)).collect()
}

fn object<const N: usize>(fields: [(&str, Value); N]) -> Map<String, Value> {
    let fields = fields.into_iter();
    fields
        .map(|(name, value)| (name.to_owned(), value))
        .collect()
}
