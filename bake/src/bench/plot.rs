//! Speed against error as an SVG: the presets of one encoder joined.

use std::fmt::Write;

use super::textures::Mean;

const WIDTH: f64 = 900.0;
const HEIGHT: f64 = 560.0;
const MARGIN: f64 = 60.0;
/// Okabe and Ito's colours, which differ for every kind of sight.
const COLORS: [&str; 4] = ["#d55e00", "#0072b2", "#009e73", "#7f7f7f"];

/// Draws mean PSNR over Mpix/s of one thread, which runs in powers of ten.
pub fn svg(means: &[Mean]) -> String {
    let speeds = || means.iter().map(|mean| mean.megapixels_per_second.log10());
    let (left, right) = (
        speeds().fold(f64::MAX, f64::min).floor(),
        speeds().fold(f64::MIN, f64::max).ceil(),
    );
    let bounds = means.iter().map(|mean| mean.psnr_db);
    let (low, high) = bounds.fold((f64::MAX, f64::MIN), |(low, high), db| {
        (low.min(db), high.max(db))
    });
    let (low, high) = ((low - 0.5).floor(), (high + 0.5).ceil());
    let x = |speed: f64| {
        MARGIN + (speed.log10() - left) / (right - left).max(1.0) * (WIDTH - 2.0 * MARGIN)
    };
    let y = |db: f64| HEIGHT - MARGIN - (db - low) / (high - low) * (HEIGHT - 2.0 * MARGIN);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" font-family=\"sans-serif\" \
         font-size=\"12\">\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n"
    );
    for power in left as i32..=right as i32 {
        for digit in [1.0, 2.0, 5.0] {
            let speed = digit * 10.0_f64.powi(power);
            if speed.log10() <= right + 1e-9 {
                let at = x(speed);
                let _ = writeln!(
                    svg,
                    "<path d=\"M{at:.1} {:.1}V{MARGIN}\" stroke=\"#ddd\"/><text x=\"{at:.1}\" y=\"{:.1}\" \
                     text-anchor=\"middle\">{speed}</text>",
                    HEIGHT - MARGIN,
                    HEIGHT - MARGIN + 16.0
                );
            }
        }
    }
    let step = ((high - low) / 8.0).ceil().max(1.0);
    let mut db = low;
    while db <= high {
        let at = y(db);
        let _ = writeln!(
            svg,
            "<path d=\"M{MARGIN} {at:.1}H{:.1}\" stroke=\"#ddd\"/><text x=\"{:.1}\" y=\"{:.1}\" \
             text-anchor=\"end\">{db}</text>",
            WIDTH - MARGIN,
            MARGIN - 6.0,
            at + 4.0
        );
        db += step;
    }
    let _ = writeln!(
        svg,
        "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">Mpix/s of one thread</text>\
         <text x=\"{MARGIN}\" y=\"{:.1}\">mean PSNR, dB</text>",
        WIDTH / 2.0,
        HEIGHT - 16.0,
        MARGIN - 16.0
    );
    let mut encoders: Vec<&str> = means.iter().map(|mean| mean.encoder).collect();
    encoders.dedup();
    for (row, (encoder, color)) in encoders.into_iter().zip(COLORS.iter().cycle()).enumerate() {
        let _ = writeln!(
            svg,
            "<text x=\"{:.1}\" y=\"{:.1}\" fill=\"{color}\">{encoder}</text>",
            MARGIN + 10.0,
            HEIGHT - MARGIN - 12.0 - 16.0 * row as f64
        );
        line(&mut svg, encoder, color, means, [&x, &y]);
    }
    svg.push_str("</svg>\n");
    svg
}

fn line(
    svg: &mut String,
    encoder: &str,
    color: &str,
    means: &[Mean],
    [x, y]: [&dyn Fn(f64) -> f64; 2],
) {
    let presets: Vec<&Mean> = means
        .iter()
        .filter(|mean| mean.encoder == encoder)
        .collect();
    let place = |mean: &Mean| (x(mean.megapixels_per_second), y(mean.psnr_db));
    let points: Vec<String> = presets
        .iter()
        .map(|mean| {
            let (x, y) = place(mean);
            format!("{x:.1},{y:.1}")
        })
        .collect();
    let _ = writeln!(
        svg,
        "<polyline points=\"{}\" fill=\"none\" stroke=\"{color}\" stroke-opacity=\"0.5\"/>",
        points.join(" ")
    );
    for mean in presets {
        let (x, y) = place(mean);
        // Names at the right lie to the left of their points.
        let (beside, anchor) = match x > 0.9 * WIDTH {
            true => (x - 8.0, "end"),
            false => (x + 6.0, "start"),
        };
        let _ = writeln!(
            svg,
            "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4\" fill=\"{color}\"/><text x=\"{beside:.1}\" y=\"{:.1}\" \
             fill=\"{color}\" text-anchor=\"{anchor}\">{}</text>",
            y - 5.0,
            mean.preset
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_lie_where_their_figures_are() {
        let mean = |encoder, preset, megapixels_per_second, psnr_db| Mean {
            encoder,
            preset,
            megapixels_per_second,
            psnr_db,
            p99_block_rmse: 1.0,
        };
        let svg = svg(&[
            mean("a", "fast", 10.0, 40.0),
            mean("a", "best", 1.0, 44.0),
            mean("b", "one", 5.0, 42.0),
        ]);
        assert_eq!(svg.matches("<circle").count(), 3);
        assert_eq!(svg.matches("<polyline").count(), 2);
        // The slowest lies at the left margin, the fastest at the right one.
        assert!(
            svg.contains("cx=\"60.0\"") && svg.contains("cx=\"840.0\""),
            "{svg}"
        );
        assert!(svg.contains(">a</text>") && svg.contains(">best</text>"));
    }
}
