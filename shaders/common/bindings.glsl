// Descriptor sets 0 (frame) and 1 (bindless), the same for every pass.
#ifndef CAIRN_BINDINGS_GLSL
#define CAIRN_BINDINGS_GLSL

#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_nonuniform_qualifier : require
// gpu.glsl declares records with 64-bit addresses; a module that uses none of them needs no Int64 capability.
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#include "gpu.glsl"

layout(set = 0, binding = 0, std140) uniform GlobalBlock {
    GlobalUniform global;
};
layout(set = 0, binding = 1, scalar) readonly buffer LightBuffer {
    DirectionalLight lights[];
};
layout(set = 0, binding = 2, scalar) readonly buffer MaterialBuffer {
    Material materials[];
};
layout(set = 0, binding = 3, scalar) readonly buffer InstanceBuffer {
    Instance instances[];
};
// Bound where HAS_TEXTURE_TRANSFORMS; one record per 2D slot of the package, the BRDF table's excepted.
layout(set = 0, binding = 9, scalar) readonly buffer TextureTransformBuffer {
    TextureTransform texture_transforms[];
};
// Bound where HAS_VERTEX_COLORS; one record per vertex of the arena.
layout(set = 0, binding = 10, scalar) readonly buffer VertexColorBuffer {
    VertexColor vertex_colors[];
};

// Bound where the package has point or spot lights.
layout(set = 0, binding = 11, scalar) readonly buffer PunctualLightBuffer {
    PunctualLight punctual_lights[];
};

// Bound where some material has lobes beyond metallic-roughness; one record per material.
layout(set = 0, binding = 12, scalar) readonly buffer MaterialExtensionBuffer {
    MaterialExtension material_extensions[];
};

// The arenas and the draws, where a pass fetches vertices itself.
layout(set = 0, binding = 13, scalar) readonly buffer VertexBuffer {
    Vertex arena_vertices[];
};
layout(set = 0, binding = 14, scalar) readonly buffer IndexBuffer {
    uint arena_indices[];
};
layout(set = 0, binding = 15, scalar) readonly buffer DrawGroupBuffer {
    DrawGroup draw_groups[];
};

// Linear RGBA of a vertex of the arena.
vec4 arena_color(uint vertex) {
    VertexColor color = vertex_colors[vertex];
    return vec4(unpackUnorm2x16(color.red_green), unpackUnorm2x16(color.blue_alpha));
}

layout(set = 1, binding = 0) uniform sampler2D textures[];
layout(set = 1, binding = 1) uniform samplerCube cubes[];

#endif
