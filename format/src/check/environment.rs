//! Rules of the environment: its cubes, sun and coefficients at `open`, its importance table in bulk.

use crate::brdf_table::BRDF_TABLE_SIZE;
use crate::error::Result;
use crate::features;
use crate::gpu::{EnvAliasEntry, EnvAliasHeader};
use crate::package::Package;
use crate::scene::{ArchivedEnvironment, ArchivedScene, ArchivedSun, natives};
use crate::section::SectionKind;

use super::{Flow, Found, finite, first, root_error, section_error};

/// Largest relative error of the importance table's integral over the sphere.
const ALIAS_TOLERANCE: f64 = 1e-4;
/// Largest difference from 1 of the length of a unit vector.
const UNIT_TOLERANCE: f32 = 1e-4;

/// Cubes, BRDF table, sun, coefficients, and that the importance table's words are whole entries.
pub(super) fn environment(package: &Package, scene: &ArchivedScene, found: &mut Found) -> Flow {
    let layers = |image: u32| {
        scene
            .images
            .get(image as usize)
            .map(|image| image.layers.to_native())
    };
    let extent = |image: u32| {
        let image = &scene.images[image as usize];
        [image.width.to_native(), image.height.to_native()]
    };
    match scene.brdf_lut.as_ref() {
        Some(image) if layers(image.to_native()) != Some(1) => {
            let what = format!("BRDF table: image {image} is no 2D image");
            found(root_error(what))?;
        }
        Some(image) if extent(image.to_native()) != [BRDF_TABLE_SIZE; 2] => {
            let what = format!("BRDF table: image {image} is not {BRDF_TABLE_SIZE} texels a side");
            found(root_error(what))?;
        }
        _ => {}
    }
    let words = package.count(SectionKind::EnvAlias);
    if words != 0 && (words < 7 || words % 3 != 1) {
        let what = format!("{words} words are no header and entries");
        found(section_error(SectionKind::EnvAlias, 0, what))?;
    }
    let Some(environment) = scene.environment.as_ref() else {
        if words != 0 {
            found(root_error("an importance table without an environment"))?;
        }
        return sun_feature(scene, false, found);
    };
    for image in [
        environment.sky,
        environment.irradiance,
        environment.prefiltered,
    ] {
        if layers(image.to_native()) != Some(6) {
            return found(root_error(format!("environment: image {image} is no cube")));
        }
    }
    if scene.brdf_lut.is_none() {
        found(root_error("environment without a BRDF table"))?;
    }
    sun_feature(scene, environment.sun.is_some(), found)?;
    light(scene, environment, found)
}

fn sun_feature(scene: &ArchivedScene, sun: bool, found: &mut Found) -> Flow {
    let bit = scene.features.to_native() & features::SUN != 0;
    if bit == sun {
        return Flow::Continue(());
    }
    found(root_error(
        "environment: the feature bit and the sun differ",
    ))
}

fn light(scene: &ArchivedScene, environment: &ArchivedEnvironment, found: &mut Found) -> Flow {
    let mut fail = |what: String| found(root_error(format!("environment: {what}")));
    let scale = environment.scale.to_native();
    if !scale.is_finite() || scale <= 0.0 {
        fail(format!("scale {scale}"))?;
    }
    let prefiltered = &scene.images[environment.prefiltered.to_native() as usize];
    let (levels, stored) = (
        prefiltered.levels.len(),
        environment.prefiltered_roughness.len(),
    );
    if levels != stored {
        fail(format!("{stored} roughnesses of {levels} levels"))?;
    }
    for (level, roughness) in environment.prefiltered_roughness.iter().enumerate() {
        let expected = level as f32 / (levels - 1).max(1) as f32;
        if (roughness.to_native() - expected).abs() > 1e-6 {
            fail(format!(
                "level {level} has roughness {roughness}, not {expected}"
            ))?;
        }
    }
    let coefficients = environment.irradiance_sh.iter();
    if !coefficients.into_iter().all(|rgb| finite(&natives(rgb))) {
        fail("a coefficient is not finite".into())?;
    }
    match environment.sun.as_ref() {
        Some(sun) if !sound(sun) => {
            fail("the sun's direction, colour, illuminance or radius is out of range".into())
        }
        _ => Flow::Continue(()),
    }
}

