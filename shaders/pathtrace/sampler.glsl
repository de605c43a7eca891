// Owen-scrambled Sobol points: sample i of pixel p is the same in every run.
//
// Burley, "Practical Hash-based Owen Scrambling", JCGT 9(4), 2020: dimensions in groups of four, each group with the
// index shuffled and every coordinate scrambled by hashes.
#ifndef CAIRN_PATH_SAMPLER_GLSL
#define CAIRN_PATH_SAMPLER_GLSL

#include "path_options.glsl"

// The group whose first sample follows a lattice over the screen: the directions of the first bounce.
const uint LATTICE_GROUP = 1;

// Wellons' lowbias32.
uint hash(uint x) {
    x ^= x >> 16;
    x *= 0x7feb352du;
    x ^= x >> 15;
    x *= 0x846ca68bu;
    x ^= x >> 16;
    return x;
}

uint hash_combine(uint seed, uint value) {
    return hash(seed ^ (value * 0x9e3779b9u + 0x7f4a7c15u));
}

// Nested uniform scramble of a bit-reversed value (Laine and Karras 2011, Vegdahl's constants).
uint laine_karras(uint x, uint seed) {
    x ^= x * 0x3d20adeau;
    x += seed;
    x *= (seed >> 16) | 1u;
    x ^= x * 0x05526c56u;
    x ^= x * 0x53a22864u;
    return x;
}

uint owen(uint x, uint seed) {
    return bitfieldReverse(laine_karras(bitfieldReverse(x), seed));
}

// Sobol's second coordinate from the first: Pascal's triangle modulo 2 in five steps.
uint sobol_second(uint x) {
    x ^= (x & 0x0000ffffu) << 16;
    x ^= (x & 0x00ff00ffu) << 8;
    x ^= (x & 0x0f0f0f0fu) << 4;
    x ^= (x & 0x33333333u) << 2;
    x ^= (x & 0x55555555u) << 1;
    return x;
}

// Direction numbers of x^2 + x + 1 and x^3 + x^2 + 1 by the recurrence of Bratley and Fox (1988). The initial numbers
// (1, 1) and (1, 1, 5) are the ones with the least t of the four coordinates and of their pairs for 2^2 to 2^10 points.
const uint SOBOL_THIRD[32] = uint[32](
    0x80000000u, 0x40000000u, 0xe0000000u, 0xb0000000u, 0x68000000u, 0xf4000000u, 0x86000000u, 0x4f000000u,
    0xe8800000u, 0xb4400000u, 0x66e00000u, 0xffb00000u, 0x80e80000u, 0x40b40000u, 0xe0660000u, 0xb0ff0000u,
    0x68808000u, 0xf4404000u, 0x86e0e000u, 0x4fb0b000u, 0xe8e86800u, 0xb4b4f400u, 0x66668600u, 0xffff4f00u,
    0x80006880u, 0x4000f440u, 0xe00086e0u, 0xb0004fb0u, 0x6800e8e8u, 0xf400b4b4u, 0x86006666u, 0x4f00ffffu);
const uint SOBOL_FOURTH[32] = uint[32](
    0x80000000u, 0x40000000u, 0xa0000000u, 0x30000000u, 0x78000000u, 0xcc000000u, 0xfa000000u, 0x8d000000u,
    0x58800000u, 0xbdc00000u, 0x21600000u, 0x72f00000u, 0xd8880000u, 0xfdc40000u, 0x816a0000u, 0x42f30000u,
    0xa08f8000u, 0x31c8c000u, 0x7b65a000u, 0xcffbd000u, 0xf80a0800u, 0x8c031c00u, 0x5a07b600u, 0xbd0cff00u,
    0x208f8080u, 0x71c8c040u, 0xdb65a0a0u, 0xfffbd030u, 0x800a0878u, 0x40031cccu, 0xa007b6fau, 0x300cff8du);

struct Sampler {
    uint index;
    // Hash of the pixel and the run's seed.
    uint pixel;
    uvec2 place;
};

Sampler make_sampler(uvec2 pixel, uint seed) {
    return Sampler(0u, hash_combine(hash(pixel.x | pixel.y << 16), seed), pixel);
}

// Four scrambled coordinates of one point. The first is the reversed index: shuffling the index is scrambling it.
uvec4 owen_point(uint index, uint seed) {
    uint first = laine_karras(bitfieldReverse(index), seed);
    uint third = 0u, fourth = 0u;
    for (int bit = 0; bit < 32; ++bit) {
        uint mask = uint(bitfieldExtract(int(first), 31 - bit, 1));
        third ^= SOBOL_THIRD[bit] & mask;
        fourth ^= SOBOL_FOURTH[bit] & mask;
    }
    return uvec4(owen(first, hash(seed ^ 0x51633e2du)), owen(sobol_second(first), hash(seed ^ 0x68bc21ebu)),
                 owen(third, hash(seed ^ 0x02e5be93u)), owen(fourth, hash(seed ^ 0x967a889bu)));
}

// Pixel coordinates times the generators of Roberts's R2 sequence (2018): each component is a lattice whose neighbours
// differ much, so an error that follows it has high frequency.
uvec4 lattice(uvec2 p) {
    const uint a = 3242174889u, b = 2447445414u;
    return uvec4(a * p.x + b * p.y, b * p.x - a * p.y, b * p.x + a * p.y, a * p.x - b * p.y);
}

// Four coordinates as fractions of 2^32.
uvec4 sample_bits(Sampler s, uint group) {
    uint seed = hash_combine(s.pixel, group);
    if (SAMPLER == 1u) {
        uint x = hash_combine(seed, s.index);
        return uvec4(x, hash(x + 0x68bc21ebu), hash(x + 0x02e5be93u), hash(x + 0x967a889bu));
    }
    uvec4 point = owen_point(s.index, seed);
    // A digital shift of scrambled points: they are as good, and the first lies on the lattice.
    return group == LATTICE_GROUP ? point ^ owen_point(0u, seed) ^ lattice(s.place) : point;
}

// To [0, 1): 24 bits, as 32 would round up to 1.
vec4 unit_interval(uvec4 bits) {
    return vec4(bits >> 8) * (1.0 / 16777216.0);
}

#endif
