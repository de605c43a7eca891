//! UASTC LDR 4x4 blocks from f32 values: the universal texels of `--target portable`.
//!
//! UASTC (Basis Universal) is the part of ASTC that also maps onto BC7: 19 modes, each with its number of subsets,
//! planes, components, weight levels and endpoint levels. This encoder tries the modes that a block's content can
//! gain from, fits endpoints by least squares, and keeps the least squared error of what decoders show. Hints for
//! transcoding to ETC1 and BC1 are zero, because nothing here reads them. Only sums, products, quotients, square
//! roots and roundings: the bytes are the same on every machine.

mod fit;
mod pack;

use std::sync::LazyLock;

use basisu::uastc::bise;
use basisu::uastc::patterns::{ASTC_BC7_PATTERNS2, ASTC_BC7_PATTERNS3};

use super::Quality;
use fit::{Fit, Levels, Points};

/// Texels of four channels in 0..=255, rows of four.
pub(super) type Texels = [[f32; 4]; 16];

/// How many partitions are tried of each mode that has any: none, a few, or more.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Search {
    /// Two-subset patterns.
    pub pairs: usize,
    /// Three-subset patterns.
    pub triples: usize,
    /// Whether a channel may have weights of its own.
    pub planes: bool,
}

impl Search {
    /// What a preset spends.
    pub const fn of(quality: Quality) -> Self {
        let (pairs, triples) = match quality {
            Quality::Fast => (0, 0),
            Quality::Default => (2, 1),
            Quality::Best => (8, 4),
        };
        Self {
            pairs,
            triples,
            planes: pairs > 0,
        }
    }
}

/// A mode: what it stores.
#[derive(Clone, Copy, Debug)]
struct Mode {
    /// Number of the mode in UASTC.
    number: u8,
    /// 2: luminance and alpha, 3: RGB, 4: RGBA.
    components: usize,
    weight_bits: u32,
    /// Index of the endpoints' range among ASTC's.
    range: usize,
    subsets: usize,
}

const fn mode(
    number: u8,
    components: usize,
    weight_bits: u32,
    range: usize,
    subsets: usize,
) -> Mode {
    Mode {
        number,
        components,
        weight_bits,
        range,
        subsets,
    }
}

/// Number of the mode of one colour.
const SOLID: u8 = 8;
const OPAQUE: [Mode; 3] = [
    mode(0, 3, 4, 19, 1),
    mode(18, 3, 5, 11, 1),
    mode(5, 3, 3, 20, 1),
];
const OPAQUE_PAIRS: [Mode; 2] = [mode(2, 3, 3, 8, 2), mode(4, 3, 2, 12, 2)];
const OPAQUE_TRIPLES: Mode = mode(3, 3, 2, 7, 3);
const OPAQUE_PLANES: Mode = mode(6, 3, 2, 18, 1);
const ALPHA: [Mode; 3] = [
    mode(10, 4, 4, 13, 1),
    mode(12, 4, 3, 19, 1),
    mode(14, 4, 2, 20, 1),
];
const ALPHA_PAIRS: Mode = mode(9, 4, 2, 8, 2);
const ALPHA_PLANES: Mode = mode(11, 4, 2, 13, 1);
const GREY: Mode = mode(15, 2, 4, 20, 1);
const GREY_PAIRS: Mode = mode(16, 2, 2, 20, 2);
const GREY_PLANES: Mode = mode(17, 2, 2, 20, 1);

/// Levels of every endpoint range.
static LEVELS: LazyLock<Vec<Levels>> = LazyLock::new(|| {
    let range = |range: u32| {
        let count = bise::astc_get_levels(range);
        let values = (0..count).map(|code| bise::unquant_astc_endpoint_val(code, range) as u8);
        Levels::new(values.collect())
    };
    (0..=20).map(range).collect()
});

/// A block in some mode.
#[derive(Clone, Debug)]
struct Candidate {
    mode: Mode,
    /// Common partition pattern, of modes with subsets.
    pattern: usize,
    /// Component with weights of its own.
    plane: Option<usize>,
    /// Endpoint codes: a pair of each component of each subset.
    endpoints: [[[u8; 2]; 4]; 3],
    /// Of each texel, and of its second plane.
    weights: [[u8; 16]; 2],
    error: f32,
}

/// One block of 16 texels. `alpha` says whether the fourth channel counts; where it does not, the block is opaque.
pub(super) fn compress_block(texels: &Texels, alpha: bool, search: Search) -> [u8; 16] {
    let codes = texels.map(|texel| texel.map(|value| (value + 0.5) as u8));
    let alpha = alpha && codes.iter().any(|code| code[3] != 255);
    if let Some(color) = solid(&codes, alpha) {
        return pack::solid(color);
    }
    let grey = codes.iter().all(|[r, g, b, _]| r == g && g == b);
    let best = match (grey, alpha) {
        (true, _) => best_grey(texels, alpha, search),
        (false, true) => best_alpha(texels, search),
        (false, false) => best_opaque(texels, search),
    };
    pack::pack(&best)
}

