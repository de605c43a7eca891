//! Descriptor set layouts 0 (frame), 1 (bindless textures), 2 (render targets) and 3 (one pass's own), and the sets
//! made from them.

use std::sync::Arc;

use ash::vk;

use super::accel::TopLevel;
use super::buffer::Buffer;
use super::device::{Gpu, Shared};
use super::error::{GpuError, GpuResult};
use super::image::{ImageRef, Sampler};
use super::queue::Garbage;

/// Sets of a pipeline layout.
pub(super) const SET_COUNT: usize = 4;
/// Bytes of push constants: what every Vulkan device has.
pub(super) const PUSH_CONSTANT_BYTES: u32 = 128;
/// Stages that see sets and push constants.
fn stages(tracing: bool) -> vk::ShaderStageFlags {
    let stages = vk::ShaderStageFlags::VERTEX
        | vk::ShaderStageFlags::FRAGMENT
        | vk::ShaderStageFlags::COMPUTE;
    if tracing {
        stages | vk::ShaderStageFlags::RAYGEN_KHR | vk::ShaderStageFlags::ANY_HIT_KHR
    } else {
        stages
    }
}

/// What shapes the set layouts.
#[derive(Clone, Copy)]
struct Shape {
    /// Lengths of the two arrays of set 1.
    bindless: [u32; 2],
    /// Whether the device traces rays.
    tracing: bool,
}

/// The sets of every pipeline.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SetIndex {
    /// b0 global uniform, b1 directional lights, b2 materials, b3 instances; where the device traces rays, b4
    /// the top-level acceleration structure; where the package has them, b5 geometry
    /// table, b6 environment table, b7 emissive triangles, b8 their table, b9 texture transforms, b10 vertex colours,
    /// b11 punctual lights, b12 material extensions, b13 vertices, b14 indices,
    /// b15 draw groups.
    Frame = 0,
    /// b0 2D textures, b1 cubes.
    Bindless = 1,
    /// b0 HDR colour, b1 depth, b2 normal, b3 ambient occlusion, b4 contact mask, b5 shadow map with comparison, b6 the
    /// same without.
    Targets = 2,
    /// What one compute or ray-tracing pass reads and writes: b0..=b3 storage images, b4..=b7 sampled images,
    /// b8..=b9 storage buffers.
    Pass = 3,
}

impl SetIndex {
    const ALL: [Self; SET_COUNT] = [Self::Frame, Self::Bindless, Self::Targets, Self::Pass];
}

/// The set layouts of one package, and the pipeline layout of them all.
#[derive(Clone)]
pub struct Layouts(Arc<LayoutObjects>);

struct LayoutObjects {
    shared: Arc<Shared>,
    sets: [vk::DescriptorSetLayout; SET_COUNT],
    pipeline: vk::PipelineLayout,
    shape: Shape,
}

/// A descriptor set with a pool of its own.
pub struct DescriptorSet {
    shared: Arc<Shared>,
    /// Keeps the layout alive.
    layouts: Layouts,
    pool: vk::DescriptorPool,
    raw: vk::DescriptorSet,
    index: SetIndex,
}

/// One binding of a set layout.
#[derive(Clone, Copy)]
struct Binding {
    number: u32,
    ty: vk::DescriptorType,
    /// Array length.
    length: u32,
    /// Whether elements may stay empty, because no shader reads what a package does not have.
    partial: bool,
}

/// Bindings of set 0 that hold a storage buffer where the package has the section.
const OPTIONAL_BUFFERS: [u32; 11] = [5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];

/// The bindings of a set, in ascending order.
fn bindings(index: SetIndex, shape: Shape) -> Vec<Binding> {
    let binding = |number, ty, length, partial| Binding {
        number,
        ty,
        length,
        partial,
    };
    let storage = vk::DescriptorType::STORAGE_BUFFER;
    let texture = vk::DescriptorType::COMBINED_IMAGE_SAMPLER;
    match index {
        SetIndex::Frame => {
            let uniform = binding(0, vk::DescriptorType::UNIFORM_BUFFER, 1, false);
            let always = (1..=3).map(|number| binding(number, storage, 1, false));
            let structure = vk::DescriptorType::ACCELERATION_STRUCTURE_KHR;
            let structure = shape.tracing.then(|| binding(4, structure, 1, true));
            let optional = OPTIONAL_BUFFERS.map(|number| binding(number, storage, 1, true));
            [uniform]
                .into_iter()
                .chain(always)
                .chain(structure)
                .chain(optional)
                .collect()
        }
        SetIndex::Bindless => (0..)
            .zip(shape.bindless)
            .map(|(number, length)| binding(number, texture, length, true))
            .collect(),
        SetIndex::Targets => (0..=6)
            .map(|number| binding(number, texture, 1, true))
            .collect(),
        SetIndex::Pass => {
            let image = vk::DescriptorType::STORAGE_IMAGE;
            let images = (0..=3).map(|number| binding(number, image, 1, true));
            let textures = (4..=7).map(|number| binding(number, texture, 1, true));
            let buffers = (8..=9).map(|number| binding(number, storage, 1, true));
            images.chain(textures).chain(buffers).collect()
        }
    }
}

