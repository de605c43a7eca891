//! Acceleration structures: bottom levels built in batches and compacted, one top level.

use std::sync::Arc;

use ash::vk;

use super::buffer::{Buffer, BufferDesc, Memory};
use super::command::Sync;
use super::device::{Gpu, Shared};
use super::error::{GpuError, GpuResult};
use super::queue::Garbage;

/// Scratch memory of one batch of builds; a structure that needs more gets a batch and as much as it needs.
const SCRATCH_BYTES: u64 = 64 << 20;
/// Alignment of a structure in its buffer (Vulkan specification, `VkAccelerationStructureCreateInfoKHR`).
const STRUCTURE_ALIGNMENT: u64 = 256;

/// Bytes per vertex.
const VERTEX_STRIDE: u64 = size_of::<cairn_format::Vertex>() as u64;

/// A triangle list of a bottom level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TraceGeometry {
    /// Device address of its first vertex.
    pub vertices: vk::DeviceAddress,
    /// Vertices.
    pub vertex_count: u32,
    /// Device address of its first index.
    pub indices: vk::DeviceAddress,
    /// Triangles.
    pub triangle_count: u32,
    /// Whether every ray that hits it stops; otherwise any-hit decides, once for each hit.
    pub opaque: bool,
    /// Device address of a `VkTransformMatrixKHR` that places it in its structure; absent where it stands as it is.
    pub transform: Option<vk::DeviceAddress>,
}

/// A placed bottom level.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TraceInstance {
    /// Rows of the object-to-world matrix; a negative determinant is fine.
    pub transform: [[f32; 4]; 3],
    /// Index of the bottom level.
    pub bottom: u32,
    /// `gl_InstanceCustomIndexEXT`, 24 bits.
    pub custom_index: u32,
}

/// What the builds cost.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct BuildStats {
    /// Bottom levels.
    pub bottom_levels: u32,
    /// Top-level instances.
    pub instances: u32,
    /// Triangles of the bottom levels.
    pub triangles: u64,
    /// Bytes of the bottom levels as built.
    pub built_bytes: u64,
    /// Bytes of the bottom levels compacted, and of the top level.
    pub kept_bytes: u64,
    /// Largest scratch memory in use.
    pub scratch_bytes: u64,
    /// From the first build to the end of the last.
    pub seconds: f64,
}

/// Structures that share one buffer.
struct Pool {
    shared: Arc<Shared>,
    structures: Vec<vk::AccelerationStructureKHR>,
    /// Taken when dropped, behind the structures.
    buffer: Option<Buffer>,
}

impl Drop for Pool {
    fn drop(&mut self) {
        for structure in self.structures.drain(..) {
            self.shared.discard(Garbage::Structure(structure));
        }
        self.buffer.take();
    }
}

/// All acceleration structures of a scene.
pub struct TopLevel {
    top: Pool,
    _bottom: Vec<Pool>,
    /// What building them cost.
    pub stats: BuildStats,
}

impl TopLevel {
    /// Builds one bottom level for each list of geometries, then the top level.
    ///
    /// # Errors
    /// `Limit` above what the device allows, `OutOfMemory`.
    ///
    /// # Panics
    /// Where the device cannot trace rays, or an instance names a bottom level that is not there.
    pub fn build(
        gpu: &Gpu,
        meshes: &[Vec<TraceGeometry>],
        instances: &[TraceInstance],
    ) -> GpuResult<Self> {
        let start = std::time::Instant::now();
        let mut builder = Builder {
            gpu,
            shared: gpu.shared.clone(),
            stats: BuildStats::default(),
        };
        builder.check_limits(meshes, instances)?;
        let bottom = builder.bottom_levels(meshes)?;
        let addresses: Vec<vk::DeviceAddress> = bottom
            .iter()
            .flat_map(|pool| pool.structures.iter())
            .map(|structure| builder.address(*structure))
            .collect();
        let top = builder.top_level(instances, &addresses)?;
        let mut stats = builder.stats;
        stats.seconds = start.elapsed().as_secs_f64();
        Ok(Self {
            top,
            _bottom: bottom,
            stats,
        })
    }

