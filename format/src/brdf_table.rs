//! Where the BRDF table is read: the axes that the bake fills and shaders look up.
//!
//! Both axes have their first and last texel centre at the ends of their range, so that a lookup never leaves the
//! table, and both are stretched to where albedos bend: `N.V` by its cube root, as the loss at grazing angles lies
//! within `N.V` of the lobe's alpha, roughness by the square root of its distance from the least one.

/// Texels per side: with bilinear filtering, directional albedos are within 2e-3 of the integral for `N.V` from 1e-4
/// on and within 8e-4 from 0.05 on, and their sum is within 0.25 % everywhere.
pub const BRDF_TABLE_SIZE: u32 = 64;

/// Perceptual roughness of the first row: the least that any lobe has where light comes from one direction, below
/// which its highlight would vanish between pixels and its peak overflow.
pub const MIN_LIGHT_ROUGHNESS: f32 = 0.045;

/// Texture coordinates of a lookup, texel centres at `(i + 0.5) / size`.
///
/// The GLSL function of the same name is generated beside the records.
pub fn brdf_table_uv(n_dot_v: f64, roughness: f64) -> [f64; 2] {
    let least = f64::from(MIN_LIGHT_ROUGHNESS);
    let along = [
        n_dot_v.clamp(0.0, 1.0).cbrt(),
        ((roughness - least) / (1.0 - least)).clamp(0.0, 1.0).sqrt(),
    ];
    let size = f64::from(BRDF_TABLE_SIZE);
    along.map(|at| (at * (size - 1.0) + 0.5) / size)
}

/// `N.V` and perceptual roughness of the texel in the given column and row of a table of the given side, at least 2:
/// the inverse of [`brdf_table_uv`] for [`BRDF_TABLE_SIZE`].
pub fn brdf_table_point(column: u32, row: u32, size: u32) -> [f64; 2] {
    let last = f64::from(size - 1);
    let (x, y) = (f64::from(column) / last, f64::from(row) / last);
    let least = f64::from(MIN_LIGHT_ROUGHNESS);
    [x * x * x, least + (1.0 - least) * y * y]
}

/// [`brdf_table_uv`] for shaders.
pub(crate) const GLSL: &str = "
// Coordinates of the BRDF table (cairn-format's brdf_table.rs).
vec2 brdf_table_uv(float n_dot_v, float roughness) {
    float x = pow(clamp(n_dot_v, 0.0, 1.0), 1.0 / 3.0);
    float y = sqrt(clamp((roughness - MIN_LIGHT_ROUGHNESS) / (1.0 - MIN_LIGHT_ROUGHNESS), 0.0, 1.0));
    float size = float(BRDF_TABLE_SIZE);
    return (vec2(x, y) * (size - 1.0) + 0.5) / size;
}
";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texels_are_read_at_their_centres() {
        let size = BRDF_TABLE_SIZE;
        for (column, row) in [
            (0, 0),
            (1, 1),
            (13, 50),
            (size - 1, 0),
            (size - 1, size - 1),
        ] {
            let [n_dot_v, roughness] = brdf_table_point(column, row, size);
            let [u, v] = brdf_table_uv(n_dot_v, roughness);
            let center = |index: u32| (f64::from(index) + 0.5) / f64::from(size);
            assert!((u - center(column)).abs() < 1e-9 && (v - center(row)).abs() < 1e-9);
        }
        let last = (f64::from(size) - 0.5) / f64::from(size);
        assert_eq!(brdf_table_uv(2.0, 3.0), [last; 2]);
        assert_eq!(brdf_table_uv(-1.0, 0.0), [1.0 - last; 2]);
    }
}
