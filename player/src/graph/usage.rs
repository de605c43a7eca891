//! What each kind of use of an image or buffer waits for, and leaves behind for the next one to wait for.

use crate::gpu::Sync;
use crate::gpu::vk::{AccessFlags2, ImageLayout, PipelineStageFlags2};

/// The shader stage that touches an image or buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    Fragment,
    Compute,
    RayTracing,
}

impl Stage {
    fn flags(self) -> PipelineStageFlags2 {
        match self {
            Self::Fragment => PipelineStageFlags2::FRAGMENT_SHADER,
            Self::Compute => PipelineStageFlags2::COMPUTE_SHADER,
            Self::RayTracing => PipelineStageFlags2::RAY_TRACING_SHADER_KHR,
        }
    }
}

/// How a pass uses an image or buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Usage {
    /// Colour attachment; what it held before is lost.
    ColorClear,
    /// Colour attachment, on top of what it holds.
    Color,
    /// Depth attachment, tested and written; what it held before is lost.
    DepthClear,
    /// Depth attachment, tested, written or not: storing it is a write as well.
    Depth,
    /// Texture.
    Sampled(Stage),
    /// Storage image, written whole; what it held before is lost.
    StorageClear(Stage),
    /// Storage image, read and written.
    Storage(Stage),
    /// Storage buffer, read.
    BufferRead(Stage),
    /// Storage buffer, read and written.
    Buffer(Stage),
    /// Buffer that a copy or fill writes.
    BufferCopyTarget,
    /// Buffer that a copy reads.
    BufferCopySource,
    /// Source of a copy.
    CopySource,
}

/// What a usage means to the GPU.
#[derive(Clone, Copy)]
pub(super) struct Access {
    pub(super) layout: ImageLayout,
    pub(super) sync: Sync,
    pub(super) writes: bool,
    pub(super) keeps: bool,
}

impl Usage {
    pub(super) fn access(self) -> Access {
        let color = PipelineStageFlags2::COLOR_ATTACHMENT_OUTPUT;
        let depth =
            PipelineStageFlags2::EARLY_FRAGMENT_TESTS | PipelineStageFlags2::LATE_FRAGMENT_TESTS;
        let (color_read, color_write) = (
            AccessFlags2::COLOR_ATTACHMENT_READ,
            AccessFlags2::COLOR_ATTACHMENT_WRITE,
        );
        let (depth_read, depth_write) = (
            AccessFlags2::DEPTH_STENCIL_ATTACHMENT_READ,
            AccessFlags2::DEPTH_STENCIL_ATTACHMENT_WRITE,
        );
        let (layout, stage, access, writes, keeps) = match self {
            Self::ColorClear => (
                ImageLayout::COLOR_ATTACHMENT_OPTIMAL,
                color,
                color_read | color_write,
                true,
                false,
            ),
            Self::Color => (
                ImageLayout::COLOR_ATTACHMENT_OPTIMAL,
                color,
                color_read | color_write,
                true,
                true,
            ),
            Self::DepthClear => (
                ImageLayout::DEPTH_ATTACHMENT_OPTIMAL,
                depth,
                depth_read | depth_write,
                true,
                false,
            ),
            Self::Depth => (
                ImageLayout::DEPTH_ATTACHMENT_OPTIMAL,
                depth,
                depth_read | depth_write,
                true,
                true,
            ),
            Self::Sampled(stage) => (
                ImageLayout::SHADER_READ_ONLY_OPTIMAL,
                stage.flags(),
                AccessFlags2::SHADER_SAMPLED_READ,
                false,
                true,
            ),
            Self::StorageClear(stage) | Self::Storage(stage) => (
                ImageLayout::GENERAL,
                stage.flags(),
                AccessFlags2::SHADER_STORAGE_READ | AccessFlags2::SHADER_STORAGE_WRITE,
                true,
                matches!(self, Self::Storage(_)),
            ),
            // Buffers have no layout: theirs stays undefined.
            Self::BufferRead(stage) => (
                ImageLayout::UNDEFINED,
                stage.flags(),
                AccessFlags2::SHADER_STORAGE_READ,
                false,
                true,
            ),
            Self::Buffer(stage) => (
                ImageLayout::UNDEFINED,
                stage.flags(),
                AccessFlags2::SHADER_STORAGE_READ | AccessFlags2::SHADER_STORAGE_WRITE,
                true,
                true,
            ),
            Self::BufferCopyTarget => (
                ImageLayout::UNDEFINED,
                PipelineStageFlags2::COPY | PipelineStageFlags2::CLEAR,
                AccessFlags2::TRANSFER_WRITE,
                true,
                true,
            ),
            Self::BufferCopySource => (
                ImageLayout::UNDEFINED,
                PipelineStageFlags2::COPY,
                AccessFlags2::TRANSFER_READ,
                false,
                true,
            ),
            Self::CopySource => (
                ImageLayout::TRANSFER_SRC_OPTIMAL,
                PipelineStageFlags2::COPY,
                AccessFlags2::TRANSFER_READ,
                false,
                true,
            ),
        };
        Access {
            layout,
            sync: Sync { stage, access },
            writes,
            keeps,
        }
    }
}

