// Lights that are sampled: the environment, its sun, directional, point and spot lights, emissive triangles.
//
// Each kind has one density function, which sampling and weighting both call.
#ifndef CAIRN_PATH_LIGHTS_GLSL
#define CAIRN_PATH_LIGHTS_GLSL

#include "geometry.glsl"
#include "lighting.glsl"
#include "offset.glsl"
#include "scatter.glsl"

layout(set = 0, binding = 6, scalar) readonly buffer EnvAliasBuffer {
    EnvAliasHeader env_header;
    EnvAliasEntry env_entries[];
};
layout(set = 0, binding = 7, scalar) readonly buffer EmissiveBuffer {
    EmissiveTriangle emissive[];
};
layout(set = 0, binding = 8, scalar) readonly buffer EmissiveAliasBuffer {
    EmissiveAliasHeader emissive_header;
    EmissiveAliasEntry emissive_entries[];
};

// Of the importance table: cumulative shares of its rows, then for each row those of its cells, as bits of floats; then
// where to search: for each of as many even parts of 0..1 as the run has steps, or up to the next power of two, the
// first step above the part's start.
layout(set = 3, binding = 9, scalar) readonly buffer EnvDistributionBuffer {
    uint env_distribution[];
};

const float FAR = 1e30;

// A proposal to be tested for visibility.
struct LightSample {
    vec3 l;
    float distance;
    vec3 radiance;
    // Per steradian; 0 of lights without extent, whose radiance stands for irradiance.
    float pdf;
};

// Reverses `to_environment`.
vec3 from_environment(vec3 d) {
    float s = global.ibl_rotation_sin;
    float c = global.ibl_rotation_cos;
    return vec3(c * d.x - s * d.z, d.y, s * d.x + c * d.z);
}

vec3 environment_radiance(vec3 direction) {
    if (!HAS_ENVIRONMENT) {
        return vec3(AMBIENT_RADIANCE);
    }
    return textureLod(cubes[global.skybox_cubemap_index], to_environment(direction), 0.0).rgb * global.ibl_intensity;
}

float environment_pdf(vec3 direction) {
    if (!HAS_ENV_TABLE) {
        return 0.0;
    }
    vec3 d = to_environment(direction);
    vec2 uv = vec2(0.5 + atan(d.z, d.x) / (2.0 * PI), acos(clamp(d.y, -1.0, 1.0)) / PI);
    uvec2 size = uvec2(env_header.width, env_header.height);
    uvec2 cell = min(uvec2(uv * vec2(size)), size - 1u);
    return env_entries[cell.y * size.x + cell.x].luminance / env_header.total_luminance;
}

uint guide_parts(uint count) {
    return count > 1u ? 2u << findMSB(count - 1u) : 1u;
}

// First step of an ascending run that exceeds `u`; how far `u` is in it goes to `u` itself.
uint invert(uint first, uint count, uint guide, inout float u) {
    uint parts = guide_parts(count);
    uint part = min(uint(u * float(parts)), parts - 1u);
    uint low = env_distribution[guide + part];
    uint high = part + 1u < parts ? env_distribution[guide + part + 1u] : count - 1u;
    while (low < high) {
        uint middle = (low + high) >> 1;
        if (uintBitsToFloat(env_distribution[first + middle]) > u) {
            high = middle;
        } else {
            low = middle + 1u;
        }
    }
    float below = low > 0u ? uintBitsToFloat(env_distribution[first + low - 1u]) : 0.0;
    u = clamp((u - below) / max(uintBitsToFloat(env_distribution[first + low]) - below, 1e-30), 0.0, 1.0);
    return low;
}

// Inverts the distribution of rows, then of the row's cells: unlike the alias table's, this map keeps neighbouring
// points neighbours, and with it the evenness of the sampler's.
LightSample sample_environment(vec2 u) {
    uvec2 count = uvec2(env_header.width, env_header.height);
    uint guides = count.y + count.y * count.x;
    uint row = invert(0u, count.y, guides, u.y);
    uint guide = guides + guide_parts(count.y) + row * guide_parts(count.x);
    uint column = invert(count.y + row * count.x, count.x, guide, u.x);
    float phi = ((float(column) + u.x) / float(count.x) - 0.5) * 2.0 * PI;
    float top = cos(float(row) / float(count.y) * PI);
    float bottom = cos(float(row + 1u) / float(count.y) * PI);
    float y = mix(top, bottom, u.y);
    float radius = sqrt(max(1.0 - y * y, 0.0));
    vec3 l = from_environment(vec3(radius * cos(phi), y, radius * sin(phi)));
    float pdf = env_entries[row * count.x + column].luminance / env_header.total_luminance;
    return LightSample(l, FAR, environment_radiance(l), pdf);
}

