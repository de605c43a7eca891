// Where a pixel's samples lie.
#ifndef CAIRN_SAMPLES_GLSL
#define CAIRN_SAMPLES_GLSL

// Samples per pixel: 1, 2, 4 or 8.
layout(constant_id = 32) const int SAMPLES = 1;

// Vulkan's standard sample locations, in sixteenths of a pixel.
const ivec2 LOCATIONS[15] = ivec2[15](
    ivec2(8, 8),
    ivec2(12, 12), ivec2(4, 4),
    ivec2(6, 2), ivec2(14, 6), ivec2(2, 10), ivec2(10, 14),
    ivec2(9, 5), ivec2(7, 11), ivec2(13, 9), ivec2(5, 3), ivec2(3, 13), ivec2(1, 7), ivec2(11, 15), ivec2(15, 1));

// In pixels from its upper left corner.
vec2 location(int index) {
    return vec2(LOCATIONS[SAMPLES - 1 + index]) / 16.0;
}

// Which triangle a sample sees, and its depth: which of each pair is read goes by SAMPLES.
layout(set = 3, binding = 4) uniform usampler2D visibility;
layout(set = 3, binding = 5) uniform usampler2DMS visibility_samples;
layout(set = 2, binding = 1) uniform sampler2D visible_depth;
layout(set = 3, binding = 7) uniform sampler2DMS depth_samples;

float depth_at(ivec2 pixel, int index) {
    return SAMPLES == 1 ? texelFetch(visible_depth, pixel, 0).r : texelFetch(depth_samples, pixel, index).r;
}

// Zero where nothing is seen: the target itself is not cleared.
uvec2 triangle_at(ivec2 pixel, int index) {
    if (depth_at(pixel, index) == 0.0) {
        return uvec2(0u);
    }
    return SAMPLES == 1 ? texelFetch(visibility, pixel, 0).xy : texelFetch(visibility_samples, pixel, index).xy;
}

#endif
