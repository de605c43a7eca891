//! Model and normal matrices of an instance.

use glam::{DMat3, DMat4, DVec3};

/// `a * d - b * c` with a relative error of at most 1.5 ulp (Jeannerod, Louvet and Muller 2013, Kahan's algorithm).
fn difference_of_products(a: f64, d: f64, b: f64, c: f64) -> f64 {
    let product = b * c;
    let error = b.mul_add(-c, product);
    a.mul_add(d, -product) + error
}

/// Cross product without cancellation.
pub(super) fn cross(a: DVec3, b: DVec3) -> DVec3 {
    DVec3::new(
        difference_of_products(a.y, b.z, a.z, b.y),
        difference_of_products(a.z, b.x, a.x, b.z),
        difference_of_products(a.x, b.y, a.y, b.x),
    )
}

/// The world transform of a node in the forms that a package stores.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Placement {
    /// Object to world, columns.
    pub(super) model: [[f32; 4]; 4],
    /// As [`cairn_format::gpu::Instance::normal_matrix`].
    pub(super) normal: [[f32; 4]; 3],
    /// Whether the determinant is negative. Singular matrices are not mirrored.
    pub(super) mirrored: bool,
}

impl Placement {
    /// Rounds an affine `world`; `None` where an element leaves the range of f32.
    pub(super) fn new(world: &DMat4) -> Option<Self> {
        let model = [
            world.x_axis.truncate().as_vec3().extend(0.0).to_array(),
            world.y_axis.truncate().as_vec3().extend(0.0).to_array(),
            world.z_axis.truncate().as_vec3().extend(0.0).to_array(),
            world.w_axis.truncate().as_vec3().extend(1.0).to_array(),
        ];
        if !model.as_flattened().iter().all(|value| value.is_finite()) {
            return None;
        }
        let linear = DMat3::from_mat4(*world);
        let (normal, mirrored) = normal_matrix(&linear);
        let column = |column: DVec3| column.as_vec3().extend(0.0).to_array();
        Some(Self {
            model,
            normal: [
                column(normal.x_axis),
                column(normal.y_axis),
                column(normal.z_axis),
            ],
            mirrored,
        })
    }

    /// Rows of the 3x4 matrix.
    pub(super) fn rows(&self) -> [[f32; 4]; 3] {
        std::array::from_fn(|row| std::array::from_fn(|column| self.model[column][row]))
    }
}

/// A determinant this far below the product of the columns' lengths is rounding noise of a singular matrix.
const SINGULAR: f64 = 1e-14;

/// The cofactor matrix times the sign of the determinant, scaled to a largest element of 1, and whether that sign
/// is negative. It equals the inverse transpose up to a positive factor, and is defined for singular matrices too:
/// one zero axis leaves the normal of the plane, two leave nothing and give the identity.
fn normal_matrix(linear: &DMat3) -> (DMat3, bool) {
    let linear = scaled(linear);
    let (x, y, z) = (linear.x_axis, linear.y_axis, linear.z_axis);
    let cofactors = DMat3::from_cols(cross(y, z), cross(z, x), cross(x, y));
    let determinant = x.dot(cofactors.x_axis);
    let mirrored = determinant < -SINGULAR * x.length() * y.length() * z.length();
    if largest(&cofactors) == 0.0 {
        return (DMat3::IDENTITY, mirrored);
    }
    let normal = scaled(&cofactors);
    (if mirrored { normal * -1.0 } else { normal }, mirrored)
}

fn largest(matrix: &DMat3) -> f64 {
    matrix
        .to_cols_array()
        .iter()
        .fold(0.0, |largest, value| f64::max(largest, value.abs()))
}

