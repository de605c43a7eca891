//! What differs between two packages: sections, and what they mean.

use std::collections::BTreeMap;

use cairn_format::gpu::MeshInstance;
use cairn_format::{Package, Result};
use glam::{Mat4, Vec4};
use serde::Serialize;
use serde_json::{Map, Value};

use super::compare::{self, ImageDifference, MeshDifference};
use super::contents::Contents;
use super::mesh::meshes;

/// Differences of two packages, called before and after.
#[derive(Clone, Debug, Serialize)]
pub struct Difference {
    /// Whether both have the same content hash, and so the same bytes.
    pub equal: bool,
    /// Before and after.
    pub content_hashes: [String; 2],
    /// Sections whose content differs.
    pub sections: Vec<SectionChange>,
    /// By name.
    pub meshes: Changes<MeshChange>,
    /// By name.
    pub materials: Changes<FieldChanges>,
    /// By name and role.
    pub images: Changes<ImageChange>,
    /// Top-level instances, as the n-th of their mesh.
    pub instances: Changes<InstanceChange>,
    /// By name.
    pub lights: Changes<FieldChanges>,
    /// By name.
    pub cameras: Changes<FieldChanges>,
    /// Fields of the scene, the environment and the settings of the bake.
    pub fields: Vec<FieldChange>,
    /// Input files.
    pub sources: Changes<FieldChanges>,
}

/// A section that only one package has, or whose hash differs.
#[derive(Clone, Debug, Serialize)]
pub struct SectionChange {
    /// Name of its kind.
    pub name: &'static str,
    /// Bytes before and after; 0 where it is absent.
    pub bytes: [u64; 2],
    /// Before and after.
    pub records: [u64; 2],
}

/// Names that only one package has, and what differs of the others. Equal names count up.
#[derive(Clone, Debug, Serialize)]
pub struct Changes<T> {
    /// Only after.
    pub added: Vec<String>,
    /// Only before.
    pub removed: Vec<String>,
    /// In both, and not the same.
    pub changed: Vec<T>,
}

/// Fields that differ of one object.
#[derive(Clone, Debug, Serialize)]
pub struct FieldChanges {
    /// Name of the object.
    pub name: String,
    /// What differs.
    pub fields: Vec<FieldChange>,
}

/// A field that differs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FieldChange {
    /// Path of the field, such as `textures.0.image`.
    pub field: String,
    /// Null where it is absent.
    pub before: Value,
    /// Null where it is absent.
    pub after: Value,
}

/// A mesh that differs.
#[derive(Clone, Debug, Serialize)]
pub struct MeshChange {
    /// Name of the mesh.
    pub name: String,
    /// How far both are from each other.
    #[serde(flatten)]
    pub difference: MeshDifference,
    /// Names of the materials of its primitives, where these differ.
    pub materials: Option<[Vec<String>; 2]>,
}

/// An image that differs.
#[derive(Clone, Debug, Serialize)]
pub struct ImageChange {
    /// Name and role of the image.
    pub name: String,
    /// Format, extents, levels: where these differ.
    pub fields: Vec<FieldChange>,
    /// Absent where the extents differ.
    pub texels: Option<ImageDifference>,
}

/// An instance that stands elsewhere.
#[derive(Clone, Debug, Serialize)]
pub struct InstanceChange {
    /// Name of its mesh, and which of it.
    pub name: String,
    /// Longest way of a corner of its mesh's bounds, metres.
    pub largest_move: f64,
}

impl Difference {
    /// Compares two packages.
    ///
    /// # Errors
    /// Bulk data that is out of range, or a file that changes meanwhile.
    pub fn between(a: &Package, b: &Package) -> Result<Self> {
        let (before, after) = (Contents::of(a)?, Contents::of(b)?);
        Ok(Self {
            equal: before.content_hash == after.content_hash,
            sections: sections(&before, &after),
            meshes: mesh_changes([a, b], [&before, &after])?,
            materials: items(&before.materials, &after.materials, |row| row.name.clone()),
            images: image_changes([a, b], [&before, &after])?,
            instances: instance_changes([a, b])?,
            lights: items(&before.lights, &after.lights, |row| row.name.clone()),
            cameras: items(&before.cameras, &after.cameras, |row| row.name.clone()),
            fields: fields("", &scene_fields(&before), &scene_fields(&after)),
            sources: items(&before.sources, &after.sources, |row| row.path.clone()),
            content_hashes: [before.content_hash, after.content_hash],
        })
    }
}

fn sections(before: &Contents, after: &Contents) -> Vec<SectionChange> {
    let rows = |contents: &Contents| -> BTreeMap<&'static str, (u64, u64, String)> {
        let rows = contents.sections.iter();
        rows.map(|row| (row.name, (row.bytes, row.records, row.hash.clone())))
            .collect()
    };
    let (before, after) = (rows(before), rows(after));
    let kinds = cairn_format::SectionKind::ALL
        .iter()
        .map(|kind| kind.name());
    kinds
        .filter(|name| before.get(name) != after.get(name))
        .map(|name| {
            let of = |rows: &BTreeMap<_, (u64, u64, String)>| {
                rows.get(name).map_or([0, 0], |row| [row.0, row.1])
            };
            let ([a, n], [b, m]) = (of(&before), of(&after));
            SectionChange {
                name,
                bytes: [a, b],
                records: [n, m],
            }
        })
        .collect()
}

