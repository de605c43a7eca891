//! The nine coefficients of diffuse light: real spherical harmonics up to degree 2 as a polynomial.

use std::ops::{Mul, Sub};

/// The nine polynomials at the unit vector `(x, y, z)`, in the order of the coefficients.
pub fn basis<T>(x: T, y: T, z: T) -> [T; 9]
where
    T: Copy + From<u8> + Mul<Output = T> + Sub<Output = T>,
{
    let one = T::from(1);
    [
        one,
        x,
        y,
        z,
        x * y,
        y * z,
        z * x,
        T::from(3) * y * y - one,
        x * x - z * z,
    ]
}

/// `E / pi` for the unit normal `[x, y, z]`, at least 0.
///
/// `c0 + c1 x + c2 y + c3 z + c4 xy + c5 yz + c6 zx + c7 (3y^2 - 1) + c8 (x^2 - z^2)`: the constants of
/// the basis and of the cosine lobe are in the coefficients (Ramamoorthi and Hanrahan, "An Efficient
/// Representation for Irradiance Environment Maps", SIGGRAPH 2001).
pub fn evaluate(coefficients: &[[f32; 3]; 9], [x, y, z]: [f32; 3]) -> [f32; 3] {
    let mut sum = [0.0; 3];
    for (rgb, value) in coefficients.iter().zip(basis(x, y, z)) {
        for (sum, coefficient) in sum.iter_mut().zip(rgb) {
            *sum += coefficient * value;
        }
    }
    sum.map(|channel: f32| channel.max(0.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_terms_are_where_they_are_said_to_be() {
        let one = |term: usize, normal| {
            let mut coefficients = [[0.0; 3]; 9];
            coefficients[term] = [1.0, -1.0, 0.5];
            evaluate(&coefficients, normal)
        };
        assert_eq!(one(0, [0.0, 1.0, 0.0]), [1.0, 0.0, 0.5]);
        assert_eq!(one(2, [0.0, 1.0, 0.0]), [1.0, 0.0, 0.5]);
        assert_eq!(one(7, [0.0, 1.0, 0.0]), [2.0, 0.0, 1.0]);
        assert_eq!(one(8, [0.0, 0.0, 1.0]), [0.0, 1.0, 0.0]);
        assert_eq!(one(6, [0.5, 0.5, 0.5]), [0.25, 0.0, 0.125]);
    }
}
