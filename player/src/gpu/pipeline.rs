//! Graphics and compute pipelines from SPIR-V.

use std::sync::Arc;

use ash::vk;
use cairn_format::Vertex;
use cairn_format::vertex::ATTRIBUTES;

use super::command::MAX_COLORS;
use super::descriptor::Layouts;
use super::device::{Gpu, Shared};
use super::error::{GpuError, GpuResult};
use super::queue::Garbage;

/// Location of the per-instance attribute: the index of the instance record.
const INSTANCE_LOCATION: u32 = 5;

/// A shader with entry point `main`.
#[derive(Clone, Copy)]
pub struct Shader<'a> {
    /// SPIR-V words.
    pub spirv: &'a [u32],
    /// Specialisation constants: id and the bits of the value.
    pub constants: &'a [(u32, u32)],
}

/// Where vertices come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VertexInput {
    /// The shader makes them.
    None,
    /// Binding 0: the package's vertices. Binding 1: one u32 per instance at location 5.
    Scene,
    /// As `Scene`, without normals and tangents.
    Positions,
}

/// Locations of positions and both texture coordinates.
const POSITION_LOCATIONS: [u32; 3] = [0, 2, 4];

/// How a fragment joins what the target holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Blend {
    /// Replaces it.
    None,
    /// `source * alpha + target * (1 - alpha)`.
    Alpha,
    /// `source + target * (1 - alpha)`.
    Premultiplied,
    /// `source + target`.
    Add,
}

/// A colour target of a pipeline.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ColorTarget {
    /// Format of the attachment.
    pub format: vk::Format,
    /// How fragments are blended.
    pub blend: Blend,
}

/// Depth test of a pipeline.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DepthState {
    /// Format of the attachment.
    pub format: vk::Format,
    /// When a fragment passes.
    pub compare: vk::CompareOp,
    /// Whether a fragment that passes writes its depth.
    pub write: bool,
}

/// What to create. Triangle lists; viewport, scissor, cull mode and front face are dynamic.
#[derive(Clone, Copy)]
pub struct GraphicsPipelineDesc<'a> {
    /// Name in messages and debuggers.
    pub name: &'a str,
    /// Vertex shader.
    pub vertex: Shader<'a>,
    /// Fragment shader; absent in depth-only passes.
    pub fragment: Option<Shader<'a>>,
    /// Vertex input.
    pub input: VertexInput,
    /// Colour targets, eight at most.
    pub colors: &'a [ColorTarget],
    /// Depth test; absent where the pass has no depth attachment.
    pub depth: Option<DepthState>,
    /// Samples per pixel of every attachment.
    pub samples: u32,
    /// Whether the depth bias is dynamic state, and depth is clamped to 0..=1 instead of clipped: shadow maps.
    pub depth_bias: bool,
}

/// A graphics pipeline.
pub struct GraphicsPipeline(Pipeline);

/// A compute pipeline.
pub struct ComputePipeline(Pipeline);

struct Pipeline {
    shared: Arc<Shared>,
    raw: vk::Pipeline,
    /// Keeps the pipeline layout alive.
    _layouts: Layouts,
}

impl Drop for Pipeline {
    fn drop(&mut self) {
        self.shared.discard(Garbage::Pipeline(self.raw));
    }
}

/// A shader module that lives while a pipeline is built.
pub(super) struct Module<'a> {
    shared: &'a Shared,
    raw: vk::ShaderModule,
}

impl<'a> Module<'a> {
    pub(super) fn new(shared: &'a Shared, spirv: &[u32]) -> GpuResult<Self> {
        #[cfg(feature = "hot-reload")]
        let replaced = cairn_shaders::reload::current(spirv);
        #[cfg(feature = "hot-reload")]
        let spirv = replaced.as_deref().unwrap_or(spirv);
        let info = vk::ShaderModuleCreateInfo::default().code(spirv);
        // SAFETY: the device is alive; the words are those that the shader compiler wrote.
        let raw = unsafe { shared.device.create_shader_module(&info, None) }
            .map_err(GpuError::of("vkCreateShaderModule"))?;
        Ok(Self { shared, raw })
    }

    pub(super) fn stage<'s>(
        &self,
        stage: vk::ShaderStageFlags,
        constants: &'s vk::SpecializationInfo<'s>,
    ) -> vk::PipelineShaderStageCreateInfo<'s> {
        vk::PipelineShaderStageCreateInfo::default()
            .stage(stage)
            .module(self.raw)
            .name(c"main")
            .specialization_info(constants)
    }
}

impl Drop for Module<'_> {
    fn drop(&mut self) {
        // SAFETY: a module may go once the pipeline is built.
        unsafe { self.shared.device.destroy_shader_module(self.raw, None) };
    }
}

/// Specialisation constants in Vulkan's form.
pub(super) struct Constants {
    entries: Vec<vk::SpecializationMapEntry>,
    values: Vec<u8>,
}

