//! Looks into finished packages: what `inspect`, `extract`, `diff`, `verify` and `report` have in common.

mod compare;
mod contents;
mod decode;
mod difference;
pub mod export;
mod fields;
mod mesh;
mod nearest;
mod page;
mod picture;
mod text;

use std::path::Path;

use cairn_format::{Error, Package};

use crate::diagnostic::{BakeError, Result};
use crate::scene::Origin;

pub use compare::{ImageDifference, MeshDifference};
pub use contents::{
    Contents, ErrorRow, ImageRow, Item, MaterialRow, MeshRow, PrimitiveRow, SectionRow, SourceRow,
    TextureUse,
};
pub use decode::{Plane, decode, layer};
pub use difference::{
    Changes, Difference, FieldChange, FieldChanges, ImageChange, InstanceChange, MeshChange,
    SectionChange,
};
pub use fields::record_values;
pub use mesh::{MeshView, PrimitiveView, mesh, meshes};
pub use page::{Extras, page};
pub use picture::{Picture, level_picture, thumbnail};
pub use text::{bytes_text, number, printable};

/// Opens a package; errors name the file.
///
/// # Errors
/// [`BakeError`] where the file cannot be read, is no package, or breaks a rule.
pub fn open(path: &Path) -> Result<Package> {
    Package::open(path).map_err(|error| refused(path, error))
}

/// The error of a package at `path`.
pub fn refused(path: &Path, error: Error) -> BakeError {
    match error {
        Error::Io { source, .. } => BakeError::io(path, source),
        error => BakeError::input("package", &origin(path), error.to_string()),
    }
}

/// A file as messages name it.
pub fn origin(path: &Path) -> Origin {
    Origin {
        file: path.display().to_string(),
        pointer: String::new(),
    }
}
