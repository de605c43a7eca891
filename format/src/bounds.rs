//! Bounds of instances, in the order that culling reads them.
//!
//! The instance bounds section is a structure of arrays: `min.x` of all instances, then `min.y`, `min.z`,
//! `max.x`, `max.y`, `max.z`, each array padded with zeros to a multiple of 16 floats.

use glam::{Mat4, Vec3, Vec4};

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

/// Boxes around every [`CLUSTER`] consecutive boxes; the last one may hold fewer.
pub fn clusters(boxes: &[Aabb]) -> Vec<Aabb> {
    let union = |chunk: &[Aabb]| chunk.iter().copied().fold(Aabb::EMPTY, Aabb::union);
    boxes.chunks(CLUSTER).map(union).collect()
}

/// A borrowed bounds section.
#[derive(Clone, Copy, Debug)]
pub struct BoundsView<'a> {
    arrays: &'a [f32],
    count: usize,
}

impl<'a> BoundsView<'a> {
    /// Views the section of `count` instances; `None` where its length is not `6 * padded(count)`.
    pub fn new(arrays: &'a [f32], count: usize) -> Option<Self> {
        (arrays.len() == padded(count).checked_mul(6)?).then_some(Self { arrays, count })
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
        let at = |array: usize| self.arrays[array * padded(self.count) + index];
        Aabb {
            min: Vec3::new(at(0), at(1), at(2)),
            max: Vec3::new(at(3), at(4), at(5)),
        }
    }
}

/// The half-spaces of a view: a point `p` is inside where `dot(plane.xyz, p) + plane.w >= 0` for all six.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frustum {
    planes: [Vec4; 6],
}

impl Frustum {
    /// Planes of a world-to-clip matrix with clip z in `[0, w]` (Gribb and Hartmann 2001), normalised.
    /// A plane without direction, as the far plane of an infinite reverse-Z projection, keeps everything.
    pub fn from_view_projection(matrix: &Mat4) -> Self {
        let rows = [matrix.row(0), matrix.row(1), matrix.row(2), matrix.row(3)];
        let planes = [
            rows[3] + rows[0],
            rows[3] - rows[0],
            rows[3] + rows[1],
            rows[3] - rows[1],
            rows[2],
            rows[3] - rows[2],
        ];
        Self {
            planes: planes.map(normalized),
        }
    }

    /// The six planes.
    pub fn planes(&self) -> &[Vec4; 6] {
        &self.planes
    }

    /// Whether the box may touch the inside. Never false for a box that does: the corner farthest along each
    /// plane is tested with a margin above the rounding error of the test.
    pub fn may_see(&self, aabb: &Aabb) -> bool {
        self.planes.iter().all(|plane| {
            let positive = plane.truncate().cmpge(Vec3::ZERO);
            let corner = Vec3::select(positive, aabb.max, aabb.min);
            farthest_is_inside(*plane, corner)
        })
    }

    /// Appends to `visible` every index of `range` whose box may be seen, in ascending order.
    pub fn cull(&self, bounds: &BoundsView, range: std::ops::Range<u32>, visible: &mut Vec<u32>) {
        for index in range {
            if self.may_see(&bounds.get(index as usize)) {
                visible.push(index);
            }
        }
    }
}

/// Sums four products: each product and each addition rounds once, and the plane itself was rounded when it was
/// extracted and normalised; 16 epsilons of the magnitudes cover all of it.
fn farthest_is_inside(plane: Vec4, corner: Vec3) -> bool {
    let products = plane.truncate() * corner;
    let distance = products.x + products.y + products.z + plane.w;
    let magnitude = products.abs().element_sum() + plane.w.abs();
    // A distance that is not a number (huge boxes overflow) must keep the box.
    let surely_outside = distance < -16.0 * f32::EPSILON * magnitude;
    !surely_outside
}

