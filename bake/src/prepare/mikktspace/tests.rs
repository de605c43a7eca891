//! Bit equality of the tangents with the reference.

use bevy_mikktspace::{Geometry, Ops, TangentSpace, generate_tangents};

use super::*;

/// The operations that the reference is given: those of this module.
struct PortableOps;

impl Ops for PortableOps {
    fn sqrt(x: f32) -> f32 {
        x.sqrt()
    }

    fn acos(x: f32) -> f32 {
        arc_cosine::exact(x)
    }
}

/// An unindexed triangle list.
#[derive(Clone, Default)]
struct Mesh {
    positions: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
    uvs: Vec<[f32; 2]>,
    result: Vec<[f32; 4]>,
}

impl Mesh {
    fn push(&mut self, position: [f32; 3], normal: [f32; 3], uv: [f32; 2]) {
        self.positions.push(position);
        self.normals.push(normal);
        self.uvs.push(uv);
    }

    fn generate(&self) -> Vec<[f32; 4]> {
        generate(&Soup {
            positions: &self.positions,
            normals: &self.normals,
            uvs: &self.uvs,
        })
        .expect("no group is too wide")
    }

    fn reference(&self) -> Vec<[f32; 4]> {
        let mut mesh = self.clone();
        mesh.result = vec![[0.0; 4]; self.positions.len()];
        generate_tangents(&mut mesh).expect("cannot fail");
        mesh.result
    }

    /// Asserts bit equality, NaN being equal to NaN, and returns how many corners have no tangent.
    fn check(&self, name: &str) -> usize {
        let bits = |value: f32| {
            if value.is_nan() {
                f32::NAN.to_bits()
            } else {
                value.to_bits()
            }
        };
        let ours = self.generate();
        for (corner, (ours, theirs)) in ours.iter().zip(self.reference()).enumerate() {
            let (ours, theirs) = (ours.map(bits), theirs.map(bits));
            assert_eq!(ours, theirs, "{name}: corner {corner}");
        }
        ours.iter().filter(|tangent| tangent[3] == 0.0).count()
    }

    /// The triangles in another order, and turned.
    fn shuffled(&self, random: &mut Random) -> Self {
        let mut order: Vec<usize> = (0..self.positions.len() / 3).collect();
        for at in (1..order.len()).rev() {
            order.swap(at, random.below(at + 1));
        }
        let mut mesh = Self::default();
        for triangle in order {
            let turn = random.below(3);
            for vertex in 0..3 {
                let corner = triangle * 3 + (vertex + turn) % 3;
                mesh.push(
                    self.positions[corner],
                    self.normals[corner],
                    self.uvs[corner],
                );
            }
        }
        mesh
    }
}

impl Geometry<PortableOps> for Mesh {
    fn num_faces(&self) -> usize {
        self.positions.len() / 3
    }
    fn num_vertices_of_face(&self, _face: usize) -> usize {
        3
    }
    fn position(&self, face: usize, vertex: usize) -> [f32; 3] {
        self.positions[face * 3 + vertex]
    }
    fn normal(&self, face: usize, vertex: usize) -> [f32; 3] {
        self.normals[face * 3 + vertex]
    }
    fn tex_coord(&self, face: usize, vertex: usize) -> [f32; 2] {
        self.uvs[face * 3 + vertex]
    }
    fn set_tangent(&mut self, space: Option<TangentSpace>, face: usize, vertex: usize) {
        self.result[face * 3 + vertex] = space.map_or([0.0; 4], |space| space.tangent_encoded());
    }
}

/// SplitMix64 (Steele et al. 2014).
struct Random(u64);

impl Random {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    fn below(&mut self, end: usize) -> usize {
        (self.bits() % end as u64) as usize
    }

    /// Uniform in -1..1.
    fn signed(&mut self) -> f32 {
        (self.bits() >> 40) as f32 / (1u64 << 23) as f32 - 1.0
    }

    fn vector(&mut self) -> [f32; 3] {
        [self.signed(), self.signed(), self.signed()]
    }
}

