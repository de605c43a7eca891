//! How a GPU record is declared: its layout is asserted, and its fields are listed for the GLSL mirror.

use bytemuck::Pod;

/// One field of a record, as GLSL sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Field {
    /// Field name, the same in Rust and GLSL.
    pub name: &'static str,
    /// Byte offset.
    pub offset: usize,
    /// GLSL type, such as `vec4`.
    pub glsl: &'static str,
    /// Array length; 0 where the field is no array.
    pub count: usize,
    /// What it holds, as its documentation says.
    pub doc: &'static str,
}

/// Layout of a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RecordLayout {
    /// Type name, the same in Rust, GLSL and, behind `Cairn`, in C.
    pub name: &'static str,
    /// Bytes.
    pub bytes: usize,
    /// What it is, as its documentation says.
    pub doc: &'static str,
    /// Every field in order, without gaps.
    pub fields: &'static [Field],
}

impl RecordLayout {
    /// The layout of a record type.
    pub const fn of<T: Record>() -> Self {
        Self {
            name: T::NAME,
            bytes: size_of::<T>(),
            doc: T::DOC,
            fields: T::FIELDS,
        }
    }
}

/// One field of the header, of a row of the section table, or of an archived type of the root.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FileField {
    /// Field name.
    pub name: &'static str,
    /// Rust type before archiving, such as `Vec<Mesh>`.
    pub ty: &'static str,
    /// Byte offset.
    pub offset: usize,
    /// Bytes.
    pub bytes: usize,
    /// What it holds, as its documentation says.
    pub doc: &'static str,
}

/// Layout of the header, of a row of the section table, or of an archived type of the root.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FileType {
    /// Type name.
    pub name: &'static str,
    /// Bytes.
    pub bytes: usize,
    /// What it is, as its documentation says.
    pub doc: &'static str,
    /// Fields in order; none of an enum.
    pub fields: &'static [FileField],
    /// Variants of an enum and their values.
    pub variants: &'static [(&'static str, u8, &'static str)],
}

impl Field {
    /// Bytes of the field.
    pub fn bytes(&self) -> usize {
        let one = match self.glsl {
            "uint64_t" | "vec2" => 8,
            "vec3" => 12,
            "vec4" | "uvec4" => 16,
            "mat4" => 64,
            _ => 4,
        };
        one * self.count.max(1)
    }

    /// Whether the field holds `f32` values.
    pub fn is_float(&self) -> bool {
        matches!(self.glsl, "float" | "vec2" | "vec3" | "vec4" | "mat4")
    }
}

/// A record with a known layout.
pub trait Record: Pod {
    /// Type name, the same in Rust and GLSL.
    const NAME: &'static str;
    /// What it is, as its documentation says.
    const DOC: &'static str;
    /// Every field in order, without gaps.
    const FIELDS: &'static [Field];
}

/// A field type and its GLSL spelling.
pub trait GlslType {
    /// GLSL type name.
    const NAME: &'static str;
    /// Array length; 0 where the type is no array.
    const COUNT: usize = 0;
}

macro_rules! glsl_types {
    ($($rust:ty => $glsl:literal $([$count:literal])?),* $(,)?) => {
        $(impl GlslType for $rust {
            const NAME: &'static str = $glsl;
            $(const COUNT: usize = $count;)?
        })*
    };
}

glsl_types! {
    f32 => "float",
    u32 => "uint",
    u64 => "uint64_t",
    [f32; 2] => "vec2",
    [f32; 3] => "vec3",
    [f32; 4] => "vec4",
    [u32; 4] => "uvec4",
    [[f32; 4]; 3] => "vec4"[3],
    [[f32; 4]; 4] => "mat4",
    [[[f32; 4]; 4]; 4] => "mat4"[4],
}

/// Declares a `repr(C)` record, asserts its size and every offset at compile time, and lists its fields.
macro_rules! gpu_record {
    (
        $(#[doc = $doc:literal])*
        pub struct $name:ident : $size:literal {
            $($(#[doc = $field_doc:literal])* pub $field:ident : $ty:ty = $offset:literal,)*
        }
    ) => {
        $(#[doc = $doc])*
        #[repr(C)]
        #[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
        pub struct $name {
            $($(#[doc = $field_doc])* pub $field: $ty,)*
        }

        const _: () = {
            assert!(std::mem::size_of::<$name>() == $size);
            $(assert!(std::mem::offset_of!($name, $field) == $offset);)*
        };

        impl $crate::record::Record for $name {
            const NAME: &'static str = stringify!($name);
            const DOC: &'static str = concat!($($doc),*);
            const FIELDS: &'static [$crate::record::Field] = &[
                $($crate::record::Field {
                    name: stringify!($field),
                    offset: $offset,
                    glsl: <$ty as $crate::record::GlslType>::NAME,
                    count: <$ty as $crate::record::GlslType>::COUNT,
                    doc: concat!($($field_doc),*),
                },)*
            ];
        }
    };
}
pub(crate) use gpu_record;

/// Declares a `repr(C)` struct of the file's head, and lists its fields.
macro_rules! file_record {
    (
        $(#[doc = $doc:literal])*
        pub struct $name:ident {
            $($(#[doc = $field_doc:literal])* pub $field:ident : $ty:ty,)*
        }
    ) => {
        $(#[doc = $doc])*
        #[repr(C)]
        #[derive(Clone, Copy, Debug, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
        pub struct $name {
            $($(#[doc = $field_doc])* pub $field: $ty,)*
        }

        impl $name {
            /// Layout of this struct.
            pub const LAYOUT: $crate::record::FileType = $crate::record::FileType {
                name: stringify!($name),
                bytes: std::mem::size_of::<$name>(),
                doc: concat!($($doc),*),
                fields: &[$($crate::record::FileField {
                    name: stringify!($field),
                    ty: stringify!($ty),
                    offset: std::mem::offset_of!($name, $field),
                    bytes: std::mem::size_of::<$ty>(),
                    doc: concat!($($field_doc),*),
                },)*],
                variants: &[],
            };
        }
    };
}
pub(crate) use file_record;
