//! Derives the barriers of a frame from what its passes declare to read and write.
//!
//! The graph remembers the last accesses of each image and buffer across frames, so frames in flight that share one
//! are ordered as passes of one frame are.

mod usage;

use std::ffi::CStr;

use usage::{Access, State, Transition};
pub use usage::{Stage, Usage};

use crate::gpu::{
    Commands, FrameTarget, Gpu, GpuResult, Image, ImageBarrier, ImageDesc, ImageRef, Sync, vk,
};

/// Most images and buffers that one pass may use.
const MAX_USES: usize = 12;

/// An image or buffer of the graph.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Handle(usize);

/// Two images that take turns: the one that this frame writes, and the one that the last frame wrote.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pair {
    /// Written by this frame.
    pub current: Handle,
    /// Written by the last frame; read it only where [`Graph::has_history`].
    pub history: Handle,
}

/// What to create.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target {
    /// Name in messages and debuggers.
    pub name: &'static str,
    /// Texel format.
    pub format: vk::Format,
    /// What passes do with it.
    pub usage: vk::ImageUsageFlags,
    /// Samples per texel.
    pub samples: u32,
    /// Width and height; absent where it follows the graph's extent.
    pub extent: Option<[u32; 2]>,
    /// Layers of an array; absent where it is none.
    pub layers: Option<u32>,
}

impl Target {
    /// One layer and one sample of the graph's extent.
    pub const fn new(name: &'static str, format: vk::Format, usage: vk::ImageUsageFlags) -> Self {
        Self {
            name,
            format,
            usage,
            samples: 1,
            extent: None,
            layers: None,
        }
    }
}

/// What a pass touches: a list without an allocation.
#[derive(Clone, Copy)]
pub struct Uses {
    list: [(Handle, Usage); MAX_USES],
    length: usize,
}

impl Uses {
    /// A copy of a slice.
    ///
    /// # Panics
    /// As [`Uses::push`].
    pub fn of(uses: &[(Handle, Usage)]) -> Self {
        let mut list = Self {
            list: [(Handle(0), Usage::ColorClear); MAX_USES],
            length: 0,
        };
        for (handle, usage) in uses {
            list.push(*handle, *usage);
        }
        list
    }

    /// Adds one.
    ///
    /// # Panics
    /// Where there are `MAX_USES` already.
    pub fn push(&mut self, handle: Handle, usage: Usage) {
        self.list[self.length] = (handle, usage);
        self.length += 1;
    }
}

impl std::ops::Deref for Uses {
    type Target = [(Handle, Usage)];

    fn deref(&self) -> &[(Handle, Usage)] {
        &self.list[..self.length]
    }
}

/// What a handle stands for.
enum Node {
    /// An image that the graph owns and sizes.
    Owned(Target, Image),
    /// The image that [`Graph::begin`] is given.
    Imported(&'static str),
    /// A buffer, which somebody else owns.
    Buffer(&'static str),
}

impl Node {
    fn name(&self) -> &'static str {
        match self {
            Self::Owned(target, _) => target.name,
            Self::Imported(name) | Self::Buffer(name) => name,
        }
    }
}

/// An entry of the graph: which backing it has in even and in odd frames.
struct Entry {
    /// Index of the backing in even and in odd frames; the same but for pairs.
    backings: [usize; 2],
}

/// An image or buffer with what was done to it.
struct Backing {
    node: Node,
    state: State,
    /// Frame of the last write; history is valid only where that was the last frame.
    written: Option<u64>,
}

/// The images of a renderer and their states.
pub struct Graph {
    extent: [u32; 2],
    frame: u64,
    entries: Vec<Entry>,
    backings: Vec<Backing>,
}

impl Graph {
    /// A graph whose images have `extent` texels.
    pub fn new(extent: [u32; 2]) -> Self {
        Self {
            extent,
            frame: 0,
            entries: Vec::new(),
            backings: Vec::new(),
        }
    }

    /// Texels of every owned image that has no extent of its own.
    pub fn extent(&self) -> [u32; 2] {
        self.extent
    }

