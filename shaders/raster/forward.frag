// Shades the scene's surfaces: direct light, light from the environment, emission, and the debug views.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shade.glsl"

layout(location = 0) in vec3 in_position;
layout(location = 1) in vec3 in_normal;
layout(location = 2) in vec3 in_tangent;
layout(location = 3) in vec4 in_uv;
layout(location = 4) flat in float in_handedness;
layout(location = 5) flat in uint in_material;
layout(location = 6) in vec4 in_vertex_color;

layout(location = 0) out vec4 out_color;

// The level of the base colour's texture that this fragment reads; grey without one. In uniform control flow.
vec3 mip_view(Material material, TexCoords coords) {
    if (material.base_color_tex == NO_TEXTURE) {
        return vec3(0.5);
    }
    uint slot = material.base_color_tex & ~TEXTURE_UV1;
    vec2 uv = texture_uv(material.base_color_tex, coords);
    return level_color(textureQueryLod(textures[nonuniformEXT(slot)], uv).x);
}

void main() {
    Material material = materials[in_material];
    TexCoords coords = TexCoords(in_uv.xy, in_uv.zw);
    Visible v;
    v.material = in_material;
    v.point = evaluate_material(in_material, coords, in_vertex_color);
    v.facet = fragment_facet(in_position);
    v.levels = DEBUG_VIEW ? mip_view(material, coords) : vec3(0.0);
    // After the lookups, whose implicit derivatives need whole quads.
    if (MASKED && v.point.base.a < material.alpha_cutoff) {
        discard;
    }
    v.frame = Frame(in_position, in_normal, in_tangent, in_handedness);
    v.front_facing = gl_FrontFacing;
    v.pixel = ivec2(gl_FragCoord.xy);
    out_color = vec4(storable(shade(v)), BLENDED ? clamp(v.point.base.a, 0.0, 1.0) : 1.0);
}
