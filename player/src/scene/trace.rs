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
}

impl TraceScene {
    /// Builds acceleration structures over the vertices and indices of `scene`, and uploads the rest.
    ///
    /// # Errors
    /// A damaged package, more geometries than a ray can name, failures of Vulkan.
    ///
    /// # Panics
    /// Where the device cannot trace rays.
    pub fn new(gpu: &Gpu, scene: &GpuScene, package: &Package) -> Result<Self, PlayerError> {
        check::mesh_instances(package.mesh_instances()?, package.scene())?;
        check::emissive(package)?;
        check::env_alias(package.section(SectionKind::EnvAlias)?)?;
        let primitives = package.scene().primitives.len() as u32;
        if primitives > MAX_CUSTOM_INDEX {
            return Err(PlayerError::Input(format!(
                "{primitives} primitives: rays can tell {MAX_CUSTOM_INDEX} apart; join meshes"
            )));
        }
        let address = |buffer: &Option<Buffer>| buffer.as_ref().map_or(0, Buffer::device_address);
        let (vertices, indices) = (address(&scene.vertices), address(&scene.indices));
        let infos = geometry_table(package, vertices, indices)?;
        let bounds = &package.scene().bounds;
        let corner = |corner: &[_; 3]| DVec3::from(natives(corner).map(f64::from));
        let (least, most) = (corner(&bounds.min), corner(&bounds.max));
        let center = ((least + most) * 0.5).as_vec3();
        let instances = centered(package.mesh_instances()?, center.as_dvec3());
        let (meshes, placed) = if vertices == 0 {
            (Vec::new(), Vec::new())
        } else {
            (geometries(package, &infos), placements(&instances))
        };

        let mut uploader = Uploader::new(gpu)?;
        let mut copy = Copy {
            gpu,
            uploader: &mut uploader,
        };
        let storage = vk::BufferUsageFlags::STORAGE_BUFFER;
        let geometry_buffer = records(&mut copy, "geometry table", storage, &infos)?;
        let addressed = storage | vk::BufferUsageFlags::SHADER_DEVICE_ADDRESS;
        let instance_buffer = records(&mut copy, "mesh instances", addressed, &instances)?;
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
        Ok(Self {
            top: TopLevel::build(gpu, &meshes, &placed)?,
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

    /// Cumulative shares of the importance table's rows, then for each row those of its cells.
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

/// The importance table as distributions that can be inverted: rows, then each row's cells. Each ends in 1.
fn distribution(header: &EnvAliasHeader, entries: &[EnvAliasEntry]) -> Vec<f32> {
    let (width, height) = (header.width as usize, header.height as usize);
    let edge = |row: usize| (row as f64 / height as f64 * std::f64::consts::PI).cos();
    let rows = entries.chunks_exact(width).enumerate();
    let sums = rows.map(|(row, cells)| {
        let sum: f64 = cells.iter().map(|cell| f64::from(cell.luminance)).sum();
        sum * (edge(row) - edge(row + 1))
    });
    let mut steps = cumulative(sums);
    for cells in entries.chunks_exact(width) {
        steps.extend(cumulative(
            cells.iter().map(|cell| f64::from(cell.luminance)),
        ));
    }
    steps
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

/// The geometries of each mesh.
fn geometries(package: &Package, infos: &[GeometryInfo]) -> Vec<Vec<TraceGeometry>> {
    let scene = package.scene();
    let geometry = |index: usize| {
        let (primitive, info) = (&scene.primitives[index], &infos[index]);
        TraceGeometry {
            vertices: info.vertex_buffer_address,
            vertex_count: primitive.vertex_count.to_native(),
            indices: info.index_buffer_address,
            triangle_count: primitive.traced_index_count.to_native() / 3,
            opaque: primitive.opaque,
        }
    };
    let meshes = scene.meshes.iter().map(|mesh| {
        let first = mesh.first_primitive.to_native() as usize;
        let end = first + mesh.primitive_count.to_native() as usize;
        (first..end).map(geometry).collect()
    });
    meshes.collect()
}

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

fn placements(instances: &[MeshInstance]) -> Vec<TraceInstance> {
    instances
        .iter()
        .map(|instance| TraceInstance {
            transform: instance.transform,
            bottom: instance.mesh,
            custom_index: instance.first_geometry,
        })
        .collect()
}
