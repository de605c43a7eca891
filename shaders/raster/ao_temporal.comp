// Joins this frame's ambient occlusion with that of the frames before.
//
// Each of the four texels around the reprojected pixel is taken only where it showed the same surface then: its
// distance is kept beside it. The mean counts its frames, so that it converges at once after a reset.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "ao_texel.glsl"
#include "view.glsl"

const int GROUP = 8;
const int TILE = GROUP + 2;

layout(local_size_x = GROUP, local_size_y = GROUP) in;

layout(set = 3, binding = 0, rg32ui) writeonly uniform uimage2D ao_image;
layout(set = 3, binding = 4) uniform usampler2D current_texture;
layout(set = 3, binding = 5) uniform usampler2D history_texture;

layout(push_constant, scalar) uniform PushBlock {
    AoTemporalPush push;
};

// Accepted difference of distances, in parts of the distance; a tilted surface's own slope comes on top.
const float DISTANCE_TOLERANCE = 0.01;
// Share of four texels below which the history tells nothing.
const float LEAST_SHARE = 0.05;
// How far the history may lie outside of what this frame's neighbourhood holds.
const float CLAMP_MARGIN = 0.02;

// Codes of x: visibility and distance.
shared uint tile[TILE][TILE];

float tile_visibility(ivec2 at) {
    return float(tile[at.y][at.x] & 0xffffu) / 65535.0;
}

// Distance to the camera along the view, in the frame that has this view-projection matrix. Parallel projections
// count from their near plane.
float distance_in(mat4 view_projection, vec4 clip) {
    vec3 row = vec3(view_projection[0][2], view_projection[1][2], view_projection[2][2]);
    return global.projection[2][3] != 0.0 ? clip.w : (1.0 - clip.z) / length(row);
}

// Largest change of the distance to a neighbour on the same surface: per axis, of the side that changes less.
float slope(ivec2 at, float distance) {
    float sum = 0.0;
    for (int axis = 0; axis < 2; ++axis) {
        ivec2 step = axis == 0 ? ivec2(1, 0) : ivec2(0, 1);
        float after = distance_of(tile[at.y + step.y][at.x + step.x] >> 16);
        float before = distance_of(tile[at.y - step.y][at.x - step.x] >> 16);
        sum += min(abs(after - distance), abs(before - distance));
    }
    return sum;
}

// Least and greatest visibility of 3 x 3 pixels.
vec2 neighbourhood(ivec2 at) {
    vec2 range = vec2(1.0, 0.0);
    for (int y = -1; y <= 1; ++y) {
        for (int x = -1; x <= 1; ++x) {
            float value = tile_visibility(at + ivec2(x, y));
            range = vec2(min(range.x, value), max(range.y, value));
        }
    }
    return range;
}

struct History {
    float share;
    float visibility;
    float frames;
    vec3 bent;
};

// `at` counts texels; texel centres are integers.
History fetch_history(vec2 at, float expected, float tolerance) {
    ivec2 base = ivec2(floor(at));
    vec2 part = at - vec2(base);
    History sum = History(0.0, 0.0, 0.0, vec3(0.0));
    for (int i = 0; i < 4; ++i) {
        ivec2 corner = ivec2(i & 1, i >> 1), pixel = base + corner;
        bool inside = all(greaterThanEqual(pixel, ivec2(0))) && all(lessThan(pixel, ivec2(global.screen_size)));
        if (!inside) {
            continue;
        }
        AoTexel texel = unpack_ao(texelFetch(history_texture, pixel, 0).xy);
        if (texel.distance_code == DISTANCE_SKY || abs(distance_of(texel.distance_code) - expected) > tolerance) {
            continue;
        }
        vec2 near = mix(1.0 - part, part, vec2(corner));
        float weight = near.x * near.y;
        sum.share += weight;
        sum.visibility += weight * texel.visibility;
        sum.frames += weight * float(texel.frames);
        sum.bent += weight * texel.bent;
    }
    return sum;
}

AoTexel joined(AoTexel current, ivec2 pixel, ivec2 at) {
    float depth = texelFetch(depth_texture, pixel, 0).r;
    vec3 position = view_position(lens(), vec2(pixel), depth);
    vec4 clip = global.prev_view_projection * (global.inv_view * vec4(position, 1.0));
    // Behind the last frame's camera.
    if (clip.w <= 0.0) {
        return current;
    }
    vec2 uv = clip.xy / clip.w * vec2(0.5, -0.5) + 0.5;
    float expected = distance_in(global.prev_view_projection, clip);
    float distance = distance_of(current.distance_code);
    float tolerance = DISTANCE_TOLERANCE * expected + slope(at, distance);
    History history = fetch_history(uv * global.screen_size - 0.5, expected, tolerance);
    if (history.share < LEAST_SHARE) {
        return current;
    }
    vec2 range = neighbourhood(at) + vec2(-CLAMP_MARGIN, CLAMP_MARGIN);
    float past = clamp(history.visibility / history.share, range.x, range.y);
    float frames = history.frames / history.share;
    float weight = min(push.weight, (frames + 1.0) / (frames + 2.0));
    vec3 bent = mix(current.bent, history.bent / history.share, weight);
    current.visibility = mix(current.visibility, past, weight);
    current.bent = dot(bent, bent) > 1e-6 ? normalize(bent) : current.bent;
    current.frames = uint(frames + 1.5);
    return current;
}

void main() {
    ivec2 origin = ivec2(gl_WorkGroupID.xy) * GROUP, last = ivec2(global.screen_size) - 1;
    for (uint i = gl_LocalInvocationIndex; i < TILE * TILE; i += GROUP * GROUP) {
        ivec2 at = ivec2(i % TILE, i / TILE);
        tile[at.y][at.x] = texelFetch(current_texture, clamp(origin + at - 1, ivec2(0), last), 0).x;
    }
    barrier();
    ivec2 local = ivec2(gl_LocalInvocationID.xy), pixel = origin + local;
    if (any(greaterThan(pixel, last))) {
        return;
    }
    AoTexel texel = unpack_ao(texelFetch(current_texture, pixel, 0).xy);
    if (texel.distance_code != DISTANCE_SKY && push.valid != 0u) {
        texel = joined(texel, pixel, local + 1);
    }
    imageStore(ao_image, pixel, uvec4(pack_ao(texel), 0, 0));
}
