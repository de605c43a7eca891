// The environment's sky.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "environment.glsl"
#include "finite.glsl"

layout(location = 0) in vec3 in_direction;
layout(location = 0) out vec4 out_color;

void main() {
    vec3 direction = to_environment(normalize(in_direction));
    vec3 radiance = texture(cubes[global.skybox_cubemap_index], direction).rgb;
    // The same factor as reflections, so that a mirror shows the sky that stands behind it.
    out_color = vec4(storable(radiance * global.ibl_intensity), 1.0);
}