    pub(super) fn raw(&self) -> vk::AccelerationStructureKHR {
        self.top.structures[0]
    }
}

/// Sizes and input of one build.
struct Plan<'a> {
    geometries: Vec<vk::AccelerationStructureGeometryKHR<'a>>,
    ranges: Vec<vk::AccelerationStructureBuildRangeInfoKHR>,
    size: u64,
    scratch: u64,
}

struct Builder<'a> {
    gpu: &'a Gpu,
    shared: Arc<Shared>,
    stats: BuildStats,
}

impl Builder<'_> {
    fn extension(&self) -> &ash::khr::acceleration_structure::Device {
        &self.shared.ray_tracing().structures
    }

    fn check_limits(
        &self,
        meshes: &[Vec<TraceGeometry>],
        instances: &[TraceInstance],
    ) -> GpuResult<()> {
        let limits = &self.shared.ray_tracing().limits;
        let geometries = meshes.iter().map(Vec::len).max().unwrap_or(0) as u64;
        let triangles = |mesh: &Vec<TraceGeometry>| -> u64 {
            let counts = mesh
                .iter()
                .map(|geometry| u64::from(geometry.triangle_count));
            counts.sum()
        };
        let triangles = meshes.iter().map(triangles).max().unwrap_or(0);
        let rows = [
            ("geometries of a mesh", geometries, limits.max_geometries),
            ("triangles of a mesh", triangles, limits.max_primitives),
            (
                "top-level instances",
                instances.len() as u64,
                limits.max_instances,
            ),
        ];
        match rows.iter().find(|(_, needed, limit)| needed > limit) {
            Some((what, needed, limit)) => Err(GpuError::Limit {
                what: format!("the number of {what}"),
                needed: *needed,
                limit: *limit,
                device: self.shared.name.clone(),
            }),
            None => Ok(()),
        }
    }

    /// Batches of builds whose scratch memory fits, each compacted before the next.
    fn bottom_levels(&mut self, meshes: &[Vec<TraceGeometry>]) -> GpuResult<Vec<Pool>> {
        let plans: Vec<Plan> = meshes.iter().map(|mesh| self.plan_mesh(mesh)).collect();
        let mut pools = Vec::new();
        let mut first = 0;
        while first < plans.len() {
            let mut scratch = 0;
            let mut end = first;
            while end < plans.len() {
                let with = scratch + self.scratch_aligned(plans[end].scratch);
                if with > SCRATCH_BYTES && end > first {
                    break;
                }
                scratch = with;
                end += 1;
            }
            let batch = &plans[first..end];
            let built = self.build(batch, vk::AccelerationStructureTypeKHR::BOTTOM_LEVEL)?;
            pools.push(self.compact(&built)?);
            first = end;
        }
        self.stats.bottom_levels = meshes.len() as u32;
        Ok(pools)
    }

    fn top_level(
        &mut self,
        instances: &[TraceInstance],
        addresses: &[vk::DeviceAddress],
    ) -> GpuResult<Pool> {
        let records: Vec<InstanceRecord> = instances
            .iter()
            .map(|instance| InstanceRecord {
                transform: instance.transform,
                custom_index_and_mask: (instance.custom_index & 0x00ff_ffff) | 0xff00_0000,
                offset_and_flags: 0,
                reference: addresses[instance.bottom as usize],
            })
            .collect();
        let size = size_of::<InstanceRecord>() as u64;
        let mut buffer = Buffer::new(
            self.gpu,
            &BufferDesc {
                name: "top-level instances",
                size: (records.len() as u64 * size).max(size),
                usage: BUILD_INPUT | vk::BufferUsageFlags::SHADER_DEVICE_ADDRESS,
                memory: Memory::Upload,
            },
        )?;
        buffer.write(0, &records)?;
        let data = vk::AccelerationStructureGeometryInstancesDataKHR::default().data(
            vk::DeviceOrHostAddressConstKHR {
                device_address: buffer.device_address(),
            },
        );
        let geometry = vk::AccelerationStructureGeometryKHR::default()
            .geometry_type(vk::GeometryTypeKHR::INSTANCES)
            .geometry(vk::AccelerationStructureGeometryDataKHR { instances: data });
        let kind = vk::AccelerationStructureTypeKHR::TOP_LEVEL;
        let plan = self.plan(vec![geometry], &[records.len() as u32], kind);
        self.stats.instances = records.len() as u32;
        self.stats.kept_bytes += plan.size;
        self.build(&[plan], kind)
    }

    fn plan_mesh(&mut self, mesh: &[TraceGeometry]) -> Plan<'static> {
        let counts: Vec<u32> = mesh
            .iter()
            .map(|geometry| geometry.triangle_count)
            .collect();
        self.stats.triangles += counts.iter().map(|count| u64::from(*count)).sum::<u64>();
        let geometries = mesh.iter().map(triangles).collect();
        self.plan(
            geometries,
            &counts,
            vk::AccelerationStructureTypeKHR::BOTTOM_LEVEL,
        )
    }

    fn plan<'g>(
        &self,
        geometries: Vec<vk::AccelerationStructureGeometryKHR<'g>>,
        counts: &[u32],
        kind: vk::AccelerationStructureTypeKHR,
    ) -> Plan<'g> {
        let mut sizes = vk::AccelerationStructureBuildSizesInfoKHR::default();
        let info = build_info(&geometries, kind);
        // SAFETY: one count for each geometry; addresses are not followed by this query.
        unsafe {
            self.extension().get_acceleration_structure_build_sizes(
                vk::AccelerationStructureBuildTypeKHR::DEVICE,
                &info,
                counts,
                &mut sizes,
            );
        }
        let range = |count: &u32| vk::AccelerationStructureBuildRangeInfoKHR {
            primitive_count: *count,
            ..Default::default()
        };
        Plan {
            ranges: counts.iter().map(range).collect(),
            geometries,
            size: sizes.acceleration_structure_size,
            scratch: sizes.build_scratch_size,
        }
    }

    fn scratch_aligned(&self, bytes: u64) -> u64 {
        bytes.next_multiple_of(self.shared.ray_tracing().limits.scratch_alignment)
    }

    /// Builds all plans in one command, each with its own part of the scratch memory, and waits.
    fn build(&mut self, plans: &[Plan], kind: vk::AccelerationStructureTypeKHR) -> GpuResult<Pool> {
        let sizes: Vec<u64> = plans.iter().map(|plan| plan.size).collect();
        let pool = self.pool(&sizes, kind)?;
        let alignment = self.shared.ray_tracing().limits.scratch_alignment;
        let mut offsets = Vec::with_capacity(plans.len());
        let mut total = 0;
        for plan in plans {
            offsets.push(total);
            total += self.scratch_aligned(plan.scratch);
        }
        self.stats.scratch_bytes = self.stats.scratch_bytes.max(total);
        // Room to align the base address, which the allocator aligns less.
        let scratch = Buffer::new(
            self.gpu,
            &BufferDesc {
                name: "build scratch",
                size: total + alignment,
                usage: vk::BufferUsageFlags::STORAGE_BUFFER
                    | vk::BufferUsageFlags::SHADER_DEVICE_ADDRESS,
                memory: Memory::Device,
            },
        )?;
        let base = scratch.device_address().next_multiple_of(alignment);
        let infos: Vec<_> = plans
            .iter()
            .zip(&offsets)
            .zip(&pool.structures)
            .map(|((plan, offset), structure)| {
                build_info(&plan.geometries, kind)
                    .dst_acceleration_structure(*structure)
                    .scratch_data(vk::DeviceOrHostAddressKHR {
                        device_address: base + offset,
                    })
            })
            .collect();
        let ranges: Vec<&[vk::AccelerationStructureBuildRangeInfoKHR]> =
            plans.iter().map(|plan| plan.ranges.as_slice()).collect();
        self.gpu.once(|commands| {
            // SAFETY: the command buffer is recording; inputs, structures and disjoint scratch ranges are alive until
            // the submission has finished, for which `once` waits.
            unsafe {
                self.extension()
                    .cmd_build_acceleration_structures(commands.raw, &infos, &ranges);
            }
            commands.memory_barrier(BUILD, READ_STRUCTURES);
            Ok(())
        })?;
        Ok(pool)
    }

    /// Copies structures to as little memory as they need.
    fn compact(&mut self, built: &Pool) -> GpuResult<Pool> {
        let sizes = self.compacted_sizes(&built.structures)?;
        self.stats.built_bytes += built.buffer.as_ref().map_or(0, Buffer::size);
        self.stats.kept_bytes += sizes.iter().sum::<u64>();
        let kind = vk::AccelerationStructureTypeKHR::BOTTOM_LEVEL;
        let small = self.pool(&sizes, kind)?;
        self.gpu.once(|commands| {
            for (from, to) in built.structures.iter().zip(&small.structures) {
                let info = vk::CopyAccelerationStructureInfoKHR::default()
                    .src(*from)
                    .dst(*to)
                    .mode(vk::CopyAccelerationStructureModeKHR::COMPACT);
                // SAFETY: the command buffer is recording; the target has the compacted size that was queried.
                unsafe {
                    self.extension()
                        .cmd_copy_acceleration_structure(commands.raw, &info);
                }
            }
            commands.memory_barrier(BUILD, READ_STRUCTURES);
            Ok(())
        })?;
        Ok(small)
    }

    fn compacted_sizes(&self, structures: &[vk::AccelerationStructureKHR]) -> GpuResult<Vec<u64>> {
        let kind = vk::QueryType::ACCELERATION_STRUCTURE_COMPACTED_SIZE_KHR;
        let count = structures.len() as u32;
        let info = vk::QueryPoolCreateInfo::default()
            .query_type(kind)
            .query_count(count);
        let device = &self.shared.device;
        // SAFETY: the device is alive and has acceleration structures enabled.
        let queries = unsafe { device.create_query_pool(&info, None) }
            .map_err(GpuError::of("vkCreateQueryPool"))?;
        let result = self.gpu.once(|commands| {
            // SAFETY: the command buffer is recording; pool and structures are alive.
            unsafe {
                device.cmd_reset_query_pool(commands.raw, queries, 0, count);
                self.extension()
                    .cmd_write_acceleration_structures_properties(
                        commands.raw,
                        structures,
                        kind,
                        queries,
                        0,
                    );
            }
            Ok(())
        });
        let mut sizes = vec![0u64; structures.len()];
        let read = result.and_then(|()| {
            // SAFETY: the submission that writes every query has finished.
            unsafe {
                let wait = vk::QueryResultFlags::TYPE_64 | vk::QueryResultFlags::WAIT;
                device.get_query_pool_results(queries, 0, &mut sizes, wait)
            }
            .map_err(GpuError::of("vkGetQueryPoolResults"))
        });
        self.shared.discard(Garbage::QueryPool(queries));
        read.map(|()| sizes)
    }

    /// Structures of these sizes in one buffer.
    fn pool(&self, sizes: &[u64], kind: vk::AccelerationStructureTypeKHR) -> GpuResult<Pool> {
        let total: u64 = sizes
            .iter()
            .map(|size| size.next_multiple_of(STRUCTURE_ALIGNMENT))
            .sum();
        let buffer = Buffer::new(
            self.gpu,
            &BufferDesc {
                name: "acceleration structures",
                size: total.max(STRUCTURE_ALIGNMENT),
                usage: vk::BufferUsageFlags::ACCELERATION_STRUCTURE_STORAGE_KHR
                    | vk::BufferUsageFlags::SHADER_DEVICE_ADDRESS,
                memory: Memory::Device,
            },
        )?;
        let raw = buffer.raw;
        let mut pool = Pool {
            shared: self.shared.clone(),
            structures: Vec::with_capacity(sizes.len()),
            buffer: Some(buffer),
        };
        let mut offset = 0;
        for size in sizes {
            let info = vk::AccelerationStructureCreateInfoKHR::default()
                .buffer(raw)
                .offset(offset)
                .size(*size)
                .ty(kind);
            // SAFETY: the buffer is alive, and this range of it belongs to this structure alone.
            let structure = unsafe { self.extension().create_acceleration_structure(&info, None) }
                .map_err(GpuError::of("vkCreateAccelerationStructureKHR"))?;
            pool.structures.push(structure);
            offset += size.next_multiple_of(STRUCTURE_ALIGNMENT);
        }
        Ok(pool)
    }

    fn address(&self, structure: vk::AccelerationStructureKHR) -> vk::DeviceAddress {
        let info = vk::AccelerationStructureDeviceAddressInfoKHR::default()
            .acceleration_structure(structure);
        // SAFETY: the structure is alive.
        unsafe {
            self.extension()
                .get_acceleration_structure_device_address(&info)
        }
    }
}

