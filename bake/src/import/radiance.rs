//! Decodes Radiance pictures (`.hdr`, RGBE) to linear RGB.
//!
//! Format: G. Ward, "Real Pixels", Graphics Gems II, and the Radiance file format document.

/// A decoded picture, row 0 at the top.
#[derive(Debug, PartialEq)]
pub(super) struct Picture {
    pub width: u32,
    pub height: u32,
    pub texels: Vec<[f32; 3]>,
    /// Header entries that change the meaning of the values and are not applied.
    pub ignored: Vec<String>,
}

/// A fault at a byte offset.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Fault {
    pub offset: usize,
    pub message: String,
}

/// Whether the bytes claim to be a Radiance picture.
pub(super) fn is_radiance(bytes: &[u8]) -> bool {
    bytes.starts_with(b"#?")
}

/// Decodes flat, old and new run-length-encoded scanlines. Values are `mantissa * 2^(e - 136)`.
/// Memory grows with the scanlines really present.
///
/// # Errors
/// A broken or cut file, XYZE colours, an orientation other than `-Y +X`, or more than
/// `limit_pixels` pixels.
pub(super) fn decode(bytes: &[u8], limit_pixels: u64) -> Result<Picture, Fault> {
    let mut reader = Reader { bytes, offset: 0 };
    let ignored = header(&mut reader)?;
    let (width, height) = resolution(&mut reader)?;
    let pixels = u64::from(width) * u64::from(height);
    if pixels == 0 || pixels > limit_pixels {
        let message = format!(
            "{width}x{height} pixels are not within 1 and the limit of {limit_pixels}; resize it"
        );
        return reader.fault(message);
    }
    let mut scanline = vec![[0; 4]; width as usize];
    let mut texels = Vec::new();
    for _ in 0..height {
        read_scanline(&mut reader, &mut scanline)?;
        texels.extend(scanline.iter().map(|&rgbe| linear(rgbe)));
    }
    Ok(Picture {
        width,
        height,
        texels,
        ignored,
    })
}

struct Reader<'a> {
    bytes: &'a [u8],
    offset: usize,
}

impl Reader<'_> {
    fn fault<T>(&self, message: impl Into<String>) -> Result<T, Fault> {
        Err(Fault {
            offset: self.offset,
            message: message.into(),
        })
    }

    fn take<const N: usize>(&mut self) -> Result<[u8; N], Fault> {
        let tail = self.bytes.get(self.offset..).unwrap_or_default();
        match tail.first_chunk::<N>() {
            Some(chunk) => {
                self.offset += N;
                Ok(*chunk)
            }
            None => self.fault("the file is cut; copy or save it again"),
        }
    }

    /// The next line without its line end.
    fn line(&mut self) -> Result<String, Fault> {
        const LONGEST: usize = 4096;
        let tail = self.bytes.get(self.offset..).unwrap_or_default();
        let tail = &tail[..tail.len().min(LONGEST)];
        let Some(length) = tail.iter().position(|&byte| byte == b'\n') else {
            return self.fault("the header is cut; copy or save the file again");
        };
        self.offset += length + 1;
        let line = String::from_utf8_lossy(&tail[..length]);
        Ok(line.trim_end_matches('\r').to_owned())
    }
}

/// Reads the header up to its empty line; returns the entries that are not applied.
fn header(reader: &mut Reader<'_>) -> Result<Vec<String>, Fault> {
    let mut ignored = Vec::new();
    loop {
        let line = reader.line()?;
        if line.is_empty() {
            return Ok(ignored);
        }
        let Some((key, value)) = line.split_once('=') else {
            continue;
        };
        match (key.trim(), value.trim()) {
            ("FORMAT", "32-bit_rle_rgbe") => {}
            ("FORMAT", format) => {
                let message =
                    format!("the format {format} is not supported; save it as 32-bit_rle_rgbe");
                return reader.fault(message);
            }
            ("EXPOSURE" | "COLORCORR", value)
                if value
                    .split_whitespace()
                    .any(|number| number.parse() != Ok(1.0)) =>
            {
                ignored.push(line);
            }
            _ => {}
        }
    }
}

