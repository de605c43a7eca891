// Depth, normal and roughness of each pixel's nearest sample: all of the same one, so that no surface is invented.
#version 460
#extension GL_GOOGLE_include_directive : require

layout(local_size_x = 8, local_size_y = 8) in;

layout(constant_id = 0) const int SAMPLES = 4;
layout(constant_id = 1) const bool HAS_SURFACE = true;

layout(set = 3, binding = 0, r32f) writeonly uniform image2D resolved_depth;
layout(set = 3, binding = 1, rgb10_a2) writeonly uniform image2D resolved_normal;
layout(set = 3, binding = 2, r8) writeonly uniform image2D resolved_roughness;
layout(set = 3, binding = 4) uniform sampler2DMS depth_samples;
layout(set = 3, binding = 5) uniform sampler2DMS normal_samples;
layout(set = 3, binding = 6) uniform sampler2DMS roughness_samples;

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, imageSize(resolved_depth)))) {
        return;
    }
    int nearest = 0;
    float depth = texelFetch(depth_samples, pixel, 0).r;
    for (int i = 1; i < SAMPLES; ++i) {
        float other = texelFetch(depth_samples, pixel, i).r;
        // Reverse-Z: larger is nearer. The first of equals wins.
        if (other > depth) {
            depth = other;
            nearest = i;
        }
    }
    imageStore(resolved_depth, pixel, vec4(depth));
    if (HAS_SURFACE) {
        imageStore(resolved_normal, pixel, texelFetch(normal_samples, pixel, nearest));
        imageStore(resolved_roughness, pixel, texelFetch(roughness_samples, pixel, nearest));
    }
}
