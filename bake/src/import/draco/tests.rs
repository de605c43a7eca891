//! Tests of the Draco primitives.

use draco_core::{
    EncoderBuffer, EncoderOptions, FaceIndex, GeometryAttributeType, MeshEncoder, PointAttribute,
};

use super::*;
use crate::import::mesh::{self, Pose};
use crate::import::testing::{context, data_uri, fault};

const SIDE: usize = 5;

fn grid_positions() -> Vec<[f32; 3]> {
    let at = |i: usize| [(i % SIDE) as f32, (i / SIDE) as f32, (i % 3) as f32 * 0.25];
    (0..SIDE * SIDE).map(at).collect()
}

fn grid_faces() -> Vec<[u32; 3]> {
    let corner = |x: usize, y: usize| (y * SIDE + x) as u32;
    (0..SIDE - 1)
        .flat_map(|y| (0..SIDE - 1).map(move |x| (x, y)))
        .flat_map(|(x, y)| {
            let [a, b] = [corner(x, y), corner(x + 1, y)];
            let [c, d] = [corner(x, y + 1), corner(x + 1, y + 1)];
            [[a, b, c], [b, d, c]]
        })
        .collect()
}

/// A grid with positions (identifier 0) and colours of bytes (identifier 1).
fn encoded() -> Vec<u8> {
    let points = SIDE * SIDE;
    let mut mesh = Mesh::new();
    mesh.set_num_points(points);
    let mut position = PointAttribute::new();
    let float = DataType::Float32;
    position.init(GeometryAttributeType::Position, 3, float, false, points);
    for (index, value) in grid_positions().iter().enumerate() {
        let bytes: Vec<u8> = value.iter().flat_map(|v| v.to_le_bytes()).collect();
        position.buffer_mut().write(index * 12, &bytes);
    }
    mesh.add_attribute(position);
    let mut color = PointAttribute::new();
    let byte = DataType::Uint8;
    color.init(GeometryAttributeType::Color, 4, byte, true, points);
    for index in 0..points {
        color
            .buffer_mut()
            .write(index * 4, &[index as u8, 0, 255, 51]);
    }
    mesh.add_attribute(color);
    let faces = grid_faces();
    mesh.set_num_faces(faces.len());
    for (index, face) in faces.iter().enumerate() {
        mesh.set_face(FaceIndex(index as u32), face.map(PointIndex));
    }
    let mut buffer = EncoderBuffer::new();
    let mut encoder = MeshEncoder::new();
    encoder.set_mesh(mesh);
    encoder.encode(&EncoderOptions::new(), &mut buffer).unwrap();
    buffer.data().to_vec()
}

/// A primitive of `bytes`; accessor 0 declares `vertices` and 1 declares `indices`.
fn scene(bytes: &[u8], vertices: usize, indices: usize, attributes: &str) -> Context {
    context(&format!(
        r#""buffers":[{{"byteLength":{0},"uri":"{1}"}}],"bufferViews":[{{"buffer":0,"byteLength":{0}}}],
        "accessors":[{{"componentType":5126,"type":"VEC3","count":{vertices}}},
            {{"componentType":5125,"type":"SCALAR","count":{indices}}},
            {{"componentType":5121,"normalized":true,"type":"VEC4","count":{vertices}}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"COLOR_0":2,"NORMAL":0}},"indices":1,
            "extensions":{{"KHR_draco_mesh_compression":{{"bufferView":0,"attributes":{attributes}}}}}}}]}}]"#,
        bytes.len(),
        data_uri(bytes),
    ))
}

const BOTH: &str = r#"{"POSITION":0,"COLOR_0":1}"#;
const POINTS: usize = SIDE * SIDE;
const CORNERS: usize = (SIDE - 1) * (SIDE - 1) * 6;

fn read(bytes: &[u8], attributes: &str) -> Result<crate::scene::Mesh> {
    let context = scene(bytes, POINTS, CORNERS, attributes);
    mesh::read(&context, 0, &Pose::default())
}

#[test]
fn a_grid_is_decoded_with_its_attributes() {
    let mesh = read(&encoded(), BOTH).unwrap();
    let primitive = &mesh.primitives[0];
    // The encoder may renumber points and rotate triangles, so they are compared as sets.
    let key = |p: [f32; 3]| p.map(|v| (v * 4.0).round() as i32);
    let canonical = |mut corners: [[i32; 3]; 3]| {
        let least = (0..3).min_by_key(|&i| corners[i]).unwrap();
        corners.rotate_left(least);
        corners
    };
    let positions = grid_positions();
    let mut expected: Vec<_> = grid_faces()
        .iter()
        .map(|face| canonical(face.map(|i| key(positions[i as usize]))))
        .collect();
    let (faces, _) = primitive.indices.as_chunks::<3>();
    let mut found: Vec<_> = faces
        .iter()
        .map(|face| canonical(face.map(|i| key(primitive.positions[i as usize]))))
        .collect();
    expected.sort();
    found.sort();
    assert_eq!(found, expected);
    let colors = primitive.colors.as_ref().unwrap();
    for (position, color) in primitive.positions.iter().zip(colors) {
        let at = positions
            .iter()
            .position(|p| key(*p) == key(*position))
            .unwrap();
        assert_eq!(*color, [at as f32 / 255.0, 0.0, 1.0, 0.2]);
    }
    // NORMAL is not compressed: its accessor has no view, so it is zeros.
    assert_eq!(primitive.normals.as_ref().unwrap()[0], [0.0; 3]);
}

#[test]
fn declarations_that_disagree_are_refused() {
    let bytes = encoded();
    let counts = |vertices, indices| {
        let context = scene(&bytes, vertices, indices, BOTH);
        fault(mesh::read(&context, 0, &Pose::default())).code
    };
    assert_eq!(counts(POINTS + 1, CORNERS), "draco-count");
    assert_eq!(counts(POINTS, CORNERS - 3), "draco-count");
    assert_eq!(counts(usize::MAX, CORNERS), "draco-count");
    let code = |attributes| fault(read(&bytes, attributes)).code;
    assert_eq!(code(r#"{"POSITION":7}"#), "draco-attribute");
    assert_eq!(code(r#"{"POSITION":1}"#), "draco-attribute");
    assert_eq!(code(r#"{"POSITION":"a"}"#), "extension-schema");
}

#[test]
fn damaged_data_never_panics() {
    let bytes = encoded();
    for length in 0..bytes.len() {
        let error = fault(read(&bytes[..length], BOTH));
        assert!(error.code.starts_with("draco"), "{error}");
    }
    let mut survived = 0;
    for position in 0..bytes.len() {
        for flip in [1, 0x80, 0xff] {
            let mut bytes = bytes.clone();
            bytes[position] ^= flip;
            survived += u32::from(read(&bytes, BOTH).is_ok());
        }
    }
    assert!(survived < 3 * bytes.len() as u32);
}

#[test]
fn a_panic_of_the_decoder_is_an_error() {
    let error = guarded(|| panic!("for the test")).map(|_| ());
    assert_eq!(error, Err("the decoder failed".into()));
}
