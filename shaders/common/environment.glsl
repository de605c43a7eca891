// Image-based light: lookups into the environment's cubes.
#ifndef CAIRN_ENVIRONMENT_GLSL
#define CAIRN_ENVIRONMENT_GLSL

#include "bindings.glsl"
#include "constants.glsl"
#include "options.glsl"

// World direction to the environment's frame: its yaw about +Y.
vec3 to_environment(vec3 d) {
    float s = global.ibl_rotation_sin;
    float c = global.ibl_rotation_cos;
    return vec3(c * d.x + s * d.z, d.y, -s * d.x + c * d.z);
}

// Irradiance / pi.
vec3 environment_irradiance(vec3 normal) {
    if (!HAS_ENVIRONMENT) {
        return vec3(AMBIENT_RADIANCE);
    }
    return textureLod(cubes[global.irradiance_cubemap_index], to_environment(normal), 0.0).rgb;
}

vec3 environment_prefiltered(vec3 direction, float roughness) {
    if (!HAS_ENVIRONMENT) {
        return vec3(AMBIENT_RADIANCE);
    }
    float level = roughness * float(max(global.prefiltered_mip_count, 1u) - 1u);
    return textureLod(cubes[global.prefiltered_cubemap_index], to_environment(direction), level).rgb;
}

#endif