fn sound(sun: &ArchivedSun) -> bool {
    let (direction, color) = (natives(&sun.direction), natives(&sun.color));
    let length = direction.iter().map(|x| x * x).sum::<f32>().sqrt();
    let radius = sun.angular_radius.to_native();
    let illuminance = sun.illuminance.to_native();
    // Written so that NaN fails.
    (length - 1.0).abs() <= UNIT_TOLERANCE
        && color.iter().all(|channel| (0.0..=1.0).contains(channel))
        && color.contains(&1.0)
        && illuminance > 0.0
        && illuminance.is_finite()
        && radius > 0.0
        && radius <= std::f32::consts::FRAC_PI_2
}

/// The importance table: whole grid, probabilities and aliases in range, the density of every cell that of its
/// luminance, their sum over the sphere 1 within 1e-4. An absent section is sound.
///
/// # Errors
/// The first broken rule.
pub fn env_alias(bytes: &[u8]) -> Result<()> {
    first(|found| each_env_alias(bytes, found))
}

pub(super) fn each_env_alias(bytes: &[u8], found: &mut Found) -> Flow {
    let mut fail =
        |word: usize, what: String| found(section_error(SectionKind::EnvAlias, word, what));
    let Some((head, rest)) = bytes.split_first_chunk::<{ size_of::<EnvAliasHeader>() }>() else {
        return if bytes.is_empty() {
            Flow::Continue(())
        } else {
            fail(0, format!("{} bytes are no header", bytes.len()))
        };
    };
    let header: EnvAliasHeader = bytemuck::pod_read_unaligned(head);
    let count = header.entry_count as usize;
    let cells = u64::from(header.width) * u64::from(header.height);
    if cells == 0 || cells != count as u64 || rest.len() != count * size_of::<EnvAliasEntry>() {
        let (width, height) = (header.width, header.height);
        return fail(0, format!("{count} entries of {width} x {height} cells"));
    }
    if !header.total_luminance.is_finite() || header.total_luminance <= 0.0 {
        return fail(0, format!("total luminance {}", header.total_luminance));
    }
    let entries: &[EnvAliasEntry] = bytemuck::cast_slice(rest);
    let mut sound = true;
    for (index, entry) in entries.iter().enumerate() {
        let luminance = entry.luminance.is_finite() && entry.luminance >= 0.0;
        if !(0.0..=1.0).contains(&entry.prob) || entry.alias_index as usize >= count || !luminance {
            sound = false;
            fail(4 + 3 * index, format!("entry {index} is out of range"))?;
        }
    }
    if !sound {
        return Flow::Continue(());
    }
    let [integral, difference] = density(&header, entries);
    if (integral - 1.0).abs() > ALIAS_TOLERANCE || difference > ALIAS_TOLERANCE {
        let what =
            format!("the density integrates to {integral}, and is off by {difference} in sum");
        fail(0, what)?;
    }
    Flow::Continue(())
}

/// Integral of the density over the sphere, and the sum over the cells of how far the probability of drawing one
/// is from that of its luminance.
fn density(header: &EnvAliasHeader, entries: &[EnvAliasEntry]) -> [f64; 2] {
    let mut drawn = vec![0.0; entries.len()];
    for (index, entry) in entries.iter().enumerate() {
        drawn[index] += f64::from(entry.prob);
        drawn[entry.alias_index as usize] += 1.0 - f64::from(entry.prob);
    }
    let (width, height) = (header.width as usize, f64::from(header.height));
    let edge = |row: usize| (std::f64::consts::PI * row as f64 / height).cos();
    let total = f64::from(header.total_luminance);
    let (mut integral, mut difference) = (0.0, 0.0);
    for (row, cells) in entries.chunks_exact(width).enumerate() {
        let solid_angle = std::f64::consts::TAU / width as f64 * (edge(row) - edge(row + 1));
        for (cell, drawn) in cells.iter().zip(&drawn[row * width..]) {
            let probability = f64::from(cell.luminance) * solid_angle / total;
            integral += probability;
            difference += (probability - drawn / entries.len() as f64).abs();
        }
    }
    [integral, difference]
}
