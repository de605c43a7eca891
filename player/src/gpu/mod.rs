//! The Vulkan layer: safe wrappers for everything that passes, the upload and the window use.
//!
//! Objects are destroyed late: a dropped object waits until the submissions that may use it have finished.
#![allow(unsafe_code)]

pub mod accel;
pub mod attachment;
pub mod blocks;
pub mod buffer;
pub mod command;
pub mod descriptor;
pub mod device;
pub mod error;
pub mod frame_sync;
pub mod image;
mod instance;
#[cfg(feature = "oidn")]
pub mod oidn;
pub mod pipeline;
mod pipeline_cache;
mod query;
mod queue;
pub mod raytracing;
mod select;
pub mod staging;
#[cfg(feature = "window")]
pub mod swapchain;
#[cfg(test)]
pub(crate) mod test_support;
#[cfg(test)]
mod tests;

pub use accel::{BuildStats, TopLevel, TraceGeometry, TraceInstance};
pub use ash::vk;
pub use attachment::{ColorAttachment, DepthAttachment, Load};
pub use blocks::{AllowedBlocks, Blocks};
pub use buffer::{Buffer, BufferDesc, Memory};
pub use command::{Commands, FrameTarget, ImageBarrier, Sync};
pub use descriptor::{DescriptorSet, Layouts, SetIndex};
pub use device::{Gpu, GpuOptions};
pub use error::{GpuError, GpuResult};
pub use frame_sync::{FRAMES_IN_FLIGHT, Frames};
pub use image::{Image, ImageDesc, ImageRef, Sampler, SamplerDesc};
pub use pipeline::{
    Blend, ColorTarget, ComputePipeline, DepthState, GraphicsPipeline, GraphicsPipelineDesc,
    Shader, VertexInput,
};
pub use query::PassTime;
pub use queue::Submission;
pub use raytracing::{RayPipeline, RayPipelineDesc};
pub use staging::{UploadStats, Uploader};
