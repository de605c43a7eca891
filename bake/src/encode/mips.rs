//! Halving of f32 images by separable polyphase filters.

use cairn_format::texture::mip_extent;
use rayon::prelude::*;

use crate::scene::Wrap;

/// How a mip is made of the level above it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default, serde::Serialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum MipFilter {
    /// Kaiser-windowed sinc, alpha 4, three output texels to each side: sharper and less aliased than a box, rings at
    /// edges (clamped to 0..=1), and means drift a little at borders that do not wrap.
    #[default]
    Kaiser,
    /// Area average: exact mean at every size, no ringing; the value a pixel's footprint averages to.
    Box,
}

impl MipFilter {
    /// As the command line has it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Kaiser => "kaiser",
            Self::Box => "box",
        }
    }
}

/// What the fourth channel means to the filter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Weighting {
    /// Nothing: the channels are independent, in [0,1].
    Plain,
    /// Straight alpha: colour is weighted by it.
    Alpha,
    /// Nothing, and values may be negative.
    Signed,
}

/// An image of four f32 channels, rows top to bottom.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Plane {
    pub width: u32,
    pub height: u32,
    /// `width * height` texels.
    pub texels: Vec<[f32; 4]>,
}

/// The weighted source texels of every output texel of one axis.
struct Kernel {
    /// Range of `taps` of each output texel.
    ranges: Vec<std::ops::Range<usize>>,
    /// Source index and weight; the weights of an output sum to 1.
    taps: Vec<(usize, f32)>,
}

const KAISER_ALPHA: f64 = 4.0;
/// Half width of the Kaiser filter in output texels.
const KAISER_WIDTH: f64 = 3.0;

/// Filtered alpha below this carries no colour: dividing by it would amplify rounding.
const LEAST_ALPHA: f32 = 1e-6;
const LITTLE_ALPHA: f32 = 1.0 / 16.0;

/// The next level of `plane`, `mip_extent` in each axis.
pub(super) fn halve(
    plane: &Plane,
    filter: MipFilter,
    wrap: [Wrap; 2],
    weighting: Weighting,
) -> Plane {
    let across = Kernel::new(plane.width, filter, wrap[0]);
    let down = Kernel::new(plane.height, filter, wrap[1]);
    let mut half = match weighting {
        Weighting::Plain | Weighting::Signed => resample(plane, &across, &down),
        Weighting::Alpha => resample_weighted(plane, &across, &down, filter),
    };
    if filter == MipFilter::Kaiser && weighting != Weighting::Signed {
        for texel in &mut half.texels {
            *texel = texel.map(|value| value.clamp(0.0, 1.0));
        }
    }
    half
}

/// Colour weighted by alpha. Where no alpha is left, the plain average of the colours, so that bilinear
/// reads across the border of a transparent region see sensible colour. Kaiser's negative weights can leave a little
/// alpha beside any colour: below `LITTLE_ALPHA` the plain average fades in.
fn resample_weighted(plane: &Plane, across: &Kernel, down: &Kernel, filter: MipFilter) -> Plane {
    let premultiplied = Plane {
        texels: plane
            .texels
            .par_iter()
            .map(|&[r, g, b, a]| [r * a, g * a, b * a, a])
            .collect(),
        ..*plane
    };
    let mut weighted = resample(&premultiplied, across, down);
    drop(premultiplied);
    let little = match filter {
        MipFilter::Kaiser => LITTLE_ALPHA,
        MipFilter::Box => LEAST_ALPHA,
    };
    let plain = (weighted.texels.iter().any(|texel| texel[3] <= little))
        .then(|| resample(plane, across, down));
    for (index, texel) in weighted.texels.iter_mut().enumerate() {
        let [r, g, b, a] = *texel;
        let own = [r, g, b].map(|value| {
            if a > LEAST_ALPHA {
                (value / a).min(1.0)
            } else {
                0.0
            }
        });
        *texel = match &plain {
            Some(plain) if a <= little => {
                let share = if a > LEAST_ALPHA { a / little } else { 0.0 };
                let [r, g, b, _] = plain.texels[index];
                let mix = |own: f32, plain: f32| plain + share * (own.max(0.0) - plain);
                [mix(own[0], r), mix(own[1], g), mix(own[2], b), a.max(0.0)]
            }
            _ => [own[0], own[1], own[2], a],
        };
    }
    weighted
}

fn resample(plane: &Plane, across: &Kernel, down: &Kernel) -> Plane {
    let (width, height) = (across.ranges.len(), down.ranges.len());
    let source_width = plane.width as usize;
    let mut rows = vec![[0.0_f32; 4]; width * plane.height as usize];
    rows.par_chunks_mut(width)
        .zip(plane.texels.par_chunks(source_width))
        .for_each(|(row, source)| {
            for (texel, range) in row.iter_mut().zip(&across.ranges) {
                *texel = weighted_sum(&across.taps[range.clone()], |index| source[index]);
            }
        });
    let mut texels = vec![[0.0_f32; 4]; width * height];
    texels
        .par_chunks_mut(width)
        .zip(down.ranges.par_iter())
        .for_each(|(row, range)| {
            let taps = &down.taps[range.clone()];
            for (x, texel) in row.iter_mut().enumerate() {
                *texel = weighted_sum(taps, |index| rows[index * width + x]);
            }
        });
    Plane {
        width: width as u32,
        height: height as u32,
        texels,
    }
}