impl Constants {
    pub(super) fn new(constants: &[(u32, u32)]) -> Self {
        let entry = |(index, (id, _)): (u32, &(u32, u32))| vk::SpecializationMapEntry {
            constant_id: *id,
            offset: index * 4,
            size: 4,
        };
        Self {
            entries: (0..).zip(constants).map(entry).collect(),
            values: constants
                .iter()
                .flat_map(|(_, value)| value.to_ne_bytes())
                .collect(),
        }
    }

    pub(super) fn info(&self) -> vk::SpecializationInfo<'_> {
        vk::SpecializationInfo::default()
            .map_entries(&self.entries)
            .data(&self.values)
    }
}

impl GraphicsPipeline {
    /// Compiles a pipeline.
    pub fn new(gpu: &Gpu, layouts: &Layouts, desc: &GraphicsPipelineDesc<'_>) -> GpuResult<Self> {
        let shared = &gpu.shared;
        let vertex = Module::new(shared, desc.vertex.spirv)?;
        let fragment = desc.fragment.as_ref();
        let fragment_module = fragment
            .map(|shader| Module::new(shared, shader.spirv))
            .transpose()?;
        let constants = [
            Constants::new(desc.vertex.constants),
            Constants::new(fragment.map_or(&[], |shader| shader.constants)),
        ];
        let infos = [constants[0].info(), constants[1].info()];
        let mut stages = vec![vertex.stage(vk::ShaderStageFlags::VERTEX, &infos[0])];
        if let Some(module) = &fragment_module {
            stages.push(module.stage(vk::ShaderStageFlags::FRAGMENT, &infos[1]));
        }
        let raw = create_graphics(shared, layouts, desc, &stages)?;
        shared.set_name(raw, desc.name);
        Ok(Self(Pipeline {
            shared: shared.clone(),
            raw,
            _layouts: layouts.clone(),
        }))
    }

    pub(super) fn raw(&self) -> vk::Pipeline {
        self.0.raw
    }
}

impl ComputePipeline {
    /// Compiles a pipeline.
    pub fn new(gpu: &Gpu, layouts: &Layouts, name: &str, shader: &Shader<'_>) -> GpuResult<Self> {
        let shared = &gpu.shared;
        let module = Module::new(shared, shader.spirv)?;
        let constants = Constants::new(shader.constants);
        let constants = constants.info();
        let info = vk::ComputePipelineCreateInfo::default()
            .stage(module.stage(vk::ShaderStageFlags::COMPUTE, &constants))
            .layout(layouts.pipeline());
        // SAFETY: module, layout and cache are alive.
        let result = unsafe {
            let device = &shared.device;
            device.create_compute_pipelines(shared.pipeline_cache.raw, &[info], None)
        };
        let raw = first(result, "vkCreateComputePipelines")?;
        shared.set_name(raw, name);
        Ok(Self(Pipeline {
            shared: shared.clone(),
            raw,
            _layouts: layouts.clone(),
        }))
    }

    pub(super) fn raw(&self) -> vk::Pipeline {
        self.0.raw
    }
}

/// The only pipeline of a call that created one.
fn first(
    result: Result<Vec<vk::Pipeline>, (Vec<vk::Pipeline>, vk::Result)>,
    call: &'static str,
) -> GpuResult<vk::Pipeline> {
    let pipelines = result.map_err(|(_, result)| GpuError::of(call)(result))?;
    Ok(pipelines.first().copied().unwrap_or_default())
}

