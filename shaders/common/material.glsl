// What a material says of a point: factors, textures and vertex colour put together.
//
// Fragment shaders let the hardware choose texture levels. Stages without derivatives define CAIRN_EXPLICIT_LOD or
// CAIRN_EXPLICIT_GRADIENT before any include, and give the footprint or the gradient with the coordinates.
#ifndef CAIRN_MATERIAL_GLSL
#define CAIRN_MATERIAL_GLSL

#include "bindings.glsl"
#include "options.glsl"

const float DIELECTRIC_F0 = 0.04;

struct TexCoords {
    vec2 uv0;
    vec2 uv1;
#ifdef CAIRN_EXPLICIT_LOD
    // log2 of the footprint's width in uv0 and uv1, before a texture's transform; very negative ones
    // read level 0.
    float footprint0;
    float footprint1;
#endif
#ifdef CAIRN_EXPLICIT_GRADIENT
    // Change of uv0 and uv1 to the next pixel on the right (xy) and below (zw).
    vec4 gradient0;
    vec4 gradient1;
#endif
};

struct MaterialPoint {
    // Linear; alpha as glTF's alpha mode uses it.
    vec4 base;
    vec3 emission;
    float metallic;
    // Perceptual.
    float roughness;
    float occlusion;
    // Tangent space, unit.
    vec3 normal;
    // Reflectance of the dielectric part at normal incidence and at grazing.
    vec3 dielectric_f0;
    float dielectric_f90;
    vec3 sheen_color;
    float sheen_roughness;
    float clearcoat;
    float clearcoat_roughness;
    // Tangent space, unit.
    vec3 clearcoat_normal;
};

mat2 texture_matrix(uint slot) {
    vec4 matrix = texture_transforms[slot].matrix;
    return mat2(matrix.xy, matrix.zw);
}

// Where a reference reads its texture.
vec2 texture_uv(uint reference, TexCoords coords) {
    uint slot = reference & ~TEXTURE_UV1;
    vec2 uv = (reference & TEXTURE_UV1) != 0u ? coords.uv1 : coords.uv0;
    return HAS_TEXTURE_TRANSFORMS ? texture_matrix(slot) * uv + texture_transforms[slot].offset : uv;
}

#ifdef CAIRN_EXPLICIT_LOD
// The level whose texels are as wide as the footprint.
float texture_level(uint reference, TexCoords coords) {
    uint slot = reference & ~TEXTURE_UV1;
    vec2 size = vec2(textureSize(textures[nonuniformEXT(slot)], 0));
    float stretch = HAS_TEXTURE_TRANSFORMS ? abs(determinant(texture_matrix(slot))) : 1.0;
    float footprint = (reference & TEXTURE_UV1) != 0u ? coords.footprint1 : coords.footprint0;
    return max(footprint + 0.5 * log2(max(size.x * size.y * stretch, 1e-12)), 0.0);
}
#endif

#ifdef CAIRN_EXPLICIT_GRADIENT
vec4 texture_gradient(uint reference, TexCoords coords) {
    vec4 gradient = (reference & TEXTURE_UV1) != 0u ? coords.gradient1 : coords.gradient0;
    if (HAS_TEXTURE_TRANSFORMS) {
        mat2 matrix = texture_matrix(reference & ~TEXTURE_UV1);
        gradient = vec4(matrix * gradient.xy, matrix * gradient.zw);
    }
    return gradient;
}
#endif

// `absent` where the reference names no texture. Colour textures have sRGB formats: the sampler decodes them.
vec4 sample_texture(uint reference, TexCoords coords, vec4 absent) {
    if (reference == NO_TEXTURE) {
        return absent;
    }
    uint slot = reference & ~TEXTURE_UV1;
    vec2 uv = texture_uv(reference, coords);
#ifdef CAIRN_EXPLICIT_LOD
    return textureLod(textures[nonuniformEXT(slot)], uv, texture_level(reference, coords));
#elif defined(CAIRN_EXPLICIT_GRADIENT)
    vec4 gradient = texture_gradient(reference, coords);
    return textureGrad(textures[nonuniformEXT(slot)], uv, gradient.xy, gradient.zw);
#else
    return texture(textures[nonuniformEXT(slot)], uv);
#endif
}

