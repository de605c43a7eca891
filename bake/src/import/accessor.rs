//! Reads accessors into plain vectors, every range checked (glTF 2.0 section 3.6.2).

use gltf::json::Accessor;
use gltf::json::accessor::{ComponentType, Type, sparse::Sparse};
use gltf::json::validation::Checked;

use crate::diagnostic::Result;

use super::buffer::{self, View};
use super::context::Context;

/// Component types, with whether they are normalised, that an attribute may have beside float.
pub(super) type IntegerTypes = &'static [(ComponentType, bool)];

/// Core glTF texture coordinates.
pub(super) const UNSIGNED_NORMALIZED: IntegerTypes =
    &[(ComponentType::U8, true), (ComponentType::U16, true)];
/// Normals and tangents of `KHR_mesh_quantization`.
pub(super) const SIGNED_NORMALIZED: IntegerTypes =
    &[(ComponentType::I8, true), (ComponentType::I16, true)];
/// Positions and texture coordinates of `KHR_mesh_quantization`.
pub(super) const ANY_SMALL: IntegerTypes = &[
    (ComponentType::I8, true),
    (ComponentType::I8, false),
    (ComponentType::U8, true),
    (ComponentType::U8, false),
    (ComponentType::I16, true),
    (ComponentType::I16, false),
    (ComponentType::U16, true),
    (ComponentType::U16, false),
];

/// An accessor whose enumerators and buffer ranges were checked.
struct Checker<'a> {
    context: &'a Context,
    accessor: &'a Accessor,
    pointer: String,
    component: ComponentType,
    count: usize,
}

/// Evenly spaced elements; the last one lies inside `bytes`.
struct Elements<'a> {
    bytes: &'a [u8],
    stride: usize,
    count: usize,
}

/// Reads an attribute of `N` components. Floats keep their bits; integers become floats, by the
/// formulas of glTF 2.0 section 3.11 where normalised.
///
/// # Errors
/// A missing accessor, a type that is neither float nor in `integers`, or data out of range.
pub(super) fn floats<const N: usize>(
    context: &Context,
    index: usize,
    referrer: &str,
    integers: IntegerTypes,
) -> Result<Vec<[f32; N]>> {
    let checker = Checker::new(context, index, referrer)?;
    let wanted = [Type::Scalar, Type::Vec2, Type::Vec3, Type::Vec4];
    checker.expect_shape(wanted.get(N - 1).copied(), referrer)?;
    let normalized = checker.accessor.normalized;
    let float = checker.component == ComponentType::F32;
    if !float && !integers.contains(&(checker.component, normalized)) {
        return Err(checker.wrong_component(referrer));
    }
    let decode = |elements: &Elements<'_>| decode_floats(elements, checker.component, normalized);
    checker.read(N * checker.component.size(), [0.0; N], decode)
}

/// Indices and the largest value of their type, which glTF reserves.
pub(super) struct Indices {
    pub values: Vec<u32>,
    pub restart: u32,
}

/// Reads the indices of a primitive: unsigned scalars of 8, 16 or 32 bits.
///
/// # Errors
/// As for `floats`.
pub(super) fn indices(context: &Context, index: usize, referrer: &str) -> Result<Indices> {
    let checker = Checker::new(context, index, referrer)?;
    checker.expect_shape(Some(Type::Scalar), referrer)?;
    let restart = match checker.component {
        ComponentType::U8 => u32::from(u8::MAX),
        ComponentType::U16 => u32::from(u16::MAX),
        ComponentType::U32 => u32::MAX,
        _ => return Err(checker.wrong_component(referrer)),
    };
    if checker.accessor.normalized {
        return Err(checker.wrong_component(referrer));
    }
    let decode = |elements: &Elements<'_>| decode_unsigned(elements, checker.component);
    let values = checker.read(checker.component.size(), 0, decode)?;
    Ok(Indices { values, restart })
}

/// Number of elements of an accessor, without reading it.
///
/// # Errors
/// A missing accessor.
pub(super) fn count(context: &Context, index: usize, referrer: &str) -> Result<u64> {
    let accessors = &context.document.accessors;
    match accessors.get(index) {
        Some(accessor) => Ok(accessor.count.0),
        None => Err(context.absent(referrer, "accessor", index, accessors.len())),
    }
}

