//! What rays need of a package: acceleration structures, the geometry table, lights that are sampled.
//!
//! Traced positions are relative to the middle of the scene, where floats are finest.

use cairn_format::gpu::{
    DRAW_MIRRORED, EmissiveTriangle, EnvAliasEntry, EnvAliasHeader, GeometryInfo, MeshInstance,
    NO_EMISSION,
};
use cairn_format::scene::natives;
use cairn_format::{Package, SectionKind, check};
use glam::DVec3;

use super::merge::Plan;
use super::{Copy, GpuScene};
use crate::PlayerError;
use crate::gpu::Buffer;
use crate::gpu::{
    BuildStats, DescriptorSet, Gpu, GpuResult, TopLevel, TraceGeometry, TraceInstance, Uploader, vk,
};

/// Largest `gl_InstanceCustomIndexEXT`.
const MAX_CUSTOM_INDEX: u32 = (1 << 24) - 1;

/// A package's scene for ray tracing.
pub struct TraceScene {
    top: TopLevel,
    geometries: Buffer,
    mesh_instances: Buffer,
    environment: Option<Buffer>,
    distribution: Option<Buffer>,
    emissive: Option<[Buffer; 2]>,
    /// Middle of the scene's bounds, metres.
    pub center: [f32; 3],
    /// Diagonal of the scene's bounds, metres.
    pub diagonal: f32,
    /// Emissive triangles that are sampled.
    pub emissive_count: u32,
    /// Device address of the vertex arena; 0 without one.
    pub vertices: vk::DeviceAddress,
    /// Whether some geometry is masked or blended.
    pub alpha: bool,
    /// Geometries of the structure that is top-level instance 0; 0 where nothing is merged.
    pub merged_count: u32,
}

impl TraceScene {
    /// Builds acceleration structures over the vertices and indices of `scene`, and uploads the rest. With `merge`,
    /// meshes share one structure where that copies few triangles.
    ///
    /// # Errors
    /// A damaged package, more geometries than a ray can name, failures of Vulkan.
    ///
    /// # Panics
    /// Where the device cannot trace rays.
    pub fn new(
        gpu: &Gpu,
        scene: &GpuScene,
        package: &Package,
        merge: bool,
    ) -> Result<Self, PlayerError> {
        check::mesh_instances(package.mesh_instances()?, package.scene())?;
        check::emissive(package)?;
        check::env_alias(package.section(SectionKind::EnvAlias)?)?;
        let address = |buffer: &Option<Buffer>| buffer.as_ref().map_or(0, Buffer::device_address);
        let (vertices, indices) = (address(&scene.vertices), address(&scene.indices));
        let bounds = &package.scene().bounds;
        let corner = |corner: &[_; 3]| DVec3::from(natives(corner).map(f64::from));
        let (least, most) = (corner(&bounds.min), corner(&bounds.max));
        let center = ((least + most) * 0.5).as_vec3();
        let instances = centered(package.mesh_instances()?, center.as_dvec3());
        let infos = geometry_table(package, vertices, indices)?;
        let plan = Plan::new(package, &infos, &instances, merge);
        let geometries = plan.infos.len() as u64;
        if geometries > u64::from(MAX_CUSTOM_INDEX) {
            return Err(PlayerError::Input(format!(
                "{geometries} geometries: rays can tell {MAX_CUSTOM_INDEX} apart; join meshes"
            )));
        }

        let mut uploader = Uploader::new(gpu)?;
        let mut copy = Copy {
            gpu,
            uploader: &mut uploader,
        };
        let storage = vk::BufferUsageFlags::STORAGE_BUFFER;
        let geometry_buffer = records(&mut copy, "geometry table", storage, &plan.infos)?;
        let addressed = storage
            | vk::BufferUsageFlags::SHADER_DEVICE_ADDRESS
            | vk::BufferUsageFlags::ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_KHR;
        let instance_buffer = records(&mut copy, "mesh instances", addressed, &plan.instances)?;
        let alias = package.emissive_alias()?;
        let emissive = if alias.is_empty() {
            None
        } else {
            let triangles = package.emissive_triangles()?;
            Some([
                records::<EmissiveTriangle>(&mut copy, "emissive triangles", storage, triangles)?,
                records(&mut copy, "emissive alias", storage, alias)?,
            ])
        };
        let table = package.section(SectionKind::EnvAlias)?;
        let environment = (!table.is_empty())
            .then(|| copy.buffer("environment table", storage, table, 4, |_, _| Ok(())));
        let environment = environment.transpose()?;
        let distribution = package.env_alias()?.map(|(header, entries)| {
            let steps = distribution(header, entries);
            records(&mut copy, "environment distribution", storage, &steps)
        });
        let distribution = distribution.transpose()?;
        uploader.finish()?;
        let (bottoms, placed) = if vertices == 0 {
            (Vec::new(), Vec::new())
        } else {
            structures(package, &plan, instance_buffer.device_address())
        };
        Ok(Self {
            top: TopLevel::build(gpu, &bottoms, &placed)?,
            merged_count: plan.merged_count,
            geometries: geometry_buffer,
            mesh_instances: instance_buffer,
            environment,
            distribution,
            emissive_count: emissive
                .as_ref()
                .map_or(0, |_| package.count(SectionKind::EmissiveTriangles) as u32),
            emissive,
            center: center.to_array(),
            diagonal: (most - least).length() as f32,
            vertices,
            alpha: package
                .scene()
                .primitives
                .iter()
                .any(|primitive| !primitive.opaque),
        })
    }

