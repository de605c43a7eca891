// Specialisation constants of the path tracer, beside those of common/options.glsl.
#ifndef CAIRN_PATH_OPTIONS_GLSL
#define CAIRN_PATH_OPTIONS_GLSL

// Some geometry is masked or blended: any-hit shaders decide.
layout(constant_id = 32) const bool HAS_ALPHA = true;
// The environment has an importance table.
layout(constant_id = 33) const bool HAS_ENV_TABLE = true;
// The environment's sun shines.
layout(constant_id = 34) const bool HAS_SUN = true;
// Directional, point or spot lights shine.
layout(constant_id = 35) const bool HAS_POINT_LIGHTS = true;
// Some triangles emit and are listed.
layout(constant_id = 36) const bool HAS_EMITTERS = true;
// Some material has a normal map.
layout(constant_id = 37) const bool HAS_NORMAL_MAPS = true;
// Rays are counted.
layout(constant_id = 38) const bool COUNT_RAYS = false;
// Albedo and normal are accumulated for a denoiser.
layout(constant_id = 39) const bool HAS_GUIDES = false;
// What is seen: 0 radiance, else the number of a debug view.
layout(constant_id = 40) const uint VIEW = 0;
// One of the SAMPLER_* numbers.
const uint SAMPLER_BLUE_NOISE = 0;
const uint SAMPLER_INDEPENDENT = 1;
const uint SAMPLER_OWEN = 2;
layout(constant_id = 41) const uint SAMPLER = SAMPLER_BLUE_NOISE;
// Light counts where it is sampled, not where a path meets it: a test of both against each other.
layout(constant_id = 42) const bool SAMPLED_LIGHT_ONLY = false;
// Light reaches surfaces through their back faces' textures at a level that the ray's width asks for.
layout(constant_id = 43) const bool HAS_LOD = true;
// Some surface texture or unlit material exists.
layout(constant_id = 44) const bool HAS_UNLIT = true;
// Every ray is traced twice, with the same result: what that adds to the time is the time of rays.
layout(constant_id = 45) const bool RAYS_TWICE = false;
// Camera rays pass single-sided surfaces from behind; otherwise those are black walls to them too.
layout(constant_id = 46) const bool SEE_THROUGH = true;

#endif