fn unit(vector: [f32; 3]) -> [f32; 3] {
    let [x, y, z] = vector;
    let length = (x * x + y * y + z * z).sqrt();
    vector.map(|value| value / length)
}

/// `columns` x `rows` squares on a wavy sheet.
fn sheet(columns: usize, rows: usize, uv: impl Fn(f32, f32) -> [f32; 2]) -> Mesh {
    let mut mesh = Mesh::default();
    for row in 0..rows {
        for column in 0..columns {
            let offsets = [(0, 0), (0, 1), (1, 0), (1, 0), (0, 1), (1, 1)];
            for (right, down) in offsets {
                let u = (column + right) as f32 / columns as f32;
                let v = (row + down) as f32 / rows as f32;
                let slope = 0.9 * libm::cosf(9.0 * u);
                mesh.push(
                    [u, 1.0 - v, 0.1 * libm::sinf(9.0 * u)],
                    unit([-slope, 0.0, 1.0]),
                    uv(u, v),
                );
            }
        }
    }
    mesh
}

fn plain(u: f32, v: f32) -> [f32; 2] {
    [u, v]
}

fn mirrored(u: f32, v: f32) -> [f32; 2] {
    [(u - 0.5).abs(), v]
}

/// A sphere with `rings` rings; the triangles at the poles are degenerate.
fn sphere(rings: usize) -> Mesh {
    use std::f32::consts::PI;
    let mut mesh = Mesh::default();
    let point = |u: f32, v: f32| {
        let (sin_v, cos_v) = libm::sincosf(v * PI);
        let (sin_u, cos_u) = libm::sincosf(u * 2.0 * PI);
        let sin_v = if v == 1.0 { 0.0 } else { sin_v };
        [sin_v * cos_u, cos_v, sin_v * sin_u]
    };
    for ring in 0..rings {
        for side in 0..rings * 2 {
            for (right, down) in [(0, 0), (0, 1), (1, 0), (1, 0), (0, 1), (1, 1)] {
                let u = (side + right) as f32 / (rings * 2) as f32;
                let v = (ring + down) as f32 / rings as f32;
                let p = point(if u == 1.0 { 0.0 } else { u }, v);
                mesh.push(p, p, [u, v]);
            }
        }
    }
    mesh
}

/// Triangles around one corner.
fn fan(count: usize) -> Mesh {
    let rim = |index: usize| {
        let (sin, cos) = libm::sincosf(index as f32 / count as f32 * std::f32::consts::TAU);
        [cos, sin, 0.0]
    };
    let mut mesh = Mesh::default();
    for index in 0..count {
        for position in [[0.0; 3], rim(index), rim((index + 1) % count)] {
            mesh.push(position, [0.0, 0.0, 1.0], [position[0], -position[1]]);
        }
    }
    mesh
}

/// Triangles over few positions, normals and coordinates; the larger `spread`, the more coordinates.
fn soup(
    random: &mut Random,
    triangles: usize,
    points: usize,
    degenerate: f32,
    spread: usize,
) -> Mesh {
    let zero = |random: &mut Random| if random.below(2) == 0 { 0.0 } else { -0.0f32 };
    let positions: Vec<_> = (0..points).map(|_| random.vector()).collect();
    let normals: Vec<_> = (0..3).map(|_| unit(random.vector())).collect();
    let uvs: Vec<_> = (0..spread)
        .map(|_| [random.signed(), random.signed()])
        .collect();
    let mut mesh = Mesh::default();
    for _ in 0..triangles {
        let mut chosen = [
            random.below(points),
            random.below(points),
            random.below(points),
        ];
        if random.signed().abs() < degenerate {
            chosen[random.below(3)] = chosen[0];
        }
        let flat = random.below(8) == 0;
        for point in chosen {
            let mut position = positions[point];
            let mut normal = normals[random.below(20) / 18];
            if point % 3 == 0 {
                position[point % 2] = zero(random);
                normal = [zero(random), 1.0, zero(random)];
            }
            let uv = if flat { uvs[0] } else { uvs[point % spread] };
            mesh.push(position, normal, uv);
        }
    }
    mesh
}