impl<'a> Checker<'a> {
    fn new(context: &'a Context, index: usize, referrer: &str) -> Result<Self> {
        let elements = count(context, index, referrer)?;
        let accessor = &context.document.accessors[index];
        let pointer = format!("/accessors/{index}");
        let Checked::Valid(component) = accessor.component_type else {
            let message = "componentType is none of 5120 to 5123, 5125, 5126; export again";
            return Err(context.error("accessor-type", pointer, message));
        };
        let count = usize::try_from(elements)
            .map_err(|_| context.error("accessor-out-of-range", &pointer, "count is too large"))?;
        Ok(Self {
            context,
            accessor,
            pointer,
            component: component.0,
            count,
        })
    }

    fn expect_shape(&self, wanted: Option<Type>, referrer: &str) -> Result<()> {
        let found = match self.accessor.type_ {
            Checked::Valid(found) if Some(found) == wanted => return Ok(()),
            Checked::Valid(found) => format!("{found:?}"),
            Checked::Invalid => "no valid type".into(),
        };
        let wanted = wanted.map_or_else(String::new, |wanted| format!("{wanted:?}"));
        let message = format!("{referrer} needs {wanted} elements, found {found}; export again");
        Err(self.context.error("accessor-type", &self.pointer, message))
    }

    fn wrong_component(&self, referrer: &str) -> crate::BakeError {
        let normalized = if self.accessor.normalized {
            "normalized "
        } else {
            ""
        };
        let hint = if self.context.document.quantized() {
            "export again"
        } else {
            "export again, or declare KHR_mesh_quantization if the file uses it"
        };
        let message = format!(
            "{referrer} cannot have {normalized}{:?} components; {hint}",
            self.component
        );
        self.context.error("accessor-type", &self.pointer, message)
    }

    /// Decodes the dense part, or zeros where there is none, then lays the sparse part over it.
    fn read<T: Copy>(
        &self,
        size: usize,
        zero: T,
        decode: impl Fn(&Elements<'_>) -> Vec<T>,
    ) -> Result<Vec<T>> {
        let mut values = match self.accessor.buffer_view {
            Some(view) => {
                let offset = self.accessor.byte_offset.map_or(0, |offset| offset.0);
                let view = buffer::view(self.context, view.value(), &self.pointer)?;
                let stride = view.stride.unwrap_or(size);
                if stride < size {
                    let message = format!(
                        "elements of {size} bytes do not fit the view's byteStride {stride}; export again"
                    );
                    let code = "buffer-view-stride";
                    return Err(self.context.error(code, &self.pointer, message));
                }
                let elements = self.elements(view, offset, stride, size, self.count)?;
                self.context.charge(self.count as u64, &self.pointer)?;
                decode(&elements)
            }
            None => {
                self.context
                    .charge_zeroed(self.count as u64, &self.pointer)?;
                vec![zero; self.count]
            }
        };
        if let Some(sparse) = &self.accessor.sparse {
            self.overlay(sparse, size, &mut values, decode)?;
        }
        Ok(values)
    }

    fn overlay<T: Copy>(
        &self,
        sparse: &Sparse,
        size: usize,
        values: &mut [T],
        decode: impl Fn(&Elements<'_>) -> Vec<T>,
    ) -> Result<()> {
        let fault = |message: String| {
            let pointer = format!("{}/sparse", self.pointer);
            self.context.error("accessor-sparse", pointer, message)
        };
        let count = match usize::try_from(sparse.count.0) {
            Ok(count) if count <= self.count => count,
            _ => {
                return Err(fault(format!(
                    "{} sparse elements in an accessor of {}; export again",
                    sparse.count.0, self.count
                )));
            }
        };
        let Checked::Valid(component) = sparse.indices.component_type else {
            let message =
                "the componentType of the indices is none of 5121, 5123, 5125; export again";
            return Err(fault(message.into()));
        };
        let component = component.0;
        let tight = |view: usize, offset: u64, size: usize| {
            let view = buffer::view(self.context, view, &self.pointer)?;
            self.elements(view, offset, size, size, count)
        };
        let indices = &sparse.indices;
        let targets = tight(
            indices.buffer_view.value(),
            indices.byte_offset.0,
            component.size(),
        )?;
        let replacements = tight(
            sparse.values.buffer_view.value(),
            sparse.values.byte_offset.0,
            size,
        )?;
        self.context.charge(2 * count as u64, &self.pointer)?;
        let mut previous = None;
        for (target, value) in decode_unsigned(&targets, component)
            .into_iter()
            .zip(decode(&replacements))
        {
            if previous.is_some_and(|previous| target <= previous) {
                let message = format!("index {target} does not increase; export again");
                return Err(fault(message));
            }
            let Some(slot) = values.get_mut(target as usize) else {
                let message = format!(
                    "index {target} is beyond the accessor's {} elements; export again",
                    self.count
                );
                return Err(fault(message));
            };
            *slot = value;
            previous = Some(target);
        }
        Ok(())
    }

    /// Checks that `count` elements lie inside the view.
    fn elements<'v>(
        &self,
        view: View<'v>,
        offset: u64,
        stride: usize,
        size: usize,
        count: usize,
    ) -> Result<Elements<'v>> {
        let needed = match count.checked_sub(1) {
            Some(steps) => steps
                .checked_mul(stride)
                .and_then(|span| span.checked_add(size)),
            None => Some(0),
        };
        let tail = usize::try_from(offset)
            .ok()
            .and_then(|offset| view.bytes.get(offset..));
        match (needed, tail) {
            (Some(needed), Some(bytes)) if needed <= bytes.len() => Ok(Elements {
                bytes,
                stride,
                count,
            }),
            _ => {
                let message = format!(
                    "{count} elements of {size} bytes, {stride} apart, at offset {offset} leave the \
                     buffer view of {} bytes; the file is cut or was exported wrongly",
                    view.bytes.len()
                );
                let code = "accessor-out-of-range";
                Err(self.context.error(code, &self.pointer, message))
            }
        }
    }
}

