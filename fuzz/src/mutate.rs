//! A mutation loop for stable Rust: seeds, a dictionary and a fixed random sequence.

/// Interesting bytes: ends of ranges, signs, brackets.
const BYTES: [u8; 12] = [
    0, 1, 0x7f, 0x80, 0xfe, 0xff, b'-', b'9', b'"', b'{', b']', b',',
];
/// Longest mutant.
const LONGEST: usize = 1 << 16;

/// The generator xorshift64* (Marsaglia 2003, Vigna 2016).
#[derive(Clone, Debug)]
pub struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Self {
        Self(seed | 1)
    }

    pub fn draw(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_f491_4f6c_dd1d)
    }

    /// Below `bound`, which is not 0.
    pub fn below(&mut self, bound: usize) -> usize {
        (self.draw() % bound as u64) as usize
    }
}

/// The words of a dictionary in libFuzzer's form: a quoted string a line, `\xNN`, `\\` and `\"` escaped.
pub fn dictionary(text: &str) -> Vec<Vec<u8>> {
    text.lines()
        .filter_map(|line| {
            let line = line.trim();
            let quoted = line.split_once('"')?.1.strip_suffix('"')?;
            (!line.starts_with('#')).then(|| unescaped(quoted.as_bytes()))
        })
        .collect()
}

fn unescaped(quoted: &[u8]) -> Vec<u8> {
    let mut word = Vec::new();
    let mut rest = quoted;
    while let [first, tail @ ..] = rest {
        let (byte, behind) = match (first, tail) {
            (b'\\', [b'x', high, low, behind @ ..]) => (hexadecimal(*high, *low), behind),
            (b'\\', [escaped, behind @ ..]) => (*escaped, behind),
            _ => (*first, tail),
        };
        word.push(byte);
        rest = behind;
    }
    word
}

/// `?` where the digits are none.
fn hexadecimal(high: u8, low: u8) -> u8 {
    let digit = |byte: u8| char::from(byte).to_digit(16);
    match (digit(high), digit(low)) {
        (Some(high), Some(low)) => (high * 16 + low) as u8,
        _ => b'?',
    }
}

/// A mutant of one of the seeds: one to four changes.
///
/// # Panics
/// If there is no seed.
pub fn mutant(seeds: &[Vec<u8>], words: &[Vec<u8>], random: &mut Random) -> Vec<u8> {
    let mut bytes = seeds[random.below(seeds.len())].clone();
    for _ in 0..=random.below(4) {
        change(&mut bytes, seeds, words, random);
    }
    bytes.truncate(LONGEST);
    bytes
}

fn change(bytes: &mut Vec<u8>, seeds: &[Vec<u8>], words: &[Vec<u8>], random: &mut Random) {
    if bytes.is_empty() {
        bytes.push(random.draw() as u8);
        return;
    }
    let at = random.below(bytes.len());
    let span = at..(at + 1 + random.below(16)).min(bytes.len());
    match random.below(9) {
        0 => bytes[at] ^= 1 << random.below(8),
        1 => bytes[at] = BYTES[random.below(BYTES.len())],
        2 => bytes.truncate(at),
        3 => drop(bytes.drain(span)),
        4 => {
            let copy = bytes[span].to_vec();
            let to = random.below(bytes.len());
            bytes.splice(to..to, copy);
        }
        5 => {
            let word = random.draw().to_le_bytes();
            let length = span.len().min(8);
            bytes[at..at + length].copy_from_slice(&word[..length]);
        }
        6 if !words.is_empty() => {
            let word = &words[random.below(words.len())];
            bytes.splice(at..at, word.iter().copied());
        }
        7 if !words.is_empty() => {
            let word = &words[random.below(words.len())];
            let end = (at + word.len()).min(bytes.len());
            bytes.splice(at..end, word.iter().copied());
        }
        _ => {
            let other = &seeds[random.below(seeds.len())];
            if !other.is_empty() {
                let from = random.below(other.len());
                bytes.truncate(at);
                bytes.extend(&other[from..]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dictionaries_are_read() {
        let text = "# words\nname=\"a\\\"b\"\n\"\\x00\\xff\\\\\"\n\nnothing";
        assert_eq!(dictionary(text), [b"a\"b".to_vec(), b"\0\xff\\".to_vec()]);
    }

    #[test]
    fn mutants_repeat_and_differ() {
        let seeds = [b"{\"asset\":{\"version\":\"2.0\"}}".to_vec(), vec![7; 40]];
        let words = [b"meshes".to_vec()];
        let row = |seed| {
            let mut random = Random::new(seed);
            (0..64)
                .map(|_| mutant(&seeds, &words, &mut random))
                .collect::<Vec<_>>()
        };
        assert_eq!(row(1), row(1));
        let changed = row(1)
            .iter()
            .filter(|mutant| !seeds.contains(mutant))
            .count();
        assert!(changed > 55, "{changed}");
    }
}
