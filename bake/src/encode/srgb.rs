//! The sRGB transfer function (IEC 61966-2-1), exact to the nearest 8-bit code.

use std::sync::OnceLock;

/// Buckets of the first guess of `encode_u8`; the steepest part of the curve crosses one code a bucket.
const BUCKETS: usize = 4096;

struct Tables {
    /// Linear value of every 16-bit code.
    linear16: Vec<f32>,
    /// Linear value of every 8-bit code.
    linear8: [f32; 256],
    /// `thresholds[k]`: the least linear value that rounds to code `k + 1`.
    thresholds: [f32; 255],
    /// The code of each bucket's lower bound.
    first: Vec<u8>,
}

/// Encoded value in [0,1] to linear light, in f64.
pub fn decode_f64(encoded: f64) -> f64 {
    if encoded <= 0.04045 {
        encoded / 12.92
    } else {
        libm::pow((encoded + 0.055) / 1.055, 2.4)
    }
}

/// Linear light in [0,1] to the encoded value, in f64.
pub fn encode_f64(linear: f64) -> f64 {
    if linear <= 0.003_130_8 {
        linear * 12.92
    } else {
        1.055 * libm::pow(linear, 1.0 / 2.4) - 0.055
    }
}

fn tables() -> &'static Tables {
    static TABLES: OnceLock<Tables> = OnceLock::new();
    TABLES.get_or_init(|| {
        let linear16 = (0..=u16::MAX)
            .map(|code| decode_f64(f64::from(code) / 65535.0) as f32)
            .collect();
        let linear8 = std::array::from_fn(|code| decode_f64(code as f64 / 255.0) as f32);
        let thresholds: [f32; 255] =
            std::array::from_fn(|code| decode_f64((code as f64 + 0.5) / 255.0) as f32);
        let first = (0..=BUCKETS)
            .map(|bucket| {
                let low = bucket as f32 / BUCKETS as f32;
                thresholds.partition_point(|&threshold| threshold <= low) as u8
            })
            .collect();
        Tables {
            linear16,
            linear8,
            thresholds,
            first,
        }
    })
}

/// Linear light in [0,1] of a 16-bit code (an 8-bit code times 257).
pub fn decode_u16(code: u16) -> f32 {
    tables().linear16[usize::from(code)]
}

/// Linear light in [0,1] of an 8-bit code.
pub fn decode_u8(code: u8) -> f32 {
    tables().linear8[usize::from(code)]
}

/// The nearest 8-bit code of a linear value, halves rounded up in the encoded scale; clamps to [0,1],
/// and NaN gives 0.
pub fn encode_u8(linear: f32) -> u8 {
    let tables = tables();
    // NaN passes the clamp, converts to bucket 0 and fails every comparison.
    let linear = linear.clamp(0.0, 1.0);
    let mut code = tables.first[(linear * BUCKETS as f32) as usize];
    while code < 255 && linear >= tables.thresholds[usize::from(code)] {
        code += 1;
    }
    code
}

/// Linear light to the encoded value in [0,1], not quantised.
pub fn encode(linear: f32) -> f32 {
    encode_f64(f64::from(linear.clamp(0.0, 1.0))) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn every_code_survives_the_round_trip() {
        for code in 0..=255_u8 {
            assert_eq!(encode_u8(decode_u8(code)), code);
            assert_eq!(encode_u8(decode_u16(u16::from(code) * 257)), code);
            assert!((encode(decode_u8(code)) * 255.0 - f32::from(code)).abs() < 1e-3);
        }
    }

    #[test]
    fn known_values() {
        assert_eq!(encode_u8(0.5), 188);
        assert_eq!(encode_u8(0.0), 0);
        assert_eq!(encode_u8(1.0), 255);
        assert_eq!(encode_u8(-3.0), 0);
        assert_eq!(encode_u8(7.0), 255);
        assert_eq!(encode_u8(f32::NAN), 0);
        assert!((decode_f64(0.5) - 0.214_041_140_482_232_55).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn code_is_the_nearest(linear in 0.0_f32..=1.0) {
            let exact = encode_f64(f64::from(linear)) * 255.0;
            let code = f64::from(encode_u8(linear));
            prop_assert!((code - exact).abs() <= 0.5 + 1e-4, "{linear}: {code} for {exact}");
        }
    }
}
