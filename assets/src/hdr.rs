//! Radiance RGBE picture files.

use libm::{floor, frexp, ldexp};

/// Shared-exponent encoding of one linear colour, mantissas rounded to nearest (Ward, "Real Pixels", Graphics Gems II).
///
/// Components are finite and not negative; the error is at most 1/256 of the largest one.
pub fn encode_rgbe(rgb: [f64; 3]) -> [u8; 4] {
    let largest = rgb[0].max(rgb[1]).max(rgb[2]);
    if largest < 1e-32 {
        return [0; 4];
    }
    let (_, mut exponent) = frexp(largest);
    if floor(ldexp(largest, 8 - exponent) + 0.5) > 255.0 {
        exponent += 1;
    }
    let mantissa = |c: f64| floor(ldexp(c, 8 - exponent) + 0.5) as u8;
    [
        mantissa(rgb[0]),
        mantissa(rgb[1]),
        mantissa(rgb[2]),
        (exponent + 128) as u8,
    ]
}

/// The linear colour of one RGBE texel.
pub fn decode_rgbe(rgbe: [u8; 4]) -> [f64; 3] {
    if rgbe[3] == 0 {
        return [0.0; 3];
    }
    let exponent = i32::from(rgbe[3]) - 136;
    [rgbe[0], rgbe[1], rgbe[2]].map(|m| ldexp(f64::from(m), exponent))
}

/// Appends one channel of a scan line in the adaptive run-length code: runs of 4 to 127, literals of up to 128.
fn push_runs(out: &mut Vec<u8>, line: &[u8]) {
    const SHORTEST_RUN: usize = 4;
    let run_at = |start: usize| {
        let value = line[start];
        line[start..]
            .iter()
            .take(127)
            .take_while(|&&b| b == value)
            .count()
    };
    let mut at = 0;
    while at < line.len() {
        let run = run_at(at);
        if run >= SHORTEST_RUN {
            out.extend([128 + run as u8, line[at]]);
            at += run;
            continue;
        }
        let start = at;
        while at < line.len() && at - start < 128 && run_at(at) < SHORTEST_RUN {
            at += 1;
        }
        out.push((at - start) as u8);
        out.extend(&line[start..at]);
    }
}

/// A whole `.hdr` file from RGBE texels, top row first; `width` is 8..=32767, as the run-length code needs.
pub fn encode_hdr(width: usize, height: usize, texels: &[[u8; 4]]) -> Vec<u8> {
    assert!((8..=32767).contains(&width) && texels.len() == width * height);
    let mut out = format!(
        "#?RADIANCE\nSOFTWARE=cairn-assets\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n"
    )
    .into_bytes();
    for row in texels.chunks(width) {
        out.extend([2, 2, (width >> 8) as u8, width as u8]);
        for channel in 0..4 {
            let line: Vec<u8> = row.iter().map(|texel| texel[channel]).collect();
            push_runs(&mut out, &line);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rgbe_round_trip_is_within_its_bound() {
        let mut worst: f64 = 0.0;
        for i in 0..4000 {
            let large = libm::pow(10.0, f64::from(i) / 4000.0 * 9.0 - 4.0);
            let rgb = [large, large * 0.37, large * 0.011];
            let back = decode_rgbe(encode_rgbe(rgb));
            for (a, b) in rgb.iter().zip(back) {
                worst = worst.max((a - b).abs() / large);
            }
        }
        assert!(worst <= 1.0 / 256.0, "{worst}");
        assert!(
            worst > 1.0 / 600.0,
            "the bound is near what happens: {worst}"
        );
        assert_eq!(decode_rgbe(encode_rgbe([0.0; 3])), [0.0; 3]);
        assert_eq!(decode_rgbe(encode_rgbe([0.9999, 0.0, 0.0]))[0], 1.0);
    }

    #[test]
    fn runs_decode_to_the_line() {
        let mut line: Vec<u8> = vec![9; 300];
        line.extend((0..200).map(|i| (i * 7) as u8));
        line.extend([1, 1, 1, 2, 2, 2, 2, 3]);
        let mut code = Vec::new();
        push_runs(&mut code, &line);
        let (mut back, mut at) = (Vec::new(), 0);
        while at < code.len() {
            let count = usize::from(code[at]);
            if count > 128 {
                back.resize(back.len() + count - 128, code[at + 1]);
                at += 2;
            } else {
                back.extend(&code[at + 1..=at + count]);
                at += 1 + count;
            }
        }
        assert_eq!(back, line);
        assert!(code.len() < line.len());
    }
}
