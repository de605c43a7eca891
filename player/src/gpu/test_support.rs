//! A validated device for tests.

use super::device::{Gpu, GpuOptions};
use super::error::GpuError;

/// A device with validation. `None`, loudly, where there is no Vulkan at all and `CAIRN_REQUIRE_VULKAN` is not
/// set; any other failure is the test's.
pub(crate) fn gpu() -> Option<Gpu> {
    let options = GpuOptions {
        validation: true,
        device: None,
        ..GpuOptions::default()
    };
    match Gpu::new(&options) {
        Ok(gpu) => Some(gpu),
        Err(error @ (GpuError::NoLoader(_) | GpuError::NoDriver))
            if std::env::var_os("CAIRN_REQUIRE_VULKAN").is_none() =>
        {
            eprintln!("SKIPPED: {error}");
            None
        }
        Err(error) => panic!("{error}"),
    }
}

/// Drops the device; fails where the validation layer has reported anything, leaks included.
pub(crate) fn close_clean(gpu: Gpu) {
    let messages = gpu.close();
    assert!(messages.is_empty(), "{messages:#?}");
}

/// Counts the allocations of each thread of the test program.
struct Counting;

thread_local! {
    static ALLOCATIONS: std::cell::Cell<u64> = const { std::cell::Cell::new(0) };
}

// SAFETY: everything is the system allocator's; the counter is a plain number that allocates nothing.
unsafe impl std::alloc::GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: std::alloc::Layout) -> *mut u8 {
        let _ = ALLOCATIONS.try_with(|count| count.set(count.get() + 1));
        // SAFETY: the caller's promises are those of the system allocator.
        unsafe { std::alloc::System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: std::alloc::Layout) {
        // SAFETY: the pointer came from the system allocator with this layout.
        unsafe { std::alloc::System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

/// How often this thread has allocated so far.
pub(crate) fn allocations() -> u64 {
    ALLOCATIONS.with(std::cell::Cell::get)
}