/// A barrier, but for its image.
#[derive(Clone, Copy, Debug)]
pub(super) struct Transition {
    pub(super) old: ImageLayout,
    pub(super) new: ImageLayout,
    pub(super) source: Sync,
    pub(super) destination: Sync,
}

/// What was done to an image so far.
#[derive(Clone, Copy, Debug)]
pub(super) struct State {
    layout: ImageLayout,
    /// The last write or layout transition.
    write: Sync,
    /// Accesses to which that write is visible.
    visible: Sync,
    /// Stages that read since; the next write waits for all of them.
    readers: PipelineStageFlags2,
}

const NOTHING: Sync = Sync {
    stage: PipelineStageFlags2::NONE,
    access: AccessFlags2::NONE,
};

impl State {
    /// An image nobody touched.
    pub(super) const UNDEFINED: Self = Self {
        layout: ImageLayout::UNDEFINED,
        write: NOTHING,
        visible: NOTHING,
        readers: PipelineStageFlags2::NONE,
    };

    /// The state in which an imported image of unknown content comes: work up to `stage` may still use it, and
    /// so may what `self` records of its last frame.
    pub(super) fn handed_over(self, stage: PipelineStageFlags2) -> Self {
        Self {
            write: Sync {
                stage: self.write.stage | self.readers | stage,
                access: self.write.access,
            },
            ..Self::UNDEFINED
        }
    }