    /// Frames begun, modulo two: which image of a [`Pair`] is the current one.
    pub fn parity(&self) -> usize {
        (self.frame % 2) as usize
    }

    /// Adds an image.
    pub fn image(&mut self, gpu: &Gpu, target: Target) -> GpuResult<Handle> {
        let image = create(gpu, &target, self.extent)?;
        let backing = self.back(Node::Owned(target, image));
        Ok(self.push([backing, backing]))
    }

    /// Adds a pair of images.
    pub fn pair(&mut self, gpu: &Gpu, target: Target) -> GpuResult<Pair> {
        let mut back = || -> GpuResult<usize> {
            let image = create(gpu, &target, self.extent)?;
            Ok(self.back(Node::Owned(target, image)))
        };
        let (even, odd) = (back()?, back()?);
        Ok(Pair {
            current: self.push([even, odd]),
            history: self.push([odd, even]),
        })
    }

    /// Adds a place for the image that [`Graph::begin`] is given.
    pub fn imported(&mut self, name: &'static str) -> Handle {
        let backing = self.back(Node::Imported(name));
        self.push([backing, backing])
    }

    /// Adds a buffer, whose accesses are ordered and which somebody else owns.
    pub fn buffer(&mut self, name: &'static str) -> Handle {
        let backing = self.back(Node::Buffer(name));
        self.push([backing, backing])
    }

    fn back(&mut self, node: Node) -> usize {
        self.backings.push(Backing {
            node,
            state: State::UNDEFINED,
            written: None,
        });
        self.backings.len() - 1
    }

    fn push(&mut self, backings: [usize; 2]) -> Handle {
        self.entries.push(Entry { backings });
        Handle(self.entries.len() - 1)
    }

    /// Replaces every owned image that follows the graph's extent by an empty one of the new extent.
    pub fn resize(&mut self, gpu: &Gpu, extent: [u32; 2]) -> GpuResult<()> {
        for backing in &mut self.backings {
            match &mut backing.node {
                Node::Owned(target, image) if target.extent.is_none() => {
                    *image = create(gpu, target, extent)?;
                    backing.state = State::UNDEFINED;
                    backing.written = None;
                }
                _ => {}
            }
        }
        self.extent = extent;
        Ok(())
    }

    /// Replaces an owned image by an empty one, where `target` differs from what it was made of.
    ///
    /// # Panics
    /// Where the handle is not that of an owned image.
    pub fn replace(&mut self, gpu: &Gpu, handle: Handle, target: Target) -> GpuResult<bool> {
        let extent = self.extent;
        let mut changed = false;
        for index in self.entries[handle.0].backings {
            let backing = &mut self.backings[index];
            let Node::Owned(old, image) = &mut backing.node else {
                panic!("`{}` is not owned", backing.node.name());
            };
            if *old != target {
                *image = create(gpu, &target, extent)?;
                *old = target;
                backing.state = State::UNDEFINED;
                backing.written = None;
                changed = true;
            }
        }
        Ok(changed)
    }

    fn backing(&self, handle: Handle) -> &Backing {
        &self.backings[self.entries[handle.0].backings[self.parity()]]
    }

    fn backing_mut(&mut self, handle: Handle) -> &mut Backing {
        let index = self.entries[handle.0].backings[self.parity()];
        &mut self.backings[index]
    }

    /// The image behind a handle in this frame.
    ///
    /// # Panics
    /// Where the handle is that of an imported image or a buffer.
    pub fn owned(&self, handle: Handle) -> ImageRef<'_> {
        self.owned_image(handle).view()
    }

    /// The image behind a handle in this frame, with the views of its layers.
    ///
    /// # Panics
    /// As [`Graph::owned`].
    pub fn owned_image(&self, handle: Handle) -> &Image {
        match &self.backing(handle).node {
            Node::Owned(_, image) => image,
            other => panic!("`{}` is not owned", other.name()),
        }
    }

