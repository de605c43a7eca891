//! The Cairn package: one memory-mapped file that a renderer draws from without parsing.
//!
//! ```
//! use cairn_format::{Package, SectionKind, Vertex, Writer, scene::Scene};
//!
//! # fn main() -> cairn_format::Result<()> {
//! let vertices = [Vertex { position: [1.0, 2.0, 3.0], ..bytemuck::Zeroable::zeroed() }];
//! let mut writer = Writer::new();
//! writer.records(SectionKind::Vertices, &vertices);
//! let bytes = writer.to_vec(&Scene::empty("tiny"), "0.1.0")?;
//!
//! let package = Package::from_bytes(&bytes)?;
//! package.verify()?;
//! assert_eq!(package.vertices()?[0].position, [1.0, 2.0, 3.0]);
//! # Ok(())
//! # }
//! ```
#![warn(missing_docs)]

pub mod bounds;
pub mod brdf_table;
pub mod c_header;
pub mod check;
pub mod error;
pub mod features;
pub mod glsl;
pub mod gpu;
pub mod harmonics;
pub mod header;
pub mod package;
mod record;
pub mod reference;
pub mod scene;
pub mod schema;
pub mod section;
pub mod texture;
mod tracing;
pub mod vertex;
pub mod writer;

pub use bounds::{Aabb, BoundsView, Frustum};
pub use error::{Error, Part, Result};
pub use package::Package;
pub use section::SectionKind;
pub use texture::TextureFormat;
pub use vertex::Vertex;
pub use writer::Writer;
