//! Tests of the decompression of buffer views.

use super::*;
use crate::import::buffer;
use crate::import::testing::{context, data_uri, fault};

/// View 0 holds `count` elements of `stride` bytes, compressed to `bytes`.
fn scene(bytes: &[u8], count: usize, stride: usize, rest: &str) -> Context {
    named("EXT_meshopt_compression", bytes, count, stride, rest)
}

fn named(name: &str, bytes: &[u8], count: usize, stride: usize, rest: &str) -> Context {
    context(&format!(
        r#""buffers":[{{"byteLength":{0},"uri":"{1}"}},
            {{"byteLength":9,"extensions":{{"{name}":{{"fallback":true}}}}}}],
        "bufferViews":[{{"buffer":1,"byteLength":{2},"extensions":{{"{name}":
            {{"buffer":0,"byteLength":{0},"byteStride":{stride},"count":{count},{rest}}}}}}}]"#,
        bytes.len(),
        data_uri(bytes),
        count * stride,
    ))
}

fn decoded(context: &Context) -> Result<Vec<u8>> {
    buffer::view(context, 0, "/test").map(|view| view.bytes.to_vec())
}

const ATTRIBUTES: &str = r#""mode":"ATTRIBUTES""#;
const TRIANGLES: &str = r#""mode":"TRIANGLES""#;
const INDICES: &str = r#""mode":"INDICES""#;

/// Deterministic words that resemble vertex data.
fn noise(count: usize) -> Vec<u32> {
    let step = |state: &mut u32| {
        *state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        Some(*state >> 12)
    };
    std::iter::successors(Some(1u32), |state| step(&mut state.clone()))
        .take(count)
        .collect()
}

#[test]
fn attributes_of_every_size_survive() {
    fn check<const WORDS: usize>() {
        let elements: Vec<[u32; WORDS]> = noise(300 * WORDS)
            .chunks(WORDS)
            .map(|chunk| std::array::from_fn(|index| chunk[index]))
            .collect();
        let encoded = ::meshopt::encode_vertex_buffer(&elements).unwrap();
        let context = scene(&encoded, 300, 4 * WORDS, ATTRIBUTES);
        assert_eq!(
            decoded(&context).unwrap(),
            bytemuck::cast_slice::<_, u8>(elements.as_flattened())
        );
    }
    check::<1>();
    check::<3>();
    check::<7>();
    check::<32>();
    check::<33>();
    check::<63>();
    check::<64>();
}

#[test]
fn both_index_codecs_survive_in_both_sizes() {
    let indices: Vec<u32> = (0..200).flat_map(|i| [i, i + 1, i + 2]).collect();
    let list = ::meshopt::encode_index_buffer(&indices, 202).unwrap();
    let sequence = ::meshopt::encode_index_sequence(&indices, 202).unwrap();
    let wide: &[u8] = bytemuck::cast_slice(&indices);
    let narrow: Vec<u8> = indices
        .iter()
        .flat_map(|&i| (i as u16).to_le_bytes())
        .collect();
    for (encoded, mode) in [(&list, TRIANGLES), (&sequence, INDICES)] {
        for (stride, expected) in [(4, wide), (2, &narrow[..])] {
            let context = named("KHR_meshopt_compression", encoded, 600, stride, mode);
            let bytes = decoded(&context).unwrap();
            assert_eq!(bytes.len(), expected.len());
            if mode == INDICES {
                assert_eq!(bytes, expected);
            }
        }
    }
}