    /// Whether the environment has an importance table.
    pub fn has_environment_table(&self) -> bool {
        self.environment.is_some()
    }

    /// Cumulative shares of the importance table's rows, then for each row those of its cells; then the guides of the
    /// same runs: see `guide`.
    pub fn distribution(&self) -> Option<&Buffer> {
        self.distribution.as_ref()
    }

    /// Device address of the mesh instances, whose transforms are relative to [`Self::center`].
    pub fn mesh_instances(&self) -> vk::DeviceAddress {
        self.mesh_instances.device_address()
    }

    /// What building the acceleration structures cost.
    pub fn build_stats(&self) -> BuildStats {
        self.top.stats
    }

    /// Writes bindings 4 to 8 of set 0.
    ///
    /// # Errors
    /// `Limit` where a buffer is larger than a shader may see.
    pub fn bind(&self, set: &mut DescriptorSet) -> GpuResult<()> {
        set.write_structure(4, &self.top);
        set.write_buffer(5, &self.geometries)?;
        if let Some(table) = &self.environment {
            set.write_buffer(6, table)?;
        }
        if let Some([triangles, alias]) = &self.emissive {
            set.write_buffer(7, triangles)?;
            set.write_buffer(8, alias)?;
        }
        Ok(())
    }
}

/// A device buffer of records; one of zeros where there are none.
fn records<T: bytemuck::Pod>(
    copy: &mut Copy<'_>,
    name: &str,
    usage: vk::BufferUsageFlags,
    records: &[T],
) -> Result<Buffer, PlayerError> {
    let zero = [T::zeroed()];
    let records = if records.is_empty() { &zero } else { records };
    let bytes = bytemuck::cast_slice(records);
    copy.buffer(name, usage, bytes, size_of::<T>(), |_, _| Ok(()))
}

