// The environment's sky in the pixels that nothing covers; one sample per pixel.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "environment.glsl"
#include "finite.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

layout(set = 2, binding = 1) uniform sampler2D depth_texture;
layout(set = 3, binding = 0, rgba16f) uniform writeonly image2D hdr;

// View ray through a point of the image in pixels, any length; linear in it where the projection is a perspective.
vec3 ray(vec2 pixel, vec2 size) {
    if (global.projection[3][3] != 0.0) {
        return vec3(0.0, 0.0, -1.0);
    }
    // Images grow downwards, clip space upwards.
    vec2 ndc = vec2(2.0, -2.0) * (pixel / size) + vec2(-1.0, 1.0);
    return vec3(ndc.x * global.inv_projection[0][0], ndc.y * global.inv_projection[1][1], -1.0);
}

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    ivec2 size = imageSize(hdr);
    if (any(greaterThanEqual(pixel, size)) || texelFetch(depth_texture, pixel, 0).r != 0.0) {
        return;
    }
    mat3 to_world = mat3(global.inv_view);
    vec2 center = vec2(pixel) + 0.5;
    vec3 middle = ray(center, vec2(size));
    vec3 right = ray(center + vec2(1.0, 0.0), vec2(size)) - middle;
    vec3 down = ray(center + vec2(0.0, 1.0), vec2(size)) - middle;
    vec3 direction = to_environment(to_world * middle);
    vec3 radiance = textureGrad(cubes[global.skybox_cubemap_index], direction, to_environment(to_world * right),
                                to_environment(to_world * down)).rgb;
    // The same factor as reflections, so that a mirror shows the sky that stands behind it.
    imageStore(hdr, pixel, vec4(storable(radiance * global.ibl_intensity), 1.0));
}
