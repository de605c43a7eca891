//! Indexed triangle meshes made from primitive shapes.

use glam::{DVec2, DVec3, Mat4, Vec2, Vec3};
use libm::{cos, sin};

/// Triangles with normals and texture coordinates; counter-clockwise is the front, metres, y up.
///
/// Charts are not mirrored: seen from the front with u to the right, v runs down.
#[derive(Debug, Clone, Default)]
pub struct Mesh {
    pub positions: Vec<Vec3>,
    pub normals: Vec<Vec3>,
    pub uvs: Vec<Vec2>,
    /// The second texture coordinate set; empty where there is none.
    pub uvs1: Vec<Vec2>,
    pub indices: Vec<u16>,
}

impl Mesh {
    fn vertex(&mut self, position: DVec3, normal: DVec3, uv: DVec2) -> u16 {
        let index = u16::try_from(self.positions.len()).expect("meshes fit u16 indices");
        self.positions.push(position.as_vec3());
        self.normals.push(normal.normalize().as_vec3());
        self.uvs.push(uv.as_vec2());
        index
    }

    /// Adds a flat convex quad, corners counter-clockwise from the front, with planar UVs of `repeats` per metre.
    pub fn flat_quad(&mut self, corners: [DVec3; 4], repeats: f64) {
        let normal = (corners[1] - corners[0])
            .cross(corners[2] - corners[0])
            .normalize();
        let i = corners.map(|p| self.vertex(p, normal, planar_uv(p, normal) * repeats));
        self.indices.extend([i[0], i[1], i[2], i[0], i[2], i[3]]);
    }