    /// The image behind a handle in frames of this parity: descriptor sets are written once for each.
    ///
    /// # Panics
    /// As [`Graph::owned`].
    pub fn owned_at(&self, handle: Handle, parity: usize) -> ImageRef<'_> {
        match &self.backings[self.entries[handle.0].backings[parity % 2]].node {
            Node::Owned(_, image) => image.view(),
            other => panic!("`{}` is not owned", other.name()),
        }
    }

    /// Whether the last frame wrote the image that `pair.history` now stands for.
    pub fn has_history(&self, pair: Pair) -> bool {
        self.frame > 0 && self.backing(pair.history).written == Some(self.frame - 1)
    }

    /// Starts the next frame: pairs take turns. Handles of pairs resolve to this frame's images from here on.
    pub fn advance(&mut self) {
        self.frame += 1;
    }

    /// Starts to record. `target` is the imported image, of undefined content.
    pub fn begin<'a>(
        &'a mut self,
        commands: &'a mut Commands,
        target: Option<(Handle, FrameTarget<'a>)>,
    ) -> FrameGraph<'a> {
        if let Some((handle, _)) = target {
            // The first access waits for the stage that the acquired image's semaphore was waited for in.
            let state = &mut self.backing_mut(handle).state;
            *state = state.handed_over(vk::PipelineStageFlags2::COLOR_ATTACHMENT_OUTPUT);
        }
        FrameGraph {
            graph: self,
            commands,
            target,
        }
    }
}

fn create(gpu: &Gpu, target: &Target, extent: [u32; 2]) -> GpuResult<Image> {
    let desc = ImageDesc {
        name: target.name,
        format: target.format,
        extent: target.extent.unwrap_or(extent),
        levels: 1,
        layers: target.layers.unwrap_or(1),
        cube: false,
        array: target.layers.is_some(),
        samples: target.samples,
        usage: target.usage,
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

    /// One layer of an array.
    ///
    /// # Panics
    /// As [`Graph::owned`], and where there is no such layer.
    pub fn layer(&self, handle: Handle, layer: u32) -> ImageRef<'a> {
        self.graph.owned_image(handle).layer(layer)
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
    /// Where a pass uses more than `MAX_USES` images and buffers, or one twice.
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
        assert!(uses.len() <= MAX_USES, "{} uses in one pass", uses.len());
        let frame = self.graph.frame;
        let mut transitions = [None; MAX_USES];
        for (index, (handle, usage)) in uses.iter().enumerate() {
            let twice = uses[..index].iter().any(|(earlier, _)| earlier == handle);
            let backing = self.graph.backing_mut(*handle);
            assert!(!twice, "`{}` is used twice", backing.node.name());
            let access = usage.access();
            if access.writes {
                backing.written = Some(frame);
            }
            transitions[index] = backing.state.advance(access).map(|found| (*handle, found));
        }
        self.memory_barrier(&transitions);
        self.image_barriers(&transitions);
    }

    /// One barrier for all buffers.
    fn memory_barrier(&mut self, transitions: &[Option<(Handle, Transition)>]) {
        let join = |a: Sync, b: Sync| Sync {
            stage: a.stage | b.stage,
            access: a.access | b.access,
        };
        let (mut source, mut destination) = (Sync::NONE, Sync::NONE);
        for (handle, found) in transitions.iter().flatten() {
            if matches!(self.graph.backing(*handle).node, Node::Buffer(_)) {
                source = join(source, found.source);
                destination = join(destination, found.destination);
            }
        }
        if source != Sync::NONE {
            self.commands.memory_barrier(source, destination);
        }
    }

    fn image_barriers(&mut self, transitions: &[Option<(Handle, Transition)>]) {
        let target = self.target.map(|(handle, target)| (handle, target.image));
        let images = Images {
            graph: self.graph,
            target,
        };
        let is_image = |(handle, _): &&(Handle, Transition)| {
            !matches!(self.graph.backing(*handle).node, Node::Buffer(_))
        };
        let mut pending = transitions.iter().flatten().filter(is_image);
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
        if let Some(found) = self.graph.backing_mut(handle).state.advance(access) {
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
