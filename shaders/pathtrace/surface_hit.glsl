// What a ray met, ready to be shaded.
#ifndef CAIRN_PATH_SURFACE_HIT_GLSL
#define CAIRN_PATH_SURFACE_HIT_GLSL

#include "geometry.glsl"
#include "normal.glsl"
#include "offset.glsl"

struct Point {
    vec3 position;
    // The triangle's normal on the ray's side, unit.
    vec3 geometric;
    bool front;
    uint material;
    Frame frame;
    TexCoords coords;
    vec4 color;
    // Number of the emissive triangle; NO_EMISSION where there is none.
    uint emitter;
    // Where rays leave on the ray's side.
    vec3 origin;
};

// Linear part of an instance's transform.
mat3 linear_of(MeshInstance instance) {
    return transpose(mat3(instance.transform[0].xyz, instance.transform[1].xyz, instance.transform[2].xyz));
}

vec3 place(MeshInstance instance, vec3 p) {
    vec4 q = vec4(p, 1.0);
    return vec3(dot(instance.transform[0], q), dot(instance.transform[1], q), dot(instance.transform[2], q));
}

vec3 unit_or_zero(vec3 v) {
    float length2 = dot(v, v);
    return length2 > 0.0 ? v * inversesqrt(length2) : vec3(0.0);
}

// log2 of the width in texture coordinates of a ray `width` wide, under `cosine`: the square root of the areas.
float footprint(vec2 a, vec2 b, vec2 c, float area2, float width, float cosine) {
    vec2 e1 = b - a, e2 = c - a;
    float uv_area2 = abs(e1.x * e2.y - e1.y * e2.x);
    return HAS_LOD && uv_area2 > 0.0 && area2 > 0.0
        ? log2(width) + 0.5 * log2(uv_area2 / (area2 * max(cosine, 1e-3)))
        : -64.0;
}

// Index of a hit's instance record.
uint instance_of(Hit hit) {
    uint merged = push.merged_geometries;
    if (merged == 0u) {
        return hit.instance;
    }
    return hit.instance == 0u ? hit.geometry : merged + hit.instance - 1u;
}

// `width` is that of the ray's cone here (Akenine-Moeller et al. 2021).
Point resolve_hit(Hit hit, vec3 direction, float width) {
    MeshInstance instance = MeshInstanceReference(push.mesh_instances).instances[instance_of(hit)];
    GeometryInfo geometry = geometries[hit.geometry];
    Corners c = corners_of(geometry, hit.primitive, hit.barycentrics);
    mat3 linear = linear_of(instance);
    mat3 cofactor = mat3(cross(linear[1], linear[2]), cross(linear[2], linear[0]), cross(linear[0], linear[1]));
    float turn = (instance.flags & DRAW_MIRRORED) != 0u ? -1.0 : 1.0;

    vec3 object[3];
    vec3 normals[3];
    vec3 corners[3];
    for (int corner = 0; corner < 3; ++corner) {
        object[corner] = c.arena.vertices[c.index[corner]].position;
        normals[corner] = unit_or_zero(cofactor * c.arena.vertices[c.index[corner]].normal) * turn;
        corners[corner] = place(instance, object[corner]);
    }
    Point p;
    // Interpolated in object space, where coordinates are small.
    vec3 e1 = object[1] - object[0], e2 = object[2] - object[0];
    p.position = place(instance, object[0] + e1 * c.weight.y + e2 * c.weight.z);
    vec3 facet = cofactor * cross(e1, e2) * turn;
    float area2 = length(facet);
    vec3 face = area2 > 0.0 ? facet / area2 : -direction;
    p.front = dot(face, direction) <= 0.0;
    p.geometric = p.front ? face : -face;
    p.material = geometry.material_buffer_offset;

    float cosine = abs(dot(face, direction));
    vec2 a = c.arena.vertices[c.index.x].uv0, b = c.arena.vertices[c.index.y].uv0, d = c.arena.vertices[c.index.z].uv0;
    vec2 uv0 = mix3(a, b, d, c.weight);
    float footprint0 = footprint(a, b, d, area2, width, cosine);
    a = c.arena.vertices[c.index.x].uv1;
    b = c.arena.vertices[c.index.y].uv1;
    d = c.arena.vertices[c.index.z].uv1;
    p.coords = TexCoords(uv0, mix3(a, b, d, c.weight), footprint0, footprint(a, b, d, area2, width, cosine));
    p.color = vertex_color(geometry, c);

    p.frame.position = p.position;
    p.frame.normal = mix3(normals[0], normals[1], normals[2], c.weight);
    p.frame.tangent = vec3(0.0);
    p.frame.handedness = 1.0;
    if (HAS_NORMAL_MAPS) {
        for (int corner = 0; corner < 3; ++corner) {
            vec3 tangent = c.arena.vertices[c.index[corner]].tangent.xyz;
            p.frame.tangent += c.weight[corner] * unit_or_zero(linear * tangent);
        }
        p.frame.handedness = c.arena.vertices[c.index.x].tangent.w * turn;
    }
    bool listed = HAS_EMITTERS && geometry.emissive_offset != NO_EMISSION && instance.first_emissive != NO_EMISSION;
    p.emitter = listed ? instance.first_emissive + geometry.emissive_offset + hit.primitive : NO_EMISSION;

    float side = p.front ? 1.0 : -1.0;
    for (int corner = 0; corner < 3; ++corner) {
        normals[corner] *= side;
    }
    p.origin = offset_origin(smooth_point(p.position, corners, normals, c.weight), p.geometric);
    return p;
}

// A shading normal whose mirror direction lies above the triangle (as NVIDIA Iray does, Keller et al. 2017, A.3).
vec3 consistent_normal(vec3 normal, vec3 geometric, vec3 view) {
    const float least = 1e-3;
    vec3 mirrored = reflect(-view, normal);
    float above = dot(mirrored, geometric);
    if (above >= least) {
        return normal;
    }
    vec3 bent = view + normalize(mirrored + (least - above) * geometric);
    float length2 = dot(bent, bent);
    return length2 > 1e-12 ? bent * inversesqrt(length2) : geometric;
}

#endif
