//! Derives the barriers of a frame from what its passes declare to read and write.
//!
//! The graph remembers the last accesses of each image across frames, so frames in flight that share an image
//! are ordered as passes of one frame are.

mod usage;

use std::ffi::CStr;

pub use usage::Usage;
use usage::{Access, State, Transition};

use crate::gpu::{
    Commands, FrameTarget, Gpu, GpuResult, Image, ImageBarrier, ImageDesc, ImageRef, vk,
};

/// Most images that one pass may use.
const MAX_USES: usize = 8;

/// An image of the graph.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Handle(usize);

/// An image that the graph owns and sizes, or the slot of an imported one.
struct Node {
    name: &'static str,
    owned: Option<(vk::Format, vk::ImageUsageFlags, Image)>,
    state: State,
}

/// The images of a renderer and their states.
pub struct Graph {
    extent: [u32; 2],
    nodes: Vec<Node>,
}

impl Graph {
    /// A graph whose images have `extent` texels.
    pub fn new(extent: [u32; 2]) -> Self {
        Self {
            extent,
            nodes: Vec::new(),
        }
    }

    /// Texels of every owned image.
    pub fn extent(&self) -> [u32; 2] {
        self.extent
    }

    /// Adds an image of the graph's extent.
    pub fn image(
        &mut self,
        gpu: &Gpu,
        name: &'static str,
        format: vk::Format,
        usage: vk::ImageUsageFlags,
    ) -> GpuResult<Handle> {
        let image = create(gpu, name, format, usage, self.extent)?;
        Ok(self.push(name, Some((format, usage, image))))
    }

    /// Adds a place for the image that [`Graph::begin`] is given.
    pub fn imported(&mut self, name: &'static str) -> Handle {
        self.push(name, None)
    }

    fn push(
        &mut self,
        name: &'static str,
        owned: Option<(vk::Format, vk::ImageUsageFlags, Image)>,
    ) -> Handle {
        self.nodes.push(Node {
            name,
            owned,
            state: State::UNDEFINED,
        });
        Handle(self.nodes.len() - 1)
    }

    /// Replaces every owned image by an empty one of the new extent.
    pub fn resize(&mut self, gpu: &Gpu, extent: [u32; 2]) -> GpuResult<()> {
        for node in &mut self.nodes {
            if let Some((format, usage, image)) = &mut node.owned {
                *image = create(gpu, node.name, *format, *usage, extent)?;
                node.state = State::UNDEFINED;
            }
        }
        self.extent = extent;
        Ok(())
    }

    /// The image behind a handle.
    ///
    /// # Panics
    /// Where the handle is that of an imported image.
    pub fn owned(&self, handle: Handle) -> ImageRef<'_> {
        match &self.nodes[handle.0].owned {
            Some((_, _, image)) => image.view(),
            None => panic!("image `{}` is imported", self.nodes[handle.0].name),
        }
    }

    /// Starts a frame. `target` is the imported image, of undefined content.
    pub fn begin<'a>(
        &'a mut self,
        commands: &'a mut Commands,
        target: Option<(Handle, FrameTarget<'a>)>,
    ) -> FrameGraph<'a> {
        if let Some((handle, _)) = target {
            // The first access waits for the stage that the acquired image's semaphore was waited for in.
            let state = &mut self.nodes[handle.0].state;
            *state = state.handed_over(vk::PipelineStageFlags2::COLOR_ATTACHMENT_OUTPUT);
        }
        FrameGraph {
            graph: self,
            commands,
            target,
        }
    }
}

fn create(
    gpu: &Gpu,
    name: &str,
    format: vk::Format,
    usage: vk::ImageUsageFlags,
    extent: [u32; 2],
) -> GpuResult<Image> {
    let desc = ImageDesc {
        name,
        format,
        extent,
        levels: 1,
        layers: 1,
        cube: false,
        usage,
    };
    Image::new(gpu, &desc)
}

/// Resolves handles while a pass is recorded.
pub struct Images<'a> {
    graph: &'a Graph,
    target: Option<(Handle, ImageRef<'a>)>,
}

impl<'a> Images<'a> {
    /// The image behind a handle.
    ///
    /// # Panics
    /// Where the handle is of an imported image that this frame was not given.
    pub fn get(&self, handle: Handle) -> ImageRef<'a> {
        match self.target {
            Some((target, image)) if target == handle => image,
            _ => self.graph.owned(handle),
        }
    }
}

/// A frame being recorded.
pub struct FrameGraph<'a> {
    graph: &'a mut Graph,
    commands: &'a mut Commands,
    target: Option<(Handle, FrameTarget<'a>)>,
}

impl FrameGraph<'_> {
    /// Records a pass: barriers for `uses`, then `record`, inside a label and a timer of the pass's name.
    ///
    /// # Panics
    /// Where a pass uses more than `MAX_USES` images, or one image twice.
    pub fn pass(
        &mut self,
        name: &'static CStr,
        uses: &[(Handle, Usage)],
        record: impl FnOnce(&mut Commands, &Images<'_>),
    ) {
        self.commands.pass_begin(name);
        self.barriers(uses);
        let target = self.target.map(|(handle, target)| (handle, target.image));
        record(
            self.commands,
            &Images {
                graph: self.graph,
                target,
            },
        );
        self.commands.pass_end();
    }

    fn barriers(&mut self, uses: &[(Handle, Usage)]) {
        assert!(uses.len() <= MAX_USES, "{} images in one pass", uses.len());
        let mut transitions = [None; MAX_USES];
        for (index, (handle, usage)) in uses.iter().enumerate() {
            let twice = uses[..index].iter().any(|(earlier, _)| earlier == handle);
            assert!(
                !twice,
                "image `{}` is used twice",
                self.graph.nodes[handle.0].name
            );
            let state = &mut self.graph.nodes[handle.0].state;
            transitions[index] = state.advance(usage.access()).map(|found| (*handle, found));
        }
        let target = self.target.map(|(handle, target)| (handle, target.image));
        let images = Images {
            graph: self.graph,
            target,
        };
        let mut pending = transitions.iter().flatten();
        let Some(first) = pending.next().map(|entry| barrier(&images, entry)) else {
            return;
        };
        let mut barriers = [first; MAX_USES];
        let mut count = 1;
        for entry in pending {
            barriers[count] = barrier(&images, entry);
            count += 1;
        }
        self.commands.image_barriers(&barriers[..count]);
    }

    /// Hands the imported image over in the layout that its owner asked for.
    pub fn finish(self) {
        let Some((handle, target)) = self.target else {
            return;
        };
        let access = Access {
            layout: target.final_layout,
            sync: target.final_sync,
            writes: false,
            keeps: true,
        };
        if let Some(found) = self.graph.nodes[handle.0].state.advance(access) {
            let images = Images {
                graph: self.graph,
                target: Some((handle, target.image)),
            };
            self.commands
                .image_barriers(&[barrier(&images, &(handle, found))]);
        }
    }
}

fn barrier<'a>(images: &Images<'a>, (handle, found): &(Handle, Transition)) -> ImageBarrier<'a> {
    ImageBarrier {
        image: images.get(*handle),
        old: found.old,
        new: found.new,
        source: found.source,
        destination: found.destination,
    }
}
