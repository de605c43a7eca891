//! What a setting is: its values, its bounds, and the macros that declare groups of them.

/// The value of one setting.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Value {
    /// On or off.
    Switch(bool),
    /// A whole number.
    Integer(u32),
    /// A finite number; radians where it is an angle.
    Number(f32),
    /// The name of a choice.
    Choice(&'static str),
}

/// A choice and what it means.
#[derive(Debug, PartialEq, Eq)]
pub struct Choice {
    /// As it is written in files and on the command line.
    pub name: &'static str,
    /// One sentence.
    pub doc: &'static str,
}

/// Which values a setting may have. Bounds are inclusive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    /// On or off.
    Switch,
    /// Whole numbers from a least to a most.
    Integer(u32, u32),
    /// One of these whole numbers.
    OneOf(&'static [u32]),
    /// Numbers from a least to a most.
    Number(f32, f32),
    /// Angles from a least to a most, in degrees; radians in memory and in JSON.
    Degrees(f32, f32),
    /// One of these names.
    Choice(&'static [Choice]),
}

/// One setting.
#[derive(Debug)]
pub struct Field {
    /// Name in its group, as in JSON.
    pub name: &'static str,
    /// What it does; its unit. Lines of a doc comment, each with a space before it.
    pub doc: &'static str,
    /// Which values it may have.
    pub kind: Kind,
}

/// Settings that are accessible by their position in [`Group::fields`].
pub trait Group {
    /// What there is.
    fn fields(&self) -> &'static [Field];
    /// The value of field `index`.
    fn get(&self, index: usize) -> Value;
    /// Replaces the value of field `index`. False, and nothing is changed, where `value` is of another type or
    /// out of range.
    fn set(&mut self, index: usize, value: Value) -> bool;
}

/// A type that settings may have.
pub trait Setting: Copy {
    /// As a value.
    fn value(self) -> Value;
    /// From a value of the same type.
    fn from_value(value: Value) -> Option<Self>;
}

macro_rules! setting {
    ($type:ty, $variant:ident) => {
        impl Setting for $type {
            fn value(self) -> Value {
                Value::$variant(self)
            }
            fn from_value(value: Value) -> Option<Self> {
                match value {
                    Value::$variant(value) => Some(value),
                    _ => None,
                }
            }
        }
    };
}

setting!(bool, Switch);
setting!(u32, Integer);
setting!(f32, Number);

impl Kind {
    /// Whether `value` is of this kind and within its bounds. An angle may exceed a bound by its rounding.
    pub fn allows(&self, value: Value) -> bool {
        match (self, value) {
            (Self::Switch, Value::Switch(_)) => true,
            (Self::Integer(least, most), Value::Integer(value)) => {
                (*least..=*most).contains(&value)
            }
            (Self::OneOf(values), Value::Integer(value)) => values.contains(&value),
            (Self::Number(least, most), Value::Number(value)) => (*least..=*most).contains(&value),
            (Self::Degrees(least, most), Value::Number(value)) => {
                (least.to_radians()..=most.to_radians()).contains(&value)
            }
            (Self::Choice(choices), Value::Choice(value)) => {
                choices.iter().any(|choice| choice.name == value)
            }
            _ => false,
        }
    }

    /// The allowed values in words, angles in degrees.
    pub fn allowed(&self) -> String {
        match self {
            Self::Switch => "true or false".into(),
            Self::Integer(least, most) => format!("{least} to {most}"),
            Self::OneOf(values) => list(values.iter().map(u32::to_string)),
            Self::Number(least, most) => format!("{least} to {most}"),
            Self::Degrees(least, most) => format!("{least} to {most} degrees"),
            Self::Choice(choices) => list(choices.iter().map(|choice| choice.name.to_owned())),
        }
    }

    /// Reads a value as the command line has it: angles in degrees.
    ///
    /// # Errors
    /// What is expected.
    pub fn parse(&self, text: &str) -> Result<Value, String> {
        let value = match self {
            Self::Switch => text.parse().ok().map(Value::Switch),
            Self::Integer(..) | Self::OneOf(_) => text.parse().ok().map(Value::Integer),
            Self::Number(..) => text.parse().ok().map(Value::Number),
            Self::Degrees(..) => text
                .parse()
                .ok()
                .map(|value: f32| Value::Number(value.to_radians())),
            Self::Choice(choices) => chosen(choices, text),
        };
        value
            .filter(|value| self.allows(*value))
            .ok_or_else(|| format!("expected {}", self.allowed()))
    }

    /// Reads a value as JSON has it: angles in radians.
    ///
    /// # Errors
    /// What is expected.
    pub fn from_json(&self, json: &serde_json::Value) -> Result<Value, String> {
        let value = match self {
            Self::Switch => json.as_bool().map(Value::Switch),
            Self::Integer(..) | Self::OneOf(_) => json
                .as_u64()
                .and_then(|value| u32::try_from(value).ok())
                .map(Value::Integer),
            Self::Number(..) | Self::Degrees(..) => {
                json.as_f64().map(|value| Value::Number(value as f32))
            }
            Self::Choice(choices) => json.as_str().and_then(|text| chosen(choices, text)),
        };
        value
            .filter(|value| self.allows(*value))
            .ok_or_else(|| match self {
                Self::Degrees(least, most) => {
                    format!("{} to {} radians", least.to_radians(), most.to_radians())
                }
                _ => self.allowed(),
            })
    }
}

impl Value {
    /// As JSON: angles in radians, numbers with the fewest digits that give the same bits back.
    pub fn to_json(self) -> serde_json::Value {
        match self {
            Self::Switch(value) => value.into(),
            Self::Integer(value) => value.into(),
            Self::Number(value) => value
                .to_string()
                .parse::<f64>()
                .unwrap_or(f64::from(value))
                .into(),
            Self::Choice(name) => name.into(),
        }
    }

    /// As the command line has it: angles in degrees.
    pub fn to_text(self, kind: &Kind) -> String {
        match (self, kind) {
            // A tenth of a millionth of a degree is below what the radians hold.
            (Self::Number(value), Kind::Degrees(..)) => {
                ((f64::from(value).to_degrees() * 1e5).round() / 1e5).to_string()
            }
            (Self::Switch(value), _) => value.to_string(),
            (Self::Integer(value), _) => value.to_string(),
            (Self::Number(value), _) => value.to_string(),
            (Self::Choice(name), _) => name.into(),
        }
    }
}

fn chosen(choices: &'static [Choice], text: &str) -> Option<Value> {
    let found = choices.iter().find(|choice| choice.name == text)?;
    Some(Value::Choice(found.name))
}

fn list(values: impl Iterator<Item = String>) -> String {
    values.collect::<Vec<_>>().join(", ")
}

/// Declares an enumeration that is a setting: each variant with its name.
macro_rules! choice {
    (
        $(#[doc = $about:literal])+
        pub enum $type:ident {
            $( $(#[doc = $doc:literal])+ $variant:ident = $name:literal, )+
        }
    ) => {
        $(#[doc = $about])+
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum $type {
            $( $(#[doc = $doc])+ $variant, )+
        }

        impl $type {
            /// Names and meanings, in the order of the variants.
            pub const CHOICES: &'static [$crate::settings::table::Choice] = &[
                $( $crate::settings::table::Choice { name: $name, doc: concat!($($doc),+) }, )+
            ];

            /// As it is written in files and on the command line.
            pub fn name(self) -> &'static str {
                match self {
                    $( Self::$variant => $name, )+
                }
            }
        }

        impl $crate::settings::table::Setting for $type {
            fn value(self) -> $crate::settings::table::Value {
                $crate::settings::table::Value::Choice(self.name())
            }
            fn from_value(value: $crate::settings::table::Value) -> Option<Self> {
                match value {
                    $( $crate::settings::table::Value::Choice($name) => Some(Self::$variant), )+
                    _ => None,
                }
            }
        }
    };
}

/// Declares a group of settings: a struct with defaults, and its table. See the module above for how.
macro_rules! group {
    (
        $(#[doc = $about:literal])+
        pub struct $type:ident {
            $( $(#[doc = $doc:literal])+ $field:ident: $field_type:ty = $default:expr, $kind:expr; )*
            $( + $member:ident: $member_type:ident; )*
        }
    ) => {
        $(#[doc = $about])+
        #[derive(Clone, Debug, PartialEq)]
        pub struct $type {
            $( $(#[doc = $doc])+ pub $field: $field_type, )*
            $( #[doc = concat!("See [`", stringify!($member_type), "`].")] pub $member: $member_type, )*
        }

        impl Default for $type {
            fn default() -> Self {
                Self {
                    $( $field: $default, )*
                    $( $member: $member_type::default(), )*
                }
            }
        }

        impl $type {
            /// The settings of this group; those of the groups in it are in their own types.
            pub const FIELDS: &'static [$crate::settings::table::Field] = &[
                $( $crate::settings::table::Field {
                    name: stringify!($field),
                    doc: concat!($($doc),+),
                    kind: $kind,
                }, )*
            ];
            /// Names of the groups in this one.
            pub const MEMBERS: &'static [&'static str] = &[$( stringify!($member), )*];

            /// Member `index` of [`Self::MEMBERS`].
            ///
            /// # Panics
            /// Where there are fewer.
            pub fn member(&self, index: usize) -> &dyn $crate::settings::table::Group {
                let members: &[&dyn $crate::settings::table::Group] = &[$( &self.$member, )*];
                members[index]
            }

            /// As [`Self::member`].
            ///
            /// # Panics
            /// Where there are fewer.
            pub fn member_mut(&mut self, index: usize) -> &mut dyn $crate::settings::table::Group {
                let mut members: Vec<&mut dyn $crate::settings::table::Group> = vec![$( &mut self.$member, )*];
                members.swap_remove(index)
            }
        }

        impl $crate::settings::table::Group for $type {
            fn fields(&self) -> &'static [$crate::settings::table::Field] {
                Self::FIELDS
            }

            fn get(&self, index: usize) -> $crate::settings::table::Value {
                let values = [$( $crate::settings::table::Setting::value(self.$field), )*];
                values[index]
            }

            fn set(&mut self, index: usize, value: $crate::settings::table::Value) -> bool {
                if !Self::FIELDS[index].kind.allows(value) {
                    return false;
                }
                let mut at = 0..;
                $(
                    if at.next() == Some(index) {
                        let value = $crate::settings::table::Setting::from_value(value);
                        return value.map(|value| self.$field = value).is_some();
                    }
                )*
                let _ = (at, value);
                false
            }
        }
    };
}

pub(super) use {choice, group};