fn solid(codes: &[[u8; 4]; 16], alpha: bool) -> Option<[u8; 4]> {
    let color = |code: &[u8; 4]| {
        let [r, g, b, a] = *code;
        [r, g, b, if alpha { a } else { 255 }]
    };
    let first = color(&codes[0]);
    codes
        .iter()
        .all(|code| color(code) == first)
        .then_some(first)
}

fn best_opaque(texels: &Texels, search: Search) -> Candidate {
    let points = Points::new(texels.map(|[r, g, b, _]| [r, g, b, 0.0]), 3);
    let mut best = Best::default();
    for mode in OPAQUE {
        best.offer(whole(&points, mode));
    }
    if best.is_fine() {
        return best.taken();
    }
    for pattern in fit::patterns(&points, &ASTC_BC7_PATTERNS2, search.pairs) {
        for mode in OPAQUE_PAIRS {
            best.offer(split(&points, mode, pattern, &ASTC_BC7_PATTERNS2[pattern]));
        }
    }
    for pattern in fit::patterns(&points, &ASTC_BC7_PATTERNS3, search.triples) {
        best.offer(split(
            &points,
            OPAQUE_TRIPLES,
            pattern,
            &ASTC_BC7_PATTERNS3[pattern],
        ));
    }
    if search.planes {
        for plane in 0..3 {
            best.offer(planes(&points, OPAQUE_PLANES, plane));
        }
    }
    best.taken()
}

fn best_alpha(texels: &Texels, search: Search) -> Candidate {
    let points = Points::new(*texels, 4);
    let mut best = Best::default();
    for mode in ALPHA {
        best.offer(whole(&points, mode));
    }
    // Opacity seldom follows colour: it has weights of its own in any search.
    best.offer(planes(&points, ALPHA_PLANES, 3));
    if best.is_fine() {
        return best.taken();
    }
    for pattern in fit::patterns(&points, &ASTC_BC7_PATTERNS2, search.pairs) {
        best.offer(split(
            &points,
            ALPHA_PAIRS,
            pattern,
            &ASTC_BC7_PATTERNS2[pattern],
        ));
    }
    if search.planes {
        for plane in 0..3 {
            best.offer(planes(&points, ALPHA_PLANES, plane));
        }
    }
    best.taken()
}

fn best_grey(texels: &Texels, alpha: bool, search: Search) -> Candidate {
    let opacity = |a: f32| if alpha { a } else { 255.0 };
    // Luminance stands for three channels.
    let points = Points::new(texels.map(|[l, _, _, a]| [l, opacity(a), 0.0, 0.0]), 2);
    let mut best = Best::default();
    best.offer(whole(&points, GREY));
    if alpha {
        best.offer(planes(&points, GREY_PLANES, 1));
    }
    if best.is_fine() {
        return best.taken();
    }
    for pattern in fit::patterns(&points, &ASTC_BC7_PATTERNS2, search.pairs) {
        best.offer(split(
            &points,
            GREY_PAIRS,
            pattern,
            &ASTC_BC7_PATTERNS2[pattern],
        ));
    }
    best.taken()
}

/// The candidate with the least error so far.
#[derive(Default)]
struct Best(Option<Candidate>);

impl Best {
    /// Squared error of a block that no other mode is tried for: half a code in one channel of each texel.
    const FINE: f32 = 4.0;

    fn offer(&mut self, candidate: Candidate) {
        if self
            .0
            .as_ref()
            .is_none_or(|best| candidate.error < best.error)
        {
            self.0 = Some(candidate);
        }
    }

    fn is_fine(&self) -> bool {
        self.0.as_ref().is_some_and(|best| best.error <= Self::FINE)
    }

    fn taken(self) -> Candidate {
        self.0.expect("a mode was tried")
    }
}

fn candidate(mode: Mode) -> Candidate {
    Candidate {
        mode,
        pattern: 0,
        plane: None,
        endpoints: [[[0; 2]; 4]; 3],
        weights: [[0; 16]; 2],
        error: 0.0,
    }
}

fn whole(points: &Points, mode: Mode) -> Candidate {
    split(points, mode, 0, &[0; 16])
}

/// Each subset fitted by itself.
fn split(points: &Points, mode: Mode, number: usize, pattern: &[u8; 16]) -> Candidate {
    let mut block = candidate(mode);
    block.pattern = number;
    for subset in 0..mode.subsets {
        let members: Vec<usize> = (0..16)
            .filter(|&texel| usize::from(pattern[texel]) == subset)
            .collect();
        let fit = Fit::of(
            points,
            &members,
            0..mode.components,
            mode.weight_bits,
            &LEVELS[mode.range],
        );
        block.endpoints[subset] = fit.endpoints;
        for (&texel, &weight) in members.iter().zip(&fit.weights) {
            block.weights[0][texel] = weight;
        }
        block.error += fit.error;
    }
    block
}

