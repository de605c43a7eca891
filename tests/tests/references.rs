//! The path tracer against pictures of an independent renderer (Mitsuba 3.9.1, `../shared/refs`, glTF core BRDF).
//!
//! `CAIRN_TRACED=DIR` compares DIR/helmet.exr, boombox.exr and bust.exr, rendered elsewhere at 640x360 with
//! `--mode path-trace --brdf gltf-core --path-bounces 14 --no-path-lod`. Without it, one scene is traced here at a
//! quarter of the size with few samples.

use std::path::{Path, PathBuf};

use cairn_bake::import::load_environment;
use cairn_format::Package;
use cairn_player::gpu::GpuOptions;
use cairn_player::headless::HeadlessOptions;
use cairn_player::headless::trace::TraceOptions;
use cairn_player::settings::{Brdf, Mode, Settings};
use cairn_player::{camera_file, headless};
use cairn_tests::{repository, require_vulkan, shared_assets};

/// Linear RGB, rows from the top.
struct Picture {
    width: usize,
    height: usize,
    texels: Vec<[f32; 3]>,
}

fn read(path: &Path) -> Picture {
    let image =
        load_environment(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    Picture {
        width: image.width as usize,
        height: image.height as usize,
        texels: image.texels,
    }
}

impl Picture {
    /// Means of squares of `factor` texels a side.
    fn reduced(&self, factor: usize) -> Self {
        let (width, height) = (self.width / factor, self.height / factor);
        let texel = |index: usize| {
            let (x, y) = (index % width * factor, index / width * factor);
            self.mean(x, y, x + factor, y + factor)
        };
        Self {
            width,
            height,
            texels: (0..width * height).map(texel).collect(),
        }
    }

    fn mean(&self, x0: usize, y0: usize, x1: usize, y1: usize) -> [f32; 3] {
        let mut sum = [0.0f64; 3];
        for y in y0..y1 {
            for texel in &self.texels[y * self.width + x0..y * self.width + x1] {
                (0..3).for_each(|channel| sum[channel] += f64::from(texel[channel]));
            }
        }
        let count = ((x1 - x0) * (y1 - y0)) as f64;
        sum.map(|sum| (sum / count) as f32)
    }

    /// A box of 5x5 texels, cut at the borders.
    fn blurred(&self) -> Self {
        let texel = |index: usize| {
            let (x, y) = (index % self.width, index / self.width);
            let (x1, y1) = ((x + 3).min(self.width), (y + 3).min(self.height));
            self.mean(x.saturating_sub(2), y.saturating_sub(2), x1, y1)
        };
        Self {
            width: self.width,
            height: self.height,
            texels: (0..self.texels.len()).map(texel).collect(),
        }
    }
}

/// Mean over texels and channels of the difference, relative to the reference plus 0.01, after a 5x5 box.
fn relative_difference(test: &Picture, reference: &Picture) -> f64 {
    assert_eq!(
        (test.width, test.height),
        (reference.width, reference.height)
    );
    let (test, reference) = (test.blurred(), reference.blurred());
    let channels = test
        .texels
        .as_flattened()
        .iter()
        .zip(reference.texels.as_flattened());
    let sum: f64 = channels
        .map(|(a, b)| f64::from((a - b).abs()) / (f64::from(*b) + 0.01))
        .sum();
    sum / (test.texels.len() * 3) as f64
}

fn references(test: &str) -> Option<PathBuf> {
    let path = repository().join("../shared/refs");
    if path.is_dir() {
        return Some(path);
    }
    eprintln!(
        "SKIPPED: {test}: no reference pictures at {}",
        path.display()
    );
    None
}

#[test]
fn traced_pictures_agree_with_another_renderer() {
    let Some(references) = references("references") else {
        return;
    };
    let Some(folder) = std::env::var_os("CAIRN_TRACED").map(PathBuf::from) else {
        eprintln!("SKIPPED: CAIRN_TRACED names no folder of traced pictures");
        return;
    };
    let mut worst: f64 = 0.0;
    for name in ["helmet", "boombox", "bust"] {
        let reference = read(&references.join(format!("{name}.exr")));
        let traced = read(&folder.join(format!("{name}.exr")));
        let difference = relative_difference(&traced, &reference);
        println!("{name}: {:.3} %", difference * 100.0);
        worst = worst.max(difference);
    }
    assert!(worst < 0.01, "{:.3} %", worst * 100.0);
}

#[test]
fn the_bust_agrees_with_another_renderer() {
    let test = "the_bust_agrees_with_another_renderer";
    let (Some(references), Some(assets)) = (references(test), shared_assets(test)) else {
        return;
    };
    if !require_vulkan(test) {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let output = folder.path().join("bust.cairn");
    let mut options = cairn_tests::quick_options(
        &assets.join("renderling/marble_bust_1k/marble_bust_1k.glb"),
        &output,
    );
    options.environment = Some(assets.join("hdri/pmndrs-assets/park.hdr"));
    cairn_bake::bake(&options, &cairn_bake::Silent).expect("bakes");
    let package = Package::open(&output).expect("opens");
    let camera = camera_file::load(&references.join("cameras.json"), "bust").expect("a camera");
    let mut settings = Settings {
        mode: Mode::PathTrace,
        brdf: Brdf::GltfCore,
        ..Settings::default()
    };
    settings.path.bounces = 14;
    settings.path.lod = false;
    let options = HeadlessOptions {
        size: [160, 90],
        camera: camera.with_near_for(cairn_tests::bounds(&package)),
        settings,
        frames: 1,
        hdr: true,
        gpu: GpuOptions::default(),
    };
    let limits = TraceOptions {
        samples: Some(32),
        ..TraceOptions::default()
    };
    let image = headless::render_traced(&package, &options, &limits).expect("traces");
    let hdr = image.hdr.expect("read back");
    let traced = Picture {
        width: 160,
        height: 90,
        texels: hdr.iter().map(|[r, g, b, _]| [*r, *g, *b]).collect(),
    };
    let reference = read(&references.join("bust.exr")).reduced(4);
    let difference = relative_difference(&traced, &reference);
    println!("bust at 160x90, 32 samples: {:.3} %", difference * 100.0);
    assert!(difference < 0.015, "{:.3} %", difference * 100.0);
}
