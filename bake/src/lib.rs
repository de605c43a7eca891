//! Bakes glTF 2.0 and an HDR environment into one Cairn package: import -> prepare -> encode -> write.
//!
//! [`bake()`] is the whole bake; [`Options`] says of what and how, [`Progress`] listens, [`Summary`] and [`BakeError`]
//! tell what came of it. [`look`] reads packages back. `examples/bake.rs` is a program around it. The other modules are
//! the stages, public for tests and benches.
//!
//! ```no_run
//! use cairn_bake::{Options, Silent, bake};
//!
//! # fn main() -> cairn_bake::Result<()> {
//! let mut options = Options::new("helmet.gltf", "helmet.cairn");
//! options.environment = Some("park.hdr".into());
//! let summary = bake(&options, &Silent)?;
//! for row in &summary.report {
//!     println!("{} {}: {} {}", row.stage, row.item, row.error, row.metric);
//! }
//! # Ok(())
//! # }
//! ```

pub mod alias;
pub mod args;
pub mod bench;
pub mod bounded;
pub mod cache;
pub mod codes;
pub mod commands;
pub mod constants;
pub mod content;
pub mod diagnostic;
pub mod emitters;
pub mod encode;
pub mod environment;
pub mod import;
pub mod interrupt;
pub mod label;
#[warn(missing_docs)]
pub mod look;
pub mod materials;
pub mod memory;
pub mod panorama;
#[warn(missing_docs)]
pub mod peak;
pub mod pipeline;
pub mod prepare;
#[warn(missing_docs)]
pub mod progress;
pub mod rebake;
#[warn(missing_docs)]
pub mod report;
pub mod scene;
pub mod sky;
pub mod strict;
pub mod temporary;
pub mod textures;
pub mod twice;
pub mod write;

pub use diagnostic::{BakeError, Diagnostic, Result, Severity};
pub use pipeline::{Options, bake};
pub use progress::{Progress, Silent};
pub use report::Summary;