#[test]
fn sheets_equal_the_reference() {
    for (columns, rows) in [(2, 1), (2, 9), (7, 3), (3, 7), (40, 40), (90, 30)] {
        for uv in [plain, mirrored] {
            let mesh = sheet(columns, rows, uv);
            assert_eq!(mesh.check("sheet"), 0);
            let mut random = Random(columns as u64);
            for _ in 0..4 {
                assert_eq!(mesh.shuffled(&mut random).check("shuffled sheet"), 0);
            }
        }
    }
}

#[test]
fn spheres_equal_the_reference() {
    for rings in [2, 3, 8, 33] {
        let mesh = sphere(rings);
        assert!(mesh.check("sphere") > 0, "the poles have no tangent");
        mesh.shuffled(&mut Random(7)).check("shuffled sphere");
    }
}

#[test]
fn soups_equal_the_reference() {
    let (mut without, mut with) = (0, 0);
    for seed in 0..3000u64 {
        let mut random = Random(seed);
        // Few points make the order of the last edges matter.
        let (triangles, points) = if seed % 5 == 0 {
            let triangles = 1 + random.below(400);
            (triangles, 3 + random.below(3 + triangles))
        } else {
            (8 + random.below(60), 5 + random.below(15))
        };
        let degenerate = (seed % 7) as f32 / 10.0;
        let spread = 1 + random.below(1 + points);
        let mesh = soup(&mut random, triangles, points, degenerate, spread);
        let missing = mesh.check(&format!("soup {seed}"));
        without += missing;
        with += mesh.positions.len() - missing;
    }
    assert!(without > 1000 && with > 10_000, "{without} {with}");
}

#[test]
fn opposite_tangents_split_groups_as_in_the_reference() {
    // Around the centre the coordinates turn twice, so that tangents of one group are opposite.
    let mut split = 0;
    for count in [4usize, 6, 8, 12, 50, 200] {
        for turns in [2, 3] {
            let mut mesh = fan(count);
            for (corner, uv) in mesh.uvs.iter_mut().enumerate() {
                let side = corner / 3 + usize::from(corner % 3 == 2);
                if corner % 3 != 0 {
                    let angle = (side * turns) as f32 / count as f32 * std::f32::consts::TAU;
                    let (sin, cos) = libm::sincosf(angle);
                    *uv = [cos, sin];
                }
            }
            mesh.check(&format!("{turns} turns in {count}"));
            let centre: Vec<_> = mesh.generate().into_iter().step_by(3).collect();
            split += usize::from(centre.iter().any(|tangent| *tangent != centre[0]));
        }
    }
    assert!(split > 0, "no group was split");
}

#[test]
fn wide_fans_equal_the_reference() {
    let mesh = fan(5000);
    assert_eq!(mesh.generate().len(), 15_000);
    let equal = |mesh: &Mesh| {
        // The reference recurses once per triangle.
        let mesh = mesh.clone();
        let thread = std::thread::Builder::new().stack_size(64 << 20);
        let handle = thread.spawn(move || mesh.check("fan"));
        handle.expect("a thread starts").join().expect("equal");
    };
    equal(&mesh);
    equal(&mesh.shuffled(&mut Random(3)));
}

#[test]
fn many_triangles_on_one_edge_pair_as_in_the_reference() {
    let mut random = Random(11);
    for count in [3, 30, 700] {
        let mut mesh = Mesh::default();
        for _ in 0..count {
            let mut ends = [([0.0; 3], [0.0; 2]), ([0.0, 1.0, 0.0], [0.0, 1.0])];
            if random.below(2) == 0 {
                ends.reverse();
            }
            let tip = (random.vector(), [random.signed(), random.signed()]);
            for (position, uv) in [ends[0], ends[1], tip] {
                mesh.push(position, [0.0, 0.0, 1.0], uv);
            }
        }
        mesh.check("book");
    }
}

