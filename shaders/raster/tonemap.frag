// HDR to display: exposure, tone curve; an sRGB target encodes.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "bindings.glsl"
#include "finite.glsl"

layout(set = 2, binding = 0) uniform sampler2D hdr_color;

layout(push_constant, scalar) uniform Push {
    // 0 ACES, 1 linear.
    uint curve;
};

layout(location = 0) out vec4 out_color;

// Narkowicz 2016, "ACES Filmic Tone Mapping Curve".
vec3 aces(vec3 x) {
    return (x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14);
}

void main() {
    vec3 color = storable(texelFetch(hdr_color, ivec2(gl_FragCoord.xy), 0).rgb);
    if (global.debug_render_mode < FIRST_PASSTHROUGH_VIEW) {
        color = storable(color * global.camera_position_and_exposure.w);
        color = curve == 0u ? aces(color) : color;
    }
    out_color = vec4(clamp(color, 0.0, 1.0), 1.0);
}
