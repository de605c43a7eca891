//! What rays need of a fixture: instances, emissive triangles, importance tables.

use cairn_format::check;
use cairn_format::gpu::{
    DRAW_MIRRORED, EmissiveAliasEntry, EmissiveAliasHeader, EmissiveTriangle, EnvAliasEntry,
    EnvAliasHeader, MATERIAL_DOUBLE_SIDED, MeshInstance, NO_EMISSION,
};
use glam::{Mat4, Vec3};

use super::fixture::{Fixture, Object, halves};

/// Texels per side of a gradient sky.
pub const SKY_SIZE: u32 = 32;
/// Cells of the importance table.
const COLUMNS: u32 = 32;
const ROWS: u32 = 16;

#[derive(Default)]
pub struct Traced {
    pub mesh_instances: Vec<MeshInstance>,
    pub emissive_triangles: Vec<EmissiveTriangle>,
    pub emissive_alias: Vec<u8>,
    pub env_alias: Vec<u8>,
}

impl Traced {
    pub fn of(fixture: &Fixture) -> Self {
        let mut traced = Self::default();
        for (index, object) in fixture.objects.iter().enumerate() {
            for model in &object.models {
                traced.add(fixture, index as u32, object, model);
            }
        }
        let powers: Vec<f64> = traced
            .emissive_triangles
            .iter()
            .map(|triangle| f64::from(triangle.power))
            .collect();
        if powers.iter().any(|power| *power > 0.0) {
            let header = EmissiveAliasHeader {
                count: powers.len() as u32,
                total_power: powers.iter().sum::<f64>() as f32,
            };
            traced.emissive_alias.extend(bytemuck::bytes_of(&header));
            for (prob, alias_index) in alias(&powers) {
                let entry = EmissiveAliasEntry { prob, alias_index };
                traced.emissive_alias.extend(bytemuck::bytes_of(&entry));
            }
        }
        if let Some(faces) = fixture.environment {
            let by_face = |d: Vec3| faces[face_of(d)];
            match fixture.gradient {
                Some(sky) => traced.env_alias = table(&sky),
                None => traced.env_alias = table(&by_face),
            }
        }
        traced
    }

    fn add(&mut self, fixture: &Fixture, mesh: u32, object: &Object, model: &Mat4) {
        let material = &fixture.materials[object.material as usize];
        let mirrored = model.determinant() < 0.0;
        let rows = model.transpose().to_cols_array_2d();
        let listed = check::emits(material) && material.alpha_mode == 0;
        self.mesh_instances.push(MeshInstance {
            transform: [rows[0], rows[1], rows[2]],
            mesh,
            first_geometry: mesh,
            flags: if mirrored { DRAW_MIRRORED } else { 0 },
            first_emissive: if listed {
                self.emissive_triangles.len() as u32
            } else {
                NO_EMISSION
            },
        });
        if !listed {
            return;
        }
        let [r, g, b, _] = material.emissive_factor;
        let sides = if material.double_sided & MATERIAL_DOUBLE_SIDED != 0 {
            2.0
        } else {
            1.0
        };
        for triangle in object.indices.chunks_exact(3) {
            let mut corners = [triangle[0], triangle[1], triangle[2]];
            if mirrored {
                corners.swap(1, 2);
            }
            let [v0, v1, v2] = corners.map(|corner| {
                let position = object.vertices[corner as usize].position;
                model.transform_point3(Vec3::from(position))
            });
            let area = (v1 - v0).cross(v2 - v0).length() * 0.5;
            let luminance = 0.2126 * r + 0.7152 * g + 0.0722 * b;
            let [uv0, uv1, uv2] = corners.map(|corner| object.vertices[corner as usize].uv0);
            self.emissive_triangles.push(EmissiveTriangle {
                v0: v0.to_array(),
                v1: v1.to_array(),
                v2: v2.to_array(),
                emission: [r, g, b],
                area,
                material_index: object.material,
                power: luminance * area * std::f32::consts::PI * sides,
                uv0,
                uv1,
                uv2,
                ..bytemuck::Zeroable::zeroed()
            });
        }
    }
}

