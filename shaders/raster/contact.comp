// Shadows of small things nearby: one ray per pixel through the depth image towards directional light 0.
//
// The ray is a straight line in the image, and its depth affine along it, as a plane's is. It steps from column to
// column (or row to row) of the image and compares with the depth interpolated between the two texels it passes, which
// is exact on planes: none shadows itself, at any tilt. Where the nearer texel of the two is farther away, it counts
// instead, so that what is interpolated across an edge, where there is no surface, casts nothing.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "noise.glsl"
#include "view.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

layout(set = 3, binding = 0, r8) writeonly uniform image2D contact_image;

layout(push_constant, scalar) uniform PushBlock {
    ContactPush push;
};

// Part of the ray over which its shadows fade out.
const float FADE_START = 0.75;
// Width of the image's border towards which shadows fade, in parts of its size.
const float BORDER = 0.05;
// A ray clears the surface that it leaves by this much of the distance: depth is rounded, and triangles are flat.
const float CLEARANCE = 2e-4;

// A point of the image: pixels, and reverse-Z depth.
vec3 to_image(vec4 clip) {
    vec3 ndc = clip.xyz / clip.w;
    return vec3((ndc.xy * vec2(0.5, -0.5) + 0.5) * global.screen_size - 0.5, ndc.z);
}

// Depth of the scene on a line that crosses the pixel's column, or its row where the line is steep.
float scene_depth(vec2 at, bool steep) {
    vec2 low = steep ? vec2(floor(at.x), round(at.y)) : vec2(round(at.x), floor(at.y));
    float part = steep ? at.x - low.x : at.y - low.y;
    ivec2 last = ivec2(global.screen_size) - 1;
    ivec2 first = clamp(ivec2(low), ivec2(0), last);
    ivec2 second = min(first + (steep ? ivec2(1, 0) : ivec2(0, 1)), last);
    float a = texelFetch(depth_texture, first, 0).r, b = texelFetch(depth_texture, second, 0).r;
    return min(mix(a, b, part), part < 0.5 ? a : b);
}

// Fades where what lies outside of the image might cast a shadow, too.
float border_fade(vec2 at) {
    vec2 uv = (at + 0.5) / global.screen_size;
    vec2 inward = smoothstep(vec2(0.0), vec2(BORDER), min(uv, 1.0 - uv));
    return inward.x * inward.y;
}

// Part of the line from `start` on that lies in the image.
float inside_part(vec2 start, vec2 way) {
    vec2 border = mix(vec2(-0.5), global.screen_size - 0.5, greaterThan(way, vec2(0.0)));
    vec2 part = (border - start) / mix(way, vec2(1e-12), equal(way, vec2(0.0)));
    return clamp(min(part.x, part.y), 0.0, 1.0);
}

// Visibility along the line from `start` to `end`, `noise` in 0..1.
float march(Lens view, vec3 start, vec3 end, float noise) {
    vec3 way = end - start;
    bool steep = abs(way.y) > abs(way.x);
    float whole = max(abs(way.x), abs(way.y));
    float pixels = floor(whole * inside_part(start.xy, way.xy));
    // A ray within its own pixel meets nothing.
    uint count = min(push.steps, uint(pixels));
    // Whole columns or rows: each of them where they are few, denser near the surface where they are not.
    bool sparse = float(count) < pixels;
    float last = view_distance(view, start.z);
    for (uint i = 0; i < count; ++i) {
        float part = (float(i) + noise) / float(count);
        float columns = sparse ? max(round(part * part * pixels), float(i + 1)) : float(i + 1);
        float t = columns / whole;
        vec3 at = start + way * t;
        // In front of the near plane.
        if (at.z >= 1.0) {
            break;
        }
        float depth = scene_depth(at.xy, steep);
        float ray = view_distance(view, max(at.z, 1e-12));
        float behind = depth > 0.0 ? ray - view_distance(view, depth) : 0.0;
        if (behind > CLEARANCE * ray && behind < max(push.thickness, abs(ray - last))) {
            return 1.0 - (1.0 - smoothstep(FADE_START, 1.0, t)) * border_fade(at.xy);
        }
        last = ray;
    }
    return 1.0;
}

float visibility(ivec2 pixel) {
    float depth = texelFetch(depth_texture, pixel, 0).r;
    if (depth <= 0.0) {
        return 1.0;
    }
    vec3 light = -lights[0].direction_and_intensity.xyz;
    if (dot(world_normal(pixel), light) <= 0.0) {
        return 1.0;
    }
    Lens view = lens();
    vec3 origin = view_position(view, vec2(pixel), depth);
    vec3 direction = mat3(global.view) * light;
    float reach = push.reach;
    // Up to just in front of the camera.
    if (view.perspective && direction.z > 0.0) {
        reach = min(reach, 0.99 * -origin.z / direction.z);
    }
    vec3 end = to_image(global.projection * vec4(origin + direction * reach, 1.0));
    return march(view, vec3(vec2(pixel), depth), end, spatial_noise(uvec2(pixel), 0).x);
}

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, ivec2(global.screen_size)))) {
        return;
    }
    imageStore(contact_image, pixel, vec4(visibility(pixel)));
}
