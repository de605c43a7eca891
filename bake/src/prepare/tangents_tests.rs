//! Tests of the tangents against MikkTSpace itself.

use std::path::Path;

use bevy_mikktspace::{Geometry, Ops, TangentSpace, generate_tangents};

use super::*;
use crate::import::import;
use crate::prepare::testing::{Random, grid};
use crate::scene::Primitive;

/// The operations of the reference, with an arc cosine that is the same everywhere.
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
#[derive(Clone, Default)]
struct Triangles {
    positions: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
    uvs: Vec<[f32; 2]>,
    result: Vec<Option<[f32; 4]>>,
}

impl Triangles {
    fn of(primitive: &Primitive) -> Self {
        let mut soup = Self::default();
        for index in primitive.indices.iter().map(|index| *index as usize) {
            soup.positions.push(primitive.positions[index]);
            soup.normals
                .push(primitive.normals.as_ref().expect("has normals")[index]);
            soup.uvs
                .push(primitive.uv0.as_ref().expect("has uv0")[index]);
        }
        soup
    }

    /// What the MikkTSpace crate gives, with w turned to glTF's sense.
    fn reference(&self) -> Vec<Option<[f32; 4]>> {
        let mut soup = self.clone();
        soup.result = vec![None; self.positions.len()];
        generate_tangents(&mut soup).expect("cannot fail");
        let turned = |[x, y, z, w]: [f32; 4]| [x, y, z, -w];
        soup.result
            .into_iter()
            .map(|tangent| tangent.map(turned))
            .collect()
    }

    /// Number of corners that have no counterpart in the reference; asserts that all others equal it bit for bit.
    fn assert_equals_reference(&self) -> u64 {
        let generated = generate(self).expect("few corners are shared");
        let mut without = 0;
        for (corner, (ours, theirs)) in generated.tangents.iter().zip(self.reference()).enumerate()
        {
            let normal = self.normals[corner];
            match theirs.filter(|tangent| usable(normal, *tangent)) {
                Some(theirs) => {
                    assert_eq!(ours.map(f32::to_bits), theirs.map(f32::to_bits), "{corner}")
                }
                None => {
                    assert_eq!(*ours, fallback(normal));
                    without += 1;
                }
            }
        }
        assert_eq!(generated.fallbacks, without);
        without
    }
}

impl Corners for Triangles {
    fn count(&self) -> usize {
        self.positions.len()
    }
    fn position(&self, corner: usize) -> [f32; 3] {
        self.positions[corner]
    }
    fn normal(&self, corner: usize) -> [f32; 3] {
        self.normals[corner]
    }
    fn uv(&self, corner: usize) -> [f32; 2] {
        self.uvs[corner]
    }
}

impl Geometry<PortableOps> for Triangles {
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
        self.result[face * 3 + vertex] = space.map(|space| space.tangent_encoded());
    }
}

fn quad(positions: [[f32; 3]; 4], normal: [f32; 3], uvs: [[f32; 2]; 4]) -> Triangles {
    let order = [0, 1, 2, 0, 2, 3];
    Triangles {
        positions: order.map(|index| positions[index]).to_vec(),
        normals: vec![normal; 6],
        uvs: order.map(|index| uvs[index]).to_vec(),
        result: Vec::new(),
    }
}

const CORNERS: [[f32; 3]; 4] = [
    [0.0, 0.0, 0.0],
    [1.0, 0.0, 0.0],
    [1.0, 1.0, 0.0],
    [0.0, 1.0, 0.0],
];
const UVS: [[f32; 2]; 4] = [[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]];

#[test]
fn an_upright_quad_has_w_plus_one() {
    let upright = quad(CORNERS, [0.0, 0.0, 1.0], UVS);
    let generated = generate(&upright).expect("few corners are shared");
    assert_eq!(generated.fallbacks, 0);
    for [x, y, z, w] in generated.tangents {
        assert_eq!([x, y, z, w], [1.0, 0.0, 0.0, 1.0]);
        let bitangent = DVec3::Z.cross(DVec3::new(x.into(), y.into(), z.into())) * f64::from(w);
        assert_eq!(
            bitangent,
            DVec3::Y,
            "up in the texture is the direction of falling v"
        );
    }
}

#[test]
fn a_mirrored_quad_has_w_minus_one() {
    let mirrored = quad(CORNERS, [0.0, 0.0, 1.0], UVS.map(|[u, v]| [1.0 - u, v]));
    let generated = generate(&mirrored).expect("few corners are shared");
    assert!(
        generated
            .tangents
            .iter()
            .all(|tangent| *tangent == [-1.0, 0.0, 0.0, -1.0])
    );
}

