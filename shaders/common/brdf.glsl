// The surface model: metallic-roughness (glTF 2.0, appendix B) under sheen under a clear coat.
//
// With BRDF_ENERGY each lobe's albedo is brought to what a conductor or dielectric of that Fresnel reflectance has
// once light may bounce between microfacets, and the layers beneath receive the rest: a white furnace closes. Without,
// the lobes are those of the specification and its extensions.
#ifndef CAIRN_BRDF_GLSL
#define CAIRN_BRDF_GLSL

#include "bindings.glsl"
#include "constants.glsl"
#include "material.glsl"
#include "options.glsl"

const float MIN_NDOTV = 1e-4;
// KHR_materials_clearcoat: an index of refraction of 1.5.
const float CLEARCOAT_F0 = 0.04;

// A point ready to be lit. Every direction is a unit vector in the world that leaves the surface.
struct Surface {
    vec3 normal;
    vec3 view;
    float n_dot_v;
    // Perceptual.
    float roughness;
    // Lambert's albedo: without metals, and with BRDF_ENERGY without what the specular lobe reflects.
    vec3 diffuse;
    // Reflectance of the specular lobe at normal incidence and at grazing; both layers' shares, compensation included.
    vec3 f0;
    vec3 f90;
    // Largest channel of the dielectric's reflectance at normal incidence, and its reflectance at grazing.
    vec2 dielectric;
    // x = A and y = B: directional albedo = F0 * A + F90 * B. z = C: integral of (1 - V.H)^5 N.L / pi.
    vec3 table;
    vec3 sheen_color;
    float sheen_roughness;
    // Directional albedo of white sheen.
    float sheen_albedo;
    vec3 coat_normal;
    float coat_n_dot_v;
    float coat_roughness;
    // Share of light that the coat reflects; what lies beneath gets the rest.
    float coat;
    // Brings the coat's lobe to the albedo that `coat` says.
    float coat_gain;
};

// Reflected radiance per unit of irradiance on a plane perpendicular to the light.
struct Reflected {
    // Lambert's lobe.
    vec3 diffuse;
    // All others.
    vec3 specular;
};

float max3(vec3 v) {
    return max(v.x, max(v.y, v.z));
}

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

// Estevez and Kulla 2017, "Production Friendly Microfacet Sheen BRDF": exponentiated sine. `sin2_h` = |N x H|^2.
float distribution_sheen(float sin2_h, float alpha) {
    float inverse = 1.0 / alpha;
    return (2.0 + inverse) * pow(max(sin2_h, 1e-12), 0.5 * inverse) / (2.0 * PI);
}

float lambda_sheen_curve(float x, float alpha) {
    float t = (1.0 - alpha) * (1.0 - alpha);
    float a = mix(21.5473, 25.3245, t);
    float b = mix(3.82987, 3.32435, t);
    float c = mix(0.19823, 0.16801, t);
    float d = mix(-1.97760, -1.27393, t);
    float e = mix(-4.32054, -4.85967, t);
    return a / (1.0 + b * pow(max(x, 1e-6), c)) + d * x + e;
}

float lambda_sheen(float cosine, float alpha) {
    return cosine < 0.5 ? exp(lambda_sheen_curve(cosine, alpha))
                        : exp(2.0 * lambda_sheen_curve(0.5, alpha) - lambda_sheen_curve(1.0 - cosine, alpha));
}

// Limited to 1, as the lobe is unbounded at grazing; the table's albedo has the same limit.
float visibility_sheen(float n_dot_v, float n_dot_l, float alpha) {
    float shadowing = 1.0 + lambda_sheen(n_dot_v, alpha) + lambda_sheen(n_dot_l, alpha);
    return min(1.0 / (shadowing * 4.0 * n_dot_v * max(n_dot_l, 1e-7)), 1.0);
}

