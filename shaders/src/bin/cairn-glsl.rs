//! Writes `shaders/common/gpu.glsl` from the records of `cairn-format`.

use std::process::ExitCode;

fn main() -> ExitCode {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/common/gpu.glsl");
    match std::fs::write(path, cairn_format::glsl::gpu_glsl()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{path}: {error}");
            ExitCode::FAILURE
        }
    }
}
