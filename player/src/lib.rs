//! Maps a Cairn package and renders it: open -> upload -> cull -> record -> present.

pub mod args;
pub mod bench;
pub mod camera;
pub mod camera_file;
pub mod cascade;
pub mod compare;
pub mod converge;
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
#[cfg(feature = "hot-reload")]
pub mod reload;
pub mod ruler;
pub mod scene;
pub mod settings;
pub mod sweep;
pub mod targets;
pub mod tracer;
pub mod user;
#[cfg(feature = "window")]
pub mod window;

pub use error::PlayerError;
