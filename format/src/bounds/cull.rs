//! Culling of many boxes by the fastest kernel that the processor has.

use std::ops::Range;

use super::frustum::HalfSpace;
use super::scalar::{self, INSIDE, PART_TOUCHES};
#[cfg(target_arch = "x86_64")]
use super::simd;
use super::{BoundsView, CLUSTER, Frustum, LANES};

/// Ranges too short to pay for a vector's setup.
const FEW: usize = 4;

/// A way to test many boxes. All give the same bits, so that the visible set depends on none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kernel {
    /// Portable code, one box at a time; stands in for those that the processor lacks.
    Scalar,
    /// 4 boxes at a time.
    Sse2,
    /// 8 boxes at a time.
    Avx2,
    /// 16 boxes at a time.
    Avx512,
}

impl Kernel {
    /// From the slowest to the fastest.
    pub const ALL: [Self; 4] = [Self::Scalar, Self::Sse2, Self::Avx2, Self::Avx512];

    /// The fastest one that this processor runs.
    pub fn best() -> Self {
        let found = Self::ALL.into_iter().rfind(|kernel| kernel.is_available());
        found.unwrap_or(Self::Scalar)
    }

    /// Whether this processor runs it.
    #[cfg(target_arch = "x86_64")]
    pub fn is_available(self) -> bool {
        match self {
            Self::Scalar | Self::Sse2 => true,
            Self::Avx2 => is_x86_feature_detected!("avx2"),
            Self::Avx512 => is_x86_feature_detected!("avx512f"),
        }
    }

    /// Whether this processor runs it.
    #[cfg(not(target_arch = "x86_64"))]
    pub fn is_available(self) -> bool {
        self == Self::Scalar
    }

    fn keep(
        self,
        half_spaces: &[HalfSpace],
        view: &BoundsView,
        range: Range<usize>,
        visible: &mut Vec<u32>,
    ) {
        #[cfg(target_arch = "x86_64")]
        if range.len() >= FEW {
            return simd::keep(self, half_spaces, view, range, visible);
        }
        scalar::keep(half_spaces, view, range, visible);
    }

    fn mask<const QUESTION: u8>(
        self,
        half_spaces: &[HalfSpace],
        view: &BoundsView,
        chunk: &Chunk,
    ) -> u64 {
        #[cfg(target_arch = "x86_64")]
        let mask = simd::mask::<QUESTION>(self, half_spaces, view, chunk.base, chunk.blocks());
        #[cfg(not(target_arch = "x86_64"))]
        let mask = scalar::mask::<QUESTION>(half_spaces, view, chunk.base, chunk.blocks());
        mask & chunk.within
    }
}

impl Frustum {
    /// Appends to `visible` every index of `range` whose box may be seen, in ascending order. Allocates only
    /// where `visible` lacks capacity for `range` and 64 more.
    ///
    /// # Panics
    /// Where `range` ends behind the last box.
    pub fn cull(&self, bounds: &BoundsView, range: Range<u32>, visible: &mut Vec<u32>) {
        self.cull_on(Kernel::best(), bounds, range, visible);
    }

    /// [`Self::cull`] on one kernel.
    ///
    /// # Panics
    /// As [`Self::cull`].
    pub fn cull_on(
        &self,
        kernel: Kernel,
        bounds: &BoundsView,
        range: Range<u32>,
        visible: &mut Vec<u32>,
    ) {
        let range = checked(bounds, range, visible);
        kernel.keep(self.half_spaces(), bounds, range, visible);
    }

    /// [`Self::cull`] with the same result, but first by `clusters`, the boxes around every [`CLUSTER`]
    /// consecutive boxes (see [`super::clusters`]): the boxes of one outside are skipped, those of one inside
    /// all planes appended, without a test.
    ///
    /// # Panics
    /// As [`Self::cull`], and where there are not as many clusters as the boxes need.
    pub fn cull_clustered(
        &self,
        bounds: &BoundsView,
        clusters: &BoundsView,
        range: Range<u32>,
        visible: &mut Vec<u32>,
    ) {
        self.cull_clustered_on(Kernel::best(), bounds, clusters, range, visible);
    }