/// `matrix` divided by its largest element, where that is not zero.
fn scaled(matrix: &DMat3) -> DMat3 {
    let largest = largest(matrix);
    if largest == 0.0 {
        return *matrix;
    }
    // A division per element: the reciprocal of a subnormal is infinite.
    DMat3::from_cols_array(&matrix.to_cols_array().map(|value| value / largest))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec4};
    use proptest::prelude::*;

    fn columns(placement: &Placement) -> DMat3 {
        DMat3::from_cols_array_2d(
            &placement
                .normal
                .map(|[x, y, z, _]| [x, y, z].map(f64::from)),
        )
    }

    fn world(linear: DMat3) -> DMat4 {
        DMat4::from_mat3(linear)
    }

    proptest! {
        #[test]
        fn normals_follow_the_inverse_transpose(
            elements in prop::array::uniform9(-1.0f64..1.0),
            exponent in -8i32..=8,
            normal in prop::array::uniform3(-1.0f64..1.0),
        ) {
            let linear = DMat3::from_cols_array(&elements) * libm::pow(10.0, exponent.into());
            let size = linear.x_axis.length() * linear.y_axis.length() * linear.z_axis.length();
            let normal = DVec3::from(normal);
            prop_assume!(linear.determinant().abs() > 1e-2 * size && normal.length() > 0.1);
            let expected = (linear.inverse().transpose() * normal).normalize();
            let placement = Placement::new(&world(linear)).expect("in range");
            let actual = (columns(&placement) * normal).normalize();
            prop_assert!(actual.dot(expected) > 0.0);
            prop_assert!(actual.cross(expected).length() < 1e-5);
            prop_assert_eq!(placement.mirrored, linear.determinant() < 0.0);
            let largest = placement.normal.as_flattened().iter().fold(0.0f32, |a, b| a.max(b.abs()));
            prop_assert_eq!(largest, 1.0);
        }
    }

    #[test]
    fn extreme_scales_stay_finite() {
        for scale in [1e-8, 1e8, 1e-30, 1e38, 1e-300] {
            let placement = Placement::new(&world(DMat3::from_diagonal(DVec3::splat(-scale))));
            let placement = placement.expect("in range");
            assert_eq!(columns(&placement), DMat3::from_diagonal(DVec3::NEG_ONE));
            assert!(placement.mirrored);
        }
        let mixed = DMat3::from_diagonal(DVec3::new(1e8, 1.0, 1e-8));
        let placement = Placement::new(&world(mixed)).expect("in range");
        let expected = [1e-16, 1e-8, 1.0].map(|value: f64| f64::from(value as f32));
        assert_eq!(
            columns(&placement),
            DMat3::from_diagonal(DVec3::from(expected))
        );
        assert!(Placement::new(&world(DMat3::from_diagonal(DVec3::splat(1e39)))).is_none());
    }

    #[test]
    fn a_flattened_axis_leaves_the_normal_of_the_plane() {
        let (outer, inner) = (DQuat::from_rotation_x(0.7), DQuat::from_rotation_z(1.1));
        let flat = DMat3::from_diagonal(DVec3::new(2.0, 0.0, -3.0));
        let linear = DMat3::from_quat(outer) * flat * DMat3::from_quat(inner);
        let placement = Placement::new(&world(linear)).expect("in range");
        assert!(!placement.mirrored);
        let normal = columns(&placement) * (inner.inverse() * DVec3::Y);
        assert!(normal.normalize().cross(outer * DVec3::Y).length() < 1e-6);
        for axis in [DVec3::ZERO, DVec3::X] {
            let placement = Placement::new(&world(DMat3::from_diagonal(axis))).expect("in range");
            assert_eq!(columns(&placement), DMat3::IDENTITY);
            assert!(!placement.mirrored);
        }
    }

    #[test]
    fn rows_are_those_of_the_matrix() {
        let matrix = DMat4::from_cols(
            DVec4::new(1.0, 2.0, 3.0, 0.0),
            DVec4::new(4.0, 5.0, 7.0, 0.0),
            DVec4::new(8.0, 9.0, 11.0, 0.0),
            DVec4::new(12.0, 13.0, 14.0, 1.0),
        );
        let rows = Placement::new(&matrix).expect("in range").rows();
        assert_eq!(rows[0], [1.0, 4.0, 8.0, 12.0]);
        assert_eq!(rows[2], [3.0, 7.0, 11.0, 14.0]);
    }
}
