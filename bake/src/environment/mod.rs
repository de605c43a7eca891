//! Bakes an equirectangular sky into the cube maps of image-based light.

pub mod bench;
mod brdf_lut;
mod cells;
mod cubemap;
mod cut;
mod equirect;
mod ggx;
mod harmonics;
mod importance;
mod irradiance;
mod lattice;
mod mirrors;
mod prefilter;
mod quadrature;
mod range;
mod resample;
mod sheen;
mod simd;
mod sun;
mod taps;
#[cfg(test)]
mod tests;
mod verify;

use std::time::Instant;

pub use brdf_lut::brdf_lut;
pub(crate) use cubemap::texel_at;
pub use cubemap::{Cube, HALF_MAX, face_direction, level_to_rgba16f};
pub use equirect::Equirect;
pub use importance::ImportanceTable;
pub use prefilter::level_roughness;
pub use sun::{ExtractedSun, SunMode};
pub use verify::Kernel;

use equirect::Rows;
use verify::Oracle;

/// Finest level the lobe and cosine integrals read; finer skies are averaged to it.
const LARGEST_CELL_LEVEL: u32 = 512;
/// Finest cells per face side times the alpha of the sharpest lobe, at least.
const CELLS_PER_LOBE: f64 = 16.0;
/// Side of the sky level that irradiance sums.
const IRRADIANCE_CELLS: u32 = 64;
/// Smallest sky cube, so that tiny maps keep their smooth reconstruction.
const SMALLEST_SKY: u32 = 64;

/// Sizes of the products, all in texels per face side and rounded up to a power of two.
#[derive(Clone, Debug, PartialEq)]
pub struct EnvironmentOptions {
    /// Sky side; `None` takes the power of two at or above width / pi, which matches the map's
    /// density at the middle of a face, and at least 64.
    pub sky_size: Option<u32>,
    /// Upper bound of the sky side.
    pub sky_limit: u32,
    pub irradiance_size: u32,
    /// Side of prefiltered level 0 (at least 8).
    pub prefiltered_size: u32,
    /// Side of the last prefiltered level, whose roughness is 1.
    pub prefiltered_last: u32,
    /// What becomes of the sun.
    pub sun: SunMode,
    /// Bound of the relative RMS error of every prefiltered level, from which the work follows.
    pub error: f64,
    /// Directions at which each product is measured against the f64 reference; 0 measures only
    /// energy.
    pub probes: usize,
}

impl Default for EnvironmentOptions {
    fn default() -> Self {
        Self {
            sky_size: None,
            sky_limit: 2048,
            irradiance_size: 32,
            prefiltered_size: 256,
            prefiltered_last: 8,
            sun: SunMode::Auto,
            error: 2e-3,
            probes: 8,
        }
    }
}

/// Seconds and error of one stage.
#[derive(Clone, Debug, PartialEq)]
pub struct StageReport {
    pub name: String,
    /// Wall time of the stage without its verification.
    pub seconds: f64,
    /// What `error` is.
    pub metric: &'static str,
    /// `None` where the options asked for no measurement.
    pub error: Option<f64>,
    /// Wall time of measuring `error`.
    pub verify_seconds: f64,
}

/// Everything image-based light reads, linear radiance.
#[derive(Clone, Debug)]
pub struct EnvironmentProducts {
    /// What left the map; `None` where nothing did.
    pub sun: Option<ExtractedSun>,
    /// Cube texels times this are radiance: a power of two, 1 unless the map leaves half range.
    pub scale: f32,
    /// Radiance, with every mip.
    pub sky: Cube,
    /// Irradiance divided by pi, one level.
    pub irradiance: Cube,
    /// GGX-filtered radiance; level `i` of `n` has perceptual roughness `i / (n - 1)`.
    pub prefiltered: Cube,
    /// Irradiance divided by pi, unscaled: coefficients of [`cairn_format::harmonics::evaluate`].
    pub irradiance_sh: [[f32; 3]; 9],
    /// `None` where the sky is black.
    pub importance: Option<ImportanceTable>,
    /// The bound that was asked for.
    pub error_bound: f64,
    /// Texels of all levels above [`HALF_MAX`], which [`level_to_rgba16f`] clamps.
    pub clamped_texels: u64,
    pub reports: Vec<StageReport>,
}

const ENERGY_METRIC: &str = "relative energy error";
const HARMONICS_METRIC: &str = "relative rms against the irradiance cube";
const RMS_METRIC: &str = "relative rms against f64 sum over the map";