/// Reads the resolution line: width, height.
fn resolution(reader: &mut Reader<'_>) -> Result<(u32, u32), Fault> {
    let line = reader.line()?;
    let words: Vec<&str> = line.split_whitespace().collect();
    let number = |text: &str| text.parse::<u32>().ok();
    match words[..] {
        ["-Y", height, "+X", width] => match (number(width), number(height)) {
            (Some(width), Some(height)) => Ok((width, height)),
            _ => reader.fault(format!(
                "the size `{line}` is no pair of numbers; save it again"
            )),
        },
        ["-Y" | "+Y" | "-X" | "+X", _, "-Y" | "+Y" | "-X" | "+X", _] => reader.fault(format!(
            "the orientation `{line}` is not supported; save it as `-Y height +X width`"
        )),
        _ => reader.fault(format!(
            "`{line}` is no resolution line; save the file again"
        )),
    }
}

fn read_scanline(reader: &mut Reader<'_>, scanline: &mut [[u8; 4]]) -> Result<(), Fault> {
    let width = scanline.len();
    let first = reader.take::<4>()?;
    let [2, 2, high @ 0..128, low] = first else {
        return read_old(reader, first, scanline);
    };
    if !(8..=0x7fff).contains(&width) {
        return read_old(reader, first, scanline);
    }
    let length = usize::from(high) << 8 | usize::from(low);
    if length != width {
        let message =
            format!("a scanline of {length} pixels in a picture {width} wide; save it again");
        return reader.fault(message);
    }
    for component in 0..4 {
        read_component(reader, component, scanline)?;
    }
    Ok(())
}

/// One component of a run-length-encoded scanline: runs above 128, literals up to 128.
fn read_component(
    reader: &mut Reader<'_>,
    component: usize,
    scanline: &mut [[u8; 4]],
) -> Result<(), Fault> {
    let mut at = 0;
    while at < scanline.len() {
        let [code] = reader.take()?;
        let run = code > 128;
        let length = usize::from(if run { code - 128 } else { code });
        let Some(span) = scanline.get_mut(at..at + length) else {
            return reader.fault("a run passes the end of its scanline; save the file again");
        };
        if run {
            let [value] = reader.take()?;
            span.iter_mut().for_each(|pixel| pixel[component] = value);
        } else {
            for pixel in span {
                [pixel[component]] = reader.take()?;
            }
        }
        at += length;
    }
    Ok(())
}

/// A flat scanline, with the old scheme's markers (1, 1, 1, n) that repeat the pixel before;
/// consecutive markers are digits of one count, least significant first.
fn read_old(
    reader: &mut Reader<'_>,
    first: [u8; 4],
    scanline: &mut [[u8; 4]],
) -> Result<(), Fault> {
    let mut next = Some(first);
    let mut at = 0;
    let mut shift = 0;
    while at < scanline.len() {
        let pixel = match next.take() {
            Some(pixel) => pixel,
            None => reader.take::<4>()?,
        };
        if let [1, 1, 1, digit] = pixel {
            let count = usize::from(digit).checked_shl(shift).unwrap_or(usize::MAX);
            let end = at
                .checked_add(count)
                .filter(|&end| at > 0 && end <= scanline.len());
            let Some(end) = end.filter(|_| shift <= 24) else {
                return reader.fault("a run does not fit its scanline; save the file again");
            };
            let previous = scanline[at - 1];
            scanline[at..end].fill(previous);
            at = end;
            shift += 8;
        } else {
            scanline[at] = pixel;
            at += 1;
            shift = 0;
        }
    }
    Ok(())
}