#[test]
fn sheets_equal_the_reference() {
    for cells in [1, 7, 40] {
        let mut soup = Triangles::of(&grid(cells));
        assert_eq!(soup.assert_equals_reference(), 0);
        for uv in &mut soup.uvs {
            uv[0] = (uv[0] - 0.3).abs();
        }
        assert_eq!(soup.assert_equals_reference(), 0);
    }
}

/// Triangles over few positions, normals and coordinates, so that many corners are equal and many triangles bad.
fn random_soup(seed: u64, triangles: usize, choices: u64) -> Triangles {
    let mut random = Random(seed);
    let points: Vec<_> = (0..choices)
        .map(|_| random.vector().as_vec3().to_array())
        .collect();
    let normals: Vec<_> = (0..3)
        .map(|_| random.vector().normalize().as_vec3().to_array())
        .collect();
    let mut soup = Triangles::default();
    for _ in 0..triangles * 3 {
        let point = (random.bits() % choices) as usize;
        soup.positions.push(points[point]);
        soup.normals
            .push(normals[(random.bits() % 16 / 14) as usize]);
        let uv = (random.bits() % 8 / 7) as f32;
        soup.uvs.push([points[point][0] + uv, points[point][1]]);
    }
    soup
}

#[test]
fn soups_with_degenerate_triangles_equal_the_reference() {
    let mut without = 0;
    for seed in 0..60 {
        without += random_soup(seed, 120, 6 + seed % 40).assert_equals_reference();
    }
    assert!(without > 0, "some corners must need a stand-in");
}

#[test]
fn degenerate_triangles_change_no_other_corner() {
    let clean = Triangles::of(&grid(12));
    let expected = generate(&clean).expect("few corners are shared").tangents;
    let (mut soup, mut kept) = (Triangles::default(), Vec::new());
    let mut random = Random(5);
    for face in 0..clean.positions.len() / 3 {
        for corner in face * 3..face * 3 + 3 {
            kept.push(soup.positions.len());
            soup.positions.push(clean.positions[corner]);
            soup.normals.push(clean.normals[corner]);
            soup.uvs.push(clean.uvs[corner]);
        }
        if random.bits().is_multiple_of(3) {
            // A needle along one edge of the triangle, and a point with a coordinate of its own.
            let start = face * 3;
            for (corner, uv) in [
                (start, None),
                (start + 1, None),
                (start + 1, Some([9.0, 9.0])),
            ] {
                soup.positions.push(clean.positions[corner]);
                soup.normals.push(clean.normals[corner]);
                soup.uvs.push(uv.unwrap_or(clean.uvs[corner]));
            }
        }
    }
    let generated = generate(&soup).expect("few corners are shared");
    for (corner, kept) in kept.into_iter().enumerate() {
        assert_eq!(generated.tangents[kept], expected[corner]);
    }
    let needles = (soup.positions.len() - clean.positions.len()) / 3;
    assert!(needles > 50);
    assert_eq!(
        generated.fallbacks, needles as u64,
        "only the corner without an equal"
    );
    assert_eq!(soup.assert_equals_reference(), generated.fallbacks);
}

#[test]
fn triangles_without_area_cost_linear_time() {
    let mut soup = Triangles::of(&grid(4));
    for index in 0..300_000u32 {
        soup.positions.push([(index / 3) as f32; 3]);
        soup.normals.push([0.0, 1.0, 0.0]);
        soup.uvs.push([index as f32, 0.0]);
    }
    let generated = generate(&soup).expect("few corners are shared");
    assert_eq!(generated.fallbacks, 300_000);
}

#[test]
fn constant_coordinates_get_the_stand_in() {
    let flat = quad(CORNERS, [0.0, 0.0, 1.0], [[0.5; 2]; 4]);
    let generated = generate(&flat).expect("few corners are shared");
    assert_eq!(generated.fallbacks, 6);
    assert!(
        generated
            .tangents
            .iter()
            .all(|tangent| *tangent == [1.0, 0.0, 0.0, 1.0])
    );
}

#[test]
fn extreme_coordinates_stay_usable() {
    for scale in [1e-30f32, 1e-6, 1e7, 1e30, 3e38] {
        let scaled = CORNERS.map(|corner| corner.map(|value| value * scale));
        let soup = quad(scaled, [0.0, 0.0, 1.0], UVS);
        let generated = generate(&soup).expect("few corners are shared");
        for tangent in generated.tangents {
            assert!(usable([0.0, 0.0, 1.0], tangent) && tangent[3].abs() == 1.0);
        }
    }
    for normal in [[0.0; 3], [0.0, 0.0, 7.0], [1e-20, 0.0, 0.0]] {
        let generated = generate(&quad(CORNERS, normal, UVS)).expect("few corners are shared");
        assert!(
            generated
                .tangents
                .iter()
                .all(|tangent| usable(normal, *tangent))
        );
    }
}

