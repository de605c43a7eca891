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

/// Pixels that the header promises; `None` where it is broken.
pub(super) fn pixels(bytes: &[u8]) -> Option<u64> {
    let mut reader = Reader { bytes, offset: 0 };
    header(&mut reader).ok()?;
    let layout = resolution(&mut reader).ok()?;
    Some(u64::from(layout.lines) * u64::from(layout.length))
}

/// Decodes flat, old and new run-length-encoded scanlines, in any of the eight orientations. Values are
/// `mantissa * 2^(e - 136)` over the product of every `EXPOSURE` and `COLORCORR`, which the file was multiplied with.
/// Memory grows with the scanlines really present.
///
/// # Errors
/// A broken or cut file, XYZE colours, or more than `limit_pixels` pixels.
pub(super) fn decode(bytes: &[u8], limit_pixels: u64) -> Result<Picture, Fault> {
    let mut reader = Reader { bytes, offset: 0 };
    let header = header(&mut reader)?;
    let layout = resolution(&mut reader)?;
    let pixels = u64::from(layout.lines) * u64::from(layout.length);
    if pixels == 0 || pixels > limit_pixels {
        let message = format!(
            "{}x{} pixels are not within 1 and the limit of {limit_pixels}; resize it",
            layout.length, layout.lines
        );
        return reader.fault(message);
    }
    let mut scanline = vec![[0; 4]; layout.length as usize];
    let mut texels = Vec::new();
    for _ in 0..layout.lines {
        read_scanline(&mut reader, &mut scanline)?;
        texels.extend(scanline.iter().map(|&rgbe| {
            let [r, g, b] = linear(rgbe);
            [
                r / header.scale[0],
                g / header.scale[1],
                b / header.scale[2],
            ]
        }));
    }
    let (width, height) = layout.size();
    Ok(Picture {
        width,
        height,
        texels: layout.upright(texels),
        ignored: header.ignored,
    })
}

/// The order of the scanlines and of the pixels within them.
#[derive(Clone, Copy)]
struct Layout {
    lines: u32,
    /// Pixels of a scanline.
    length: u32,
    /// Scanlines are columns.
    columns: bool,
    /// The picture's bottom comes first, its right end comes first.
    from_bottom: bool,
    from_right: bool,
}

impl Layout {
    /// Width and height.
    fn size(self) -> (u32, u32) {
        if self.columns {
            (self.lines, self.length)
        } else {
            (self.length, self.lines)
        }
    }

