//! The images of a frame, and set 2, through which shaders read them.

use crate::gpu::vk::{Format, ImageUsageFlags};
use crate::gpu::{DescriptorSet, Gpu, GpuResult, Layouts, Sampler, SamplerDesc, SetIndex};
use crate::graph::{Graph, Handle, Pair, Stage, Target, Usage, Uses};
use crate::passes::{DEPTH_FORMAT, HDR_FORMAT, NORMAL_FORMAT, ROUGHNESS_FORMAT, VISIBILITY_FORMAT};
use crate::plan::{Plan, ShadowMap};

/// Depth of one sample per pixel where the depth image itself has several.
const RESOLVED_DEPTH_FORMAT: Format = Format::R32_SFLOAT;

/// Two words: `ao_texel.glsl`.
const AO_FORMAT: Format = Format::R32G32_UINT;

/// Handles of a frame's images. With one sample per pixel, what is drawn to is what is read.
pub struct Targets {
    /// What is shown.
    pub output: Handle,
    /// Linear radiance, one sample.
    pub hdr: Handle,
    /// Depth in reverse-Z, one sample: of each pixel's nearest one. The last frame's is kept.
    pub depth: Pair,
    /// World normal `n * 0.5 + 0.5` and roughness of the sample that `depth` has; where a pass reads them.
    pub surface: Option<Surface>,
    /// Ambient occlusion.
    pub ao: Option<AoImages>,
    /// How much of directional light 0 contact shadows let through.
    pub contact: Option<Handle>,
    /// Which triangle each sample sees; where surfaces are shaded in compute.
    pub visibility: Option<Handle>,
    /// What surfaces are drawn to.
    pub drawn: Drawn,
    /// Light depth in reverse-Z, a layer per cascade.
    pub shadow: Option<ShadowTarget>,
    /// The nearest texel, and between texels.
    pub samplers: Samplers,
    sets: [DescriptorSet; 2],
}

/// Images of the visible surfaces.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Surface {
    pub normal: Handle,
    pub roughness: Handle,
}

/// Images of ambient occlusion; `ao_texel.glsl` says what they hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AoImages {
    /// Before it is filtered.
    pub noisy: Handle,
    /// Of this frame alone; absent where frames are not joined.
    pub spatial: Option<Handle>,
    /// What surfaces read, and what it was in the last frame.
    pub ao: Pair,
}

impl AoImages {
    /// What the spatial filter writes.
    pub fn filtered(&self) -> Handle {
        self.spatial.unwrap_or(self.ao.current)
    }
}

/// Attachments, with the plan's samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Drawn {
    pub hdr: Handle,
    pub depth: Handle,
    pub surface: Option<Surface>,
}

/// The shadow map, and how it is read.
pub struct ShadowTarget {
    pub map: Handle,
    compare: Sampler,
    depth: Sampler,
}

/// Samplers of the frame's images, clamped to the edge.
pub struct Samplers {
    pub nearest: Sampler,
    pub linear: Sampler,
}

impl Targets {
    /// Adds the images of a plan to the graph.
    ///
    /// # Errors
    /// Failures of Vulkan.
    pub fn new(gpu: &Gpu, layouts: &Layouts, graph: &mut Graph, plan: &Plan) -> GpuResult<Self> {
        let resolved = plan.samples > 1;
        let storage = ImageUsageFlags::SAMPLED | ImageUsageFlags::STORAGE;
        let color = ImageUsageFlags::COLOR_ATTACHMENT;
        let hdr_usage = storage | color | ImageUsageFlags::TRANSFER_SRC;
        let hdr = graph.image(gpu, Target::new("hdr", HDR_FORMAT, hdr_usage))?;
        let depth = graph.pair(gpu, depth_target(plan))?;
        let surface = plan
            .normals
            .then(|| add_surface(gpu, graph, ["normal", "roughness"], storage | color, 1));
        let surface = surface.transpose()?;
        let ao = plan
            .ao
            .map(|ao| add_ao(gpu, graph, ao.temporal))
            .transpose()?;
        let contact = Target::new("contact mask", Format::R8_UNORM, storage);
        let contact = plan
            .contact
            .then(|| graph.image(gpu, contact))
            .transpose()?;
        let drawn = if resolved {
            add_multisampled(gpu, graph, plan, hdr)?
        } else {
            Drawn {
                hdr,
                depth: depth.current,
                surface,
            }
        };
        let visibility = plan.compute.then(|| {
            let usage = color | ImageUsageFlags::SAMPLED;
            let target = Target::new("visibility", VISIBILITY_FORMAT, usage);
            let samples = plan.samples;
            graph.image(gpu, Target { samples, ..target })
        });
        let shadow = plan.shadow.map(|map| add_shadow(gpu, graph, map));
        let samplers = Samplers {
            nearest: Sampler::new(gpu, "nearest clamp", &SamplerDesc::NEAREST_CLAMP)?,
            linear: Sampler::new(gpu, "linear clamp", &SamplerDesc::LINEAR_CLAMP)?,
        };
        let set = || layouts.allocate(SetIndex::Targets, "targets");
        let mut targets = Self {
            output: graph.imported("output"),
            hdr,
            depth,
            surface,
            ao,
            contact,
            visibility: visibility.transpose()?,
            drawn,
            shadow: shadow.transpose()?,
            samplers,
            sets: [set()?, set()?],
        };
        targets.write(layouts, graph)?;
        Ok(targets)
    }

    /// Whether what is drawn has several samples, and what is read one.
    pub fn is_resolved(&self) -> bool {
        self.drawn.depth != self.depth.current
    }

