//! Tests of the mesh reader.

use super::*;
use crate::import::testing::{context, data_uri, fault};

/// The mesh in its base shape.
fn read(context: &Context, index: u32) -> Result<Mesh> {
    super::read(context, index, &Pose::default())
}

/// One mesh over a buffer of floats followed by `tail`; accessor 0 holds `vertices` VEC3.
fn scene(floats: &[f32], tail: &[u8], accessors: &str, primitives: &str) -> Context {
    let mut bytes: Vec<u8> = floats.iter().flat_map(|v| v.to_le_bytes()).collect();
    let split = bytes.len();
    bytes.extend(tail);
    context(&format!(
        r#""buffers":[{{"byteLength":{},"uri":"{}"}}],
        "bufferViews":[{{"buffer":0,"byteLength":{split}}},
            {{"buffer":0,"byteOffset":{split},"byteLength":{}}}],
        "accessors":[{accessors}],"meshes":[{{"primitives":[{primitives}]}}]"#,
        bytes.len(),
        data_uri(&bytes),
        tail.len(),
    ))
}

const TRIANGLE: [f32; 9] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
const POSITIONS: &str = r#"{"bufferView":0,"componentType":5126,"type":"VEC3","count":3}"#;
const PLAIN: &str = r#"{"attributes":{"POSITION":0}}"#;
const INDEXED: &str = r#"{"attributes":{"POSITION":0},"indices":1}"#;

fn indexed(component: u32, count: usize, tail: &[u8]) -> Result<Mesh> {
    let accessors = format!(
        r#"{POSITIONS},{{"bufferView":1,"componentType":{component},"type":"SCALAR","count":{count}}}"#
    );
    read(&scene(&TRIANGLE, tail, &accessors, INDEXED), 0)
}

fn warnings(context: Context) -> Vec<&'static str> {
    context
        .finish()
        .1
        .iter()
        .map(|warning| warning.code)
        .collect()
}

#[test]
fn triangles_are_read_with_and_without_indices() {
    let mesh = read(&scene(&TRIANGLE, &[], POSITIONS, PLAIN), 0).unwrap();
    assert_eq!(mesh.primitives[0].indices, [0, 1, 2]);
    assert_eq!(mesh.primitives[0].positions[1], [1.0, 0.0, 0.0]);
    let mesh = indexed(5121, 3, &[2, 1, 0]).unwrap();
    assert_eq!(mesh.primitives[0].indices, [2, 1, 0]);
    let mesh = indexed(5123, 3, &[2, 0, 1, 0, 0, 0]).unwrap();
    assert_eq!(mesh.primitives[0].indices, [2, 1, 0]);
}

#[test]
fn bad_indices_are_refused() {
    let error = fault(indexed(5121, 3, &[0, 1, 3]));
    assert_eq!(
        (error.code, error.place.as_str()),
        ("index-out-of-range", "/accessors/1")
    );
    assert!(error.message.contains("index 2 is 3"), "{}", error.message);
    for (component, tail) in [
        (5121, &[0, 1, 0xff][..]),
        (5123, &[0, 0, 1, 0, 0xff, 0xff]),
        (5125, &[0, 0, 0, 0, 1, 0, 0, 0, 0xff, 0xff, 0xff, 0xff]),
    ] {
        assert_eq!(fault(indexed(component, 3, tail)).code, "index-restart");
    }
    assert_eq!(fault(indexed(5121, 2, &[0, 1])).code, "index-count");
    let four = POSITIONS.replace("\"count\":3", "\"count\":4");
    let context = scene(&[0.0; 12], &[], &four, PLAIN);
    assert_eq!(fault(read(&context, 0)).code, "index-count");
}

#[test]
fn non_finite_values_are_refused_in_positions_and_zeroed_elsewhere() {
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let mut floats = TRIANGLE;
        floats[4] = bad;
        let error = fault(read(&scene(&floats, &[], POSITIONS, PLAIN), 0));
        assert_eq!(error.code, "non-finite-position");
        assert!(error.message.contains("position 1 "));
    }
    let mut floats = [TRIANGLE, TRIANGLE].concat();
    floats[9] = f32::NAN;
    floats[13] = f32::INFINITY;
    let normals = POSITIONS.replace("\"count\"", "\"byteOffset\":36,\"count\"");
    let primitive = r#"{"attributes":{"POSITION":0,"NORMAL":1}}"#;
    let context = scene(&floats, &[], &format!("{POSITIONS},{normals}"), primitive);
    let mesh = read(&context, 0).unwrap();
    assert_eq!(
        mesh.primitives[0].normals.as_ref().unwrap()[..2],
        [[0.0; 3], [1.0, 0.0, 0.0]]
    );
    let (_, diagnostics) = context.finish();
    assert!(
        diagnostics[0]
            .message
            .starts_with("2 non-finite values of NORMAL")
    );
}

