//! Tests of the accessor reader.

use super::*;
use crate::import::testing::{context, data_uri, fault};

/// A scene of one buffer with the given accessors and views.
fn scene(bytes: &[u8], views: &str, accessors: &str) -> Context {
    context(&format!(
        r#""extensionsUsed":["KHR_mesh_quantization"],
        "buffers":[{{"byteLength":{},"uri":"{}"}}],"bufferViews":[{views}],"accessors":[{accessors}]"#,
        bytes.len(),
        data_uri(bytes)
    ))
}

fn view(offset: usize, length: usize) -> String {
    format!(r#"{{"buffer":0,"byteOffset":{offset},"byteLength":{length}}}"#)
}

fn accessor(component: u32, kind: &str, count: u64, rest: &str) -> String {
    format!(r#"{{"componentType":{component},"type":"{kind}","count":{count}{rest}}}"#)
}

const IN_VIEW: &str = r#","bufferView":0"#;
const NORMALIZED: &str = r#","bufferView":0,"normalized":true"#;

fn scalars(bytes: &[u8], component: u32, count: u64, rest: &str) -> Vec<f32> {
    let context = scene(
        bytes,
        &view(0, bytes.len()),
        &accessor(component, "SCALAR", count, rest),
    );
    let values = floats::<1>(&context, 0, "/test", ANY_SMALL).unwrap();
    values.into_iter().map(|[value]| value).collect()
}

#[test]
fn normalised_integers_follow_the_specification() {
    let i8s = scalars(&[0x80, 0x81, 0, 127], 5120, 4, NORMALIZED);
    assert_eq!(i8s, [-1.0, -1.0, 0.0, 1.0]);
    let u8s = scalars(&[0, 51, 255], 5121, 3, NORMALIZED);
    assert_eq!(u8s, [0.0, 0.2, 1.0]);
    let bytes: Vec<u8> = [i16::MIN, -32767, 0, 32767]
        .iter()
        .flat_map(|v| v.to_le_bytes())
        .collect();
    assert_eq!(scalars(&bytes, 5122, 4, NORMALIZED), [-1.0, -1.0, 0.0, 1.0]);
    let bytes: Vec<u8> = [0u16, 13107, 65535]
        .iter()
        .flat_map(|v| v.to_le_bytes())
        .collect();
    assert_eq!(scalars(&bytes, 5123, 3, NORMALIZED), [0.0, 0.2, 1.0]);
}

#[test]
fn every_normalised_value_is_the_rounded_quotient() {
    for value in i16::MIN..=i16::MAX {
        let decoded = scalars_of(value.to_le_bytes());
        let exact = (f64::from(value) / 32767.0).max(-1.0);
        assert_eq!(decoded, exact as f32, "{value}");
    }
}

fn scalars_of(bytes: [u8; 2]) -> f32 {
    let elements = Elements {
        bytes: &bytes,
        stride: 2,
        count: 1,
    };
    decode_floats::<1>(&elements, ComponentType::I16, true)[0][0]
}

#[test]
fn plain_integers_keep_their_value() {
    assert_eq!(
        scalars(&[0x80, 0, 127], 5120, 3, IN_VIEW),
        [-128.0, 0.0, 127.0]
    );
    assert_eq!(
        scalars(&[0, 128, 255, 255], 5123, 2, IN_VIEW),
        [32768.0, 65535.0]
    );
}

#[test]
fn floats_keep_their_bits() {
    let bits = [0x7fc0_1234u32, 0x8000_0000, 1, 0x7f80_0000];
    let bytes: Vec<u8> = bits.iter().flat_map(|v| v.to_le_bytes()).collect();
    let read = scalars(&bytes, 5126, 4, IN_VIEW);
    assert_eq!(read.iter().map(|v| v.to_bits()).collect::<Vec<_>>(), bits);
}

#[test]
fn strides_and_offsets_interleave() {
    let bytes: Vec<u8> = (0..9u8).flat_map(|v| f32::from(v).to_le_bytes()).collect();
    let view = r#"{"buffer":0,"byteLength":36,"byteStride":12}"#;
    let accessors = accessor(5126, "VEC2", 3, r#","bufferView":0,"byteOffset":4"#);
    let context = scene(&bytes, view, &accessors);
    let read = floats::<2>(&context, 0, "/test", &[]).unwrap();
    assert_eq!(read, [[1.0, 2.0], [4.0, 5.0], [7.0, 8.0]]);
}

#[test]
fn strides_below_the_element_or_out_of_range_are_refused() {
    for stride in [0, 3, 4, 8, 253, 1 << 20] {
        let view = format!(r#"{{"buffer":0,"byteLength":64,"byteStride":{stride}}}"#);
        let context = scene(&[0; 64], &view, &accessor(5126, "VEC3", 2, IN_VIEW));
        let error = fault(floats::<3>(&context, 0, "/test", &[]));
        assert_eq!(error.code, "buffer-view-stride", "{stride}");
    }
}

/// Two sparse replacements (indices 1 and 3, values 8 and 9) over four scalars 0, 1, 2, 3.
fn sparse(base: &str, indices: [u8; 2], count: u64) -> Context {
    let values = [0f32, 1.0, 2.0, 3.0, 8.0, 9.0];
    let mut bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    bytes.extend(indices);
    let views = [view(0, 16), view(16, 8), view(24, 2)].join(",");
    let sparse = format!(
        r#"{base},"sparse":{{"count":{count},"values":{{"bufferView":1}},
        "indices":{{"bufferView":2,"componentType":5121}}}}"#
    );
    scene(&bytes, &views, &accessor(5126, "SCALAR", 4, &sparse))
}

#[test]
fn sparse_values_replace_the_base_or_zeros() {
    let read = |context: &Context| floats::<1>(context, 0, "/test", &[]).unwrap();
    let with_base = sparse(IN_VIEW, [1, 3], 2);
    assert_eq!(read(&with_base), [[0.0], [8.0], [2.0], [9.0]]);
    let without = sparse("", [1, 3], 2);
    assert_eq!(read(&without), [[0.0], [8.0], [0.0], [9.0]]);
    assert_eq!(read(&sparse("", [1, 3], 0)), [[0.0]; 4]);
}

#[test]
fn sparse_faults_are_refused() {
    for (indices, count) in [
        ([3, 1], 2),
        ([1, 1], 2),
        ([1, 4], 2),
        ([1, 3], 5),
        ([1, 3], u64::MAX),
    ] {
        let context = sparse(IN_VIEW, indices, count);
        let error = fault(floats::<1>(&context, 0, "/test", &[]));
        assert_eq!(error.code, "accessor-sparse", "{indices:?} {count}");
        assert_eq!(error.place, "/accessors/0/sparse");
    }
    let context = sparse(IN_VIEW, [1, 3], 3);
    let error = fault(floats::<1>(&context, 0, "/test", &[]));
    assert_eq!(error.code, "accessor-out-of-range");
}

#[test]
fn an_accessor_without_data_is_zeros_within_a_limit() {
    let context = scene(&[], "", &accessor(5126, "VEC3", 5, ""));
    assert_eq!(
        floats::<3>(&context, 0, "/test", &[]).unwrap(),
        [[0.0; 3]; 5]
    );
    let context = scene(&[], "", &accessor(5126, "VEC3", 1 << 40, ""));
    assert_eq!(
        fault(floats::<3>(&context, 0, "/test", &[])).code,
        "scene-too-large"
    );
    let context = scene(&[], "", &accessor(5126, "VEC3", 1 << 23, ""));
    assert!(floats::<3>(&context, 0, "/test", &[]).is_ok());
    assert!(floats::<3>(&context, 0, "/test", &[]).is_ok());
    assert_eq!(
        fault(floats::<3>(&context, 0, "/test", &[])).code,
        "scene-too-large"
    );
}

#[test]
fn ranges_that_overflow_are_refused() {
    let huge = u64::MAX;
    for (count, rest) in [
        (4, IN_VIEW.to_owned()),
        (huge, IN_VIEW.to_owned()),
        (huge / 12 + 1, IN_VIEW.to_owned()),
        (1 << 32, IN_VIEW.to_owned()),
        (3, format!(r#"{IN_VIEW},"byteOffset":1"#)),
        (1, format!(r#"{IN_VIEW},"byteOffset":{huge}"#)),
        (1, format!(r#"{IN_VIEW},"byteOffset":{}"#, huge - 11)),
    ] {
        let context = scene(
            &[0; 36],
            &view(0, 36),
            &accessor(5126, "VEC3", count, &rest),
        );
        let error = fault(floats::<3>(&context, 0, "/test", &[]));
        assert_eq!(error.code, "accessor-out-of-range", "{count} {rest}");
        assert_eq!(error.place, "/accessors/0");
    }
    for bad in [
        r#"{"buffer":0,"byteLength":37}"#.to_owned(),
        r#"{"buffer":0,"byteOffset":36,"byteLength":1}"#.to_owned(),
        format!(r#"{{"buffer":0,"byteOffset":{huge},"byteLength":{huge}}}"#),
        format!(r#"{{"buffer":0,"byteOffset":2,"byteLength":{}}}"#, huge - 1),
    ] {
        let context = scene(&[0; 36], &bad, &accessor(5126, "VEC3", 1, IN_VIEW));
        let error = fault(floats::<3>(&context, 0, "/test", &[]));
        assert_eq!(error.code, "buffer-view-out-of-range", "{bad}");
    }
}

#[test]
fn wrong_types_and_references_are_refused() {
    let code = |accessors: &str, types: IntegerTypes| {
        let context = scene(&[0; 64], &view(0, 64), accessors);
        fault(floats::<3>(&context, 0, "/test", types)).code
    };
    assert_eq!(
        code(&accessor(5126, "VEC2", 1, IN_VIEW), &[]),
        "accessor-type"
    );
    assert_eq!(
        code(&accessor(5126, "MAT4", 1, IN_VIEW), &[]),
        "accessor-type"
    );
    assert_eq!(
        code(&accessor(5126, "VEC5", 1, IN_VIEW), &[]),
        "accessor-type"
    );
    assert_eq!(
        code(&accessor(5124, "VEC3", 1, IN_VIEW), ANY_SMALL),
        "accessor-type"
    );
    assert_eq!(
        code(&accessor(5125, "VEC3", 1, IN_VIEW), ANY_SMALL),
        "accessor-type"
    );
    assert_eq!(
        code(&accessor(5122, "VEC3", 1, IN_VIEW), &[]),
        "accessor-type"
    );
    assert_eq!(
        code(&accessor(5121, "VEC3", 1, NORMALIZED), SIGNED_NORMALIZED),
        "accessor-type"
    );
    assert_eq!(code("", &[]), "index-out-of-range");
    let rest = r#","bufferView":7"#;
    assert_eq!(
        code(&accessor(5126, "VEC3", 1, rest), &[]),
        "index-out-of-range"
    );
}

#[test]
fn indices_are_unsigned_scalars() {
    let read = |component: u32, kind: &str, rest: &str| {
        let context = scene(
            &[1, 0, 0, 0],
            &view(0, 4),
            &accessor(component, kind, 1, rest),
        );
        indices(&context, 0, "/test").map(|indices| (indices.values, indices.restart))
    };
    assert_eq!(read(5121, "SCALAR", IN_VIEW).unwrap(), (vec![1], 0xff));
    assert_eq!(read(5123, "SCALAR", IN_VIEW).unwrap(), (vec![1], 0xffff));
    assert_eq!(read(5125, "SCALAR", IN_VIEW).unwrap(), (vec![1], u32::MAX));
    for (component, kind, rest) in [
        (5126, "SCALAR", IN_VIEW),
        (5120, "SCALAR", IN_VIEW),
        (5122, "SCALAR", IN_VIEW),
        (5121, "SCALAR", NORMALIZED),
        (5121, "VEC2", IN_VIEW),
    ] {
        assert_eq!(fault(read(component, kind, rest)).code, "accessor-type");
    }
}