/// Indices by name; the second of a name is `name (2)`.
fn keys(names: impl Iterator<Item = String>) -> BTreeMap<String, usize> {
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    let mut keys = BTreeMap::new();
    for (index, name) in names.enumerate() {
        let count = counts.entry(name.clone()).or_default();
        *count += 1;
        let key = if *count == 1 {
            name
        } else {
            format!("{name} ({count})")
        };
        keys.insert(key, index);
    }
    keys
}

/// Pairs objects by name; `compare` gets the name and both indices.
fn pair<T>(
    before: &BTreeMap<String, usize>,
    after: &BTreeMap<String, usize>,
    mut compare: impl FnMut(&str, usize, usize) -> Option<T>,
) -> Changes<T> {
    let missing = |from: &BTreeMap<String, usize>, of: &BTreeMap<String, usize>| {
        let names = from.keys().filter(|name| !of.contains_key(*name));
        names.cloned().collect()
    };
    let both = before
        .iter()
        .filter_map(|(name, a)| Some((name, *a, *after.get(name)?)));
    Changes {
        changed: both
            .filter_map(|(name, a, b)| compare(name, a, b))
            .collect(),
        added: missing(after, before),
        removed: missing(before, after),
    }
}

fn items<T: Serialize>(
    before: &[T],
    after: &[T],
    name: impl Fn(&T) -> String,
) -> Changes<FieldChanges> {
    let names = |rows: &[T]| keys(rows.iter().map(&name));
    pair(&names(before), &names(after), |name, a, b| {
        let fields = fields("", &plain(&before[a]), &plain(&after[b]));
        (!fields.is_empty()).then(|| FieldChanges {
            name: name.to_owned(),
            fields,
        })
    })
}

/// A row as JSON, without numbers of places, which shift when others are added.
fn plain(row: &impl Serialize) -> Value {
    let mut value = serde_json::to_value(row).unwrap_or(Value::Null);
    drop_indices(&mut value);
    value
}

fn drop_indices(value: &mut Value) {
    match value {
        Value::Object(fields) => {
            fields.retain(|name, _| !name.ends_with("_index"));
            fields.values_mut().for_each(drop_indices);
        }
        Value::Array(items) => items.iter_mut().for_each(drop_indices),
        _ => {}
    }
}

fn scene_fields(contents: &Contents) -> Value {
    let settings = contents.settings.iter();
    let settings: Map<String, Value> = settings
        .map(|[name, value]| (name.clone(), Value::from(value.as_str())))
        .collect();
    serde_json::json!({
        "name": contents.name,
        "tool": contents.tool,
        "format_version": contents.format_version,
        "features": contents.features,
        "bounds": contents.bounds,
        "environment": contents.environment,
        "settings": settings,
    })
}

/// Leaves of two values that differ, named by their path.
fn fields(path: &str, before: &Value, after: &Value) -> Vec<FieldChange> {
    if before == after {
        return Vec::new();
    }
    let join = |name: &str| {
        if path.is_empty() {
            name.to_owned()
        } else {
            format!("{path}.{name}")
        }
    };
    match (before, after) {
        (Value::Object(a), Value::Object(b)) => {
            let mut names: Vec<&String> = a.keys().chain(b.keys()).collect();
            names.sort();
            names.dedup();
            let null = Value::Null;
            let of =
                |object: &Map<String, Value>, name: &str| object.get(name).unwrap_or(&null).clone();
            names
                .into_iter()
                .flat_map(|name| fields(&join(name), &of(a, name), &of(b, name)))
                .collect()
        }
        // Lists of objects by place; lists of numbers as a whole.
        (Value::Array(a), Value::Array(b))
            if a.len() == b.len() && a.iter().any(Value::is_object) =>
        {
            a.iter()
                .zip(b)
                .enumerate()
                .flat_map(|(index, (a, b))| fields(&join(&index.to_string()), a, b))
                .collect()
        }
        _ => vec![FieldChange {
            field: path.to_owned(),
            before: before.clone(),
            after: after.clone(),
        }],
    }
}

fn mesh_changes(
    [a, b]: [&Package; 2],
    [before, after]: [&Contents; 2],
) -> Result<Changes<MeshChange>> {
    let (a, b) = (meshes(a)?, meshes(b)?);
    let names = |contents: &Contents| keys(contents.meshes.iter().map(|mesh| mesh.name.clone()));
    let materials = |contents: &Contents, index: usize| -> Vec<String> {
        let primitives = contents.meshes[index].primitives.iter();
        primitives
            .map(|primitive| primitive.material.clone())
            .collect()
    };
    Ok(pair(&names(before), &names(after), |name, i, j| {
        let used = [materials(before, i), materials(after, j)];
        let same_materials = used[0] == used[1];
        let same = a[i].primitives.len() == b[j].primitives.len()
            && a[i].primitives.iter().zip(&b[j].primitives).all(|(a, b)| {
                a.indices == b.indices && a.vertices == b.vertices && a.colors == b.colors
            });
        (!same || !same_materials).then(|| MeshChange {
            name: name.to_owned(),
            difference: compare::meshes(&a[i], &b[j]),
            materials: (!same_materials).then_some(used),
        })
    }))
}