    /// Set 2 of frames of this parity.
    pub fn set(&self, parity: usize) -> &DescriptorSet {
        &self.sets[parity % 2]
    }

    /// What surfaces read where they are lit.
    pub fn add_lighting(&self, uses: &mut Uses, stage: Stage) {
        if let Some(shadow) = &self.shadow {
            uses.push(shadow.map, Usage::Sampled(stage));
        }
        for images in self.ao.iter() {
            uses.push(images.ao.current, Usage::Sampled(stage));
        }
        for mask in self.contact.iter() {
            uses.push(*mask, Usage::Sampled(stage));
        }
    }

    /// Makes set 2 anew, after images were replaced.
    ///
    /// # Errors
    /// Failures of Vulkan.
    pub fn write(&mut self, layouts: &Layouts, graph: &Graph) -> GpuResult<()> {
        for parity in 0..2 {
            let mut set = layouts.allocate(SetIndex::Targets, "targets")?;
            let nearest = &self.samplers.nearest;
            set.write_image(0, 0, graph.owned_at(self.hdr, parity), nearest);
            set.write_image(1, 0, graph.owned_at(self.depth.current, parity), nearest);
            if let Some(surface) = self.surface {
                set.write_image(2, 0, graph.owned_at(surface.normal, parity), nearest);
            }
            if let Some(images) = self.ao {
                set.write_image(3, 0, graph.owned_at(images.ao.current, parity), nearest);
            }
            if let Some(mask) = self.contact {
                set.write_image(4, 0, graph.owned_at(mask, parity), nearest);
            }
            if let Some(shadow) = &self.shadow {
                let map = graph.owned_at(shadow.map, parity);
                set.write_image(5, 0, map, &shadow.compare);
                set.write_image(6, 0, map, &shadow.depth);
            }
            self.sets[parity] = set;
        }
        Ok(())
    }
}

/// With one sample, depth is drawn and read in the same image.
fn depth_target(plan: &Plan) -> Target {
    let sampled = ImageUsageFlags::SAMPLED;
    if plan.samples > 1 {
        let usage = sampled | ImageUsageFlags::STORAGE;
        return Target::new("depth", RESOLVED_DEPTH_FORMAT, usage);
    }
    let usage = sampled | ImageUsageFlags::DEPTH_STENCIL_ATTACHMENT;
    Target::new("depth", DEPTH_FORMAT, usage)
}

fn add_ao(gpu: &Gpu, graph: &mut Graph, temporal: bool) -> GpuResult<AoImages> {
    let usage = ImageUsageFlags::SAMPLED | ImageUsageFlags::STORAGE | ImageUsageFlags::TRANSFER_SRC;
    let target = |name| Target::new(name, AO_FORMAT, usage);
    let spatial = temporal.then(|| graph.image(gpu, target("ao spatial")));
    Ok(AoImages {
        noisy: graph.image(gpu, target("ao noisy"))?,
        spatial: spatial.transpose()?,
        ao: graph.pair(gpu, target("ao"))?,
    })
}

fn add_surface(
    gpu: &Gpu,
    graph: &mut Graph,
    [normal, roughness]: [&'static str; 2],
    usage: ImageUsageFlags,
    samples: u32,
) -> GpuResult<Surface> {
    let mut add = |name, format| {
        let target = Target::new(name, format, usage);
        graph.image(gpu, Target { samples, ..target })
    };
    Ok(Surface {
        normal: add(normal, NORMAL_FORMAT)?,
        roughness: add(roughness, ROUGHNESS_FORMAT)?,
    })
}

fn add_shadow(gpu: &Gpu, graph: &mut Graph, map: ShadowMap) -> GpuResult<ShadowTarget> {
    let usage = ImageUsageFlags::SAMPLED | ImageUsageFlags::DEPTH_STENCIL_ATTACHMENT;
    let target = Target {
        extent: Some([map.resolution; 2]),
        layers: Some(map.cascades),
        ..Target::new("shadow map", DEPTH_FORMAT, usage)
    };
    Ok(ShadowTarget {
        map: graph.image(gpu, target)?,
        compare: Sampler::new(gpu, "shadow compare", &SamplerDesc::SHADOW_COMPARE)?,
        depth: Sampler::new(gpu, "shadow depth", &SamplerDesc::SHADOW_DEPTH)?,
    })
}

fn add_multisampled(
    gpu: &Gpu,
    graph: &mut Graph,
    plan: &Plan,
    resolved: Handle,
) -> GpuResult<Drawn> {
    let samples = plan.samples;
    let sampled = ImageUsageFlags::SAMPLED;
    let color = sampled | ImageUsageFlags::COLOR_ATTACHMENT;
    let depth = sampled | ImageUsageFlags::DEPTH_STENCIL_ATTACHMENT;
    let hdr = Target::new("hdr samples", HDR_FORMAT, color);
    let depth = Target::new("depth samples", DEPTH_FORMAT, depth);
    let names = ["normal samples", "roughness samples"];
    let surface =
        (plan.normals && !plan.compute).then(|| add_surface(gpu, graph, names, color, samples));
    // Shaded in compute, samples hold what is blended over the pixel: nothing, mostly.
    let layered = !plan.compute || plan.variant.blended;
    Ok(Drawn {
        surface: surface.transpose()?,
        hdr: match layered {
            true => graph.image(gpu, Target { samples, ..hdr })?,
            false => resolved,
        },
        depth: graph.image(gpu, Target { samples, ..depth })?,
    })
}
