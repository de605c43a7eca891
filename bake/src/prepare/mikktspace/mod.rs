//! Tangent spaces of MikkTSpace in linear time.
//!
//! Mikkelsen, "Simulation of Wrinkled Surfaces Revisited", 2008. The result equals that of the reference
//! implementation bit for bit, with its default threshold of 180 degrees, on triangles: groups, order of sums,
//! and an order of edges that is a slip of the reference but part of every normal map baked with it.
//! What the reference finds by comparing all with all (equal corners, neighbours, the equals of corners of
//! degenerate triangles) is found here by hashing and counting.

mod arc_cosine;
mod classes;
mod derive;
mod groups;
mod last_edges;
mod representatives;
mod split;
#[cfg(test)]
mod tests;
mod twins;
mod vector;

pub use split::{MAX_SPLIT, TooWide};

use classes::Classes;
use derive::Derived;
use representatives::Bounds;

const NONE: u32 = u32::MAX;

/// Coordinates beyond this may have midpoints that overflow, near which the reference does not weld.
const SAFE: f32 = 1e38;

/// Bits per triangle.
mod flag {
    /// Two corners have the same position.
    pub(super) const DEGENERATE: u8 = 1;
    /// The texture coordinates say nothing.
    pub(super) const ANY: u8 = 2;
    /// The texture is not mirrored.
    pub(super) const PRESERVING: u8 = 4;
    /// All of [`assigned`].
    pub(super) const ALL_ASSIGNED: u8 = 8 + 16 + 32;

    /// Corner 0, 1 or 2 belongs to a group.
    pub(super) const fn assigned(vertex: u32) -> u8 {
        8 << vertex
    }
}

/// A triangle list: corner `c` belongs to triangle `c / 3`.
pub trait Corners: Sync {
    /// Corners, a multiple of three below 2^31.
    fn count(&self) -> usize;
    /// Position.
    fn position(&self, corner: usize) -> [f32; 3];
    /// Unit normal.
    fn normal(&self, corner: usize) -> [f32; 3];
    /// Texture coordinates.
    fn uv(&self, corner: usize) -> [f32; 2];
}

/// Corners in arrays of equal length.
#[derive(Clone, Copy, Debug)]
pub struct Soup<'a> {
    /// Position of each corner.
    pub positions: &'a [[f32; 3]],
    /// Normal of each corner.
    pub normals: &'a [[f32; 3]],
    /// Texture coordinates of each corner.
    pub uvs: &'a [[f32; 2]],
}

impl Corners for Soup<'_> {
    #[inline]
    fn count(&self) -> usize {
        self.positions.len()
    }

    #[inline]
    fn position(&self, corner: usize) -> [f32; 3] {
        self.positions[corner]
    }

    #[inline]
    fn normal(&self, corner: usize) -> [f32; 3] {
        self.normals[corner]
    }

    #[inline]
    fn uv(&self, corner: usize) -> [f32; 2] {
        self.uvs[corner]
    }
}

/// The unit tangent of every corner, with w +1 where the texture is not mirrored and -1 where it is; all zero where
/// MikkTSpace gives none.
///
/// The bitangent is w * cross(normal, tangent) with V pointing up, as in the reference. Numbers that are not finite
/// end in some tangent, perhaps not finite itself, and do not affect corners that share no vertex with them. The
/// result does not depend on the number of threads.
///
/// # Errors
/// [`TooWide`] where more than [`MAX_SPLIT`] corners share a vertex and some of their tangents are opposite.
///
/// # Panics
/// Where [`Corners::count`] breaks its promise.
pub fn generate<C: Corners + ?Sized>(corners: &C) -> Result<Vec<[f32; 4]>, TooWide> {
    let count = corners.count();
    assert!(
        count.is_multiple_of(3) && count < 1 << 31,
        "{count} corners"
    );
    let (mut derived, mut classes) =
        rayon::join(|| derive::derive(corners), || classes::classes(corners));
    let bounds = Bounds {
        low: derived.low,
        high: derived.high,
    };
    let extremes = bounds.low.iter().chain(&bounds.high);
    if count > 0 && !extremes.copied().all(|value| value.abs() <= SAFE) {
        let found =
            representatives::representatives(corners, &derived.flags, &classes, bounds, None);
        classes.separate(&found.loose);
    }
    let edges = twins::Edges::new(&classes.of, classes.count(), &derived.flags);
    let mut twins = edges.pair(count);
    last_edges::repair(
        corners,
        &derived.flags,
        &classes,
        bounds,
        &edges,
        &mut twins,
    );
    drop(edges);
    groups::tangents(corners, &mut derived, &twins)?;
    let Derived {
        flags,
        corners: mut tangents,
        ..
    } = derived;
    inherit(&flags, &classes, &mut tangents);
    Ok(tangents)
}

/// Gives corners of degenerate triangles the tangent of the first corner of a sound one that equals them.
fn inherit(flags: &[u8], classes: &Classes, tangents: &mut [[f32; 4]]) {
    let degenerate = |corner: usize| flags[corner / 3] & flag::DEGENERATE != 0;
    if !flags.iter().any(|flags| flags & flag::DEGENERATE != 0) {
        return;
    }
    let mut sources = vec![NONE; classes.count()];
    for corner in (0..tangents.len()).filter(|corner| !degenerate(*corner)) {
        let source = &mut sources[classes.of[corner] as usize];
        if *source == NONE {
            *source = corner as u32;
        }
    }
    for corner in (0..tangents.len()).filter(|corner| degenerate(*corner)) {
        let source = sources[classes.of[corner] as usize];
        if source != NONE {
            tangents[corner] = tangents[source as usize];
        }
    }
}
