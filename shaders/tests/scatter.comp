// Evaluates and samples the surface model at given points: all lobes, for tests of energy, reciprocity and densities.
#version 460
#extension GL_GOOGLE_include_directive : require
#define CAIRN_EXPLICIT_LOD
#include "../pathtrace/scatter.glsl"

layout(local_size_x = 64) in;

struct Query {
    // w = roughness. Every normal is +Z.
    vec4 view;
    // w = metallic.
    vec4 light;
    // w = reflectance of the dielectric at grazing.
    vec4 base;
    // Reflectance of the dielectric at normal incidence; w = roughness of the sheen.
    vec4 f0;
    // w = coat.
    vec4 sheen;
    // xy = where to sample; z = roughness of the coat; w = angle of the coat's normal from +Z towards +X.
    vec4 place;
};

struct Answer {
    // Reflected radiance per irradiance perpendicular to `light`; w = density of `light`.
    vec4 given;
    // A sampled direction; w = its density.
    vec4 direction;
    // What is reflected from it; w = sum of the probabilities of all lobes but the cosine one.
    vec4 sampled;
};

layout(set = 3, binding = 8, scalar) readonly buffer QueryBuffer {
    Query queries[];
};

layout(set = 3, binding = 9, scalar) writeonly buffer AnswerBuffer {
    Answer answers[];
};

void main() {
    uint index = gl_GlobalInvocationID.x;
    if (index >= queries.length()) {
        return;
    }
    Query q = queries[index];
    MaterialPoint m;
    m.base = vec4(q.base.rgb, 1.0);
    m.emission = vec3(0.0);
    m.metallic = q.light.w;
    m.roughness = q.view.w;
    m.occlusion = 1.0;
    m.dielectric_f0 = q.f0.rgb;
    m.dielectric_f90 = q.base.w;
    m.sheen_color = q.sheen.rgb;
    m.sheen_roughness = q.f0.w;
    m.clearcoat = q.sheen.w;
    m.clearcoat_roughness = q.place.z;
    vec3 coat_normal = vec3(sin(q.place.w), 0.0, cos(q.place.w));
    Surface s = make_surface(m, vec3(0.0, 0.0, 1.0), coat_normal, q.view.xyz);
    Lobes lobes = choose_lobes(s);
    Reflected given = reflect_light(s, q.light.xyz);
    vec3 l = sample_scatter(s, lobes, q.place.xy);
    Reflected sampled = reflect_light(s, l);
    answers[index].given = vec4(given.diffuse + given.specular, scatter_pdf(s, lobes, q.light.xyz));
    answers[index].direction = vec4(l, scatter_pdf(s, lobes, l));
    answers[index].sampled = vec4(sampled.diffuse + sampled.specular, lobes.specular + lobes.coat);
}
