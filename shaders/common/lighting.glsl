// Light that falls on a surface: point and spot lights, and the environment.
#ifndef CAIRN_LIGHTING_GLSL
#define CAIRN_LIGHTING_GLSL

#include "brdf.glsl"
#include "environment.glsl"

// Squared metres below which a punctual light's falloff stays what it is there.
const float MIN_DISTANCE2 = 1e-8;

// Direction to a point or spot light, its distance, and what it irradiates a facing plane with (KHR_lights_punctual).
struct Incident {
    vec3 l;
    float distance;
    vec3 irradiance;
};

Incident punctual_incident(PunctualLight light, vec3 position) {
    vec3 to_light = light.position_and_range.xyz - position;
    float distance2 = dot(to_light, to_light);
    float inverse2 = 1.0 / max(distance2, MIN_DISTANCE2);
    vec3 l = to_light * sqrt(inverse2);
    float range = light.position_and_range.w;
    float ratio2 = range > 0.0 ? distance2 / (range * range) : 0.0;
    float window = clamp(1.0 - ratio2 * ratio2, 0.0, 1.0);
    float cosine = dot(light.direction_and_spot_scale.xyz, -l);
    float cone = clamp(light.direction_and_spot_scale.w * cosine + light.spot_offset, 0.0, 1.0);
    return Incident(l, sqrt(distance2), light.color_and_shadow.rgb * (inverse2 * window * cone * cone));
}

// Light from the environment, unoccluded: by Lambert's lobe, and by the others.
struct Ambient {
    vec3 diffuse;
    vec3 specular;
    vec3 coat;
};

// Split sum (Karis 2013). Sheen spreads over all azimuths: irradiance about the normal is three to four times nearer to
// its lobe than the GGX chain about the reflection.
Ambient environment_light(Surface s) {
    vec3 reflected = reflect(-s.view, s.normal);
    Ambient light;
    vec3 irradiance = environment_irradiance(s.normal);
    light.diffuse = diffuse_albedo(s) * irradiance;
    light.specular = specular_albedo(s) * environment_prefiltered(reflected, s.roughness);
    light.coat = vec3(0.0);
    if (HAS_SHEEN && s.sheen_albedo > 0.0) {
        light.specular += sheen_albedo(s) * irradiance;
    }
    if (HAS_CLEARCOAT && s.coat > 0.0) {
        vec3 direction = reflect(-s.view, s.coat_normal);
        light.coat = coat_albedo(s) * environment_prefiltered(direction, s.coat_roughness);
    }
    return light;
}

#endif
