// Shadow of directional light 0, the only one with a shadow map: cascades, PCF and PCSS.
//
// The receiver's plane comes from the geometric normal, not from derivatives, and the map has one level: every
// function may be called in divergent control flow.
#ifndef CAIRN_SHADOW_GLSL
#define CAIRN_SHADOW_GLSL

#include "bindings.glsl"
#include "constants.glsl"
#include "options.glsl"

// The pixel's centre; stages other than fragment shaders define it before any include.
#ifndef CAIRN_PIXEL
#define CAIRN_PIXEL gl_FragCoord.xy
#endif

// Compares by GREATER_OR_EQUAL with linear filtering; outside of the map all is lit.
layout(set = 2, binding = 5) uniform sampler2DArrayShadow shadow_map;
// The same image, unfiltered.
layout(set = 2, binding = 6) uniform sampler2DArray shadow_depth;

// Tangent of the angle to the light up to which a kernel follows the receiver's plane. Steeper, it would reach under
// what stands on the plane and leak light; the rest is made up by a longer normal offset.
const float PCF_MAX_SLOPE = 1.0;
// PCSS follows the plane down to one degree, as its kernel is the light's own cone, but at most half the way to the
// blockers.
const float PCSS_MAX_SLOPE = 57.0;
// Rounding of a position's way to light depth, relative to the magnitudes involved.
const float ROUNDING = 1e-6;
const uint PCSS_EARLY_OUT = 0x1u;

// A point in a cascade's map.
struct Receiver {
    vec2 uv;
    float depth;
    // Change of the receiver plane's depth per UV.
    vec2 slope;
};

// Vogel's spiral: `count` points of equal share in the unit disc.
vec2 disc_point(uint index, uint count, float rotation) {
    float angle = float(index) * 2.39996323 + rotation;
    return sqrt((float(index) + 0.5) / float(count)) * vec2(cos(angle), sin(angle));
}

// Jimenez 2014. Fixed in screen space: no filter over time would hide a pattern that moves.
float screen_noise(vec2 pixel) {
    return fract(52.9829189 * fract(dot(pixel, vec2(0.06711056, 0.00583715))));
}

uint shadow_cascade(float view_depth) {
    uint cascade = 0;
    while (cascade + 1 < global.shadow_cascade_count && view_depth >= global.cascade_splits[cascade]) {
        ++cascade;
    }
    return cascade;
}

// Debug view 8: red, green, blue, yellow; grey without shadows.
vec3 cascade_color(float view_depth) {
    if (SHADOWS == SHADOWS_NONE || global.shadow_cascade_count == 0) {
        return vec3(0.5);
    }
    const vec3 colors[4] =
        vec3[4](vec3(1.0, 0.0, 0.0), vec3(0.0, 1.0, 0.0), vec3(0.0, 0.0, 1.0), vec3(1.0, 1.0, 0.0));
    return colors[shadow_cascade(view_depth)];
}

// `kernel`: radius in texels of what follows the plane only up to `max_slope`.
Receiver shadow_receiver(uint cascade, vec3 position, vec3 normal, float kernel, float max_slope) {
    mat4 matrix = global.cascade_view_proj[cascade];
    mat3 rows = transpose(mat3(matrix));
    float texel = global.cascade_texel_world_size[cascade];
    float width = texel / global.shadow_texel_size;
    float inverse_range = length(rows[2]);

    // The normal in light space, z towards the light.
    vec3 n = vec3(dot(normal, rows[0]) * 0.5 * width, dot(normal, rows[1]) * 0.5 * width,
                  dot(normal, rows[2]) / inverse_range);
    float across = length(n.xy);
    float followed = n.z > 0.0 ? min(1.0, max_slope * n.z / max(across, 1e-6)) : 0.0;
    vec2 slope = -n.xy / max(n.z, 1e-6) * followed;

    // A comparison's 2x2 texels lie within one texel per axis; what else the kernel needs, it follows or not.
    float footprint = (abs(n.x) + abs(n.y)) * (1.0 + kernel * (1.0 - followed));
    float magnitude = abs(position.x) + abs(position.y) + abs(position.z);
    vec3 lifted = position + normal * (footprint * texel * global.shadow_normal_offset);
    vec3 clip = (matrix * vec4(lifted, 1.0)).xyz;
    float rounding = ROUNDING * (1.0 + magnitude * inverse_range);
    return Receiver(clip.xy * 0.5 + 0.5, min(clip.z + rounding, 1.0), slope * width * inverse_range);
}

// Depth to compare with at `offset` from the receiver, at most `most` above the receiver's. What lies under the
// receiver's plane cannot shadow it, nor can what is farther from the light than the receiver itself.
float reference_depth(Receiver r, vec2 offset, float most) {
    return r.depth + clamp(dot(r.slope, offset), 0.0, most);
}

