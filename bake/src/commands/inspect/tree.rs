//! The contents of a package as text.

use std::fmt::{Result, Write};

use cairn_format::gpu::{Material, MaterialExtension, Record};
use serde_json::{Map, Value};

use crate::look::{
    Contents, ErrorRow, ImageRow, MaterialRow, MeshRow, Picture, bytes_text, number, printable,
    record_values,
};

/// Widest column of names.
const NAME: usize = 32;

/// The whole tree; `pictures` has one a image, or none at all, and lists end after `rows` rows.
pub fn write(contents: &Contents, pictures: &[Picture], rows: usize) -> String {
    let mut out = String::new();
    let tree = Tree {
        contents,
        pictures,
        rows,
    };
    tree.write(&mut out).unwrap_or_default();
    out
}

/// The files that a package was made of, as `b3sum` writes them, with their bytes.
pub fn sources(contents: &Contents) -> String {
    let rows = contents.sources.iter();
    rows.map(|row| {
        format!(
            "{}  {:>12}  {}\n",
            row.hash,
            row.bytes,
            printable(&row.path)
        )
    })
    .collect()
}

struct Tree<'a> {
    contents: &'a Contents,
    pictures: &'a [Picture],
    rows: usize,
}

impl Tree<'_> {
    fn write(&self, out: &mut String) -> Result {
        self.head(out)?;
        self.sections(out)?;
        self.list(out, "meshes", &self.contents.meshes, |out, _, mesh| {
            self.mesh(out, mesh)
        })?;
        self.list(out, "materials", &self.contents.materials, |out, _, row| {
            material(out, row)
        })?;
        self.list(out, "images", &self.contents.images, |out, index, row| {
            self.image(out, index, row)
        })?;
        for (name, items) in [
            ("lights", &self.contents.lights),
            ("cameras", &self.contents.cameras),
        ] {
            self.list(out, name, items, |out, _, item| {
                writeln!(out, "  {}  {}", printable(&item.name), values(&item.values))
            })?;
        }
        self.environment(out)?;
        self.provenance(out)?;
        self.list(out, "errors", &self.contents.report, |out, _, row| {
            error(out, row)
        })
    }

    fn head(&self, out: &mut String) -> Result {
        let contents = self.contents;
        writeln!(
            out,
            "{}  {}, format {}, {}",
            printable(&contents.name),
            bytes_text(contents.bytes),
            contents.format_version,
            printable(&contents.tool)
        )?;
        writeln!(out, "  blake3 {}", contents.content_hash)?;
        let [min, max] = contents.bounds;
        writeln!(out, "  bounds {min:?} to {max:?} m")?;
        writeln!(
            out,
            "  {} triangles, {} vertices; {} instances in {} draw groups",
            contents.triangles, contents.vertices, contents.instances, contents.draw_groups
        )?;
        let features = contents.features.join(", ");
        writeln!(
            out,
            "  features: {}",
            if features.is_empty() {
                "none"
            } else {
                &features
            }
        )
    }

    fn sections(&self, out: &mut String) -> Result {
        writeln!(out, "sections")?;
        for row in &self.contents.sections {
            writeln!(
                out,
                "  {:<20}{:>12}{:>10} x {:<4}at {:<11}blake3 {}",
                row.name,
                bytes_text(row.bytes),
                row.records,
                row.stride,
                row.offset,
                &row.hash[..16]
            )?;
        }
        Ok(())
    }

    /// A titled list, cut after the wanted number of rows; nothing where it is empty.
    fn list<T>(
        &self,
        out: &mut String,
        title: &str,
        items: &[T],
        mut row: impl FnMut(&mut String, usize, &T) -> Result,
    ) -> Result {
        if items.is_empty() {
            return Ok(());
        }
        writeln!(out, "{title} ({})", items.len())?;
        for (index, item) in items.iter().take(self.rows).enumerate() {
            row(out, index, item)?;
        }
        match items.len().saturating_sub(self.rows) {
            0 => Ok(()),
            more => writeln!(out, "  and {more} more: --rows 0 shows all"),
        }
    }

    fn mesh(&self, out: &mut String, mesh: &MeshRow) -> Result {
        writeln!(
            out,
            "  {}  {} triangles, {} vertices, {} instances",
            name(&mesh.name),
            mesh.triangles,
            mesh.vertices,
            mesh.instances
        )?;
        for (index, primitive) in mesh.primitives.iter().take(self.rows).enumerate() {
            let last = index + 1 == mesh.primitives.len();
            let flat = primitive.triangles - primitive.traced_triangles;
            writeln!(
                out,
                "  {} {} triangles, {} vertices, {}{}{}",
                if last {
                    "\u{2514}\u{2500}"
                } else {
                    "\u{251c}\u{2500}"
                },
                primitive.triangles,
                primitive.vertices,
                name(&primitive.material),
                if primitive.opaque { "" } else { ", not opaque" },
                if flat > 0 {
                    format!(", {flat} without area")
                } else {
                    String::new()
                }
            )?;
        }
        Ok(())
    }

    fn image(&self, out: &mut String, index: usize, image: &ImageRow) -> Result {
        let mut lines = vec![
            name(&image.name),
            format!(
                "{} {}, {}x{}{}, {} levels, {}",
                image.role,
                image.format,
                image.width,
                image.height,
                if image.layers == 6 { " cube" } else { "" },
                image.levels,
                bytes_text(image.bytes)
            ),
        ];
        let errors = image.errors.iter().filter(|row| row.level().is_none());
        lines.extend(errors.map(|row| format!("{} {}", number(row.error), printable(&row.metric))));
        let Some(picture) = self.pictures.get(index) else {
            return lines.iter().enumerate().try_for_each(|(index, line)| {
                writeln!(out, "{}{line}", if index == 0 { "  " } else { "    " })
            });
        };
        let blocks = picture.half_blocks();
        let blank = " ".repeat(picture.width as usize);
        for row in 0..blocks.len().max(lines.len()) {
            let block = blocks.get(row).unwrap_or(&blank);
            let line = lines.get(row).map_or("", String::as_str);
            writeln!(out, "  {block}  {line}")?;
        }
        Ok(())
    }

    fn environment(&self, out: &mut String) -> Result {
        let Some(environment) = &self.contents.environment else {
            return Ok(());
        };
        writeln!(out, "environment")?;
        for (key, value) in environment
            .iter()
            .filter(|(key, _)| *key != "irradiance_sh")
        {
            match value {
                Value::Object(fields) => writeln!(out, "  {key:<18}{}", values(fields))?,
                value => writeln!(out, "  {key:<18}{}", plain(value))?,
            }
        }
        Ok(())
    }

    fn provenance(&self, out: &mut String) -> Result {
        writeln!(out, "provenance")?;
        for [name, value] in &self.contents.settings {
            writeln!(out, "  --{} {}", printable(name), printable(value))?;
        }
        self.list(out, "sources", &self.contents.sources, |out, _, row| {
            writeln!(
                out,
                "  {:<NAME$}{:>12}  blake3 {}",
                printable(&row.path),
                bytes_text(row.bytes),
                &row.hash[..16]
            )
        })
    }
}

