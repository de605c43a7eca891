//! Morton codes of places in a scene, for orders in which neighbours are near each other.

use cairn_format::Aabb;
use glam::DVec3;

/// Bits of a code per axis.
const BITS: u32 = 21;

/// A grid of cubes over a scene.
#[derive(Clone, Copy, Debug)]
pub(super) struct Grid {
    origin: DVec3,
    /// Cubes per metre.
    scale: f64,
}

impl Grid {
    /// The grid that spans `bounds` along its longest side.
    pub(super) fn new(bounds: Aabb) -> Self {
        let (min, max) = (bounds.min.as_dvec3(), bounds.max.as_dvec3());
        let side = (max - min).max_element();
        let scale = f64::from(1u32 << BITS) / side;
        Self {
            origin: min,
            scale: if side > 0.0 && scale.is_finite() {
                scale
            } else {
                0.0
            },
        }
    }

    /// Code of the cube that holds the middle of `aabb` (Morton 1966): x in the lowest bit of each three.
    pub(super) fn code(&self, aabb: Aabb) -> u64 {
        let center = (aabb.min.as_dvec3() + aabb.max.as_dvec3()) * 0.5;
        let last = f64::from((1u32 << BITS) - 1);
        let cell = (center - self.origin) * self.scale;
        // The cast takes NaN, which empty bounds give, to zero.
        let spread_axis = |value: f64| spread(value.clamp(0.0, last) as u64);
        spread_axis(cell.x) | spread_axis(cell.y) << 1 | spread_axis(cell.z) << 2
    }
}

/// Puts two zeros before each of the low 21 bits.
fn spread(value: u64) -> u64 {
    let mut bits = value & 0x1F_FFFF;
    bits = (bits | bits << 32) & 0x001F_0000_0000_FFFF;
    bits = (bits | bits << 16) & 0x001F_0000_FF00_00FF;
    bits = (bits | bits << 8) & 0x100F_00F0_0F00_F00F;
    bits = (bits | bits << 4) & 0x10C3_0C30_C30C_30C3;
    (bits | bits << 2) & 0x1249_2492_4924_9249
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use proptest::prelude::*;

    fn cube(min: Vec3, side: f32) -> Aabb {
        Aabb {
            min,
            max: min + Vec3::splat(side),
        }
    }

    proptest! {
        #[test]
        fn spreading_moves_every_bit(value in 0u64..1 << 21) {
            let slow = (0..BITS).fold(0, |code, bit| code | (value >> bit & 1) << (3 * bit));
            prop_assert_eq!(spread(value), slow);
        }

        #[test]
        fn the_highest_bits_are_the_octant(x in 0.0f32..7.9, y in 0.0f32..7.9, z in 0.0f32..7.9) {
            let grid = Grid::new(cube(Vec3::ZERO, 8.0));
            let octant = u64::from(x >= 4.0) | u64::from(y >= 4.0) << 1 | u64::from(z >= 4.0) << 2;
            prop_assert_eq!(grid.code(cube(Vec3::new(x, y, z), 0.0)) >> 60, octant);
        }
    }

    #[test]
    fn points_and_extremes_have_a_code() {
        let point = cube(Vec3::ONE, 0.0);
        assert_eq!(Grid::new(point).code(point), 0);
        assert_eq!(Grid::new(Aabb::EMPTY).code(Aabb::EMPTY), 0);
        let huge = Aabb {
            min: Vec3::splat(-3e38),
            max: Vec3::splat(3e38),
        };
        assert_eq!(Grid::new(huge).code(cube(huge.max, 0.0)), (1 << 63) - 1);
        assert_eq!(Grid::new(huge).code(cube(huge.min, 0.0)), 0);
    }
}
