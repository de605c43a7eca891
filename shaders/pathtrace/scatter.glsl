// Sampling of the surface model: one density function for directions, whoever proposes them.
#ifndef CAIRN_PATH_SCATTER_GLSL
#define CAIRN_PATH_SCATTER_GLSL

#include "brdf.glsl"

// Least probability of a lobe that reflects anything.
const float MIN_LOBE = 0.05;
// The largest float below 1.
const float ONE_LESS = 0.99999994;

// Probabilities: the base's GGX lobe, the coat's; the rest goes to the cosine lobe, which also serves sheen.
struct Lobes {
    float specular;
    float coat;
};

mat3 basis(vec3 n) {
    // Duff et al. 2017, "Building an Orthonormal Basis, Revisited".
    float s = n.z >= 0.0 ? 1.0 : -1.0;
    float a = -1.0 / (s + n.z);
    float b = n.x * n.y * a;
    return mat3(vec3(1.0 + s * n.x * n.x * a, s * b, -s * n.x), vec3(b, s + n.y * n.y * a, -n.y), n);
}

float luminance(vec3 color) {
    return dot(color, vec3(0.2126, 0.7152, 0.0722));
}

Lobes choose_lobes(Surface s) {
    float diffuse = luminance(diffuse_albedo(s));
    float specular = luminance(specular_albedo(s));
    float coat = 0.0;
    if (HAS_SHEEN) {
        diffuse += luminance(sheen_albedo(s));
    }
    if (HAS_CLEARCOAT) {
        coat = luminance(coat_albedo(s));
    }
    float total = diffuse + specular + coat;
    Lobes lobes = Lobes(1.0, 0.0);
    if (total > 0.0) {
        lobes.specular = diffuse + coat > 0.0 ? clamp(specular / total, MIN_LOBE, 1.0 - MIN_LOBE) : 1.0;
        lobes.coat = coat > 0.0 ? max(coat / total, MIN_LOBE) : 0.0;
        if (diffuse <= 0.0) {
            lobes.specular = 1.0 - lobes.coat;
        }
        lobes.specular = min(lobes.specular, 1.0 - lobes.coat);
    }
    return lobes;
}

// Density of reflections about visible normals (Heitz 2018): D G1 / (4 N.V).
float pdf_visible(vec3 n, vec3 h, float n_dot_v, float alpha) {
    float a2 = alpha * alpha;
    float d = distribution_ggx(n, h, clamp(dot(n, h), 0.0, 1.0), alpha);
    return 0.5 * d / (n_dot_v + sqrt(n_dot_v * n_dot_v * (1.0 - a2) + a2));
}

// A reflection about a visible normal, by spherical caps (Dupuy and Benyoub 2023).
vec3 sample_visible(vec3 n, vec3 view, float alpha, vec2 u) {
    mat3 frame = basis(n);
    vec3 v = view * frame;
    v.z = max(v.z, MIN_NDOTV);
    vec3 stretched = normalize(vec3(alpha * v.xy, v.z));
    float phi = 2.0 * PI * u.x;
    float z = (1.0 - u.y) * (1.0 + stretched.z) - stretched.z;
    float sine = sqrt(max(1.0 - z * z, 0.0));
    vec3 cap = vec3(sine * cos(phi), sine * sin(phi), z) + stretched;
    vec3 h = frame * normalize(vec3(alpha * cap.xy, max(cap.z, 1e-7)));
    return reflect(-view, h);
}

vec3 sample_cosine(vec3 n, vec2 u) {
    float radius = sqrt(u.x);
    float phi = 2.0 * PI * u.y;
    return basis(n) * vec3(radius * cos(phi), radius * sin(phi), sqrt(max(1.0 - u.x, 0.0)));
}

// Density per steradian with which `sample_scatter` returns `l`.
float scatter_pdf(Surface s, Lobes lobes, vec3 l) {
    vec3 h = half_vector(s.view, l);
    float n_dot_l = dot(s.normal, l);
    float cosine = max(n_dot_l, 0.0) / PI;
    float pdf = (1.0 - lobes.specular - lobes.coat) * cosine;
    if (n_dot_l > 0.0) {
        pdf += lobes.specular * pdf_visible(s.normal, h, s.n_dot_v, light_alpha(s.roughness));
    }
    if (HAS_CLEARCOAT && lobes.coat > 0.0 && dot(s.coat_normal, l) > 0.0) {
        pdf += lobes.coat * pdf_visible(s.coat_normal, h, s.coat_n_dot_v, light_alpha(s.coat_roughness));
    }
    return pdf;
}

// The first coordinate also chooses the lobe: what it has left of its lobe's part is as even as before.
vec3 sample_scatter(Surface s, Lobes lobes, vec2 u) {
    if (u.x < lobes.specular) {
        u.x = min(u.x / lobes.specular, ONE_LESS);
        return sample_visible(s.normal, s.view, light_alpha(s.roughness), u);
    }
    u.x -= lobes.specular;
    if (HAS_CLEARCOAT && u.x < lobes.coat) {
        u.x = min(u.x / lobes.coat, ONE_LESS);
        return sample_visible(s.coat_normal, s.view, light_alpha(s.coat_roughness), u);
    }
    u.x = min((u.x - lobes.coat) / max(1.0 - lobes.specular - lobes.coat, 1e-6), ONE_LESS);
    return sample_cosine(s.normal, u);
}

#endif
