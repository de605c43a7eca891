//! Which corner of each class stands for it in the reference, where that matters.
//!
//! The reference welds slab by slab and halves each slab with an unstable partition until a part has no extent;
//! the first corner of a class in the order that remains stands for the class. The order must be replayed.

use super::classes::Classes;
use super::{Corners, NONE, flag};

const SLABS: usize = 2048;

/// Box around all positions.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bounds {
    pub(super) low: [f32; 3],
    pub(super) high: [f32; 3],
}

#[derive(Clone, Copy)]
struct Item {
    position: [f32; 3],
    corner: u32,
    slab: u16,
    needed: bool,
}

/// What the replay found.
pub(super) struct Representatives {
    /// Representative corner of each class; [`NONE`] where it was not needed.
    pub(super) of: Vec<u32>,
    /// Corners that the reference does not weld, because a midpoint overflows; only of needed classes.
    pub(super) loose: Vec<u32>,
}

/// Replays the weld for the classes where `needed` is true, or for all.
pub(super) fn representatives<C: Corners + ?Sized>(
    corners: &C,
    flags: &[u8],
    classes: &Classes,
    bounds: Bounds,
    needed: Option<&[bool]>,
) -> Representatives {
    let mut replay = Replay {
        classes,
        found: Representatives {
            of: vec![NONE; classes.count()],
            loose: Vec::new(),
        },
    };
    let mut items = collect(corners, flags, classes, bounds, needed);
    items.sort_by_key(|item| item.slab);
    for slab in items.chunk_by_mut(|a, b| a.slab == b.slab) {
        replay.slab(slab);
    }
    replay.found
}

/// The corners of all slabs with a needed class, sound triangles first.
fn collect<C: Corners + ?Sized>(
    corners: &C,
    flags: &[u8],
    classes: &Classes,
    bounds: Bounds,
    needed: Option<&[bool]>,
) -> Vec<Item> {
    let axis = longest(bounds);
    let (low, extent) = (bounds.low[axis], bounds.high[axis] - bounds.low[axis]);
    // The cast takes NaN to zero.
    let slab = |value: f32| {
        let at = SLABS as f32 * ((value - low) / extent).clamp(0.0, 1.0);
        (at as u16).min(SLABS as u16 - 1)
    };
    let mut used = [needed.is_none(); SLABS];
    if let Some(needed) = needed {
        let firsts = classes.first.iter().zip(needed);
        for (corner, _) in firsts.filter(|(_, needed)| **needed) {
            used[usize::from(slab(corners.position(*corner as usize)[axis]))] = true;
        }
    }
    let mut items = Vec::new();
    for pass in [0, flag::DEGENERATE] {
        let triangles = flags.iter().enumerate();
        let chosen = triangles.filter(|(_, flags)| *flags & flag::DEGENERATE == pass);
        for corner in chosen.flat_map(|(triangle, _)| triangle * 3..triangle * 3 + 3) {
            let position = corners.position(corner);
            let slab = slab(position[axis]);
            if used[usize::from(slab)] {
                items.push(Item {
                    position,
                    corner: corner as u32,
                    slab,
                    needed: needed.is_none_or(|needed| needed[classes.of[corner] as usize]),
                });
            }
        }
    }
    items
}

fn longest(bounds: Bounds) -> usize {
    let [x, y, z] = std::array::from_fn(|axis| bounds.high[axis] - bounds.low[axis]);
    if y > x && y > z {
        1
    } else if z > x {
        2
    } else {
        0
    }
}

struct Replay<'a> {
    classes: &'a Classes,
    found: Representatives,
}

impl Replay<'_> {
    fn slab(&mut self, items: &mut [Item]) {
        let mut stack = vec![(0, items.len())];
        while let Some((start, end)) = stack.pop() {
            let part = &mut items[start..end];
            if !part.iter().any(|item| item.needed) {
                continue;
            }
            if part.len() < 2 {
                self.weld(part);
                continue;
            }
            let bounds = enclose(part);
            let axis = longest(bounds);
            let (low, high) = (bounds.low[axis], bounds.high[axis]);
            let middle = 0.5 * (high + low);
            if !middle.is_finite() {
                self.found.loose.extend(part.iter().map(|item| item.corner));
                self.weld(part);
            } else if low < middle && middle < high {
                let split = start + partition(part, axis, middle);
                stack.push((start, split));
                stack.push((split, end));
            } else {
                self.weld(part);
            }
        }
    }

    /// Equal corners always end in the same part.
    fn weld(&mut self, part: &[Item]) {
        for item in part {
            let class = self.classes.of[item.corner as usize] as usize;
            if self.found.of[class] == NONE {
                self.found.of[class] = item.corner;
            }
        }
    }
}

fn enclose(part: &[Item]) -> Bounds {
    let mut low = part[0].position;
    let mut high = low;
    for item in &part[1..] {
        for axis in 0..3 {
            low[axis] = low[axis].min(item.position[axis]);
            high[axis] = high[axis].max(item.position[axis]);
        }
    }
    Bounds { low, high }
}

/// Moves what lies below `middle` to the front by swaps from both ends, and returns how many do; NaN stays put.
fn partition(part: &mut [Item], axis: usize, middle: f32) -> usize {
    // Both are false for NaN.
    let at_least = |item: &Item| item.position[axis] >= middle;
    let below = |item: &Item| item.position[axis] < middle;
    let (mut start, mut end) = (0, part.len());
    while end - start >= 2 {
        while start < end && !at_least(&part[start]) {
            start += 1;
        }
        if start == end {
            return start;
        }
        let left = start;
        start += 1;
        while start < end && !below(&part[end - 1]) {
            end -= 1;
        }
        if start == end {
            start = left;
            end = left + 1;
            break;
        }
        end -= 1;
        part.swap(left, end);
    }
    if start < end && below(&part[start]) {
        start + 1
    } else {
        start
    }
}
