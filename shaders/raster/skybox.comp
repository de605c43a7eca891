// The environment's sky in the pixels that nothing covers; one sample per pixel.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "finite.glsl"
#include "sky.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

layout(set = 2, binding = 1) uniform sampler2D depth_texture;
layout(set = 3, binding = 0, rgba16f) uniform writeonly image2D hdr;

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    ivec2 size = imageSize(hdr);
    if (any(greaterThanEqual(pixel, size)) || texelFetch(depth_texture, pixel, 0).r != 0.0) {
        return;
    }
    imageStore(hdr, pixel, vec4(storable(sky_radiance(pixel, size)), 1.0));
}
