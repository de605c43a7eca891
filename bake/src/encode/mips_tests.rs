//! Tests of the mip filters against f64 oracles.

use proptest::prelude::*;

use super::*;

const WRAPS: [Wrap; 3] = [Wrap::Repeat, Wrap::MirroredRepeat, Wrap::ClampToEdge];

fn noise(width: u32, height: u32, seed: u64) -> Plane {
    let mut state = seed | 1;
    let mut random = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 40) as f32 / (1 << 24) as f32
    };
    Plane {
        width,
        height,
        texels: (0..width * height)
            .map(|_| std::array::from_fn(|_| random()))
            .collect(),
    }
}

fn mean(plane: &Plane, channel: usize) -> f64 {
    let sum: f64 = plane
        .texels
        .iter()
        .map(|texel| f64::from(texel[channel]))
        .sum();
    sum / plane.texels.len() as f64
}

/// Area average of the rectangle under an output texel, by exact overlaps in f64.
fn area_average(plane: &Plane, out: [u32; 2], x: u32, y: u32, channel: usize) -> f64 {
    let overlap = |index: u32, extent: u32, out: u32, texel: u32| {
        let scale = f64::from(extent) / f64::from(out);
        let (low, high) = (f64::from(index) * scale, f64::from(index + 1) * scale);
        (high.min(f64::from(texel + 1)) - low.max(f64::from(texel))).max(0.0) / scale
    };
    let mut sum = 0.0;
    for sy in 0..plane.height {
        for sx in 0..plane.width {
            let weight = overlap(x, plane.width, out[0], sx) * overlap(y, plane.height, out[1], sy);
            let texel = plane.texels[(sy * plane.width + sx) as usize];
            sum += weight * f64::from(texel[channel]);
        }
    }
    sum
}

proptest! {
    #[test]
    fn box_is_the_area_average(width in 1_u32..20, height in 1_u32..20, seed in any::<u64>()) {
        let plane = noise(width, height, seed);
        let half = halve(&plane, MipFilter::Box, [Wrap::Repeat; 2], Weighting::Plain);
        prop_assert_eq!(half.width, mip_extent(width, 1));
        prop_assert_eq!(half.height, mip_extent(height, 1));
        for y in 0..half.height {
            for x in 0..half.width {
                let expected = area_average(&plane, [half.width, half.height], x, y, 1);
                let value = f64::from(half.texels[(y * half.width + x) as usize][1]);
                prop_assert!((value - expected).abs() < 2e-6, "{value} for {expected}");
            }
        }
    }

    #[test]
    fn weights_sum_to_one(extent in 1_u32..300, wrap in 0..3_usize) {
        for filter in [MipFilter::Box, MipFilter::Kaiser] {
            let kernel = Kernel::new(extent, filter, WRAPS[wrap]);
            prop_assert_eq!(kernel.ranges.len() as u32, mip_extent(extent, 1));
            for range in kernel.ranges {
                let taps = &kernel.taps[range];
                let sum: f64 = taps.iter().map(|&(_, weight)| f64::from(weight)).sum();
                prop_assert!((sum - 1.0).abs() < 1e-6);
                prop_assert!(taps.iter().all(|&(texel, _)| texel < extent as usize));
            }
        }
    }

    /// Colour weighted by alpha against the same in f64; alpha itself is the plain average.
    #[test]
    fn alpha_weights_colour(width in 1_u32..9, height in 1_u32..9, seed in any::<u64>()) {
        let mut plane = noise(width, height, seed);
        for texel in &mut plane.texels {
            texel[3] = if texel[3] < 0.4 { 0.0 } else { texel[3] };
        }
        let mut premultiplied = plane.clone();
        for texel in &mut premultiplied.texels {
            texel[0] *= texel[3];
        }
        let half = halve(&plane, MipFilter::Box, [Wrap::Repeat; 2], Weighting::Alpha);
        let out = [half.width, half.height];
        for y in 0..half.height {
            for x in 0..half.width {
                let texel = half.texels[(y * half.width + x) as usize];
                let alpha = area_average(&plane, out, x, y, 3);
                let expected = if alpha > 0.0 {
                    area_average(&premultiplied, out, x, y, 0) / alpha
                } else {
                    area_average(&plane, out, x, y, 0)
                };
                prop_assert!((f64::from(texel[0]) - expected).abs() < 1e-5);
                prop_assert!((f64::from(texel[3]) - alpha).abs() < 2e-6);
            }
        }
    }
}

#[test]
fn box_keeps_the_mean_of_odd_sizes_to_the_last_level() {
    for (width, height) in [(5, 3), (1, 1), (1, 37), (255, 63), (33, 129)] {
        let mut plane = noise(width, height, 7);
        let means = [mean(&plane, 0), mean(&plane, 3)];
        while plane.texels.len() > 1 {
            plane = halve(
                &plane,
                MipFilter::Box,
                [Wrap::ClampToEdge; 2],
                Weighting::Plain,
            );
            for (channel, expected) in [(0, means[0]), (3, means[1])] {
                assert!(
                    (mean(&plane, channel) - expected).abs() < 1e-6,
                    "{width}x{height}"
                );
            }
        }
    }
}

