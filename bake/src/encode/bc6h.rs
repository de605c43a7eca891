//! BC6H blocks from half floats, unsigned, with the same bytes on every machine.
//!
//! Format: Khronos Data Format Specification 1.3, section 20.2. The four modes of one region are tried: 10-bit
//! endpoints, and 11, 12 and 16 bits with a difference of 9, 8 and 4. The squared error of the half floats' bits
//! is made small, which is close to that of the logarithm. Only additions, products, divisions and square
//! roots in a fixed order.

/// Mode code, bits of an endpoint, bits of the difference (0: the second endpoint stands for itself).
const MODES: [(u128, u32, u32); 4] = [(3, 10, 0), (7, 11, 9), (11, 12, 8), (15, 16, 4)];
/// Interpolation weights of 4-bit indices, of 64.
const WEIGHTS: [i32; 16] = [0, 4, 9, 13, 17, 21, 26, 30, 34, 38, 43, 47, 51, 55, 60, 64];
/// Largest finite half, as bits.
const LARGEST: u16 = 0x7bff;
/// Rounds of least squares after the first fit.
const ROUNDS: usize = 3;

/// A line in the space of unquantised endpoints (0..=65535).
type Line = [[f32; 3]; 2];

/// One way to store a block.
struct Way {
    error: i64,
    mode: usize,
    ends: [[i32; 3]; 2],
    indices: [usize; 16],
}

/// Compresses 16 RGB texels of non-negative half bits, rows of four; bits above the largest finite half are
/// clamped to it.
pub(super) fn compress_block(texels: &[[u16; 3]; 16]) -> [u8; 16] {
    let texels = texels.map(|texel| texel.map(|bits| bits.min(LARGEST)));
    // The decoder multiplies by 31 / 64.
    let values = texels.map(|texel| texel.map(|bits| (f32::from(bits) + 0.5) * (64.0 / 31.0)));
    let mut line = principal(&values);
    let mut best: Option<Way> = None;
    for _ in 0..=ROUNDS {
        for mode in 0..MODES.len() {
            let way = way(&texels, &line, mode);
            if let Some(way) = way
                && best.as_ref().is_none_or(|best| way.error < best.error)
            {
                best = Some(way);
            }
        }
        let Some(found) = &best else { break };
        line = least_squares(&values, &found.indices, &found_line(found));
    }
    // Mode 0 holds every pair of endpoints.
    best.map_or([0; 16], |best| pack(&best))
}

/// The line through the mean along the axis of largest variance, as far as the texels reach.
fn principal(values: &[[f32; 3]; 16]) -> Line {
    let mut mean = [0.0; 3];
    for value in values {
        for (sum, channel) in mean.iter_mut().zip(value) {
            *sum += channel / 16.0;
        }
    }
    let centred = values.map(|value| [0, 1, 2].map(|k| value[k] - mean[k]));
    let mut covariance = [[0.0_f32; 3]; 3];
    for value in &centred {
        for (row, a) in covariance.iter_mut().zip(value) {
            for (sum, b) in row.iter_mut().zip(value) {
                *sum += a * b;
            }
        }
    }
    let mut axis = [1.0_f32; 3];
    for _ in 0..6 {
        let next = covariance.map(|row| row[0] * axis[0] + row[1] * axis[1] + row[2] * axis[2]);
        let length = (next[0] * next[0] + next[1] * next[1] + next[2] * next[2]).sqrt();
        if length <= 0.0 || !length.is_finite() {
            break;
        }
        axis = next.map(|channel| channel / length);
    }
    let norm = axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2];
    let (mut low, mut high) = (0.0_f32, 0.0_f32);
    for value in &centred {
        let at = (value[0] * axis[0] + value[1] * axis[1] + value[2] * axis[2]) / norm;
        low = low.min(at);
        high = high.max(at);
    }
    [low, high].map(|at| [0, 1, 2].map(|k| (mean[k] + at * axis[k]).clamp(0.0, 65535.0)))
}

/// Endpoints that fit the texels best under given indices; the old ones where all indices are alike.
fn least_squares(values: &[[f32; 3]; 16], indices: &[usize; 16], old: &Line) -> Line {
    let (mut aa, mut ab, mut bb) = (0.0_f32, 0.0_f32, 0.0_f32);
    let (mut at, mut bt) = ([0.0_f32; 3], [0.0_f32; 3]);
    for (value, &index) in values.iter().zip(indices) {
        let b = WEIGHTS[index] as f32 / 64.0;
        let a = 1.0 - b;
        aa += a * a;
        ab += a * b;
        bb += b * b;
        for k in 0..3 {
            at[k] += a * value[k];
            bt[k] += b * value[k];
        }
    }
    let determinant = aa * bb - ab * ab;
    if determinant < 1e-4 {
        return *old;
    }
    let first = [0, 1, 2].map(|k| (bb * at[k] - ab * bt[k]) / determinant);
    let second = [0, 1, 2].map(|k| (aa * bt[k] - ab * at[k]) / determinant);
    [first, second].map(|end| end.map(|channel| channel.clamp(0.0, 65535.0)))
}

fn found_line(way: &Way) -> Line {
    let bits = MODES[way.mode].1;
    way.ends
        .map(|end| end.map(|channel| unquantize(channel, bits) as f32))
}

/// The unquantised 16-bit value of a stored endpoint.
fn unquantize(stored: i32, bits: u32) -> i32 {
    let largest = (1 << bits) - 1;
    match stored {
        0 => 0,
        _ if bits >= 15 => stored,
        _ if stored == largest => 0xffff,
        _ => ((stored << 16) + 0x8000) >> bits,
    }
}

