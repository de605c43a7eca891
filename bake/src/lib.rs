//! Bakes glTF 2.0 and an HDR environment into one Cairn package: import -> prepare -> encode -> write.

pub mod alias;
pub mod args;
pub mod cache;
pub mod codes;
pub mod commands;
pub mod diagnostic;
pub mod emitters;
pub mod encode;
pub mod environment;
pub mod import;
pub mod interrupt;
pub mod label;
pub mod look;
pub mod materials;
pub mod panorama;
pub mod pipeline;
pub mod prepare;
pub mod progress;
pub mod rebake;
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
