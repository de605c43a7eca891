// Places one instance's vertex in the world.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "bindings.glsl"
#include "options.glsl"

layout(location = 0) in vec3 in_position;
layout(location = 1) in vec3 in_normal;
layout(location = 2) in vec2 in_uv0;
layout(location = 3) in vec4 in_tangent;
layout(location = 4) in vec2 in_uv1;
layout(location = 5) in uint in_instance;

layout(location = 0) out vec3 out_position;
layout(location = 1) out vec3 out_normal;
layout(location = 2) out vec3 out_tangent;
layout(location = 3) out vec4 out_uv;
layout(location = 4) flat out float out_handedness;
layout(location = 5) flat out uint out_material;
// Written where HAS_VERTEX_COLORS.
layout(location = 6) out vec4 out_vertex_color;

// Every pass that draws the scene computes the same depth.
invariant gl_Position;

vec3 normalize_or_zero(vec3 v) {
    float length2 = dot(v, v);
    return length2 > 0.0 ? v * inversesqrt(length2) : vec3(0.0);
}

void main() {
    Instance instance = instances[in_instance];
    vec4 world = instance.model * vec4(in_position, 1.0);
    gl_Position = global.view_projection * world;

    mat3 model = mat3(instance.model);
    mat3 normal_matrix = mat3(instance.normal_matrix[0].xyz, instance.normal_matrix[1].xyz,
                              instance.normal_matrix[2].xyz);
    out_position = world.xyz;
    // Unit per vertex, then interpolated as they are: MikkTSpace's convention, freed of the model's scale.
    out_normal = normalize_or_zero(normal_matrix * in_normal);
    out_tangent = normalize_or_zero(model * in_tangent.xyz);
    out_uv = vec4(in_uv0, in_uv1);
    // A mirroring matrix turns the cross product of its images round.
    out_handedness = determinant(model) < 0.0 ? -in_tangent.w : in_tangent.w;
    out_material = instance.material_index;
    if (HAS_VERTEX_COLORS) {
        // The index includes the draw's vertex offset, so it counts from the arena's beginning.
        out_vertex_color = arena_color(gl_VertexIndex);
    }
}
