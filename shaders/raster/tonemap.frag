// HDR to display, into an sRGB target, which encodes.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "tonemap.glsl"

layout(set = 2, binding = 0) uniform sampler2D hdr_color;

layout(push_constant, scalar) uniform Push {
    uint curve;
};

layout(location = 0) out vec4 out_color;

void main() {
    vec3 color = display_color(texelFetch(hdr_color, ivec2(gl_FragCoord.xy), 0).rgb, curve);
    out_color = vec4(decode_srgb(dither(encode_srgb(color), uvec2(gl_FragCoord.xy))), 1.0);
}
