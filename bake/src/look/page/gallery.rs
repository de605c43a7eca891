//! Pictures of textures and of the environment's products, each with its error.

use std::fmt::Write;

use cairn_format::{Package, Result};
use rayon::prelude::*;
use serde_json::Value;

use super::{data_uri, escape};
use crate::look::contents::{Contents, ImageRow};
use crate::look::picture::{level_picture, thumbnail};
use crate::look::{bytes_text, number};

/// Longer side of a texture's picture, and width of an environment's.
const TEXTURE: u32 = 192;
const PANORAMA: u32 = 320;

pub(super) fn textures(out: &mut String, package: &Package, contents: &Contents) -> Result<()> {
    let wanted = |row: &&ImageRow| row.role != "environment";
    if !contents.images.iter().any(|row| wanted(&row)) {
        return Ok(());
    }
    let texels = package.texels()?;
    let images: Vec<_> = package
        .scene()
        .images
        .iter()
        .zip(&contents.images)
        .collect();
    let figures: Vec<String> = images
        .par_iter()
        .filter(|(_, row)| wanted(row))
        .map(|(image, row)| figure(&thumbnail(image, texels, TEXTURE).png(), row))
        .collect();
    out.push_str("<h2>Textures</h2>\n<div class=\"grid\">\n");
    out.extend(figures);
    out.push_str("</div>\n");
    Ok(())
}

fn figure(png: &[u8], row: &ImageRow) -> String {
    let mut out = format!(
        "<figure><img alt=\"{0}\" loading=\"lazy\" src=\"{1}\"><figcaption><strong>{0}</strong><br>{2} {3}, {4}x{5}, {6} levels, {7}",
        escape(&row.name),
        data_uri(png),
        escape(&row.role),
        row.format,
        row.width,
        row.height,
        row.levels,
        bytes_text(row.bytes)
    );
    for error in row.errors.iter().filter(|error| error.level().is_none()) {
        let exact = error.metric.contains("psnr") && error.error >= 999.0;
        let value = if exact {
            "exact".into()
        } else {
            number(error.error)
        };
        let _ = write!(out, "<br>{}: {value}", escape(&error.metric));
    }
    out + "</figcaption></figure>\n"
}

/// A value as text.
fn plain(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Null => "none".into(),
        Value::Object(fields) => {
            let fields: Vec<String> = fields
                .iter()
                .map(|(name, value)| format!("{name} {}", plain(value)))
                .collect();
            fields.join(", ")
        }
        Value::Array(items) => items.iter().map(plain).collect::<Vec<_>>().join(" "),
        other => other.to_string(),
    }
}

pub(super) fn environment(out: &mut String, package: &Package, contents: &Contents) -> Result<()> {
    let Some(environment) = &contents.environment else {
        return Ok(());
    };
    out.push_str("<h2>Environment</h2>\n<div class=\"wide\"><table>");
    let shown = environment
        .iter()
        .filter(|(name, _)| *name != "irradiance_sh");
    for (name, value) in shown {
        let _ = write!(out, "<tr><th>{}<td>{}", escape(name), escape(&plain(value)));
    }
    out.push_str("</table></div>\n<p class=\"soft\">Cubes seen all around, each exposed for itself.</p>\n<div class=\"grid\">\n");
    let texels = package.texels()?;
    let images = package.scene().images.iter().zip(&contents.images);
    for (image, row) in images.filter(|(_, row)| row.role == "environment") {
        let all = row.layers == 6 && row.name == "prefiltered";
        let levels = if all { row.levels as usize } else { 1 };
        for level in 0..levels {
            let picture = level_picture(image, texels, level, PANORAMA);
            let mut shown = row.clone();
            if all {
                // The report has a row `prefiltered 3` for every level, and `prefiltered stored` for all of them.
                let of_level = |item: &str| {
                    let level = item.strip_prefix(&row.name).map(str::trim);
                    level.and_then(|level| level.parse::<usize>().ok())
                };
                shown.errors.retain(|error| match of_level(&error.item) {
                    Some(other) => other == level,
                    None => level == 0,
                });
                shown.name = format!("{} {level}", row.name);
                (shown.width, shown.height) = (row.width >> level, row.height >> level);
                shown.bytes = image.levels[level].length.to_native();
                shown.levels = 1;
            }
            out.push_str(&figure(&picture.png(), &shown));
        }
    }
    out.push_str("</div>\n");
    Ok(())
}
