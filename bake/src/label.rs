//! Names from this program's own tables that are read back from files it wrote.

use std::collections::BTreeSet;
use std::sync::Mutex;

use rkyv::rancor::{Fallible, Source};
use rkyv::ser::Writer;
use rkyv::string::{ArchivedString, StringResolver};
use rkyv::with::{ArchiveWith, DeserializeWith, SerializeWith};
use serde::{Deserialize, Deserializer};

/// A name that the program knows: a stage, a code, a unit. Fields of this type are read back with
/// `#[serde(deserialize_with = "crate::label::read")]`; written as `&'static str` they would only be
/// readable out of texts that live for ever.
pub type Label = &'static str;

/// Writes a label with rkyv as a string: `#[rkyv(with = Interned)]`.
pub struct Interned;

impl ArchiveWith<Label> for Interned {
    type Archived = ArchivedString;
    type Resolver = StringResolver;

    fn resolve_with(field: &Label, resolver: StringResolver, out: rkyv::Place<ArchivedString>) {
        ArchivedString::resolve_from_str(field, resolver, out);
    }
}

impl<S: Fallible<Error: Source> + Writer + ?Sized> SerializeWith<Label, S> for Interned {
    fn serialize_with(field: &Label, serializer: &mut S) -> Result<StringResolver, S::Error> {
        ArchivedString::serialize_from_str(field, serializer)
    }
}

impl<D: Fallible + ?Sized> DeserializeWith<ArchivedString, Label, D> for Interned {
    fn deserialize_with(field: &ArchivedString, _: &mut D) -> Result<Label, D::Error> {
        Ok(intern(field.as_str()))
    }
}

/// Reads a label.
pub fn read<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Label, D::Error> {
    Ok(intern(&String::deserialize(deserializer)?))
}

/// Reads a list of labels.
pub fn read_list<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<Label>, D::Error> {
    let names = Vec::<String>::deserialize(deserializer)?;
    Ok(names.iter().map(|name| intern(name)).collect())
}

/// The one copy of a name, which is never freed.
pub fn intern(name: &str) -> Label {
    static NAMES: Mutex<BTreeSet<Label>> = Mutex::new(BTreeSet::new());
    let mut names = NAMES
        .lock()
        .unwrap_or_else(|poisoned| poisoned.into_inner());
    if let Some(known) = names.get(name) {
        return known;
    }
    let kept: Label = Box::leak(name.to_owned().into_boxed_str());
    names.insert(kept);
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_kept_once() {
        let first = intern(&String::from("a name of this test"));
        let second = intern(&String::from("a name of this test"));
        assert!(std::ptr::eq(first, second));
        assert_ne!(intern("another"), first);
    }
}
