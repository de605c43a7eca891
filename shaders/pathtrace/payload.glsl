// What a ray brings back.
#ifndef CAIRN_PATH_PAYLOAD_GLSL
#define CAIRN_PATH_PAYLOAD_GLSL

struct Hit {
    // On the way: the ray's random seed, which any-hit reads. Afterwards: the top-level instance.
    uint instance;
    // Index into the geometry table.
    uint geometry;
    uint primitive;
    // Weights of the second and third corner.
    vec2 barycentrics;
    // Distance; negative where nothing was met.
    float t;
};

#endif
