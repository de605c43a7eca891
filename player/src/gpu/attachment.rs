//! What a pass draws to: images, what they hold at its beginning, and whether the result is kept.

use ash::vk;

use super::image::ImageRef;

/// What an attachment holds when a pass begins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Load<T> {
    /// This value everywhere.
    Clear(T),
    /// What it held before.
    Keep,
    /// Anything: every pixel will be written.
    Discard,
}

/// A colour target, in `COLOR_ATTACHMENT_OPTIMAL`.
#[derive(Clone, Copy)]
pub struct ColorAttachment<'a> {
    /// Target.
    pub image: ImageRef<'a>,
    /// Content at the beginning.
    pub load: Load<[f32; 4]>,
    /// Whether the result is kept.
    pub store: bool,
}

/// A depth target, in `DEPTH_ATTACHMENT_OPTIMAL`.
#[derive(Clone, Copy)]
pub struct DepthAttachment<'a> {
    /// Target.
    pub image: ImageRef<'a>,
    /// Content at the beginning.
    pub load: Load<f32>,
    /// Whether the result is kept.
    pub store: bool,
}

fn load_op<T>(load: &Load<T>) -> vk::AttachmentLoadOp {
    match load {
        Load::Clear(_) => vk::AttachmentLoadOp::CLEAR,
        Load::Keep => vk::AttachmentLoadOp::LOAD,
        Load::Discard => vk::AttachmentLoadOp::DONT_CARE,
    }
}

fn store_op(store: bool) -> vk::AttachmentStoreOp {
    if store {
        vk::AttachmentStoreOp::STORE
    } else {
        vk::AttachmentStoreOp::DONT_CARE
    }
}

pub(super) fn color_info(color: &ColorAttachment<'_>) -> vk::RenderingAttachmentInfo<'static> {
    let mut clear = vk::ClearValue::default();
    if let Load::Clear(float32) = color.load {
        clear.color = vk::ClearColorValue { float32 };
    }
    vk::RenderingAttachmentInfo::default()
        .image_view(color.image.view)
        .image_layout(vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL)
        .load_op(load_op(&color.load))
        .store_op(store_op(color.store))
        .clear_value(clear)
}

pub(super) fn depth_info(depth: &DepthAttachment<'_>) -> vk::RenderingAttachmentInfo<'static> {
    let mut clear = vk::ClearValue::default();
    if let Load::Clear(value) = depth.load {
        clear.depth_stencil = vk::ClearDepthStencilValue {
            depth: value,
            stencil: 0,
        };
    }
    vk::RenderingAttachmentInfo::default()
        .image_view(depth.image.view)
        .image_layout(vk::ImageLayout::DEPTH_ATTACHMENT_OPTIMAL)
        .load_op(load_op(&depth.load))
        .store_op(store_op(depth.store))
        .clear_value(clear)
}
