//! Where the bytes are.

use std::fmt::Write;

use cairn_format::{Package, Result, SectionKind};

use super::escape;
use super::treemap::{Rectangle, lay_out};
use crate::look::bytes_text;
use crate::look::contents::Contents;

/// Colours of the sections' groups, dark enough for white text: geometry, texels, environment, everything else.
const COLORS: [&str; 4] = ["#3a6b4f", "#2f5f86", "#7a5a2c", "#6a4a74"];
/// Objects of one section that get a box of their own; the others share one.
const BOXES: usize = 60;

/// One box.
struct Cell {
    name: String,
    bytes: u64,
    color: &'static str,
}

pub(super) fn write(out: &mut String, package: &Package, contents: &Contents) -> Result<()> {
    let mut cells = Vec::new();
    for row in &contents.sections {
        match row.name {
            "texels" => cells.extend(largest(
                contents.images.iter().map(|image| Cell {
                    color: COLORS[if image.role == "environment" { 2 } else { 1 }],
                    name: image.name.clone(),
                    bytes: image.bytes,
                }),
                "other images",
            )),
            "vertices" | "indices" => {
                let vertices = row.name == "vertices";
                let meshes = contents.meshes.iter().map(|mesh| Cell {
                    name: format!("{} {}", mesh.name, row.name),
                    bytes: if vertices {
                        56 * mesh.vertices
                    } else {
                        12 * mesh.triangles
                    },
                    color: COLORS[0],
                });
                cells.extend(largest(
                    meshes,
                    if vertices {
                        "other vertices"
                    } else {
                        "other indices"
                    },
                ));
            }
            name => cells.push(Cell {
                name: name.to_owned(),
                bytes: row.bytes,
                color: COLORS[if name.starts_with("env") { 2 } else { 3 }],
            }),
        }
    }
    let inside: u64 = contents.sections.iter().map(|row| row.bytes).sum();
    cells.push(Cell {
        name: "head and padding".into(),
        bytes: package.header().file_length.saturating_sub(inside),
        color: COLORS[3],
    });
    cells.sort_by(|a, b| b.bytes.cmp(&a.bytes).then_with(|| a.name.cmp(&b.name)));
    out.push_str("<h2>Sizes</h2>\n<div class=\"map\" role=\"img\" aria-label=\"treemap of the file's bytes\">\n");
    let sizes: Vec<f64> = cells.iter().map(|cell| cell.bytes as f64).collect();
    for (cell, area) in cells.iter().zip(lay_out(&sizes, [0.0, 0.0, 16.0, 9.0])) {
        draw(out, cell, area);
    }
    out.push_str("</div>\n");
    table(out, package, contents);
    Ok(())
}

/// The largest of many cells, and one for all others.
fn largest(cells: impl Iterator<Item = Cell>, others: &str) -> Vec<Cell> {
    let mut cells: Vec<Cell> = cells.collect();
    cells.sort_by_key(|cell| std::cmp::Reverse(cell.bytes));
    if cells.len() > BOXES {
        let color = cells[BOXES].color;
        let bytes = cells.drain(BOXES..).map(|cell| cell.bytes).sum();
        cells.push(Cell {
            name: others.to_owned(),
            bytes,
            color,
        });
    }
    cells
}

fn draw(out: &mut String, cell: &Cell, [left, top, width, height]: Rectangle) {
    let (name, size) = (escape(&cell.name), bytes_text(cell.bytes));
    // Labels where they fit: a box of 1 x 0.5 sixteenths has room for a word.
    let label = if width > 1.1 && height > 0.5 {
        format!("{name}<br>{size}")
    } else {
        String::new()
    };
    let _ = writeln!(
        out,
        "<div title=\"{name}: {size}\" style=\"left:{:.3}%;top:{:.3}%;width:{:.3}%;height:{:.3}%;background:{}{}\">{label}</div>",
        left / 0.16,
        top / 0.09,
        width / 0.16,
        height / 0.09,
        cell.color,
        // Padding would widen boxes that are thinner than it.
        if label.is_empty() {
            ";padding:0;border-width:.5px"
        } else {
            ""
        }
    );
}

fn table(out: &mut String, package: &Package, contents: &Contents) {
    out.push_str("<details><summary>Sections</summary><div class=\"wide\"><table><tr><th>section<th class=\"n\">bytes<th class=\"n\">records<th class=\"n\">stride<th>BLAKE3</tr>\n");
    for row in &contents.sections {
        let _ = writeln!(
            out,
            "<tr><td>{}<td class=\"n\">{}<td class=\"n\">{}<td class=\"n\">{}<td class=\"hash\">{}",
            row.name,
            bytes_text(row.bytes),
            row.records,
            row.stride,
            row.hash
        );
    }
    let _ = writeln!(
        out,
        "</table></div></details>\n<p class=\"soft\">{} kinds of section are not in this package: it does not need them.</p>",
        SectionKind::ALL.len() - package.table().len()
    );
}
