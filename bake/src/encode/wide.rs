//! One value of each of several blocks, side by side, as many as the processor's registers hold.
//!
//! Only additions, products, divisions, square roots, comparisons and roundings, in the order in which they are
//! written: every lane computes what one block alone would, on every machine.
//!
//! No closure belongs near these: it is compiled for the least processor, and each operation becomes a call.

use std::ops::{Add, AddAssign, Mul, Sub};

use pulp::Simd;

/// Adding 1.5 * 2^23 leaves no fraction bits: rounding (halves to even) by two additions.
const ROUND: f32 = 12_582_912.0;

/// Rounds halves to even; for magnitudes up to 2^22.
#[inline(always)]
pub(super) fn round(value: f32) -> f32 {
    value + ROUND - ROUND
}

/// An f32 of each block.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wide<S: Simd> {
    simd: S,
    value: S::f32s,
}

/// A choice of each block.
#[derive(Clone, Copy, Debug)]
pub(super) struct Mask<S: Simd> {
    simd: S,
    value: S::m32s,
}

/// A word of each block, as many as the widest registers hold.
#[derive(Clone, Copy)]
#[repr(align(64))]
pub(super) struct Words(pub [u32; MOST_LANES]);

/// Most blocks side by side.
pub(super) const MOST_LANES: usize = 16;

impl Words {
    pub const ZERO: Self = Self([0; MOST_LANES]);

    /// The low two bytes as numbers.
    #[inline(always)]
    pub fn bytes<S: Simd>(&self, simd: S) -> [Wide<S>; 2] {
        // Below 2^23 an integer is the low bits of the float of 2^23 more.
        let exponent = simd.splat_u32s(0x4b00_0000);
        let origin = Wide::splat(simd, 8_388_608.0);
        let words: S::u32s =
            bytemuck::pod_read_unaligned(&bytemuck::bytes_of(&self.0)[..size_of::<S::u32s>()]);
        let low = simd.or_u32s(simd.and_u32s(words, simd.splat_u32s(0xff)), exponent);
        let high = simd.or_u32s(simd.and_u32s(words, simd.splat_u32s(0xff00)), exponent);
        let low = simd.transmute_f32s_u32s(low);
        let high = simd.transmute_f32s_u32s(high);
        let low = Wide { simd, value: low } - origin;
        let high = Wide { simd, value: high } - origin;
        [low, high * (1.0 / 256.0)]
    }
}

impl<S: Simd> Wide<S> {
    #[inline(always)]
    pub fn splat(simd: S, value: f32) -> Self {
        Self {
            simd,
            value: simd.splat_f32s(value),
        }
    }

    #[inline(always)]
    pub fn zero(simd: S) -> Self {
        Self::splat(simd, 0.0)
    }

    #[inline(always)]
    pub fn simd(self) -> S {
        self.simd
    }

    /// Another value in all lanes.
    #[inline(always)]
    pub fn of(self, value: f32) -> Self {
        Self::splat(self.simd, value)
    }

    /// One value a lane; lanes beyond the slice get 0.
    #[inline(always)]
    pub fn load(simd: S, values: &[f32]) -> Self {
        let bytes: &[u8] = bytemuck::cast_slice(values);
        let value = match bytes.get(..size_of::<S::f32s>()) {
            Some(bytes) => bytemuck::pod_read_unaligned(bytes),
            None => simd.partial_load_f32s(values),
        };
        Self { simd, value }
    }

    /// The value of one block.
    #[inline(always)]
    pub fn lane(self, lane: usize) -> f32 {
        self.lanes()[lane]
    }

    /// The values of all blocks.
    #[inline(always)]
    pub fn lanes(&self) -> &[f32] {
        bytemuck::cast_slice(std::slice::from_ref(&self.value))
    }

    #[inline(always)]
    pub fn min(self, other: Self) -> Self {
        Self {
            value: self.simd.min_f32s(self.value, other.value),
            ..self
        }
    }

    #[inline(always)]
    pub fn max(self, other: Self) -> Self {
        Self {
            value: self.simd.max_f32s(self.value, other.value),
            ..self
        }
    }

    #[inline(always)]
    pub fn clamp(self, least: f32, most: f32) -> Self {
        self.max(self.of(least)).min(self.of(most))
    }

    /// Rounds halves to even; for magnitudes up to 2^22.
    #[inline(always)]
    pub fn round(self) -> Self {
        let round = self.of(ROUND);
        self + round - round
    }

    #[inline(always)]
    pub fn sqrt(self) -> Self {
        Self {
            value: self.simd.sqrt_f32s(self.value),
            ..self
        }
    }

    #[inline(always)]
    pub fn recip(self) -> Self {
        let one = self.of(1.0);
        Self {
            value: self.simd.div_f32s(one.value, self.value),
            ..self
        }
    }

    #[inline(always)]
    pub fn less(self, other: Self) -> Mask<S> {
        Mask {
            simd: self.simd,
            value: self.simd.less_than_f32s(self.value, other.value),
        }
    }
}

impl<S: Simd> Mask<S> {
    /// Whether bit `bit` is set in the word of each lane.
    #[inline(always)]
    pub fn bit(simd: S, words: &[u32], bit: u32) -> Self {
        let wanted = simd.splat_u32s(1 << bit);
        let bytes: &[u8] = bytemuck::cast_slice(words);
        let words = match bytes.get(..size_of::<S::u32s>()) {
            Some(bytes) => bytemuck::pod_read_unaligned(bytes),
            None => simd.partial_load_u32s(words),
        };
        Self {
            simd,
            value: simd.equal_u32s(simd.and_u32s(words, wanted), wanted),
        }
    }

    #[inline(always)]
    pub fn any(self) -> bool {
        self.simd.first_true_m32s(self.value) < S::F32_LANES
    }

    /// `yes` where chosen, else `no`.
    #[inline(always)]
    pub fn select(self, yes: Wide<S>, no: Wide<S>) -> Wide<S> {
        Wide {
            simd: self.simd,
            value: self.simd.select_f32s(self.value, yes.value, no.value),
        }
    }

    /// [`Self::select`] of three values.
    #[inline(always)]
    pub fn select_all(self, yes: [Wide<S>; 3], no: [Wide<S>; 3]) -> [Wide<S>; 3] {
        let [a, b, c] = yes;
        [
            self.select(a, no[0]),
            self.select(b, no[1]),
            self.select(c, no[2]),
        ]
    }
}

impl<S: Simd> Add for Wide<S> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self {
            value: self.simd.add_f32s(self.value, other.value),
            ..self
        }
    }
}

impl<S: Simd> AddAssign for Wide<S> {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl<S: Simd> Sub for Wide<S> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self {
            value: self.simd.sub_f32s(self.value, other.value),
            ..self
        }
    }
}

impl<S: Simd> Mul for Wide<S> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self {
            value: self.simd.mul_f32s(self.value, other.value),
            ..self
        }
    }
}

impl<S: Simd> Mul<f32> for Wide<S> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, factor: f32) -> Self {
        self * self.of(factor)
    }
}
