//! The bound that every index of the arena must keep.

use std::collections::BTreeMap;

use cairn_format::{Package, check};

/// A run of the index arena with the least vertex count of the primitives that use it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Segment {
    start: u64,
    end: u64,
    vertex_count: u32,
}

/// Disjoint segments in ascending order. Primitives of a hostile package may overlap in any way: one pass over the
/// segments still checks each index once.
#[derive(Debug)]
pub(super) struct Segments {
    segments: Vec<Segment>,
    /// First segment that ends behind what was checked.
    next: usize,
}

impl Segments {
    pub(super) fn new(package: &Package) -> Self {
        let primitives = package.scene().primitives.iter().map(|primitive| {
            let first = u64::from(primitive.first_index.to_native());
            let count = u64::from(primitive.index_count.to_native());
            (first, first + count, primitive.vertex_count.to_native())
        });
        Self {
            segments: sweep(primitives),
            next: 0,
        }
    }

    /// Checks a run of indices that begins at `first`; runs come in ascending order.
    pub(super) fn check(&mut self, indices: &[u32], first: u64) -> cairn_format::Result<()> {
        let end = first + indices.len() as u64;
        while let Some(segment) = self.segments.get(self.next) {
            if segment.start >= end {
                break;
            }
            let from = segment.start.max(first);
            let to = segment.end.min(end);
            if from < to {
                let run = &indices[(from - first) as usize..(to - first) as usize];
                check::indices(run, from as usize, segment.vertex_count)?;
            }
            if segment.end > end {
                break;
            }
            self.next += 1;
        }
        Ok(())
    }
}

/// Segments of ranges `(start, end, vertex count)`.
fn sweep(ranges: impl Iterator<Item = (u64, u64, u32)>) -> Vec<Segment> {
    let mut events: Vec<(u64, bool, u32)> = ranges
        .filter(|(start, end, _)| start < end)
        .flat_map(|(start, end, count)| [(start, true, count), (end, false, count)])
        .collect();
    events.sort_unstable();
    let mut segments: Vec<Segment> = Vec::new();
    let mut active: BTreeMap<u32, u32> = BTreeMap::new();
    let mut position = 0;
    for (at, begins, count) in events {
        if let (Some((least, _)), true) = (active.first_key_value(), position < at) {
            segments.push(Segment {
                start: position,
                end: at,
                vertex_count: *least,
            });
        }
        position = at;
        let users = active.entry(count).or_default();
        if begins {
            *users += 1;
        } else {
            *users -= 1;
        }
        if *users == 0 {
            active.remove(&count);
        }
    }
    segments
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn segments(ranges: &[(u64, u64, u32)]) -> Segments {
        Segments {
            segments: sweep(ranges.iter().copied()),
            next: 0,
        }
    }

    proptest! {
        #[test]
        fn every_index_keeps_the_least_bound_of_its_primitives(
            ranges in prop::collection::vec((0u64..40, 0u64..20, 1u32..6), 0..8),
            indices in prop::collection::vec(0u32..6, 60),
            run in 1usize..17,
        ) {
            let ranges: Vec<_> = ranges.iter().map(|(s, n, c)| (*s, s + n, *c)).collect();
            let good = (0u64..).zip(&indices).all(|(at, index)| {
                ranges.iter().all(|(start, end, count)| !(*start..*end).contains(&at) || index < count)
            });
            let mut segments = segments(&ranges);
            let mut first = 0;
            let checked = indices.chunks(run).try_for_each(|chunk| {
                let result = segments.check(chunk, first);
                first += chunk.len() as u64;
                result
            });
            prop_assert_eq!(checked.is_ok(), good);
        }
    }

    #[test]
    fn a_million_overlapping_primitives_stay_cheap() {
        let ranges = (0..1_000_000u64).map(|start| (start % 7, 3_000_000 - start, 9));
        assert!(sweep(ranges).len() <= 2_000_000);
    }

    #[test]
    fn neighbours_do_not_share_a_bound() {
        let mut segments = segments(&[(0, 3, 3), (3, 6, 8)]);
        assert!(segments.check(&[0, 1, 2, 7, 7, 7, 99], 0).is_ok());
        assert!(
            super::tests::segments(&[(0, 3, 3), (3, 6, 8)])
                .check(&[0, 1, 3, 0, 0, 0], 0)
                .is_err()
        );
    }
}
