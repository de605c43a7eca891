//! The error of every lossy step, by stage and metric: where all objects are, and which are the worst.

use std::fmt::Write;

use super::{bar, escape};
use crate::look::contents::{Contents, ErrorRow};
use crate::look::number;

/// Worst objects that are named.
const NAMED: usize = 8;
/// Width of a plot, and its margin.
const WIDTH: f64 = 640.0;
const MARGIN: f64 = 10.0;

pub(super) fn write(out: &mut String, contents: &Contents) {
    out.push_str("<h2>Errors</h2>\n");
    let mut stages: Vec<&str> = Vec::new();
    for row in &contents.report {
        if !stages.contains(&row.stage.as_str()) {
            stages.push(&row.stage);
        }
    }
    for stage in stages {
        let _ = writeln!(
            out,
            "<details open><summary><strong>{}</strong></summary>",
            escape(stage)
        );
        let rows: Vec<ErrorRow> = contents
            .report
            .iter()
            .filter(|row| row.stage == stage)
            .map(by_object)
            .collect();
        let mut metrics: Vec<&str> = Vec::new();
        for row in &rows {
            if !metrics.contains(&row.metric.as_str()) {
                metrics.push(&row.metric);
            }
        }
        let of = |metric: &str| -> Vec<&ErrorRow> {
            rows.iter().filter(|row| row.metric == metric).collect()
        };
        let (single, many): (Vec<&str>, Vec<&str>) = metrics
            .into_iter()
            .partition(|metric| of(metric).len() == 1);
        let single: Vec<&ErrorRow> = single.into_iter().flat_map(of).collect();
        table(out, &single);
        for metric in many {
            plot(out, metric, &of(metric));
        }
        out.push_str("</details>\n");
    }
    if contents.report.is_empty() {
        out.push_str("<p>No step of this bake loses anything.</p>\n");
    }
}

/// Metrics of one object.
fn table(out: &mut String, rows: &[&ErrorRow]) {
    if rows.is_empty() {
        return;
    }
    out.push_str("<div class=\"wide\"><table>\n");
    for row in rows {
        let exact = better_when_higher(&row.metric) && row.error >= 999.0;
        let _ = writeln!(
            out,
            "<tr><td>{}<td>{}<td class=\"n\">{}",
            escape(&row.item),
            escape(&row.metric),
            if exact {
                "exact".into()
            } else {
                number(row.error)
            }
        );
    }
    out.push_str("</table></div>\n");
}

/// A row with the level that its metric names as a part of its object, so that all levels are in one plot.
fn by_object(row: &ErrorRow) -> ErrorRow {
    let mut row = row.clone();
    if let Some((metric, level)) = row.level() {
        let (metric, item) = (
            format!("{metric}, each mip"),
            format!("{} mip {level}", row.item),
        );
        (row.metric, row.item) = (metric, item);
    }
    row
}

/// Decibels fall as errors grow; 999 stands for no error at all.
fn better_when_higher(metric: &str) -> bool {
    metric.contains("psnr")
}

fn plot(out: &mut String, metric: &str, rows: &[&ErrorRow]) {
    let higher = better_when_higher(metric);
    let note = if higher {
        " <span class=\"soft\">more is better</span>"
    } else {
        ""
    };
    let _ = writeln!(out, "<h3>{}{note}</h3>", escape(metric));
    let lossless = rows
        .iter()
        .filter(|row| higher && row.error >= 999.0)
        .count();
    let mut rows: Vec<&ErrorRow> = rows
        .iter()
        .copied()
        .filter(|row| !higher || row.error < 999.0)
        .collect();
    if lossless > 0 {
        let _ = writeln!(out, "<p class=\"soft\">{lossless} without any error.</p>");
    }
    rows.sort_by(|a, b| {
        if higher {
            a.error.total_cmp(&b.error)
        } else {
            b.error.abs().total_cmp(&a.error.abs())
        }
    });
    if rows.len() > 2 {
        strip(out, &rows);
    }
    let largest = rows.iter().map(|row| row.error.abs()).fold(0.0, f64::max);
    for row in rows.iter().take(NAMED) {
        bar(
            out,
            &row.item,
            row.error.abs() / largest,
            &number(row.error),
        );
    }
    if rows.len() > NAMED {
        let _ = writeln!(
            out,
            "<p class=\"soft\">The worst {NAMED} of {}.</p>",
            rows.len()
        );
    }
}

/// A dot for every object along an axis from the least to the greatest error.
fn strip(out: &mut String, rows: &[&ErrorRow]) {
    let errors = rows.iter().map(|row| row.error);
    let (low, high) = errors.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), error| {
        (low.min(error), high.max(error))
    });
    if low >= high {
        return;
    }
    let place = |error: f64| MARGIN + (WIDTH - 2.0 * MARGIN) * (error - low) / (high - low);
    let _ = write!(
        out,
        "<svg viewBox=\"0 0 {WIDTH} 32\" role=\"img\" aria-label=\"{} values from {low} to {high}\">\
         <line x1=\"{MARGIN}\" x2=\"{}\" y1=\"16\" y2=\"16\" stroke=\"currentColor\" stroke-opacity=\".35\"/>",
        rows.len(),
        WIDTH - MARGIN
    );
    for row in rows {
        let _ = write!(
            out,
            "<circle cx=\"{:.1}\" cy=\"16\" r=\"5\" fill=\"currentColor\" fill-opacity=\".45\"><title>{}: {}</title></circle>",
            place(row.error),
            escape(&row.item),
            number(row.error)
        );
    }
    let _ = writeln!(
        out,
        "</svg><div class=\"ends\"><span>{}</span><span>{}</span></div>",
        number(low),
        number(high)
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_worst_comes_first() {
        let row = |item: &str, error| ErrorRow {
            stage: "texture".into(),
            item: item.into(),
            setting: String::new(),
            metric: "psnr dB".into(),
            error,
            bytes: 0,
        };
        let rows = [
            row("good", 50.0),
            row("bad", 30.0),
            row("exact", 999.0),
            row("fair", 40.0),
        ];
        let mut out = String::new();
        plot(&mut out, "psnr dB", &rows.iter().collect::<Vec<_>>());
        assert!(out.contains("1 without any error"), "{out}");
        assert!(out.find(">bad<") < out.find(">fair<"), "{out}");
        assert_eq!(out.matches("<circle").count(), 3);
        assert!(!out.contains("NaN"), "{out}");
    }
}
