// The one guard in front of HDR targets.
#ifndef CAIRN_FINITE_GLSL
#define CAIRN_FINITE_GLSL

#include "constants.glsl"

// The exponent bits are read because a compiler may assume that isnan() is false.
bool is_finite(float value) {
    return (floatBitsToUint(value) & 0x7f800000u) != 0x7f800000u;
}

// Radiance that a half-float target holds: non-finite and negative channels become 0.
vec3 storable(vec3 radiance) {
    bvec3 good = bvec3(is_finite(radiance.r), is_finite(radiance.g), is_finite(radiance.b));
    return clamp(mix(vec3(0.0), radiance, good), 0.0, HDR_MAX);
}

#endif
