//! Groups in which some tangents are opposite: every corner averages over those that are not opposite to its own.

use super::derive::{Derived, first_order};
use super::groups::sum;
use super::vector::V3;
use super::{Corners, flag};

/// Largest group that may be split. The sums of its members differ in terms and in rounding, so that exact results
/// take quadratic time.
pub const MAX_SPLIT: usize = 1 << 15;

/// A group beyond [`MAX_SPLIT`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TooWide {
    /// Corners in the group.
    pub corners: usize,
}

/// Cosine that the vectors of two corners of one average must exceed.
const THRESHOLD: f32 = -1.0;

struct Member {
    corner: u32,
    any: bool,
    normal: V3,
    order: [V3; 2],
}

impl Member {
    fn new<C: Corners + ?Sized>(corners: &C, derived: &Derived, corner: u32) -> Self {
        let first = corner as usize / 3 * 3;
        let triangle = [first, first + 1, first + 2];
        let order = first_order(
            triangle.map(|corner| V3::new(corners.position(corner))),
            triangle.map(|corner| corners.uv(corner)),
        );
        Self {
            corner,
            any: derived.flags[first / 3] & flag::ANY != 0,
            normal: V3::new(corners.normal(corner as usize)),
            order: [order.tangent, order.bitangent],
        }
    }

    /// Tangent and bitangent seen along `normal`.
    fn seen(&self, normal: V3) -> [V3; 2] {
        self.order.map(|vector| vector.project(normal).normalized())
    }
}

/// The tangent of each of `members`, which ascend.
pub(super) fn tangents<C: Corners + ?Sized>(
    corners: &C,
    derived: &Derived,
    members: &[u32],
) -> Result<Vec<V3>, TooWide> {
    if members.len() > MAX_SPLIT {
        return Err(TooWide {
            corners: members.len(),
        });
    }
    let group: Vec<Member> = members
        .iter()
        .map(|corner| Member::new(corners, derived, *corner))
        .collect();
    // All members have the normal of one vertex.
    let normal = group[0].normal;
    let seen: Vec<[V3; 2]> = group.iter().map(|member| member.seen(normal)).collect();
    let mut tangents = Vec::with_capacity(group.len());
    let mut chosen = Vec::with_capacity(group.len());
    for (at, a) in group.iter().enumerate() {
        chosen.clear();
        for (to, b) in group.iter().enumerate() {
            let close = (0..2).all(|which| seen[at][which].dot(seen[to][which]) > THRESHOLD);
            if at == to || a.any || b.any || close {
                chosen.push(b.corner);
            }
        }
        tangents.push(sum(derived, &chosen));
    }
    Ok(tangents)
}
