//! Cairn's shaders as SPIR-V, compiled from GLSL when this crate is built.
#![warn(missing_docs)]

#[cfg(feature = "hot-reload")]
mod compile;
#[cfg(feature = "hot-reload")]
pub mod reload;

/// A compiled entry point; its name in the module is `main`.
#[derive(Debug)]
pub struct Shader {
    /// File name of the source, such as `forward.frag`.
    pub name: &'static str,
    /// SPIR-V words.
    pub spirv: &'static [u32],
}

/// Little-endian words of a SPIR-V file; `N` is a quarter of its bytes.
const fn words<const N: usize>(bytes: &[u8]) -> [u32; N] {
    assert!(bytes.len() == N * 4);
    let mut words = [0; N];
    let mut index = 0;
    while index < N {
        let at = index * 4;
        words[index] = u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
        index += 1;
    }
    words
}

include!(concat!(env!("OUT_DIR"), "/embedded.rs"));

#[cfg(test)]
mod tests {
    use super::*;
    use std::process::Command;

    #[test]
    fn generated_glsl_is_current() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/common/gpu.glsl");
        let committed = std::fs::read_to_string(path).expect("common/gpu.glsl");
        assert!(
            committed == cairn_format::glsl::gpu_glsl(),
            "common/gpu.glsl is stale: run `cargo run -p cairn-shaders --bin cairn-glsl`"
        );
    }

    #[test]
    fn every_shader_is_valid_spirv() {
        if Command::new("spirv-val").arg("--version").output().is_err() {
            assert!(
                std::env::var_os("CAIRN_REQUIRE_VULKAN").is_none(),
                "spirv-val is missing: install spirv-tools"
            );
            eprintln!("SKIPPED: spirv-val is missing (package spirv-tools)");
            return;
        }
        assert!(!ALL.is_empty());
        for shader in ALL {
            assert_eq!(shader.spirv[0], 0x0723_0203, "{}", shader.name);
            let file = concat!(env!("OUT_DIR"), "/").to_owned() + shader.name + ".spv";
            let output = Command::new("spirv-val")
                .args(["--target-env", "vulkan1.3", "--scalar-block-layout", &file])
                .output()
                .expect("spirv-val runs");
            let text = String::from_utf8_lossy(&output.stderr).into_owned()
                + &String::from_utf8_lossy(&output.stdout);
            assert!(output.status.success(), "{}: {text}", shader.name);
        }
    }
}