/// Cube face of a direction: +X -X +Y -Y +Z -Z.
fn face_of(d: Vec3) -> usize {
    let a = d.abs();
    let (axis, value) = if a.x >= a.y && a.x >= a.z {
        (0, d.x)
    } else if a.y >= a.z {
        (1, d.y)
    } else {
        (2, d.z)
    };
    axis * 2 + usize::from(value < 0.0)
}

/// Texels of a cube that holds `sky` (Vulkan specification, cube map face selection).
pub fn sky_texels(sky: fn(Vec3) -> [f32; 3]) -> Vec<u8> {
    let mut bytes = Vec::new();
    for face in 0..6 {
        for row in 0..SKY_SIZE {
            for column in 0..SKY_SIZE {
                let unit = |index: u32| (index as f32 + 0.5) / SKY_SIZE as f32 * 2.0 - 1.0;
                let (s, t) = (unit(column), unit(row));
                let direction = match face {
                    0 => Vec3::new(1.0, -t, -s),
                    1 => Vec3::new(-1.0, -t, s),
                    2 => Vec3::new(s, 1.0, t),
                    3 => Vec3::new(s, -1.0, -t),
                    4 => Vec3::new(s, -t, 1.0),
                    _ => Vec3::new(-s, -t, -1.0),
                };
                let [r, g, b] = sky(direction.normalize());
                bytes.extend(halves([r, g, b, 1.0]));
            }
        }
    }
    bytes
}

/// The importance table of a sky; empty where it is black.
fn table(sky: &dyn Fn(Vec3) -> [f32; 3]) -> Vec<u8> {
    use std::f64::consts::{PI, TAU};
    let mut luminances = Vec::new();
    let mut weights = Vec::new();
    for row in 0..ROWS {
        let edge = |row: u32| (f64::from(row) / f64::from(ROWS) * PI).cos();
        let angle = (edge(row) - edge(row + 1)) * TAU / f64::from(COLUMNS);
        for column in 0..COLUMNS {
            let phi = ((f64::from(column) + 0.5) / f64::from(COLUMNS) - 0.5) * TAU;
            let theta = (f64::from(row) + 0.5) / f64::from(ROWS) * PI;
            let (sine, y) = theta.sin_cos();
            let d = glam::DVec3::new(sine * phi.cos(), y, sine * phi.sin());
            let [r, g, b] = sky(d.as_vec3());
            let luminance = 0.2126 * r + 0.7152 * g + 0.0722 * b;
            luminances.push(luminance);
            weights.push(f64::from(luminance) * angle);
        }
    }
    let total: f64 = weights.iter().sum();
    if total <= 0.0 {
        return Vec::new();
    }
    let header = EnvAliasHeader {
        total_luminance: total as f32,
        entry_count: COLUMNS * ROWS,
        width: COLUMNS,
        height: ROWS,
    };
    let mut bytes = bytemuck::bytes_of(&header).to_vec();
    for ((prob, alias_index), luminance) in alias(&weights).into_iter().zip(luminances) {
        let entry = EnvAliasEntry {
            prob,
            alias_index,
            luminance,
        };
        bytes.extend(bytemuck::bytes_of(&entry));
    }
    bytes
}

/// An alias table by repeatedly filling the emptiest cell from the fullest.
fn alias(weights: &[f64]) -> Vec<(f32, u32)> {
    let mean = weights.iter().sum::<f64>() / weights.len() as f64;
    let mut left: Vec<f64> = weights.iter().map(|weight| weight / mean).collect();
    let mut open: Vec<usize> = (0..weights.len()).collect();
    let mut table = vec![(1.0, 0); weights.len()];
    while open.len() > 1 {
        open.sort_by(|a, b| left[*a].total_cmp(&left[*b]));
        let (less, more) = (open.remove(0), open[open.len() - 1]);
        let kept = left[less].clamp(0.0, 1.0);
        table[less] = (kept as f32, more as u32);
        left[more] -= 1.0 - kept;
    }
    table[open[0]] = (1.0, open[0] as u32);
    table
}
