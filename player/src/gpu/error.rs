//! Why Vulkan cannot be used, or stopped working.

use ash::vk;
use gpu_allocator::AllocationError;

/// Shorthand of this module's fallible functions.
pub type GpuResult<T> = Result<T, GpuError>;

/// A failure of the Vulkan layer, with the remedy where there is one.
#[derive(Debug, thiserror::Error)]
pub enum GpuError {
    /// `libvulkan` is not installed.
    #[error(
        "no Vulkan loader ({0}): install it (Debian, Ubuntu: apt install libvulkan1) and a Vulkan 1.3 driver"
    )]
    NoLoader(String),
    /// The loader is older than Vulkan 1.3.
    #[error("the Vulkan loader speaks version {0}, but 1.3 is needed: update libvulkan1")]
    OldLoader(String),
    /// The loader found no driver.
    #[error(
        "no Vulkan driver: install the one of the GPU's vendor, or the software one \
         (Debian, Ubuntu: apt install mesa-vulkan-drivers)"
    )]
    NoDriver,
    /// Validation was asked for and the layer is absent.
    #[error(
        "the Vulkan layer VK_LAYER_KHRONOS_validation is not installed \
         (Debian, Ubuntu: apt install vulkan-validationlayers)"
    )]
    NoValidationLayer,
    /// An instance extension is absent.
    #[error("the Vulkan loader lacks the extension {0}")]
    NoExtension(String),
    /// No device can render. One line per device with all it lacks.
    #[error("no usable Vulkan device:\n{0}")]
    NoDevice(String),
    /// The device cannot use a format as needed.
    #[error("{device} does not support {format} for {usage}")]
    Format {
        /// Device name.
        device: String,
        /// Vulkan name of the format.
        format: String,
        /// What it is needed for.
        usage: String,
    },
    /// A package stores an image in blocks that the device cannot read.
    #[error(
        "{device} reads no {family} textures, but image `{image}` is one: bake the scene with \
         --target portable, which any device can show"
    )]
    NoBlocks {
        /// Device name.
        device: String,
        /// `BC` or `ASTC`.
        family: &'static str,
        /// Image name.
        image: String,
    },
    /// Something is larger than the device allows.
    #[error("{what} is {needed}, but {device} allows {limit}")]
    Limit {
        /// What is too large, with its name.
        what: String,
        /// Size needed.
        needed: u64,
        /// The device's limit.
        limit: u64,
        /// Device name.
        device: String,
    },
    /// An allocation failed.
    #[error("out of GPU memory for {what} ({bytes} bytes): {reason}")]
    OutOfMemory {
        /// What was allocated.
        what: String,
        /// Its size.
        bytes: u64,
        /// The allocator's reason.
        reason: String,
    },
    /// The device stopped: a hang, a crash of the driver, or an unplugged GPU.
    #[error("the GPU was lost (VK_ERROR_DEVICE_LOST): see the kernel log; start the program again")]
    DeviceLost,
    /// The window's surface cannot be presented to.
    #[error("cannot present to the window: {0}")]
    Surface(String),
    /// Any other failure of a Vulkan call.
    #[error("{call} failed: {result}")]
    Vulkan {
        /// Name of the call.
        call: &'static str,
        /// Its result.
        result: vk::Result,
    },
}

impl GpuError {
    /// The typed error of a failed call, for `map_err`.
    pub(super) fn of(call: &'static str) -> impl Fn(vk::Result) -> Self {
        move |result| match result {
            vk::Result::ERROR_DEVICE_LOST => Self::DeviceLost,
            vk::Result::ERROR_SURFACE_LOST_KHR => Self::Surface(format!("{call}: {result}")),
            vk::Result::ERROR_OUT_OF_HOST_MEMORY | vk::Result::ERROR_OUT_OF_DEVICE_MEMORY => {
                Self::OutOfMemory {
                    what: call.into(),
                    bytes: 0,
                    reason: result.to_string(),
                }
            }
            _ => Self::Vulkan { call, result },
        }
    }

    /// The typed error of a failed allocation of `bytes` for `what`.
    pub(super) fn allocation(what: &str, bytes: u64, error: &AllocationError) -> Self {
        Self::OutOfMemory {
            what: what.into(),
            bytes,
            reason: error.to_string(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_become_types() {
        let of = GpuError::of("vkQueueSubmit2");
        assert!(matches!(
            of(vk::Result::ERROR_DEVICE_LOST),
            GpuError::DeviceLost
        ));
        assert!(matches!(
            of(vk::Result::ERROR_SURFACE_LOST_KHR),
            GpuError::Surface(_)
        ));
        assert!(matches!(
            of(vk::Result::ERROR_OUT_OF_DEVICE_MEMORY),
            GpuError::OutOfMemory { .. }
        ));
        let other = of(vk::Result::ERROR_FORMAT_NOT_SUPPORTED).to_string();
        assert!(other.contains("vkQueueSubmit2"), "{other}");
    }
}
