// From radiance to what a display shows: exposure, tone curve, dithering, sRGB.
#ifndef CAIRN_TONEMAP_GLSL
#define CAIRN_TONEMAP_GLSL

#include "bindings.glsl"
#include "finite.glsl"

const uint CURVE_ACES = 0;
const uint CURVE_LINEAR = 1;
const uint CURVE_AGX = 2;
const uint CURVE_NEUTRAL = 3;
const uint VIEW_OVERDRAW = 11;

// Narkowicz 2016, "ACES Filmic Tone Mapping Curve".
vec3 aces(vec3 x) {
    return (x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14);
}

// The sigmoid of AgX in closed form: slope 2 through (20 / 33, 1 / 2), powers 3 below and 3.25 above.
vec3 agx_sigmoid(vec3 x) {
    const float pivot = 20.0 / 33.0;
    bvec3 below = lessThan(x, vec3(pivot));
    vec3 distance = abs(x - pivot);
    vec3 toe = pow(1.0 + 59.507875 * pow(distance, vec3(3.0)), vec3(-1.0 / 3.0));
    vec3 shoulder = pow(1.0 + 69.86278913545539 * pow(distance, vec3(3.25)), vec3(-4.0 / 13.0));
    return 0.5 + 2.0 * (x - pivot) * mix(shoulder, toe, below);
}

// Sobotka's AgX, base look: inset, sigmoid over 16.5 stops, outset; the display's power of 2.2 makes it linear.
vec3 agx(vec3 color) {
    const mat3 inset = mat3(0.8424010709504686, 0.04240107095046854, 0.04240107095046854,
                            0.07843650156180276, 0.8784365015618028, 0.07843650156180276,
                            0.0791624274877287, 0.0791624274877287, 0.8791624274877287);
    const mat3 outset = mat3(1.1969986613119143, -0.053001338688085674, -0.053001338688085674,
                             -0.09804562695225345, 1.1519543730477466, -0.09804562695225345,
                             -0.09895303435966087, -0.09895303435966087, 1.151046965640339);
    const float first_stop = -12.473931188332413;
    const float stops = 16.5;
    vec3 stop = log2(max(inset * color, vec3(1e-10)));
    vec3 encoded = agx_sigmoid(clamp((stop - first_stop) / stops, 0.0, 1.0));
    return pow(max(outset * encoded, 0.0), vec3(2.2));
}

// Khronos PBR Neutral: colours below 0.76 as they are but for Fresnel's 0.04; brighter ones compressed, then faded.
vec3 neutral(vec3 color) {
    const float start = 0.8 - 0.04;
    const float fading = 0.15;
    float least = min(color.r, min(color.g, color.b));
    color -= least < 0.08 ? least - 6.25 * least * least : 0.04;
    float peak = max(color.r, max(color.g, color.b));
    if (peak < start) {
        return color;
    }
    const float room = 1.0 - start;
    float shown = 1.0 - room * room / (peak + room - start);
    float white = 1.0 - 1.0 / (fading * (peak - shown) + 1.0);
    return mix(color * (shown / peak), vec3(shown), white);
}

vec3 tone_curve(vec3 color, uint curve) {
    switch (curve) {
    case CURVE_ACES: return aces(color);
    case CURVE_AGX: return agx(color);
    case CURVE_NEUTRAL: return neutral(color);
    default: return color;
    }
}

// IEC 61966-2-1.
vec3 encode_srgb(vec3 linear) {
    vec3 curved = 1.055 * pow(linear, vec3(1.0 / 2.4)) - 0.055;
    return mix(curved, linear * 12.92, lessThanEqual(linear, vec3(0.0031308)));
}

vec3 decode_srgb(vec3 encoded) {
    vec3 curved = pow((encoded + 0.055) / 1.055, vec3(2.4));
    return mix(curved, encoded / 12.92, lessThanEqual(encoded, vec3(0.04045)));
}

// Fragments per pixel: black 0, blue 1, green 4, red 8, white from 16 on.
vec3 heat(float count) {
    vec3 cold = mix(vec3(0.0, 0.0, 1.0), vec3(0.0, 1.0, 0.0), clamp((count - 1.0) / 3.0, 0.0, 1.0));
    vec3 warm = mix(cold, vec3(1.0, 0.0, 0.0), clamp((count - 4.0) / 4.0, 0.0, 1.0));
    return mix(warm, vec3(1.0), clamp((count - 8.0) / 8.0, 0.0, 1.0)) * clamp(count, 0.0, 1.0);
}

// Linear light that the display is to emit, 0..1.
vec3 display_color(vec3 radiance, uint curve) {
    vec3 color = storable(radiance);
    if (global.debug_render_mode == VIEW_OVERDRAW) {
        return heat(color.r);
    }
    if (global.debug_render_mode < FIRST_PASSTHROUGH_VIEW) {
        color = tone_curve(storable(color * global.camera_position_and_exposure.w), curve);
    }
    return clamp(color, 0.0, 1.0);
}

// Half a step of 8 bits either way, so that gradients show no bands and what is exactly a code stays one: Jimenez's
// interleaved gradient noise, the same in every frame. Debug views are exact.
vec3 dither(vec3 encoded, uvec2 pixel) {
    if (global.debug_render_mode >= FIRST_PASSTHROUGH_VIEW) {
        return encoded;
    }
    float noise = fract(52.9829189 * fract(dot(vec2(pixel), vec2(0.06711056, 0.00583715))));
    return clamp(encoded + (noise - 0.5) * (0.998 / 255.0), 0.0, 1.0);
}

#endif
