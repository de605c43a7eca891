// Owen-scrambled Sobol points: sample i of pixel p is the same in every run.
//
// Burley, "Practical Hash-based Owen Scrambling", JCGT 9(4), 2020: dimensions in pairs, each pair with the index shuffled
// and both coordinates scrambled by hashes. Pairs lie as evenly as groups of four did in our renders, and need no tables
// of direction numbers.
#ifndef CAIRN_PATH_SAMPLER_GLSL
#define CAIRN_PATH_SAMPLER_GLSL

#include "path_options.glsl"

// Groups of four dimensions from here on take no regard to neighbouring pixels.
const uint FIRST_WHITE_GROUP = 2;
// Pixels of a tile's side, as a power of two.
const uint TILE_BITS = 4;
// Leading binary digits whose scrambling a tile shares.
const uint SHARED_DIGITS = 0x3fu;

// Digital shifts of a tile's pixels: what each bit of x and y adds to both coordinates. A pixel's first 2^k points and
// those of the pixels of an aligned square lie in every elementary interval of the unit square, but for one binary digit,
// for k up to 6 and squares up to 16: the points of neighbours fill each other's gaps, as in Ahmed and Wonka, "Screen-space
// blue-noise diffusion of Monte Carlo sampling error via hierarchical ordering of pixels", 2020, but at every count.
const uvec2 TILE_SHIFTS[2 * TILE_BITS] = uvec2[2 * TILE_BITS](
    uvec2(0x973c0000u, 0xef4c0000u), uvec2(0x62740000u, 0xbae00000u), uvec2(0x58d00000u, 0x462c0000u),
    uvec2(0x16fc0000u, 0xdd100000u), uvec2(0x5ca40000u, 0xa5e40000u), uvec2(0x9e640000u, 0x4c5c0000u),
    uvec2(0x0ea00000u, 0x92d00000u), uvec2(0x35180000u, 0xe16c0000u));

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

struct Sampler {
    uint index;
    // Hashes of the pixel and of its tile with the run's seed.
    uint pixel;
    uint tile;
    // The pixel's digital shift.
    uvec2 shift;
};

uvec2 tile_shift(uvec2 pixel) {
    uvec2 shift = uvec2(0u);
    for (int bit = 0; bit < int(TILE_BITS); ++bit) {
        uvec2 digit = (pixel >> bit) & 1u;
        shift ^= TILE_SHIFTS[2 * bit] * digit.x ^ TILE_SHIFTS[2 * bit + 1] * digit.y;
    }
    return shift;
}

Sampler make_sampler(uvec2 pixel, uint seed) {
    Sampler s = Sampler(0u, hash_combine(hash(pixel.x | pixel.y << 16), seed), 0u, uvec2(0u));
    if (SAMPLER == SAMPLER_BLUE_NOISE) {
        uvec2 tile = pixel >> TILE_BITS;
        s.tile = hash_combine(hash(tile.x | tile.y << 16) ^ 0x9e3779b9u, seed);
        s.shift = tile_shift(pixel);
    }
    return s;
}

// Seeds of a group's four scrambles.
uvec4 coordinate_seeds(uint seed) {
    return uvec4(hash(seed ^ 0x51633e2du), hash(seed ^ 0x68bc21ebu), hash(seed ^ 0x02e5be93u), hash(seed ^ 0x967a889bu));
}

// Two pairs of scrambled coordinates. The first of a pair is the reversed index: shuffling the index is scrambling it.
uvec4 owen_pairs(uint index, uint order, uvec4 seeds, uvec2 shift) {
    uint reversed = bitfieldReverse(index);
    uint first = laine_karras(reversed, order);
    uint second = laine_karras(reversed, hash(order ^ 0x2c1b3c6du));
    return uvec4(owen(first ^ shift.x, seeds.x), owen(sobol_second(first) ^ shift.y, seeds.y),
                 owen(second ^ shift.x, seeds.z), owen(sobol_second(second) ^ shift.y, seeds.w));
}

// Four coordinates as fractions of 2^32.
uvec4 sample_bits(Sampler s, uint group) {
    uint seed = hash_combine(s.pixel, group);
    if (SAMPLER == SAMPLER_INDEPENDENT) {
        uint x = hash_combine(seed, s.index);
        return uvec4(x, hash(x + 0x68bc21ebu), hash(x + 0x02e5be93u), hash(x + 0x967a889bu));
    }
    uvec4 seeds = coordinate_seeds(seed);
    if (SAMPLER != SAMPLER_BLUE_NOISE || group >= FIRST_WHITE_GROUP) {
        return owen_pairs(s.index, seed, seeds, uvec2(0u));
    }
    // A digit's scrambling depends on the digits of the seed's halves up to its own.
    const uint mask = SHARED_DIGITS | SHARED_DIGITS << 16;
    uint tile = hash_combine(s.tile, group);
    return owen_pairs(s.index, tile, (coordinate_seeds(tile) & mask) | (seeds & ~mask), s.shift);
}

// To [0, 1): 24 bits, as 32 would round up to 1.
vec4 unit_interval(uvec4 bits) {
    return vec4(bits >> 8) * (1.0 / 16777216.0);
}

#endif
