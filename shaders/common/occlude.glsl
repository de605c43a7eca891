// What ambient occlusion does to light from the surroundings.
#ifndef CAIRN_OCCLUDE_GLSL
#define CAIRN_OCCLUDE_GLSL

#include "constants.glsl"

// Jimenez et al. 2016, "Practical Realtime Strategies for Accurate Indirect Occlusion", section 5: light that bounces
// between occluders of the same albedo, a cubic fitted per albedo.
vec3 multi_bounce(float visibility, vec3 albedo) {
    vec3 a = 2.0404 * albedo - 0.3324;
    vec3 b = -4.7951 * albedo + 0.6417;
    vec3 c = 2.7552 * albedo + 0.6903;
    return max(vec3(visibility), ((visibility * a + b) * visibility + c) * visibility);
}

// Lagarde and de Rousiers 2014, "Moving Frostbite to PBR", section 4.10.2. `roughness` is perceptual.
float specular_occlusion_lagarde(float n_dot_v, float visibility, float roughness) {
    float exponent = exp2(-16.0 * roughness - 1.0);
    return clamp(pow(n_dot_v + visibility, exponent) - 1.0 + visibility, 0.0, 1.0);
}

// After Jimenez et al. 2016, section 6: the cone of open directions about the bent normal against the specular lobe
// about the reflection. An unoccluded point stays so.
float specular_occlusion_cones(vec3 bent, vec3 reflected, float visibility, float roughness) {
    float open = acos(sqrt(clamp(1.0 - visibility, 0.0, 1.0)));
    // Where a Phong lobe of that roughness has fallen to a hundredth.
    float lobe = max(acos(pow(0.01, 0.5 * roughness * roughness)), 0.01);
    float between = acos(clamp(dot(bent, reflected), -1.0, 1.0));
    float share = smoothstep(0.0, 1.0, (open - between) / lobe);
    return mix(share, 1.0, visibility * visibility);
}

#endif
