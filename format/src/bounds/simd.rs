//! Box tests by the vector units of x86-64; their oracle is the scalar twin.
#![allow(unsafe_code)]

use std::ops::Range;

use super::cull::{Kernel, chunks};
use super::frustum::{HalfSpace, MARGIN};
use super::scalar::{self, INSIDE, PART_SIZE, PART_TOUCHES, TOUCHES};
use super::{BoundsView, CLUSTER, LANES};

/// [`scalar::keep`] on a kernel.
pub(super) fn keep(
    kernel: Kernel,
    half_spaces: &[HalfSpace],
    view: &BoundsView,
    range: Range<usize>,
    visible: &mut Vec<u32>,
) {
    match kernel {
        Kernel::Avx512 if kernel.is_available() => {
            // SAFETY: the processor has AVX-512F.
            unsafe { avx512::keep(half_spaces, view, range, visible) }
        }
        Kernel::Avx2 if kernel.is_available() => {
            // SAFETY: the processor has AVX2.
            unsafe { avx2::keep(half_spaces, view, range, visible) }
        }
        Kernel::Sse2 => {
            // SAFETY: every x86-64 processor has SSE2.
            unsafe { sse2::keep(half_spaces, view, range, visible) }
        }
        _ => scalar::keep(half_spaces, view, range, visible),
    }
}

/// [`scalar::mask`] on a kernel.
pub(super) fn mask<const QUESTION: u8>(
    kernel: Kernel,
    half_spaces: &[HalfSpace],
    view: &BoundsView,
    base: usize,
    blocks: Range<usize>,
) -> u64 {
    match kernel {
        Kernel::Avx512 if kernel.is_available() => {
            // SAFETY: the processor has AVX-512F.
            unsafe { avx512::mask::<QUESTION>(half_spaces, view, base, blocks) }
        }
        Kernel::Avx2 if kernel.is_available() => {
            // SAFETY: the processor has AVX2.
            unsafe { avx2::mask::<QUESTION>(half_spaces, view, base, blocks) }
        }
        Kernel::Sse2 => {
            // SAFETY: every x86-64 processor has SSE2.
            unsafe { sse2::mask::<QUESTION>(half_spaces, view, base, blocks) }
        }
        _ => scalar::mask::<QUESTION>(half_spaces, view, base, blocks),
    }
}

/// Masks over the primitives `load`, `splat`, `add`, `mul`, `magnitude`, `ALL`, `filter_touching`,
/// `filter_inside`, `bits` and `append` of the module that it stands in. `LANES_HERE` boxes fill a vector; the
/// planes pass over `WIDTH` vectors at a time, as many as the registers hold.
macro_rules! kernel {
    ($feature:literal) => {
        /// See [`super::super::scalar::mask`].
        #[target_feature(enable = $feature)]
        pub fn mask<const QUESTION: u8>(
            half_spaces: &[HalfSpace],
            view: &BoundsView,
            base: usize,
            blocks: Range<usize>,
        ) -> u64 {
            const STEP: usize = WIDTH * LANES_HERE;
            const SHORT: usize = LANES / LANES_HERE;
            let (mut at, end) = (blocks.start * LANES, blocks.end * LANES);
            let mut mask = 0;
            while at + STEP <= end {
                mask |= answers::<QUESTION, WIDTH>(half_spaces, view, base + at) << at;
                at += STEP;
            }
            while at < end {
                mask |= answers::<QUESTION, SHORT>(half_spaces, view, base + at) << at;
                at += LANES;
            }
            mask
        }

        /// See [`super::super::scalar::keep`].
        #[target_feature(enable = $feature)]
        pub fn keep(
            half_spaces: &[HalfSpace],
            view: &BoundsView,
            range: Range<usize>,
            visible: &mut Vec<u32>,
        ) {
            for chunk in chunks(range) {
                let mask = mask::<TOUCHES>(half_spaces, view, chunk.base, chunk.blocks());
                append(mask & chunk.within, chunk.base as u32, visible);
            }
        }

        /// Answers for `N` vectors of boxes.
        #[target_feature(enable = $feature)]
        #[inline]
        fn answers<const QUESTION: u8, const N: usize>(
            half_spaces: &[HalfSpace],
            view: &BoundsView,
            base: usize,
        ) -> u64 {
            let arrays = view
                .arrays
                .map(|array| &array[base..base + N * LANES_HERE].as_chunks().0[..N]);
            let thresholds = thresholds::<QUESTION, N>(&arrays);
            let mut kept = [ALL; N];
            for half_space in half_spaces {
                let corner = match QUESTION {
                    INSIDE => half_space.nearest,
                    _ => half_space.farthest,
                };
                let [x, y, z] = [arrays[corner[0]], arrays[corner[1]], arrays[corner[2]]];
                let [a, b, c] = half_space.normal;
                let (a, b, c) = (splat(a), splat(b), splat(c));
                let offset = splat(half_space.offset);
                for i in 0..N {
                    let products = [
                        mul(a, load(&x[i])),
                        mul(b, load(&y[i])),
                        mul(c, load(&z[i])),
                    ];
                    let sum = add(add(products[0], products[1]), products[2]);
                    let distance = add(sum, offset);
                    kept[i] = match QUESTION {
                        INSIDE => filter_inside(kept[i], distance, thresholds[i]),
                        _ => filter_touching(kept[i], distance, thresholds[i]),
                    };
                }
            }
            let mut mask = 0;
            for (i, kept) in kept.into_iter().enumerate() {
                mask |= bits(kept) << (i * LANES_HERE);
            }
            mask
        }

        /// A closure would not be inlined here: it lacks the feature where an iterator calls it.
        #[target_feature(enable = $feature)]
        #[inline]
        fn thresholds<const QUESTION: u8, const N: usize>(
            arrays: &[&[[f32; LANES_HERE]]; 6],
        ) -> [Vector; N] {
            let mut thresholds = [splat(0.0); N];
            if QUESTION == INSIDE {
                return thresholds;
            }
            for (i, threshold) in thresholds.iter_mut().enumerate() {
                let mut axes = [splat(0.0); 3];
                for (axis, size) in axes.iter_mut().enumerate() {
                    let (min, max) = (load(&arrays[axis][i]), load(&arrays[axis + 3][i]));
                    *size = add(magnitude(min), magnitude(max));
                }
                let size = add(add(axes[0], axes[1]), axes[2]);
                let size = match QUESTION {
                    PART_TOUCHES => mul(size, splat(PART_SIZE)),
                    _ => size,
                };
                *threshold = mul(size, splat(-MARGIN));
            }
            thresholds
        }
    };
}

