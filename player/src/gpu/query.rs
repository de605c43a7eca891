//! GPU times of passes, by timestamps.

use std::ffi::CStr;
use std::sync::Arc;

use ash::vk;

use super::device::Shared;
use super::error::{GpuError, GpuResult};
use super::queue::Garbage;

/// Most passes of a frame that are timed; further ones are not.
pub(super) const MAX_PASSES: usize = 32;
const MAX_QUERIES: usize = MAX_PASSES * 2;

/// How long the GPU worked on a pass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PassTime {
    /// Name given to `pass_begin`.
    pub name: &'static CStr,
    /// From the end of all earlier work to the end of the pass.
    pub milliseconds: f64,
}

/// The timestamps of one frame in flight.
pub(super) struct QueryPool {
    shared: Arc<Shared>,
    raw: vk::QueryPool,
}

/// The passes of a recording: pass `i` writes the queries `2 i` and `2 i + 1`.
#[derive(Clone, Copy)]
pub(super) struct PassTimer {
    pool: vk::QueryPool,
    names: [&'static CStr; MAX_PASSES],
    count: usize,
}

impl PassTimer {
    /// Times nothing.
    pub(super) const NONE: Self = Self {
        pool: vk::QueryPool::null(),
        names: [c""; MAX_PASSES],
        count: 0,
    };

    /// Pool and query of the next pass's begin, which is now counted.
    pub(super) fn begin(&mut self, name: &'static CStr) -> Option<(vk::QueryPool, u32)> {
        if self.pool == vk::QueryPool::null() || self.count == MAX_PASSES {
            return None;
        }
        self.names[self.count] = name;
        self.count += 1;
        Some((self.pool, self.count as u32 * 2 - 2))
    }

    /// Pool and query of the current pass's end.
    pub(super) fn end(&self) -> Option<(vk::QueryPool, u32)> {
        (self.count > 0).then(|| (self.pool, self.count as u32 * 2 - 1))
    }
}

impl QueryPool {
    /// `None` where the queue has no timestamps.
    pub(super) fn new(shared: &Arc<Shared>) -> GpuResult<Option<Self>> {
        if shared.timestamp_bits == 0 {
            return Ok(None);
        }
        let info = vk::QueryPoolCreateInfo::default()
            .query_type(vk::QueryType::TIMESTAMP)
            .query_count(MAX_QUERIES as u32);
        // SAFETY: the device is alive.
        let raw = unsafe { shared.device.create_query_pool(&info, None) }
            .map_err(GpuError::of("vkCreateQueryPool"))?;
        Ok(Some(Self {
            shared: shared.clone(),
            raw,
        }))
    }

    /// Resets all queries and returns the timer that writes them.
    pub(super) fn start(&self, commands: vk::CommandBuffer) -> PassTimer {
        // SAFETY: the command buffer is recording outside of rendering, and the pool's last use has finished.
        unsafe {
            let device = &self.shared.device;
            device.cmd_reset_query_pool(commands, self.raw, 0, MAX_QUERIES as u32);
        }
        PassTimer {
            pool: self.raw,
            ..PassTimer::NONE
        }
    }

    /// Replaces `times` by those of a finished submission.
    pub(super) fn read(&self, timer: &PassTimer, times: &mut Vec<PassTime>) -> GpuResult<()> {
        times.clear();
        let mut ticks = [0u64; MAX_QUERIES];
        let ticks = &mut ticks[..timer.count * 2];
        if ticks.is_empty() {
            return Ok(());
        }
        // SAFETY: both queries of every counted pass were written by a submission that has finished.
        unsafe {
            self.shared.device.get_query_pool_results(
                self.raw,
                0,
                ticks,
                vk::QueryResultFlags::TYPE_64,
            )
        }
        .map_err(GpuError::of("vkGetQueryPoolResults"))?;
        let period = f64::from(self.shared.limits.timestamp_period);
        let bits = self.shared.timestamp_bits;
        for (name, pair) in timer.names.iter().zip(ticks.chunks_exact(2)) {
            times.push(PassTime {
                name,
                milliseconds: elapsed(pair[0], pair[1], bits) as f64 * period * 1e-6,
            });
        }
        Ok(())
    }
}

impl Drop for QueryPool {
    fn drop(&mut self) {
        self.shared.discard(Garbage::QueryPool(self.raw));
    }
}

/// Ticks between two readings of a counter with `bits` valid bits, which may have wrapped once.
fn elapsed(begin: u64, end: u64, bits: u32) -> u64 {
    let mask = u64::MAX >> (64 - bits.clamp(1, 64));
    end.wrapping_sub(begin) & mask
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_counter_may_wrap() {
        assert_eq!(elapsed(10, 25, 64), 15);
        assert_eq!(elapsed(0xffff_fff0, 0x10, 32), 0x20);
        assert_eq!(elapsed(u64::MAX, 4, 64), 5);
    }

    #[test]
    fn passes_beyond_the_pool_are_not_timed() {
        let mut timer = PassTimer {
            pool: <vk::QueryPool as vk::Handle>::from_raw(1),
            ..PassTimer::NONE
        };
        for pass in 0..MAX_PASSES as u32 {
            assert_eq!(timer.begin(c"pass").map(|(_, query)| query), Some(pass * 2));
            assert_eq!(timer.end().map(|(_, query)| query), Some(pass * 2 + 1));
        }
        assert!(timer.begin(c"one too many").is_none());
        let mut none = PassTimer::NONE;
        assert!(none.begin(c"pass").is_none() && none.end().is_none());
    }
}
