//! What a bake did: counts, bytes, seconds, and the error of every lossy step beside its time.

use std::fmt::Write;

use serde::{Deserialize, Serialize};

use crate::cache;
use crate::diagnostic::Diagnostic;
use crate::label::{Interned, Label};
use crate::look::{bytes_text as bytes, number};
use crate::prepare::{GeometryStats, StepTime};

/// One row of the speed-against-error report.
#[derive(
    rkyv::Archive,
    rkyv::Serialize,
    rkyv::Deserialize,
    Clone,
    Debug,
    PartialEq,
    Serialize,
    Deserialize,
)]
pub struct Row {
    /// `geometry`, `texture` or `environment`.
    pub stage: String,
    /// The object, such as an image's name.
    pub item: String,
    /// Format and preset.
    pub setting: String,
    /// Wall time of the step; rows of one step state the same.
    pub seconds: f64,
    /// In `throughput_unit`; absent where it has no meaning.
    pub throughput: Option<f64>,
    /// Such as `Mpix/s`.
    #[serde(deserialize_with = "crate::label::read")]
    #[rkyv(with = Interned)]
    pub throughput_unit: Label,
    /// Name and unit of the error.
    pub metric: String,
    /// In the unit that `metric` names; 999 dB stands for no error.
    pub error: f64,
    /// Bytes produced.
    pub bytes: u64,
}

/// Wall time of a stage.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Stage {
    /// Such as `textures`.
    #[serde(deserialize_with = "crate::label::read")]
    pub name: Label,
    /// Seconds.
    pub seconds: f64,
}

/// Bytes of a section.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Section {
    /// As [`cairn_format::SectionKind::name`] gives it.
    #[serde(deserialize_with = "crate::label::read")]
    pub name: Label,
    /// Bytes, without the padding before it.
    pub bytes: u64,
    /// BLAKE3 in hexadecimal.
    pub hash: String,
}

/// The result of a bake.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Summary {
    /// The scene, as the caller named it.
    pub input: String,
    /// The package, as the caller named it.
    pub output: String,
    /// Name and version of the tool.
    pub tool: String,
    /// Triangles of all primitives, each once however many instances it has.
    pub triangles: u64,
    /// Vertices of all primitives.
    pub vertices: u64,
    /// Meshes.
    pub meshes: u64,
    /// Primitives.
    pub primitives: u64,
    /// Drawn primitives of all nodes.
    pub instances: u64,
    /// Indexed draws.
    pub draw_groups: u64,
    /// Materials in use.
    pub materials: u64,
    /// Images seen through samplers.
    pub textures: u64,
    /// Stored images, those of the environment included.
    pub images: u64,
    /// Lights of the scene.
    pub lights: u64,
    /// Cameras of the scene.
    pub cameras: u64,
    /// Names of what the scene contains, as [`cairn_format::features::NAMES`] has them.
    #[serde(deserialize_with = "crate::label::read_list")]
    pub features: Vec<Label>,
    /// Sections, in file order.
    pub sections: Vec<Section>,
    /// Bytes of the file.
    pub package_bytes: u64,
    /// BLAKE3 of header, section table and root, which holds the hash of every section.
    pub content_hash: String,
    /// Stages, in order.
    pub stages: Vec<Stage>,
    /// Counts of the geometry stage.
    pub geometry: GeometryStats,
    /// Times of the steps of the geometry stage, summed over threads.
    pub geometry_steps: Vec<StepTime>,
    /// The error of every lossy step, beside its time.
    pub report: Vec<Row>,
    /// Warnings about the input.
    pub diagnostics: Vec<Diagnostic>,
    /// Seconds in all.
    pub seconds: f64,
    /// Most memory that the process held; known on Linux alone.
    pub peak_memory_bytes: Option<u64>,
    /// What was reused and why; absent where nothing is kept.
    pub cache: Option<cache::Report>,
}

impl Summary {
    /// The summary as text for a terminal; `verbose` adds every row of the report.
    pub fn text(&self, verbose: bool) -> String {
        let mut text = String::new();
        self.write(&mut text, verbose).unwrap_or_default();
        text
    }

