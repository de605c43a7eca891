//! What each quality tries. The numbers are measured: docs/numbers.md, "BC6H".

use super::super::Quality;

/// See the module.
pub(super) struct Preset {
    /// Rounds of least squares of one region.
    pub whole: u32,
    /// The same of two regions.
    pub parts: u32,
    /// Partitions that are fitted in short.
    pub partitions: usize,
    /// Of those, how many are fitted in full.
    pub finished: usize,
    /// Mean squared error of a channel, in steps of half floats, below which two regions are not tried.
    pub enough: f32,
    /// Rounds of descent over single steps of the stored endpoints.
    pub polish: u32,
}

static FAST: Preset = Preset {
    whole: 1,
    parts: 0,
    partitions: 0,
    finished: 0,
    enough: 0.0,
    polish: 0,
};

static DEFAULT: Preset = Preset {
    whole: 1,
    parts: 1,
    partitions: 4,
    finished: 4,
    enough: 4.0,
    polish: 0,
};

static BEST: Preset = Preset {
    whole: 3,
    parts: 2,
    partitions: 32,
    finished: 4,
    enough: 0.25,
    polish: 2,
};

/// The preset of a quality.
pub(super) fn preset(quality: Quality) -> &'static Preset {
    match quality {
        Quality::Fast => &FAST,
        Quality::Default => &DEFAULT,
        Quality::Best => &BEST,
    }
}