// Tangent-space normal with x and y scaled (glTF 2.0, 3.9.3); z is rebuilt before the scale. A transformed map
// needs no rotation: the bake derives tangents from the transformed coordinates.
vec3 sample_bend(uint reference, float scale, TexCoords coords) {
    if (reference == NO_TEXTURE) {
        return vec3(0.0, 0.0, 1.0);
    }
    vec2 xy = sample_texture(reference, coords, vec4(0.5)).rg * 2.0 - 1.0;
    float z = sqrt(max(0.0, 1.0 - dot(xy, xy)));
    vec3 scaled = vec3(xy * scale, z);
    float length2 = dot(scaled, scaled);
    return length2 > 0.0 ? scaled * inversesqrt(length2) : vec3(0.0, 0.0, 1.0);
}

vec3 sample_normal(Material material, TexCoords coords) {
    return sample_bend(material.normal_tex, material.normal_scale, coords);
}

vec4 base_color(Material material, TexCoords coords, vec4 vertex_color) {
    vec4 base = material.base_color_factor * sample_texture(material.base_color_tex, coords, vec4(1.0));
    return HAS_VERTEX_COLORS ? base * vertex_color : base;
}

// The lobes that KHR_materials_specular, ior, sheen and clearcoat add.
void evaluate_lobes(uint index, TexCoords coords, inout MaterialPoint point) {
    MaterialExtension lobes = material_extensions[index];
    if (HAS_SPECULAR) {
        float factor = lobes.specular_factor * sample_texture(lobes.specular_tex, coords, vec4(1.0)).a;
        vec3 color = lobes.specular_color * sample_texture(lobes.specular_color_tex, coords, vec4(1.0)).rgb;
        point.dielectric_f0 = min(lobes.dielectric_f0 * color, 1.0) * factor;
        point.dielectric_f90 = factor;
    }
    if (HAS_SHEEN) {
        point.sheen_color = lobes.sheen_color * sample_texture(lobes.sheen_color_tex, coords, vec4(1.0)).rgb;
        float texel = sample_texture(lobes.sheen_roughness_tex, coords, vec4(1.0)).a;
        point.sheen_roughness = lobes.sheen_roughness * texel;
    }
    if (HAS_CLEARCOAT) {
        point.clearcoat = lobes.clearcoat_factor * sample_texture(lobes.clearcoat_tex, coords, vec4(1.0)).r;
        float texel = sample_texture(lobes.clearcoat_roughness_tex, coords, vec4(1.0)).g;
        point.clearcoat_roughness = clamp(lobes.clearcoat_roughness * texel, 0.0, 1.0);
        point.clearcoat_normal = sample_bend(lobes.clearcoat_normal_tex, lobes.clearcoat_normal_scale, coords);
    }
}

// `vertex_color` counts where HAS_VERTEX_COLORS.
MaterialPoint evaluate_material(uint index, TexCoords coords, vec4 vertex_color) {
    Material material = materials[index];
    vec2 texel = sample_texture(material.metallic_roughness_tex, coords, vec4(1.0)).gb;
    float occlusion = sample_texture(material.occlusion_tex, coords, vec4(1.0)).r;
    MaterialPoint point;
    point.base = base_color(material, coords, vertex_color);
    point.emission = material.emissive_factor.rgb * sample_texture(material.emissive_tex, coords, vec4(1.0)).rgb;
    point.metallic = clamp(texel.y * material.metallic_factor, 0.0, 1.0);
    point.roughness = clamp(texel.x * material.roughness_factor, 0.0, 1.0);
    point.occlusion = 1.0 + material.occlusion_strength * (occlusion - 1.0);
    point.normal = sample_normal(material, coords);
    point.dielectric_f0 = vec3(DIELECTRIC_F0);
    point.dielectric_f90 = 1.0;
    point.sheen_color = vec3(0.0);
    point.sheen_roughness = 0.0;
    point.clearcoat = 0.0;
    point.clearcoat_roughness = 0.0;
    point.clearcoat_normal = vec3(0.0, 0.0, 1.0);
    if (HAS_SPECULAR || HAS_SHEEN || HAS_CLEARCOAT) {
        evaluate_lobes(index, coords, point);
    }
    return point;
}

#endif