/// One component fitted by itself, the others together.
fn planes(points: &Points, mode: Mode, plane: usize) -> Candidate {
    let mut block = candidate(mode);
    block.plane = Some(plane);
    let all: Vec<usize> = (0..16).collect();
    let others = points.without(plane);
    let levels = &LEVELS[mode.range];
    let first = Fit::of(&others, &all, 0..mode.components, mode.weight_bits, levels);
    let second = Fit::of(points, &all, plane..plane + 1, mode.weight_bits, levels);
    block.endpoints[0] = first.endpoints;
    block.endpoints[0][plane] = second.endpoints[plane];
    block.weights = [first.weights, second.weights];
    block.error = first.error + second.error;
    block
}

#[cfg(test)]
mod tests {
    use basisu::uastc::{astc_pack, bc7, unpack};
    use proptest::prelude::*;

    use super::*;

    fn decode(block: &[u8; 16]) -> [[u8; 4]; 16] {
        let texels = unpack::unpack_uastc(block, false).expect("a block of UASTC");
        texels.map(|texel| texel.c)
    }

    fn mode_of(block: &[u8; 16]) -> u32 {
        let block = unpack::unpack_to_block(block, false, false);
        block.expect("a block of UASTC").mode
    }

    fn squared_error(block: &[u8; 16], texels: &Texels, channels: usize) -> f32 {
        let pairs = decode(block).into_iter().zip(texels);
        let error = |(found, wanted): ([u8; 4], &[f32; 4])| -> f32 {
            let pairs = found.iter().zip(wanted).take(channels);
            pairs
                .map(|(found, wanted)| (f32::from(*found) - wanted).powi(2))
                .sum()
        };
        pairs.map(error).sum()
    }

    fn every_search() -> [Search; 3] {
        Quality::ALL.map(Search::of)
    }

    #[test]
    fn one_colour_is_exact() {
        for search in every_search() {
            let color = [3.0, 77.0, 255.0, 9.0];
            let block = compress_block(&[color; 16], true, search);
            assert_eq!(decode(&block), [[3, 77, 255, 9]; 16]);
            let opaque = compress_block(&[color; 16], false, search);
            assert_eq!(decode(&opaque), [[3, 77, 255, 255]; 16]);
        }
    }

    #[test]
    fn content_chooses_the_mode() {
        let search = Search::of(Quality::Default);
        let ramp = |texel: usize| texel as f32 * 16.0;
        let grey = std::array::from_fn(|texel| {
            [[ramp(texel); 3].as_slice(), &[255.0]]
                .concat()
                .try_into()
                .unwrap()
        });
        assert_eq!(mode_of(&compress_block(&grey, true, search)), 15);
        // Two channels that have nothing to do with each other.
        let pair: Texels = std::array::from_fn(|texel| {
            let [x, y] = [texel % 4, texel / 4].map(|at| at as f32 * 80.0);
            [x, x, x, y]
        });
        assert_eq!(mode_of(&compress_block(&pair, true, search)), 17);
        // Red and blue halves, each a ramp of its own.
        let halves: Texels = std::array::from_fn(|texel| {
            let value = 100.0 + 10.0 * (texel / 4) as f32;
            if texel % 4 < 2 {
                [value, 0.0, 0.0, 255.0]
            } else {
                [0.0, 0.0, value, 255.0]
            }
        });
        let block = compress_block(&halves, true, search);
        assert!([2, 4].contains(&mode_of(&block)), "{}", mode_of(&block));
        let single = compress_block(&halves, true, Search::of(Quality::Fast));
        let (split, whole) = (
            squared_error(&block, &halves, 3),
            squared_error(&single, &halves, 3),
        );
        assert!(split * 4.0 < whole, "{split} {whole}");
    }

    proptest! {
        /// Every block is valid, shows what the encoder reckoned with, transcodes, and gains from a wider search.
        #[test]
        fn blocks_decode_and_transcode(base in any::<[u8; 4]>(), spread in 0.0_f32..1.0, noise in any::<[[u8; 4]; 16]>()) {
            let texels: Texels = noise.map(|texel| {
                std::array::from_fn(|c| {
                    let (base, noise) = (f32::from(base[c]), f32::from(texel[c]));
                    (base + (noise - base) * spread).round()
                })
            });
            let mut errors = every_search().map(|search| {
                let block = compress_block(&texels, true, search);
                assert!(bc7::transcode_uastc_to_bc7(&block).is_some());
                assert!(astc_pack::transcode_uastc_to_astc(&block).is_some());
                squared_error(&block, &texels, 4)
            });
            prop_assert!(errors[2] <= errors[1] && errors[1] <= errors[0], "{errors:?}");
            // Never worse than the block's extremes with sixteen levels on one line, by far.
            errors[0] /= 64.0;
            prop_assert!(errors[0].sqrt() <= 1.0 + 128.0 * spread, "{errors:?}");
        }
    }
}
