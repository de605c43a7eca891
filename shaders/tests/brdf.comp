// Evaluates the surface model at given points, for comparison with its f64 twin.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "brdf.glsl"
#include "occlude.glsl"

layout(local_size_x = 64) in;

struct Case {
    vec4 normal;
    vec4 view;
    // w = roughness.
    vec4 light;
    // w = metallic.
    vec4 base;
    // w = roughness.
    vec4 sheen;
    // x = coat, y = its roughness, z = visibility of the surroundings.
    vec4 coat;
};

struct Result {
    // All lobes but sheen, N.L included; w = white sheen without N.L.
    vec4 lobes;
    // Multi-bounce with the base's red; Lagarde's specular occlusion; cones, with the light's direction as bent normal.
    vec4 occlusion;
};

layout(set = 3, binding = 8, scalar) readonly buffer CaseBuffer {
    Case cases[];
};

layout(set = 3, binding = 9, scalar) writeonly buffer ResultBuffer {
    Result results[];
};

void main() {
    uint index = gl_GlobalInvocationID.x;
    if (index >= cases.length()) {
        return;
    }
    Case c = cases[index];
    MaterialPoint m;
    m.base = vec4(c.base.rgb, 1.0);
    m.metallic = c.base.w;
    m.roughness = c.light.w;
    m.dielectric_f0 = vec3(DIELECTRIC_F0);
    m.dielectric_f90 = 1.0;
    m.sheen_color = c.sheen.rgb;
    m.sheen_roughness = c.sheen.w;
    m.clearcoat = c.coat.x;
    m.clearcoat_roughness = c.coat.y;
    Surface s = make_surface(m, c.normal.xyz, c.normal.xyz, c.view.xyz);
    Reflected r = reflect_light(s, c.light.xyz);
    vec3 h = half_vector(s.view, c.light.xyz);
    vec3 cross_nh = cross(s.normal, h);
    float n_dot_l = dot(s.normal, c.light.xyz);
    float alpha = sheen_alpha(s);
    float sheen = n_dot_l > 0.0
        ? distribution_sheen(dot(cross_nh, cross_nh), alpha) * visibility_sheen(s.n_dot_v, n_dot_l, alpha)
        : 0.0;
    vec4 occlusion = vec4(0.0);
    occlusion.x = multi_bounce(c.coat.z, c.base.rgb).r;
    occlusion.y = specular_occlusion_lagarde(s.n_dot_v, c.coat.z, s.roughness);
    vec3 reflected = reflect(-s.view, s.normal);
    occlusion.z = specular_occlusion_cones(c.light.xyz, reflected, c.coat.z, s.roughness);
    results[index] = Result(vec4(r.diffuse + r.specular, sheen), occlusion);
}