impl Layouts {
    /// Layouts for a package with this many 2D textures and cubes; each array has at least one element.
    ///
    /// # Errors
    /// `Limit` where the device cannot bind as many.
    pub fn new(gpu: &Gpu, textures: u32, cubes: u32) -> GpuResult<Self> {
        let shared = &gpu.shared;
        let shape = Shape {
            bindless: [textures.max(1), cubes.max(1)],
            tracing: gpu.traces_rays(),
        };
        check_limits(shared, shape)?;
        // Built in place, so that an error half way drops what exists.
        let mut objects = LayoutObjects {
            shared: shared.clone(),
            sets: [vk::DescriptorSetLayout::null(); SET_COUNT],
            pipeline: vk::PipelineLayout::null(),
            shape,
        };
        for index in SetIndex::ALL {
            objects.sets[index as usize] = create_set_layout(shared, index, shape)?;
        }
        let ranges = [vk::PushConstantRange {
            stage_flags: stages(shape.tracing),
            offset: 0,
            size: PUSH_CONSTANT_BYTES,
        }];
        let info = vk::PipelineLayoutCreateInfo::default()
            .set_layouts(&objects.sets)
            .push_constant_ranges(&ranges);
        // SAFETY: the device and the set layouts are alive.
        objects.pipeline = unsafe { shared.device.create_pipeline_layout(&info, None) }
            .map_err(GpuError::of("vkCreatePipelineLayout"))?;
        Ok(Self(Arc::new(objects)))
    }

    /// Stages that see push constants.
    pub(super) fn stages(&self) -> vk::ShaderStageFlags {
        stages(self.0.shape.tracing)
    }

    pub(super) fn pipeline(&self) -> vk::PipelineLayout {
        self.0.pipeline
    }

    /// Makes a set; its bindings are empty.
    pub fn allocate(&self, index: SetIndex, name: &str) -> GpuResult<DescriptorSet> {
        let shared = &self.0.shared;
        let sizes: Vec<vk::DescriptorPoolSize> = bindings(index, self.0.shape)
            .iter()
            .map(|binding| vk::DescriptorPoolSize {
                ty: binding.ty,
                descriptor_count: binding.length,
            })
            .collect();
        let info = vk::DescriptorPoolCreateInfo::default()
            .max_sets(1)
            .pool_sizes(&sizes);
        // SAFETY: the device is alive.
        let pool = unsafe { shared.device.create_descriptor_pool(&info, None) }
            .map_err(GpuError::of("vkCreateDescriptorPool"))?;
        let mut set = DescriptorSet {
            shared: shared.clone(),
            layouts: self.clone(),
            pool,
            raw: vk::DescriptorSet::null(),
            index,
        };
        let layouts = [self.0.sets[index as usize]];
        let info = vk::DescriptorSetAllocateInfo::default()
            .descriptor_pool(pool)
            .set_layouts(&layouts);
        // SAFETY: the pool has room for exactly this set.
        let sets = unsafe { shared.device.allocate_descriptor_sets(&info) }
            .map_err(GpuError::of("vkAllocateDescriptorSets"))?;
        set.raw = sets.first().copied().unwrap_or_default();
        shared.set_name(set.raw, name);
        Ok(set)
    }
}

impl Drop for LayoutObjects {
    fn drop(&mut self) {
        self.shared
            .discard(Garbage::Layouts(self.pipeline, self.sets));
    }
}

impl DescriptorSet {
    pub(super) fn raw(&self) -> vk::DescriptorSet {
        self.raw
    }

    pub(super) fn index(&self) -> SetIndex {
        self.index
    }

    /// Whether shaders may see the whole of a storage buffer.
    pub fn takes(&self, buffer: &Buffer) -> bool {
        buffer.size() <= u64::from(self.shared.limits.max_storage_buffer_range)
    }

    /// Binds a whole buffer.
    ///
    /// # Errors
    /// `Limit` where it is larger than a shader may see.
    pub fn write_buffer(&mut self, binding: u32, buffer: &Buffer) -> GpuResult<()> {
        let ty = self.binding(binding).ty;
        let limits = &self.shared.limits;
        let limit = match ty {
            vk::DescriptorType::UNIFORM_BUFFER => limits.max_uniform_buffer_range,
            _ => limits.max_storage_buffer_range,
        };
        if buffer.size() > u64::from(limit) {
            return Err(GpuError::Limit {
                what: format!("the buffer of set {}, binding {binding}", self.index as u32),
                needed: buffer.size(),
                limit: u64::from(limit),
                device: self.shared.name.clone(),
            });
        }
        let infos = [vk::DescriptorBufferInfo {
            buffer: buffer.raw,
            offset: 0,
            range: vk::WHOLE_SIZE,
        }];
        let write = self.write(binding, 0).buffer_info(&infos);
        // SAFETY: `&mut self` and the caller's care keep the set out of use; the buffer is alive.
        unsafe { self.shared.device.update_descriptor_sets(&[write], &[]) };
        Ok(())
    }

