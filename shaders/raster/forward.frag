// Shades the scene's surfaces: directional lights, image-based light, emission, and the debug views.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "brdf.glsl"
#include "environment.glsl"
#include "finite.glsl"
#include "normal.glsl"

layout(location = 0) in vec3 in_position;
layout(location = 1) in vec3 in_normal;
layout(location = 2) in vec3 in_tangent;
layout(location = 3) in vec4 in_uv;
layout(location = 4) flat in float in_handedness;
layout(location = 5) flat in uint in_material;
layout(location = 6) in vec4 in_vertex_color;

layout(location = 0) out vec4 out_color;

struct Light {
    vec3 diffuse;
    vec3 specular;
};

Surface surface(Material material, TexCoords coords, vec3 base_color) {
    vec2 texel = sample_texture(material.metallic_roughness_tex, coords, vec4(1.0)).gb;
    float metallic = clamp(texel.y * material.metallic_factor, 0.0, 1.0);
    Surface s;
    s.metallic = metallic;
    s.view = view_direction(in_position);
    Frame frame = Frame(in_position, in_normal, in_tangent, in_handedness);
    s.normal = shading_normal(material, coords, frame, s.view, gl_FrontFacing);
    s.roughness = clamp(texel.x * material.roughness_factor, 0.0, 1.0);
    s.n_dot_v = clamp(dot(s.normal, s.view), MIN_NDOTV, 1.0);
    s.diffuse = base_color * (1.0 - metallic);
    s.f0 = mix(vec3(DIELECTRIC_F0), base_color, metallic);
    s.table = HAS_LUT
        ? textureLod(textures[global.brdf_lut_index], vec2(s.n_dot_v, s.roughness), 0.0).rgb
        : fitted_table(s.n_dot_v, s.roughness);
    return s;
}

Light direct_light(Surface s) {
    Light sum = Light(vec3(0.0), vec3(0.0));
    if (!HAS_LIGHTS) {
        return sum;
    }
    for (uint i = 0; i < global.directional_light_count; ++i) {
        vec3 l = -lights[i].direction_and_intensity.xyz;
        float n_dot_l = dot(s.normal, l);
        if (n_dot_l <= 0.0) {
            continue;
        }
        vec3 diffuse, specular;
        direct_brdf(s, l, n_dot_l, diffuse, specular);
        float intensity = lights[i].direction_and_intensity.w;
        vec3 irradiance = lights[i].color_and_shadow.rgb * (intensity * n_dot_l);
        sum.diffuse += diffuse * irradiance;
        sum.specular += specular * irradiance;
    }
    return sum;
}

Light indirect_light(Surface s, float occlusion) {
    vec3 diffuse, specular;
    indirect_brdf(s, diffuse, specular);
    vec3 reflected = reflect(-s.view, s.normal);
    float scale = global.ibl_intensity * occlusion;
    return Light(diffuse * environment_irradiance(s.normal) * scale,
                 specular * environment_prefiltered(reflected, s.roughness) * scale);
}

// The numbers are those of `GlobalUniform::debug_render_mode`; views of passes that do not exist are magenta.
vec3 view_color(Surface s, Light direct, Light indirect, vec3 emitted, float occlusion) {
    switch (global.debug_render_mode) {
    case 0: return direct.diffuse + direct.specular + indirect.diffuse + indirect.specular + emitted;
    case 1: return direct.diffuse + indirect.diffuse;
    case 2: return direct.specular + indirect.specular;
    case 3: return indirect.diffuse + indirect.specular;
    case 4: return s.normal * 0.5 + 0.5;
    case 5: return vec3(s.metallic);
    case 6: return vec3(s.roughness);
    case 7: return vec3(occlusion);
    default: return vec3(1.0, 0.0, 1.0);
    }
}

void main() {
    Material material = materials[in_material];
    TexCoords coords = TexCoords(in_uv.xy, in_uv.zw);
    vec4 base = material.base_color_factor * sample_texture(material.base_color_tex, coords, vec4(1.0));
    if (HAS_VERTEX_COLORS) {
        base *= in_vertex_color;
    }
    Surface s = surface(material, coords, base.rgb);
    float occlusion_texel = sample_texture(material.occlusion_tex, coords, vec4(1.0)).r;
    vec3 emitted = material.emissive_factor.rgb * sample_texture(material.emissive_tex, coords, vec4(1.0)).rgb;
    // After the lookups, whose implicit derivatives need whole quads.
    if (MASKED && base.a < material.alpha_cutoff) {
        discard;
    }
    float occlusion = 1.0 + material.occlusion_strength * (occlusion_texel - 1.0);
    vec3 color;
    if ((material.double_sided & MATERIAL_UNLIT) != 0u && global.debug_render_mode == 0u) {
        color = base.rgb;
    } else {
        color = view_color(s, direct_light(s), indirect_light(s, occlusion), emitted, occlusion);
    }
    out_color = vec4(storable(color), BLENDED ? clamp(base.a, 0.0, 1.0) : 1.0);
}
