// Cuts what casts a shadow by its alpha.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "material.glsl"

layout(location = 0) in vec4 in_uv;
layout(location = 1) flat in uint in_material;
layout(location = 2) in float in_alpha;

void main() {
    Material material = materials[in_material];
    TexCoords coords = TexCoords(in_uv.xy, in_uv.zw);
    float texel = sample_texture(material.base_color_tex, coords, vec4(1.0)).a;
    if (material.base_color_factor.a * texel * in_alpha < material.alpha_cutoff) {
        discard;
    }
}