/// Bakes all cube maps; `progress` receives the stage's name and the finished fraction.
///
/// The result depends only on the input and the options, not on the number of threads.
///
/// # Panics
/// If the map is empty or `texels` does not hold `width * height` values.
pub fn bake_environment(
    mut input: Equirect,
    options: &EnvironmentOptions,
    progress: &(dyn Fn(&str, f32) + Sync),
) -> EnvironmentProducts {
    let expected = u64::from(input.width) * u64::from(input.height);
    assert!(expected > 0 && input.texels.len() as u64 == expected);
    let rows = Rows::new(input.height);
    let mut reports = Vec::new();
    let sun = take_sun(&mut input, &rows, options.sun, &mut reports);
    let scale = range::normalize(&mut input);
    let mut baker = Baker {
        input: &input,
        scale,
        rows,
        probes: options.probes,
        error: options.error,
        reports,
    };
    let sizes = Sizes::new(&input, options);

    progress("sky", 0.0);
    let base = baker.sky(sizes.base);
    let sky = Cube {
        size: sizes.sky,
        levels: base.levels[levels_between(sizes.base, sizes.sky)..].to_vec(),
    };
    progress("irradiance", 0.3);
    let finest = levels_between(sizes.base, sizes.cells);
    let cells = cells::build(&base, finest, prefilter::COARSEST_CELLS);
    let irradiance = baker.irradiance(&cells, sizes.irradiance);
    let irradiance_sh = baker.harmonics(&cells, &irradiance);
    let importance = baker.importance();
    progress("prefiltered", 0.4);
    let prefiltered = baker.prefiltered(&base, &cells, &sizes, progress);
    progress("prefiltered", 1.0);

    let clamped_texels = [&sky, &irradiance, &prefiltered]
        .iter()
        .map(|cube| cube.texels_above_half())
        .sum();
    EnvironmentProducts {
        sun: sun.filter(|_| options.sun == SunMode::Auto),
        scale,
        sky,
        irradiance,
        prefiltered,
        irradiance_sh,
        importance,
        error_bound: options.error,
        clamped_texels,
        reports: baker.reports,
    }
}

/// Takes the sun out of the map, and reports how well energy was kept.
fn take_sun(
    input: &mut Equirect,
    rows: &Rows,
    mode: SunMode,
    reports: &mut Vec<StageReport>,
) -> Option<ExtractedSun> {
    if mode == SunMode::Keep {
        return None;
    }
    let start = Instant::now();
    let before = input.energy(rows);
    let sun = sun::extract(input, rows)?;
    let difference = input.energy(rows) + sun.energy() - before;
    reports.push(StageReport {
        name: "sun".into(),
        seconds: start.elapsed().as_secs_f64(),
        metric: "relative energy error of sky and sun",
        error: Some(difference.abs().max_element() / before.max_element()),
        verify_seconds: 0.0,
    });
    Some(sun)
}

/// Resolved powers of two.
struct Sizes {
    sky: u32,
    /// The cube that all products start from.
    base: u32,
    cells: u32,
    irradiance: u32,
    prefiltered: u32,
    prefiltered_levels: usize,
}

impl Sizes {
    fn new(input: &Equirect, options: &EnvironmentOptions) -> Self {
        let power = |size: u32, least: u32| size.clamp(least, 1 << 14).next_power_of_two();
        let matching = libm::ceil(f64::from(input.width) / std::f64::consts::PI) as u32;
        let limit = power(options.sky_limit, 8);
        let sky = options
            .sky_size
            .map_or_else(|| power(matching, SMALLEST_SKY), |size| power(size, 8))
            .min(limit);
        let prefiltered = power(options.prefiltered_size, 8);
        let last = power(options.prefiltered_last, 1).min(prefiltered);
        let prefiltered_levels = levels_between(prefiltered, last) + 1;
        let sharpest = level_roughness(1, prefiltered_levels.max(2)).powi(2);
        let cells = power(libm::ceil(CELLS_PER_LOBE / sharpest) as u32, 8);
        let base = sky
            .max(prefiltered)
            .max(IRRADIANCE_CELLS)
            .max(cells.min(LARGEST_CELL_LEVEL));
        Self {
            sky,
            base,
            cells: base.min(LARGEST_CELL_LEVEL.max(prefiltered)),
            irradiance: power(options.irradiance_size, 1),
            prefiltered,
            prefiltered_levels,
        }
    }
}

/// How many halvings lead from one power of two to a smaller one.
fn levels_between(large: u32, small: u32) -> usize {
    (large.ilog2() - small.ilog2()) as usize
}

/// The level that diffuse light sums.
fn summed<'a, 'b>(cells: &'b [cells::CellLevel<'a>]) -> &'b cells::CellLevel<'a> {
    cells
        .iter()
        .find(|level| level.size >= IRRADIANCE_CELLS)
        .unwrap_or(&cells[cells.len() - 1])
}

