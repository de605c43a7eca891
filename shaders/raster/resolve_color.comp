// Mean of a pixel's samples with weights 1 / (1 + exposed luminance): a lamp's edge keeps its steps behind the tone
// curve, where a plain mean of radiance would saturate (Karis 2013, "Tone mapping and antialiasing").
#version 460
#extension GL_GOOGLE_include_directive : require
#include "bindings.glsl"
#include "finite.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

layout(constant_id = 0) const int SAMPLES = 4;

layout(set = 3, binding = 0, rgba16f) writeonly uniform image2D resolved;
layout(set = 3, binding = 4) uniform sampler2DMS samples;

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, imageSize(resolved)))) {
        return;
    }
    // Debug values are no radiance.
    bool plain = global.debug_render_mode >= FIRST_PASSTHROUGH_VIEW;
    float exposure = plain ? 0.0 : global.camera_position_and_exposure.w;
    vec3 sum = vec3(0.0);
    float weights = 0.0;
    for (int i = 0; i < SAMPLES; ++i) {
        vec3 radiance = texelFetch(samples, pixel, i).rgb;
        float luminance = dot(radiance, vec3(0.2126, 0.7152, 0.0722));
        float weight = 1.0 / (1.0 + luminance * exposure);
        sum += radiance * weight;
        weights += weight;
    }
    imageStore(resolved, pixel, vec4(storable(sum / weights), 1.0));
}
