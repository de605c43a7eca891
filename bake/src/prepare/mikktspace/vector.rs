//! Three-component arithmetic in the order of operations that MikkTSpace fixes.

/// Whether `x` counts as nonzero; NaN does not.
#[inline(always)]
pub(super) fn not_zero(x: f32) -> bool {
    x.abs() > f32::MIN_POSITIVE
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct V3 {
    pub(super) x: f32,
    pub(super) y: f32,
    pub(super) z: f32,
}

impl V3 {
    #[inline(always)]
    pub(super) fn new([x, y, z]: [f32; 3]) -> Self {
        Self { x, y, z }
    }

    #[inline(always)]
    pub(super) fn add(self, other: Self) -> Self {
        Self {
            x: self.x + other.x,
            y: self.y + other.y,
            z: self.z + other.z,
        }
    }

    #[inline(always)]
    pub(super) fn sub(self, other: Self) -> Self {
        Self {
            x: self.x - other.x,
            y: self.y - other.y,
            z: self.z - other.z,
        }
    }

    #[inline(always)]
    pub(super) fn scale(self, factor: f32) -> Self {
        Self {
            x: self.x * factor,
            y: self.y * factor,
            z: self.z * factor,
        }
    }

    #[inline(always)]
    pub(super) fn dot(self, other: Self) -> f32 {
        self.x * other.x + self.y * other.y + self.z * other.z
    }

    #[inline(always)]
    pub(super) fn length(self) -> f32 {
        self.dot(self).sqrt()
    }

    /// Unit length; vectors without a component that counts as nonzero stay as they are.
    ///
    /// Free of branches, so that loops over it become SIMD; a factor of one keeps every bit.
    #[inline(always)]
    pub(super) fn normalized(self) -> Self {
        let any = not_zero(self.x) | not_zero(self.y) | not_zero(self.z);
        let inverse = 1.0 / self.length();
        self.scale(if any { inverse } else { 1.0 })
    }

    /// What is left of `self` without its part along the unit `normal`, not normalised.
    #[inline(always)]
    pub(super) fn project(self, normal: Self) -> Self {
        self.sub(normal.scale(normal.dot(self)))
    }
}
