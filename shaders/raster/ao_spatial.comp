// Filters ambient occlusion over 5 x 5 pixels of the same surface.
//
// Depths are compared with the centre's plane: on a plane, depth is affine in the image, so a surface is one at every
// tilt. Normals keep creases apart.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "ao_texel.glsl"
#include "view.glsl"

const int GROUP = 8;
const int RADIUS = 2;
const int TILE = GROUP + 2 * RADIUS;

layout(local_size_x = GROUP, local_size_y = GROUP) in;

layout(set = 3, binding = 0, rg32ui) writeonly uniform uimage2D filtered_image;
layout(set = 3, binding = 4) uniform usampler2D noisy_texture;

layout(push_constant, scalar) uniform PushBlock {
    AoSpatialPush push;
};

// Distance from the plane, in parts of the distance to the camera, at which a pixel's weight is gone.
const float PLANE_TOLERANCE = 0.01;
// The weight within half of that is full.
const float PLANE_PLATEAU = 2.0;
// Cosine between normals below which a pixel belongs to another surface.
const float CREASE_COSINE = 0.5;
// Standard deviation of the kernel, pixels.
const float SIGMA = 1.5;

// Depth, visibility in -1..1.
shared vec2 tile_values[TILE][TILE];
shared vec3 tile_normals[TILE][TILE];
shared vec3 tile_bent[TILE][TILE];

void load(ivec2 at, ivec2 origin) {
    ivec2 pixel = origin + at - RADIUS;
    bool inside = all(greaterThanEqual(pixel, ivec2(0))) && all(lessThan(pixel, ivec2(global.screen_size)));
    float depth = inside ? texelFetch(depth_texture, pixel, 0).r : 0.0;
    tile_values[at.y][at.x] = vec2(depth, 1.0);
    if (depth > 0.0) {
        AoTexel texel = unpack_ao(texelFetch(noisy_texture, pixel, 0).xy);
        tile_values[at.y][at.x].y = texel.visibility * 2.0 - 1.0;
        tile_normals[at.y][at.x] = world_normal(pixel);
        tile_bent[at.y][at.x] = texel.bent;
    }
}

// Change of depth per pixel along an axis: of the two sides, the one that changes less belongs to the surface.
float gradient(ivec2 at, ivec2 axis) {
    float center = tile_values[at.y][at.x].x;
    float after = tile_values[at.y + axis.y][at.x + axis.x].x - center;
    float before = center - tile_values[at.y - axis.y][at.x - axis.x].x;
    return abs(after) < abs(before) ? after : before;
}

AoTexel filtered(ivec2 at) {
    float depth = tile_values[at.y][at.x].x;
    vec3 normal = tile_normals[at.y][at.x];
    vec2 slope = vec2(gradient(at, ivec2(1, 0)), gradient(at, ivec2(0, 1)));
    // In parts of the distance; parallel projections have no camera, and take the depth range instead.
    float scale = 1.0 / (PLANE_TOLERANCE * (global.projection[2][3] != 0.0 ? depth : 1.0));
    float visibility = 0.0, total = 0.0;
    vec3 bent = vec3(0.0);
    for (int y = -RADIUS; y <= RADIUS; ++y) {
        for (int x = -RADIUS; x <= RADIUS; ++x) {
            ivec2 tap = at + ivec2(x, y);
            vec2 value = tile_values[tap.y][tap.x];
            // Reads of sky pixels are void.
            if (value.x <= 0.0) {
                continue;
            }
            float off_plane = abs(value.x - depth - dot(slope, vec2(x, y))) * scale;
            float cosine = dot(normal, tile_normals[tap.y][tap.x]);
            float weight = exp(float(x * x + y * y) / (-2.0 * SIGMA * SIGMA))
                         * clamp(PLANE_PLATEAU * (1.0 - off_plane), 0.0, 1.0)
                         * clamp((cosine - CREASE_COSINE) / (1.0 - CREASE_COSINE), 0.0, 1.0);
            visibility += weight * value.y;
            bent += weight * max(value.y, 0.01) * tile_bent[tap.y][tap.x];
            total += weight;
        }
    }
    // The centre's own weight is 1, but for the rounding of its normal's length.
    float mean = clamp(visibility / max(total, 1e-6), 0.0, 1.0);
    bent = dot(bent, bent) > 1e-12 ? normalize(bent) : tile_bent[at.y][at.x];
    return AoTexel(pow(mean, push.intensity), bent, distance_code(view_distance(lens(), depth)), 0);
}

void main() {
    ivec2 origin = ivec2(gl_WorkGroupID.xy) * GROUP;
    for (uint i = gl_LocalInvocationIndex; i < TILE * TILE; i += GROUP * GROUP) {
        load(ivec2(i % TILE, i / TILE), origin);
    }
    barrier();
    ivec2 local = ivec2(gl_LocalInvocationID.xy), pixel = origin + local;
    if (any(greaterThanEqual(pixel, ivec2(global.screen_size)))) {
        return;
    }
    AoTexel texel = AoTexel(1.0, vec3(0.0, 0.0, 1.0), DISTANCE_SKY, 0);
    if (tile_values[local.y + RADIUS][local.x + RADIUS].x > 0.0) {
        texel = filtered(local + RADIUS);
    }
    imageStore(filtered_image, pixel, uvec4(pack_ao(texel), 0, 0));
}
