// Where rays begin.
#ifndef CAIRN_PATH_OFFSET_GLSL
#define CAIRN_PATH_OFFSET_GLSL

// Waechter and Binder 2019, "A Fast and Robust Method for Avoiding Self-Intersection": a step of 256 units in the last
// place along the triangle's normal, and of 1/65536 near the coordinate planes.
vec3 offset_origin(vec3 p, vec3 n) {
    const float near = 1.0 / 32.0;
    const float float_scale = 1.0 / 65536.0;
    const float int_scale = 256.0;
    ivec3 steps = ivec3(int_scale * n);
    vec3 moved = intBitsToFloat(floatBitsToInt(p) + mix(steps, -steps, lessThan(p, vec3(0.0))));
    return mix(moved, p + float_scale * n, lessThan(abs(p), vec3(near)));
}

// Hanika 2021, "Hacking the Shadow Terminator": the point raised to the surface that the vertex normals suggest.
vec3 smooth_point(vec3 p, vec3 corners[3], vec3 normals[3], vec3 weight) {
    vec3 raised = vec3(0.0);
    for (int corner = 0; corner < 3; ++corner) {
        float below = min(dot(p - corners[corner], normals[corner]), 0.0);
        raised += weight[corner] * (p - below * normals[corner]);
    }
    return raised;
}

#endif