fn palette(ends: &[[i32; 3]; 2], bits: u32) -> [[i32; 3]; 16] {
    let full = ends.map(|end| end.map(|channel| unquantize(channel, bits)));
    WEIGHTS.map(|weight| {
        [0, 1, 2].map(|k| {
            let mixed = (full[0][k] * (64 - weight) + full[1][k] * weight + 32) >> 6;
            (mixed * 31) >> 6
        })
    })
}

/// The line stored in a mode; `None` where the difference of the endpoints does not fit.
fn way(texels: &[[u16; 3]; 16], line: &Line, mode: usize) -> Option<Way> {
    let (_, bits, difference) = MODES[mode];
    let mut ends = line.map(|end| end.map(|channel| channel as i32 >> (16 - bits)));
    let colors = palette(&ends, bits);
    let mut error = 0;
    let mut indices = [0; 16];
    for (texel, index) in texels.iter().zip(&mut indices) {
        let mut least = i64::MAX;
        for (candidate, color) in colors.iter().enumerate() {
            let distance = [0, 1, 2].map(|k| i64::from(color[k] - i32::from(texel[k])));
            let squared = distance.iter().map(|d| d * d).sum();
            if squared < least {
                (least, *index) = (squared, candidate);
            }
        }
        error += least;
    }
    // The first index has three bits: its highest is zero.
    if indices[0] >= 8 {
        ends.swap(0, 1);
        indices = indices.map(|index| 15 - index);
    }
    let half = 1 << (difference.max(1) - 1);
    let fits = |k: usize| (-half..half).contains(&(ends[1][k] - ends[0][k]));
    (difference == 0 || (0..3).all(fits)).then_some(Way {
        error,
        mode,
        ends,
        indices,
    })
}

fn pack(way: &Way) -> [u8; 16] {
    let (code, bits, difference) = MODES[way.mode];
    let mut block = code;
    let mut at = 5;
    let mut put = |value: u128, count: u32| {
        block |= (value & ((1 << count) - 1)) << at;
        at += count;
    };
    for channel in way.ends[0] {
        put(channel as u128, 10);
    }
    for k in 0..3 {
        let (first, second) = (way.ends[0][k], way.ends[1][k]);
        if difference == 0 {
            put(second as u128, 10);
            continue;
        }
        put((second - first) as u128, difference);
        // High bits of the first endpoint, the highest first.
        for bit in (10..bits).rev() {
            put((first >> bit) as u128, 1);
        }
    }
    put(way.indices[0] as u128, 3);
    for index in &way.indices[1..] {
        put(*index as u128, 4);
    }
    block.to_le_bytes()
}

/// The 16 texels of a block, as half bits.
pub(super) fn decompress_block(block: &[u8; 16]) -> [[u16; 3]; 16] {
    let mut texels = [[0_u16; 3]; 16];
    bcdec_rs::bc6h_half(block, texels.as_flattened_mut(), 12, false);
    texels
}

#[cfg(test)]
mod tests {
    use half::f16;

    use super::*;

    fn bits(value: f32) -> u16 {
        f16::from_f32(value).to_bits()
    }

    fn error(texels: &[[u16; 3]; 16]) -> f64 {
        let decoded = decompress_block(&compress_block(texels));
        let pairs = texels.as_flattened().iter().zip(decoded.as_flattened());
        pairs
            .map(|(&a, &b)| {
                let (a, b) = (f16::from_bits(a).to_f64(), f16::from_bits(b).to_f64());
                (a - b).abs() / a.max(1e-4)
            })
            .fold(0.0, f64::max)
    }

    #[test]
    fn constant_blocks_are_exact_to_a_bit() {
        for value in [0.0, 1e-3, 0.18, 1.0, 777.0, 65504.0] {
            let texels = [[bits(value), bits(0.5 * value), bits(0.25 * value)]; 16];
            let decoded = decompress_block(&compress_block(&texels));
            for (a, b) in texels.as_flattened().iter().zip(decoded.as_flattened()) {
                assert!(a.abs_diff(*b) <= 1, "{value}: {a} {b}");
            }
        }
    }

    #[test]
    fn every_mode_is_decoded_as_it_was_meant() {
        let mut used = [false; 4];
        for spread in [0, 3, 12, 60, 400, 3000] {
            for base in [300, 9000, 20_000, 31_000_u16] {
                let texels: [[u16; 3]; 16] = std::array::from_fn(|i| {
                    let step = |k: u16| (base + spread * (i as u16 ^ (5 * k)) / 4).min(LARGEST);
                    [step(0), step(1), step(2)]
                });
                let values = texels.map(|t| t.map(|b| (f32::from(b) + 0.5) * (64.0 / 31.0)));
                let line = principal(&values);
                for (mode, used) in used.iter_mut().enumerate() {
                    let Some(way) = way(&texels, &line, mode) else {
                        continue;
                    };
                    *used = true;
                    let colors = palette(&way.ends, MODES[mode].1);
                    let expected = way.indices.map(|index| colors[index].map(|c| c as u16));
                    assert_eq!(decompress_block(&pack(&way)), expected, "mode {mode}");
                }
            }
        }
        assert_eq!(used, [true; 4]);
    }

    #[test]
    fn gradients_are_close() {
        let texels = std::array::from_fn(|i| {
            let value = 1.0 + 0.01 * i as f32;
            [bits(value), bits(0.8 * value), bits(0.3 * value)]
        });
        assert!(error(&texels) < 5e-3, "{}", error(&texels));
    }

    #[test]
    fn bits_above_half_are_clamped() {
        let decoded = decompress_block(&compress_block(&[[0x7c00, 0xffff, 0]; 16]));
        assert!(decoded.iter().all(|t| t[0] <= LARGEST && t[1] <= LARGEST));
        assert!(decoded.iter().all(|t| t[0] >= LARGEST - 1 && t[2] == 0));
    }
}
