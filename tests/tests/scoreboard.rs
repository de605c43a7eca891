//! Every real model bakes and renders, or is refused for a reason that is known.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

use cairn_bake::{BakeError, Silent, Summary};
use cairn_format::Package;
use cairn_player::camera::Camera;
use cairn_player::gpu::{Gpu, GpuOptions};
use cairn_player::headless::{HeadlessImage, HeadlessOptions, render_on};
use cairn_player::settings::Settings;
use cairn_tests::{bounds, files, quick_options, require_vulkan, shared_assets};

const SIZE: [u32; 2] = [128, 72];

/// Models that are refused: the end of the path, and what the error must contain.
const REFUSED: [(&str, &str); 2] = [
    ("Compatibility/Compatibility_04.gltf", "glTF version `2.1`"),
    (
        "Compatibility/Compatibility_05.gltf",
        "the extension FAKE_materials_quantumRendering",
    ),
];

/// Models that show nothing, because their cutoff lies above 1.
const INVISIBLE: [&str; 1] = ["Material_AlphaMask/Material_AlphaMask_03.gltf"];

/// A model's row of the table.
struct Row {
    model: String,
    triangles: u64,
    instances: u64,
    seconds: f64,
    result: String,
}

#[test]
fn every_model_bakes_and_renders() {
    let Some(assets) = shared_assets("every_model_bakes_and_renders") else {
        return;
    };
    if !require_vulkan("every_model_bakes_and_renders") {
        return;
    }
    let options = GpuOptions {
        validation: true,
        device: None,
        ..GpuOptions::default()
    };
    let gpu = Gpu::new(&options).expect("a device");
    let (mut rows, mut failures) = (Vec::new(), Vec::new());
    for model in models(&assets) {
        let name = name(&assets, &model);
        let start = Instant::now();
        let outcome = run(&gpu, &name, &model);
        let (triangles, instances, result) = match outcome {
            Ok(outcome) => outcome,
            Err(failure) => {
                failures.push(format!("{name}: {failure}"));
                (0, 0, format!("**fails**: {failure}"))
            }
        };
        rows.push(Row {
            model: name,
            triangles,
            instances,
            seconds: start.elapsed().as_secs_f64(),
            result,
        });
    }
    println!("{}", table(&rows));
    assert!(rows.len() > 100, "only {} models are there", rows.len());
    assert!(failures.is_empty(), "{}", failures.join("\n"));
    assert_eq!(gpu.close(), Vec::<String>::new());
}

/// glTF files outside `adversarial`, sorted.
fn models(assets: &Path) -> Vec<PathBuf> {
    let is_model = |path: &PathBuf| {
        let extension = path.extension().and_then(|extension| extension.to_str());
        matches!(extension, Some("gltf" | "glb")) && !path.starts_with(assets.join("adversarial"))
    };
    files(assets).into_iter().filter(is_model).collect()
}

/// Path below the assets.
fn name(assets: &Path, model: &Path) -> String {
    let below = model.strip_prefix(assets).unwrap_or(model);
    below.display().to_string()
}

type Outcome = (u64, u64, String);

/// Triangles, instances and remarks; or what is wrong.
fn run(gpu: &Gpu, name: &str, model: &Path) -> Result<Outcome, String> {
    let known = REFUSED.iter().find(|(end, _)| name.ends_with(end));
    let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
    let output = folder.path().join("model.cairn");
    match (
        cairn_bake::bake(&quick_options(model, &output), &Silent),
        known,
    ) {
        (Ok(summary), None) => check(gpu, name, &output, &summary),
        (Ok(_), Some((_, reason))) => Err(format!("bakes, though listed as refused: {reason}")),
        (Err(BakeError::Input(error)), Some((_, reason))) if error.message.contains(reason) => {
            Ok((0, 0, format!("refused: {}: {}", error.code, error.message)))
        }
        (Err(error), _) => Err(error.to_string()),
    }
}

fn check(gpu: &Gpu, name: &str, output: &Path, summary: &Summary) -> Result<Outcome, String> {
    let package = Package::open(output).map_err(|error| error.to_string())?;
    package.verify().map_err(|error| error.to_string())?;
    let image = render(gpu, &package)?;
    if let Some(message) = image.validation.first() {
        return Err(format!("validation: {message}"));
    }
    if image.non_finite() != Some(0) {
        return Err(format!("{:?} texels are not finite", image.non_finite()));
    }
    // The camera holds the scene's bounds, so nothing may be culled.
    if u64::from(image.draws.visible_instances) != summary.instances {
        let visible = image.draws.visible_instances;
        return Err(format!(
            "{visible} of {} instances are drawn",
            summary.instances
        ));
    }
    let lit = image
        .rgba8
        .chunks_exact(4)
        .filter(|texel| texel[..3] != [0; 3]);
    let coverage = lit.count() as f64 / f64::from(SIZE[0] * SIZE[1]);
    let visible = summary.triangles > 0 && !INVISIBLE.iter().any(|end| name.ends_with(end));
    if visible != (coverage > 0.0) {
        return Err(format!("{:.1} % of the image is lit", coverage * 100.0));
    }
    let warnings = summary.diagnostics.len();
    let remark = match warnings {
        0 => String::new(),
        1 => format!("; 1 warning: {}", summary.diagnostics[0].code),
        _ => format!(
            "; {warnings} warnings, first {}",
            summary.diagnostics[0].code
        ),
    };
    let result = format!("covers {:.1} %{remark}", coverage * 100.0);
    Ok((summary.triangles, summary.instances, result))
}

fn render(gpu: &Gpu, package: &Package) -> Result<HeadlessImage, String> {
    let options = HeadlessOptions {
        size: SIZE,
        camera: Camera::framing(bounds(package), SIZE[0] as f32 / SIZE[1] as f32),
        settings: Settings::default(),
        frames: 1,
        hdr: true,
        gpu: GpuOptions::default(),
    };
    render_on(gpu, package, &options).map_err(|error| error.to_string())
}

/// The scoreboard in Markdown.
fn table(rows: &[Row]) -> String {
    let mut text = String::from(
        "| model | triangles | instances | seconds | result |\n|---|--:|--:|--:|---|\n",
    );
    for row in rows {
        let _ = writeln!(
            text,
            "| {} | {} | {} | {:.2} | {} |",
            row.model, row.triangles, row.instances, row.seconds, row.result
        );
    }
    text
}
