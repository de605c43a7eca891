// Depth and normal of the prepass, and positions in view space: x right, y up, looking along -z, metres.
#ifndef CAIRN_VIEW_GLSL
#define CAIRN_VIEW_GLSL

#include "bindings.glsl"

// Reverse-Z, 0 where there is nothing. Read by texelFetch alone: a filtered depth belongs to no surface.
layout(set = 2, binding = 1) uniform sampler2D depth_texture;
// World normal n * 0.5 + 0.5.
layout(set = 2, binding = 2) uniform sampler2D normal_texture;

// Pixels to view space: at distance z along the view a pixel is at (pixel * slope + offset) * (z, or 1 if parallel).
struct Lens {
    vec2 slope;
    vec2 offset;
    bool perspective;
};

Lens lens() {
    vec2 inverse = vec2(1.0 / global.projection[0][0], 1.0 / global.projection[1][1]);
    vec2 slope = vec2(2.0, -2.0) * inverse / global.screen_size;
    // Pixel centres are at halves; rows run downwards.
    return Lens(slope, vec2(-1.0, 1.0) * inverse + 0.5 * slope, global.projection[2][3] != 0.0);
}

// Distance along the view of a depth above 0.
float view_distance(Lens view, float depth) {
    float z = global.projection[3][2], scale = global.projection[2][2];
    return view.perspective ? z / (depth + scale) : (z - depth) / scale;
}

vec3 view_position(Lens view, vec2 pixel, float depth) {
    float z = view_distance(view, depth);
    vec2 at = pixel * view.slope + view.offset;
    return vec3(view.perspective ? at * z : at, -z);
}

// Unit vector from a position to the camera.
vec3 view_vector(Lens view, vec3 position) {
    return view.perspective ? -normalize(position) : vec3(0.0, 0.0, 1.0);
}

vec3 world_normal(ivec2 pixel) {
    return normalize(texelFetch(normal_texture, pixel, 0).xyz * 2.0 - 1.0);
}

#endif
