// The shading normal of a fragment.
#ifndef CAIRN_NORMAL_GLSL
#define CAIRN_NORMAL_GLSL

#include "material.glsl"

// Squared length below which an interpolated vector has no direction.
const float DEGENERATE = 1e-12;

// What the vertex shader interpolates, world space.
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

// World normal: the vertex's, bent by the normal map, turned to the side that is seen. In a fragment shader.
vec3 shading_normal(Material material, TexCoords coords, Frame frame, vec3 view, bool front_facing) {
    // Derivatives come first, in uniform control flow.
    vec3 facet = cross(dFdx(frame.position), dFdy(frame.position));
    vec3 mapped = sample_normal(material, coords);
    bool has_tangent = dot(frame.tangent, frame.tangent) > DEGENERATE;
    if (dot(frame.normal, frame.normal) <= DEGENERATE) {
        float length2 = dot(facet, facet);
        vec3 flat_normal = length2 > 0.0 ? facet * inversesqrt(length2) : view;
        return dot(flat_normal, view) < 0.0 ? -flat_normal : flat_normal;
    }
    vec3 normal = frame.normal;
    if (material.normal_tex != NO_TEXTURE && has_tangent) {
        vec3 bitangent = frame.handedness * cross(frame.normal, frame.tangent);
        normal = mapped.x * frame.tangent + mapped.y * bitangent + mapped.z * frame.normal;
        normal = dot(normal, normal) > DEGENERATE ? normal : frame.normal;
    }
    return front_facing ? normalize(normal) : -normalize(normal);
}

#endif
