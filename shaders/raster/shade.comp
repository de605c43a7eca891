// Shades what the visibility pass found: each triangle of a pixel once, then the pixel's samples weighed as
// resolve_color.comp weighs them, with blended surfaces over them and the sky behind.
#version 460
#extension GL_GOOGLE_include_directive : require
#define CAIRN_EXPLICIT_GRADIENT
#define CAIRN_PIXEL (vec2(gl_GlobalInvocationID.xy) + 0.5)
#include "samples.glsl"
#include "shade.glsl"
#include "sky.glsl"
#include "visible.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

layout(constant_id = 33) const bool SKYBOX = true;

layout(set = 3, binding = 0, rgba16f) uniform writeonly image2D hdr;
layout(set = 3, binding = 6) uniform sampler2DMS layer_samples;

// The colour of the level that the longer side of the footprint asks for, as implicit lookups choose it.
vec3 mip_view(Fetched f) {
    uint reference = materials[f.material].base_color_tex;
    if (reference == NO_TEXTURE) {
        return vec3(0.5);
    }
    vec2 size = vec2(textureSize(textures[nonuniformEXT(reference & ~TEXTURE_UV1)], 0));
    vec4 gradient = texture_gradient(reference, f.coords) * size.xyxy;
    float footprint2 = max(dot(gradient.xy, gradient.xy), dot(gradient.zw, gradient.zw));
    return level_color(0.5 * log2(max(footprint2, 1e-12)));
}

vec3 radiance_of(uvec2 triangle, ivec2 pixel, vec2 point) {
    if (triangle.x == 0u) {
        return SKYBOX ? storable(sky_radiance(pixel, imageSize(hdr))) : vec3(0.0);
    }
    Fetched f = fetch_visible(triangle, vec2(pixel) + point);
    Visible v;
    v.material = f.material;
    v.point = evaluate_material(f.material, f.coords, f.vertex_color);
    v.frame = f.frame;
    v.facet = f.facet;
    v.front_facing = f.front_facing;
    v.pixel = pixel;
    v.levels = DEBUG_VIEW ? mip_view(f) : vec3(0.0);
    return storable(shade(v));
}

vec3 resolve(ivec2 pixel) {
    uvec2 triangles[SAMPLES];
    for (int i = 0; i < SAMPLES; ++i) {
        triangles[i] = triangle_at(pixel, i);
    }
    // Debug values are no radiance.
    bool plain = DEBUG_VIEW && global.debug_render_mode >= FIRST_PASSTHROUGH_VIEW;
    float exposure = plain ? 0.0 : global.camera_position_and_exposure.w;
    vec3 sum = vec3(0.0);
    float weights = 0.0;
    uvec2 at = uvec2(pixel);
    bool layered = all(greaterThanEqual(at, push.layer.xy)) && all(lessThan(at, push.layer.zw));
    uint done = 0u;
    for (int i = 0; i < SAMPLES; ++i) {
        if ((done & (1u << i)) != 0u) {
            continue;
        }
        // The mean of the samples that see the triangle lies inside of it.
        uint same = 0u;
        vec2 point = vec2(0.0);
        for (int j = i; j < SAMPLES; ++j) {
            if (triangles[j] == triangles[i]) {
                same |= 1u << j;
                point += location(j);
            }
        }
        done |= same;
        vec3 surface = radiance_of(triangles[i], pixel, point / float(bitCount(same)));
        for (int j = i; j < SAMPLES; ++j) {
            if ((same & (1u << j)) == 0u) {
                continue;
            }
            vec4 layer = layered ? texelFetch(layer_samples, pixel, j) : vec4(0.0);
            vec3 radiance = layer.rgb + (1.0 - layer.a) * surface;
            float weight = 1.0 / (1.0 + dot(radiance, vec3(0.2126, 0.7152, 0.0722)) * exposure);
            sum += radiance * weight;
            weights += weight;
        }
    }
    return storable(sum / weights);
}

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, imageSize(hdr)))) {
        return;
    }
    vec3 color = SAMPLES == 1 ? radiance_of(triangle_at(pixel, 0), pixel, vec2(0.5)) : resolve(pixel);
    imageStore(hdr, pixel, vec4(color, 1.0));
}
