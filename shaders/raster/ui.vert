// Triangles of the panel: vertices in points, pulled by index.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require

struct PanelVertex {
    vec2 position;
    vec2 uv;
    // sRGB bytes, premultiplied.
    uint color;
};

layout(set = 3, binding = 8, scalar) readonly buffer Vertices {
    PanelVertex vertices[];
};

layout(push_constant, scalar) uniform Push {
    // Points to clip space.
    vec2 scale;
};

layout(location = 0) out vec2 uv;
layout(location = 1) out vec4 color;

void main() {
    PanelVertex v = vertices[gl_VertexIndex];
    uv = v.uv;
    color = unpackUnorm4x8(v.color);
    gl_Position = vec4(v.position * scale - 1.0, 0.0, 1.0);
}
