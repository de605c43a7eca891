//! Times the geometry stages on real files, beside gltfpack on the same files.
//!
//! `cargo bench -p cairn-bake --bench geometry -- FILE...`; without files, two models of `CAIRN_ASSETS` (else
//! `../shared/assets` beside the checkout).

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;

use cairn_bake::import::import;
use cairn_bake::prepare::{Prepared, StepTime, prepare};

const RUNS: usize = 5;
const DEFAULTS: [&str; 2] = [
    "derived/chevrolet-plain-png/chevrolet.glb",
    "3d-demo-data/dream-apartment/dream-apartment.glb",
];

fn main() {
    let threads = rayon::current_num_threads();
    println!("Geometry on {threads} threads, medians of {RUNS} runs.\n");
    for file in files() {
        if file.is_file() {
            measure(&file);
        } else {
            println!("SKIPPED: no {}\n", file.display());
        }
    }
}

fn files() -> Vec<PathBuf> {
    let arguments = std::env::args().skip(1);
    let named: Vec<PathBuf> = arguments
        .filter(|argument| !argument.starts_with("--"))
        .map(PathBuf::from)
        .collect();
    if !named.is_empty() {
        return named;
    }
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/assets");
    let assets = std::env::var_os("CAIRN_ASSETS").map_or_else(beside, PathBuf::from);
    DEFAULTS.map(|file| assets.join(file)).to_vec()
}

/// One run: seconds of import and preparation, and what came of it.
fn run(file: &Path) -> Result<(f64, f64, Prepared), cairn_bake::BakeError> {
    let start = Instant::now();
    let mut scene = import(file)?;
    let imported = start.elapsed().as_secs_f64();
    let prepared = prepare(&mut scene, &|_| ())?;
    Ok((imported, start.elapsed().as_secs_f64() - imported, prepared))
}

fn measure(file: &Path) {
    let mut runs = Vec::new();
    for _ in 0..RUNS {
        match run(file) {
            Ok(run) => runs.push(run),
            Err(error) => {
                println!("SKIPPED: {error}\n");
                return;
            }
        }
    }
    let import = median(runs.iter().map(|run| run.0));
    let prepare = median(runs.iter().map(|run| run.1));
    let total = median(runs.iter().map(|run| run.0 + run.1));
    let stats = runs[0].2.stats;
    println!("### {}\n", file.display());
    println!(
        "{} triangles, {} vertices in, {} out, {} generated tangents, {} primitives\n",
        stats.triangles,
        stats.vertices_in,
        stats.vertices_out,
        stats.generated_tangents,
        runs[0].2.primitives.len()
    );
    println!("| Stage | Seconds | Mtri/s |\n|---|---:|---:|");
    let triangles = stats.triangles as f64;
    for (name, seconds) in [("import", import), ("prepare", prepare), ("both", total)] {
        println!(
            "| {name} | {seconds:.4} | {:.2} |",
            triangles / seconds / 1e6
        );
    }
    for (index, step) in runs[0].2.steps.iter().enumerate() {
        let times = runs.iter().map(|run| run.2.steps[index].seconds);
        let step = StepTime {
            seconds: median(times),
            ..*step
        };
        let speed = step.mega_triangles_per_second().unwrap_or_default();
        println!(
            "| {} (one thread) | {:.4} | {speed:.2} |",
            step.name, step.seconds
        );
    }
    match gltfpack(file) {
        Some(seconds) => println!(
            "| gltfpack | {seconds:.4} | {:.2} |\n\nOurs takes {:.2} times as long.\n",
            triangles / seconds / 1e6,
            total / seconds
        ),
        None => println!("\nSKIPPED: gltfpack is absent, or fails on this file\n"),
    }
    println!("| Metric | Before | After |\n|---|---:|---:|");
    let metrics = [
        ("ACMR", stats.acmr()),
        ("ATVR", stats.atvr()),
        ("Overdraw", stats.overdraw()),
    ];
    for (name, [before, after]) in metrics {
        println!("| {name} | {before:.3} | {after:.3} |");
    }
    println!();
}

/// Seconds of gltfpack without texture work; `None` where it cannot be run.
fn gltfpack(file: &Path) -> Option<f64> {
    let folder = tempfile::tempdir().ok()?;
    let mut times = Vec::new();
    for _ in 0..RUNS {
        let start = Instant::now();
        let status = Command::new("gltfpack")
            .arg("-i")
            .arg(file)
            .arg("-o")
            .arg(folder.path().join("packed.glb"))
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .status()
            .ok()?;
        if !status.success() {
            return None;
        }
        times.push(start.elapsed().as_secs_f64());
    }
    Some(median(times.into_iter()))
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
