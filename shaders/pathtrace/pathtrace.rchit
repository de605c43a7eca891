// The nearest hit: what and where, no more.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_ray_tracing : require
#include "payload.glsl"

layout(location = 0) rayPayloadInEXT Hit hit;
hitAttributeEXT vec2 attributes;

void main() {
    hit.instance = gl_InstanceID;
    hit.geometry = gl_InstanceCustomIndexEXT + gl_GeometryIndexEXT;
    hit.primitive = gl_PrimitiveID;
    hit.barycentrics = attributes;
    hit.t = gl_HitTEXT;
}