    /// Adds a grid over (u, v) in the unit square, `columns` by `rows` quads, seen with u right and v down.
    ///
    /// Normals come from the surface's derivatives, which must not vanish at the vertices.
    pub fn surface(
        &mut self,
        columns: usize,
        rows: usize,
        uv_size: DVec2,
        point: impl Fn(f64, f64) -> DVec3,
    ) {
        const STEP: f64 = 1e-4;
        let first = self.positions.len();
        for j in 0..=rows {
            for i in 0..=columns {
                let (u, v) = (i as f64 / columns as f64, j as f64 / rows as f64);
                let du = point(u + STEP, v) - point(u - STEP, v);
                let dv = point(u, v + STEP) - point(u, v - STEP);
                self.vertex(point(u, v), dv.cross(du), DVec2::new(u, v) * uv_size);
            }
        }
        let at = |i: usize, j: usize| (first + j * (columns + 1) + i) as u16;
        for j in 0..rows {
            for i in 0..columns {
                let (a, b, c, d) = (at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j));
                self.indices.extend([a, b, c, a, c, d]);
            }
        }
    }

    /// Adds an axis-aligned box between two corners, flat normals, UVs of `repeats` per metre.
    pub fn cuboid(&mut self, low: DVec3, high: DVec3, repeats: f64) {
        let (a, b) = (low, high);
        let p = DVec3::new;
        let faces = [
            [
                p(a.x, a.y, b.z),
                p(b.x, a.y, b.z),
                p(b.x, b.y, b.z),
                p(a.x, b.y, b.z),
            ],
            [
                p(b.x, a.y, a.z),
                p(a.x, a.y, a.z),
                p(a.x, b.y, a.z),
                p(b.x, b.y, a.z),
            ],
            [
                p(b.x, a.y, b.z),
                p(b.x, a.y, a.z),
                p(b.x, b.y, a.z),
                p(b.x, b.y, b.z),
            ],
            [
                p(a.x, a.y, a.z),
                p(a.x, a.y, b.z),
                p(a.x, b.y, b.z),
                p(a.x, b.y, a.z),
            ],
            [
                p(a.x, b.y, b.z),
                p(b.x, b.y, b.z),
                p(b.x, b.y, a.z),
                p(a.x, b.y, a.z),
            ],
            [
                p(a.x, a.y, a.z),
                p(b.x, a.y, a.z),
                p(b.x, a.y, b.z),
                p(a.x, a.y, b.z),
            ],
        ];
        for face in faces {
            self.flat_quad(face, repeats);
        }
    }

    /// Adds a surface of revolution about +y from a profile of (radius, height) points, top to bottom.
    ///
    /// Each slice of `profile` is smooth within itself; a crease lies between slices. Straight
    /// slices have two points, others are read as polylines with averaged normals.
    pub fn lathe(&mut self, profile: &[&[(f64, f64)]], segments: usize, uv_size: DVec2) {
        let mut travelled = 0.0;
        for part in profile {
            let first = self.positions.len();
            for (row, &(radius, height)) in part.iter().enumerate() {
                let before = part[row.saturating_sub(1)];
                let after = part[(row + 1).min(part.len() - 1)];
                if row > 0 {
                    travelled += libm::hypot(radius - before.0, height - before.1);
                }
                let tangent = DVec2::new(after.0 - before.0, after.1 - before.1);
                for i in 0..=segments {
                    let u = i as f64 / segments as f64;
                    let (s, c) = ring(u);
                    let normal = DVec3::new(-tangent.y * c, tangent.x, -tangent.y * s);
                    let position = DVec3::new(radius * c, height, radius * s);
                    self.vertex(position, normal, DVec2::new(u, travelled) * uv_size);
                }
            }
            let at = |i: usize, j: usize| (first + j * (segments + 1) + i) as u16;
            for j in 0..part.len() - 1 {
                for i in 0..segments {
                    let (a, b, c, d) = (at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j));
                    // A ring of radius 0 makes triangles without area, which the format would carry for nothing.
                    if part[j + 1].0 > 0.0 {
                        self.indices.extend([a, b, c]);
                    }
                    if part[j].0 > 0.0 {
                        self.indices.extend([a, c, d]);
                    }
                }
            }
        }
    }

    /// A sphere about the origin.
    pub fn sphere(radius: f64, segments: usize, rings: usize) -> Self {
        let mut mesh = Self::default();
        for j in 0..=rings {
            let v = j as f64 / rings as f64;
            let (y, r) = match j {
                0 => (1.0, 0.0),
                j if j == rings => (-1.0, 0.0),
                _ => (cos(v * std::f64::consts::PI), sin(v * std::f64::consts::PI)),
            };
            for i in 0..=segments {
                let pole = if j == 0 || j == rings { 0.5 } else { 0.0 };
                let u = i as f64 / segments as f64;
                let (s, c) = ring(u);
                let n = DVec3::new(r * c, y, r * s);
                mesh.vertex(n * radius, n, DVec2::new(u + pole / segments as f64, v));
            }
        }
        let at = |i: usize, j: usize| (j * (segments + 1) + i) as u16;
        for j in 0..rings {
            for i in 0..segments {
                let (a, b, c, d) = (at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j));
                if j + 1 < rings {
                    mesh.indices.extend([a, b, c]);
                }
                if j > 0 {
                    mesh.indices.extend([a, c, d]);
                }
            }
        }
        mesh
    }

    /// An upright quad about the origin in the xy plane that faces +z and shows `repeats` whole textures a side.
    pub fn quad(width: f64, height: f64, repeats: f64) -> Self {
        let mut mesh = Self::default();
        mesh.surface(1, 1, DVec2::splat(repeats), |u, v| {
            DVec3::new((u - 0.5) * width, (0.5 - v) * height, 0.0)
        });
        mesh
    }

    /// Adds a transformed copy of another mesh; the transform does not mirror.
    pub fn append(&mut self, other: &Self, transform: Mat4) {
        let first = self.positions.len();
        assert!(transform.determinant() > 0.0 && self.uvs1.is_empty() && other.uvs1.is_empty());
        let turn = glam::Mat3::from_mat4(transform).inverse().transpose();
        for (&p, &n) in other.positions.iter().zip(&other.normals) {
            self.positions.push(transform.transform_point3(p));
            self.normals.push((turn * n).normalize());
        }
        self.uvs.extend(&other.uvs);
        self.indices
            .extend(other.indices.iter().map(|&i| i + first as u16));
    }

    /// Twice the area of triangle `t` as a vector along its front.
    pub fn triangle_normal(&self, t: usize) -> Vec3 {
        let [a, b, c] = [0, 1, 2].map(|k| self.positions[usize::from(self.indices[3 * t + k])]);
        (b - a).cross(c - a)
    }
}