#[test]
fn borders_follow_the_sampler() {
    for (wrap, expected) in [
        (Wrap::Repeat, [2, 3, 0, 1, 2, 3, 0, 1]),
        (Wrap::MirroredRepeat, [1, 0, 0, 1, 2, 3, 3, 2]),
        (Wrap::ClampToEdge, [0, 0, 0, 1, 2, 3, 3, 3]),
    ] {
        let texels: Vec<usize> = (-2..6).map(|index| wrapped(index, 4, wrap)).collect();
        assert_eq!(texels, expected, "{wrap:?}");
        assert_eq!(wrapped(i64::from(u32::MAX), 1, wrap), 0);
    }
}

/// A ramp with a jump at its seam: only the wrapped filter sees the other side.
#[test]
fn kaiser_reads_across_a_repeating_border() {
    let plane = Plane {
        width: 64,
        height: 1,
        texels: (0..64).map(|x| [0.25 + 0.5 * x as f32 / 63.0; 4]).collect(),
    };
    let first = |wrap| {
        let half = halve(
            &plane,
            MipFilter::Kaiser,
            [wrap, Wrap::Repeat],
            Weighting::Plain,
        );
        (half.texels[0][0], half.texels[16][0])
    };
    let (repeat, clamp, mirror) = (
        first(Wrap::Repeat),
        first(Wrap::ClampToEdge),
        first(Wrap::MirroredRepeat),
    );
    assert_eq!(repeat.1, clamp.1);
    assert!((clamp.0 - mirror.0).abs() < 0.02);
    assert!((repeat.0 - clamp.0).abs() > 0.01, "{repeat:?} {clamp:?}");
}

#[test]
fn kaiser_keeps_constants_and_stays_in_range() {
    for (width, height) in [(1, 1), (2, 2), (7, 5), (64, 31)] {
        let flat = Plane {
            width,
            height,
            texels: vec![[0.3, 0.6, 1.0, 1.0]; (width * height) as usize],
        };
        let mut steps = flat.clone();
        for (index, texel) in steps.texels.iter_mut().enumerate() {
            *texel = [if index % width as usize > width as usize / 2 {
                1.0
            } else {
                0.0
            }; 4];
        }
        for wrap in WRAPS {
            let half = halve(&flat, MipFilter::Kaiser, [wrap; 2], Weighting::Plain);
            for texel in half.texels {
                for (value, expected) in texel.into_iter().zip([0.3, 0.6, 1.0, 1.0]) {
                    assert!((value - expected).abs() < 1e-5);
                }
            }
            for weighting in [Weighting::Plain, Weighting::Alpha] {
                let half = halve(&steps, MipFilter::Kaiser, [wrap; 2], weighting);
                let in_range = |value: &f32| (0.0..=1.0).contains(value);
                assert!(half.texels.as_flattened().iter().all(in_range));
            }
        }
    }
}

/// RMS of what a halving leaves of a wave of `frequency` cycles a source texel, relative to the wave.
fn response(filter: MipFilter, frequency: f64) -> f64 {
    let wave = |x: f64| libm::sin(std::f64::consts::TAU * frequency * x + 0.3);
    let plane = Plane {
        width: 1000,
        height: 1,
        texels: (0..1000)
            .map(|x| [wave(f64::from(x) + 0.5) as f32; 4])
            .collect(),
    };
    let half = halve(&plane, filter, [Wrap::Repeat; 2], Weighting::Signed);
    let power: f64 = half
        .texels
        .iter()
        .map(|texel| f64::from(texel[0]).powi(2))
        .sum();
    (2.0 * power / half.texels.len() as f64).sqrt()
}

/// Waves above a quarter cycle a texel cannot be held by the half-size image: what is left of them is alias.
#[test]
fn kaiser_passes_more_and_aliases_less_than_box() {
    let (pass, alias) = (0.15, 0.4);
    let boxed = (
        response(MipFilter::Box, pass),
        response(MipFilter::Box, alias),
    );
    let kaiser = (
        response(MipFilter::Kaiser, pass),
        response(MipFilter::Kaiser, alias),
    );
    assert!((boxed.0 - libm::cos(std::f64::consts::PI * pass)).abs() < 1e-3);
    assert!((boxed.1 - libm::cos(std::f64::consts::PI * alias)).abs() < 1e-3);
    assert!((kaiser.0 - 1.0).abs() < 0.02, "{kaiser:?}");
    assert!(kaiser.1 < 0.02, "{kaiser:?}");
}
