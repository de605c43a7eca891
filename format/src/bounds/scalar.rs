//! Portable box tests, the twin of the SIMD kernels: same operations in the same order, so same bits.

use std::ops::Range;

use super::frustum::{HalfSpace, MARGIN};
use super::{BoundsView, CLUSTER, LANES};

/// Whether a box may touch the inside.
pub(super) const TOUCHES: u8 = 0;
/// Whether a box within this one may.
pub(super) const PART_TOUCHES: u8 = 1;
/// Whether every box within this one surely passes [`TOUCHES`].
pub(super) const INSIDE: u8 = 2;

/// Bound of the size of a box over the size of one around it. On each axis the inner box's two magnitudes are at
/// most the greater one of the outer; twice as much again covers the roundings of both sums.
pub(super) const PART_SIZE: f32 = 4.0;

/// One answer for a box given by its six coordinates.
///
/// Rounding is monotone, so that what a box answers follows for the boxes within it, without any error bound.
/// Their farthest corners give products, and so sums, no greater than its own, and their sizes are at most
/// [`PART_SIZE`] times its own: where it fails `PART_TOUCHES`, they fail `TOUCHES`. Their farthest corners are no
/// less than its nearest one, and no threshold is above zero: where it passes `INSIDE`, they pass `TOUCHES`.
pub(super) fn keeps<const QUESTION: u8>(half_spaces: &[HalfSpace], corners: &[f32; 6]) -> bool {
    let threshold = threshold::<QUESTION>(corners);
    half_spaces.iter().all(|half_space| {
        let [x, y, z] = match QUESTION {
            INSIDE => half_space.nearest,
            _ => half_space.farthest,
        };
        let [a, b, c] = half_space.normal;
        let distance = a * corners[x] + b * corners[y] + c * corners[z] + half_space.offset;
        match QUESTION {
            INSIDE => distance >= threshold,
            // What is not a number, as huge boxes give, must keep the box.
            _ => !matches!(
                distance.partial_cmp(&threshold),
                Some(std::cmp::Ordering::Less)
            ),
        }
    })
}

/// The distance below which a box is surely outside.
fn threshold<const QUESTION: u8>(corners: &[f32; 6]) -> f32 {
    let axis = |axis: usize| corners[axis].abs() + corners[axis + 3].abs();
    let size = axis(0) + axis(1) + axis(2);
    match QUESTION {
        INSIDE => 0.0,
        PART_TOUCHES => size * PART_SIZE * -MARGIN,
        _ => size * -MARGIN,
    }
}

/// Answers for the boxes `base + 16 * blocks.start..base + 16 * blocks.end`: box `base + i` in bit `i`.
pub(super) fn mask<const QUESTION: u8>(
    half_spaces: &[HalfSpace],
    view: &BoundsView,
    base: usize,
    blocks: Range<usize>,
) -> u64 {
    let mut mask = 0;
    for bit in blocks.start * LANES..blocks.end * LANES {
        let corners = view.arrays.map(|array| array[base + bit]);
        mask |= u64::from(keeps::<QUESTION>(half_spaces, &corners)) << bit;
    }
    mask
}

/// Appends every box of `range` that may touch the inside.
pub(super) fn keep(
    half_spaces: &[HalfSpace],
    view: &BoundsView,
    range: Range<usize>,
    visible: &mut Vec<u32>,
) {
    for index in range {
        let corners = view.arrays.map(|array| array[index]);
        if keeps::<TOUCHES>(half_spaces, &corners) {
            visible.push(index as u32);
        }
    }
}

/// Appends `base + i` for every set bit `i`.
pub(super) fn append(mut mask: u64, base: u32, visible: &mut Vec<u32>) {
    let mut indices = [0; CLUSTER];
    let mut count = 0;
    while mask != 0 {
        indices[count] = base + mask.trailing_zeros();
        count += 1;
        mask &= mask - 1;
    }
    visible.extend_from_slice(&indices[..count]);
}
