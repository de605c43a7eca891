// Normals of a point: the triangle's, and the vertices' bent by normal maps.
#ifndef CAIRN_NORMAL_GLSL
#define CAIRN_NORMAL_GLSL

#include "material.glsl"

// Squared length below which an interpolated vector has no direction.
const float DEGENERATE = 1e-12;

// What is interpolated over a triangle, world space.
struct Frame {
    vec3 position;
    vec3 normal;
    vec3 tangent;
    float handedness;
};

// From a surface point to the camera.
vec3 view_direction(vec3 position) {
    if (global.projection[3][3] == 0.0) {
        return normalize(global.camera_position_and_exposure.xyz - position);
    }
    return normalize(global.inv_view[2].xyz);
}

// The triangle's unit normal on the side that `view` points to. `facet` is a normal of any length and sign.
vec3 facing_normal(vec3 facet, vec3 view) {
    float length2 = dot(facet, facet);
    vec3 normal = length2 > 0.0 ? facet * inversesqrt(length2) : view;
    return dot(normal, view) < 0.0 ? -normal : normal;
}

// A normal that faces away from the viewer, as interpolation and normal maps make near silhouettes, is turned just far
// enough to be seen edge-on: reflections then graze the surface instead of entering it.
vec3 visible_normal(vec3 normal, vec3 view) {
    float facing = dot(normal, view);
    return facing < 0.0 ? normalize(normal - facing * view) : normal;
}

// World normal of a point: the vertices', bent by the tangent-space normal `mapped`, turned to the side that is seen.
// Without vertex normals it is the triangle's own.
vec3 bend_normal(vec3 mapped, Frame frame, vec3 facet, vec3 view, bool front_facing) {
    if (dot(frame.normal, frame.normal) <= DEGENERATE) {
        return facing_normal(facet, view);
    }
    vec3 normal = frame.normal;
    if (dot(frame.tangent, frame.tangent) > DEGENERATE) {
        vec3 bitangent = frame.handedness * cross(frame.normal, frame.tangent);
        normal = mapped.x * frame.tangent + mapped.y * bitangent + mapped.z * frame.normal;
        normal = dot(normal, normal) > DEGENERATE ? normal : frame.normal;
    }
    vec3 unit = normalize(normal);
    return visible_normal(front_facing ? unit : -unit, view);
}

#if !defined(CAIRN_EXPLICIT_LOD) && !defined(CAIRN_EXPLICIT_GRADIENT)
// A normal of the fragment's triangle, of any length and sign. In uniform control flow.
vec3 fragment_facet(vec3 position) {
    return cross(dFdx(position), dFdy(position));
}

// The shading normal of a fragment.
vec3 shading_normal(Material material, TexCoords coords, Frame frame, vec3 view, bool front_facing) {
    vec3 facet = fragment_facet(frame.position);
    return bend_normal(sample_normal(material, coords), frame, facet, view, front_facing);
}
#endif

#endif
