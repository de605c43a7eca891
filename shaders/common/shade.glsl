// From a surface point to the light that leaves it: what forward.frag and shade.comp have in common.
#ifndef CAIRN_SHADE_GLSL
#define CAIRN_SHADE_GLSL

#include "brdf.glsl"
#include "finite.glsl"
#include "lighting.glsl"
#include "normal.glsl"
#include "occlude.glsl"
#include "occlusion.glsl"
#include "shadow.glsl"

// `GlobalUniform::ao_so_mode`: cones about bent normals, else from the amount of occlusion.
const uint SPECULAR_CONES = 1;

void add(Reflected r, vec3 irradiance, inout Reflected sum) {
    sum.diffuse += r.diffuse * irradiance;
    sum.specular += r.specular * irradiance;
}

Reflected direct_light(Surface s, vec3 position, vec3 geometric_normal, float view_depth, float contact) {
    Reflected sum = Reflected(vec3(0.0), vec3(0.0));
    if (HAS_LIGHTS) {
        for (uint i = 0; i < global.directional_light_count; ++i) {
            vec3 l = -lights[i].direction_and_intensity.xyz;
            Reflected r = reflect_light(s, l);
            // No lookup where the surface faces away.
            if (r.diffuse + r.specular == vec3(0.0)) {
                continue;
            }
            float lit = directional_shadow(i, position, geometric_normal, view_depth);
            if (i == 0) {
                lit *= contact;
            }
            add(r, lights[i].color_and_shadow.rgb * (lights[i].direction_and_intensity.w * lit), sum);
        }
    }
    for (uint i = 0; i < PUNCTUAL_LIGHTS; ++i) {
        Incident incident = punctual_incident(punctual_lights[i], position);
        if (incident.irradiance != vec3(0.0)) {
            add(reflect_light(s, incident.l), incident.irradiance, sum);
        }
    }
    return sum;
}

// What lies around this pixel. The images of the screen hold what lies behind blended surfaces.
Occlusion surroundings(ivec2 pixel, vec3 normal) {
    if (!SCREEN_OCCLUSION || BLENDED) {
        return Occlusion(1.0, normal);
    }
    return screen_occlusion(pixel, normal);
}

// Share of the environment's reflection about `normal` that nothing hides: what the screen shows around the pixel, and
// what the material's texture says, whichever hides more; both know of the same folds.
float specular_occlusion(Surface s, vec3 normal, float n_dot_v, float roughness, Occlusion screen, float baked) {
    float share = specular_occlusion_lagarde(n_dot_v, baked, roughness);
    if (SCREEN_OCCLUSION && !BLENDED) {
        float seen = global.ao_so_mode == SPECULAR_CONES
            ? specular_occlusion_cones(screen.bent, reflect(-s.view, normal), screen.visibility, roughness)
            : specular_occlusion_lagarde(n_dot_v, screen.visibility, roughness);
        share = min(share, seen);
    }
    return share;
}

// Occlusion concerns light from the surroundings alone: what hides a light is its shadow.
Reflected indirect_light(Surface s, Occlusion screen, float baked) {
    Ambient ambient = environment_light(s);
    float visibility = min(screen.visibility, baked);
    vec3 specular = ambient.specular * specular_occlusion(s, s.normal, s.n_dot_v, s.roughness, screen, baked);
    if (HAS_CLEARCOAT) {
        float n_dot_v = s.coat_n_dot_v;
        specular += ambient.coat * specular_occlusion(s, s.coat_normal, n_dot_v, s.coat_roughness, screen, baked);
    }
    vec3 diffuse = ambient.diffuse * multi_bounce(visibility, s.diffuse);
    return Reflected(diffuse * global.ibl_intensity, specular * global.ibl_intensity);
}

// A hue for each whole level, blends between: white for level 0, then red to violet.
vec3 level_color(float level) {
    const vec3 colors[8] = vec3[8](vec3(1.0), vec3(1.0, 0.0, 0.0), vec3(1.0, 0.5, 0.0), vec3(1.0, 1.0, 0.0),
                                   vec3(0.0, 1.0, 0.0), vec3(0.0, 1.0, 1.0), vec3(0.0, 0.0, 1.0),
                                   vec3(0.5, 0.0, 1.0));
    float clamped = clamp(level, 0.0, 7.0);
    uint below = min(uint(clamped), 6u);
    return mix(colors[below], colors[below + 1u], clamped - float(below));
}

// What debug views show besides the surface.
struct View {
    // Along the view, metres.
    float depth;
    float visibility;
    float contact;
    vec3 levels;
};

// The numbers are those of `GlobalUniform::debug_render_mode`; unknown ones are magenta.
vec3 view_color(MaterialPoint m, Surface s, Reflected direct, Reflected indirect, View view) {
    switch (global.debug_render_mode) {
    case 1: return direct.diffuse + indirect.diffuse;
    case 2: return direct.specular + indirect.specular;
    case 3: return indirect.diffuse + indirect.specular;
    case 4: return s.normal * 0.5 + 0.5;
    case 5: return vec3(m.metallic);
    case 6: return vec3(m.roughness);
    case 7: return vec3(m.occlusion * view.visibility);
    case 8: return cascade_color(view.depth);
    case 9: return vec3(view.visibility);
    case 10: return vec3(view.contact);
    // Added up by the blend unit.
    case 11: return vec3(1.0);
    case 12: return view.levels;
    default: return vec3(1.0, 0.0, 1.0);
    }
}

// A visible point of a surface.
struct Visible {
    uint material;
    MaterialPoint point;
    Frame frame;
    // A normal of the triangle, of any length and sign.
    vec3 facet;
    bool front_facing;
    ivec2 pixel;
    // Where a debug view is drawn: colour of the texture level.
    vec3 levels;
};

// Radiance towards the camera, or the value of the debug view.
vec3 shade(Visible v) {
    MaterialPoint m = v.point;
    vec3 position = v.frame.position;
    vec3 view = view_direction(position);
    vec3 normal = bend_normal(m.normal, v.frame, v.facet, view, v.front_facing);
    vec3 coat_normal =
        HAS_CLEARCOAT ? bend_normal(m.clearcoat_normal, v.frame, v.facet, view, v.front_facing) : normal;
    Surface s = make_surface(m, normal, coat_normal, view);
    float view_depth = -(global.view * vec4(position, 1.0)).z;
    if ((materials[v.material].double_sided & MATERIAL_UNLIT) != 0u && !DEBUG_VIEW) {
        return m.base.rgb;
    }
    float contact = CONTACT_SHADOWS && !BLENDED ? contact_visibility(v.pixel) : 1.0;
    Occlusion screen = surroundings(v.pixel, s.normal);
    Reflected direct = direct_light(s, position, facing_normal(v.facet, view), view_depth, contact);
    Reflected indirect = indirect_light(s, screen, m.occlusion);
    vec3 emitted = m.emission * emission_share(s);
    return DEBUG_VIEW
        ? view_color(m, s, direct, indirect, View(view_depth, screen.visibility, contact, v.levels))
        : direct.diffuse + direct.specular + indirect.diffuse + indirect.specular + emitted;
}

#endif
