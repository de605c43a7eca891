//! BC5 and BC4 blocks from f32 values, by a search of the endpoints.
//!
//! Each channel of BC5 is a BC4 block: two 8-bit endpoints and eight evenly spaced levels between them (Khronos Data
//! Format Specification 1.3, section 19). The GPU interpolates finer than 8 bits, so that values between two
//! codes survive in smooth blocks; encoders that read 8-bit texels lose them. Only additions, products,
//! divisions and roundings: the bytes are the same on every machine.

/// Bound on the descent, which gains less each time; it seldom takes ten steps.
const MOST_STEPS: usize = 32;

/// Compresses 16 texels of two channels in [0,1] (values outside are clamped), rows of four.
pub(super) fn compress_block(texels: &[[f32; 2]; 16]) -> [u8; 16] {
    let mut block = [0; 16];
    for channel in 0..2 {
        let values = texels.map(|texel| texel[channel]);
        block[channel * 8..][..8].copy_from_slice(&compress_channel(&values));
    }
    block
}

/// Compresses 16 values in [0,1] to BC4.
pub(super) fn compress_channel(texels: &[f32; 16]) -> [u8; 8] {
    let values = texels.map(|value| (value * 255.0).clamp(0.0, 255.0));
    pack(&search(&values), &values)
}

/// A candidate: endpoints in 8-bit codes, `low < high`, and its squared error.
#[derive(Clone, Copy)]
struct Candidate {
    low: i32,
    high: i32,
    error: f32,
}

impl Candidate {
    fn new(low: i32, high: i32, values: &[f32; 16]) -> Self {
        let levels = levels(low, high, values);
        let step = (high - low) as f32 / 7.0;
        let mut error = 0.0;
        for (value, level) in values.iter().zip(levels) {
            let difference = low as f32 + level * step - value;
            error += difference * difference;
        }
        Self { low, high, error }
    }

    /// Replaces `self` where the other endpoints are valid and better.
    fn improve(&mut self, low: i32, high: i32, values: &[f32; 16]) -> bool {
        if low < 0 || high > 255 || low >= high {
            return false;
        }
        let other = Self::new(low, high, values);
        let better = other.error < self.error;
        if better {
            *self = other;
        }
        better
    }
}

/// The nearest of the eight levels (0 at `low`, 7 at `high`) of each value.
fn levels(low: i32, high: i32, values: &[f32; 16]) -> [f32; 16] {
    let inverse = 7.0 / (high - low) as f32;
    // Adding 1.5 * 2^23 leaves no fraction bits: rounding without a call, which baseline x86-64 would need.
    const ROUND: f32 = 12_582_912.0;
    values.map(|value| ((value - low as f32) * inverse).clamp(0.0, 7.0) + ROUND - ROUND)
}

/// From the extremes, through the least-squares fit at their levels, down to a local minimum.
fn search(values: &[f32; 16]) -> Candidate {
    let (least, most) = values
        .iter()
        .fold((255.0_f32, 0.0_f32), |(least, most), &v| {
            (least.min(v), most.max(v))
        });
    let low = (least.floor() as i32).min(254);
    let high = (most.ceil() as i32).max(low + 1);
    let mut best = Candidate::new(low, high, values);
    best.improve(least.round() as i32, most.round() as i32, values);
    if let Some([low, high]) = least_squares(&best, values) {
        let (low, high) = (low.floor() as i32, high.floor() as i32);
        for (low, high) in [
            (low, high),
            (low, high + 1),
            (low + 1, high),
            (low + 1, high + 1),
        ] {
            best.improve(low, high, values);
        }
    }
    for _ in 0..MOST_STEPS {
        let from = best;
        for (low, high) in [
            (-1, 0),
            (1, 0),
            (0, -1),
            (0, 1),
            (-1, -1),
            (1, 1),
            (1, -1),
            (-1, 1),
        ] {
            best.improve(from.low + low, from.high + high, values);
        }
        if (best.low, best.high) == (from.low, from.high) {
            break;
        }
    }
    best
}

/// The endpoints that fit the values best at the levels of a candidate; none where all share one level.
fn least_squares(candidate: &Candidate, values: &[f32; 16]) -> Option<[f32; 2]> {
    let (mut aa, mut ab, mut bb, mut av, mut bv) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for (&value, level) in values
        .iter()
        .zip(levels(candidate.low, candidate.high, values))
    {
        let b = level / 7.0;
        let a = 1.0 - b;
        aa += a * a;
        ab += a * b;
        bb += b * b;
        av += a * value;
        bv += b * value;
    }
    let determinant = aa * bb - ab * ab;
    (determinant > 1e-3).then(|| {
        [
            (av * bb - bv * ab) / determinant,
            (bv * aa - av * ab) / determinant,
        ]
    })
}