/// `VkAccelerationStructureInstanceKHR`.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct InstanceRecord {
    transform: [[f32; 4]; 3],
    custom_index_and_mask: u32,
    offset_and_flags: u32,
    reference: u64,
}

const BUILD_INPUT: vk::BufferUsageFlags =
    vk::BufferUsageFlags::ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_KHR;

const BUILD: Sync = Sync {
    stage: vk::PipelineStageFlags2::from_raw(
        vk::PipelineStageFlags2::ACCELERATION_STRUCTURE_BUILD_KHR.as_raw()
            | vk::PipelineStageFlags2::ACCELERATION_STRUCTURE_COPY_KHR.as_raw(),
    ),
    access: vk::AccessFlags2::ACCELERATION_STRUCTURE_WRITE_KHR,
};
const READ_STRUCTURES: Sync = Sync {
    stage: vk::PipelineStageFlags2::ALL_COMMANDS,
    access: vk::AccessFlags2::ACCELERATION_STRUCTURE_READ_KHR,
};

fn triangles(geometry: &TraceGeometry) -> vk::AccelerationStructureGeometryKHR<'static> {
    let address = |device_address| vk::DeviceOrHostAddressConstKHR { device_address };
    let triangles = vk::AccelerationStructureGeometryTrianglesDataKHR::default()
        .vertex_format(vk::Format::R32G32B32_SFLOAT)
        .vertex_data(address(geometry.vertices))
        .vertex_stride(VERTEX_STRIDE)
        .max_vertex(geometry.vertex_count.saturating_sub(1))
        .index_type(vk::IndexType::UINT32)
        .index_data(address(geometry.indices))
        .transform_data(address(geometry.transform.unwrap_or(0)));
    let flags = match geometry.opaque {
        true => vk::GeometryFlagsKHR::OPAQUE,
        false => vk::GeometryFlagsKHR::NO_DUPLICATE_ANY_HIT_INVOCATION,
    };
    vk::AccelerationStructureGeometryKHR::default()
        .geometry_type(vk::GeometryTypeKHR::TRIANGLES)
        .geometry(vk::AccelerationStructureGeometryDataKHR { triangles })
        .flags(flags)
}

fn build_info<'g>(
    geometries: &'g [vk::AccelerationStructureGeometryKHR<'g>],
    kind: vk::AccelerationStructureTypeKHR,
) -> vk::AccelerationStructureBuildGeometryInfoKHR<'g> {
    let mut flags = vk::BuildAccelerationStructureFlagsKHR::PREFER_FAST_TRACE;
    if kind == vk::AccelerationStructureTypeKHR::BOTTOM_LEVEL {
        flags |= vk::BuildAccelerationStructureFlagsKHR::ALLOW_COMPACTION;
    }
    vk::AccelerationStructureBuildGeometryInfoKHR::default()
        .ty(kind)
        .flags(flags)
        .mode(vk::BuildAccelerationStructureModeKHR::BUILD)
        .geometries(geometries)
}