    /// Binds an image in `SHADER_READ_ONLY_OPTIMAL` at an array element.
    pub fn write_image(
        &mut self,
        binding: u32,
        element: u32,
        image: ImageRef<'_>,
        sampler: &Sampler,
    ) {
        let length = self.binding(binding).length;
        assert!(element < length, "element {element} of {length}");
        let infos = [vk::DescriptorImageInfo {
            sampler: sampler.raw,
            image_view: image.view,
            image_layout: vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL,
        }];
        let write = self.write(binding, element).image_info(&infos);
        // SAFETY: `&mut self` and the caller's care keep the set out of use; image and sampler are alive.
        unsafe { self.shared.device.update_descriptor_sets(&[write], &[]) };
    }

    /// Binds the top-level acceleration structure.
    pub fn write_structure(&mut self, binding: u32, structure: &TopLevel) {
        let structures = [structure.raw()];
        let mut info = vk::WriteDescriptorSetAccelerationStructureKHR::default()
            .acceleration_structures(&structures);
        let write = self.write(binding, 0).push_next(&mut info);
        // SAFETY: `&mut self` and the caller's care keep the set out of use; the structure is alive.
        unsafe { self.shared.device.update_descriptor_sets(&[write], &[]) };
    }

    /// Binds an image in `GENERAL` that shaders load from and store to.
    pub fn write_storage_image(&mut self, binding: u32, image: ImageRef<'_>) {
        let infos = [vk::DescriptorImageInfo {
            sampler: vk::Sampler::null(),
            image_view: image.view,
            image_layout: vk::ImageLayout::GENERAL,
        }];
        let write = self.write(binding, 0).image_info(&infos);
        // SAFETY: `&mut self` and the caller's care keep the set out of use; the image is alive.
        unsafe { self.shared.device.update_descriptor_sets(&[write], &[]) };
    }

    /// # Panics
    /// Where the set has no such binding.
    fn binding(&self, number: u32) -> Binding {
        let bindings = bindings(self.index, self.layouts.0.shape);
        let found = bindings.iter().find(|binding| binding.number == number);
        *found.unwrap_or_else(|| panic!("{:?} has no binding {number}", self.index))
    }

    fn write<'a>(&self, binding: u32, element: u32) -> vk::WriteDescriptorSet<'a> {
        vk::WriteDescriptorSet::default()
            .dst_set(self.raw)
            .dst_binding(binding)
            .dst_array_element(element)
            .descriptor_type(self.binding(binding).ty)
            .descriptor_count(1)
    }
}

impl Drop for DescriptorSet {
    fn drop(&mut self) {
        self.shared.discard(Garbage::DescriptorPool(self.pool));
    }
}

fn check_limits(shared: &Shared, shape: Shape) -> GpuResult<()> {
    let limits = &shared.limits;
    let fixed = |index| bindings(index, shape).len() as u64;
    let buffers = fixed(SetIndex::Frame);
    let needed = u64::from(shape.bindless[0])
        + u64::from(shape.bindless[1])
        + buffers
        + fixed(SetIndex::Targets)
        + fixed(SetIndex::Pass);
    let textures = [
        limits.max_per_stage_descriptor_sampled_images,
        limits.max_per_stage_descriptor_samplers,
        limits.max_descriptor_set_sampled_images,
        limits.max_descriptor_set_samplers,
        limits.max_per_stage_resources,
    ];
    let storage = [
        limits.max_per_stage_descriptor_storage_buffers,
        limits.max_descriptor_set_storage_buffers,
    ];
    let check = |what: &str, needed: u64, limits: &[u32]| {
        let limit = u64::from(limits.iter().copied().min().unwrap_or(0));
        if needed <= limit {
            return Ok(());
        }
        Err(GpuError::Limit {
            what: what.into(),
            needed,
            limit,
            device: shared.name.clone(),
        })
    };
    check("the number of storage buffers", buffers - 1, &storage)?;
    check("the number of textures and buffers", needed, &textures)
}

fn create_set_layout(
    shared: &Shared,
    index: SetIndex,
    shape: Shape,
) -> GpuResult<vk::DescriptorSetLayout> {
    let info = |binding: &Binding| {
        vk::DescriptorSetLayoutBinding::default()
            .binding(binding.number)
            .descriptor_type(binding.ty)
            .descriptor_count(binding.length)
            .stage_flags(stages(shape.tracing))
    };
    let flag = |binding: &Binding| match binding.partial {
        true => vk::DescriptorBindingFlags::PARTIALLY_BOUND,
        false => vk::DescriptorBindingFlags::empty(),
    };
    let bindings = bindings(index, shape);
    let infos: Vec<_> = bindings.iter().map(info).collect();
    let flags: Vec<_> = bindings.iter().map(flag).collect();
    let mut flags = vk::DescriptorSetLayoutBindingFlagsCreateInfo::default().binding_flags(&flags);
    let info = vk::DescriptorSetLayoutCreateInfo::default()
        .bindings(&infos)
        .push_next(&mut flags);
    // SAFETY: the device is alive and has partially bound descriptors enabled.
    unsafe { shared.device.create_descriptor_set_layout(&info, None) }
        .map_err(GpuError::of("vkCreateDescriptorSetLayout"))
}