#[test]
fn extreme_numbers_equal_the_reference() {
    for scale in [
        1e-44f32, 1e-38, 1e-30, 1e-20, 1e-6, 1e7, 1e18, 1e20, 1e30, 2e38, 3.4e38,
    ] {
        for which in 0..3 {
            let mut mesh = sheet(5, 6, mirrored);
            for position in &mut mesh.positions {
                *position = position.map(|value| value * if which == 0 { scale } else { 1.0 });
            }
            for uv in &mut mesh.uvs {
                *uv = uv.map(|value| value * if which == 1 { scale } else { 1.0 });
            }
            for normal in &mut mesh.normals {
                *normal = normal.map(|value| value * if which == 2 { scale } else { 1.0 });
            }
            mesh.check(&format!("{scale:e} on {which}"));
            mesh.shuffled(&mut Random(5))
                .check(&format!("{scale:e} on {which}, shuffled"));
        }
    }
}

#[test]
fn numbers_that_are_not_finite_end() {
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for every in [1, 2, 7, 100] {
            let mut random = Random(every as u64);
            let mut mesh = sheet(12, 12, mirrored);
            for corner in (0..mesh.positions.len()).step_by(every) {
                match random.below(3) {
                    0 => mesh.positions[corner][random.below(3)] = bad,
                    1 => mesh.normals[corner][random.below(3)] = bad,
                    _ => mesh.uvs[corner][random.below(2)] = bad,
                }
            }
            assert_eq!(mesh.generate().len(), mesh.positions.len());
        }
    }
}

#[test]
fn degenerate_triangles_inherit_from_the_first_equal_corner() {
    let mut mesh = sheet(12, 12, mirrored);
    let count = mesh.positions.len();
    for triangle in 0..count / 3 {
        let corner = triangle * 3;
        for (from, uv) in [(corner, None), (corner, None), (corner + 1, Some([9.0; 2]))] {
            let uv = uv.unwrap_or(mesh.uvs[from]);
            mesh.push(mesh.positions[from], mesh.normals[from], uv);
        }
    }
    assert_eq!(
        mesh.check("needles"),
        count / 3,
        "only corners without an equal"
    );
}

#[test]
fn degenerate_triangles_and_wide_fans_are_affordable() {
    // All pairs would be 10^11 steps and more.
    let mut mesh = fan(300_000).shuffled(&mut Random(1));
    for index in 0..300_000u32 {
        for _ in 0..3 {
            mesh.push([index as f32; 3], [0.0, 1.0, 0.0], [index as f32, 0.0]);
        }
    }
    let tangents = mesh.generate();
    assert!(tangents[..900_000].iter().all(|tangent| tangent[3] != 0.0));
    assert!(
        tangents[900_000..]
            .iter()
            .all(|tangent| *tangent == [0.0; 4])
    );
}

#[test]
fn a_wide_fan_of_opposite_tangents_is_refused() {
    let mut mesh = fan(MAX_SPLIT + 1);
    for (corner, uv) in mesh.uvs.iter_mut().enumerate() {
        if corner % 3 != 0 {
            let side = corner / 3 + usize::from(corner % 3 == 2);
            let angle = side as f32 * 2.0 / (MAX_SPLIT + 1) as f32 * std::f32::consts::TAU;
            let (sin, cos) = libm::sincosf(angle);
            *uv = [cos, sin];
        }
    }
    let soup = Soup {
        positions: &mesh.positions,
        normals: &mesh.normals,
        uvs: &mesh.uvs,
    };
    assert!(matches!(generate(&soup), Err(TooWide { corners }) if corners > MAX_SPLIT));
}

#[test]
fn nothing_gives_nothing() {
    assert_eq!(Mesh::default().generate(), Vec::<[f32; 4]>::new());
}

#[test]
fn the_number_of_threads_does_not_matter() {
    let mesh = soup(&mut Random(9), 20_000, 9000, 0.3, 8000);
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        pool.build().expect("a pool").install(|| mesh.generate())
    };
    let bits = |tangents: Vec<[f32; 4]>| -> Vec<_> {
        tangents
            .into_iter()
            .map(|tangent| tangent.map(f32::to_bits))
            .collect()
    };
    assert_eq!(bits(run(1)), bits(run(3)));
}
