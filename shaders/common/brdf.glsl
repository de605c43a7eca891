// The metallic-roughness BRDF: GGX, height-correlated Smith, Schlick (glTF 2.0, appendix B).
#ifndef CAIRN_BRDF_GLSL
#define CAIRN_BRDF_GLSL

#include "constants.glsl"
#include "options.glsl"

const float DIELECTRIC_F0 = 0.04;
// Perceptual roughness below which a punctual light's highlight would vanish between pixels and D overflow.
const float MIN_LIGHT_ROUGHNESS = 0.045;
const float MIN_NDOTV = 1e-4;

struct Surface {
    vec3 normal;
    vec3 view;
    vec3 diffuse;
    vec3 f0;
    float n_dot_v;
    float metallic;
    float roughness;
    // x = A and y = B: directional albedo = F0 * A + B. z = C: integral of (1 - V.H)^5 N.L / pi.
    vec3 table;
};

// |N x H|^2 = 1 - (N.H)^2 without the cancellation that costs 16 % at roughness 0.04 in 32-bit floats.
float distribution_ggx(vec3 n, vec3 h, float n_dot_h, float alpha) {
    vec3 cross_nh = cross(n, h);
    float scaled = n_dot_h * alpha;
    float k = alpha / (dot(cross_nh, cross_nh) + scaled * scaled);
    return k * k / PI;
}

// G / (4 N.L N.V), Heitz 2014.
float visibility_smith(float n_dot_v, float n_dot_l, float alpha) {
    float a2 = alpha * alpha;
    float shadowing = n_dot_l * sqrt(n_dot_v * n_dot_v * (1.0 - a2) + a2);
    float masking = n_dot_v * sqrt(n_dot_l * n_dot_l * (1.0 - a2) + a2);
    return 0.5 / max(shadowing + masking, 1e-7);
}

float schlick_weight(float cosine) {
    float x = clamp(1.0 - cosine, 0.0, 1.0);
    float x2 = x * x;
    return x2 * x2 * x;
}

// Stand-in for the table, fitted to the same quadrature: A + B and B within 0.016 (rms), C within 0.00015.
// At roughness 1 the loss of one bounce is N.V ln(1 + 1 / N.V) exactly, hence that factor.
vec3 fitted_table(float n_dot_v, float r) {
    float loss = n_dot_v * log(1.0 + 1.0 / n_dot_v) * r * r
        * (3.609 - 5.748 * n_dot_v + r * (-4.841 + 11.919 * n_dot_v + r * (2.226 - 6.169 * n_dot_v)));
    float albedo = clamp(1.0 - loss, 0.0, 1.0);
    float x = 1.0 - n_dot_v;
    float s = 1.0 - r;
    float b = min(pow(x, 5.0 / (1.0 + 2.0 * r * r)) * s * (0.090 + s * (0.378 + s * 0.691)), albedo);
    float c = ((0.025730 * x - 0.002171) * x + 0.004521) * x;
    return vec3(albedo - b, b, c);
}

vec3 single_scatter_albedo(Surface s) {
    return s.f0 * s.table.x + s.table.y;
}

// Fdez-Aguera 2019 in Filament's form: brings the albedo of F0 = 1 to one at every roughness.
vec3 scatter_compensation(Surface s) {
    return BRDF_ENERGY ? 1.0 + s.f0 * (1.0 / max(s.table.x + s.table.y, 1e-3) - 1.0) : vec3(1.0);
}

vec3 specular_albedo(Surface s) {
    return single_scatter_albedo(s) * scatter_compensation(s);
}

// What a directional light adds per unit of irradiance perpendicular to the surface.
void direct_brdf(Surface s, vec3 l, float n_dot_l, out vec3 diffuse, out vec3 specular) {
    float floored = max(s.roughness, MIN_LIGHT_ROUGHNESS);
    float alpha = floored * floored;
    vec3 sum = s.view + l;
    vec3 h = sum * inversesqrt(max(dot(sum, sum), 1e-12));
    float n_dot_h = clamp(dot(s.normal, h), 0.0, 1.0);
    vec3 f = s.f0 + (1.0 - s.f0) * schlick_weight(dot(s.view, h));
    float lobe = distribution_ggx(s.normal, h, n_dot_h, alpha) * visibility_smith(s.n_dot_v, n_dot_l, alpha);
    specular = f * lobe * scatter_compensation(s);
    vec3 transmitted = BRDF_ENERGY ? max(1.0 - specular_albedo(s), 0.0) : 1.0 - f;
    diffuse = s.diffuse * transmitted / PI;
}

// Factors of irradiance / pi and of prefiltered radiance.
void indirect_brdf(Surface s, out vec3 diffuse, out vec3 specular) {
    specular = specular_albedo(s);
    vec3 transmitted =
        BRDF_ENERGY ? max(1.0 - specular, 0.0) : (1.0 - s.f0) * max(1.0 - s.table.z, 0.0);
    diffuse = s.diffuse * transmitted;
}

#endif