fn image_changes(
    [a, b]: [&Package; 2],
    [before, after]: [&Contents; 2],
) -> Result<Changes<ImageChange>> {
    let texels = [a.texels()?, b.texels()?];
    // An image may be stored once for each role.
    let names = |contents: &Contents| {
        let rows = contents.images.iter();
        keys(rows.map(|image| format!("{} ({})", image.name, image.role)))
    };
    Ok(pair(&names(before), &names(after), |name, i, j| {
        let (one, other) = (&a.scene().images[i], &b.scene().images[j]);
        let shape = |contents: &Contents, index: usize| {
            let mut row = plain(&contents.images[index]);
            // Errors are told by the texels, and by the report.
            row.as_object_mut().map(|fields| fields.remove("errors"));
            row
        };
        let fields = fields("", &shape(before, i), &shape(after, j));
        let same = fields.is_empty() && bytes(one, texels[0]).eq(bytes(other, texels[1]));
        (!same).then(|| ImageChange {
            name: name.to_owned(),
            fields,
            texels: compare::images((one, texels[0]), (other, texels[1])),
        })
    }))
}

fn bytes<'a>(
    image: &'a cairn_format::scene::ArchivedImage,
    texels: &'a [u8],
) -> impl Iterator<Item = &'a [u8]> {
    image.levels.iter().map(move |level| {
        let start = level.offset.to_native() as usize;
        &texels[start..start + level.length.to_native() as usize]
    })
}

fn instance_changes([a, b]: [&Package; 2]) -> Result<Changes<InstanceChange>> {
    let names = |package: &Package| -> Result<BTreeMap<String, usize>> {
        let scene = package.scene();
        let rows = package.mesh_instances()?.iter();
        Ok(keys(rows.map(|row| {
            scene.meshes[row.mesh as usize].name.to_string()
        })))
    };
    let (before, after) = (a.mesh_instances()?, b.mesh_instances()?);
    Ok(pair(&names(a)?, &names(b)?, |name, i, j| {
        let moved = before[i].transform != after[j].transform || before[i].flags != after[j].flags;
        moved.then(|| InstanceChange {
            name: name.to_owned(),
            largest_move: largest_move(a, &before[i], &after[j]),
        })
    }))
}

/// Longest way of a corner of the mesh's bounds from one transform to the other.
fn largest_move(package: &Package, before: &MeshInstance, after: &MeshInstance) -> f64 {
    let matrix = |instance: &MeshInstance| {
        let [x, y, z] = instance.transform.map(Vec4::from);
        Mat4::from_cols(x, y, z, Vec4::W).transpose().as_dmat4()
    };
    let scene = package.scene();
    let mesh = &scene.meshes[before.mesh as usize];
    let first = mesh.first_primitive.to_native() as usize;
    let range = first..first + mesh.primitive_count.to_native() as usize;
    let (before, after) = (matrix(before), matrix(after));
    let mut largest = 0.0_f64;
    for primitive in &scene.primitives[range] {
        let corners = [&primitive.bounds.min, &primitive.bounds.max]
            .map(|corner| glam::Vec3::from(cairn_format::scene::natives(corner)).as_dvec3());
        for corner in 0..8 {
            let pick = |axis: usize| corners[corner >> axis & 1][axis];
            let point = glam::DVec3::new(pick(0), pick(1), pick(2));
            let way = before
                .transform_point3(point)
                .distance(after.transform_point3(point));
            largest = largest.max(way);
        }
    }
    largest
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn leaves_are_named_by_their_path() {
        let before = json!({"a": {"b": [1.0, 2.0], "c": 3}, "list": [{"x": 1}, {"x": 2}]});
        let after =
            json!({"a": {"b": [1.0, 2.5], "c": 3}, "list": [{"x": 1}, {"x": 4}], "new": true});
        let changes = fields("", &before, &after);
        let paths: Vec<&str> = changes.iter().map(|change| change.field.as_str()).collect();
        assert_eq!(paths, ["a.b", "list.1.x", "new"]);
        assert_eq!(
            (&changes[2].before, &changes[2].after),
            (&Value::Null, &json!(true))
        );
    }

    #[test]
    fn equal_names_count_up() {
        let keys = keys(["a", "b", "a"].map(String::from).into_iter());
        assert_eq!(
            keys.into_iter().collect::<Vec<_>>(),
            [("a".into(), 0), ("a (2)".into(), 2), ("b".into(), 1)]
        );
    }

    #[test]
    fn places_are_no_content() {
        let row = json!({"image_index": 3, "textures": [{"image": "a", "image_index": 1}]});
        assert_eq!(plain(&row), json!({"textures": [{"image": "a"}]}));
    }
}
