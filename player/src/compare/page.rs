//! The comparison as one HTML file without anything beside it.

use std::fmt::Write;

use base64::Engine;

use super::{CompareReport, Row};
use crate::PlayerError;
use crate::metrics::Picture;
use crate::{exr, png};

const STYLE: &str = "
:root{color-scheme:light dark;--line:#8884}
body{font:16px/1.5 system-ui,sans-serif;margin:0 auto;max-width:1400px;padding:1rem}
table{border-collapse:collapse;display:block;overflow-x:auto}
th,td{padding:.3rem .7rem;border-bottom:1px solid var(--line);text-align:right;white-space:nowrap}
th:first-child,td:first-child{text-align:left}
.row{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,320px),1fr));gap:.75rem}
figure{margin:0}img{width:100%;display:block;image-rendering:auto}
figcaption,footer{font-size:.85rem;opacity:.75}
.note{border-left:4px solid #e69f00;padding:.2rem .8rem}
";

/// The page.
///
/// # Errors
/// [`PlayerError::Input`] where a picture cannot be encoded.
pub fn html(report: &CompareReport, title: &str) -> Result<String, PlayerError> {
    let mut page = format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\">\
         <meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\
         <title>{0}</title><style>{STYLE}</style><h1>{0}</h1>\n<p>Raster on {1} against {2}, {3} by {4} pixels.</p>\n",
        escape(title),
        escape(&report.origin.device),
        escape(&report.reference),
        report.origin.size[0],
        report.origin.size[1]
    );
    if let Some(note) = report.note {
        let _ = writeln!(page, "<p class=\"note\">{}</p>", escape(note));
    }
    table(&mut page, report);
    for row in &report.rows {
        pictures(&mut page, row)?;
    }
    let _ = writeln!(
        page,
        "<footer>{} {}, driver {}, scene {}. RMSE, relative error and bias of linear radiance; FLIP (Andersson et al. 2020, \
         67 pixels per degree) of display values.</footer></html>",
        escape(report.origin.tool),
        escape(report.origin.commit),
        escape(&report.origin.driver),
        &report.origin.scene
    );
    Ok(page)
}

/// Pictures of every row as PNG, and radiance as OpenEXR: names and bytes.
///
/// # Errors
/// [`PlayerError::Input`] where a picture cannot be encoded.
pub fn files(report: &CompareReport) -> Result<Vec<(String, Vec<u8>)>, PlayerError> {
    let mut files = Vec::new();
    for row in &report.rows {
        let feature: String = row
            .feature
            .chars()
            .map(|c| if c.is_alphanumeric() { c } else { '-' })
            .collect();
        let pictures = &row.pictures;
        for (name, picture) in [
            ("raster", &pictures.raster),
            ("reference", &pictures.reference),
            ("difference", &pictures.difference),
            ("flip", &pictures.flip),
        ] {
            files.push((format!("{feature}-{name}.png"), png_bytes(picture)?));
        }
        for (name, picture) in [
            ("raster", &pictures.raster_radiance),
            ("reference", &pictures.reference_radiance),
        ] {
            files.push((format!("{feature}-{name}.exr"), exr::encode(picture)));
        }
    }
    Ok(files)
}

fn table(page: &mut String, report: &CompareReport) {
    page.push_str(
        "<table><tr><th>feature<th>GPU ms<th>RMSE<th>relative<th>bias<th>mean FLIP<th>reference s</tr>\n",
    );
    for row in &report.rows {
        let gpu = row
            .gpu_ms
            .map_or("not measured".into(), |ms| format!("{ms:.3}"));
        let error = &row.error;
        let _ = writeln!(
            page,
            "<tr><td>{}<td>{gpu}<td>{:.5}<td>{:.4}<td>{:+.4}<td>{:.4}<td>{:.2}</tr>",
            row.feature, error.rmse, error.relative, error.bias, row.flip, row.reference_s
        );
    }
    page.push_str("</table>\n");
}

fn pictures(page: &mut String, row: &Row) -> Result<(), PlayerError> {
    let _ = writeln!(page, "<h2>{}</h2><div class=\"row\">", row.feature);
    let pictures = &row.pictures;
    for (name, picture) in [
        ("raster", &pictures.raster),
        ("reference", &pictures.reference),
        ("difference, twice, around grey", &pictures.difference),
        ("FLIP, dark is equal", &pictures.flip),
    ] {
        let _ = writeln!(
            page,
            "<figure><img alt=\"{0}: {name}\" src=\"data:image/png;base64,{1}\"><figcaption>{name}</figcaption></figure>",
            row.feature,
            encoded(picture)?
        );
    }
    page.push_str("</div>\n");
    Ok(())
}

fn encoded(picture: &Picture) -> Result<String, PlayerError> {
    Ok(base64::engine::general_purpose::STANDARD.encode(png_bytes(picture)?))
}

fn png_bytes(picture: &Picture) -> Result<Vec<u8>, PlayerError> {
    let bytes = png::encode(
        picture.width as u32,
        picture.height as u32,
        &picture.to_srgb8(),
    );
    bytes.map_err(|error| PlayerError::Input(format!("a picture: {error}")))
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('"', "&quot;")
}
