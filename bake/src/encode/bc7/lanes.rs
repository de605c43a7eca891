//! Four f32 lanes whose operations are plain IEEE ones, so that every machine computes the same bits.

use std::ops::{Add, AddAssign, Index, IndexMut, Mul, MulAssign, Sub};

use glam::Vec4;

/// Four values side by side. An array would do, but the compiler splits its operations in halves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Lanes(Vec4);

/// Adding 1.5 * 2^23 leaves no fraction bits: rounding (halves to even) without a call.
const ROUND: f32 = 12_582_912.0;

/// Rounds halves to even; for magnitudes up to 2^22.
#[inline(always)]
pub(super) fn round(value: f32) -> f32 {
    value + ROUND - ROUND
}

impl Lanes {
    pub const ZERO: Self = Self::splat(0.0);

    pub const fn new(values: [f32; 4]) -> Self {
        Self(Vec4::from_array(values))
    }

    #[inline(always)]
    pub const fn splat(value: f32) -> Self {
        Self(Vec4::splat(value))
    }

    #[inline(always)]
    pub const fn to_array(self) -> [f32; 4] {
        self.0.to_array()
    }

    /// The lesser of each lane, the other's where they do not compare.
    #[inline(always)]
    pub fn min(self, other: Self) -> Self {
        Self(self.0.min(other.0))
    }

    /// The greater of each lane, the other's where they do not compare.
    #[inline(always)]
    pub fn max(self, other: Self) -> Self {
        Self(self.0.max(other.0))
    }

    /// Of each lane, `yes` where it is less than the other's, else `no`.
    #[inline(always)]
    pub fn select_less(self, other: Self, yes: Self, no: Self) -> Self {
        Self(Vec4::select(self.0.cmplt(other.0), yes.0, no.0))
    }

    #[inline(always)]
    pub fn clamp(self, least: f32, most: f32) -> Self {
        self.max(Self::splat(least)).min(Self::splat(most))
    }

    /// Rounds halves to even; for magnitudes up to 2^22.
    #[inline(always)]
    pub fn round(self) -> Self {
        self + Self::splat(ROUND) - Self::splat(ROUND)
    }

    #[inline(always)]
    pub fn sqrt(self) -> Self {
        Self::new(self.to_array().map(f32::sqrt))
    }

    #[inline(always)]
    pub fn recip(self) -> Self {
        Self(Vec4::ONE / self.0)
    }

    #[inline(always)]
    pub fn sum(self) -> f32 {
        let [a, b, c, d] = self.to_array();
        (a + c) + (b + d)
    }
}

impl Index<usize> for Lanes {
    type Output = f32;
    #[inline(always)]
    fn index(&self, lane: usize) -> &f32 {
        let lanes: &[f32; 4] = self.0.as_ref();
        &lanes[lane]
    }
}

impl IndexMut<usize> for Lanes {
    #[inline(always)]
    fn index_mut(&mut self, lane: usize) -> &mut f32 {
        let lanes: &mut [f32; 4] = self.0.as_mut();
        &mut lanes[lane]
    }
}

impl Add for Lanes {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self(self.0 + other.0)
    }
}

impl Sub for Lanes {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self(self.0 - other.0)
    }
}

impl Mul for Lanes {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self(self.0 * other.0)
    }
}

impl Mul<f32> for Lanes {
    type Output = Self;
    #[inline(always)]
    fn mul(self, factor: f32) -> Self {
        self * Self::splat(factor)
    }
}

impl AddAssign for Lanes {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl MulAssign<f32> for Lanes {
    #[inline(always)]
    fn mul_assign(&mut self, factor: f32) {
        *self = *self * factor;
    }
}