    /// Advances to the next access; the barrier that must stand in front of it, where one is needed.
    pub(super) fn advance(&mut self, next: Access) -> Option<Transition> {
        let changes_layout = self.layout != next.layout;
        let sees_write = self.visible.stage.contains(next.sync.stage)
            && self.visible.access.contains(next.sync.access);
        if !next.writes && !changes_layout && (sees_write || self.write.stage.is_empty()) {
            self.readers |= next.sync.stage;
            return None;
        }
        let overwrites = next.writes || changes_layout;
        let waits_for_readers = if overwrites {
            self.readers
        } else {
            PipelineStageFlags2::NONE
        };
        let transition = Transition {
            old: if next.keeps {
                self.layout
            } else {
                ImageLayout::UNDEFINED
            },
            new: next.layout,
            source: Sync {
                stage: self.write.stage | waits_for_readers,
                access: self.write.access,
            },
            destination: next.sync,
        };
        self.layout = next.layout;
        if next.writes {
            self.write = next.sync;
            self.visible = NOTHING;
            self.readers = PipelineStageFlags2::NONE;
        } else {
            if changes_layout {
                // The transition is a write that ends before the destination's stages begin.
                self.write = Sync {
                    stage: next.sync.stage,
                    access: AccessFlags2::NONE,
                };
                self.visible = NOTHING;
                self.readers = PipelineStageFlags2::NONE;
            }
            self.visible.stage |= next.sync.stage;
            self.visible.access |= next.sync.access;
            self.readers |= next.sync.stage;
        }
        Some(transition)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAGMENT: Usage = Usage::Sampled(Stage::Fragment);

    fn after(usages: &[Usage]) -> (State, Vec<Option<Transition>>) {
        let mut state = State::UNDEFINED;
        let found = usages
            .iter()
            .map(|usage| state.advance(usage.access()))
            .collect();
        (state, found)
    }

    #[test]
    fn a_read_waits_for_the_write() {
        let (_, found) = after(&[Usage::ColorClear, FRAGMENT]);
        let barrier = found[1].expect("read after write");
        assert_eq!(barrier.old, ImageLayout::COLOR_ATTACHMENT_OPTIMAL);
        assert_eq!(barrier.new, ImageLayout::SHADER_READ_ONLY_OPTIMAL);
        assert_eq!(
            barrier.source.stage,
            PipelineStageFlags2::COLOR_ATTACHMENT_OUTPUT
        );
        assert!(
            barrier
                .source
                .access
                .contains(AccessFlags2::COLOR_ATTACHMENT_WRITE)
        );
        assert_eq!(
            barrier.destination.stage,
            PipelineStageFlags2::FRAGMENT_SHADER
        );
    }

    #[test]
    fn a_second_read_needs_no_barrier() {
        let (_, found) = after(&[Usage::ColorClear, FRAGMENT, FRAGMENT]);
        assert!(found[2].is_none());
    }

    #[test]
    fn a_read_in_another_stage_is_not_covered_by_the_first() {
        let (mut state, _) = after(&[Usage::ColorClear, FRAGMENT]);
        let compute = Usage::Sampled(Stage::Compute).access();
        let barrier = state
            .advance(compute)
            .expect("the write is not visible to compute yet");
        assert_eq!(barrier.old, barrier.new);
        assert!(state.advance(compute).is_none());
        let overwrite = state
            .advance(Usage::ColorClear.access())
            .expect("write after read");
        let readers = PipelineStageFlags2::FRAGMENT_SHADER | PipelineStageFlags2::COMPUTE_SHADER;
        assert!(
            overwrite.source.stage.contains(readers),
            "the write waits for every reader"
        );
    }

    #[test]
    fn the_next_frame_waits_for_the_last_readers() {
        let (mut state, _) = after(&[Usage::ColorClear, Usage::Color, FRAGMENT]);
        let barrier = state
            .advance(Usage::ColorClear.access())
            .expect("write after read");
        assert_eq!(
            barrier.old,
            ImageLayout::UNDEFINED,
            "cleared content is not kept"
        );
        assert!(
            barrier
                .source
                .stage
                .contains(PipelineStageFlags2::FRAGMENT_SHADER)
        );
    }

    #[test]
    fn writes_wait_for_writes() {
        let (_, found) = after(&[Usage::DepthClear, Usage::Depth, Usage::DepthClear]);
        assert!(found.iter().all(Option::is_some));
        let tests =
            PipelineStageFlags2::EARLY_FRAGMENT_TESTS | PipelineStageFlags2::LATE_FRAGMENT_TESTS;
        assert_eq!(found[2].map(|barrier| barrier.source.stage), Some(tests));
    }

    #[test]
    fn the_first_access_waits_for_nothing() {
        let (_, found) = after(&[Usage::ColorClear]);
        let barrier = found[0].expect("the layout changes");
        assert_eq!(barrier.source.stage, PipelineStageFlags2::NONE);
    }

    #[test]
    fn an_imported_image_waits_for_its_last_frame() {
        let (state, _) = after(&[Usage::ColorClear, Usage::CopySource]);
        let mut state = state.handed_over(PipelineStageFlags2::COLOR_ATTACHMENT_OUTPUT);
        let barrier = state
            .advance(Usage::ColorClear.access())
            .expect("write after read");
        let stages = PipelineStageFlags2::COLOR_ATTACHMENT_OUTPUT | PipelineStageFlags2::COPY;
        assert_eq!(barrier.source.stage, stages);
        assert_eq!(barrier.old, ImageLayout::UNDEFINED);
    }

    #[test]
    fn a_storage_write_waits_for_the_sampled_read() {
        let clear = Usage::StorageClear(Stage::Compute);
        let (_, found) = after(&[clear, FRAGMENT, clear]);
        let read = found[1].expect("read after write");
        assert_eq!(
            (read.old, read.new),
            (ImageLayout::GENERAL, ImageLayout::SHADER_READ_ONLY_OPTIMAL)
        );
        let write = found[2].expect("write after read");
        assert_eq!(write.old, ImageLayout::UNDEFINED);
        assert!(
            write
                .source
                .stage
                .contains(PipelineStageFlags2::FRAGMENT_SHADER)
        );
        let (_, found) = after(&[clear, Usage::Storage(Stage::Compute)]);
        assert_eq!(
            found[1].map(|barrier| barrier.old),
            Some(ImageLayout::GENERAL)
        );
    }

    #[test]
    fn buffers_are_ordered_without_layouts() {
        let write = Usage::Buffer(Stage::Compute);
        let read = Usage::BufferRead(Stage::Fragment);
        let (_, found) = after(&[write, read, read, Usage::BufferCopySource, write]);
        assert!(found[1].is_some() && found[2].is_none());
        assert!(found[3].is_some(), "the write is not visible to copies yet");
        let last = found[4].expect("write after read");
        let readers = PipelineStageFlags2::FRAGMENT_SHADER | PipelineStageFlags2::COPY;
        assert!(last.source.stage.contains(readers));
        assert!(
            found
                .iter()
                .flatten()
                .all(|barrier| barrier.old == ImageLayout::UNDEFINED
                    && barrier.new == ImageLayout::UNDEFINED)
        );
    }
}