/// Bilinear interpolation at the centres of more texels, as samplers magnify.
pub(super) fn enlarge(plane: &Plane, [width, height]: [u32; 2], wrap: [Wrap; 2]) -> Plane {
    let across = Kernel::bilinear(plane.width, width, wrap[0]);
    let down = Kernel::bilinear(plane.height, height, wrap[1]);
    resample(plane, &across, &down)
}

fn weighted_sum(taps: &[(usize, f32)], texel: impl Fn(usize) -> [f32; 4]) -> [f32; 4] {
    let mut sum = [0.0_f32; 4];
    for &(index, weight) in taps {
        let value = texel(index);
        for channel in 0..4 {
            sum[channel] += weight * value[channel];
        }
    }
    sum
}

impl Kernel {
    fn new(extent: u32, filter: MipFilter, wrap: Wrap) -> Self {
        let mut kernel = Self {
            ranges: Vec::new(),
            taps: Vec::new(),
        };
        let out = mip_extent(extent, 1);
        for index in 0..out {
            let start = kernel.taps.len();
            match filter {
                MipFilter::Kaiser if extent > 1 => kernel.push_kaiser(index, extent, out, wrap),
                _ => kernel.push_box(index, extent, out),
            }
            kernel.ranges.push(start..kernel.taps.len());
        }
        kernel
    }

    fn bilinear(extent: u32, out: u32, wrap: Wrap) -> Self {
        let mut kernel = Self {
            ranges: Vec::new(),
            taps: Vec::new(),
        };
        for index in 0..out {
            let start = kernel.taps.len();
            let at = (f64::from(index) + 0.5) * f64::from(extent) / f64::from(out) - 0.5;
            let share = (at - at.floor()) as f32;
            for (step, weight) in [(0, 1.0 - share), (1, share)] {
                let texel = wrapped(at.floor() as i64 + step, extent, wrap);
                kernel.taps.push((texel, weight));
            }
            kernel.ranges.push(start..kernel.taps.len());
        }
        kernel
    }

    /// Output `index` covers `[index, index + 1) * extent / out` source texels. In units of `1 / out` texel
    /// all bounds are integers, so that the overlaps are exact.
    fn push_box(&mut self, index: u32, extent: u32, out: u32) {
        let (extent, out) = (u64::from(extent), u64::from(out));
        let low = u64::from(index) * extent;
        let high = low + extent;
        for texel in low / out..high.div_ceil(out) {
            let overlap = high.min((texel + 1) * out) - low.max(texel * out);
            let weight = overlap as f64 / extent as f64;
            self.taps.push((texel as usize, weight as f32));
        }
    }

    fn push_kaiser(&mut self, index: u32, extent: u32, out: u32, wrap: Wrap) {
        let scale = f64::from(extent) / f64::from(out);
        let centre = (f64::from(index) + 0.5) * scale;
        let radius = KAISER_WIDTH * scale;
        let first = (centre - radius - 0.5).ceil() as i64;
        let last = (centre + radius - 0.5).floor() as i64;
        let weights: Vec<f64> = (first..=last)
            .map(|texel| kaiser_sinc((texel as f64 + 0.5 - centre) / scale))
            .collect();
        let total: f64 = weights.iter().sum();
        for (texel, weight) in (first..=last).zip(weights) {
            let source = wrapped(texel, extent, wrap);
            self.taps.push((source, (weight / total) as f32));
        }
    }
}

/// The texel that a sampler reads at `index` of an axis of `extent` texels.
pub(super) fn wrapped(index: i64, extent: u32, wrap: Wrap) -> usize {
    let extent = i64::from(extent);
    let texel = match wrap {
        Wrap::Repeat => index.rem_euclid(extent),
        Wrap::ClampToEdge => index.clamp(0, extent - 1),
        Wrap::MirroredRepeat => {
            let phase = index.rem_euclid(2 * extent);
            phase.min(2 * extent - 1 - phase)
        }
    };
    texel as usize
}

/// `sinc(x)` under a Kaiser window; `x` in output texels, 0 outside the window.
fn kaiser_sinc(x: f64) -> f64 {
    let t = x / KAISER_WIDTH;
    let inside = 1.0 - t * t;
    if inside < 0.0 {
        return 0.0;
    }
    let window = bessel_i0(KAISER_ALPHA * inside.sqrt()) / bessel_i0(KAISER_ALPHA);
    let angle = std::f64::consts::PI * x;
    let sinc = if angle.abs() < 1e-9 {
        1.0
    } else {
        libm::sin(angle) / angle
    };
    sinc * window
}

/// The modified Bessel function of the first kind, order 0, by its power series.
fn bessel_i0(x: f64) -> f64 {
    let quarter = 0.25 * x * x;
    let (mut sum, mut term, mut k) = (1.0, 1.0, 1.0);
    while term > sum * 1e-17 {
        term *= quarter / (k * k);
        sum += term;
        k += 1.0;
    }
    sum
}

#[cfg(test)]
#[path = "mips_tests.rs"]
mod tests;