/// The importance table as distributions that can be inverted: rows, then each row's cells, as the bits of floats. Each
/// ends in 1. Behind them the guide of the rows, and of each row's cells.
fn distribution(header: &EnvAliasHeader, entries: &[EnvAliasEntry]) -> Vec<u32> {
    let (width, height) = (header.width as usize, header.height as usize);
    let edge = |row: usize| (row as f64 / height as f64 * std::f64::consts::PI).cos();
    let rows = entries.chunks_exact(width).enumerate();
    let sums = rows.map(|(row, cells)| {
        let sum: f64 = cells.iter().map(|cell| f64::from(cell.luminance)).sum();
        sum * (edge(row) - edge(row + 1))
    });
    let mut runs = vec![cumulative(sums)];
    for cells in entries.chunks_exact(width) {
        runs.push(cumulative(
            cells.iter().map(|cell| f64::from(cell.luminance)),
        ));
    }
    let steps = runs.iter().flatten().map(|step| step.to_bits());
    steps
        .chain(runs.iter().flat_map(|run| guide(run)))
        .collect()
}

/// For each of `k` even parts of 0..1, as many as the run has steps or up to the next power of two: the first step above
/// the part's start. A search begins there and ends at the next part's (Chen and Asau 1974).
fn guide(run: &[f32]) -> Vec<u32> {
    let parts = run.len().next_power_of_two();
    let mut step = 0;
    let first_above = |part: usize| {
        // Exact: the number of parts is a power of two.
        let start = part as f32 / parts as f32;
        while step + 1 < run.len() && run[step] <= start {
            step += 1;
        }
        step as u32
    };
    (0..parts).map(first_above).collect()
}

/// Running sums over the total; even steps where that is 0.
fn cumulative(weights: impl ExactSizeIterator<Item = f64>) -> Vec<f32> {
    let count = weights.len();
    let mut sum = 0.0;
    let sums: Vec<f64> = weights
        .map(|weight| {
            sum += weight;
            sum
        })
        .collect();
    let share = |(index, partial): (usize, &f64)| {
        if index + 1 == count {
            1.0
        } else if sum > 0.0 {
            (partial / sum) as f32
        } else {
            (index + 1) as f32 / count as f32
        }
    };
    sums.iter().enumerate().map(share).collect()
}

/// One record per primitive of the root, in order.
fn geometry_table(
    package: &Package,
    vertices: vk::DeviceAddress,
    indices: vk::DeviceAddress,
) -> Result<Vec<GeometryInfo>, PlayerError> {
    let scene = package.scene();
    let materials = package.materials()?;
    let mut infos = Vec::with_capacity(scene.primitives.len());
    for mesh in scene.meshes.iter() {
        let first = mesh.first_primitive.to_native() as usize;
        let mut emissive = 0;
        for primitive in &scene.primitives[first..first + mesh.primitive_count.to_native() as usize]
        {
            let material = primitive.material.to_native();
            let emits = primitive.opaque && check::emits(&materials[material as usize]);
            infos.push(GeometryInfo {
                vertex_buffer_address: vertices
                    + u64::from(primitive.first_vertex.to_native())
                        * size_of::<cairn_format::Vertex>() as u64,
                index_buffer_address: indices + u64::from(primitive.first_index.to_native()) * 4,
                material_buffer_offset: material,
                emissive_offset: if emits { emissive } else { NO_EMISSION },
            });
            if emits {
                emissive += primitive.traced_index_count.to_native() / 3;
            }
        }
    }
    Ok(infos)
}

