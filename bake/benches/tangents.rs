//! Speed and exactness of tangent generation on one thread, as a Markdown table.

use std::fs;
use std::time::Instant;

use bevy_mikktspace::{Geometry, Ops, TangentSpace, generate_tangents};
use cairn_bake::prepare::mikktspace::{self, Soup};
use meshopt::TangentOptions;

/// Runs of which the median counts.
const RUNS: usize = 5;

struct PortableOps;

impl Ops for PortableOps {
    fn sqrt(x: f32) -> f32 {
        x.sqrt()
    }

    fn acos(x: f32) -> f32 {
        libm::acos(x.into()) as f32
    }
}

/// An unindexed triangle list.
#[derive(Default)]
struct Mesh {
    positions: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
    uvs: Vec<[f32; 2]>,
    result: Vec<[f32; 4]>,
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

impl Mesh {
    /// `side` x `side` squares on a wavy sheet; the texture is mirrored at `mirrors` lines.
    fn sheet(side: usize, mirrors: usize) -> Self {
        let mut mesh = Self::default();
        let points: Vec<_> = (0..=side)
            .map(|at| Column::new(at as f32 / side as f32, mirrors))
            .collect();
        for row in 0..side {
            for column in 0..side {
                for (right, down) in [(0, 0), (0, 1), (1, 0), (1, 0), (0, 1), (1, 1)] {
                    let point = &points[column + right];
                    let v = (row + down) as f32 / side as f32;
                    mesh.positions.push([point.x, 1.0 - v, point.z]);
                    mesh.normals.push(point.normal);
                    mesh.uvs.push([point.u, v]);
                }
            }
        }
        mesh
    }

    /// Makes three of ten triangles degenerate by moving a corner onto another.
    fn collapse(mut self) -> Self {
        for corner in (0..self.positions.len()).step_by(3) {
            if corner / 3 % 10 < 3 {
                let (from, to) = (corner + corner / 3 % 3, corner + (corner / 3 + 1) % 3);
                self.positions[to] = self.positions[from];
            }
        }
        self
    }

    fn triangles(&self) -> usize {
        self.positions.len() / 3
    }

    fn ours(&self) -> Vec<[f32; 4]> {
        let soup = Soup {
            positions: &self.positions,
            normals: &self.normals,
            uvs: &self.uvs,
        };
        mikktspace::generate(&soup).expect("no group is too wide")
    }

    fn reference(&mut self) -> Vec<[f32; 4]> {
        self.result = vec![[0.0; 4]; self.positions.len()];
        generate_tangents(self).expect("cannot fail");
        std::mem::take(&mut self.result)
    }

    fn meshopt(&self) -> Vec<[f32; 4]> {
        let options = TangentOptions::Compatible | TangentOptions::ZeroFallback;
        meshopt::generate_tangents(None, &self.positions, &self.normals, &self.uvs, options)
    }
}

struct Column {
    x: f32,
    z: f32,
    u: f32,
    normal: [f32; 3],
}

impl Column {
    fn new(x: f32, mirrors: usize) -> Self {
        let slope = 0.9 * libm::cosf(9.0 * x);
        let length = (1.0 + slope * slope).sqrt();
        let folded = x * (mirrors + 1) as f32;
        let part = folded.floor();
        let u = folded - part;
        Self {
            x,
            z: 0.1 * libm::sinf(9.0 * x),
            u: if (part as usize).is_multiple_of(2) {
                u
            } else {
                1.0 - u
            },
            normal: [-slope / length, 0.0, 1.0 / length],
        }
    }
}

/// Seconds that this thread has run, where Linux tells, else of the wall clock: other work on the machine does not
/// count.
fn clock(start: Instant) -> f64 {
    let run = fs::read_to_string("/proc/thread-self/schedstat").ok();
    let nanoseconds = run.and_then(|text| text.split(' ').next()?.parse::<f64>().ok());
    nanoseconds.map_or_else(
        || start.elapsed().as_secs_f64(),
        |nanoseconds| nanoseconds * 1e-9,
    )
}

/// Median seconds and the last result.
fn time(runs: usize, mut run: impl FnMut() -> Vec<[f32; 4]>) -> (f64, Vec<[f32; 4]>) {
    let (mut seconds, mut result) = (Vec::new(), Vec::new());
    for _ in 0..runs {
        drop(std::mem::take(&mut result));
        let origin = Instant::now();
        let start = clock(origin);
        result = run();
        seconds.push(clock(origin) - start);
    }
    seconds.sort_by(f64::total_cmp);
    (seconds[seconds.len() / 2], result)
}

/// Percentage of corners with equal bits, and the largest angle in degrees where both have a tangent.
fn compare(ours: &[[f32; 4]], reference: &[[f32; 4]]) -> (f64, f64) {
    let (mut equal, mut largest) = (0usize, 0.0f64);
    for (a, b) in ours.iter().zip(reference) {
        if a.map(f32::to_bits) == b.map(f32::to_bits) {
            equal += 1;
        } else if a[3] != 0.0 && b[3] != 0.0 {
            let wide = |v: &[f32; 4]| [v[0], v[1], v[2]].map(f64::from);
            let (a, b) = (wide(a), wide(b));
            let dot = |p: [f64; 3], q: [f64; 3]| p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
            let cosine = dot(a, b) / (dot(a, a) * dot(b, b)).sqrt();
            largest = largest.max(libm::acos(cosine.clamp(-1.0, 1.0)).to_degrees());
        }
    }
    (100.0 * equal as f64 / ours.len() as f64, largest)
}

fn report(name: &str, mut mesh: Mesh, with_reference: bool) {
    let millions = mesh.triangles() as f64 / 1e6;
    let row = |who: &str, seconds: f64, exactness: Option<(f64, f64)>| {
        let exactness = exactness.map_or("- | -".into(), |(equal, angle)| {
            format!("{equal:.2} | {angle:.4}")
        });
        let speed = millions / seconds;
        let speed = if seconds > 0.0 {
            format!("{speed:.2}")
        } else {
            "below resolution".to_owned()
        };
        println!("| {name} | {who} | {seconds:.3} | {speed} | {exactness} |");
    };
    let reference = with_reference.then(|| time(1, || mesh.reference()));
    let against = |tangents: &[[f32; 4]]| {
        let (_, reference) = reference.as_ref()?;
        Some(compare(tangents, reference))
    };
    let (seconds, tangents) = time(RUNS, || mesh.ours());
    row("ours", seconds, against(&tangents));
    match &reference {
        Some((seconds, tangents)) => row("bevy_mikktspace", *seconds, against(tangents)),
        None => println!(
            "| {name} | bevy_mikktspace | not run: quadratic in degenerate triangles | | | |"
        ),
    }
    let (seconds, tangents) = time(RUNS, || mesh.meshopt());
    row("meshopt, compatible", seconds, against(&tangents));
}

fn main() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    pool.expect("a pool of one thread").install(|| {
        println!("| mesh | by | CPU s | Mtri/s | % bit-equal | max angle, degrees |");
        println!("|---|---|---|---|---|---|");
        report("clean, 2 M", Mesh::sheet(1000, 0), true);
        report("mirrored seams, 2 M", Mesh::sheet(1000, 7), true);
        report(
            "30 % degenerate, 20 k",
            Mesh::sheet(100, 7).collapse(),
            true,
        );
        report(
            "30 % degenerate, 1 M",
            Mesh::sheet(707, 7).collapse(),
            false,
        );
        report(
            "30 % degenerate, 2 M",
            Mesh::sheet(1000, 7).collapse(),
            false,
        );
    });
}
