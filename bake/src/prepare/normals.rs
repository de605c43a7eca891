//! Flat normals of triangles (glTF 2.0 section 3.7.2.1: absent normals are flat).

use glam::DVec3;

use super::matrix::cross;

/// Normal of a triangle without area, which has none: finite, unit length, and nobody sees it.
pub(super) const FALLBACK: [f32; 3] = [0.0, 0.0, 1.0];

/// Twice the area times the unit normal of a counter-clockwise triangle. Zero only where the area is.
///
/// Edges between f32 positions are exact in f64 unless their exponents lie 29 apart, and [`cross`] rounds
/// each component twice at most, so that slivers keep their direction. Nothing overflows or underflows.
pub(super) fn area_vector(corners: [[f32; 3]; 3]) -> DVec3 {
    let [a, b, c] = corners.map(|[x, y, z]| DVec3::new(x.into(), y.into(), z.into()));
    cross(b - a, c - a)
}

/// Whether a triangle has no area: [`area_vector`] is zero.
pub(super) fn is_degenerate(corners: [[f32; 3]; 3]) -> bool {
    let [a, b, c] = corners.map(|[x, y, z]| DVec3::new(x.into(), y.into(), z.into()));
    let (e, f) = (b - a, c - a);
    // Twice what the three roundings of a plain difference of products can do.
    const ROUNDING: f64 = 4.0 * f64::EPSILON;
    let clear = |p: f64, q: f64| (p - q).abs() > ROUNDING * (p.abs() + q.abs());
    let sound =
        clear(e.y * f.z, e.z * f.y) || clear(e.z * f.x, e.x * f.z) || clear(e.x * f.y, e.y * f.x);
    !sound && cross(e, f) == DVec3::ZERO
}

/// Unit normal of a triangle, or [`FALLBACK`].
pub(super) fn flat(corners: [[f32; 3]; 3]) -> [f32; 3] {
    let area = area_vector(corners);
    if area == DVec3::ZERO {
        return FALLBACK;
    }
    (area / area.length()).as_vec3().to_array()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The exact cross product of integer corners.
    fn exact(corners: [[i32; 3]; 3]) -> [i128; 3] {
        let [a, b, c] = corners.map(|corner| corner.map(i128::from));
        let e = [b[0] - a[0], b[1] - a[1], b[2] - a[2]];
        let f = [c[0] - a[0], c[1] - a[1], c[2] - a[2]];
        [
            e[1] * f[2] - e[2] * f[1],
            e[2] * f[0] - e[0] * f[2],
            e[0] * f[1] - e[1] * f[0],
        ]
    }

    fn angle(a: DVec3, b: DVec3) -> f64 {
        libm::atan2(a.cross(b).length(), a.dot(b))
    }

    fn check(corners: [[i32; 3]; 3], scale: f32) {
        let floats = corners.map(|corner| corner.map(|value| value as f32 * scale));
        let expected = exact(corners).map(|value| value as f64);
        let normal = flat(floats);
        if expected == [0.0; 3] {
            assert_eq!(normal, FALLBACK);
            return;
        }
        let normal = DVec3::from(normal.map(f64::from));
        assert!((normal.length() - 1.0).abs() < 2e-7);
        let expected = DVec3::from(expected);
        assert!(angle(normal, expected / expected.length()) < 1e-6);
    }

    const LIMIT: i32 = 1 << 24;

    proptest! {
        #[test]
        fn flat_normals_match_exact_integers(
            corners in prop::array::uniform3(prop::array::uniform3(-LIMIT..=LIMIT)),
            exponent in -60i32..60,
        ) {
            check(corners, libm::exp2f(exponent as f32));
        }

        #[test]
        fn only_exact_zeros_are_degenerate(
            a in prop::array::uniform3(-1000i32..1000),
            edge in prop::array::uniform3(-3i32..=3),
            factors in prop::array::uniform2(-900_000i32..900_000),
            nudge in prop::array::uniform3(-1i32..=1),
        ) {
            let at = |factor: i32, nudge: [i32; 3]| {
                std::array::from_fn(|axis| a[axis] + edge[axis] * factor + nudge[axis])
            };
            for nudge in [[0; 3], nudge] {
                let corners: [[i32; 3]; 3] = [a, at(factors[0], [0; 3]), at(factors[1], nudge)];
                let floats = corners.map(|corner| corner.map(|value| value as f32));
                prop_assert_eq!(is_degenerate(floats), exact(corners) == [0; 3]);
            }
        }

        #[test]
        fn slivers_keep_their_direction(
            a in prop::array::uniform3(-1000i32..1000),
            edge in prop::array::uniform3(-4000i32..4000),
            factor in 2i32..1000,
            nudge in prop::array::uniform3(-1i32..=1),
        ) {
            let at = |factor: i32, nudge: [i32; 3]| {
                std::array::from_fn(|axis| a[axis] + edge[axis] * factor + nudge[axis])
            };
            check([a, at(1, [0; 3]), at(factor, nudge)], 1.0);
        }
    }

    #[test]
    fn triangles_without_area_get_the_fallback() {
        let p = [1.0, 2.0, 3.0];
        assert_eq!(flat([p, p, p]), FALLBACK);
        assert_eq!(flat([p, p, [0.0; 3]]), FALLBACK);
        assert_eq!(flat([[0.0; 3], [1.0, 1.0, 0.0], [3.0, 3.0, 0.0]]), FALLBACK);
    }

    #[test]
    fn extreme_sizes_stay_exact() {
        for size in [f32::MIN_POSITIVE, 1e-45, 1e-6, 1e7, 1e38] {
            let corners = [[0.0; 3], [size, 0.0, 0.0], [0.0, 0.0, size]];
            assert_eq!(flat(corners), [0.0, -1.0, 0.0]);
        }
    }
}