/// A material: what differs from glTF's default, and its textures.
fn material(out: &mut String, material: &MaterialRow) -> Result {
    writeln!(out, "  {}", name(&material.name))?;
    let mut defaults = record_values(Material::FIELDS, bytemuck::bytes_of(&Material::default()));
    let extension = MaterialExtension::default();
    defaults.extend(record_values(
        MaterialExtension::FIELDS,
        bytemuck::bytes_of(&extension),
    ));
    let mut special = material.values.clone();
    special.retain(|field, value| defaults.get(field) != Some(value));
    if !special.is_empty() {
        writeln!(out, "    {}", values(&special))?;
    }
    for texture in &material.textures {
        writeln!(
            out,
            "    {:<24}{}{}{}",
            texture.slot,
            name(&texture.image),
            if texture.uv == 1 {
                ", second coordinates"
            } else {
                ""
            },
            if texture.transform.is_some() {
                ", transformed"
            } else {
                ""
            }
        )?;
    }
    Ok(())
}

fn error(out: &mut String, row: &ErrorRow) -> Result {
    writeln!(
        out,
        "  {:<14}{:<NAME$}{:<26}{:>10}  {}",
        printable(&row.stage),
        printable(&row.item),
        printable(&row.setting),
        number(row.error),
        printable(&row.metric)
    )
}

/// A name, or what stands for none.
fn name(name: &str) -> String {
    if name.is_empty() {
        "(no name)".into()
    } else {
        printable(name)
    }
}

fn values(fields: &Map<String, Value>) -> String {
    let fields: Vec<String> = fields
        .iter()
        .map(|(key, value)| format!("{key} {}", plain(value)))
        .collect();
    fields.join(", ")
}

fn plain(value: &Value) -> String {
    match value {
        Value::String(text) => printable(text),
        Value::Null => "none".into(),
        Value::Array(items) => {
            let items: Vec<String> = items.iter().map(plain).collect();
            format!("({})", items.join(" "))
        }
        other => other.to_string(),
    }
}
