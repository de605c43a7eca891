// Declares every shared record in a scalar buffer, and GlobalUniform in a std140 block too, for reflection tests.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#include "gpu.glsl"

layout(local_size_x = 1) in;

layout(set = 0, binding = 0, std140) uniform GlobalUniformStd140 {
    GlobalUniform uniform_record;
};

#define RECORD(index, type) \
    layout(set = 1, binding = index, scalar) buffer type##Scalar { \
        type record[]; \
    } type##_buffer;

RECORD(0, Vertex)
RECORD(1, GlobalUniform)
RECORD(2, DirectionalLight)
RECORD(3, Material)
RECORD(4, Instance)
RECORD(5, GeometryInfo)
RECORD(6, EnvAliasEntry)
RECORD(7, EnvAliasHeader)
RECORD(8, EmissiveTriangle)
RECORD(9, EmissiveAliasEntry)
RECORD(10, EmissiveAliasHeader)
RECORD(11, ShadowPush)
RECORD(12, GtaoPush)
RECORD(13, AoTemporalPush)
RECORD(14, ContactPush)
RECORD(15, PathTracePush)
RECORD(16, DrawGroup)
RECORD(17, MeshInstance)
RECORD(18, TextureTransform)
RECORD(19, VertexColor)
RECORD(20, PunctualLight)
RECORD(21, MaterialExtension)
RECORD(22, AoSpatialPush)
RECORD(23, VisiblePush)

// Each record is read and written, so that no declaration is dropped.
void main() {
    Vertex_buffer.record[0] = Vertex_buffer.record[1];
    GlobalUniform_buffer.record[0].view = uniform_record.view;
    DirectionalLight_buffer.record[0] = DirectionalLight_buffer.record[1];
    Material_buffer.record[0] = Material_buffer.record[1];
    Instance_buffer.record[0] = Instance_buffer.record[1];
    GeometryInfo_buffer.record[0] = GeometryInfo_buffer.record[1];
    EnvAliasEntry_buffer.record[0] = EnvAliasEntry_buffer.record[1];
    EnvAliasHeader_buffer.record[0] = EnvAliasHeader_buffer.record[1];
    EmissiveTriangle_buffer.record[0] = EmissiveTriangle_buffer.record[1];
    EmissiveAliasEntry_buffer.record[0] = EmissiveAliasEntry_buffer.record[1];
    EmissiveAliasHeader_buffer.record[0] = EmissiveAliasHeader_buffer.record[1];
    ShadowPush_buffer.record[0] = ShadowPush_buffer.record[1];
    GtaoPush_buffer.record[0] = GtaoPush_buffer.record[1];
    AoTemporalPush_buffer.record[0] = AoTemporalPush_buffer.record[1];
    ContactPush_buffer.record[0] = ContactPush_buffer.record[1];
    PathTracePush_buffer.record[0] = PathTracePush_buffer.record[1];
    DrawGroup_buffer.record[0] = DrawGroup_buffer.record[1];
    MeshInstance_buffer.record[0] = MeshInstance_buffer.record[1];
    TextureTransform_buffer.record[0] = TextureTransform_buffer.record[1];
    VertexColor_buffer.record[0] = VertexColor_buffer.record[1];
    PunctualLight_buffer.record[0] = PunctualLight_buffer.record[1];
    MaterialExtension_buffer.record[0] = MaterialExtension_buffer.record[1];
    AoSpatialPush_buffer.record[0] = AoSpatialPush_buffer.record[1];
    VisiblePush_buffer.record[0] = VisiblePush_buffer.record[1];
}
