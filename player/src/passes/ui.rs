//! The panel over the finished picture: egui's triangles through our own buffers.

use bytemuck::{Pod, Zeroable};
use cairn_format::TextureFormat;
use egui::epaint::{ImageData, Primitive};
use egui::{ClippedPrimitive, TextureId, TexturesDelta};

use super::fullscreen;
use crate::gpu::{
    Blend, Buffer, BufferDesc, ColorAttachment, ColorTarget, Commands, DescriptorSet,
    FRAMES_IN_FLIGHT, Gpu, GpuResult, GraphicsPipeline, GraphicsPipelineDesc, Image, ImageDesc,
    ImageRef, Layouts, Load, Memory, Sampler, SamplerDesc, SetIndex, Shader, Uploader, VertexInput,
    vk,
};

/// As in `ui.vert`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct PanelVertex {
    position: [f32; 2],
    uv: [f32; 2],
    color: [u8; 4],
}

/// Records that the buffers hold at first; they double where more are needed.
const FIRST_CAPACITY: usize = 16 * 1024;

/// The atlas of glyphs: its copy here takes patches, the image is replaced whole.
struct Atlas {
    size: [usize; 2],
    texels: Vec<[u8; 4]>,
    image: Image,
}

/// What the CPU writes while the GPU still reads the other slot.
struct Slot {
    vertices: Buffer,
    indices: Buffer,
    set: DescriptorSet,
}

/// Draws panels into images of one format.
pub struct Ui {
    gpu: Gpu,
    layouts: Layouts,
    pipeline: GraphicsPipeline,
    sampler: Sampler,
    atlas: Option<Atlas>,
    slots: Vec<Option<Slot>>,
    vertices: Vec<PanelVertex>,
    indices: Vec<u32>,
    draws: Vec<Draw>,
    points: [f32; 2],
}

/// Indices under one scissor.
struct Draw {
    /// Pixels: left, top, width, height.
    scissor: [u32; 4],
    first: u32,
    count: u32,
}

impl Ui {
    /// A pass that draws into sRGB targets of `format`.
    ///
    /// # Errors
    /// Failures of Vulkan.
    pub fn new(gpu: &Gpu, layouts: &Layouts, format: vk::Format) -> GpuResult<Self> {
        Ok(Self {
            pipeline: pipeline(gpu, layouts, format)?,
            sampler: Sampler::new(gpu, "panel", &SamplerDesc::LINEAR_CLAMP)?,
            gpu: gpu.clone(),
            layouts: layouts.clone(),
            atlas: None,
            slots: (0..FRAMES_IN_FLIGHT).map(|_| None).collect(),
            vertices: Vec::new(),
            indices: Vec::new(),
            draws: Vec::new(),
            points: [1.0; 2],
        })
    }

    /// Compiles the pipeline anew; where that fails, it stays as it is.
    ///
    /// # Errors
    /// Failures of Vulkan.
    #[cfg(feature = "hot-reload")]
    pub fn rebuild_pipeline(&mut self, format: vk::Format) -> GpuResult<()> {
        self.pipeline = pipeline(&self.gpu, &self.layouts, format)?;
        Ok(())
    }

    /// Takes a frame of egui: changes of the atlas are uploaded, triangles kept for [`Ui::record`]. `extent` is the
    /// target's, `scale` pixels per point.
    ///
    /// # Errors
    /// Failures of Vulkan.
    pub fn update(
        &mut self,
        slot: usize,
        mut changes: TexturesDelta,
        primitives: &[ClippedPrimitive],
        extent: [u32; 2],
        scale: f32,
    ) -> GpuResult<()> {
        let set = std::mem::take(&mut changes.set);
        changes.clear();
        // The panel has no pictures, so the atlas is the only texture.
        let atlas = set
            .into_iter()
            .filter(|(id, _)| *id == TextureId::default());
        for delta in atlas.flat_map(|(_, deltas)| deltas) {
            let ImageData::Color(image) = &delta.image;
            let texels: Vec<[u8; 4]> = image.pixels.iter().map(|texel| texel.to_array()).collect();
            self.change_atlas(delta.pos, image.size, &texels)?;
        }
        self.points = extent.map(|side| side as f32 / scale);
        self.collect(primitives, extent, scale);
        self.fill(slot)
    }

    fn change_atlas(
        &mut self,
        at: Option<[usize; 2]>,
        size: [usize; 2],
        texels: &[[u8; 4]],
    ) -> GpuResult<()> {
        let (whole, copy) = match (at, &self.atlas) {
            (Some([left, top]), Some(atlas)) => {
                let mut copy = atlas.texels.clone();
                for (row, texels) in texels.chunks_exact(size[0]).enumerate() {
                    let start = (top + row) * atlas.size[0] + left;
                    copy[start..start + size[0]].copy_from_slice(texels);
                }
                (atlas.size, copy)
            }
            _ => (size, texels.to_vec()),
        };
        let image = Image::new(
            &self.gpu,
            &ImageDesc {
                name: "panel atlas",
                format: vk::Format::R8G8B8A8_UNORM,
                extent: whole.map(|side| side as u32),
                levels: 1,
                layers: 1,
                cube: false,
                array: false,
                samples: 1,
                usage: vk::ImageUsageFlags::SAMPLED | vk::ImageUsageFlags::TRANSFER_DST,
            },
        )?;
        let mut uploader = Uploader::with_slot_bytes(&self.gpu, 1 << 20)?;
        let bytes: &[u8] = bytemuck::cast_slice(&copy);
        uploader.upload_image(&image, TextureFormat::Rgba8Unorm, [bytes])?;
        uploader.finish()?;
        self.atlas = Some(Atlas {
            size: whole,
            texels: copy,
            image,
        });
        // Their sets refer to the old image.
        self.slots.iter_mut().for_each(|slot| *slot = None);
        Ok(())
    }

