//! The sweep as an SVG: error against time, the levels of one setting joined.

use std::fmt::Write;

use super::{Level, SweepReport};

const WIDTH: f64 = 900.0;
const HEIGHT: f64 = 560.0;
const MARGIN: f64 = 60.0;
/// Okabe and Ito's colours, which differ for every kind of sight.
const COLORS: [&str; 7] = [
    "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7f7f7f",
];

/// Draws mean FLIP over GPU milliseconds (CPU ones without timestamps).
pub fn svg(report: &SweepReport) -> String {
    let time = |level: &Level| level.gpu_ms.unwrap_or(level.record_ms);
    let most = |values: &mut dyn Iterator<Item = f64>| values.fold(1e-6, f64::max) * 1.08;
    let (right, top) = (
        most(&mut report.levels.iter().map(time)),
        most(&mut report.levels.iter().map(|level| level.flip)),
    );
    let x = |ms: f64| MARGIN + ms / right * (WIDTH - 2.0 * MARGIN);
    let y = |flip: f64| HEIGHT - MARGIN - flip / top * (HEIGHT - 2.0 * MARGIN);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" font-family=\"sans-serif\" \
         font-size=\"11\">\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n"
    );
    axes(&mut svg, right, top, &x, &y);
    let mut settings: Vec<&str> = report
        .levels
        .iter()
        .map(|level| level.setting.as_str())
        .collect();
    settings.dedup();
    for (index, setting) in settings.iter().enumerate() {
        let color = COLORS[index % COLORS.len()];
        let levels: Vec<&Level> = report
            .levels
            .iter()
            .filter(|level| level.setting == *setting)
            .collect();
        let points: Vec<String> = levels
            .iter()
            .map(|level| format!("{:.1},{:.1}", x(time(level)), y(level.flip)))
            .collect();
        let _ = writeln!(
            svg,
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{color}\" stroke-opacity=\"0.5\"/>",
            points.join(" ")
        );
        for level in levels {
            let (cx, cy) = (x(time(level)), y(level.flip));
            let _ = writeln!(
                svg,
                "<circle cx=\"{cx:.1}\" cy=\"{cy:.1}\" r=\"3.5\" fill=\"{color}\"><title>{} {}</title></circle>\
                 <text x=\"{:.1}\" y=\"{:.1}\" fill=\"{color}\">{} {}</text>",
                level.setting,
                level.value,
                cx + 5.0,
                cy - 4.0,
                level.setting,
                level.value
            );
        }
    }
    svg.push_str("</svg>\n");
    svg
}

fn axes(svg: &mut String, right: f64, top: f64, x: &dyn Fn(f64) -> f64, y: &dyn Fn(f64) -> f64) {
    for step in 0..=5 {
        let part = f64::from(step) / 5.0;
        let (ms, flip) = (right * part, top * part);
        let _ = writeln!(
            svg,
            "<path d=\"M{:.1} {:.1}V{MARGIN}M{MARGIN} {:.1}H{:.1}\" stroke=\"#ddd\"/>\
             <text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{ms:.3}</text>\
             <text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{flip:.4}</text>",
            x(ms),
            HEIGHT - MARGIN,
            y(flip),
            WIDTH - MARGIN,
            x(ms),
            HEIGHT - MARGIN + 16.0,
            MARGIN - 6.0,
            y(flip) + 4.0
        );
    }
    let _ = writeln!(
        svg,
        "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">milliseconds per frame</text>\
         <text x=\"16\" y=\"{:.1}\" transform=\"rotate(-90 16 {:.1})\" text-anchor=\"middle\">mean FLIP</text>",
        WIDTH / 2.0,
        HEIGHT - 16.0,
        HEIGHT / 2.0,
        HEIGHT / 2.0
    );
}
