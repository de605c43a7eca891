// From a visibility texel to the surface point that it shows. Needs CAIRN_EXPLICIT_GRADIENT.
#ifndef CAIRN_VISIBLE_GLSL
#define CAIRN_VISIBLE_GLSL

#include "normal.glsl"

layout(push_constant, scalar) uniform PushBlock {
    VisiblePush push;
};

// A point of a triangle, with the change of its barycentric coordinates to the next pixel on the right and below.
struct Barycentrics {
    vec3 at;
    vec3 right;
    vec3 down;
};

// A triangle's record and corners.
struct Triangle {
    Instance instance;
    uvec3 corners;
};

struct Fetched {
    uint material;
    TexCoords coords;
    vec4 vertex_color;
    Frame frame;
    vec3 facet;
    bool front_facing;
};

Triangle fetch_triangle(uvec2 texel) {
    uint instance = texel.x - 1u;
    uint low = 0;
    uint high = push.draw_groups;
    while (low + 1u < high) {
        uint middle = (low + high) / 2u;
        if (draw_groups[middle].first_instance <= instance) {
            low = middle;
        } else {
            high = middle;
        }
    }
    DrawGroup group = draw_groups[low];
    uint first = group.first_index + texel.y * 3u;
    Triangle t;
    t.instance = instances[instance];
    t.corners = group.vertex_offset
        + uvec3(arena_indices[first], arena_indices[first + 1u], arena_indices[first + 2u]);
    return t;
}

// Perspective-correct coordinates of the point behind `pixel` (in pixels from the upper left). Clip coordinates are
// moved to the pixel first: the edge functions are then small numbers of full precision, and a corner behind the
// camera needs no clipping (Olano and Greer 1997, "Triangle scan conversion using 2D homogeneous coordinates").
Barycentrics barycentrics(vec4 clip[3], vec2 pixel) {
    vec2 step = vec2(2.0, -2.0) / global.screen_size;
    vec2 ndc = pixel * step + vec2(-1.0, 1.0);
    vec3 x, y, w;
    for (int i = 0; i < 3; ++i) {
        x[i] = clip[i].x - ndc.x * clip[i].w;
        y[i] = clip[i].y - ndc.y * clip[i].w;
        w[i] = clip[i].w;
    }
    vec3 edge = x.yzx * y.zxy - x.zxy * y.yzx;
    vec3 by_x = (w.zxy * y.yzx - w.yzx * y.zxy) * step.x;
    vec3 by_y = (w.yzx * x.zxy - w.zxy * x.yzx) * step.y;
    float sum = edge.x + edge.y + edge.z;
    float inverse = sum != 0.0 ? 1.0 / sum : 0.0;
    Barycentrics b;
    b.at = edge * inverse;
    b.right = (by_x - b.at * (by_x.x + by_x.y + by_x.z)) * inverse;
    b.down = (by_y - b.at * (by_y.x + by_y.y + by_y.z)) * inverse;
    return b;
}

vec3 unit_or_zero(vec3 v) {
    float length2 = dot(v, v);
    return length2 > 0.0 ? v * inversesqrt(length2) : vec3(0.0);
}

// The surface behind `pixel`; interpolates what forward.vert writes.
Fetched fetch_visible(uvec2 texel, vec2 pixel) {
    Triangle t = fetch_triangle(texel);
    Vertex v[3];
    vec3 world[3];
    vec4 clip[3];
    for (int i = 0; i < 3; ++i) {
        v[i] = arena_vertices[t.corners[i]];
        world[i] = (t.instance.model * vec4(v[i].position, 1.0)).xyz;
        clip[i] = global.view_projection * vec4(world[i], 1.0);
    }
    Barycentrics b = barycentrics(clip, pixel);

    mat3 model = mat3(t.instance.model);
    mat3 normal_matrix = mat3(t.instance.normal_matrix[0].xyz, t.instance.normal_matrix[1].xyz,
                              t.instance.normal_matrix[2].xyz);
    bool mirrored = determinant(model) < 0.0;
    Fetched f;
    f.material = t.instance.material_index;
    f.frame.position = mat3(world[0], world[1], world[2]) * b.at;
    f.frame.normal = vec3(0.0);
    f.frame.tangent = vec3(0.0);
    for (int i = 0; i < 3; ++i) {
        f.frame.normal += unit_or_zero(normal_matrix * v[i].normal) * b.at[i];
        f.frame.tangent += unit_or_zero(model * v[i].tangent.xyz) * b.at[i];
    }
    f.vertex_color = vec4(1.0);
    if (HAS_VERTEX_COLORS) {
        f.vertex_color = mat3x4(arena_color(t.corners.x), arena_color(t.corners.y), arena_color(t.corners.z)) * b.at;
    }
    // The provoking vertex's, as flat interpolation has it.
    f.frame.handedness = mirrored ? -v[0].tangent.w : v[0].tangent.w;
    f.facet = cross(world[1] - world[0], world[2] - world[0]);
    f.front_facing = (dot(f.facet, view_direction(f.frame.position)) > 0.0) != mirrored;

    mat3x2 uv0 = mat3x2(v[0].uv0, v[1].uv0, v[2].uv0);
    mat3x2 uv1 = mat3x2(v[0].uv1, v[1].uv1, v[2].uv1);
    f.coords.uv0 = uv0 * b.at;
    f.coords.uv1 = uv1 * b.at;
    f.coords.gradient0 = vec4(uv0 * b.right, uv0 * b.down);
    f.coords.gradient1 = vec4(uv1 * b.right, uv1 * b.down);
    return f;
}

#endif