    /// Pixels in the order of the file, to rows from the top.
    fn upright(self, texels: Vec<[f32; 3]>) -> Vec<[f32; 3]> {
        if !(self.columns || self.from_bottom || self.from_right) {
            return texels;
        }
        let (width, height) = self.size();
        let (width, height) = (width as usize, height as usize);
        let source = |index: usize| {
            let (mut x, mut y) = (index % width, index / width);
            if self.from_right {
                x = width - 1 - x;
            }
            if self.from_bottom {
                y = height - 1 - y;
            }
            let (line, at) = if self.columns { (x, y) } else { (y, x) };
            line * self.length as usize + at
        };
        (0..texels.len())
            .map(|index| texels[source(index)])
            .collect()
    }
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

/// What the header says of the values.
struct Header {
    /// What each channel was multiplied with.
    scale: [f32; 3],
    /// Entries that change the meaning of the values and are not applied.
    ignored: Vec<String>,
}

/// Reads the header up to its empty line. Entries may be repeated; their factors multiply.
fn header(reader: &mut Reader<'_>) -> Result<Header, Fault> {
    let mut header = Header {
        scale: [1.0; 3],
        ignored: Vec::new(),
    };
    loop {
        let line = reader.line()?;
        if line.is_empty() {
            return Ok(header);
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
            ("EXPOSURE" | "COLORCORR", value) => {
                let factors: Vec<f32> = value
                    .split_whitespace()
                    .filter_map(|number| number.parse().ok())
                    .collect();
                let factors = match factors[..] {
                    [all] => [all; 3],
                    [r, g, b] => [r, g, b],
                    _ => [f32::NAN; 3],
                };
                for (scale, factor) in header.scale.iter_mut().zip(factors) {
                    *scale *= factor;
                }
                if !header
                    .scale
                    .iter()
                    .all(|scale| scale.is_normal() && *scale > 0.0)
                {
                    let message = format!("`{line}` holds no positive factors; save it again");
                    return reader.fault(message);
                }
            }
            ("GAMMA", value) if value.parse() != Ok(1.0_f32) => header.ignored.push(line),
            _ => {}
        }
    }
}

/// Reads the resolution line.
fn resolution(reader: &mut Reader<'_>) -> Result<Layout, Fault> {
    let line = reader.line()?;
    let words: Vec<&str> = line.split_whitespace().collect();
    let number = |text: &str| text.parse::<u32>().ok();
    let [first, lines, second, length] = words[..] else {
        return reader.fault(format!(
            "`{line}` is no resolution line; save the file again"
        ));
    };
    let (Some(lines), Some(length)) = (number(lines), number(length)) else {
        return reader.fault(format!(
            "the size `{line}` is no pair of numbers; save it again"
        ));
    };
    let (columns, y, x) = match (first, second) {
        ("-Y" | "+Y", "-X" | "+X") => (false, first, second),
        ("-X" | "+X", "-Y" | "+Y") => (true, second, first),
        _ => {
            return reader.fault(format!(
                "`{line}` is no resolution line; save the file again"
            ));
        }
    };
    Ok(Layout {
        lines,
        length,
        columns,
        from_bottom: y == "+Y",
        from_right: x == "-X",
    })
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
            ("+Y 1 +Y 1", &[0; 4][..]),
            ("+Z 1 -Y 1", &[0; 4]),
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

    /// Six pixels, brightest first: 6, 5, 4, 3, 2, 1.
    fn six() -> Vec<u8> {
        (1..7)
            .rev()
            .flat_map(|value| [value * 16, 0, 0, 132])
            .collect()
    }

    #[test]
    fn every_orientation_comes_upright() {
        // Rows from the top, of a picture 3 wide and 2 high.
        for (size, rows) in [
            ("-Y 2 +X 3", [6, 5, 4, 3, 2, 1]),
            ("-Y 2 -X 3", [4, 5, 6, 1, 2, 3]),
            ("+Y 2 +X 3", [3, 2, 1, 6, 5, 4]),
            ("+Y 2 -X 3", [1, 2, 3, 4, 5, 6]),
            ("+X 3 -Y 2", [6, 4, 2, 5, 3, 1]),
            ("+X 3 +Y 2", [5, 3, 1, 6, 4, 2]),
            ("-X 3 -Y 2", [2, 4, 6, 1, 3, 5]),
            ("-X 3 +Y 2", [1, 3, 5, 2, 4, 6]),
        ] {
            let decoded = decode(&picture(size, &six()), 6).unwrap();
            assert_eq!((decoded.width, decoded.height), (3, 2), "{size}");
            let found: Vec<f32> = decoded.texels.iter().map(|texel| texel[0]).collect();
            assert_eq!(found, rows.map(|value: u8| f32::from(value)), "{size}");
        }
    }

    #[test]
    fn exposures_and_corrections_are_taken_out() {
        let decoded = |head: &str| {
            let bytes = format!("#?RGBE\n{head}\n\n-Y 1 +X 1\n");
            decode(&[bytes.as_bytes(), &[128, 128, 128, 129]].concat(), 1)
        };
        let texel = |head: &str| decoded(head).unwrap().texels[0];
        assert_eq!(texel("EXPOSURE= 2.0"), [0.5; 3]);
        assert_eq!(texel("EXPOSURE=2\nEXPOSURE=0.25"), [2.0; 3]);
        assert_eq!(texel("COLORCORR=1 2 4\nEXPOSURE=0.5"), [2.0, 1.0, 0.5]);
        assert_eq!(decoded("GAMMA=1").unwrap().ignored, Vec::<String>::new());
        assert_eq!(decoded("GAMMA=2.2").unwrap().ignored, ["GAMMA=2.2"]);
        for broken in [
            "EXPOSURE=0",
            "EXPOSURE=-1",
            "EXPOSURE=x",
            "EXPOSURE=nan",
            "COLORCORR=1 2",
            "EXPOSURE=1e-30\nEXPOSURE=1e-30",
        ] {
            assert!(decoded(broken).is_err(), "{broken}");
        }
    }
}
