//! OpenEXR pictures of our own kind: one part, scan lines, uncompressed, RGB or RGBA, half or float.
//!
//! Format: "OpenEXR File Layout", openexr.com. What is read is what [`encode`] writes, and the same from others.

use crate::metrics::Picture;

const MAGIC: [u8; 4] = [0x76, 0x2f, 0x31, 0x01];
/// Version 2, no flags: one part of scan lines, short names.
const VERSION: u32 = 2;
/// Pixel types of the channel list.
const HALF: u32 = 1;
const FLOAT: u32 = 2;
/// Largest side that is read.
const MAX_SIDE: i64 = 65_536;

/// A picture as the bytes of a file: channels B, G, R of 32-bit floats.
///
/// # Panics
/// Where the picture is empty or a side exceeds 65536.
pub fn encode(picture: &Picture) -> Vec<u8> {
    let (width, height) = (picture.width, picture.height);
    assert!(width > 0 && height > 0 && width.max(height) as i64 <= MAX_SIDE);
    let mut bytes = header(width, height);
    let row_bytes = width * 3 * 4;
    let first = bytes.len() + height * 8;
    for y in 0..height {
        bytes.extend((first as u64 + y as u64 * (row_bytes as u64 + 8)).to_le_bytes());
    }
    for (y, row) in picture.texels.chunks_exact(width).enumerate() {
        bytes.extend((y as u32).to_le_bytes());
        bytes.extend((row_bytes as u32).to_le_bytes());
        for channel in [2, 1, 0] {
            bytes.extend(row.iter().flat_map(|texel| texel[channel].to_le_bytes()));
        }
    }
    bytes
}

fn header(width: usize, height: usize) -> Vec<u8> {
    let mut bytes = Vec::new();
    bytes.extend(MAGIC);
    bytes.extend(VERSION.to_le_bytes());
    let mut channels = Vec::new();
    for name in [b"B\0", b"G\0", b"R\0"] {
        channels.extend(name);
        // Pixel type, perceptually linear, reserved, sampling.
        for word in [FLOAT, 0, 1, 1] {
            channels.extend(word.to_le_bytes());
        }
    }
    channels.push(0);
    let window: Vec<u8> = [0, 0, width as u32 - 1, height as u32 - 1]
        .iter()
        .flat_map(|v| v.to_le_bytes())
        .collect();
    let one = 1.0f32.to_le_bytes();
    for (name, kind, value) in [
        ("channels", "chlist", channels.as_slice()),
        ("compression", "compression", &[0]),
        ("dataWindow", "box2i", &window),
        ("displayWindow", "box2i", &window),
        ("lineOrder", "lineOrder", &[0]),
        ("pixelAspectRatio", "float", &one),
        ("screenWindowCenter", "v2f", &[0; 8]),
        ("screenWindowWidth", "float", &one),
    ] {
        for text in [name, kind] {
            bytes.extend(text.bytes());
            bytes.push(0);
        }
        bytes.extend((value.len() as u32).to_le_bytes());
        bytes.extend(value);
    }
    bytes.push(0);
    bytes
}

/// A channel of the file: which of red, green, blue it is, and its type.
struct Channel {
    target: Option<usize>,
    half: bool,
}

/// Reads a picture.
///
/// # Errors
/// What is damaged or not supported.
pub fn decode(bytes: &[u8]) -> Result<Picture, String> {
    let mut reader = Reader { bytes, at: 0 };
    if reader.take(4)? != MAGIC {
        return Err("not an OpenEXR file".into());
    }
    let version = reader.word()?;
    if version & 0xff != VERSION || version & !0x4ff != 0 {
        return Err("tiled, deep or multi-part OpenEXR is not read".into());
    }
    let (mut channels, mut window) = (Vec::new(), None);
    loop {
        let name = reader.text()?;
        if name.is_empty() {
            break;
        }
        let _kind = reader.text()?;
        let length = reader.word()? as usize;
        let value = reader.take(length)?;
        match name {
            b"channels" => channels = channel_list(value)?,
            b"compression" if value != [0] => {
                return Err("compressed OpenEXR is not read: save it uncompressed".into());
            }
            b"dataWindow" => window = Some(size(value)?),
            _ => {}
        }
    }
    let (width, height, top) = window.ok_or("no dataWindow")?;
    for color in 0..3 {
        if !channels.iter().any(|channel| channel.target == Some(color)) {
            return Err("no channels R, G and B".into());
        }
    }
    rows(&mut reader, &channels, width, height, top)
}

