//! Tangents by MikkTSpace, with an orthonormal stand-in where it gives none.

use bevy_mikktspace::{Geometry, Ops, TangentSpace, generate_tangents};
use glam::DVec3;

use super::weld::Welder;

/// Most corners that may share one position, normal and texture coordinate: MikkTSpace takes quadratic time in
/// them, and far fewer would mean minutes.
pub(super) const MAX_SHARED_CORNERS: u32 = 1 << 15;

/// MikkTSpace recurses once per triangle around a vertex; more than a frame of it takes in any build.
const RECURSION_BYTES: usize = 1024;
/// What a thread of a pool spares for the recursion.
const POOL_STACK_BYTES: usize = 1 << 20;

/// Tangents shorter than this have no usable direction.
const MIN_LENGTH: f64 = 1e-6;
/// Tangents whose sine with the normal is smaller span no plane with it.
const MIN_SINE: f64 = 1e-3;

/// A triangle list as MikkTSpace sees it: corner `c` belongs to triangle `c / 3`. All numbers are finite.
pub(super) trait Corners: Sync {
    /// Corners, a multiple of three.
    fn count(&self) -> usize;
    /// Position.
    fn position(&self, corner: usize) -> [f32; 3];
    /// Normal.
    fn normal(&self, corner: usize) -> [f32; 3];
    /// Coordinates of the normal map, as glTF stores them.
    fn uv(&self, corner: usize) -> [f32; 2];
}

/// The tangent of every corner, w +1 or -1 in glTF's sense, and how many are stand-ins.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Generated {
    pub(super) tangents: Vec<[f32; 4]>,
    pub(super) fallbacks: u64,
}

/// Runs MikkTSpace on the unindexed triangles (Mikkelsen 2008), bit for bit, with w negated: glTF's V points down.
///
/// The time of MikkTSpace is quadratic in triangles with two equal corner positions. They are left out, which
/// changes no other corner, and get what MikkTSpace would have given them: the tangent of the first corner of
/// equal position, normal and texture coordinate.
///
/// `None` where more than [`MAX_SHARED_CORNERS`] corners are alike.
pub(super) fn generate(corners: &dyn Corners) -> Option<Generated> {
    let faces = sound_faces(corners);
    let (numbers, distinct) = number_corners(corners);
    let mut sharing = vec![0u32; distinct];
    for corner in faces.iter().flat_map(|face| corners_of(*face)) {
        sharing[numbers[corner] as usize] += 1;
    }
    let most = sharing.iter().copied().max().unwrap_or(0);
    if most > MAX_SHARED_CORNERS {
        return None;
    }
    let mut tangents = run(corners, &faces, most);
    if faces.len() * 3 < tangents.len() {
        inherit(&mut tangents, &faces, &numbers, distinct);
    }
    let mut fallbacks = 0;
    for (corner, tangent) in tangents.iter_mut().enumerate() {
        let normal = corners.normal(corner);
        if !usable(normal, *tangent) {
            *tangent = fallback(normal);
            fallbacks += 1;
        }
    }
    Some(Generated {
        tangents,
        fallbacks,
    })
}

/// An authored tangent with w snapped to +1 or -1, or a stand-in where it is unusable, and whether it is one.
pub(super) fn authored(normal: [f32; 3], tangent: [f32; 4]) -> ([f32; 4], bool) {
    if !usable(normal, tangent) {
        return (fallback(normal), true);
    }
    let [x, y, z, w] = tangent;
    ([x, y, z, if w < 0.0 { -1.0 } else { 1.0 }], false)
}

/// A unit tangent orthogonal to `normal` (Duff et al. 2017), which may have any length, with w = 1.
pub(super) fn fallback(normal: [f32; 3]) -> [f32; 4] {
    let normal = DVec3::from(normal.map(f64::from));
    let length = normal.length();
    if length == 0.0 {
        return [1.0, 0.0, 0.0, 1.0];
    }
    let n = normal / length;
    let sign = if n.z < 0.0 { -1.0 } else { 1.0 };
    let a = -1.0 / (sign + n.z);
    let tangent = DVec3::new(
        1.0 + sign * n.x * n.x * a,
        sign * n.x * n.y * a,
        -sign * n.x,
    );
    tangent.as_vec3().extend(1.0).to_array()
}

/// Sine of the angle between `tangent` and the plane of `normal`; 0 without a normal.
pub(super) fn tilt(normal: [f32; 3], tangent: [f32; 4]) -> f64 {
    let (n, t) = (widened(normal), direction(tangent));
    let lengths = n.length() * t.length();
    if lengths > 0.0 {
        (n.dot(t) / lengths).abs()
    } else {
        0.0
    }
}

fn widened(vector: [f32; 3]) -> DVec3 {
    DVec3::from(vector.map(f64::from))
}

fn direction([x, y, z, _]: [f32; 4]) -> DVec3 {
    widened([x, y, z])
}

