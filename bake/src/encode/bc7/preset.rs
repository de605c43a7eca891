//! What each quality tries. The numbers are measured: docs/numbers.md, "BC7".

use super::super::Quality;
use super::fit::Effort;

/// See the module.
pub(super) struct Preset {
    /// Of mode 6.
    pub whole: Effort,
    /// Of all other modes.
    pub parts: Effort,
    /// Squared error of a block by mode 6 with which nothing else is tried.
    pub enough: f32,
    /// Most partitions of modes 0, 1, 2, 3 (opaque) and 7 (alpha).
    pub partitions: [usize; 5],
    /// Most ways of modes 4 and 5; of blocks with alpha first, then of opaque ones.
    pub rotated: [[usize; 2]; 2],
    /// Most ways besides mode 6 that are fitted, the least estimated errors first.
    pub tried: usize,
    /// Largest estimated error of those, in units of that of mode 6; of blocks with alpha first, then of opaque ones.
    pub promise: [f32; 2],
    /// Ways of a block that are kept to be polished, at least one.
    pub kept: usize,
    /// Another fit of those that are kept.
    pub again: Option<Effort>,
    /// Most further rounds of least squares of those.
    pub rounds: u32,
    /// Most rounds of descent over single steps.
    pub descents: u32,
    /// Whether both ends of a channel are stepped at once, too.
    pub pairs: bool,
}

impl Preset {
    pub fn polishes(&self) -> bool {
        self.again.is_some() || self.rounds + self.descents > 0
    }
}

const fn rounds(rounds: u32) -> Effort {
    Effort {
        rounds,
        parities: false,
        insets: &[],
        level: false,
    }
}

static FAST: Preset = Preset {
    whole: rounds(2),
    parts: rounds(1),
    enough: 0.0,
    partitions: [0; 5],
    rotated: [[1, 1], [0, 1]],
    tried: 2,
    promise: [4.0, 0.4],
    kept: 1,
    again: None,
    rounds: 0,
    descents: 0,
    pairs: false,
};

static DEFAULT: Preset = Preset {
    whole: rounds(2),
    parts: rounds(1),
    enough: 1.0,
    partitions: [1, 2, 0, 2, 2],
    rotated: [[1, 1], [1, 1]],
    tried: 5,
    promise: [4.0; 2],
    kept: 1,
    again: None,
    rounds: 0,
    descents: 1,
    pairs: false,
};

static BEST: Preset = Preset {
    whole: rounds(2),
    parts: Effort {
        level: true,
        ..rounds(1)
    },
    enough: 0.0,
    partitions: [4, 12, 4, 12, 12],
    rotated: [[4, 2], [4, 2]],
    tried: 40,
    promise: [1000.0; 2],
    kept: 6,
    again: Some(Effort {
        parities: true,
        insets: &[0.08, -0.08],
        level: true,
        ..rounds(2)
    }),
    rounds: 1,
    descents: 2,
    pairs: true,
};

/// The preset of a quality.
pub(super) fn preset(quality: Quality) -> &'static Preset {
    match quality {
        Quality::Fast => &FAST,
        Quality::Default => &DEFAULT,
        Quality::Best => &BEST,
    }
}
