// The sky behind a pixel, for stages without derivatives.
#ifndef CAIRN_SKY_GLSL
#define CAIRN_SKY_GLSL

#include "environment.glsl"

// View ray through a point of the image in pixels, any length; linear in it where the projection is a perspective.
vec3 sky_ray(vec2 pixel, vec2 size) {
    if (global.projection[3][3] != 0.0) {
        return vec3(0.0, 0.0, -1.0);
    }
    // Images grow downwards, clip space upwards.
    vec2 ndc = vec2(2.0, -2.0) * (pixel / size) + vec2(-1.0, 1.0);
    return vec3(ndc.x * global.inv_projection[0][0], ndc.y * global.inv_projection[1][1], -1.0);
}

// Radiance of the sky behind a pixel, as reflections show it.
vec3 sky_radiance(ivec2 pixel, ivec2 size) {
    mat3 to_world = mat3(global.inv_view);
    vec2 center = vec2(pixel) + 0.5;
    vec3 middle = sky_ray(center, vec2(size));
    vec3 right = sky_ray(center + vec2(1.0, 0.0), vec2(size)) - middle;
    vec3 down = sky_ray(center + vec2(0.0, 1.0), vec2(size)) - middle;
    vec3 direction = to_environment(to_world * middle);
    vec3 radiance = textureGrad(cubes[global.skybox_cubemap_index], direction, to_environment(to_world * right),
                                to_environment(to_world * down)).rgb;
    // The same factor as reflections, so that a mirror shows the sky that stands behind it.
    return radiance * global.ibl_intensity;
}

#endif
