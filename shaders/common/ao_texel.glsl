// A texel of ambient occlusion, 8 bytes:
//   x: 16 bits visibility 0..1 (-1..1 before it is filtered), 16 bits logarithm of the distance to the camera
//   y: 2 x 12 bits bent normal as an octahedron, world space, 8 bits frames that the history holds
#ifndef CAIRN_AO_TEXEL_GLSL
#define CAIRN_AO_TEXEL_GLSL

// Distances from 2^-20 m, in steps of 2^-10.4: 0.05 %.
const float DISTANCE_LOW = -20.0;
const float DISTANCE_OCTAVES = 48.0;
// The code of a pixel that shows nothing.
const uint DISTANCE_SKY = 0xffffu;

struct AoTexel {
    float visibility;
    // Unit.
    vec3 bent;
    uint distance_code;
    uint frames;
};

uint distance_code(float distance) {
    float octave = (log2(max(distance, 1e-30)) - DISTANCE_LOW) / DISTANCE_OCTAVES;
    return uint(clamp(octave, 0.0, 1.0) * 65534.0 + 0.5);
}

float distance_of(uint code) {
    return exp2(float(code) / 65534.0 * DISTANCE_OCTAVES + DISTANCE_LOW);
}

// Cigolle et al. 2014, "A survey of efficient representations for independent unit vectors".
vec2 octahedral(vec3 n) {
    vec2 flat_part = n.xy / (abs(n.x) + abs(n.y) + abs(n.z));
    vec2 side = vec2(flat_part.x < 0.0 ? -1.0 : 1.0, flat_part.y < 0.0 ? -1.0 : 1.0);
    return n.z < 0.0 ? (1.0 - abs(flat_part.yx)) * side : flat_part;
}

vec3 from_octahedral(vec2 at) {
    vec3 n = vec3(at, 1.0 - abs(at.x) - abs(at.y));
    float fold = max(-n.z, 0.0);
    n.xy -= vec2(n.x < 0.0 ? -fold : fold, n.y < 0.0 ? -fold : fold);
    return normalize(n);
}

uvec2 pack_ao(AoTexel texel) {
    uvec2 bent = uvec2((octahedral(texel.bent) * 0.5 + 0.5) * 4095.0 + 0.5);
    uint visibility = uint(clamp(texel.visibility, 0.0, 1.0) * 65535.0 + 0.5);
    return uvec2(visibility | texel.distance_code << 16, bent.x | bent.y << 12 | min(texel.frames, 255u) << 24);
}

AoTexel unpack_ao(uvec2 code) {
    vec2 bent = vec2(code.y & 0xfffu, code.y >> 12 & 0xfffu) / 4095.0 * 2.0 - 1.0;
    return AoTexel(float(code.x & 0xffffu) / 65535.0, from_octahedral(bent), code.x >> 16, code.y >> 24);
}

#endif
