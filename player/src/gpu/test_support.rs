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
