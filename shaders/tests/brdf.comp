// Evaluates the surface model at given points, for comparison with its f64 twin.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "brdf.glsl"

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
    // x = coat, y = its roughness.
    vec4 coat;
};

layout(set = 3, binding = 8, scalar) readonly buffer CaseBuffer {
    Case cases[];
};

layout(set = 3, binding = 9, scalar) writeonly buffer ResultBuffer {
    // All lobes but sheen, N.L included; w = white sheen without N.L.
    vec4 results[];
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
    results[index] = vec4(r.diffuse + r.specular, sheen);
}