/// RGBE to linear RGB, exact in f32 for every exponent.
fn linear([r, g, b, e]: [u8; 4]) -> [f32; 3] {
    if e == 0 {
        return [0.0; 3];
    }
    const F64_BIAS: u64 = 1023;
    let scale = f64::from_bits((F64_BIAS + u64::from(e) - 136) << 52);
    [r, g, b].map(|mantissa| (f64::from(mantissa) * scale) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(size: &str, data: &[u8]) -> Vec<u8> {
        let head = format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n{size}\n");
        [head.as_bytes(), data].concat()
    }

    fn texels(bytes: &[u8]) -> Vec<[f32; 3]> {
        decode(bytes, 1 << 20).unwrap().texels
    }

    #[test]
    fn exponents_are_exact() {
        assert_eq!(linear([128, 64, 1, 129]), [1.0, 0.5, 1.0 / 128.0]);
        assert_eq!(linear([255, 255, 255, 0]), [0.0; 3]);
        assert_eq!(linear([1, 0, 0, 1])[0], 2f32.powi(-135));
        assert_eq!(
            f64::from(linear([255, 0, 0, 255])[0]),
            255.0 * 2f64.powi(119)
        );
    }

    #[test]
    fn flat_and_old_runs_decode() {
        let data = [[128, 0, 0, 129], [1, 1, 1, 2], [0, 128, 0, 129]].concat();
        let red = [1.0, 0.0, 0.0];
        assert_eq!(
            texels(&picture("-Y 1 +X 4", &data)),
            [red, red, red, [0.0, 1.0, 0.0]]
        );
        let data = [[128, 0, 0, 129], [1, 1, 1, 1], [1, 1, 1, 1]].concat();
        assert_eq!(texels(&picture("-Y 1 +X 258", &data)), vec![red; 258]);
    }

    #[test]
    fn new_runs_decode() {
        let mut data = vec![2, 2, 0, 8];
        data.extend([128 + 8, 128]);
        data.extend([4, 1, 2, 3, 4, 128 + 4, 128]);
        data.extend([8, 0, 0, 0, 0, 0, 0, 0, 0]);
        data.extend([128 + 8, 129]);
        let texels = texels(&picture("-Y 1 +X 8", &data));
        assert_eq!(texels[1], [1.0, 2.0 / 128.0, 0.0]);
        assert_eq!(texels[7], [1.0, 1.0, 0.0]);
    }

    #[test]
    fn truncation_at_every_byte_is_an_error() {
        let data = [[128, 0, 0, 129], [1, 1, 1, 2], [0, 128, 0, 129]].concat();
        let bytes = picture("-Y 1 +X 4", &data);
        for length in 0..bytes.len() {
            assert!(decode(&bytes[..length], 1 << 20).is_err(), "{length}");
        }
    }

    #[test]
    fn hostile_pictures_are_refused() {
        let endless = [[128, 0, 0, 129], [1, 1, 1, 0], [1, 1, 1, 0]].concat();
        for (size, data) in [
            ("+Y 1 +X 1", &[0; 4][..]),
            ("+X 1 -Y 1", &[0; 4]),
            ("-Y 0 +X 1", &[]),
            ("-Y 4294967295 +X 4294967295", &[]),
            ("-Y x +X 1", &[]),
            ("-Y 1 +X 4", &[1, 1, 1, 1]),
            ("-Y 1 +X 2", &[128, 0, 0, 129, 1, 1, 1, 255]),
            ("-Y 1 +X 8", &[2, 2, 0, 9, 0, 0]),
            ("-Y 1 +X 8", &[2, 2, 0, 8, 255, 0]),
            ("-Y 1 +X 4", &endless),
            ("-Y 1 +X 4", &[[1, 1, 1, 0]; 64].concat()),
        ] {
            assert!(
                decode(&picture(size, data), 1 << 20).is_err(),
                "{size} {data:?}"
            );
        }
        let xyze = b"#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 1 +X 1\n1234";
        assert!(decode(xyze, 1).unwrap_err().message.contains("xyze"));
    }

    #[test]
    fn exposure_is_reported() {
        let bytes = b"#?RGBE\nEXPOSURE= 2.0\nGAMMA=1\n\n-Y 1 +X 1\n\x80\x80\x80\x81";
        assert_eq!(decode(bytes, 1).unwrap().ignored, ["EXPOSURE= 2.0"]);
    }
}
