//! The view frustum as half-spaces prepared for testing boxes.

use glam::{DVec3, Mat4, Vec4};

use super::{Aabb, scalar};

/// Share of a box's size by which it may lie outside a plane and still be kept: 16 roundings.
///
/// With `u` = 2^-24, a distance rounds the plane once, each product once and each sum three more times: 6u of
/// the magnitudes at most. The size sums both corners, so it is no less than the magnitudes but for 5u of it.
pub(super) const MARGIN: f32 = 8.0 * f32::EPSILON;

/// The half-spaces of a view: a point `p` is inside where `dot(plane.xyz, p) + plane.w >= 0` for all six.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frustum {
    planes: [Vec4; 6],
    half_spaces: [HalfSpace; 6],
    /// Leading ones that have a direction.
    used: usize,
}

/// One plane as the kernels read it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct HalfSpace {
    /// Unit length.
    pub normal: [f32; 3],
    /// `plane.w`, moved outward by the error of its own roundings.
    pub offset: f32,
    /// Which of the six arrays holds the coordinates of the corner farthest inside (the p-vertex).
    pub farthest: [usize; 3],
    /// The same of the corner opposite to it (the n-vertex).
    pub nearest: [usize; 3],
}

impl Frustum {
    /// Planes of a world-to-clip matrix with clip z in `[0, w]` (Gribb and Hartmann 2001), normalised.
    /// A plane without direction, as the far plane of an infinite reverse-Z projection, keeps everything.
    pub fn from_view_projection(matrix: &Mat4) -> Self {
        let matrix = matrix.as_dmat4();
        let rows = [matrix.row(0), matrix.row(1), matrix.row(2), matrix.row(3)];
        let rows = [
            rows[3] + rows[0],
            rows[3] - rows[0],
            rows[3] + rows[1],
            rows[3] - rows[1],
            rows[2],
            rows[3] - rows[2],
        ];
        let mut frustum = Self {
            planes: [Vec4::W; 6],
            half_spaces: [HalfSpace::default(); 6],
            used: 0,
        };
        for (plane, row) in frustum.planes.iter_mut().zip(rows) {
            let length = row.truncate().length();
            if length > 0.0 && length.is_finite() {
                *plane = (row / length).as_vec4();
                frustum.half_spaces[frustum.used] =
                    HalfSpace::new(row.truncate() / length, row.w / length);
                frustum.used += 1;
            }
        }
        frustum
    }

    /// The six planes.
    pub fn planes(&self) -> &[Vec4; 6] {
        &self.planes
    }

    /// Whether the box may touch the inside. Never false for a box that does, or that is not finite: the corner
    /// farthest along each plane is tested with a margin above the rounding error of the test.
    pub fn may_see(&self, aabb: &Aabb) -> bool {
        let corners = [aabb.min.to_array(), aabb.max.to_array()].concat();
        let corners = std::array::from_fn(|array| corners[array]);
        scalar::keeps::<{ scalar::TOUCHES }>(self.half_spaces(), &corners)
    }

    pub(super) fn half_spaces(&self) -> &[HalfSpace] {
        &self.half_spaces[..self.used]
    }
}

impl HalfSpace {
    fn new(normal: DVec3, distance: f64) -> Self {
        // The least normal number covers what underflows.
        let slack = f64::from(MARGIN) * distance.abs() + f64::from(f32::MIN_POSITIVE);
        let normal = normal.as_vec3().to_array();
        let array = |axis: usize, greater: bool| if greater { axis + 3 } else { axis };
        Self {
            normal,
            offset: (distance + slack) as f32,
            farthest: std::array::from_fn(|axis| array(axis, normal[axis] >= 0.0)),
            nearest: std::array::from_fn(|axis| array(axis, normal[axis] < 0.0)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat4, DVec4, Vec3};

    fn infinite_reverse_z() -> Mat4 {
        DMat4::from_cols(
            DVec4::new(1.8, 0.0, 0.0, 0.0),
            DVec4::new(0.0, 1.8, 0.0, 0.0),
            DVec4::new(0.0, 0.0, 0.0, -1.0),
            DVec4::new(0.0, 0.0, 0.1, 0.0),
        )
        .as_mat4()
    }

    #[test]
    fn boxes_behind_or_beside_are_culled() {
        let frustum = Frustum::from_view_projection(&infinite_reverse_z());
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
    fn non_finite_and_empty_boxes_are_kept() {
        let frustum = Frustum::from_view_projection(&infinite_reverse_z());
        let behind = Aabb {
            min: Vec3::new(0.0, 0.0, 10.0),
            max: Vec3::new(1.0, 1.0, 11.0),
        };
        assert!(!frustum.may_see(&behind));
        for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            for axis in 0..3 {
                let (mut low, mut high) = (behind, behind);
                low.min[axis] = value;
                high.max[axis] = value;
                assert!(
                    frustum.may_see(&low) && frustum.may_see(&high),
                    "{value} {axis}"
                );
            }
        }
        for aabb in [Aabb::EMPTY, Aabb::EVERYWHERE] {
            assert!(frustum.may_see(&aabb));
        }
    }

    #[test]
    fn planes_without_direction_keep_everything() {
        let frustum = Frustum::from_view_projection(&Mat4::ZERO);
        assert!(frustum.half_spaces().is_empty());
        assert!(frustum.may_see(&Aabb::EVERYWHERE));
        let infinite = Frustum::from_view_projection(&infinite_reverse_z());
        assert_eq!(infinite.half_spaces().len(), 5);
        assert_eq!(infinite.planes()[4], Vec4::W);
    }

    /// Rows whose squares leave the range of f32.
    #[test]
    fn planes_of_tiny_and_huge_matrices_are_those_of_the_matrix() {
        let frustum = Frustum::from_view_projection(&infinite_reverse_z());
        for scale in [1e-30, 1e30] {
            let scaled = Frustum::from_view_projection(&(infinite_reverse_z() * scale));
            for (a, b) in frustum.planes().iter().zip(scaled.planes()) {
                assert!(a.abs_diff_eq(*b, 1e-6), "{a} {b}");
            }
        }
    }
}