#[test]
fn points_and_lines_are_skipped_and_counted() {
    let modes =
        [0, 1, 2, 3, 1].map(|mode| format!(r#"{{"attributes":{{"POSITION":0}},"mode":{mode}}}"#));
    let context = scene(&TRIANGLE, &[], POSITIONS, &modes.join(","));
    assert!(read(&context, 0).unwrap().primitives.is_empty());
    let (_, diagnostics) = context.finish();
    assert_eq!(diagnostics.len(), 4);
    assert!(
        diagnostics[1].message.contains("the first of 2"),
        "{}",
        diagnostics[1]
    );
    let context = scene(
        &TRIANGLE,
        &[],
        POSITIONS,
        r#"{"attributes":{"POSITION":0},"mode":7}"#,
    );
    assert_eq!(fault(read(&context, 0)).code, "primitive-mode");
}

/// The indices of a primitive of five positions in a mode, with indices where `tail` has some.
fn corners(mode: u32, positions: usize, tail: &[u8]) -> (Result<Mesh>, Vec<&'static str>) {
    let accessors = format!(
        r#"{{"bufferView":0,"componentType":5126,"type":"VEC3","count":{positions}}},
        {{"bufferView":1,"componentType":5121,"type":"SCALAR","count":{}}}"#,
        tail.len()
    );
    let indices = if tail.is_empty() {
        ""
    } else {
        r#","indices":1"#
    };
    let primitive = format!(r#"{{"attributes":{{"POSITION":0}},"mode":{mode}{indices}}}"#);
    let context = scene(&[0.5; 15], tail, &accessors, &primitive);
    (read(&context, 0), warnings(context))
}

#[test]
fn strips_and_fans_become_lists() {
    let list = |mode, positions, tail: &[u8]| {
        let (mesh, warnings) = corners(mode, positions, tail);
        (mesh.unwrap().primitives[0].indices.clone(), warnings)
    };
    let stitched = vec!["degenerate-triangles"];
    assert_eq!(list(5, 4, &[]), (vec![0, 1, 2, 1, 3, 2], vec![]));
    assert_eq!(list(6, 4, &[]), (vec![1, 2, 0, 2, 3, 0], vec![]));
    assert_eq!(list(5, 5, &[4, 2, 3, 1]), (vec![4, 2, 3, 2, 1, 3], vec![]));
    assert_eq!(list(6, 5, &[4, 2, 3, 1]), (vec![2, 3, 4, 3, 1, 4], vec![]));
    assert_eq!(
        list(5, 5, &[0, 1, 2, 2]),
        (vec![0, 1, 2, 1, 2, 2], stitched)
    );
}

#[test]
fn short_strips_are_dropped_and_bad_ones_refused() {
    for (mode, positions, tail) in [(5, 2, &[][..]), (6, 1, &[]), (5, 5, &[0, 1])] {
        let (mesh, warnings) = corners(mode, positions, tail);
        assert!(mesh.unwrap().primitives.is_empty());
        assert_eq!(warnings, ["primitive-empty"]);
    }
    assert_eq!(
        fault(corners(5, 5, &[0, 1, 2, 5]).0).code,
        "index-out-of-range"
    );
    assert_eq!(
        fault(corners(6, 5, &[0, 1, 2, 255]).0).code,
        "index-restart"
    );
}

#[test]
fn empty_and_shapeless_primitives_are_dropped() {
    let none = POSITIONS.replace("\"count\":3", "\"count\":0");
    let primitives = format!(r#"{PLAIN},{{"attributes":{{}}}}"#);
    let context = scene(&TRIANGLE, &[], &none, &primitives);
    assert!(read(&context, 0).unwrap().primitives.is_empty());
    assert_eq!(
        warnings(context),
        ["primitive-empty", "primitive-without-position"]
    );
    assert!(indexed(5121, 0, &[]).unwrap().primitives.is_empty());
}

#[test]
fn attribute_faults_are_refused() {
    let code = |accessor: &str, semantic: &str| {
        let primitive = format!(r#"{{"attributes":{{"POSITION":0,"{semantic}":1}}}}"#);
        let accessors = format!("{POSITIONS},{accessor}");
        fault(read(&scene(&TRIANGLE, &[], &accessors, &primitive), 0)).code
    };
    let two = r#"{"componentType":5126,"type":"VEC3","count":2}"#;
    assert_eq!(code(two, "NORMAL"), "attribute-count");
    let short = r#"{"componentType":5122,"type":"VEC3","count":3,"normalized":true}"#;
    assert_eq!(code(short, "NORMAL"), "accessor-type");
    let plain = r#"{"componentType":5121,"type":"VEC2","count":3}"#;
    assert_eq!(code(plain, "TEXCOORD_0"), "accessor-type");
    let vec2 = POSITIONS.replace("VEC3", "VEC2");
    assert_eq!(
        fault(read(&scene(&TRIANGLE, &[], &vec2, PLAIN), 0)).code,
        "accessor-type"
    );
    let material = r#"{"attributes":{"POSITION":0},"material":4}"#;
    let context = scene(&TRIANGLE, &[], POSITIONS, material);
    assert_eq!(
        fault(read(&context, 0)).place,
        "/meshes/0/primitives/0/material"
    );
}

#[test]
fn ignored_features_are_warned_of_once() {
    let primitive = r#"{"attributes":{"POSITION":0,"COLOR_1":9},"targets":[{"POSITION":9}]}"#;
    let context = scene(
        &TRIANGLE,
        &[],
        POSITIONS,
        &format!("{primitive},{primitive}"),
    );
    assert_eq!(read(&context, 0).unwrap().primitives.len(), 2);
    assert_eq!(
        warnings(context),
        ["vertex-color-ignored", "morph-target-static"]
    );
}

/// The colours of a triangle, with the codes of the warnings.
fn colors(floats: &[f32], tail: &[u8], accessor: &str) -> (Vec<[f32; 4]>, Vec<&'static str>) {
    let floats = [&TRIANGLE, floats].concat();
    let primitive = r#"{"attributes":{"POSITION":0,"COLOR_0":1}}"#;
    let context = scene(&floats, tail, &format!("{POSITIONS},{accessor}"), primitive);
    let mesh = read(&context, 0).unwrap();
    (
        mesh.primitives[0].colors.clone().unwrap(),
        warnings(context),
    )
}

#[test]
fn colors_of_every_type_are_read() {
    let bytes = [255, 0, 51, 9, 0, 255, 0, 9, 0, 0, 255, 9];
    let (read, _) = colors(
        &[],
        &bytes,
        r#"{"bufferView":1,"componentType":5121,"normalized":true,"type":"VEC4","count":3}"#,
    );
    assert_eq!(read[0], [1.0, 0.0, 0.2, 9.0 / 255.0]);
    let shorts: Vec<u8> = [65535u16, 0, 13107, 0, 0, 0, 0, 0, 0]
        .iter()
        .flat_map(|v| v.to_le_bytes())
        .collect();
    let (read, _) = colors(
        &[],
        &shorts,
        r#"{"bufferView":1,"componentType":5123,"normalized":true,"type":"VEC3","count":3}"#,
    );
    assert_eq!(read[..2], [[1.0, 0.0, 0.2, 1.0], [0.0, 0.0, 0.0, 1.0]]);
    let floats = [0.25, 1.5, -0.5, f32::NAN, 1.0, 0.0, 0.0, 0.0, 0.0];
    let (read, warned) = colors(
        &floats,
        &[],
        r#"{"bufferView":0,"byteOffset":36,"componentType":5126,"type":"VEC3","count":3}"#,
    );
    assert_eq!(read[..2], [[0.25, 1.0, 0.0, 1.0], [0.0, 1.0, 0.0, 1.0]]);
    assert_eq!(warned, ["non-finite-attribute", "vertex-color-range"]);
}

#[test]
fn the_sets_that_a_material_uses_are_loaded() {
    let mut floats = TRIANGLE.to_vec();
    floats.extend((0..12).map(|value| value as f32));
    let mut bytes: Vec<u8> = floats.iter().flat_map(|v| v.to_le_bytes()).collect();
    bytes.resize(floats.len() * 4, 0);
    let texture = |set: u32| format!(r#"{{"index":0,"texCoord":{set}}}"#);
    let context = context(&format!(
        r#""buffers":[{{"byteLength":84,"uri":"{}"}}],"bufferViews":[{{"buffer":0,"byteLength":84}}],
        "accessors":[{POSITIONS},
            {{"bufferView":0,"byteOffset":36,"componentType":5126,"type":"VEC2","count":3}},
            {{"bufferView":0,"byteOffset":60,"componentType":5126,"type":"VEC2","count":3}}],
        "textures":[{{}}],
        "materials":[{{"emissiveTexture":{}}},{{"emissiveTexture":{},"normalTexture":{}}},{{}}],
        "meshes":[{{"primitives":[{}]}}]"#,
        data_uri(&bytes),
        texture(4),
        texture(4),
        texture(2),
        [0, 1, 2]
            .map(|material| format!(
                r#"{{"attributes":{{"POSITION":0,"TEXCOORD_2":1,"TEXCOORD_4":2}},"material":{material}}}"#
            ))
            .join(",")
    ));
    let mesh = read(&context, 0).unwrap();
    let sets: Vec<_> = mesh
        .primitives
        .iter()
        .map(|p| [&p.uv0, &p.uv1].map(|uv| uv.as_ref().map(|uv| uv[0])))
        .collect();
    let (second, fourth) = (Some([0.0, 1.0]), Some([6.0, 7.0]));
    assert_eq!(sets, [[fourth, None], [second, fourth], [None, None]]);
}

#[test]
fn morph_weights_displace_the_base_shape() {
    let up: Vec<f32> = [[0.0f32, 0.0, 1.0]; 3].concat();
    let floats = [
        &TRIANGLE[..],
        &up,
        &[1.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 4.0],
    ]
    .concat();
    let at = |offset: usize| {
        POSITIONS.replace("\"count\"", &format!("\"byteOffset\":{offset},\"count\""))
    };
    let accessors = format!("{POSITIONS},{},{}", at(36), at(72));
    let primitive = r#"{"attributes":{"POSITION":0,"NORMAL":1},
        "targets":[{"POSITION":1},{"POSITION":2,"NORMAL":2}]}"#;
    let posed = |weights: &[f32]| {
        let pose = Pose {
            weights: weights.to_vec(),
            joints: None,
        };
        let context = scene(&floats, &[], &accessors, primitive);
        let mesh = super::read(&context, 0, &pose).unwrap();
        let normals = mesh.primitives[0].normals.clone().unwrap();
        (mesh.primitives[0].positions.clone(), normals[0])
    };
    let half = 0.5f32.sqrt();
    assert_eq!(posed(&[]).0, [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    let (positions, normal) = posed(&[0.5, 1.0]);
    assert_eq!(
        positions,
        [[1.0, 0.0, 0.5], [1.0, 2.0, 0.5], [0.0, 1.0, 4.5]]
    );
    assert_eq!(normal, [half, 0.0, half]);
    assert_eq!(posed(&[0.0, 1.0]).0[0], [1.0, 0.0, 0.0]);
}

/// A triangle that two joints move: accessors 2 and 3 hold joints and weights.
fn skinned(joints: [u8; 12], weights: [u8; 12]) -> Context {
    let mut floats = TRIANGLE.to_vec();
    floats.extend([[0.0f32, 0.0, 1.0]; 3].concat());
    let tail = [joints, weights].concat();
    let accessors = format!(
        r#"{POSITIONS},{},
        {{"bufferView":1,"componentType":5121,"type":"VEC4","count":3}},
        {{"bufferView":1,"byteOffset":12,"componentType":5121,"normalized":true,"type":"VEC4","count":3}}"#,
        POSITIONS.replace("\"count\"", "\"byteOffset\":36,\"count\"")
    );
    let primitive = r#"{"attributes":{"POSITION":0,"NORMAL":1,"JOINTS_0":2,"WEIGHTS_0":3}}"#;
    scene(&floats, &tail, &accessors, primitive)
}

#[test]
fn skins_move_vertices_by_their_joints() {
    let quarter = glam::DMat4::from_rotation_y(std::f64::consts::FRAC_PI_2);
    let pose = Pose {
        weights: vec![],
        joints: Some(vec![
            glam::DMat4::from_translation(glam::DVec3::new(0.0, 0.0, 2.0)),
            quarter,
        ]),
    };
    let joints = [0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0];
    let weights = [255, 0, 0, 0, 255, 0, 0, 0, 51, 51, 0, 0];
    let context = skinned(joints, weights);
    let mesh = super::read(&context, 0, &pose).unwrap();
    let primitive = &mesh.primitives[0];
    let near = |a: [f32; 3], b: [f32; 3]| {
        let far = a.iter().zip(b).any(|(a, b)| (a - b).abs() > 1e-6);
        assert!(!far, "{a:?} {b:?}");
    };
    near(primitive.positions[0], [0.0, 0.0, 2.0]);
    near(primitive.positions[1], [0.0, 0.0, -1.0]);
    // Weights that do not sum to one are normalised.
    near(primitive.positions[2], [0.0, 1.0, 1.0]);
    let normals = primitive.normals.as_ref().unwrap();
    near(normals[0], [0.0, 0.0, 1.0]);
    near(normals[1], [1.0, 0.0, 0.0]);
    let bad = skinned([2; 12], weights);
    assert_eq!(fault(super::read(&bad, 0, &pose)).code, "skin-joint");
    let unweighted = skinned([2; 12], [0; 12]);
    let mesh = super::read(&unweighted, 0, &pose).unwrap();
    assert_eq!(mesh.primitives[0].positions[1], [1.0, 0.0, 0.0]);
}