/// Triangles around one corner.
fn fan(count: usize) -> Triangles {
    let rim = |index: usize| {
        let (sin, cos) = libm::sincosf(index as f32 / count as f32 * std::f32::consts::TAU);
        [cos, sin, 0.0]
    };
    let mut soup = Triangles::default();
    for index in 0..count {
        for position in [[0.0; 3], rim(index), rim((index + 1) % count)] {
            soup.positions.push(position);
            soup.normals.push([0.0, 0.0, 1.0]);
            soup.uvs.push([position[0], -position[1]]);
        }
    }
    soup
}

#[test]
fn a_wide_fan_does_not_exhaust_the_stack() {
    let soup = fan(50_000);
    let pool = std::thread::Builder::new().stack_size(2 << 20);
    let thread = pool
        .spawn(move || generate(&soup))
        .expect("a thread starts");
    let generated = thread
        .join()
        .expect("no overflow")
        .expect("within the limit");
    for [x, y, z, w] in generated.tangents {
        assert!((x - 1.0).abs() < 1e-3 && y.abs() < 1e-3 && z == 0.0 && w == 1.0);
    }
}

#[test]
fn authored_tangents_are_kept_unless_unusable() {
    let up = [0.0, 0.0, 1.0];
    assert_eq!(
        authored(up, [0.5, 0.25, 0.0, 0.3]),
        ([0.5, 0.25, 0.0, 1.0], false)
    );
    assert_eq!(
        authored(up, [0.0, 1.0, 0.0, -0.1]),
        ([0.0, 1.0, 0.0, -1.0], false)
    );
    assert_eq!(
        authored(up, [0.0, 1.0, 0.0, 0.0]),
        ([0.0, 1.0, 0.0, 1.0], false)
    );
    assert_eq!(
        authored([0.0; 3], [0.0, 1.0, 0.0, 1.0]),
        ([0.0, 1.0, 0.0, 1.0], false)
    );
    let bad = [
        [0.0; 4],
        [0.0, 0.0, -2.0, 1.0],
        [f32::NAN, 0.0, 0.0, 1.0],
        [1e-8, 0.0, 0.0, 1.0],
    ];
    for tangent in bad {
        assert_eq!(authored(up, tangent), (fallback(up), true));
    }
}

#[test]
fn stand_ins_are_orthonormal() {
    let mut random = Random(3);
    let check = |normal: [f32; 3]| {
        let [x, y, z, w] = fallback(normal);
        let tangent = DVec3::new(x.into(), y.into(), z.into());
        assert!((tangent.length() - 1.0).abs() < 1e-6 && w == 1.0);
        assert!(tilt(normal, [x, y, z, w]) < 1e-6, "{normal:?}");
    };
    for _ in 0..2000 {
        check((random.vector() * 3.0).as_vec3().to_array());
    }
    for normal in [
        [0.0, 0.0, -1.0],
        [0.0, 0.0, 1.0],
        [1e-7, 0.0, -1.0],
        [0.0, -1e-30, 0.0],
        [0.0; 3],
    ] {
        check(normal);
    }
}

#[test]
fn real_meshes_equal_the_reference() {
    let assets = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/assets");
    let mut triangles = 0;
    for name in [
        "khronos/NormalTangentTest/NormalTangentTest.glb",
        "khronos/CompareNormal/CompareNormal.glb",
        "khronos/CesiumMilkTruck-glb/CesiumMilkTruck.glb",
        "khronos/OrientationTest/OrientationTest.glb",
        "renderling/marble_bust_1k/marble_bust_1k.glb",
        "derived/chevrolet-plain-png/chevrolet.glb",
        "realism-effects/chevrolet/chevrolet.optimized.glb",
        "3d-demo-data/dream-apartment/dream-apartment.glb",
        "folio-2025/areas/areas.glb",
    ] {
        let path = assets.join(name);
        if !path.is_file() {
            eprintln!("SKIPPED: {} is absent", path.display());
            continue;
        }
        let scene = match import(&path) {
            Ok(scene) => scene,
            Err(error) => {
                eprintln!("SKIPPED: {} is refused: {error}", path.display());
                continue;
            }
        };
        let primitives = scene.meshes.iter().flat_map(|mesh| &mesh.primitives);
        for primitive in
            primitives.filter(|primitive| primitive.normals.is_some() && primitive.uv0.is_some())
        {
            Triangles::of(primitive).assert_equals_reference();
            triangles += primitive.indices.len() / 3;
        }
    }
    eprintln!("{triangles} triangles of real meshes are equal");
}