/// Whether `tangent` spans a plane with `normal`; a zero normal spans none, and any direction will do.
fn usable(normal: [f32; 3], tangent: [f32; 4]) -> bool {
    let (n, t) = (widened(normal), direction(tangent));
    let lengths = n.length() * t.length();
    t.is_finite()
        && t.length() >= MIN_LENGTH
        && (lengths == 0.0 || n.cross(t).length() >= MIN_SINE * lengths)
}

fn corners_of(face: u32) -> [usize; 3] {
    [0, 1, 2].map(|vertex| face as usize * 3 + vertex)
}

/// Triangles whose corner positions differ from each other.
fn sound_faces(corners: &dyn Corners) -> Vec<u32> {
    let faces = 0..(corners.count() / 3) as u32;
    faces
        .filter(|face| {
            let [a, b, c] = corners_of(*face).map(|corner| corners.position(corner));
            a != b && b != c && c != a
        })
        .collect()
}

/// A number for every corner, equal where MikkTSpace holds the corners equal, and how many there are.
fn number_corners(corners: &dyn Corners) -> (Vec<u32>, usize) {
    let mut welder = Welder::new();
    // MikkTSpace compares floats: adding zero makes the two zeros one.
    let bits = |value: f32| (value + 0.0).to_bits();
    let numbers = (0..corners.count())
        .map(|corner| {
            let [x, y, z] = corners.position(corner).map(bits);
            let [nx, ny, nz] = corners.normal(corner).map(bits);
            let [u, v] = corners.uv(corner).map(bits);
            welder.add([x, y, z, nx, ny, nz, u, v])
        })
        .collect();
    (numbers, welder.into_values().len())
}

/// Gives corners outside `faces` the tangent of the first corner inside that is their equal.
fn inherit(tangents: &mut [[f32; 4]], faces: &[u32], numbers: &[u32], distinct: usize) {
    const NONE: u32 = u32::MAX;
    let mut first = vec![NONE; distinct];
    let mut sound = vec![false; tangents.len() / 3];
    for face in faces {
        sound[*face as usize] = true;
        for corner in corners_of(*face) {
            let first = &mut first[numbers[corner] as usize];
            if *first == NONE {
                *first = corner as u32;
            }
        }
    }
    for corner in (0..tangents.len()).filter(|corner| !sound[corner / 3]) {
        let source = first[numbers[corner] as usize];
        if source != NONE {
            tangents[corner] = tangents[source as usize];
        }
    }
}

/// Tangents of the corners of `faces`; zero elsewhere, and where MikkTSpace has none.
fn run(corners: &dyn Corners, faces: &[u32], most: u32) -> Vec<[f32; 4]> {
    let mut soup = Soup {
        corners,
        faces,
        tangents: vec![[0.0; 4]; corners.count()],
    };
    let stack = most as usize * RECURSION_BYTES;
    if stack <= POOL_STACK_BYTES {
        soup.generate();
        return soup.tangents;
    }
    std::thread::scope(|scope| {
        let builder = std::thread::Builder::new().stack_size(stack + POOL_STACK_BYTES);
        match builder.spawn_scoped(scope, || soup.generate()) {
            Ok(thread) => match thread.join() {
                Ok(()) => (),
                Err(panic) => std::panic::resume_unwind(panic),
            },
            Err(error) => panic!("no thread with {stack} bytes of stack: {error}"),
        }
    });
    soup.tangents
}

struct Soup<'a> {
    corners: &'a dyn Corners,
    faces: &'a [u32],
    tangents: Vec<[f32; 4]>,
}

impl Soup<'_> {
    fn corner(&self, face: usize, vertex: usize) -> usize {
        self.faces[face] as usize * 3 + vertex
    }
}

impl Soup<'_> {
    fn generate(&mut self) {
        // The error type has no values.
        let done = generate_tangents(self);
        debug_assert!(done.is_ok());
    }
}

/// Arc cosine of `libm`, so that every platform gives the same bits; it is evaluated in f64 as the reference does.
struct PortableOps;

impl Ops for PortableOps {
    fn sqrt(x: f32) -> f32 {
        x.sqrt()
    }

    fn acos(x: f32) -> f32 {
        libm::acos(x.into()) as f32
    }
}

impl Geometry<PortableOps> for Soup<'_> {
    fn num_faces(&self) -> usize {
        self.faces.len()
    }

    fn num_vertices_of_face(&self, _face: usize) -> usize {
        3
    }

    fn position(&self, face: usize, vertex: usize) -> [f32; 3] {
        self.corners.position(self.corner(face, vertex))
    }

    fn normal(&self, face: usize, vertex: usize) -> [f32; 3] {
        self.corners.normal(self.corner(face, vertex))
    }

    fn tex_coord(&self, face: usize, vertex: usize) -> [f32; 2] {
        self.corners.uv(self.corner(face, vertex))
    }

    fn set_tangent(&mut self, space: Option<TangentSpace>, face: usize, vertex: usize) {
        let corner = self.corner(face, vertex);
        if let Some([x, y, z, w]) = space.map(|space| space.tangent_encoded()) {
            self.tangents[corner] = [x, y, z, -w];
        }
    }
}

#[cfg(test)]
#[path = "tangents_tests.rs"]
mod tests;
