//! Runs a loop as compiled for the widest vectors that the processor has.
//!
//! The compiler contracts nothing and the loops fix the order of their sums, so that every width gives the same bits.
#![allow(unsafe_code)]

/// A loop, and what it reads.
pub(super) trait Work {
    type Output;
    /// To be marked `#[inline(always)]`, or it is compiled for the narrowest vectors.
    fn run(self) -> Self::Output;
}

/// What `work` returns.
pub(super) fn widest<W: Work>(work: W) -> W::Output {
    #[cfg(target_arch = "x86_64")]
    {
        if std::arch::is_x86_feature_detected!("avx512f") {
            // SAFETY: the processor has AVX-512F.
            return unsafe { avx512(work) };
        }
        if std::arch::is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has AVX2.
            return unsafe { avx2(work) };
        }
    }
    work.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
fn avx512<W: Work>(work: W) -> W::Output {
    work.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn avx2<W: Work>(work: W) -> W::Output {
    work.run()
}
