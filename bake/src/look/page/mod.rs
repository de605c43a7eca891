//! A package as one HTML page without anything beside it: no script, no network, pictures inside.

mod errors;
mod gallery;
mod sizes;
mod treemap;

use std::fmt::Write;

use base64::Engine;
use cairn_format::{Package, Result};

use super::contents::Contents;
use super::{bytes_text, printable};
use crate::report::Summary;

/// What a page shows beside the package.
#[derive(Debug)]
pub struct Extras {
    /// PNG of the scene, or why there is none; empty where it is not wanted.
    pub picture: std::result::Result<Vec<u8>, String>,
    /// The summary of its bake, which holds times and diagnostics.
    pub summary: Option<Summary>,
}

const STYLE: &str = "
:root{color-scheme:light dark;--back:#fbfaf8;--ink:#1d1d1b;--soft:#6b6a66;--line:#dddad3;--card:#fff;--bar:#2f6f8f;--bad:#b4432f}
@media(prefers-color-scheme:dark){:root{--back:#16181a;--ink:#e8e6e1;--soft:#9c9a94;--line:#34373a;--card:#1e2123;--bar:#6fb3d2;--bad:#f08a72}}
*{box-sizing:border-box}
body{font:16px/1.5 system-ui,sans-serif;margin:0 auto;max-width:1200px;padding:1rem;background:var(--back);color:var(--ink)}
h1{margin:.2rem 0}h2{margin:2.2rem 0 .6rem;border-bottom:1px solid var(--line)}h3{font-size:1rem;margin:1.2rem 0 .3rem}
p{max-width:46rem}.soft,figcaption{color:var(--soft);font-size:.85rem}
code,.hash{font:.85em ui-monospace,monospace;overflow-wrap:anywhere}
.wide{overflow-x:auto}table{border-collapse:collapse}
th,td{padding:.25rem .7rem .25rem 0;border-bottom:1px solid var(--line);text-align:left;vertical-align:top}
td.n,th.n{text-align:right;white-space:nowrap;font-variant-numeric:tabular-nums}
figure{margin:0}img{display:block;max-width:100%;height:auto}
.hero img{width:100%;border-radius:6px}
.map{position:relative;width:100%;aspect-ratio:16/9;min-height:240px}
.map div{position:absolute;overflow:hidden;border:1px solid var(--back);padding:.2rem .35rem;font-size:.75rem;line-height:1.25;color:#fff;border-radius:3px;overflow-wrap:anywhere}
@media(max-width:600px){.map{aspect-ratio:3/4}.map div{font-size:.65rem}}
.bar{display:grid;grid-template-columns:minmax(6rem,14rem) 1fr 6.5rem;gap:.6rem;align-items:center;margin:.15rem 0}
.bar span:first-child{overflow:hidden;text-overflow:ellipsis;white-space:nowrap}
.bar i{display:block;height:.8rem;background:var(--bar);border-radius:2px;min-width:1px}
.bar b{font-weight:400;text-align:right;font-variant-numeric:tabular-nums}
svg{width:100%;height:auto;max-width:46rem;display:block;color:var(--bar)}
.ends{display:flex;justify-content:space-between;max-width:46rem;margin-bottom:.4rem;color:var(--soft);font-size:.8rem}
.grid{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(100%,180px),1fr));gap:1rem}
.grid figure{background:var(--card);border:1px solid var(--line);border-radius:6px;overflow:hidden}
.grid img{width:100%;image-rendering:auto;background:repeating-conic-gradient(#8883 0 25%,#0000 0 50%) 0 0/16px 16px}
.grid figcaption{padding:.4rem .6rem;overflow-wrap:anywhere}.grid strong{color:var(--ink)}
.warning{border-left:4px solid var(--bad);padding:.2rem .8rem;margin:.4rem 0}
summary{cursor:pointer}
";

/// The page.
///
/// # Errors
/// Where the file changes meanwhile.
pub fn page(package: &Package, extras: &Extras) -> Result<String> {
    let contents = Contents::of(package)?;
    let title = if contents.name.is_empty() {
        "package"
    } else {
        &contents.name
    };
    let mut out = format!(
        "<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\">\
         <meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\
         <link rel=\"icon\" href=\"data:,\"><title>{0}</title><style>{STYLE}</style></head><body>\n<h1>{0}</h1>\n",
        escape(title)
    );
    head(&mut out, &contents, extras);
    sizes::write(&mut out, package, &contents)?;
    times(&mut out, extras);
    errors::write(&mut out, &contents);
    gallery::textures(&mut out, package, &contents)?;
    gallery::environment(&mut out, package, &contents)?;
    notes(&mut out, extras);
    provenance(&mut out, &contents);
    out.push_str("</body></html>\n");
    Ok(out)
}

fn head(out: &mut String, contents: &Contents, extras: &Extras) {
    match &extras.picture {
        Ok(png) if !png.is_empty() => {
            let _ = writeln!(
                out,
                "<figure class=\"hero\"><img alt=\"the scene, framed\" src=\"{}\"><figcaption>Drawn by cairn-player, \
                 camera <code>auto</code>.</figcaption></figure>",
                data_uri(png)
            );
        }
        Ok(_) => {}
        Err(reason) => {
            let _ = writeln!(
                out,
                "<p class=\"soft\">No picture of the scene: {}</p>",
                escape(reason)
            );
        }
    }
    let [min, max] = contents.bounds;
    let extent: Vec<String> = min
        .iter()
        .zip(max)
        .map(|(min, max)| format!("{:.3}", max - min))
        .collect();
    let features = contents.features.join(", ");
    let rows = [
        ("size", bytes_text(contents.bytes)),
        ("triangles", contents.triangles.to_string()),
        ("vertices", contents.vertices.to_string()),
        ("meshes", contents.meshes.len().to_string()),
        (
            "instances",
            format!(
                "{} in {} draw groups",
                contents.instances, contents.draw_groups
            ),
        ),
        ("materials", contents.materials.len().to_string()),
        ("images", contents.images.len().to_string()),
        (
            "lights, cameras",
            format!("{}, {}", contents.lights.len(), contents.cameras.len()),
        ),
        ("extent", format!("{} m", extent.join(" x "))),
        (
            "features",
            if features.is_empty() {
                "none".into()
            } else {
                features
            },
        ),
        (
            "format",
            format!("{}, by {}", contents.format_version, contents.tool),
        ),
        ("BLAKE3", contents.content_hash.clone()),
    ];
    out.push_str("<div class=\"wide\"><table>");
    for (name, value) in rows {
        let class = if name == "BLAKE3" {
            " class=\"hash\""
        } else {
            ""
        };
        let _ = write!(out, "<tr><th>{name}<td{class}>{}", escape(&value));
    }
    out.push_str("</table></div>\n");
}

fn times(out: &mut String, extras: &Extras) {
    out.push_str("<h2>Time</h2>\n");
    let Some(summary) = &extras.summary else {
        out.push_str(
            "<p class=\"soft\">A package holds no times: they would make the bytes of two bakes differ. Give \
             <code>--summary bake.json</code>, what the bake printed with <code>--json</code>.</p>\n",
        );
        return;
    };
    let longest = summary
        .stages
        .iter()
        .map(|stage| stage.seconds)
        .fold(0.0, f64::max);
    for stage in &summary.stages {
        bar(
            out,
            stage.name,
            stage.seconds / longest,
            &format!("{:.3} s", stage.seconds),
        );
    }
    let memory = summary.peak_memory_bytes.map_or_else(String::new, |bytes| {
        format!(", {} of memory at most", bytes_text(bytes))
    });
    let _ = writeln!(
        out,
        "<p class=\"soft\">{:.3} s in all{memory}.</p>",
        summary.seconds
    );
}

fn notes(out: &mut String, extras: &Extras) {
    out.push_str("<h2>Conformance notes</h2>\n");
    let Some(summary) = &extras.summary else {
        out.push_str("<p class=\"soft\">Diagnostics are in the summary of the bake: <code>--summary bake.json</code>.</p>\n");
        return;
    };
    if summary.diagnostics.is_empty() {
        out.push_str("<p>The bake had nothing to remark.</p>\n");
    }
    for diagnostic in &summary.diagnostics {
        let _ = writeln!(
            out,
            "<p class=\"warning\">{}</p>",
            escape(&diagnostic.to_string())
        );
    }
}

fn provenance(out: &mut String, contents: &Contents) {
    out.push_str("<h2>Provenance</h2>\n<p>");
    for [name, value] in &contents.settings {
        let _ = write!(out, "<code>--{} {}</code> ", escape(name), escape(value));
    }
    out.push_str(
        "</p>\n<div class=\"wide\"><table><tr><th>source<th class=\"n\">size<th>BLAKE3</tr>\n",
    );
    for source in &contents.sources {
        let _ = writeln!(
            out,
            "<tr><td>{}<td class=\"n\">{}<td class=\"hash\">{}",
            escape(&source.path),
            bytes_text(source.bytes),
            source.hash
        );
    }
    out.push_str("</table></div>\n");
}

/// A row of a bar chart; `share` is that of the longest bar.
fn bar(out: &mut String, name: &str, share: f64, value: &str) {
    let width = if share.is_finite() {
        100.0 * share.clamp(0.0, 1.0)
    } else {
        0.0
    };
    let name = escape(name);
    let _ = writeln!(
        out,
        "<div class=\"bar\"><span title=\"{name}\">{name}</span><span><i style=\"width:{width:.2}%\"></i></span><b>{}</b></div>",
        escape(value)
    );
}

/// A PNG as the address of itself.
fn data_uri(png: &[u8]) -> String {
    let encoded = base64::engine::general_purpose::STANDARD.encode(png);
    format!("data:image/png;base64,{encoded}")
}

/// Text of a page, names out of files included.
fn escape(text: &str) -> String {
    printable(text)
        .replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}