    fn collect(&mut self, primitives: &[ClippedPrimitive], extent: [u32; 2], scale: f32) {
        self.vertices.clear();
        self.indices.clear();
        self.draws.clear();
        for clipped in primitives {
            let Primitive::Mesh(mesh) = &clipped.primitive else {
                continue;
            };
            let base = self.vertices.len() as u32;
            let clip = clipped.clip_rect;
            let pixel =
                |points: f32, most: u32| ((points * scale).round().max(0.0) as u32).min(most);
            let [left, right] = [clip.min.x, clip.max.x].map(|x| pixel(x, extent[0]));
            let [top, bottom] = [clip.min.y, clip.max.y].map(|y| pixel(y, extent[1]));
            if right <= left || bottom <= top {
                continue;
            }
            self.draws.push(Draw {
                scissor: [left, top, right - left, bottom - top],
                first: self.indices.len() as u32,
                count: mesh.indices.len() as u32,
            });
            self.indices
                .extend(mesh.indices.iter().map(|index| base + index));
            self.vertices
                .extend(mesh.vertices.iter().map(|vertex| PanelVertex {
                    position: vertex.pos.into(),
                    uv: vertex.uv.into(),
                    color: vertex.color.to_array(),
                }));
        }
    }

    /// Writes this slot's buffers, which the GPU has finished with.
    fn fill(&mut self, slot: usize) -> GpuResult<()> {
        let needed = self.vertices.len().max(self.indices.len());
        let room = self.slots[slot]
            .as_ref()
            .map_or(0, |slot| slot.indices.size() as usize / 4);
        if room < needed || room == 0 {
            self.slots[slot] = self.new_slot(needed.next_power_of_two().max(FIRST_CAPACITY))?;
        }
        if let Some(slot) = &mut self.slots[slot] {
            slot.vertices.write(0, &self.vertices)?;
            slot.indices.write(0, &self.indices)?;
        }
        Ok(())
    }

    fn new_slot(&self, capacity: usize) -> GpuResult<Option<Slot>> {
        let Some(atlas) = &self.atlas else {
            return Ok(None);
        };
        let buffer = |name, record: usize, usage| {
            let desc = BufferDesc {
                name,
                size: (capacity * record) as u64,
                usage,
                memory: Memory::Upload,
            };
            Buffer::new(&self.gpu, &desc)
        };
        let storage = vk::BufferUsageFlags::STORAGE_BUFFER;
        let vertices = buffer("panel vertices", size_of::<PanelVertex>(), storage)?;
        let mut set = self.layouts.allocate(SetIndex::Pass, "panel")?;
        set.write_image(4, 0, atlas.image.view(), &self.sampler);
        set.write_buffer(8, &vertices)?;
        Ok(Some(Slot {
            indices: buffer("panel indices", 4, vk::BufferUsageFlags::INDEX_BUFFER)?,
            vertices,
            set,
        }))
    }

    /// Draws what the last [`Ui::update`] took over `target`.
    pub fn record(&self, commands: &mut Commands, target: ImageRef<'_>) {
        let Some(slot) = &self.slots[commands.slot()] else {
            return;
        };
        let color = ColorAttachment {
            image: target,
            load: Load::Keep,
            store: true,
        };
        commands.begin_rendering(target.extent(), &[color], None);
        commands.bind_graphics(&self.pipeline);
        fullscreen(commands, target.extent(), false);
        commands.bind_sets(&self.layouts, vk::PipelineBindPoint::GRAPHICS, &[&slot.set]);
        commands.bind_index_buffer(&slot.indices);
        commands.push_constants(&self.layouts, &self.points.map(|points| 2.0 / points));
        for draw in &self.draws {
            commands.set_scissor_at(draw.scissor);
            commands.draw_indexed(draw.count, 1, draw.first, 0, 0);
        }
        commands.end_rendering();
    }
}

fn pipeline(gpu: &Gpu, layouts: &Layouts, format: vk::Format) -> GpuResult<GraphicsPipeline> {
    let shader = |spirv| Shader {
        spirv,
        constants: &[],
    };
    let desc = GraphicsPipelineDesc {
        name: "ui",
        vertex: shader(cairn_shaders::UI_VERT.spirv),
        fragment: Some(shader(cairn_shaders::UI_FRAG.spirv)),
        input: VertexInput::None,
        colors: &[ColorTarget {
            format,
            blend: Blend::Premultiplied,
        }],
        depth: None,
        samples: 1,
        depth_bias: false,
    };
    GraphicsPipeline::new(gpu, layouts, &desc)
}
