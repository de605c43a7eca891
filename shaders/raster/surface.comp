// Depth, shading normal and roughness of what the visibility pass found, for passes that read the screen: of each
// pixel's nearest sample.
#version 460
#extension GL_GOOGLE_include_directive : require
#define CAIRN_EXPLICIT_GRADIENT
#include "samples.glsl"
#include "visible.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

layout(set = 3, binding = 0, r32f) uniform writeonly image2D resolved_depth;
layout(set = 3, binding = 1, rgb10_a2) uniform writeonly image2D resolved_normal;
layout(set = 3, binding = 2, r8) uniform writeonly image2D resolved_roughness;

// The nearest sample's; with one sample, depth needs no copy.
uvec2 nearest_triangle(ivec2 pixel, out vec2 point) {
    point = vec2(0.5);
    if (SAMPLES == 1) {
        return triangle_at(pixel, 0);
    }
    int nearest = 0;
    float depth = depth_at(pixel, 0);
    for (int i = 1; i < SAMPLES; ++i) {
        float other = depth_at(pixel, i);
        // Reverse-Z: larger is nearer.
        if (other > depth) {
            depth = other;
            nearest = i;
        }
    }
    imageStore(resolved_depth, pixel, vec4(depth));
    point = location(nearest);
    return triangle_at(pixel, nearest);
}

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, imageSize(resolved_normal)))) {
        return;
    }
    vec2 point;
    uvec2 triangle = nearest_triangle(pixel, point);
    vec4 normal = vec4(0.5, 0.5, 0.5, 1.0);
    float roughness = 1.0;
    if (triangle.x != 0u) {
        Fetched f = fetch_visible(triangle, vec2(pixel) + point);
        Material material = materials[f.material];
        vec3 view = view_direction(f.frame.position);
        vec3 bent = bend_normal(sample_normal(material, f.coords), f.frame, f.facet, view, f.front_facing);
        normal = vec4(bent * 0.5 + 0.5, 1.0);
        float texel = sample_texture(material.metallic_roughness_tex, f.coords, vec4(1.0)).g;
        roughness = clamp(texel * material.roughness_factor, 0.0, 1.0);
    }
    imageStore(resolved_normal, pixel, normal);
    imageStore(resolved_roughness, pixel, vec4(roughness));
}
