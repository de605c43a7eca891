//! Rules of what emits: its triangles, the table that draws them, and what each instance lists.

use crate::error::Result;
use crate::gpu::{
    EmissiveAliasEntry, EmissiveAliasHeader, EmissiveTriangle, MATERIAL_UNLIT, Material,
    NO_EMISSION,
};
use crate::package::Package;
use crate::scene::ArchivedPrimitive;
use crate::section::SectionKind;

use super::{Flow, Found, finite, first, given, section_error};

/// Largest sum of differences between the table's probabilities and those of the triangles' power.
const ALIAS_TOLERANCE: f64 = 1e-4;

/// Emissive triangles are finite, their table draws each by its power, and each mesh instance's triangles are
/// listed.
///
/// # Errors
/// The first broken rule.
pub fn emissive(package: &Package) -> Result<()> {
    first(|found| each_emissive(package, found))
}

pub(super) fn each_emissive(package: &Package, found: &mut Found) -> Flow {
    let triangles = given(package.emissive_triangles(), found)?;
    let materials = package.count(SectionKind::Materials) as u32;
    for (index, triangle) in triangles.iter().enumerate() {
        let mut fail = |what: &str| {
            let what = format!("triangle {index} {what}");
            found(section_error(SectionKind::EmissiveTriangles, index, what))
        };
        let values = [triangle.v0, triangle.v1, triangle.v2, triangle.emission];
        let coordinates = [triangle.uv0, triangle.uv1, triangle.uv2];
        if !finite(values.as_flattened()) || !finite(coordinates.as_flattened()) {
            fail("is not finite")?;
        }
        // Written so that NaN fails.
        let weights = [triangle.power, triangle.area];
        if !weights
            .iter()
            .all(|value| value.is_finite() && *value >= 0.0)
        {
            fail("has no power or area")?;
        }
        if triangle.material_index >= materials {
            fail("has no material")?;
        }
    }
    table(given(package.emissive_alias(), found)?, triangles, found)?;
    lists(package, triangles.len() as u64, found)
}

/// Every triangle that an instance reaches is in the section.
fn lists(package: &Package, triangles: u64, found: &mut Found) -> Flow {
    let scene = package.scene();
    let materials = given(package.materials(), found)?;
    for (index, instance) in given(package.mesh_instances(), found)?.iter().enumerate() {
        let Some(mesh) = scene.meshes.get(instance.mesh as usize) else {
            continue;
        };
        if instance.first_emissive == NO_EMISSION {
            continue;
        }
        let first = mesh.first_primitive.to_native() as usize;
        let count = mesh.primitive_count.to_native() as usize;
        let primitives = &scene.primitives[first..first + count];
        let listed = primitives
            .iter()
            .map(|primitive| emitted(materials, primitive));
        let (listed, start) = (listed.sum::<u64>(), u64::from(instance.first_emissive));
        if start + listed > triangles {
            let what = format!("{listed} emissive triangles from {start} on, of {triangles}");
            found(section_error(SectionKind::MeshInstances, index, what))?;
        }
    }
    Flow::Continue(())
}

/// Triangles of a primitive that an instance lists as emissive.
fn emitted(materials: &[Material], primitive: &ArchivedPrimitive) -> u64 {
    let material = &materials[primitive.material.to_native() as usize];
    if emits(material) && primitive.opaque {
        u64::from(primitive.traced_index_count.to_native() / 3)
    } else {
        0
    }
}

/// Whether light leaves a material by itself, and is sampled.
pub fn emits(material: &Material) -> bool {
    let shines = material.emissive_factor[..3]
        .iter()
        .any(|factor| *factor > 0.0);
    shines && material.double_sided & MATERIAL_UNLIT == 0
}

fn table(words: &[u32], triangles: &[EmissiveTriangle], found: &mut Found) -> Flow {
    const HEADER: usize = size_of::<EmissiveAliasHeader>() / 4;
    const ENTRY: usize = size_of::<EmissiveAliasEntry>() / 4;
    if words.is_empty() {
        return Flow::Continue(());
    }
    let count = triangles.len();
    let mut fail =
        |word: usize, what: String| found(section_error(SectionKind::EmissiveAlias, word, what));
    if words.len() != HEADER + count * ENTRY || words[0] as usize != count {
        return fail(0, format!("{} words for {count} triangles", words.len()));
    }
    let entries: &[EmissiveAliasEntry] = bytemuck::cast_slice(&words[HEADER..]);
    let mut sound = true;
    for (index, entry) in entries.iter().enumerate() {
        if entry.alias_index as usize >= count || !(0.0..=1.0).contains(&entry.prob) {
            sound = false;
            fail(HEADER + index * ENTRY, format!("entry {index} of {count}"))?;
        }
    }
    let total = f32::from_bits(words[1]);
    if !(total.is_finite() && total > 0.0) {
        return fail(1, format!("total power {total}"));
    }
    let difference = difference(entries, triangles, f64::from(total));
    if sound && difference > ALIAS_TOLERANCE {
        let what = format!("draws differ from the triangles' power by {difference} in sum");
        return fail(1, what);
    }
    Flow::Continue(())
}

/// Sum over the triangles of how far the probability of drawing one is from its share of the power.
fn difference(entries: &[EmissiveAliasEntry], triangles: &[EmissiveTriangle], total: f64) -> f64 {
    let mut drawn = vec![0.0; triangles.len()];
    for (index, entry) in entries.iter().enumerate() {
        drawn[index] += f64::from(entry.prob);
        if let Some(alias) = drawn.get_mut(entry.alias_index as usize) {
            *alias += 1.0 - f64::from(entry.prob);
        }
    }
    let count = entries.len() as f64;
    let differences = drawn.iter().zip(triangles);
    differences
        .map(|(drawn, triangle)| (drawn / count - f64::from(triangle.power) / total).abs())
        .sum()
}
