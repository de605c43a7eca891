//! The curves as an SVG: error over samples and over seconds, all axes logarithmic.

use std::fmt::Write;

use super::{ConvergeReport, Point};

const WIDTH: f64 = 1000.0;
const HEIGHT: f64 = 460.0;
const MARGIN: f64 = 56.0;
/// Okabe and Ito's colours, which differ for every kind of sight.
const COLORS: [&str; 3] = ["#d55e00", "#0072b2", "#009e73"];

/// A panel: where it lies, and the logarithms of its ends.
struct Panel {
    left: f64,
    right: f64,
    x: [f64; 2],
    y: [f64; 2],
}

impl Panel {
    fn place(&self, x: f64, y: f64) -> (f64, f64) {
        let share = |value: f64, [from, to]: [f64; 2]| (value.log10() - from) / (to - from);
        (
            self.left + share(x, self.x) * (self.right - self.left),
            HEIGHT - MARGIN - share(y, self.y) * (HEIGHT - 2.0 * MARGIN),
        )
    }
}

/// Draws RMSE of pixels (lines) and of means over 4x4 pixels (dashes).
pub fn svg(report: &ConvergeReport) -> String {
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" font-family=\"sans-serif\" \
         font-size=\"11\">\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n"
    );
    let points = || report.curves.iter().flat_map(|curve| &curve.points);
    let errors: Vec<f64> = points()
        .flat_map(|point| [point.rmse, point.rmse_4x4])
        .collect();
    let y = ends(&errors);
    let middle = WIDTH / 2.0;
    for (title, of, left) in [
        (
            "samples per pixel",
            (|point: &Point| f64::from(point.samples)) as fn(&Point) -> f64,
            MARGIN,
        ),
        (
            "seconds",
            |point: &Point| point.seconds,
            middle + MARGIN * 0.5,
        ),
    ] {
        let values: Vec<f64> = points().map(of).collect();
        let panel = Panel {
            left,
            right: left + middle - MARGIN * 1.5,
            x: ends(&values),
            y,
        };
        grid(&mut svg, &panel, title);
        for (curve, color) in report.curves.iter().zip(COLORS) {
            for (error, dashes) in [
                ((|point: &Point| point.rmse) as fn(&Point) -> f64, ""),
                (|point: &Point| point.rmse_4x4, " stroke-dasharray=\"4 3\""),
            ] {
                let places: Vec<String> = curve
                    .points
                    .iter()
                    .filter(|point| error(point) > 0.0 && of(point) > 0.0)
                    .map(|point| panel.place(of(point), error(point)))
                    .map(|(x, y)| format!("{x:.1},{y:.1}"))
                    .collect();
                let _ = writeln!(
                    svg,
                    "<polyline points=\"{}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"1.6\"{dashes}/>",
                    places.join(" ")
                );
            }
        }
    }
    legend(&mut svg, report);
    svg.push_str("</svg>\n");
    svg
}

/// Whole powers of ten around the positive values.
fn ends(values: &[f64]) -> [f64; 2] {
    let logs = || {
        values
            .iter()
            .filter(|value| **value > 0.0)
            .map(|value| value.log10())
    };
    let least = logs().fold(f64::INFINITY, f64::min);
    let most = logs().fold(f64::NEG_INFINITY, f64::max);
    if least > most {
        return [0.0, 1.0];
    }
    let least = least.floor();
    [least, most.ceil().max(least + 1.0)]
}

fn grid(svg: &mut String, panel: &Panel, title: &str) {
    let (top, bottom) = (MARGIN, HEIGHT - MARGIN);
    for power in panel.x[0] as i32..=panel.x[1] as i32 {
        let value = 10f64.powi(power);
        let x = panel.place(value, 1.0).0;
        let _ = writeln!(
            svg,
            "<path d=\"M{x:.1} {bottom:.1}V{top:.1}\" stroke=\"#ddd\"/>\
             <text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{value}</text>",
            bottom + 16.0
        );
    }
    for power in panel.y[0] as i32..=panel.y[1] as i32 {
        let value = 10f64.powi(power);
        let y = panel.place(1.0, value).1;
        let _ = writeln!(
            svg,
            "<path d=\"M{:.1} {y:.1}H{:.1}\" stroke=\"#ddd\"/>\
             <text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{value}</text>",
            panel.left,
            panel.right,
            panel.left - 5.0,
            y + 4.0
        );
    }
    let _ = writeln!(
        svg,
        "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{title}</text>",
        (panel.left + panel.right) / 2.0,
        HEIGHT - 14.0
    );
}

fn legend(svg: &mut String, report: &ConvergeReport) {
    let mut x = MARGIN;
    for (curve, color) in report.curves.iter().zip(COLORS) {
        let slope = curve
            .slope
            .map_or(String::new(), |slope| format!(", N^{slope:.2}"));
        let _ = writeln!(
            svg,
            "<path d=\"M{x:.1} 22h20\" stroke=\"{color}\" stroke-width=\"2\"/>\
             <text x=\"{:.1}\" y=\"26\">{}{slope}</text>",
            x + 25.0,
            curve.sampler
        );
        x += 190.0;
    }
    let _ = writeln!(
        svg,
        "<text x=\"{x:.1}\" y=\"26\">root mean square error of radiance: pixels (lines), means over 4x4 pixels (dashes)</text>"
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_hold_every_value() {
        assert_eq!(ends(&[0.02, 3.0, 0.0]), [-2.0, 1.0]);
        assert_eq!(ends(&[1.0]), [0.0, 1.0]);
        assert_eq!(ends(&[]), [0.0, 1.0]);
    }
}