/// The first endpoint is the larger, which selects eight levels; codes 0 and 1 are the endpoints, 2 to 7
/// run from the first to the second.
fn pack(candidate: &Candidate, values: &[f32; 16]) -> [u8; 8] {
    let mut bits = candidate.high as u64 | (candidate.low as u64) << 8;
    for (texel, level) in levels(candidate.low, candidate.high, values)
        .into_iter()
        .enumerate()
    {
        let code = match level as u64 {
            7 => 0,
            0 => 1,
            level => 8 - level,
        };
        bits |= code << (16 + 3 * texel);
    }
    bits.to_le_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn decode(block: &[u8; 16]) -> [[f32; 2]; 16] {
        let mut values = [[0.0_f32; 2]; 16];
        bcdec_rs::bc5_float(block, values.as_flattened_mut(), 8, false);
        values
    }

    fn squared_error(block: &[u8; 16], texels: &[[f32; 2]; 16]) -> f64 {
        decode(block)
            .as_flattened()
            .iter()
            .zip(texels.as_flattened())
            .map(|(a, b)| f64::from(a - b).powi(2))
            .sum()
    }

    #[test]
    fn codes_are_exact_where_flat() {
        for code in 0..=255_u8 {
            let value = f32::from(code) / 255.0;
            let texels = [[value, 1.0 - value]; 16];
            for texel in decode(&compress_block(&texels)) {
                assert!((texel[0] - value).abs() < 1e-6, "{code}");
                assert!((texel[1] - (1.0 - value)).abs() < 1e-6, "{code}");
            }
        }
    }

    #[test]
    fn values_between_codes_survive() {
        for texel in decode(&compress_block(&[[0.5, 100.3 / 255.0]; 16])) {
            assert!((texel[0] - 0.5).abs() * 255.0 < 0.08);
            assert!((texel[1] * 255.0 - 100.3).abs() < 0.08);
        }
    }

    #[test]
    fn a_ramp_of_the_levels_is_exact() {
        let texels: [[f32; 2]; 16] = std::array::from_fn(|texel| {
            let level = (texel % 8) as f32 / 7.0;
            [
                (40.0 + 60.0 * level) / 255.0,
                (200.0 - 170.0 * level) / 255.0,
            ]
        });
        assert!(squared_error(&compress_block(&texels), &texels) < 1e-10);
    }

    #[test]
    fn hostile_values_are_clamped() {
        let texels = [[f32::NAN, f32::INFINITY]; 16];
        for texel in decode(&compress_block(&texels)) {
            assert!((0.0..=1.0).contains(&texel[0]));
            assert_eq!(texel[1], 1.0);
        }
    }

    proptest! {
        #[test]
        fn no_neighbouring_endpoints_are_better(values in any::<[u8; 16]>(), fraction in 0.0_f32..1.0) {
            let values = values.map(|value| (f32::from(value) + fraction).min(255.0));
            let found = search(&values);
            for low in found.low - 1..=found.low + 1 {
                for high in found.high - 1..=found.high + 1 {
                    prop_assert!(!{ found }.improve(low, high, &values), "{low} {high}");
                }
            }
        }

        /// No worse than rounding to the levels between the extremes, the plain way of doing it.
        #[test]
        fn no_worse_than_the_extremes(base in 0.0_f32..1.0, spread in 0.0_f32..0.5, seed in any::<[u8; 16]>()) {
            let texels = seed.map(|byte| {
                let jitter = spread * f32::from(byte) / 255.0;
                [(base + jitter).min(1.0), (base - jitter).max(0.0)]
            });
            let mut plain = [0; 16];
            for channel in 0..2 {
                let values = texels.map(|texel| texel[channel] * 255.0);
                let low = values.iter().copied().fold(255.0_f32, f32::min).round() as i32;
                let high = values.iter().copied().fold(0.0_f32, f32::max).round() as i32;
                let (low, high) = if low == high { (low.min(254), low.min(254) + 1) } else { (low, high) };
                let block = pack(&Candidate::new(low, high, &values), &values);
                plain[channel * 8..][..8].copy_from_slice(&block);
            }
            let searched = squared_error(&compress_block(&texels), &texels);
            let plain = squared_error(&plain, &texels);
            prop_assert!(searched <= plain * 1.001 + 1e-9, "{searched} {plain}");
        }
    }
}
