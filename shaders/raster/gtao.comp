// Ground-truth ambient occlusion and bent normal (Jimenez et al. 2016, "Practical realtime strategies for accurate
// indirect occlusion"), unfiltered.
//
// Occlusion is estimated instead of visibility: each slice's open integral is known, so a surface without occluders is
// open exactly, whatever its tilt, the number of slices and the noise; what is left is unbiased, and below 0 at times.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "ao_texel.glsl"
#include "constants.glsl"
#include "noise.glsl"
#include "view.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

layout(constant_id = 0) const uint DIRECTIONS = 3;
layout(constant_id = 1) const uint STEPS = 3;

layout(set = 3, binding = 0, rg32ui) writeonly uniform uimage2D ao_image;

layout(push_constant, scalar) uniform PushBlock {
    GtaoPush push;
};

// Share of the radius over which an occluder's weight falls to 0 (XeGTAO).
const float FALLOFF_RANGE = 0.615;
// Longest search, in image heights: samples farther apart than this say little.
const float LONGEST_SEARCH = 0.5;
// Smallest cosine between normal and view: shading normals may face away from the camera.
const float MIN_COSINE = 1e-3;

// A pixel and what it is searched with.
struct Center {
    ivec2 pixel;
    vec3 position;
    vec3 normal;
    vec3 view;
};

// Sine of the highest elevation above the tangent plane along one side of a slice. Elevations are taken at the texel
// that was read, so that texels beside the slice's line do not rise above the plane that they lie on.
float horizon(Center center, Lens view, ivec2 offset, inout float highest) {
    ivec2 pixel = center.pixel + offset;
    if (any(lessThan(pixel, ivec2(0))) || any(greaterThanEqual(pixel, ivec2(global.screen_size)))) {
        return highest;
    }
    float depth = texelFetch(depth_texture, pixel, 0).r;
    vec3 delta = view_position(view, vec2(pixel), depth) - center.position;
    float towards = dot(delta, center.view);
    float length2 = dot(delta, delta);
    float thickness = push.thin_compensation * (2.0 + push.thin_compensation) * towards * towards;
    float weight = clamp((1.0 - sqrt(length2 + thickness) / push.radius) / FALLOFF_RANGE, 0.0, 1.0);
    float elevation = dot(delta, center.normal) * inversesqrt(max(length2, 1e-30));
    // Infinitely far where there is nothing: the sum is then no number.
    highest = depth > 0.0 ? max(highest, elevation * weight) : highest;
    return highest;
}

// What the horizons hide in a slice: of the visibility in x, of the bent normal along tangent and view in yz.
// h1 and h2 are the horizons' angles from the view, n the projected normal's.
vec3 hidden(float h1, float h2, float n) {
    float s = sin(n), c = cos(n);
    float visible = 0.25 * (2.0 * c - cos(2.0 * h1 - n) - cos(2.0 * h2 + n) + 2.0 * (h1 - h2) * s);
    float tangent = (6.0 * sin(h1 - n) - sin(3.0 * h1 - n) - 6.0 * sin(h2 + n) + sin(3.0 * h2 + n) + 16.0 * s
                     - 3.0 * sin(h1 + n) + 3.0 * sin(h2 - n)) / 12.0;
    float along = (8.0 * c - cos(3.0 * h1 - n) - cos(3.0 * h2 + n) - 3.0 * (cos(h1 + n) + cos(h2 - n))) / 12.0;
    return vec3(c + n * s - visible, 4.0 / 3.0 * s - tangent, 2.0 / 3.0 * c - along);
}

// One slice's part: of the bent normal in xyz, of the occlusion in w.
vec4 slice(Center center, Lens view, vec3 tangent, vec2 reach, float jitter) {
    // The search starts at the next pixel.
    float pixels = length(reach);
    vec2 direction = reach / pixels;
    pixels = min(pixels, LONGEST_SEARCH * global.screen_size.y);
    float near = 0.0, far = 0.0;
    for (uint i = 0; i < STEPS; ++i) {
        float t = (float(i) + jitter) / float(STEPS);
        ivec2 offset = ivec2(round(direction * (1.0 + t * t * max(pixels - 1.0, 0.0))));
        horizon(center, view, offset, near);
        horizon(center, view, -offset, far);
    }
    float along_tangent = dot(center.normal, tangent), along_view = dot(center.normal, center.view);
    float projected = sqrt(along_tangent * along_tangent + along_view * along_view);
    float n = atan(along_tangent, along_view);
    float h1 = max(0.0, n + 0.5 * PI - asin(min(near / projected, 1.0)));
    float h2 = max(0.0, 0.5 * PI - n - asin(min(far / projected, 1.0)));
    vec3 occluded = projected * hidden(h1, h2, n);
    return vec4(tangent * occluded.y + center.view * occluded.z, occluded.x);
}

// Pixels per metre along a tangent, at the centre's distance; rows run downwards.
vec2 screen_step(Center center, Lens view, vec3 tangent) {
    vec2 step = view.perspective
        ? (tangent.xy - center.position.xy * (tangent.z / center.position.z)) / -center.position.z
        : tangent.xy;
    return step / view.slope;
}

vec4 occlusion(Center center, Lens view) {
    vec2 noise = spatial_noise(uvec2(center.pixel), push.noise_frame);
    // Azimuths are even about the view vector, which is not the camera's axis.
    vec3 right = normalize(vec3(center.view.z, 0.0, -center.view.x));
    vec3 up = cross(center.view, right);
    vec4 sum = vec4(0.0);
    for (uint i = 0; i < DIRECTIONS; ++i) {
        float azimuth = (float(i) + noise.x) * (PI / float(DIRECTIONS));
        vec3 tangent = cos(azimuth) * right + sin(azimuth) * up;
        vec2 reach = push.radius * screen_step(center, view, tangent);
        sum += slice(center, view, tangent, reach, noise.y);
    }
    return sum / float(DIRECTIONS);
}

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, ivec2(global.screen_size)))) {
        return;
    }
    AoTexel texel = AoTexel(1.0, vec3(0.0, 0.0, 1.0), DISTANCE_SKY, 0);
    float depth = texelFetch(depth_texture, pixel, 0).r;
    if (depth > 0.0) {
        Lens view = lens();
        vec3 position = view_position(view, vec2(pixel), depth);
        vec3 normal = mat3(global.view) * world_normal(pixel);
        vec3 towards = view_vector(view, position);
        float cosine = dot(normal, towards);
        normal = normalize(normal + max(0.0, MIN_COSINE - cosine) * towards);
        vec4 found = occlusion(Center(pixel, position, normal, towards), view);
        vec3 bent = 2.0 / 3.0 * normal - found.xyz;
        bent = dot(bent, bent) > 1e-12 ? normalize(bent) : normal;
        texel = AoTexel(1.0 - 0.5 * found.w, mat3(global.inv_view) * bent, 0, 0);
    }
    imageStore(ao_image, pixel, uvec4(pack_ao(texel), 0, 0));
}