/// Bottom levels, the merged one first, and the top level's instances. `transforms` is the device address of the
/// plan's instances.
fn structures(
    package: &Package,
    plan: &Plan,
    transforms: vk::DeviceAddress,
) -> (Vec<Vec<TraceGeometry>>, Vec<TraceInstance>) {
    let scene = package.scene();
    let merged = plan.merged_count as usize;
    let all = plan.infos[merged..].iter().zip(scene.primitives.iter());
    let all: Vec<TraceGeometry> = all
        .map(|(info, primitive)| TraceGeometry {
            vertices: info.vertex_buffer_address,
            vertex_count: primitive.vertex_count.to_native(),
            indices: info.index_buffer_address,
            triangle_count: primitive.traced_index_count.to_native() / 3,
            opaque: primitive.opaque,
            transform: None,
        })
        .collect();
    let range = |mesh: u32| {
        let mesh = &scene.meshes[mesh as usize];
        let first = mesh.first_primitive.to_native() as usize;
        first..first + mesh.primitive_count.to_native() as usize
    };
    let (mut bottoms, mut placed) = (Vec::new(), Vec::new());
    if merged > 0 {
        bottoms.push(merged_geometries(plan, &all, &range, transforms));
        placed.push(TraceInstance {
            transform: IDENTITY,
            bottom: 0,
            custom_index: 0,
        });
    }
    let mut bottom_of = vec![None; plan.merged.len()];
    for instance in &plan.instances[merged..] {
        let bottom = *bottom_of[instance.mesh as usize].get_or_insert_with(|| {
            bottoms.push(all[range(instance.mesh)].to_vec());
            bottoms.len() as u32 - 1
        });
        placed.push(TraceInstance {
            transform: instance.transform,
            bottom,
            custom_index: plan.merged_count + instance.first_geometry,
        });
    }
    (bottoms, placed)
}

/// The merged geometries, each in its instance's place.
fn merged_geometries(
    plan: &Plan,
    all: &[TraceGeometry],
    range: &dyn Fn(u32) -> std::ops::Range<usize>,
    transforms: vk::DeviceAddress,
) -> Vec<TraceGeometry> {
    let mut geometries: Vec<TraceGeometry> = Vec::with_capacity(plan.merged_count as usize);
    while geometries.len() < plan.merged_count as usize {
        let mesh = plan.instances[geometries.len()].mesh;
        for geometry in &all[range(mesh)] {
            let record = (geometries.len() * size_of::<MeshInstance>()) as u64;
            geometries.push(TraceGeometry {
                transform: Some(transforms + record),
                ..*geometry
            });
        }
    }
    geometries
}

const IDENTITY: [[f32; 4]; 3] = [
    [1.0, 0.0, 0.0, 0.0],
    [0.0, 1.0, 0.0, 0.0],
    [0.0, 0.0, 1.0, 0.0],
];

/// The instances, moved so that `center` is the origin.
fn centered(instances: &[MeshInstance], center: DVec3) -> Vec<MeshInstance> {
    let moved = |instance: &MeshInstance| {
        let mut moved = *instance;
        for (axis, row) in moved.transform.iter_mut().enumerate() {
            row[3] = (f64::from(row[3]) - center[axis]) as f32;
        }
        debug_assert!(moved.flags & !(DRAW_MIRRORED | 1) == 0);
        moved
    };
    instances.iter().map(moved).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What the shader does: the step that `u` falls into, and where the search began and ended.
    fn invert(run: &[f32], guide: &[u32], u: f32) -> (usize, u32) {
        let part = (u * guide.len() as f32) as usize;
        let mut low = guide[part] as usize;
        let mut high = guide
            .get(part + 1)
            .map_or(run.len() - 1, |step| *step as usize);
        let mut reads = 0;
        while low < high {
            let middle = (low + high) / 2;
            if run[middle] > u {
                high = middle;
            } else {
                low = middle + 1;
            }
            reads += 1;
        }
        (low, reads)
    }

    #[test]
    fn guided_searches_find_what_a_scan_finds() {
        for count in [1_usize, 2, 3, 64, 100, 511] {
            for spiky in [false, true] {
                let weight = |index: usize| match (spiky, index % 37) {
                    (true, 5) => 1e4,
                    (true, _) => 0.0,
                    (false, step) => 0.1 + step as f64,
                };
                let run = cumulative((0..count).map(weight));
                let guide = guide(&run);
                let mut reads = 0;
                for tick in 0..4096 {
                    let u = tick as f32 / 4096.0;
                    let found = invert(&run, &guide, u);
                    let first = run.iter().position(|step| *step > u);
                    assert_eq!(Some(found.0), first, "{count} {spiky} {u}");
                    reads += found.1;
                }
                assert!(reads < 2 * 4096, "{count} {spiky}: {reads} reads");
            }
        }
    }
}
