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
    /// Tight elements in place of those of the buffer view.
    packed: Option<&'a [u8]>,
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
    floats_from(context, index, referrer, integers, None)
}

/// As `floats`, with `packed` elements in place of the buffer view's where there are any.
///
/// # Errors
/// As for `floats`, or too few packed elements.
pub(super) fn floats_from<const N: usize>(
    context: &Context,
    index: usize,
    referrer: &str,
    integers: IntegerTypes,
    packed: Option<&[u8]>,
) -> Result<Vec<[f32; N]>> {
    let checker = Checker {
        packed,
        ..Checker::new(context, index, referrer)?
    };
    let wanted = match N {
        1 => Type::Scalar,
        2 => Type::Vec2,
        3 => Type::Vec3,
        4 => Type::Vec4,
        16 => Type::Mat4,
        _ => unreachable!("no attribute has {N} components"),
    };
    checker.expect_shape(Some(wanted), referrer)?;
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

/// Component type and number of components of an accessor, without reading it.
///
/// # Errors
/// A missing accessor or an unknown enumerator.
pub(super) fn layout(
    context: &Context,
    index: usize,
    referrer: &str,
) -> Result<(ComponentType, usize)> {
    let checker = Checker::new(context, index, referrer)?;
    match checker.accessor.type_ {
        Checked::Valid(shape) => Ok((checker.component, shape.multiplicity())),
        Checked::Invalid => {
            let message = "the type is none of SCALAR, VEC2 to VEC4, MAT2 to MAT4; export again";
            Err(context.error("accessor-type", &checker.pointer, message))
        }
    }
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
            packed: None,
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
        let mut values = match (self.packed, self.accessor.buffer_view) {
            (Some(bytes), _) => {
                let view = View {
                    bytes,
                    stride: None,
                };
                let elements = self.elements(view, 0, size, size, self.count)?;
                self.context.charge(self.count as u64, &self.pointer)?;
                decode(&elements)
            }
            (None, Some(view)) => {
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
            (None, None) => {
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
mod tests;
