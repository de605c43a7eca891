//! Bounds of instances, in the order that culling reads them.
//!
//! The instance bounds section is a structure of arrays: `min.x` of all instances, then `min.y`, `min.z`,
//! `max.x`, `max.y`, `max.z`, each array padded with zeros to a multiple of 16 floats.

mod cull;
mod frustum;
mod scalar;
#[cfg(target_arch = "x86_64")]
mod simd;

use glam::Vec3;

pub use cull::Kernel;
pub use frustum::Frustum;

/// Floats to which each of the six arrays is padded.
pub const LANES: usize = 16;

/// Instances that share one box of the cluster bounds section.
pub const CLUSTER: usize = 64;

/// An axis-aligned box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aabb {
    /// Least corner.
    pub min: Vec3,
    /// Greatest corner.
    pub max: Vec3,
}

impl Aabb {
    /// Contains nothing; the union with it changes nothing.
    pub const EMPTY: Self = Self {
        min: Vec3::INFINITY,
        max: Vec3::NEG_INFINITY,
    };

    /// Every finite point; culling always keeps it.
    pub const EVERYWHERE: Self = Self {
        min: Vec3::splat(f32::MIN),
        max: Vec3::splat(f32::MAX),
    };

    /// The least box around both.
    pub fn union(self, other: Self) -> Self {
        Self {
            min: self.min.min(other.min),
            max: self.max.max(other.max),
        }
    }

    /// The least box around `self` and `point`.
    pub fn include(self, point: Vec3) -> Self {
        self.union(Self {
            min: point,
            max: point,
        })
    }

    /// Whether no point is inside.
    pub fn is_empty(self) -> bool {
        !self.min.cmple(self.max).all()
    }

    /// Middle of the box, computed without overflow.
    pub fn center(self) -> Vec3 {
        self.min * 0.5 + self.max * 0.5
    }

    /// Length of the diagonal.
    pub fn diagonal(self) -> f32 {
        (self.max * 0.5 - self.min * 0.5).length() * 2.0
    }
}

/// Length in floats of each of the six arrays for `count` instances.
pub const fn padded(count: usize) -> usize {
    count.div_ceil(LANES) * LANES
}

/// The bounds section of `boxes`.
pub fn to_arrays(boxes: &[Aabb]) -> Vec<f32> {
    let stride = padded(boxes.len());
    let mut arrays = vec![0.0; stride * 6];
    for (index, aabb) in boxes.iter().enumerate() {
        for axis in 0..3 {
            arrays[axis * stride + index] = aabb.min[axis];
            arrays[(axis + 3) * stride + index] = aabb.max[axis];
        }
    }
    arrays
}

/// Boxes around every [`CLUSTER`] consecutive boxes; the last one may hold fewer. One that is empty or not
/// finite, which culling keeps, makes its cluster [`Aabb::EVERYWHERE`].
pub fn clusters(boxes: &[Aabb]) -> Vec<Aabb> {
    let cluster = |chunk: &[Aabb]| {
        let sound = |aabb: &Aabb| aabb.min.is_finite() && aabb.max.is_finite() && !aabb.is_empty();
        if chunk.iter().all(sound) {
            chunk.iter().copied().fold(Aabb::EMPTY, Aabb::union)
        } else {
            Aabb::EVERYWHERE
        }
    };
    boxes.chunks(CLUSTER).map(cluster).collect()
}

/// A borrowed bounds section.
#[derive(Clone, Copy, Debug)]
pub struct BoundsView<'a> {
    /// `min.x` of all, `min.y`, `min.z`, `max.x`, `max.y`, `max.z`.
    arrays: [&'a [f32]; 6],
    count: usize,
}

impl<'a> BoundsView<'a> {
    /// Views the section of `count` instances; `None` where its length is not `6 * padded(count)`.
    pub fn new(arrays: &'a [f32], count: usize) -> Option<Self> {
        let stride = count.checked_next_multiple_of(LANES)?;
        if arrays.len() != stride.checked_mul(6)? {
            return None;
        }
        let array = |axis: usize| &arrays[axis * stride..(axis + 1) * stride];
        Some(Self {
            arrays: std::array::from_fn(array),
            count,
        })
    }

    /// Instances.
    pub fn len(&self) -> usize {
        self.count
    }

    /// Whether there are no instances.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Box of one instance.
    pub fn get(&self, index: usize) -> Aabb {
        assert!(index < self.count, "instance {index} of {}", self.count);
        let at = |array: usize| self.arrays[array][index];
        Aabb {
            min: Vec3::new(at(0), at(1), at(2)),
            max: Vec3::new(at(3), at(4), at(5)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_give_the_boxes_back() {
        let boxes: Vec<Aabb> = (0..17)
            .map(|i| Aabb {
                min: Vec3::splat(-(i as f32)),
                max: Vec3::new(i as f32, 1.0, 2.0),
            })
            .collect();
        let arrays = to_arrays(&boxes);
        let view = BoundsView::new(&arrays, boxes.len()).expect("length fits");
        assert!((0..17).all(|i| view.get(i) == boxes[i]));
        assert!(BoundsView::new(&arrays, 40).is_none());
        assert!(BoundsView::new(&arrays, usize::MAX).is_none());
    }

    #[test]
    fn clusters_contain_their_boxes() {
        let unit = |x: f32| Aabb {
            min: Vec3::splat(x),
            max: Vec3::splat(x + 1.0),
        };
        let mut boxes: Vec<Aabb> = (0..130).map(|i| unit(i as f32)).collect();
        let of = clusters(&boxes);
        assert_eq!(of.len(), 3);
        assert_eq!((of[1].min.x, of[1].max.x), (64.0, 128.0));
        assert_eq!((of[2].min.x, of[2].max.x), (128.0, 130.0));
        boxes[70].min.y = f32::NAN;
        boxes[129] = Aabb::EMPTY;
        let of = clusters(&boxes);
        assert_eq!(of[1..], [Aabb::EVERYWHERE; 2]);
    }
}
