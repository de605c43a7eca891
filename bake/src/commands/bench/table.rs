//! Rows of `bench ibl` as Markdown and JSON, and what follows from them.

use std::fmt::Write;

use serde::Serialize;

use crate::bench::clock::Spent;

/// One tool's work on one sky.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    pub tool: String,
    pub setting: String,
    #[serde(flatten)]
    pub spent: Spent,
    /// The times are those of a few texels, times the number of texels.
    pub scaled: bool,
    /// Filtered levels: without the mirror.
    pub levels: Vec<Level>,
}

#[derive(Clone, Copy, Debug, Serialize)]
pub struct Level {
    pub size: u32,
    /// Perceptual.
    pub roughness: f64,
    /// Relative RMS.
    pub error: f64,
}

impl Row {
    /// Of all levels.
    pub fn worst(&self) -> f64 {
        self.levels
            .iter()
            .map(|level| level.error)
            .fold(0.0, f64::max)
    }

    pub fn ours(&self) -> bool {
        self.tool == "cairn"
    }
}

/// All work on one sky.
#[derive(Clone, Debug, Serialize)]
pub struct Sky {
    pub name: String,
    pub width: u32,
    pub height: u32,
    pub rows: Vec<Row>,
}

/// Ours beside one row of another tool.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Verdict {
    pub sky: String,
    pub tool: String,
    pub setting: String,
    /// Times quicker than it, at an error that is no greater; `None` where none of ours is as close.
    pub quicker: Option<f64>,
    /// Times closer than it, in a time that is no longer; `None` where none of ours is as quick.
    pub closer: Option<f64>,
}

/// Ours beside every other tool.
pub fn verdicts(skies: &[Sky]) -> Vec<Verdict> {
    let mut verdicts = Vec::new();
    for sky in skies {
        let others = sky
            .rows
            .iter()
            .filter(|row| !row.ours() && row.worst() > 0.0);
        for other in others {
            let ours = || sky.rows.iter().filter(|row| row.ours());
            let close = ours().filter(|row| row.worst() <= other.worst());
            let quick = ours().filter(|row| row.spent.cpu_seconds <= other.spent.cpu_seconds);
            let seconds = close
                .map(|row| row.spent.cpu_seconds)
                .min_by(f64::total_cmp);
            let error = quick.map(Row::worst).min_by(f64::total_cmp);
            verdicts.push(Verdict {
                sky: sky.name.clone(),
                tool: other.tool.clone(),
                setting: other.setting.clone(),
                quicker: seconds.map(|seconds| other.spent.cpu_seconds / seconds),
                closer: error.map(|error| other.worst() / error),
            });
        }
    }
    verdicts
}

/// Everything as one JSON object.
pub fn json(skies: &[Sky], brdf_table: Spent) -> String {
    let all = serde_json::json!({
        "skies": skies,
        "verdicts": verdicts(skies),
        "brdf_table_256": brdf_table,
    });
    all.to_string()
}

/// Markdown.
pub fn text(skies: &[Sky], brdf_table: Spent) -> String {
    let mut out = String::new();
    // Writing to a string does not fail.
    let _ = write(&mut out, skies, brdf_table);
    out
}

fn write(out: &mut String, skies: &[Sky], brdf_table: Spent) -> std::fmt::Result {
    writeln!(
        out,
        "| sky | tool | setting | CPU s | wall s | worst level | error by level (roughness: relative RMS) |"
    )?;
    writeln!(out, "|---|---|---|--:|--:|--:|---|")?;
    for sky in skies {
        for row in &sky.rows {
            let levels = row.levels.iter();
            let levels: Vec<String> = levels
                .map(|level| format!("{:.2}: {:.1e}", level.roughness, level.error))
                .collect();
            let (worst, levels) = if row.scaled {
                (
                    "0".into(),
                    "the truth; time scaled from a few texels".into(),
                )
            } else {
                (format!("{:.1e}", row.worst()), levels.join(", "))
            };
            writeln!(
                out,
                "| {} {}x{} | {} | {} | {:.2} | {:.2} | {worst} | {levels} |",
                sky.name,
                sky.width,
                sky.height,
                row.tool,
                row.setting,
                row.spent.cpu_seconds,
                row.spent.wall_seconds,
            )?;
        }
    }
    let verdicts = verdicts(skies);
    if !verdicts.is_empty() {
        writeln!(
            out,
            "\n| sky | against | times quicker at no greater error | times closer in no longer time |"
        )?;
        writeln!(out, "|---|---|--:|--:|")?;
    }
    for verdict in verdicts {
        let times = |ratio: Option<f64>| ratio.map_or("-".into(), |ratio| format!("{ratio:.1}"));
        writeln!(
            out,
            "| {} | {}, {} | {} | {} |",
            verdict.sky,
            verdict.tool,
            verdict.setting,
            times(verdict.quicker),
            times(verdict.closer),
        )?;
    }
    writeln!(
        out,
        "\nBRDF table of 256 texels a side: {:.2} CPU s, {:.2} wall s.",
        brdf_table.cpu_seconds, brdf_table.wall_seconds
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    pub fn row(tool: &str, seconds: f64, error: f64) -> Row {
        Row {
            tool: tool.into(),
            setting: "x".into(),
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
        }
    }

    #[test]
    fn verdicts_compare_the_best_that_qualifies() {
        let sky = Sky {
            name: "s".into(),
            width: 2,
            height: 1,
            rows: vec![
                row("cairn", 0.5, 1e-2),
                row("cairn", 1.0, 1e-3),
                row("other", 10.0, 2e-2),
                row("fast", 0.1, 1e-4),
            ],
        };
        let found = verdicts(std::slice::from_ref(&sky));
        assert_eq!(found.len(), 2);
        assert_eq!(
            (found[0].quicker, found[0].closer),
            (Some(20.0), Some(20.0))
        );
        assert_eq!((found[1].quicker, found[1].closer), (None, None));
        let text = text(std::slice::from_ref(&sky), Spent::default());
        assert!(text.contains("| s | fast, x | - | - |"), "{text}");
        assert!(json(&[sky], Spent::default()).contains("\"quicker\":20.0"));
    }
}