/// (sin, cos) of a turn in which growing `u` runs to the right when seen from outside.
fn ring(u: f64) -> (f64, f64) {
    // The last column must meet the first one exactly.
    let angle = -(u - libm::floor(u)) * std::f64::consts::TAU;
    (sin(angle), cos(angle))
}

/// Texture coordinates in metres on the plane across the normal's largest axis, u right and v down from the front.
fn planar_uv(p: DVec3, normal: DVec3) -> DVec2 {
    let a = normal.abs();
    if a.y >= a.x && a.y >= a.z {
        DVec2::new(p.x, if normal.y > 0.0 { p.z } else { -p.z })
    } else if a.x >= a.z {
        DVec2::new(if normal.x > 0.0 { -p.z } else { p.z }, -p.y)
    } else {
        DVec2::new(if normal.z > 0.0 { p.x } else { -p.x }, -p.y)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(mesh: &Mesh) {
        for t in 0..mesh.indices.len() / 3 {
            let corners = [0, 1, 2].map(|k| usize::from(mesh.indices[3 * t + k]));
            let face = mesh.triangle_normal(t);
            assert!(face.length() > 1e-8, "triangle {t} has area");
            for i in corners {
                assert!((mesh.normals[i].length() - 1.0).abs() < 1e-5);
                assert!(
                    face.dot(mesh.normals[i]) > 0.0,
                    "triangle {t} faces its normals"
                );
            }
            let [p, q, r] = corners.map(|i| mesh.uvs[i]);
            assert!((q - p).perp_dot(r - p) < 0.0, "triangle {t}: v runs down");
        }
    }

    #[test]
    fn shapes_face_outwards_and_are_not_mirrored() {
        let sphere = Mesh::sphere(2.0, 16, 8);
        check(&sphere);
        for (p, n) in sphere.positions.iter().zip(&sphere.normals) {
            assert!(p.abs_diff_eq(*n * 2.0, 1e-5));
        }
        check(&Mesh::quad(1.0, 2.0, 1.0));
        let mut cuboid = Mesh::default();
        cuboid.cuboid(DVec3::new(-1.0, 0.0, 2.0), DVec3::new(3.0, 1.0, 5.0), 1.0);
        check(&cuboid);
        let centre = Vec3::new(1.0, 0.5, 3.5);
        for (p, n) in cuboid.positions.iter().zip(&cuboid.normals) {
            assert!((*p - centre).dot(*n) > 0.0);
        }
    }

    #[test]
    fn lathe_closes_and_faces_outwards() {
        let mut mesh = Mesh::default();
        let wall: &[(f64, f64)] = &[(0.5, 2.0), (0.7, 1.0), (0.6, 0.0)];
        mesh.lathe(&[&[(0.0, 2.0), (0.5, 2.0)], wall], 12, DVec2::ONE);
        check(&mesh);
        for row in 0..5 {
            let (a, b) = (row * 13, row * 13 + 12);
            assert_eq!(mesh.positions[a], mesh.positions[b], "the seam is closed");
        }
    }

    #[test]
    fn appended_copies_keep_unit_normals() {
        let mut mesh = Mesh::default();
        let squash = Mat4::from_scale(Vec3::new(1.0, 0.25, 3.0));
        mesh.append(&Mesh::sphere(1.0, 8, 6), squash);
        mesh.append(&Mesh::sphere(1.0, 8, 6), Mat4::from_translation(Vec3::X));
        check(&mesh);
    }
}
