// Material lookups through texture references.
#ifndef CAIRN_MATERIAL_GLSL
#define CAIRN_MATERIAL_GLSL

#include "bindings.glsl"
#include "options.glsl"

struct TexCoords {
    vec2 uv0;
    vec2 uv1;
};

// `absent` where the reference names no texture. Colour textures have sRGB formats: the sampler decodes them.
vec4 sample_texture(uint reference, TexCoords coords, vec4 absent) {
    if (reference == NO_TEXTURE) {
        return absent;
    }
    uint slot = reference & ~TEXTURE_UV1;
    vec2 uv = (reference & TEXTURE_UV1) != 0u ? coords.uv1 : coords.uv0;
    if (HAS_TEXTURE_TRANSFORMS) {
        TextureTransform transform = texture_transforms[slot];
        uv = mat2(transform.matrix.xy, transform.matrix.zw) * uv + transform.offset;
    }
    return texture(textures[nonuniformEXT(slot)], uv);
}

// Tangent-space normal with x and y scaled (glTF 2.0, 3.9.3); z is rebuilt before the scale. A transformed map
// needs no rotation: the bake derives tangents from the transformed coordinates.
vec3 sample_normal(Material material, TexCoords coords) {
    vec2 xy = sample_texture(material.normal_tex, coords, vec4(0.5)).rg * 2.0 - 1.0;
    float z = sqrt(max(0.0, 1.0 - dot(xy, xy)));
    vec3 scaled = vec3(xy * material.normal_scale, z);
    float length2 = dot(scaled, scaled);
    return length2 > 0.0 ? scaled * inversesqrt(length2) : vec3(0.0, 0.0, 1.0);
}

#endif