fn create_graphics(
    shared: &Shared,
    layouts: &Layouts,
    desc: &GraphicsPipelineDesc<'_>,
    stages: &[vk::PipelineShaderStageCreateInfo<'_>],
) -> GpuResult<vk::Pipeline> {
    let (bindings, attributes) = vertex_input(desc.input);
    let vertex_input = vk::PipelineVertexInputStateCreateInfo::default()
        .vertex_binding_descriptions(&bindings)
        .vertex_attribute_descriptions(&attributes);
    let assembly = vk::PipelineInputAssemblyStateCreateInfo::default()
        .topology(vk::PrimitiveTopology::TRIANGLE_LIST);
    let viewport = vk::PipelineViewportStateCreateInfo::default()
        .viewport_count(1)
        .scissor_count(1);
    let raster = vk::PipelineRasterizationStateCreateInfo::default()
        .polygon_mode(vk::PolygonMode::FILL)
        .depth_bias_enable(desc.depth_bias)
        .depth_clamp_enable(desc.depth_bias)
        .line_width(1.0);
    let samples = vk::PipelineMultisampleStateCreateInfo::default()
        .rasterization_samples(vk::SampleCountFlags::from_raw(desc.samples));
    let depth = depth_state(desc.depth);
    let mut blends = [vk::PipelineColorBlendAttachmentState::default(); MAX_COLORS];
    let mut formats = [vk::Format::UNDEFINED; MAX_COLORS];
    let count = desc.colors.len();
    for (index, color) in desc.colors.iter().enumerate() {
        blends[index] = blend_state(color.blend);
        formats[index] = color.format;
    }
    let blend = vk::PipelineColorBlendStateCreateInfo::default().attachments(&blends[..count]);
    let dynamic = [
        vk::DynamicState::VIEWPORT,
        vk::DynamicState::SCISSOR,
        vk::DynamicState::CULL_MODE,
        vk::DynamicState::FRONT_FACE,
        vk::DynamicState::DEPTH_BIAS,
    ];
    let states = dynamic.len() - usize::from(!desc.depth_bias);
    let dynamic = vk::PipelineDynamicStateCreateInfo::default().dynamic_states(&dynamic[..states]);
    let depth_format = desc
        .depth
        .map_or(vk::Format::UNDEFINED, |depth| depth.format);
    let mut rendering = vk::PipelineRenderingCreateInfo::default()
        .color_attachment_formats(&formats[..count])
        .depth_attachment_format(depth_format);
    let info = vk::GraphicsPipelineCreateInfo::default()
        .stages(stages)
        .vertex_input_state(&vertex_input)
        .input_assembly_state(&assembly)
        .viewport_state(&viewport)
        .rasterization_state(&raster)
        .multisample_state(&samples)
        .depth_stencil_state(&depth)
        .color_blend_state(&blend)
        .dynamic_state(&dynamic)
        .layout(layouts.pipeline())
        .push_next(&mut rendering);
    // SAFETY: modules, layout and cache are alive, and `info` points to locals of this function.
    let result = unsafe {
        let device = &shared.device;
        device.create_graphics_pipelines(shared.pipeline_cache.raw, &[info], None)
    };
    first(result, "vkCreateGraphicsPipelines")
}

type Input = (
    Vec<vk::VertexInputBindingDescription>,
    Vec<vk::VertexInputAttributeDescription>,
);

fn vertex_input(input: VertexInput) -> Input {
    if input == VertexInput::None {
        return (Vec::new(), Vec::new());
    }
    let bindings = vec![
        vk::VertexInputBindingDescription {
            binding: 0,
            stride: size_of::<Vertex>() as u32,
            input_rate: vk::VertexInputRate::VERTEX,
        },
        vk::VertexInputBindingDescription {
            binding: 1,
            stride: size_of::<u32>() as u32,
            input_rate: vk::VertexInputRate::INSTANCE,
        },
    ];
    let read =
        |location: &u32| input == VertexInput::Scene || POSITION_LOCATIONS.contains(location);
    let mut attributes: Vec<_> = ATTRIBUTES
        .iter()
        .filter(|attribute| read(&attribute.location))
        .map(|attribute| vk::VertexInputAttributeDescription {
            location: attribute.location,
            binding: 0,
            format: match attribute.components {
                1 => vk::Format::R32_SFLOAT,
                2 => vk::Format::R32G32_SFLOAT,
                3 => vk::Format::R32G32B32_SFLOAT,
                _ => vk::Format::R32G32B32A32_SFLOAT,
            },
            offset: attribute.offset,
        })
        .collect();
    attributes.push(vk::VertexInputAttributeDescription {
        location: INSTANCE_LOCATION,
        binding: 1,
        format: vk::Format::R32_UINT,
        offset: 0,
    });
    (bindings, attributes)
}

fn depth_state(depth: Option<DepthState>) -> vk::PipelineDepthStencilStateCreateInfo<'static> {
    let info = vk::PipelineDepthStencilStateCreateInfo::default();
    match depth {
        Some(depth) => info
            .depth_test_enable(true)
            .depth_write_enable(depth.write)
            .depth_compare_op(depth.compare),
        None => info,
    }
}

fn blend_state(blend: Blend) -> vk::PipelineColorBlendAttachmentState {
    let source = match blend {
        Blend::Alpha => vk::BlendFactor::SRC_ALPHA,
        Blend::None | Blend::Premultiplied | Blend::Add => vk::BlendFactor::ONE,
    };
    let target = match blend {
        Blend::Add => vk::BlendFactor::ONE,
        _ => vk::BlendFactor::ONE_MINUS_SRC_ALPHA,
    };
    vk::PipelineColorBlendAttachmentState::default()
        .blend_enable(blend != Blend::None)
        .src_color_blend_factor(source)
        .dst_color_blend_factor(target)
        .color_blend_op(vk::BlendOp::ADD)
        .src_alpha_blend_factor(vk::BlendFactor::ONE)
        .dst_alpha_blend_factor(vk::BlendFactor::ONE_MINUS_SRC_ALPHA)
        .alpha_blend_op(vk::BlendOp::ADD)
        .color_write_mask(vk::ColorComponentFlags::RGBA)
}