    fn write(&self, out: &mut String, verbose: bool) -> std::fmt::Result {
        writeln!(out, "{} -> {}", self.input, self.output)?;
        writeln!(
            out,
            "  {} triangles, {} vertices in {} primitives of {} meshes; {} instances in {} draw groups",
            self.triangles,
            self.vertices,
            self.primitives,
            self.meshes,
            self.instances,
            self.draw_groups
        )?;
        writeln!(
            out,
            "  {} materials, {} textures of {} images, {} lights, {} cameras; {}",
            self.materials,
            self.textures,
            self.images,
            self.lights,
            self.cameras,
            if self.features.is_empty() {
                "no features".into()
            } else {
                self.features.join(", ")
            }
        )?;
        for section in &self.sections {
            let hash = match verbose {
                true => format!("  blake3 {}", section.hash),
                false => String::new(),
            };
            writeln!(
                out,
                "  {:<20}{:>14}{hash}",
                section.name,
                bytes(section.bytes)
            )?;
        }
        writeln!(
            out,
            "  {:<20}{:>14}  blake3 {}",
            "package",
            bytes(self.package_bytes),
            self.content_hash
        )?;
        for stage in &self.stages {
            writeln!(out, "  {:<20}{:>12.3} s", stage.name, stage.seconds)?;
        }
        writeln!(out, "  {:<20}{:>12.3} s", "total", self.seconds)?;
        if let Some(peak) = self.peak_memory_bytes {
            writeln!(out, "  {:<20}{:>14}", "peak memory", bytes(peak))?;
        }
        if let Some(cache) = &self.cache {
            let [hits, misses] = [cache.hits, cache.misses];
            writeln!(out, "  {:<20}{hits:>9} hits, {misses} misses", "cache")?;
            if let Some(problem) = &cache.problem {
                writeln!(out, "  {:<20}cannot be written: {problem}", "cache")?;
            }
        }
        if verbose {
            self.write_steps(out)?;
            self.write_report(out)?;
        } else {
            self.write_worst(out)?;
        }
        Ok(())
    }

    fn write_steps(&self, out: &mut String) -> std::fmt::Result {
        for step in &self.geometry_steps {
            let speed = step
                .mega_triangles_per_second()
                .map_or_else(String::new, |speed| format!("{speed:.2} Mtri/s"));
            writeln!(
                out,
                "    {:<18}{:>12.3} s {:>16}",
                step.name, step.seconds, speed
            )?;
        }
        Ok(())
    }

    fn write_report(&self, out: &mut String) -> std::fmt::Result {
        for row in &self.report {
            let throughput = row.throughput.map_or_else(String::new, |value| {
                format!("{value:.2} {}", row.throughput_unit)
            });
            writeln!(
                out,
                "  {:<12} {:<28} {:<24} {:>9.3} s {:>16} {:>12} {:<32} {:>12}",
                row.stage,
                row.item,
                row.setting,
                row.seconds,
                throughput,
                number(row.error),
                row.metric,
                bytes(row.bytes)
            )?;
        }
        Ok(())
    }

    /// The row with the greatest error of every metric (the least for PSNR).
    fn write_worst(&self, out: &mut String) -> std::fmt::Result {
        let mut metrics: Vec<&str> = Vec::new();
        for row in &self.report {
            // Rows of single mips are summed up by one of their own.
            if row.metric.contains(", mip ") {
                continue;
            }
            if !metrics.contains(&row.metric.as_str()) {
                metrics.push(&row.metric);
            }
        }
        for metric in metrics {
            let rows = self.report.iter().filter(|row| row.metric == metric);
            let worst = if metric.contains("psnr") {
                rows.min_by(|a, b| a.error.total_cmp(&b.error))
            } else {
                rows.max_by(|a, b| a.error.total_cmp(&b.error))
            };
            if let Some(row) = worst {
                writeln!(
                    out,
                    "  worst {metric}: {} ({} {})",
                    number(row.error),
                    row.stage,
                    row.item
                )?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(metric: &str, item: &str, error: f64) -> Row {
        Row {
            stage: "texture".into(),
            item: item.into(),
            setting: "bc7".into(),
            seconds: 0.1,
            throughput: None,
            throughput_unit: "",
            metric: metric.into(),
            error,
            bytes: 16,
        }
    }

    #[test]
    fn peak_and_steps_are_shown_where_known() {
        let mut summary = Summary::default();
        assert!(!summary.text(true).contains("peak memory"));
        summary.peak_memory_bytes = Some(12_340_000);
        summary.geometry_steps = vec![StepTime {
            name: "weld",
            seconds: 0.5,
            triangles: 3_000_000,
        }];
        let text = summary.text(true);
        assert!(
            text.contains("peak memory") && text.contains("12.34 MB"),
            "{text}"
        );
        assert!(text.contains("6.00 Mtri/s"), "{text}");
        assert!(!summary.text(false).contains("Mtri/s"));
    }

    #[test]
    fn the_worst_psnr_is_the_least() {
        let summary = Summary {
            report: vec![
                row("psnr dB", "good", 50.0),
                row("psnr dB", "bad", 30.0),
                row("rms", "far", 0.5),
                row("rms", "near", 0.1),
            ],
            ..Summary::default()
        };
        let text = summary.text(false);
        assert!(
            text.contains("worst psnr dB: 30.000 (texture bad)"),
            "{text}"
        );
        assert!(text.contains("worst rms: 0.500 (texture far)"), "{text}");
        assert_eq!(summary.text(true).matches("bc7").count(), 4);
    }
}
