//! Arc cosines that equal `libm::acos` rounded to f32, many at a time.

use std::f64::consts::{FRAC_PI_2, PI};

/// (asin(x) / x - 1) / x^2 as a polynomial in x^2, interpolated at Chebyshev nodes of 0..1/4; with it the relative
/// error of the arc sine is below 2e-15.
#[allow(clippy::excessive_precision)]
const ARC_SINE: [f64; 12] = [
    0.166_666_666_666_666_13,
    0.075_000_000_000_414_46,
    0.044_642_857_081_406_695,
    0.030_381_948_326_758_366,
    0.022_372_025_883_025_046,
    0.017_355_543_175_654_02,
    0.013_927_471_697_873_743,
    0.011_884_982_387_224_833,
    0.007_785_152_023_037_279,
    0.016_016_324_361_165_363,
    -0.010_608_037_312_825_521,
    0.027_994_791_666_666_668,
];

/// Relative distance within which the fast value does not decide the rounding.
const DOUBT: f64 = 1e-12;

/// Within a few 1e-15 of the arc cosine, relatively, for -1..1.
#[inline(always)]
fn approximate(x: f64) -> f64 {
    let magnitude = x.abs();
    let inner = magnitude <= 0.5;
    let z = if inner {
        x * x
    } else {
        (1.0 - magnitude) * 0.5
    };
    let mut polynomial = ARC_SINE[11];
    let mut term = 11;
    while term > 0 {
        term -= 1;
        polynomial = polynomial * z + ARC_SINE[term];
    }
    let root = if inner { x } else { z.sqrt() };
    let sine = root + root * z * polynomial;
    let outer = if x < 0.0 { PI - 2.0 * sine } else { 2.0 * sine };
    if inner { FRAC_PI_2 - sine } else { outer }
}

/// Replaces every value by its arc cosine; bit for bit `libm::acos(x.into()) as f32`.
pub(super) fn in_place<const N: usize>(values: &mut [f32; N]) {
    let (mut low, mut high) = ([0.0f32; N], [0.0f32; N]);
    for lane in 0..N {
        let angle = approximate(f64::from(values[lane]));
        low[lane] = (angle * (1.0 - DOUBT)) as f32;
        high[lane] = (angle * (1.0 + DOUBT)) as f32;
    }
    for lane in 0..N {
        // NaN lands here as well.
        values[lane] = if low[lane] == high[lane] {
            low[lane]
        } else {
            exact(values[lane])
        };
    }
}

/// Arc cosine of `libm`, in f64 as the reference evaluates it, so that every platform gives the same bits.
pub(super) fn exact(x: f32) -> f32 {
    libm::acos(f64::from(x)) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(values: [f32; 8]) {
        let mut fast = values;
        in_place(&mut fast);
        let slow = values.map(exact);
        assert_eq!(fast.map(f32::to_bits), slow.map(f32::to_bits), "{values:?}");
    }

    #[test]
    fn bits_equal_libm_all_over_the_range() {
        // Every 997th float of 0..=1 with both signs, then all of those next to the joints of the formula.
        let one = 1.0f32.to_bits();
        for bits in (0..=one).step_by(997) {
            let x = f32::from_bits(bits);
            let near = f32::from_bits(one - bits);
            check([x, -x, near, -near, x, -x, near, -near]);
        }
        for joint in [0.5f32, 1.0, f32::MIN_POSITIVE, 0.25] {
            for step in 0..2000 {
                let x = f32::from_bits(joint.to_bits() - step);
                let y = f32::from_bits((joint.to_bits() + step).min(one));
                check([x, -x, y, -y, 0.0, -0.0, 1.0, -1.0]);
            }
        }
    }

    #[test]
    fn nan_stays_nan() {
        let mut values = [f32::NAN, 0.0];
        in_place(&mut values);
        assert!(values[0].is_nan());
        assert_eq!(values[1], std::f32::consts::FRAC_PI_2);
    }
}