/// 4 boxes a vector; every x86-64 processor has it.
mod sse2 {
    use super::super::scalar::append;
    use super::*;
    use std::arch::x86_64::*;

    const LANES_HERE: usize = 4;
    const WIDTH: usize = 4;
    type Vector = __m128;
    type Mask = __m128;
    // SAFETY: every bit pattern is a vector.
    const ALL: Mask = unsafe { std::mem::transmute::<[u32; 4], __m128>([!0; 4]) };

    kernel!("sse2");

    #[target_feature(enable = "sse2")]
    #[inline]
    fn load(lanes: &[f32; LANES_HERE]) -> Vector {
        // SAFETY: reads the 4 floats that the reference covers; needs no alignment.
        unsafe { _mm_loadu_ps(lanes.as_ptr()) }
    }

    #[target_feature(enable = "sse2")]
    #[inline]
    fn splat(value: f32) -> Vector {
        _mm_set1_ps(value)
    }

    #[target_feature(enable = "sse2")]
    #[inline]
    fn add(a: Vector, b: Vector) -> Vector {
        _mm_add_ps(a, b)
    }

    #[target_feature(enable = "sse2")]
    #[inline]
    fn mul(a: Vector, b: Vector) -> Vector {
        _mm_mul_ps(a, b)
    }

    #[target_feature(enable = "sse2")]
    #[inline]
    fn magnitude(a: Vector) -> Vector {
        _mm_andnot_ps(_mm_set1_ps(-0.0), a)
    }

    #[target_feature(enable = "sse2")]
    #[inline]
    fn filter_touching(kept: Mask, distance: Vector, threshold: Vector) -> Mask {
        _mm_and_ps(kept, _mm_cmpnlt_ps(distance, threshold))
    }

    #[target_feature(enable = "sse2")]
    #[inline]
    fn filter_inside(kept: Mask, distance: Vector, threshold: Vector) -> Mask {
        _mm_and_ps(kept, _mm_cmpge_ps(distance, threshold))
    }

    #[target_feature(enable = "sse2")]
    #[inline]
    fn bits(kept: Mask) -> u64 {
        _mm_movemask_ps(kept) as u64
    }
}

/// 8 boxes a vector.
mod avx2 {
    use super::super::scalar::append;
    use super::*;
    use std::arch::x86_64::*;

    const LANES_HERE: usize = 8;
    const WIDTH: usize = 4;
    type Vector = __m256;
    type Mask = __m256;
    // SAFETY: every bit pattern is a vector.
    const ALL: Mask = unsafe { std::mem::transmute::<[u32; 8], __m256>([!0; 8]) };

    kernel!("avx2");

    #[target_feature(enable = "avx2")]
    #[inline]
    fn load(lanes: &[f32; LANES_HERE]) -> Vector {
        // SAFETY: reads the 8 floats that the reference covers; needs no alignment.
        unsafe { _mm256_loadu_ps(lanes.as_ptr()) }
    }