impl<'a> Elements<'a> {
    /// The bytes from each element's start on.
    fn iter(&self) -> impl Iterator<Item = &'a [u8]> + use<'a> {
        self.bytes.chunks(self.stride.max(1)).take(self.count)
    }
}

fn decode_floats<const N: usize>(
    elements: &Elements<'_>,
    component: ComponentType,
    normalized: bool,
) -> Vec<[f32; N]> {
    use ComponentType::{F32, I8, I16, U8, U16, U32};
    match (component, normalized) {
        (F32, _) => decode(elements, f32::from_le_bytes),
        (I8, false) => decode(elements, |b| f32::from(i8::from_le_bytes(b))),
        (U8, false) => decode(elements, |b| f32::from(u8::from_le_bytes(b))),
        (I16, false) => decode(elements, |b| f32::from(i16::from_le_bytes(b))),
        (U16, false) => decode(elements, |b| f32::from(u16::from_le_bytes(b))),
        (I8, true) => decode(elements, |b| {
            (f32::from(i8::from_le_bytes(b)) / 127.0).max(-1.0)
        }),
        (U8, true) => decode(elements, |b| f32::from(u8::from_le_bytes(b)) / 255.0),
        (I16, true) => decode(elements, |b| {
            (f32::from(i16::from_le_bytes(b)) / 32767.0).max(-1.0)
        }),
        (U16, true) => decode(elements, |b| f32::from(u16::from_le_bytes(b)) / 65535.0),
        (U32, _) => unreachable!("no attribute accepts 32-bit integers"),
    }
}

fn decode_unsigned(elements: &Elements<'_>, component: ComponentType) -> Vec<u32> {
    let flat = |values: Vec<[u32; 1]>| values.into_iter().map(|[value]| value).collect();
    match component {
        ComponentType::U8 => flat(decode(elements, |b| u32::from(u8::from_le_bytes(b)))),
        ComponentType::U16 => flat(decode(elements, |b| u32::from(u16::from_le_bytes(b)))),
        _ => flat(decode(elements, u32::from_le_bytes)),
    }
}

/// Decodes `N` components of `S` bytes from each element.
fn decode<T, const N: usize, const S: usize>(
    elements: &Elements<'_>,
    convert: impl Fn([u8; S]) -> T,
) -> Vec<[T; N]> {
    let component = |element: &[u8], index: usize| {
        let mut bytes = [0; S];
        bytes.copy_from_slice(&element[index * S..][..S]);
        convert(bytes)
    };
    elements
        .iter()
        .map(|element| std::array::from_fn(|index| component(element, index)))
        .collect()
}

#[cfg(test)]
mod tests {
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
}
