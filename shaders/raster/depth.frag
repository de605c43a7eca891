// The prepass's fragment: cuts by alpha, and writes the shading normal and roughness where a pass reads them.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "normal.glsl"

// Whether the targets are there.
layout(constant_id = 31) const bool WRITES_SURFACE = true;

layout(location = 0) in vec3 in_position;
layout(location = 1) in vec3 in_normal;
layout(location = 2) in vec3 in_tangent;
layout(location = 3) in vec4 in_uv;
layout(location = 4) flat in float in_handedness;
layout(location = 5) flat in uint in_material;
layout(location = 6) in vec4 in_vertex_color;

layout(location = 0) out vec4 out_normal;
layout(location = 1) out float out_roughness;

void main() {
    Material material = materials[in_material];
    TexCoords coords = TexCoords(in_uv.xy, in_uv.zw);
    if (WRITES_SURFACE) {
        Frame frame = Frame(in_position, in_normal, in_tangent, in_handedness);
        vec3 view = view_direction(in_position);
        vec3 normal = shading_normal(material, coords, frame, view, gl_FrontFacing);
        out_normal = vec4(normal * 0.5 + 0.5, 1.0);
        float texel = sample_texture(material.metallic_roughness_tex, coords, vec4(1.0)).g;
        out_roughness = clamp(texel * material.roughness_factor, 0.0, 1.0);
    }
    if (MASKED) {
        float alpha = material.base_color_factor.a * sample_texture(material.base_color_tex, coords, vec4(1.0)).a;
        if (HAS_VERTEX_COLORS) {
            alpha *= in_vertex_color.a;
        }
        if (alpha < material.alpha_cutoff) {
            discard;
        }
    }
}