    #[target_feature(enable = "avx2")]
    #[inline]
    fn splat(value: f32) -> Vector {
        _mm256_set1_ps(value)
    }

    #[target_feature(enable = "avx2")]
    #[inline]
    fn add(a: Vector, b: Vector) -> Vector {
        _mm256_add_ps(a, b)
    }

    #[target_feature(enable = "avx2")]
    #[inline]
    fn mul(a: Vector, b: Vector) -> Vector {
        _mm256_mul_ps(a, b)
    }

    #[target_feature(enable = "avx2")]
    #[inline]
    fn magnitude(a: Vector) -> Vector {
        _mm256_andnot_ps(_mm256_set1_ps(-0.0), a)
    }

    #[target_feature(enable = "avx2")]
    #[inline]
    fn filter_touching(kept: Mask, distance: Vector, threshold: Vector) -> Mask {
        _mm256_and_ps(kept, _mm256_cmp_ps::<_CMP_NLT_UQ>(distance, threshold))
    }

    #[target_feature(enable = "avx2")]
    #[inline]
    fn filter_inside(kept: Mask, distance: Vector, threshold: Vector) -> Mask {
        _mm256_and_ps(kept, _mm256_cmp_ps::<_CMP_GE_OQ>(distance, threshold))
    }

    #[target_feature(enable = "avx2")]
    #[inline]
    fn bits(kept: Mask) -> u64 {
        u64::from(_mm256_movemask_ps(kept) as u32)
    }
}

/// 16 boxes a vector.
mod avx512 {
    use super::*;
    use std::arch::x86_64::*;

    const LANES_HERE: usize = 16;
    const WIDTH: usize = 4;
    type Vector = __m512;
    type Mask = __mmask16;
    const ALL: Mask = !0;

    kernel!("avx512f");

    #[target_feature(enable = "avx512f")]
    #[inline]
    fn load(lanes: &[f32; LANES_HERE]) -> Vector {
        // SAFETY: reads the 16 floats that the reference covers; needs no alignment.
        unsafe { _mm512_loadu_ps(lanes.as_ptr()) }
    }

    #[target_feature(enable = "avx512f")]
    #[inline]
    fn splat(value: f32) -> Vector {
        _mm512_set1_ps(value)
    }

    #[target_feature(enable = "avx512f")]
    #[inline]
    fn add(a: Vector, b: Vector) -> Vector {
        _mm512_add_ps(a, b)
    }

    #[target_feature(enable = "avx512f")]
    #[inline]
    fn mul(a: Vector, b: Vector) -> Vector {
        _mm512_mul_ps(a, b)
    }

    #[target_feature(enable = "avx512f")]
    #[inline]
    fn magnitude(a: Vector) -> Vector {
        _mm512_abs_ps(a)
    }

    #[target_feature(enable = "avx512f")]
    #[inline]
    fn filter_touching(kept: Mask, distance: Vector, threshold: Vector) -> Mask {
        _mm512_mask_cmp_ps_mask::<_CMP_NLT_UQ>(kept, distance, threshold)
    }

    #[target_feature(enable = "avx512f")]
    #[inline]
    fn filter_inside(kept: Mask, distance: Vector, threshold: Vector) -> Mask {
        _mm512_mask_cmp_ps_mask::<_CMP_GE_OQ>(kept, distance, threshold)
    }

    #[target_feature(enable = "avx512f")]
    #[inline]
    fn bits(kept: Mask) -> u64 {
        u64::from(kept)
    }

    /// Compresses in a register and stores whole vectors: compressing to memory is slow on some processors.
    #[target_feature(enable = "avx512f")]
    #[inline]
    fn append(mask: u64, base: u32, visible: &mut Vec<u32>) {
        if mask == 0 {
            return;
        }
        visible.reserve(CLUSTER);
        let lanes = _mm512_set_epi32(15, 14, 13, 12, 11, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1, 0);
        let length = visible.len();
        let mut count = 0;
        for i in 0..CLUSTER / LANES_HERE {
            let part = (mask >> (i * LANES_HERE)) as u16;
            let first = base + (i * LANES_HERE) as u32;
            let indices = _mm512_add_epi32(lanes, _mm512_set1_epi32(first.cast_signed()));
            let packed = _mm512_maskz_compress_epi32(part, indices);
            // SAFETY: `reserve` left room for 64 entries from `length` on; `count` is at most `16 * i` and
            // `i` at most 3, so that the 16 entries end within them.
            unsafe {
                let end = visible.as_mut_ptr().add(length + count);
                _mm512_storeu_si512(end.cast(), packed);
            }
            count += part.count_ones() as usize;
        }
        // SAFETY: `count`, at most 64, entries from `length` on were written and lie within the capacity.
        unsafe { visible.set_len(length + count) };
    }
}
