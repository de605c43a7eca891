// Places a vertex, for a target that holds which triangle is seen.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "bindings.glsl"
#include "options.glsl"

layout(location = 0) in vec3 in_position;
layout(location = 2) in vec2 in_uv0;
layout(location = 4) in vec2 in_uv1;
layout(location = 5) in uint in_instance;

layout(location = 0) flat out uint out_instance;
// Written where MASKED.
layout(location = 1) out vec4 out_uv;
layout(location = 2) out float out_alpha;

// Every pass that draws the scene computes the same depth.
invariant gl_Position;

void main() {
    vec4 world = instances[in_instance].model * vec4(in_position, 1.0);
    gl_Position = global.view_projection * world;
    out_instance = in_instance;
    if (MASKED) {
        out_uv = vec4(in_uv0, in_uv1);
        out_alpha = 1.0;
        if (HAS_VERTEX_COLORS) {
            out_alpha = arena_color(gl_VertexIndex).a;
        }
    }
}