bool in_sun(vec3 direction) {
    vec3 across = cross(direction, push.sun_direction);
    return HAS_SUN && dot(across, across) < push.sun_sin2 && dot(direction, push.sun_direction) > 0.0;
}

// 1 - cos of the angular radius, without cancellation.
float sun_cap() {
    return push.sun_sin2 / (1.0 + sqrt(max(1.0 - push.sun_sin2, 0.0)));
}

float sun_pdf() {
    return 1.0 / (2.0 * PI * sun_cap());
}

LightSample sample_sun(vec2 u) {
    float x = u.x * sun_cap();
    float radius = sqrt(x * (2.0 - x));
    float phi = 2.0 * PI * u.y;
    vec3 l = basis(push.sun_direction) * vec3(radius * cos(phi), radius * sin(phi), 1.0 - x);
    return LightSample(l, FAR, push.sun_radiance, sun_pdf());
}

LightSample sample_point_light(vec3 origin, uint choice) {
    uint directional = push.directional_light_count;
    uint count = directional + push.punctual_light_count;
    uint index, rest;
    umulExtended(choice, count, index, rest);
    LightSample found;
    if (index < directional) {
        DirectionalLight light = lights[index];
        vec3 irradiance = light.color_and_shadow.rgb * light.direction_and_intensity.w;
        found = LightSample(-light.direction_and_intensity.xyz, FAR, irradiance, 0.0);
    } else {
        Incident incident = punctual_incident(punctual_lights[index - directional], origin + push.center);
        found = LightSample(incident.l, incident.distance, incident.irradiance, 0.0);
    }
    found.radiance *= float(count);
    return found;
}

// Per steradian of a point on a triangle, seen at `distance` under the light's `cosine`.
float emissive_pdf(EmissiveTriangle triangle, float distance, float cosine) {
    float per_area = triangle.power / (emissive_header.total_power * triangle.area);
    return per_area * distance * distance / max(cosine, 1e-6);
}

LightSample sample_emitter(vec3 origin, uint choice, vec2 u) {
    uint index, keep;
    umulExtended(choice, push.emissive_count, index, keep);
    EmissiveAliasEntry entry = emissive_entries[index];
    if (float(keep >> 8) * (1.0 / 16777216.0) >= entry.prob) {
        index = entry.alias_index;
    }
    EmissiveTriangle triangle = emissive[index];
    float root = sqrt(u.x);
    vec3 weight = vec3(1.0 - root, root * (1.0 - u.y), root * u.y);
    vec3 edge1 = triangle.v1 - triangle.v0;
    vec3 edge2 = triangle.v2 - triangle.v0;
    vec3 normal = normalize(cross(edge1, edge2));
    // Mirrored instances turn their triangles round: the bake lists corners so that this normal is the front's.
    vec3 point = triangle.v0 - push.center + edge1 * weight.y + edge2 * weight.z;
    LightSample found = LightSample(vec3(0.0), 0.0, vec3(0.0), 1.0);
    float side = dot(origin - point, normal);
    Material material = materials[triangle.material_index];
    if (side <= 0.0 && (material.double_sided & MATERIAL_DOUBLE_SIDED) == 0u) {
        return found;
    }
    vec3 facing = side < 0.0 ? -normal : normal;
    vec3 to_light = offset_origin(point, facing) - origin;
    float distance2 = dot(to_light, to_light);
    found.distance = sqrt(distance2);
    found.l = to_light / max(found.distance, 1e-30);
    float cosine = dot(-found.l, facing);
    if (cosine <= 0.0) {
        return found;
    }
    vec2 uv = mix3(triangle.uv0, triangle.uv1, triangle.uv2, weight);
    vec3 texel = vec3(1.0);
    if (material.emissive_tex != NO_TEXTURE) {
        // The bake has applied the transform to these coordinates.
        texel = textureLod(textures[nonuniformEXT(material.emissive_tex & ~TEXTURE_UV1)], uv, 0.0).rgb;
    }
    found.radiance = triangle.emission * texel;
    found.pdf = emissive_pdf(triangle, distance(origin, point), cosine);
    return found;
}

float power_heuristic(float mine, float other) {
    float a = mine * mine;
    float b = other * other;
    return a > 0.0 ? a / (a + b) : 0.0;
}

#endif
