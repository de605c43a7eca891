// Which triangle is seen: its instance plus 1, and its number in the instance's mesh.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "material.glsl"

layout(location = 0) flat in uint in_instance;
layout(location = 1) in vec4 in_uv;
layout(location = 2) in float in_alpha;

layout(location = 0) out uvec2 out_triangle;

void main() {
    if (MASKED) {
        Material material = materials[instances[in_instance].material_index];
        TexCoords coords = TexCoords(in_uv.xy, in_uv.zw);
        if (base_color(material, coords, vec4(in_alpha)).a < material.alpha_cutoff) {
            discard;
        }
    }
    out_triangle = uvec2(in_instance + 1u, gl_PrimitiveID);
}