float lit_at(uint cascade, Receiver r, vec2 uv, float most) {
    float depth = min(reference_depth(r, uv - r.uv, most), 1.0);
    return texture(shadow_map, vec4(uv, float(cascade), depth));
}

// Mean of (2 radius + 1)^2 bilinear comparisons one texel apart, in (radius + 1)^2 taps: per axis the 2 radius + 2
// texels weigh 1 - f, 1, .., 1, f, and each pair of them is one bilinear tap.
float pcf(uint cascade, Receiver r, int radius) {
    vec2 at = r.uv / global.shadow_texel_size - 0.5;
    vec2 first = floor(at);
    vec2 f = at - first;
    float sum = 0.0;
    for (int y = 0; y <= radius; ++y) {
        for (int x = 0; x <= radius; ++x) {
            ivec2 pair = ivec2(x, y);
            vec2 near_weight = mix(vec2(1.0), 1.0 - f, equal(pair, ivec2(0)));
            vec2 far_weight = mix(vec2(1.0), f, equal(pair, ivec2(radius)));
            vec2 weight = near_weight + far_weight;
            vec2 texel = first + vec2(2 * pair - radius) + far_weight / weight + 0.5;
            sum += weight.x * weight.y * lit_at(cascade, r, texel * global.shadow_texel_size, 1.0);
        }
    }
    float side = float(2 * radius + 1);
    return sum / (side * side);
}

// Fernando 2005 for a disc at infinity, whose cone widens linearly with the distance to the receiver.
float pcss(uint cascade, Receiver r) {
    float rotation = 2.0 * PI * screen_noise(CAIRN_PIXEL);
    float texel = global.shadow_texel_size;
    // Blockers lie between the receiver and the map's near plane.
    float search = max(0.5 * global.cascade_pcss_scale[cascade] * (1.0 - r.depth), texel);
    uint count = global.pcss_blocker_samples;
    float sum = 0.0;
    uint blockers = 0;
    for (uint i = 0; i < count; ++i) {
        vec2 offset = disc_point(i, count, rotation) * search;
        float depth = textureLod(shadow_depth, vec3(r.uv + offset, float(cascade)), 0.0).r;
        if (depth > reference_depth(r, offset, 1.0)) {
            sum += depth;
            ++blockers;
        }
    }
    if (blockers == 0) {
        return 1.0;
    }
    if (blockers == count && (global.pcss_flags & PCSS_EARLY_OUT) != 0u) {
        return 0.0;
    }
    float distance = sum / float(blockers) - r.depth;
    float radius = clamp(0.5 * global.cascade_pcss_scale[cascade] * distance, texel, search);
    float lit = 0.0;
    count = global.pcss_pcf_samples;
    for (uint i = 0; i < count; ++i) {
        lit += lit_at(cascade, r, r.uv + disc_point(i, count, rotation) * radius, 0.5 * distance);
    }
    return lit / float(count);
}

float cascade_shadow(uint cascade, vec3 position, vec3 normal) {
    if (SHADOWS == SHADOWS_PCSS) {
        return pcss(cascade, shadow_receiver(cascade, position, normal, 1.0, PCSS_MAX_SLOPE));
    }
    int radius = int(global.shadow_pcf_radius);
    return pcf(cascade, shadow_receiver(cascade, position, normal, float(radius), PCF_MAX_SLOPE), radius);
}

// Share of light `light` that reaches a point: 0 in shadow, 1 lit. `position` is in the world, `geometric_normal` the
// triangle's unit normal on the side that is seen, without normal map; `view_depth` is in metres along the view.
float directional_shadow(uint light, vec3 position, vec3 geometric_normal, float view_depth) {
    if (SHADOWS == SHADOWS_NONE || light != 0 || global.shadow_cascade_count == 0
        || lights[0].color_and_shadow.w == 0.0) {
        return 1.0;
    }
    float start = global.shadow_max_distance * (1.0 - global.shadow_distance_fade_width);
    float fade = 1.0 - smoothstep(start, global.shadow_max_distance, view_depth);
    if (fade <= 0.0) {
        return 1.0;
    }
    uint cascade = shadow_cascade(view_depth);
    float lit = cascade_shadow(cascade, position, geometric_normal);
    if (cascade + 1 < global.shadow_cascade_count) {
        float end = global.cascade_splits[cascade];
        float band = max(end * global.shadow_blend_width, 1e-6);
        float blend = clamp((view_depth - end) / band + 1.0, 0.0, 1.0);
        if (blend > 0.0) {
            lit = mix(lit, cascade_shadow(cascade + 1, position, geometric_normal), blend);
        }
    }
    return mix(1.0, lit, fade);
}

#endif
