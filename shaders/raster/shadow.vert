// Places one instance's vertex in a cascade of the shadow map.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "bindings.glsl"
#include "options.glsl"

layout(push_constant, scalar) uniform Push {
    ShadowPush push;
};

layout(location = 0) in vec3 in_position;
layout(location = 2) in vec2 in_uv0;
layout(location = 4) in vec2 in_uv1;
layout(location = 5) in uint in_instance;

// Read where MASKED.
layout(location = 0) out vec4 out_uv;
layout(location = 1) flat out uint out_material;
layout(location = 2) out float out_alpha;

void main() {
    Instance instance = instances[in_instance];
    gl_Position = global.cascade_view_proj[push.cascade_index] * (instance.model * vec4(in_position, 1.0));
    if (MASKED) {
        out_uv = vec4(in_uv0, in_uv1);
        out_material = instance.material_index;
        out_alpha = 1.0;
        if (HAS_VERTEX_COLORS) {
            out_alpha = arena_color(gl_VertexIndex).a;
        }
    }
}