struct Baker<'a> {
    input: &'a Equirect,
    /// What the map was divided by.
    scale: f32,
    rows: Rows,
    probes: usize,
    error: f64,
    reports: Vec<StageReport>,
}

impl Baker<'_> {
    fn sky(&mut self, size: u32) -> Cube {
        let start = Instant::now();
        let finest = resample::equirect_to_cube(self.input, &self.rows, size);
        let cube = Cube::single(size, finest).with_mips();
        let seconds = start.elapsed().as_secs_f64();
        self.report_energy("sky", seconds, &cube.levels[0], size);
        cube
    }

    fn irradiance(&mut self, cells: &[cells::CellLevel<'_>], size: u32) -> Cube {
        let start = Instant::now();
        let texels = irradiance::irradiance(summed(cells), size);
        let seconds = start.elapsed().as_secs_f64();
        self.report_rms("irradiance", seconds, (&texels, size), &Kernel::Cosine);
        Cube::single(size, texels)
    }

    fn harmonics(&mut self, cells: &[cells::CellLevel<'_>], irradiance: &Cube) -> [[f32; 3]; 9] {
        let start = Instant::now();
        let harmonics = harmonics::project(summed(cells));
        let seconds = start.elapsed().as_secs_f64();
        let start = Instant::now();
        let error = harmonics::relative_rms(&harmonics.coefficients, irradiance);
        self.reports.push(StageReport {
            name: format!("harmonics window {:.2e}", harmonics.window),
            seconds,
            metric: HARMONICS_METRIC,
            error: Some(error),
            verify_seconds: start.elapsed().as_secs_f64(),
        });
        harmonics
            .coefficients
            .map(|rgb| rgb.map(|channel| channel * self.scale))
    }

    fn importance(&mut self) -> Option<ImportanceTable> {
        let start = Instant::now();
        let table = importance::build(self.input, &self.rows, self.scale);
        self.reports.push(StageReport {
            name: "importance".into(),
            seconds: start.elapsed().as_secs_f64(),
            metric: "error of the density's integral",
            error: Some(table.as_ref().map_or(0.0, ImportanceTable::integral_error)),
            verify_seconds: 0.0,
        });
        table
    }

    fn prefiltered(
        &mut self,
        base: &Cube,
        cells: &[cells::CellLevel<'_>],
        sizes: &Sizes,
        progress: &(dyn Fn(&str, f32) + Sync),
    ) -> Cube {
        let mirror = base.levels[levels_between(sizes.base, sizes.prefiltered)].clone();
        self.report_energy("prefiltered 0", 0.0, &mirror, sizes.prefiltered);
        let mut cube = Cube::single(sizes.prefiltered, mirror);
        let levels = sizes.prefiltered_levels;
        for level in 1..levels {
            progress(
                "prefilter",
                0.4 + 0.6 * (level - 1) as f32 / (levels - 1) as f32,
            );
            let start = Instant::now();
            let size = cube.level_size(level);
            let roughness = level_roughness(level, levels);
            let alpha = roughness * roughness;
            let texels = prefilter::prefilter(cells, size, alpha, self.error);
            let seconds = start.elapsed().as_secs_f64();
            self.report_rms(
                &format!("prefiltered {level}"),
                seconds,
                (&texels, size),
                &Kernel::Lobe(alpha),
            );
            cube.levels.push(texels);
        }
        cube
    }

    fn report_energy(&mut self, name: &str, seconds: f64, texels: &[[f32; 3]], size: u32) {
        let start = Instant::now();
        let exact = self.input.energy(&self.rows);
        let scale = exact.max_element();
        let difference = (cubemap::energy(texels, size) - exact).abs().max_element();
        let error = if scale > 0.0 {
            difference / scale
        } else {
            difference
        };
        self.reports.push(StageReport {
            name: name.to_owned(),
            seconds,
            metric: ENERGY_METRIC,
            error: Some(error),
            verify_seconds: start.elapsed().as_secs_f64(),
        });
    }

    fn report_rms(&mut self, name: &str, seconds: f64, level: (&[[f32; 3]], u32), kernel: &Kernel) {
        let start = Instant::now();
        let oracle = Oracle::new(self.input, &self.rows, self.error);
        let error = (self.probes > 0).then(|| oracle.relative_rms(level, self.probes, kernel));
        self.reports.push(StageReport {
            name: name.to_owned(),
            seconds,
            metric: RMS_METRIC,
            error,
            verify_seconds: start.elapsed().as_secs_f64(),
        });
    }
}
