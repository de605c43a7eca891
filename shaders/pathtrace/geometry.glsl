// Vertices of a hit, through device addresses.
#ifndef CAIRN_PATH_GEOMETRY_GLSL
#define CAIRN_PATH_GEOMETRY_GLSL

#extension GL_EXT_buffer_reference : require
#extension GL_EXT_buffer_reference_uvec2 : require
#include "bindings.glsl"
#include "options.glsl"
#include "path_options.glsl"

layout(buffer_reference, scalar, buffer_reference_align = 4) readonly buffer VertexReference {
    Vertex vertices[];
};
layout(buffer_reference, scalar, buffer_reference_align = 4) readonly buffer IndexReference {
    uvec3 triangles[];
};
layout(buffer_reference, scalar, buffer_reference_align = 16) readonly buffer MeshInstanceReference {
    MeshInstance instances[];
};

layout(set = 0, binding = 5, scalar) readonly buffer GeometryBuffer {
    GeometryInfo geometries[];
};
layout(push_constant, scalar) uniform PushBlock {
    PathTracePush push;
};

// Three vertices and the point between them.
struct Corners {
    VertexReference arena;
    uvec3 index;
    vec3 weight;
};

Corners corners_of(GeometryInfo geometry, uint primitive, vec2 barycentrics) {
    Corners c;
    c.arena = VertexReference(geometry.vertex_buffer_address);
    c.index = IndexReference(geometry.index_buffer_address).triangles[primitive];
    c.weight = vec3(1.0 - barycentrics.x - barycentrics.y, barycentrics);
    return c;
}

vec2 mix3(vec2 a, vec2 b, vec2 c, vec3 weight) {
    return a * weight.x + b * weight.y + c * weight.z;
}

vec3 mix3(vec3 a, vec3 b, vec3 c, vec3 weight) {
    return a * weight.x + b * weight.y + c * weight.z;
}

vec4 vertex_color(GeometryInfo geometry, Corners c) {
    if (!HAS_VERTEX_COLORS) {
        return vec4(1.0);
    }
    uint first = uint((geometry.vertex_buffer_address - push.vertices) / 56ul);
    uvec3 at = first + c.index;
    return mat3x4(arena_color(at.x), arena_color(at.y), arena_color(at.z)) * c.weight;
}

#endif
