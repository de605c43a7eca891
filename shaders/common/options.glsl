// Specialisation constants of what shades surfaces.
#ifndef CAIRN_OPTIONS_GLSL
#define CAIRN_OPTIONS_GLSL

// Fragments below the material's cutoff are discarded.
layout(constant_id = 0) const bool MASKED = false;
// The base colour's alpha reaches the blend unit.
layout(constant_id = 1) const bool BLENDED = false;
// The environment's cubes exist; otherwise a constant ambient radiance lights the scene.
layout(constant_id = 2) const bool HAS_ENVIRONMENT = true;
// The BRDF table exists; otherwise an analytic fit stands in.
layout(constant_id = 3) const bool HAS_LUT = true;
layout(constant_id = 4) const bool HAS_LIGHTS = true;
// true: multiple scattering is compensated. false: glTF's core BRDF, single scattering.
layout(constant_id = 5) const bool BRDF_ENERGY = true;
// Vertices have colours, which multiply the base colour and its alpha.
layout(constant_id = 6) const bool HAS_VERTEX_COLORS = false;
// Texture coordinates pass through their slot's transform.
layout(constant_id = 7) const bool HAS_TEXTURE_TRANSFORMS = false;
// Some material has a clear coat, a dielectric reflection of its own, sheen: binding 12 of set 0 is there.
layout(constant_id = 8) const bool HAS_CLEARCOAT = false;
layout(constant_id = 9) const bool HAS_SPECULAR = false;
layout(constant_id = 10) const bool HAS_SHEEN = false;
// Point and spot lights that shine.
layout(constant_id = 11) const uint PUNCTUAL_LIGHTS = 0;
// A debug view is drawn; without, none of its code is there.
layout(constant_id = 12) const bool DEBUG_VIEW = false;
// Ambient occlusion and contact shadows of the screen are there.
layout(constant_id = 13) const bool SCREEN_OCCLUSION = false;
layout(constant_id = 14) const bool CONTACT_SHADOWS = false;
// Filter of the shadow map: one of the SHADOWS_* numbers.
const uint SHADOWS_NONE = 0;
const uint SHADOWS_PCF = 1;
const uint SHADOWS_PCSS = 2;
layout(constant_id = 15) const uint SHADOWS = SHADOWS_NONE;

#endif
