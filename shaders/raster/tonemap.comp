// HDR to display, into a target of plain 8-bit numbers.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "tonemap.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

layout(set = 2, binding = 0) uniform sampler2D hdr_color;
layout(set = 3, binding = 0, rgba8) uniform writeonly image2D target;

layout(push_constant, scalar) uniform Push {
    uint curve;
};

void main() {
    uvec2 pixel = gl_GlobalInvocationID.xy;
    if (any(greaterThanEqual(pixel, uvec2(imageSize(target))))) {
        return;
    }
    vec3 color = display_color(texelFetch(hdr_color, ivec2(pixel), 0).rgb, curve);
    imageStore(target, ivec2(pixel), vec4(dither(encode_srgb(color), pixel), 1.0));
}