float sheen_alpha(Surface s) {
    float floored = max(s.sheen_roughness, MIN_LIGHT_ROUGHNESS);
    return floored * floored;
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

// A, B, C and the albedo of white sheen of the same roughness (which needs HAS_LUT).
vec4 brdf_table(float n_dot_v, float roughness) {
    return HAS_LUT ? textureLod(textures[global.brdf_lut_index], brdf_table_uv(n_dot_v, roughness), 0.0)
                   : vec4(fitted_table(n_dot_v, roughness), 0.0);
}

// Fdez-Aguera 2019 in Filament's form: brings the albedo of F0 = 1 to one at every roughness.
vec3 scatter_compensation(vec3 f0, vec2 table) {
    return BRDF_ENERGY ? 1.0 + f0 * (1.0 / max(table.x + table.y, 1e-3) - 1.0) : vec3(1.0);
}

// A dielectric and a metal, each with its own Fresnel term and compensation, in the shares that `metallic` says: glTF
// mixes the two BRDFs, not their parameters, so that partly metallic white closes a furnace too.
void set_base(MaterialPoint m, inout Surface s) {
    vec2 table = s.table.xy;
    vec3 dielectric = scatter_compensation(m.dielectric_f0, table) * (1.0 - m.metallic);
    vec3 metal = scatter_compensation(m.base.rgb, table) * m.metallic;
    vec3 d0 = m.dielectric_f0 * dielectric;
    vec3 d90 = m.dielectric_f90 * dielectric;
    s.f0 = d0 + m.base.rgb * metal;
    s.f90 = d90 + metal;
    s.dielectric = vec2(max3(m.dielectric_f0), m.dielectric_f90);
    s.diffuse = m.base.rgb;
    // The albedo of the dielectric alone, times its share.
    float taken = max3(d0 * table.x + d90 * table.y);
    s.diffuse *= BRDF_ENERGY ? max(1.0 - m.metallic - taken, 0.0) : 1.0 - m.metallic;
}

void set_layers(MaterialPoint m, vec3 coat_normal, inout Surface s) {
    s.sheen_color = m.sheen_color;
    s.sheen_roughness = m.sheen_roughness;
    s.sheen_albedo = 0.0;
    s.coat_normal = coat_normal;
    s.coat_n_dot_v = 1.0;
    s.coat_roughness = m.clearcoat_roughness;
    s.coat = 0.0;
    s.coat_gain = 1.0;
    if (HAS_SHEEN && max3(m.sheen_color) > 0.0) {
        s.sheen_albedo = min(brdf_table(s.n_dot_v, m.sheen_roughness).w, 1.0);
    }
    if (HAS_CLEARCOAT && m.clearcoat > 0.0) {
        s.coat_n_dot_v = clamp(dot(coat_normal, s.view), MIN_NDOTV, 1.0);
        s.coat = m.clearcoat * mix(CLEARCOAT_F0, 1.0, schlick_weight(s.coat_n_dot_v));
        vec2 table = brdf_table(s.coat_n_dot_v, m.clearcoat_roughness).xy;
        s.coat_gain = BRDF_ENERGY ? 1.0 / max(table.x + table.y, 1e-3) : 1.0;
    }
}

// Normals are in the world, on the viewer's side.
Surface make_surface(MaterialPoint m, vec3 normal, vec3 coat_normal, vec3 view) {
    Surface s;
    s.normal = normal;
    s.view = view;
    s.n_dot_v = clamp(dot(normal, view), MIN_NDOTV, 1.0);
    s.roughness = m.roughness;
    s.table = brdf_table(s.n_dot_v, m.roughness).rgb;
    set_base(m, s);
    set_layers(m, coat_normal, s);
    return s;
}

// Directional albedos towards the viewer, layers above taken off: what each lobe reflects of white surroundings. Their
// sum is at most 1 with BRDF_ENERGY, and 1 for a white surface without tinted layers.

vec3 base_share(Surface s) {
    return vec3((1.0 - s.coat) * (1.0 - max3(s.sheen_color) * s.sheen_albedo));
}

vec3 diffuse_albedo(Surface s) {
    float fresnel = s.dielectric.x + (s.dielectric.y - s.dielectric.x) * s.table.z;
    return s.diffuse * (BRDF_ENERGY ? 1.0 : max(1.0 - fresnel, 0.0)) * base_share(s);
}

vec3 specular_albedo(Surface s) {
    return (s.f0 * s.table.x + s.f90 * s.table.y) * base_share(s);
}

vec3 sheen_albedo(Surface s) {
    return s.sheen_color * s.sheen_albedo * (1.0 - s.coat);
}

vec3 coat_albedo(Surface s) {
    if (BRDF_ENERGY || !HAS_CLEARCOAT) {
        return vec3(s.coat);
    }
    vec2 table = brdf_table(s.coat_n_dot_v, s.coat_roughness).xy;
    return vec3(s.coat * (table.x + table.y));
}

// Share of emitted light that passes the coat.
float emission_share(Surface s) {
    return 1.0 - s.coat;
}

// GGX alpha for light from one direction.
float light_alpha(float roughness) {
    float floored = max(roughness, MIN_LIGHT_ROUGHNESS);
    return floored * floored;
}

vec3 half_vector(vec3 view, vec3 l) {
    vec3 sum = view + l;
    return sum * inversesqrt(max(dot(sum, sum), 1e-12));
}

// The metallic-roughness base, cosine included, for light above its horizon.
Reflected reflect_base(Surface s, vec3 l, vec3 h, float n_dot_l) {
    float alpha = light_alpha(s.roughness);
    float n_dot_h = clamp(dot(s.normal, h), 0.0, 1.0);
    float weight = schlick_weight(dot(s.view, h));
    float lobe = distribution_ggx(s.normal, h, n_dot_h, alpha) * visibility_smith(s.n_dot_v, n_dot_l, alpha);
    float fresnel = mix(s.dielectric.x, s.dielectric.y, weight);
    float transmitted = BRDF_ENERGY ? 1.0 : max(1.0 - fresnel, 0.0);
    return Reflected(s.diffuse * (transmitted * n_dot_l / PI), mix(s.f0, s.f90, weight) * (lobe * n_dot_l));
}

// KHR_materials_sheen: adds the sheen and scales what lies beneath.
void add_sheen(Surface s, vec3 h, float n_dot_l, inout Reflected r) {
    vec3 cross_nh = cross(s.normal, h);
    float alpha = sheen_alpha(s);
    float lobe = distribution_sheen(dot(cross_nh, cross_nh), alpha) * visibility_sheen(s.n_dot_v, n_dot_l, alpha);
    float largest = max3(s.sheen_color);
    float share = 1.0 - largest * s.sheen_albedo;
    if (!BRDF_ENERGY) {
        float back = min(brdf_table(clamp(n_dot_l, 0.0, 1.0), s.sheen_roughness).w, 1.0);
        share = min(share, 1.0 - largest * back);
    }
    r.diffuse *= share;
    r.specular = r.specular * share + s.sheen_color * (lobe * n_dot_l);
}

// KHR_materials_clearcoat.
void add_coat(Surface s, vec3 l, vec3 h, inout Reflected r) {
    float n_dot_l = clamp(dot(s.coat_normal, l), 0.0, 1.0);
    float alpha = light_alpha(s.coat_roughness);
    float n_dot_h = clamp(dot(s.coat_normal, h), 0.0, 1.0);
    float lobe = distribution_ggx(s.coat_normal, h, n_dot_h, alpha)
        * visibility_smith(s.coat_n_dot_v, n_dot_l, alpha);
    r.diffuse *= 1.0 - s.coat;
    r.specular = r.specular * (1.0 - s.coat) + vec3(s.coat * s.coat_gain * lobe * n_dot_l);
}

// All lobes for light from `l`.
Reflected reflect_light(Surface s, vec3 l) {
    vec3 h = half_vector(s.view, l);
    float n_dot_l = dot(s.normal, l);
    Reflected r = Reflected(vec3(0.0), vec3(0.0));
    if (n_dot_l > 0.0) {
        r = reflect_base(s, l, h, n_dot_l);
        if (HAS_SHEEN && s.sheen_albedo > 0.0) {
            add_sheen(s, h, n_dot_l, r);
        }
    }
    if (HAS_CLEARCOAT && s.coat > 0.0) {
        add_coat(s, l, h, r);
    }
    return r;
}

#endif