fn rows(
    reader: &mut Reader<'_>,
    channels: &[Channel],
    width: usize,
    height: usize,
    top: i64,
) -> Result<Picture, String> {
    let texel_bytes: usize = channels
        .iter()
        .map(|channel| if channel.half { 2 } else { 4 })
        .sum();
    let needed = (width * texel_bytes + 16)
        .checked_mul(height)
        .ok_or("too large")?;
    if reader.bytes.len() - reader.at < needed {
        return Err("the file ends before its last row".into());
    }
    reader.take(height * 8)?;
    let mut texels = vec![[0.0; 3]; width * height];
    for _ in 0..height {
        let y = i64::from(reader.word()? as i32) - top;
        if reader.word()? as usize != width * texel_bytes || !(0..height as i64).contains(&y) {
            return Err("a row has a wrong number or length".into());
        }
        let row = &mut texels[y as usize * width..][..width];
        for channel in channels {
            for texel in row.iter_mut() {
                let value = reader.value(channel.half)?;
                if let Some(target) = channel.target {
                    texel[target] = value;
                }
            }
        }
    }
    Ok(Picture {
        width,
        height,
        texels,
    })
}

fn channel_list(bytes: &[u8]) -> Result<Vec<Channel>, String> {
    let mut reader = Reader { bytes, at: 0 };
    let mut channels = Vec::new();
    loop {
        let name = reader.text()?;
        if name.is_empty() {
            return Ok(channels);
        }
        let [kind, _, x, y] = [
            reader.word()?,
            reader.word()?,
            reader.word()?,
            reader.word()?,
        ];
        if !matches!(kind, HALF | FLOAT) || (x, y) != (1, 1) {
            return Err("channels must be half or float and not subsampled".into());
        }
        channels.push(Channel {
            target: [&b"R"[..], b"G", b"B"]
                .iter()
                .position(|color| *color == name),
            half: kind == HALF,
        });
    }
}

/// Width, height and first row of a window.
fn size(value: &[u8]) -> Result<(usize, usize, i64), String> {
    let mut reader = Reader {
        bytes: value,
        at: 0,
    };
    let mut next = || reader.word().map(|word| i64::from(word as i32));
    let [left, top, right, bottom] = [next()?, next()?, next()?, next()?];
    let (width, height) = (right - left + 1, bottom - top + 1);
    if !(1..=MAX_SIDE).contains(&width) || !(1..=MAX_SIDE).contains(&height) {
        return Err(format!("a data window of {width}x{height}"));
    }
    Ok((width as usize, height as usize, top))
}

/// Little-endian values in order; anything beyond the end is an error.
struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Reader<'a> {
    fn take(&mut self, length: usize) -> Result<&'a [u8], String> {
        let end = self
            .at
            .checked_add(length)
            .filter(|end| *end <= self.bytes.len());
        let end = end.ok_or_else(|| format!("the file ends after {} bytes", self.bytes.len()))?;
        let taken = &self.bytes[self.at..end];
        self.at = end;
        Ok(taken)
    }

    fn word(&mut self) -> Result<u32, String> {
        let bytes = self.take(4)?;
        Ok(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]))
    }

    fn value(&mut self, half: bool) -> Result<f32, String> {
        if half {
            let bytes = self.take(2)?;
            return Ok(crate::headless::from_half(u16::from_le_bytes([
                bytes[0], bytes[1],
            ])));
        }
        self.word().map(f32::from_bits)
    }

    /// Up to a zero byte, which is dropped.
    fn text(&mut self) -> Result<&'a [u8], String> {
        let rest = &self.bytes[self.at..];
        let length = rest.iter().position(|byte| *byte == 0);
        let length = length.ok_or("a name without an end")?;
        self.at += length + 1;
        Ok(&rest[..length])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn picture(width: usize, height: usize) -> Picture {
        let value = |index: usize| {
            [
                index as f32 * 0.37,
                -(index as f32),
                1e6 / (index as f32 + 1.0),
            ]
        };
        Picture {
            width,
            height,
            texels: (0..width * height).map(value).collect(),
        }
    }

    #[test]
    fn pictures_come_back_bit_for_bit() {
        for (width, height) in [(1, 1), (5, 3), (64, 2)] {
            let picture = picture(width, height);
            assert_eq!(decode(&encode(&picture)), Ok(picture));
        }
    }

    #[test]
    fn what_is_not_read_is_said() {
        let good = encode(&picture(4, 4));
        let change = |from: &[u8], to: &[u8]| {
            let at = good
                .windows(from.len())
                .position(|window| window == from)
                .expect("found");
            let mut bytes = good.clone();
            bytes[at..at + to.len()].copy_from_slice(to);
            decode(&bytes).expect_err("refused")
        };
        assert!(
            change(
                b"compression\0compression\0\x01\0\0\0\0",
                b"compression\0compression\0\x01\0\0\0\x03"
            )
            .contains("compressed")
        );
        assert!(change(b"R\0\x02", b"Q\0\x02").contains("R, G and B"));
        assert!(change(&[3, 0, 0, 0, 3, 0, 0, 0], &[255, 255, 255, 127]).contains("data window"));
        assert!(decode(b"\x89PNG").expect_err("refused").contains("OpenEXR"));
    }

    proptest! {
        #[test]
        fn no_damage_panics(cut in 0usize..700, at in 0usize..700, value in any::<u8>()) {
            let mut bytes = encode(&picture(6, 5));
            let length = bytes.len();
            bytes[at % length] = value;
            bytes.truncate(length - cut.min(length));
            let _ = decode(&bytes);
        }
    }
}
