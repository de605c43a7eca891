//! Groups of corners that share a tangent.

use super::derive::{ALL_DIRECTIONS, Derived, TANGENT_DIRECTIONS};
use super::split::{self, TooWide};
use super::twins::{after, before};
use super::vector::V3;
use super::{Corners, NONE, flag};

/// Members up to which sorting by insertion is faster.
const FEW: usize = 16;

/// Walks around the vertices, and turns the corners' shares into tangents and orientation; zero for corners without
/// a group.
///
/// Two edges of a triangle meet in a corner and each has at most one twin, so a group is a chain: the recursion of
/// the reference visits it first one way, then the other.
pub(super) fn tangents<C: Corners + ?Sized>(
    corners: &C,
    derived: &mut Derived,
    twins: &[u32],
) -> Result<(), TooWide> {
    let mut members = Vec::new();
    for triangle in 0..derived.flags.len() {
        for vertex in 0..3 {
            let flags = derived.flags[triangle];
            if flags & (flag::DEGENERATE | flag::ANY | flag::assigned(vertex)) != 0 {
                continue;
            }
            let seed = triangle as u32 * 3 + vertex;
            gather(seed, &mut derived.flags, twins, &mut members);
            sort(&mut members);
            let w = if flags & flag::PRESERVING != 0 {
                1.0
            } else {
                -1.0
            };
            if one_direction(derived, &members) {
                let V3 { x, y, z } = sum(derived, &members);
                for corner in &members {
                    derived.corners[*corner as usize] = [x, y, z, w];
                }
            } else {
                let split = split::tangents(corners, derived, &members)?;
                for (corner, V3 { x, y, z }) in members.iter().zip(split) {
                    derived.corners[*corner as usize] = [x, y, z, w];
                }
            }
        }
    }
    clear(derived);
    Ok(())
}

/// Zeroes the corners that no group has reached.
fn clear(derived: &mut Derived) {
    let triangles = derived
        .flags
        .iter()
        .zip(derived.corners.chunks_exact_mut(3));
    for (flags, corners) in triangles {
        if flags & (flag::DEGENERATE | flag::ANY) != 0 {
            for (vertex, corner) in (0..3).zip(corners) {
                if flags & flag::assigned(vertex) == 0 {
                    *corner = [0.0; 4];
                }
            }
        }
    }
}

/// Collects the corners of the group of `seed`, and marks them.
#[inline]
fn gather(seed: u32, flags: &mut [u8], twins: &[u32], members: &mut Vec<u32>) {
    let orientation = flags[seed as usize / 3] & flag::PRESERVING;
    members.clear();
    members.push(seed);
    flags[seed as usize / 3] |= flag::assigned(seed % 3);
    let mut at = seed;
    loop {
        let twin = twins[before(at) as usize];
        if twin == NONE || !join(twin, orientation, flags) {
            break;
        }
        members.push(twin);
        at = twin;
    }
    at = seed;
    loop {
        let twin = twins[at as usize];
        if twin == NONE {
            break;
        }
        at = after(twin);
        if !join(at, orientation, flags) {
            break;
        }
        members.push(at);
    }
}

/// Marks `corner` as grouped, unless it already is or its triangle is oriented the other way.
#[inline(always)]
fn join(corner: u32, orientation: u8, flags: &mut [u8]) -> bool {
    let own = flag::assigned(corner % 3);
    let flags = &mut flags[corner as usize / 3];
    if *flags & own != 0 {
        return false;
    }
    // The first group that reaches a triangle without usable coordinates decides its orientation.
    if *flags & (flag::ANY | flag::ALL_ASSIGNED) == flag::ANY {
        *flags = (*flags & !flag::PRESERVING) | orientation;
    }
    if *flags & flag::PRESERVING != orientation {
        return false;
    }
    *flags |= own;
    true
}

/// The order of triangles decides the bits of sums.
#[inline]
fn sort(members: &mut [u32]) {
    if members.len() > FEW {
        members.sort_unstable();
        return;
    }
    for end in 1..members.len() {
        let value = members[end];
        let mut at = end;
        while at > 0 && members[at - 1] > value {
            members[at] = members[at - 1];
            at -= 1;
        }
        members[at] = value;
    }
}

/// Whether neither the tangents nor the bitangents of any two members can be opposite.
#[inline]
fn one_direction(derived: &Derived, members: &[u32]) -> bool {
    let common = members.iter().fold(ALL_DIRECTIONS, |common, corner| {
        common & derived.corners[*corner as usize][3].to_bits()
    });
    common & TANGENT_DIRECTIONS != 0 && common & !TANGENT_DIRECTIONS != 0
}

/// The tangent that `members`, in ascending order, have in common.
#[inline]
pub(super) fn sum(derived: &Derived, members: &[u32]) -> V3 {
    let mut total = V3::default();
    for corner in members {
        let [x, y, z, _] = derived.corners[*corner as usize];
        total = total.add(V3 { x, y, z });
    }
    total.normalized()
}
