//! Settings as JSON: one object, with an object per group. Members that are left out keep their value.

use std::path::Path;

use serde_json::{Map, Value};

use super::Settings;
use crate::PlayerError;

/// What is wrong with a settings object.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SettingsError {
    /// Not JSON at all.
    #[error("not JSON: {0}")]
    Syntax(String),
    /// An object was expected.
    #[error("`{0}` is not an object")]
    NotAnObject(String),
    /// No setting has this name.
    #[error("no setting `{name}`; there are: {known}")]
    Unknown {
        /// The name with its group.
        name: String,
        /// Those in the same group.
        known: String,
    },
    /// The value is of another type, or out of range.
    #[error("`{name}` is {value}, but must be {allowed}")]
    NotAllowed {
        /// The name with its group.
        name: String,
        /// The value that was found.
        value: String,
        /// Allowed values in words.
        allowed: String,
    },
}

impl Settings {
    /// As an object of all settings.
    pub fn to_json(&self) -> Value {
        let mut root = Map::new();
        for (place, group, field) in self.places() {
            let value = self.get(place).to_json();
            if group.is_empty() {
                root.insert(field.name.into(), value);
            } else {
                let members = root.entry(group).or_insert_with(|| Map::new().into());
                members[field.name] = value;
            }
        }
        root.into()
    }

    /// Replaces the settings that `json` names. Nothing is changed where there is an error.
    ///
    /// # Errors
    /// Names what is unknown or not allowed.
    pub fn merge_json(&mut self, json: &Value) -> Result<(), SettingsError> {
        let mut merged = self.clone();
        let object = |value: &Value, name: &str| {
            let object = value.as_object().cloned();
            object.ok_or_else(|| SettingsError::NotAnObject(name.into()))
        };
        for (name, value) in object(json, "settings")? {
            match Self::group_names().position(|group| !group.is_empty() && group == name) {
                Some(group) => {
                    for (field, value) in object(&value, &name)? {
                        merged.merge_field(group, &field, &value)?;
                    }
                }
                None => merged.merge_field(0, &name, &value)?,
            }
        }
        *self = merged;
        Ok(())
    }

    fn merge_field(&mut self, group: usize, name: &str, json: &Value) -> Result<(), SettingsError> {
        let prefix = match Self::group_names().nth(group) {
            None | Some("") => String::new(),
            Some(group) => format!("{group}."),
        };
        let fields = self.group(group).fields();
        let Some(index) = fields.iter().position(|field| field.name == name) else {
            let members = Self::MEMBERS.iter().filter(|_| group == 0).copied();
            let known: Vec<&str> = fields
                .iter()
                .map(|field| field.name)
                .chain(members)
                .collect();
            return Err(SettingsError::Unknown {
                name: format!("{prefix}{name}"),
                known: known.join(", "),
            });
        };
        let value = fields[index].kind.from_json(json);
        let value = value.map_err(|allowed| SettingsError::NotAllowed {
            name: format!("{prefix}{name}"),
            value: json.to_string(),
            allowed,
        })?;
        self.group_mut(group).set(index, value);
        Ok(())
    }

    /// Replaces the settings that a JSON file names.
    ///
    /// # Errors
    /// [`PlayerError::Input`] with the file's name.
    pub fn merge_file(&mut self, path: &Path) -> Result<(), PlayerError> {
        let fail = |what: String| PlayerError::Input(format!("{}: {what}", path.display()));
        let text = std::fs::read_to_string(path).map_err(|error| fail(error.to_string()))?;
        let json = serde_json::from_str(&text)
            .map_err(|error| fail(SettingsError::Syntax(error.to_string()).to_string()))?;
        self.merge_json(&json)
            .map_err(|error| fail(error.to_string()))
    }
}

impl serde::Serialize for Settings {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.to_json().serialize(serializer)
    }
}