    /// [`Self::cull_clustered`] on one kernel.
    ///
    /// # Panics
    /// As [`Self::cull_clustered`].
    pub fn cull_clustered_on(
        &self,
        kernel: Kernel,
        bounds: &BoundsView,
        clusters: &BoundsView,
        range: Range<u32>,
        visible: &mut Vec<u32>,
    ) {
        let (boxes, found) = (bounds.len(), clusters.len());
        assert!(
            found == boxes.div_ceil(CLUSTER),
            "{found} clusters of {boxes} boxes"
        );
        let range = checked(bounds, range, visible);
        let half_spaces = self.half_spaces();
        let mut emit = |run: Range<usize>, is_inside: bool| {
            let members =
                (run.start * CLUSTER).max(range.start)..(run.end * CLUSTER).min(range.end);
            if is_inside {
                visible.extend(members.start as u32..members.end as u32);
            } else {
                kernel.keep(half_spaces, bounds, members, visible);
            }
        };
        // Alike neighbours wait to be one run: starting the kernel anew costs it the prefetched boxes.
        let mut waiting = (0..0, false);
        for chunk in chunks(range.start / CLUSTER..range.end.div_ceil(CLUSTER)) {
            let mut touching = kernel.mask::<PART_TOUCHES>(half_spaces, clusters, &chunk);
            if touching == 0 {
                continue;
            }
            let inside = kernel.mask::<INSIDE>(half_spaces, clusters, &chunk);
            while touching != 0 {
                let first = touching.trailing_zeros();
                let is_inside = inside >> first & 1 != 0;
                let alike = touching & if is_inside { inside } else { !inside };
                let length = (alike >> first).trailing_ones();
                touching &= !(u64::MAX >> (64 - length) << first);
                let start = chunk.base + first as usize;
                let run = start..start + length as usize;
                if waiting.0.end == run.start && waiting.1 == is_inside {
                    waiting.0.end = run.end;
                } else {
                    let (before, was_inside) = std::mem::replace(&mut waiting, (run, is_inside));
                    if !before.is_empty() {
                        emit(before, was_inside);
                    }
                }
            }
        }
        if !waiting.0.is_empty() {
            emit(waiting.0, waiting.1);
        }
    }
}

/// `range` as indices of existing boxes; makes room for all of them and a kernel's last whole vectors.
fn checked(bounds: &BoundsView, range: Range<u32>, visible: &mut Vec<u32>) -> Range<usize> {
    let (start, end) = (range.start as usize, range.end as usize);
    assert!(end <= bounds.len(), "box {end} of {}", bounds.len());
    visible.reserve(end.saturating_sub(start) + 64);
    start.min(end)..end
}

/// 64 boxes that begin at a multiple of 64, and which of them are asked for.
pub(super) struct Chunk {
    /// First box.
    pub base: usize,
    /// Bit `i` for box `base + i`; never zero.
    pub within: u64,
}

impl Chunk {
    /// The blocks of [`LANES`] boxes that hold what is asked for.
    #[inline(always)]
    pub fn blocks(&self) -> Range<usize> {
        let (first, behind) = (
            self.within.trailing_zeros(),
            64 - self.within.leading_zeros(),
        );
        first as usize / LANES..(behind as usize).div_ceil(LANES)
    }
}

/// The chunks that hold `range`.
#[inline(always)]
pub(super) fn chunks(range: Range<usize>) -> impl Iterator<Item = Chunk> {
    let aligned = range.start / 64 * 64;
    (aligned..range.end).step_by(64).map(move |base| {
        let below = range.start.saturating_sub(base);
        let above = 64 - (range.end - base).min(64);
        Chunk {
            base,
            within: u64::MAX << below & u64::MAX >> above,
        }
    })
}
