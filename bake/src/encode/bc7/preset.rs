//! What each quality tries. The numbers are measured: docs/numbers.md, "BC7".

use super::super::Quality;
use super::fit::Effort;

/// See the module.
pub(super) struct Preset {
    /// Of mode 6.
    pub whole: Effort,
    /// Of all other modes.
    pub parts: Effort,
    /// Most partitions of modes 0, 1, 2, 3 (opaque) and 7 (alpha).
    pub partitions: [usize; 5],
    /// Of those, how many are fitted in full, after all were in short.
    pub finished: usize,
    /// Most rotations of modes 4 and 5, of blocks with alpha first, then of opaque ones.
    pub rotations: [usize; 2],
    /// Whether mode 4 is tried, in the same order.
    pub fourth: [bool; 2],
    /// Ways of a block that are kept for the descent, at least one.
    pub kept: usize,
    /// Another fit of those that are kept.
    pub again: Option<Effort>,
    /// Most rounds of descent from the better.
    pub polish: u32,
}

const fn effort(rounds: u32, parities: bool, insets: &'static [f32]) -> Effort {
    Effort {
        rounds,
        parities,
        insets,
    }
}

static FAST: Preset = Preset {
    whole: effort(1, false, &[]),
    parts: effort(1, false, &[]),
    partitions: [0; 5],
    finished: 0,
    rotations: [1, 0],
    fourth: [true, false],
    kept: 1,
    again: None,
    polish: 0,
};

static DEFAULT: Preset = Preset {
    whole: effort(2, false, &[]),
    parts: effort(1, false, &[]),
    partitions: [0, 2, 0, 2, 3],
    finished: 1,
    rotations: [2, 1],
    fourth: [true, true],
    kept: 2,
    again: None,
    polish: 1,
};

static BEST: Preset = Preset {
    whole: effort(1, false, &[]),
    parts: effort(0, false, &[]),
    partitions: [16, 24, 24, 16, 24],
    finished: 3,
    rotations: [4, 4],
    fourth: [true, true],
    kept: 4,
    again: Some(effort(2, true, &[0.08, -0.08])),
    polish: 4,
};

/// The preset of a quality.
pub(super) fn preset(quality: Quality) -> &'static Preset {
    match quality {
        Quality::Fast => &FAST,
        Quality::Default => &DEFAULT,
        Quality::Best => &BEST,
    }
}
