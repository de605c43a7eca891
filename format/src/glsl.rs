//! Emits `shaders/common/gpu.glsl`, the GLSL mirror of the GPU records.

use std::fmt::Write;

use crate::brdf_table;
use crate::gpu::{CONSTANTS, Field, NUMBERS, records};

/// The whole text of `shaders/common/gpu.glsl`.
pub fn gpu_glsl() -> String {
    let mut out = String::from(
        "// Generated from cairn-format's records; `cargo run -p cairn-shaders --bin cairn-glsl` writes it anew.\n\
         // Offsets hold in scalar layout, and GlobalUniform's in std140 too.\n\
         #ifndef CAIRN_GPU_GLSL\n\
         #define CAIRN_GPU_GLSL\n\n",
    );
    for (name, value) in CONSTANTS {
        let _ = writeln!(out, "const uint {name} = 0x{value:x}u;");
    }
    for (name, value) in NUMBERS {
        let _ = writeln!(out, "const float {name} = {value:?};");
    }
    for (name, size, fields) in records() {
        let _ = writeln!(out, "\n// {size} bytes\nstruct {name} {{");
        for field in fields {
            let _ = writeln!(out, "    {};", member(field));
        }
        out.push_str("};\n");
    }
    out.push_str(brdf_table::GLSL);
    out.push_str("\n#endif\n");
    out
}

fn member(field: &Field) -> String {
    match field.count {
        0 => format!("{} {}", field.glsl, field.name),
        count => format!("{} {}[{count}]", field.glsl, field.name),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_leave_no_gaps() {
        for (name, size, fields) in records() {
            let mut end = 0;
            for field in fields {
                assert_eq!(field.offset, end, "{name}.{} leaves a gap", field.name);
                end = field.offset + field.bytes();
            }
            assert_eq!(end, size, "{name} ends early");
        }
    }
}
