//! Why the player stopped, with the exit code of each reason.

use crate::gpu::GpuError;

/// Any failure of the player.
#[derive(Debug, thiserror::Error)]
pub enum PlayerError {
    /// The package cannot be read, or breaks a rule of the format.
    #[error(transparent)]
    Package(#[from] cairn_format::Error),
    /// Vulkan is missing, lacks something, or failed.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// Open Image Denoise is missing, or failed.
    #[cfg(feature = "oidn")]
    #[error(transparent)]
    Denoise(#[from] crate::gpu::oidn::OidnError),
    /// The command line or a file named on it is wrong.
    #[error("{0}")]
    Input(String),
}

impl PlayerError {
    /// 2 where the input is at fault, 1 where the machine is.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Package(_) | Self::Input(_) => 2,
            Self::Gpu(_) => 1,
            #[cfg(feature = "oidn")]
            Self::Denoise(_) => 1,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bad_input_and_a_bad_machine_exit_differently() {
        assert_eq!(PlayerError::Input("x".into()).exit_code(), 2);
        assert_eq!(
            PlayerError::from(cairn_format::Error::NotAPackage).exit_code(),
            2
        );
        assert_eq!(PlayerError::from(GpuError::DeviceLost).exit_code(), 1);
    }
}