fn normalized(plane: Vec4) -> Vec4 {
    let length = plane.truncate().length();
    if length > f32::MIN_POSITIVE && length.is_finite() {
        plane / length
    } else {
        Vec4::new(0.0, 0.0, 0.0, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat4, DVec3, DVec4};
    use proptest::prelude::*;

    fn infinite_reverse_z(yfov: f64, aspect: f64, near: f64) -> DMat4 {
        let f = 1.0 / (yfov * 0.5).tan();
        DMat4::from_cols(
            DVec4::new(f / aspect, 0.0, 0.0, 0.0),
            DVec4::new(0.0, f, 0.0, 0.0),
            DVec4::new(0.0, 0.0, 0.0, -1.0),
            DVec4::new(0.0, 0.0, near, 0.0),
        )
    }

    /// Whether the centre or a corner of the box is inside the exact frustum: then culling must keep it.
    fn surely_visible(matrix: &DMat4, aabb: &Aabb) -> bool {
        let (min, max) = (aabb.min.as_dvec3(), aabb.max.as_dvec3());
        let mut points = vec![(min + max) * 0.5];
        for corner in 0..8 {
            let pick = |axis: usize| {
                if corner >> axis & 1 == 0 {
                    min[axis]
                } else {
                    max[axis]
                }
            };
            points.push(DVec3::new(pick(0), pick(1), pick(2)));
        }
        points.into_iter().any(|point| {
            let clip = *matrix * point.extend(1.0);
            clip.x.abs() <= clip.w && clip.y.abs() <= clip.w && clip.z >= 0.0 && clip.z <= clip.w
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 20_000, ..ProptestConfig::default() })]

        #[test]
        fn no_visible_box_is_culled(
            center in prop::array::uniform3(-100.0f32..100.0),
            half in prop::array::uniform3(prop_oneof![Just(0.0f32), 0.0f32..1.0, 0.0f32..1e4]),
            eye in prop::array::uniform3(-50.0f64..50.0),
            yaw in 0.0f64..6.3,
            near in prop_oneof![Just(1e-3f64), 1e-2f64..1.0],
        ) {
            let aabb = Aabb {
                min: Vec3::from(center) - Vec3::from(half),
                max: Vec3::from(center) + Vec3::from(half),
            };
            let view = DMat4::from_rotation_y(yaw) * DMat4::from_translation(-DVec3::from(eye));
            let exact = infinite_reverse_z(1.0, 1.7, near) * view;
            let rounded = exact.as_mat4();
            let frustum = Frustum::from_view_projection(&rounded);
            if surely_visible(&rounded.as_dmat4(), &aabb) {
                prop_assert!(frustum.may_see(&aabb));
            }
        }
    }

    #[test]
    fn boxes_behind_or_beside_are_culled() {
        let frustum = Frustum::from_view_projection(&infinite_reverse_z(1.0, 1.0, 0.1).as_mat4());
        let at = |center: Vec3| Aabb {
            min: center - Vec3::ONE,
            max: center + Vec3::ONE,
        };
        assert!(frustum.may_see(&at(Vec3::new(0.0, 0.0, -10.0))));
        assert!(frustum.may_see(&at(Vec3::ZERO)));
        assert!(frustum.may_see(&at(Vec3::new(0.0, 0.0, -1e9))));
        assert!(!frustum.may_see(&at(Vec3::new(0.0, 0.0, 10.0))));
        assert!(!frustum.may_see(&at(Vec3::new(20.0, 0.0, -10.0))));
        assert!(!frustum.may_see(&at(Vec3::new(0.0, -20.0, -10.0))));
    }

    #[test]
    fn non_finite_boxes_are_kept() {
        let frustum = Frustum::from_view_projection(&infinite_reverse_z(1.0, 1.0, 0.1).as_mat4());
        let huge = Aabb {
            min: Vec3::splat(f32::MIN),
            max: Vec3::splat(f32::MAX),
        };
        assert!(frustum.may_see(&huge));
        assert!(Frustum::from_view_projection(&Mat4::ZERO).may_see(&huge));
    }

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
    }
}
