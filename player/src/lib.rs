//! Maps a Cairn package and renders it: open -> upload -> cull -> record -> present.

pub mod args;
pub mod camera;
pub mod camera_file;
pub mod cascade;
pub mod draw;
pub mod error;
pub mod exr;
pub mod frame;
pub mod gpu;
pub mod graph;
pub mod headless;
pub mod lights;
pub mod metrics;
pub mod passes;
pub mod plan;
pub mod png;
pub mod scene;
pub mod settings;
pub mod targets;
#[cfg(feature = "window")]
pub mod window;

pub use error::PlayerError;
