// What screen-space passes know about a pixel's surroundings. Read it only where FEATURE_AO or FEATURE_CONTACT_SHADOWS
// says that the pass ran, and never for blended surfaces: the images hold what lies behind those.
#ifndef CAIRN_OCCLUSION_GLSL
#define CAIRN_OCCLUSION_GLSL

#include "ao_texel.glsl"
#include "bindings.glsl"

layout(set = 2, binding = 3) uniform usampler2D ao_texture;
layout(set = 2, binding = 4) uniform sampler2D contact_texture;

struct Occlusion {
    // Cosine-weighted share of the hemisphere that nothing near blocks, 0..1.
    float visibility;
    // Cosine-weighted mean of the open directions, world space, unit.
    vec3 bent;
};

// `normal` is the answer's bent normal where ambient occlusion is off.
Occlusion screen_occlusion(ivec2 pixel, vec3 normal) {
    if ((global.feature_flags & FEATURE_AO) == 0u) {
        return Occlusion(1.0, normal);
    }
    AoTexel texel = unpack_ao(texelFetch(ao_texture, pixel, 0).xy);
    return Occlusion(texel.visibility, texel.bent);
}

// How much of directional light 0 small things nearby let through, 0..1.
float contact_visibility(ivec2 pixel) {
    if ((global.feature_flags & FEATURE_CONTACT_SHADOWS) == 0u) {
        return 1.0;
    }
    return texelFetch(contact_texture, pixel, 0).r;
}

#endif