#[test]
fn filters_restore_their_values() {
    let vectors = [
        [1.0f32, 0.0, 0.0, 0.0],
        [0.6, 0.0, 0.8, 0.0],
        [0.0, -0.6, -0.8, 0.0],
    ];
    let with = |filter: &str| format!(r#"{ATTRIBUTES},"filter":"{filter}""#);
    let filtered = |encoded: Vec<u8>, stride, filter| {
        decoded(&scene(&encoded, 3, stride, &with(filter))).unwrap()
    };
    let near = |found: f32, expected: f32, slack: f32| {
        assert!((found - expected).abs() < slack, "{found} {expected}");
    };
    let octahedral = ::meshopt::encode_filter_oct::<i8>(&vectors, 8);
    let encoded = ::meshopt::encode_vertex_buffer(&octahedral).unwrap();
    for (found, expected) in filtered(encoded, 4, "OCTAHEDRAL")
        .iter()
        .zip(vectors.as_flattened())
    {
        near(f32::from(*found as i8) / 127.0, *expected, 0.02);
    }
    let octahedral = ::meshopt::encode_filter_oct::<i16>(&vectors, 16);
    let encoded = ::meshopt::encode_vertex_buffer(&octahedral).unwrap();
    let shorts = |bytes: Vec<u8>| -> Vec<i16> {
        let (pairs, _) = bytes.as_chunks::<2>();
        pairs.iter().map(|&pair| i16::from_le_bytes(pair)).collect()
    };
    for (found, expected) in shorts(filtered(encoded, 8, "OCTAHEDRAL"))
        .iter()
        .zip(vectors.as_flattened())
    {
        near(f32::from(*found) / 32767.0, *expected, 1e-3);
    }
    let quaternions = ::meshopt::encode_filter_quat(&vectors, 16);
    let encoded = ::meshopt::encode_vertex_buffer(&quaternions).unwrap();
    for (found, expected) in shorts(filtered(encoded, 8, "QUATERNION"))
        .chunks(4)
        .zip(vectors)
    {
        let dot: f32 = found
            .iter()
            .zip(expected)
            .map(|(f, e)| f32::from(*f) / 32767.0 * e)
            .sum();
        near(dot.abs(), 1.0, 1e-3);
    }
    let mode = ::meshopt::EncodeExpMode::Separate;
    let exponential = ::meshopt::encode_filter_exp(&vectors, 15, mode);
    let encoded = ::meshopt::encode_vertex_buffer(&exponential).unwrap();
    let bytes = filtered(encoded, 16, "EXPONENTIAL");
    for (found, expected) in bytes.as_chunks::<4>().0.iter().zip(vectors.as_flattened()) {
        near(f32::from_le_bytes(*found), *expected, 1e-3);
    }
    let colors = [
        [1.0f32, 0.0, 0.0, 1.0],
        [0.0, 1.0, 0.5, 0.5],
        [0.2, 0.2, 0.2, 0.0],
    ];
    let encoded =
        ::meshopt::encode_vertex_buffer(&::meshopt::encode_filter_color::<u8>(&colors, 8)).unwrap();
    for (found, expected) in filtered(encoded, 4, "COLOR")
        .iter()
        .zip(colors.as_flattened())
    {
        near(f32::from(*found) / 255.0, *expected, 0.02);
    }
}

#[test]
fn layouts_that_the_extension_forbids_are_refused() {
    let bytes = ::meshopt::encode_vertex_buffer(&[[0u32; 2]; 3]).unwrap();
    let message = |count, stride, rest: &str| {
        let error = fault(decoded(&scene(&bytes, count, stride, rest)));
        assert_eq!(error.code, "meshopt", "{}", error.message);
        assert_eq!(
            error.place,
            "/bufferViews/0/extensions/EXT_meshopt_compression"
        );
        error.message
    };
    for (stride, rest) in [
        (0, ATTRIBUTES),
        (6, ATTRIBUTES),
        (260, ATTRIBUTES),
        (8, TRIANGLES),
        (1, INDICES),
        (4, r#""mode":"INDICES","filter":"EXPONENTIAL""#),
        (12, r#""mode":"ATTRIBUTES","filter":"OCTAHEDRAL""#),
        (4, r#""mode":"ATTRIBUTES","filter":"QUATERNION""#),
        (16, r#""mode":"ATTRIBUTES","filter":"COLOR""#),
    ] {
        assert!(message(3, stride, rest).contains("is not allowed"));
    }
    assert!(message(3, 8, r#""mode":"VERTICES""#).contains("VERTICES"));
    let filter = r#""mode":"ATTRIBUTES","filter":"ZIP""#;
    assert!(message(3, 8, filter).contains("ZIP"));
    assert!(message(4, 4, TRIANGLES).contains("4 indices"));
}

#[test]
fn sizes_are_checked_before_anything_is_allocated() {
    let bytes = ::meshopt::encode_vertex_buffer(&[[0u32; 2]; 3]).unwrap();
    let huge = scene(&bytes, 1 << 40, 256, ATTRIBUTES);
    assert!(fault(decoded(&huge)).message.contains("cannot describe"));
    let body = |length: u64| {
        format!(
            r#""buffers":[{{"byteLength":4,"uri":"{}"}}],"bufferViews":[{{"buffer":0,"byteLength":{length},
            "extensions":{{"EXT_meshopt_compression":{{"buffer":0,"byteLength":4,"byteStride":8,
            "count":{},"mode":"ATTRIBUTES"}}}}}}]"#,
            data_uri(&[0; 4]),
            u64::MAX
        )
    };
    for length in [0, 8, u64::MAX - 7] {
        let error = fault(decoded(&context(&body(length))));
        assert!(error.message.contains("do not fill"), "{}", error.message);
    }
    let large = vec![0; 1 << 20];
    let over = scene(&large, (1 << 29) / 256 + 1, 256, ATTRIBUTES);
    assert_eq!(fault(decoded(&over)).code, "scene-too-large");
    let missing = r#""bufferViews":[{"buffer":0,"byteLength":8,"extensions":{"EXT_meshopt_compression":{"buffer":0}}}]"#;
    assert_eq!(fault(decoded(&context(missing))).code, "extension-schema");
}

#[test]
fn damaged_data_is_refused_or_decoded_to_something() {
    let elements: Vec<[u32; 3]> = noise(300).chunks(3).map(|c| [c[0], c[1], c[2]]).collect();
    let indices: Vec<u32> = (0..60).flat_map(|i| [i, i + 1, i + 2]).collect();
    let streams = [
        (
            ::meshopt::encode_vertex_buffer(&elements).unwrap(),
            100,
            12,
            ATTRIBUTES,
        ),
        (
            ::meshopt::encode_index_buffer(&indices, 62).unwrap(),
            180,
            4,
            TRIANGLES,
        ),
        (
            ::meshopt::encode_index_sequence(&indices, 62).unwrap(),
            180,
            2,
            INDICES,
        ),
    ];
    for (bytes, count, stride, rest) in streams {
        for length in 0..bytes.len() {
            let error = fault(decoded(&scene(&bytes[..length], count, stride, rest)));
            assert_eq!(error.code, "meshopt");
        }
        for position in 0..bytes.len() {
            let mut bytes = bytes.clone();
            bytes[position] ^= 0x5a;
            if let Ok(decoded) = decoded(&scene(&bytes, count, stride, rest)) {
                assert_eq!(decoded.len(), count * stride);
            }
        }
    }
}
