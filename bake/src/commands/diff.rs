//! Tells two packages apart: by sections, and by what they mean.

use std::fmt::Write;
use std::path::PathBuf;

use serde_json::Value;

use super::{NEGATIVE, SUCCESS, print_json, print_text};
use crate::diagnostic::Result;
use crate::look::{self, Changes, Difference, FieldChange, bytes_text, number, printable, refused};

/// `cairn-bake diff BEFORE AFTER`.
#[derive(clap::Args, Debug)]
#[command(after_help = "Exit codes: 0 equal, 1 different, 2 a package cannot be read.")]
pub struct Diff {
    /// A package.
    before: PathBuf,
    /// Another package.
    after: PathBuf,
    /// Print one JSON object on standard output.
    #[arg(long)]
    json: bool,
    /// Print nothing; the exit code tells.
    #[arg(long, short, conflicts_with = "json")]
    quiet: bool,
}

impl Diff {
    pub(super) fn run(&self) -> Result<u8> {
        let (before, after) = (look::open(&self.before)?, look::open(&self.after)?);
        for (package, path) in [(&before, &self.before), (&after, &self.after)] {
            package.verify().map_err(|error| refused(path, error))?;
        }
        let difference =
            Difference::between(&before, &after).map_err(|error| refused(&self.after, error))?;
        if self.json {
            print_json(&difference)?;
        } else if !self.quiet {
            print_text(&text(&difference))?;
        }
        Ok(if difference.equal { SUCCESS } else { NEGATIVE })
    }
}

fn text(difference: &Difference) -> String {
    let mut out = String::new();
    write(&mut out, difference).unwrap_or_default();
    out
}

fn write(out: &mut String, difference: &Difference) -> std::fmt::Result {
    if difference.equal {
        return writeln!(out, "equal: blake3 {}", difference.content_hashes[0]);
    }
    for section in &difference.sections {
        let [a, b] = section.bytes.map(bytes_text);
        let [n, m] = section.records;
        writeln!(
            out,
            "section {:<20}{a} -> {b}, {n} -> {m} records",
            section.name
        )?;
    }
    names(out, "mesh", &difference.meshes)?;
    for mesh in &difference.meshes.changed {
        let change = &mesh.difference;
        write!(out, "~ mesh {}:", printable(&mesh.name))?;
        counts(out, "triangles", change.triangles)?;
        counts(out, "vertices", change.vertices)?;
        if let Some(way) = change.largest_move {
            let how = if change.same_order {
                ""
            } else {
                " to the nearest"
            };
            write!(out, " largest vertex move {} m{how},", number(way))?;
        }
        if let Some(turn) = change.largest_normal_turn.filter(|turn| *turn > 0.0) {
            write!(out, " normals turn by {} degrees,", number(turn))?;
        }
        if let Some(uv) = change.largest_uv_move.filter(|uv| *uv > 0.0) {
            write!(out, " coordinates move by {},", number(uv))?;
        }
        writeln!(out, " bounds move {} m", number(change.bounds_move))?;
        if let Some([before, after]) = &mesh.materials {
            let [before, after] = [before, after].map(|names| printable(&names.join(", ")));
            writeln!(out, "    materials: {before} -> {after}")?;
        }
    }
    for (kind, changes) in [
        ("material", &difference.materials),
        ("light", &difference.lights),
    ] {
        objects(out, kind, changes)?;
    }
    names(out, "image", &difference.images)?;
    for image in &difference.images.changed {
        write!(out, "~ image {}:", printable(&image.name))?;
        match &image.texels {
            Some(texels) => match texels.psnr_db {
                Some(psnr) => write!(
                    out,
                    " PSNR {psnr:.2} dB, largest difference {}",
                    number(texels.largest)
                )?,
                None => write!(
                    out,
                    " level 0 decodes alike, {} levels differ",
                    texels.levels
                )?,
            },
            None => write!(out, " not comparable texel by texel")?,
        }
        writeln!(out)?;
        fields(out, &image.fields)?;
    }
    names(out, "instance", &difference.instances)?;
    for instance in &difference.instances.changed {
        let way = number(instance.largest_move);
        writeln!(
            out,
            "~ instance {}: moves by up to {way} m",
            printable(&instance.name)
        )?;
    }
    objects(out, "camera", &difference.cameras)?;
    if !difference.fields.is_empty() {
        writeln!(out, "~ scene")?;
        fields(out, &difference.fields)?;
    }
    objects(out, "source", &difference.sources)
}

fn counts(out: &mut String, of: &str, [before, after]: [u64; 2]) -> std::fmt::Result {
    if before == after {
        return Ok(());
    }
    write!(out, " {before} -> {after} {of},")
}

fn objects(
    out: &mut String,
    kind: &str,
    changes: &Changes<look::FieldChanges>,
) -> std::fmt::Result {
    names(out, kind, changes)?;
    for object in &changes.changed {
        writeln!(out, "~ {kind} {}", printable(&object.name))?;
        fields(out, &object.fields)?;
    }
    Ok(())
}

fn names<T>(out: &mut String, kind: &str, changes: &Changes<T>) -> std::fmt::Result {
    for name in &changes.added {
        writeln!(out, "+ {kind} {}", printable(name))?;
    }
    for name in &changes.removed {
        writeln!(out, "- {kind} {}", printable(name))?;
    }
    Ok(())
}

fn fields(out: &mut String, changes: &[FieldChange]) -> std::fmt::Result {
    let plain = |value: &Value| match value {
        Value::String(text) => printable(text),
        Value::Null => "none".into(),
        other => printable(&other.to_string()),
    };
    for change in changes {
        let (before, after) = (plain(&change.before), plain(&change.after));
        writeln!(out, "    {}: {before} -> {after}", change.field)?;
    }
    Ok(())
}
