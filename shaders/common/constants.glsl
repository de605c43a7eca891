// Numbers that several files share.
#ifndef CAIRN_CONSTANTS_GLSL
#define CAIRN_CONSTANTS_GLSL

const float PI = 3.14159265358979;
// Radiance from every direction in a scene without an environment.
const float AMBIENT_RADIANCE = 0.1;
// Debug views from here on bypass exposure and tone curve.
const uint FIRST_PASSTHROUGH_VIEW = 4;
// The largest half float.
const float HDR_MAX = 65504.0;

#endif
