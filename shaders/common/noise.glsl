// Low-discrepancy noise over pixels and frames.
#ifndef CAIRN_NOISE_GLSL
#define CAIRN_NOISE_GLSL

const uint NOISE_BITS = 6;

// Position on a Hilbert curve through a square of 64 x 64 pixels.
uint hilbert_index(uvec2 pixel) {
    uint index = 0;
    for (uint level = 1u << (NOISE_BITS - 1); level > 0; level >>= 1) {
        uvec2 half_of = uvec2(greaterThan(pixel & level, uvec2(0)));
        index += level * level * ((3 * half_of.x) ^ half_of.y);
        if (half_of.y == 0) {
            if (half_of.x == 1) {
                pixel = (1u << NOISE_BITS) - 1 - pixel;
            }
            pixel = pixel.yx;
        }
    }
    return index;
}

// Two numbers in 0..1 from Roberts' R2 sequence along the curve; `frame` counts 0..64 and moves to another stretch of it.
vec2 spatial_noise(uvec2 pixel, uint frame) {
    uint index = hilbert_index(pixel & ((1u << NOISE_BITS) - 1)) + 288 * frame;
    return fract(0.5 + float(index) * vec2(0.75487766624669276, 0.56984029099805327));
}

#endif
