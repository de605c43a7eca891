//! The rows of a texture in the speed-against-error report.

use crate::encode::toksvig::{LevelWidening, WideningReport};
use crate::encode::{EncodedTexture, TextureReport};
use crate::report::Row;

/// The rows of one image in the speed-against-error report.
pub(super) fn of(name: &str, texture: &EncodedTexture, bytes: u64) -> Vec<Row> {
    let report: &TextureReport = &texture.report;
    let setting = format!("{:?} {}", texture.format, report.codec.setting());
    let row = |metric: String, error| Row {
        stage: "texture".into(),
        item: name.to_owned(),
        setting: setting.trim_end().into(),
        seconds: report.seconds,
        throughput: Some(report.megapixels_per_second),
        throughput_unit: "Mpix/s",
        metric,
        error,
        bytes,
    };
    // A lossless image has no finite PSNR; 999 stands for it, since JSON has no infinity.
    let finite = |psnr: f64| if psnr.is_finite() { psnr } else { 999.0 };
    let mut rows = vec![
        row("psnr dB".into(), finite(report.psnr_db)),
        row("p99 block rmse /255".into(), report.p99_block_rmse),
    ];
    if let Some(psnr) = report.psnr_linear_light_db {
        rows.push(row("psnr dB, linear light".into(), finite(psnr)));
    }
    if let Some(angle) = &report.normal_angle_deg {
        rows.push(row("normal p50 degrees".into(), angle.p50));
        rows.push(row("normal p99 degrees".into(), angle.p99));
        rows.push(row("normal max degrees".into(), angle.max));
    }
    if let Some(lacks) = report.missed_db {
        rows.push(row("psnr dB less the target".into(), -lacks));
    }
    let mut altered = report.altered_levels.clone();
    altered.sort_unstable();
    for levels in altered.chunk_by(|one, other| one == other) {
        let metric = format!("levels encoded again: {}", levels[0].reason());
        rows.push(row(metric, levels.len() as f64));
    }
    let levels = report.alpha_coverage_delta.len();
    for (level, delta) in report.alpha_coverage_delta.iter().enumerate() {
        // The last level has one texel, which covers all or nothing.
        let bound = if level + 1 == levels {
            ", one texel"
        } else {
            ""
        };
        rows.push(row(
            format!("alpha coverage delta, mip {level}{bound}"),
            *delta,
        ));
    }
    let coverage = report
        .alpha_coverage_delta
        .iter()
        .take(levels.saturating_sub(1));
    if let Some(worst) = coverage.map(|delta| delta.abs()).max_by(f64::total_cmp) {
        rows.push(row("alpha coverage delta, worst mip".into(), worst));
    }
    let widening = report.widening.as_ref();
    rows.extend(
        widening
            .into_iter()
            .flat_map(|one| widened(name, one, bytes)),
    );
    rows
}

/// What lost normal length did to roughness.
fn widened(name: &str, report: &WideningReport, bytes: u64) -> Vec<Row> {
    let row = |metric: String, error| Row {
        stage: "toksvig".into(),
        item: name.to_owned(),
        setting: "lost normal length as roughness".into(),
        seconds: report.seconds,
        throughput: Some(report.megapixels_per_second),
        throughput_unit: "Mpix/s",
        metric,
        error,
        bytes,
    };
    let mut rows = Vec::new();
    for (mip, level) in (0..).zip(&report.levels).skip(1) {
        rows.push(row(format!("roughness rise, mip {mip}"), level.mean_rise));
        rows.push(row(format!("lobe error, mip {mip}"), level.error_after));
        rows.push(row(
            format!("lobe error if not widened, mip {mip}"),
            level.error_before,
        ));
    }
    let most = |of: fn(&LevelWidening) -> f64| report.levels.iter().map(of).fold(0.0, f64::max);
    rows.push(row(
        "roughness rise, most".into(),
        most(|level| level.max_rise),
    ));
    rows.push(row(
        "lobe error, worst mip".into(),
        most(|level| level.error_after),
    ));
    rows.push(row(
        "lobe error if not widened, worst mip".into(),
        most(|level| level.error_before),
    ));
    rows
}
