/* cairn.h: the layout of a Cairn package, for C11 and C++11. Generated from cairn-format's records;
 * `UPDATE_GOLDEN=1 cargo test -p cairn-format --test reference` writes it anew. Described in docs/format.md.
 * Everything is little-endian. Nothing here checks a file: offsets, lengths and hashes are the reader's duty. */
#ifndef CAIRN_H
#define CAIRN_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
#define CAIRN_ASSERT(condition) static_assert(condition, #condition)
#else
#define CAIRN_ASSERT(condition) _Static_assert(condition, #condition)
#endif

#define CAIRN_MAGIC "CAIRN\r\n\x1a"
#define CAIRN_VERSION 3u
#define CAIRN_SCHEMA_HASH 0xb0f98049a3b897bcu
#define CAIRN_PAGE 4096u
#define CAIRN_ALIGNMENT 16u

#define CAIRN_SECTION_VERTICES 1u
#define CAIRN_SECTION_INDICES 2u
#define CAIRN_SECTION_INSTANCES 3u
#define CAIRN_SECTION_INSTANCE_BOUNDS 4u
#define CAIRN_SECTION_DRAW_GROUPS 5u
#define CAIRN_SECTION_MESH_INSTANCES 6u
#define CAIRN_SECTION_MATERIALS 7u
#define CAIRN_SECTION_DIRECTIONAL_LIGHTS 8u
#define CAIRN_SECTION_TEXELS 9u
#define CAIRN_SECTION_ENV_ALIAS 10u
#define CAIRN_SECTION_EMISSIVE_TRIANGLES 11u
#define CAIRN_SECTION_EMISSIVE_ALIAS 12u
#define CAIRN_SECTION_TEXTURE_TRANSFORMS 13u
#define CAIRN_SECTION_VERTEX_COLORS 14u
#define CAIRN_SECTION_CLUSTER_BOUNDS 15u
#define CAIRN_SECTION_PUNCTUAL_LIGHTS 16u
#define CAIRN_SECTION_MATERIAL_EXTENSIONS 17u

#define CAIRN_FORMAT_BC7_UNORM 0u
#define CAIRN_FORMAT_BC7_SRGB 1u
#define CAIRN_FORMAT_BC5_UNORM 2u
#define CAIRN_FORMAT_BC4_UNORM 3u
#define CAIRN_FORMAT_BC6H_UFLOAT 4u
#define CAIRN_FORMAT_RGBA8_UNORM 5u
#define CAIRN_FORMAT_RGBA8_SRGB 6u
#define CAIRN_FORMAT_RGBA16_FLOAT 7u
#define CAIRN_FORMAT_RGB9E5_UFLOAT 8u
#define CAIRN_FORMAT_RGBA16_UNORM 9u
#define CAIRN_FORMAT_UASTC_UNORM 10u
#define CAIRN_FORMAT_UASTC_SRGB 11u

#define CAIRN_HAS_MASK 0x1u
#define CAIRN_HAS_BLEND 0x2u
#define CAIRN_HAS_DOUBLE_SIDED 0x4u
#define CAIRN_HAS_MIRRORED 0x8u
#define CAIRN_HAS_NORMAL_MAPS 0x10u
#define CAIRN_HAS_EMISSIVE 0x20u
#define CAIRN_HAS_UV1 0x40u
#define CAIRN_HAS_DIRECTIONAL_LIGHTS 0x80u
#define CAIRN_HAS_ENVIRONMENT 0x100u
#define CAIRN_HAS_TEXTURES 0x200u
#define CAIRN_HAS_UNLIT 0x400u
#define CAIRN_HAS_TEXTURE_TRANSFORMS 0x800u
#define CAIRN_HAS_VERTEX_COLORS 0x1000u
#define CAIRN_HAS_PUNCTUAL_LIGHTS 0x2000u
#define CAIRN_HAS_CLEARCOAT 0x4000u
#define CAIRN_HAS_SPECULAR 0x8000u
#define CAIRN_HAS_SHEEN 0x10000u
#define CAIRN_HAS_SUN 0x20000u

#define CAIRN_NO_TEXTURE 0xffffffffu
#define CAIRN_TEXTURE_UV1 0x80000000u
#define CAIRN_MATERIAL_DOUBLE_SIDED 0x1u
#define CAIRN_MATERIAL_UNLIT 0x2u
#define CAIRN_LOBE_CLEARCOAT 0x1u
#define CAIRN_LOBE_SPECULAR 0x2u
#define CAIRN_LOBE_SHEEN 0x4u
#define CAIRN_ALPHA_OPAQUE 0x0u
#define CAIRN_ALPHA_MASK 0x1u
#define CAIRN_ALPHA_BLEND 0x2u
#define CAIRN_DRAW_DOUBLE_SIDED 0x1u
#define CAIRN_DRAW_MIRRORED 0x2u
#define CAIRN_NO_EMISSION 0xffffffffu
#define CAIRN_LIGHT_ENVIRONMENT 0x1u
#define CAIRN_LIGHT_SUN 0x2u
#define CAIRN_LIGHT_PUNCTUAL 0x4u
#define CAIRN_LIGHT_EMITTERS 0x8u
#define CAIRN_FEATURE_SHADOWS 0x1u
#define CAIRN_FEATURE_AO 0x2u
#define CAIRN_FEATURE_CONTACT_SHADOWS 0x4u
#define CAIRN_BRDF_TABLE_SIZE 0x40u

typedef struct CairnHeader {
    uint8_t magic[8];
    uint32_t version;
    uint32_t section_count;
    uint64_t file_length;
    uint64_t schema_hash;
    uint64_t root_offset;
    uint64_t root_length;
    uint8_t tool_version[16];
    uint8_t content_hash[32];
    uint8_t reserved[32];
} CairnHeader;
CAIRN_ASSERT(sizeof(CairnHeader) == 128);
CAIRN_ASSERT(offsetof(CairnHeader, magic) == 0);
CAIRN_ASSERT(offsetof(CairnHeader, version) == 8);
CAIRN_ASSERT(offsetof(CairnHeader, section_count) == 12);
CAIRN_ASSERT(offsetof(CairnHeader, file_length) == 16);
CAIRN_ASSERT(offsetof(CairnHeader, schema_hash) == 24);
CAIRN_ASSERT(offsetof(CairnHeader, root_offset) == 32);
CAIRN_ASSERT(offsetof(CairnHeader, root_length) == 40);
CAIRN_ASSERT(offsetof(CairnHeader, tool_version) == 48);
CAIRN_ASSERT(offsetof(CairnHeader, content_hash) == 64);
CAIRN_ASSERT(offsetof(CairnHeader, reserved) == 96);

typedef struct CairnSectionEntry {
    uint32_t kind;
    uint32_t stride;
    uint64_t offset;
    uint64_t length;
    uint64_t count;
    uint8_t hash[32];
} CairnSectionEntry;
CAIRN_ASSERT(sizeof(CairnSectionEntry) == 64);
CAIRN_ASSERT(offsetof(CairnSectionEntry, kind) == 0);
CAIRN_ASSERT(offsetof(CairnSectionEntry, stride) == 4);
CAIRN_ASSERT(offsetof(CairnSectionEntry, offset) == 8);
CAIRN_ASSERT(offsetof(CairnSectionEntry, length) == 16);
CAIRN_ASSERT(offsetof(CairnSectionEntry, count) == 24);
CAIRN_ASSERT(offsetof(CairnSectionEntry, hash) == 32);

/* Records of the sections. */

typedef struct CairnVertex {
    float position[3];
    float normal[3];
    float uv0[2];
    float tangent[4];
    float uv1[2];
} CairnVertex;
CAIRN_ASSERT(sizeof(CairnVertex) == 56);
CAIRN_ASSERT(offsetof(CairnVertex, position) == 0);
CAIRN_ASSERT(offsetof(CairnVertex, normal) == 12);
CAIRN_ASSERT(offsetof(CairnVertex, uv0) == 24);
CAIRN_ASSERT(offsetof(CairnVertex, tangent) == 32);
CAIRN_ASSERT(offsetof(CairnVertex, uv1) == 48);

typedef struct CairnInstance {
    float model[4][4];
    float normal_matrix[3][4];
    uint32_t material_index;
    uint32_t pad_116;
    uint32_t pad_120;
    uint32_t pad_124;
} CairnInstance;
CAIRN_ASSERT(sizeof(CairnInstance) == 128);
CAIRN_ASSERT(offsetof(CairnInstance, model) == 0);
CAIRN_ASSERT(offsetof(CairnInstance, normal_matrix) == 64);
CAIRN_ASSERT(offsetof(CairnInstance, material_index) == 112);
CAIRN_ASSERT(offsetof(CairnInstance, pad_116) == 116);
CAIRN_ASSERT(offsetof(CairnInstance, pad_120) == 120);
CAIRN_ASSERT(offsetof(CairnInstance, pad_124) == 124);

typedef struct CairnDrawGroup {
    uint32_t first_index;
    uint32_t index_count;
    uint32_t vertex_offset;
    uint32_t first_instance;
    uint32_t instance_count;
    uint32_t primitive;
    uint32_t alpha_mode;
    uint32_t flags;
} CairnDrawGroup;
CAIRN_ASSERT(sizeof(CairnDrawGroup) == 32);
CAIRN_ASSERT(offsetof(CairnDrawGroup, first_index) == 0);
CAIRN_ASSERT(offsetof(CairnDrawGroup, index_count) == 4);
CAIRN_ASSERT(offsetof(CairnDrawGroup, vertex_offset) == 8);
CAIRN_ASSERT(offsetof(CairnDrawGroup, first_instance) == 12);
CAIRN_ASSERT(offsetof(CairnDrawGroup, instance_count) == 16);
CAIRN_ASSERT(offsetof(CairnDrawGroup, primitive) == 20);
CAIRN_ASSERT(offsetof(CairnDrawGroup, alpha_mode) == 24);
CAIRN_ASSERT(offsetof(CairnDrawGroup, flags) == 28);

typedef struct CairnMeshInstance {
    float transform[3][4];
    uint32_t mesh;
    uint32_t first_geometry;
    uint32_t flags;
    uint32_t first_emissive;
} CairnMeshInstance;
CAIRN_ASSERT(sizeof(CairnMeshInstance) == 64);
CAIRN_ASSERT(offsetof(CairnMeshInstance, transform) == 0);
CAIRN_ASSERT(offsetof(CairnMeshInstance, mesh) == 48);
CAIRN_ASSERT(offsetof(CairnMeshInstance, first_geometry) == 52);
CAIRN_ASSERT(offsetof(CairnMeshInstance, flags) == 56);
CAIRN_ASSERT(offsetof(CairnMeshInstance, first_emissive) == 60);

typedef struct CairnMaterial {
    float base_color_factor[4];
    float emissive_factor[4];
    float metallic_factor;
    float roughness_factor;
    float normal_scale;
    float occlusion_strength;
    uint32_t base_color_tex;
    uint32_t emissive_tex;
    uint32_t metallic_roughness_tex;
    uint32_t normal_tex;
    uint32_t occlusion_tex;
    float alpha_cutoff;
    uint32_t alpha_mode;
    uint32_t double_sided;
} CairnMaterial;
CAIRN_ASSERT(sizeof(CairnMaterial) == 80);
CAIRN_ASSERT(offsetof(CairnMaterial, base_color_factor) == 0);
CAIRN_ASSERT(offsetof(CairnMaterial, emissive_factor) == 16);
CAIRN_ASSERT(offsetof(CairnMaterial, metallic_factor) == 32);
CAIRN_ASSERT(offsetof(CairnMaterial, roughness_factor) == 36);
CAIRN_ASSERT(offsetof(CairnMaterial, normal_scale) == 40);
CAIRN_ASSERT(offsetof(CairnMaterial, occlusion_strength) == 44);
CAIRN_ASSERT(offsetof(CairnMaterial, base_color_tex) == 48);
CAIRN_ASSERT(offsetof(CairnMaterial, emissive_tex) == 52);
CAIRN_ASSERT(offsetof(CairnMaterial, metallic_roughness_tex) == 56);
CAIRN_ASSERT(offsetof(CairnMaterial, normal_tex) == 60);
CAIRN_ASSERT(offsetof(CairnMaterial, occlusion_tex) == 64);
CAIRN_ASSERT(offsetof(CairnMaterial, alpha_cutoff) == 68);
CAIRN_ASSERT(offsetof(CairnMaterial, alpha_mode) == 72);
CAIRN_ASSERT(offsetof(CairnMaterial, double_sided) == 76);

typedef struct CairnDirectionalLight {
    float direction_and_intensity[4];
    float color_and_shadow[4];
} CairnDirectionalLight;
CAIRN_ASSERT(sizeof(CairnDirectionalLight) == 32);
CAIRN_ASSERT(offsetof(CairnDirectionalLight, direction_and_intensity) == 0);
CAIRN_ASSERT(offsetof(CairnDirectionalLight, color_and_shadow) == 16);

typedef struct CairnEmissiveTriangle {
    float v0[3];
    uint32_t pad_12;
    float v1[3];
    uint32_t pad_28;
    float v2[3];
    uint32_t pad_44;
    float emission[3];
    float area;
    uint32_t material_index;
    float power;
    float uv0[2];
    float uv1[2];
    float uv2[2];
} CairnEmissiveTriangle;
CAIRN_ASSERT(sizeof(CairnEmissiveTriangle) == 96);
CAIRN_ASSERT(offsetof(CairnEmissiveTriangle, v0) == 0);
CAIRN_ASSERT(offsetof(CairnEmissiveTriangle, pad_12) == 12);
CAIRN_ASSERT(offsetof(CairnEmissiveTriangle, v1) == 16);
CAIRN_ASSERT(offsetof(CairnEmissiveTriangle, pad_28) == 28);
CAIRN_ASSERT(offsetof(CairnEmissiveTriangle, v2) == 32);
CAIRN_ASSERT(offsetof(CairnEmissiveTriangle, pad_44) == 44);
CAIRN_ASSERT(offsetof(CairnEmissiveTriangle, emission) == 48);
CAIRN_ASSERT(offsetof(CairnEmissiveTriangle, area) == 60);
CAIRN_ASSERT(offsetof(CairnEmissiveTriangle, material_index) == 64);
CAIRN_ASSERT(offsetof(CairnEmissiveTriangle, power) == 68);
CAIRN_ASSERT(offsetof(CairnEmissiveTriangle, uv0) == 72);
CAIRN_ASSERT(offsetof(CairnEmissiveTriangle, uv1) == 80);
CAIRN_ASSERT(offsetof(CairnEmissiveTriangle, uv2) == 88);

typedef struct CairnTextureTransform {
    float matrix[4];
    float offset[2];
    uint32_t pad_24;
    uint32_t pad_28;
} CairnTextureTransform;
CAIRN_ASSERT(sizeof(CairnTextureTransform) == 32);
CAIRN_ASSERT(offsetof(CairnTextureTransform, matrix) == 0);
CAIRN_ASSERT(offsetof(CairnTextureTransform, offset) == 16);
CAIRN_ASSERT(offsetof(CairnTextureTransform, pad_24) == 24);
CAIRN_ASSERT(offsetof(CairnTextureTransform, pad_28) == 28);

typedef struct CairnVertexColor {
    uint32_t red_green;
    uint32_t blue_alpha;
} CairnVertexColor;
CAIRN_ASSERT(sizeof(CairnVertexColor) == 8);
CAIRN_ASSERT(offsetof(CairnVertexColor, red_green) == 0);
CAIRN_ASSERT(offsetof(CairnVertexColor, blue_alpha) == 4);

typedef struct CairnPunctualLight {
    float position_and_range[4];
    float direction_and_spot_scale[4];
    float color_and_shadow[4];
    float spot_offset;
    uint32_t pad_52;
    uint32_t pad_56;
    uint32_t pad_60;
} CairnPunctualLight;
CAIRN_ASSERT(sizeof(CairnPunctualLight) == 64);
CAIRN_ASSERT(offsetof(CairnPunctualLight, position_and_range) == 0);
CAIRN_ASSERT(offsetof(CairnPunctualLight, direction_and_spot_scale) == 16);
CAIRN_ASSERT(offsetof(CairnPunctualLight, color_and_shadow) == 32);
CAIRN_ASSERT(offsetof(CairnPunctualLight, spot_offset) == 48);
CAIRN_ASSERT(offsetof(CairnPunctualLight, pad_52) == 52);
CAIRN_ASSERT(offsetof(CairnPunctualLight, pad_56) == 56);
CAIRN_ASSERT(offsetof(CairnPunctualLight, pad_60) == 60);

typedef struct CairnMaterialExtension {
    float sheen_color[3];
    float sheen_roughness;
    float specular_color[3];
    float specular_factor;
    float dielectric_f0;
    float clearcoat_factor;
    float clearcoat_roughness;
    float clearcoat_normal_scale;
    uint32_t clearcoat_tex;
    uint32_t clearcoat_roughness_tex;
    uint32_t clearcoat_normal_tex;
    uint32_t specular_tex;
    uint32_t specular_color_tex;
    uint32_t sheen_color_tex;
    uint32_t sheen_roughness_tex;
    uint32_t lobes;
} CairnMaterialExtension;
CAIRN_ASSERT(sizeof(CairnMaterialExtension) == 80);
CAIRN_ASSERT(offsetof(CairnMaterialExtension, sheen_color) == 0);
CAIRN_ASSERT(offsetof(CairnMaterialExtension, sheen_roughness) == 12);
CAIRN_ASSERT(offsetof(CairnMaterialExtension, specular_color) == 16);
CAIRN_ASSERT(offsetof(CairnMaterialExtension, specular_factor) == 28);
CAIRN_ASSERT(offsetof(CairnMaterialExtension, dielectric_f0) == 32);
CAIRN_ASSERT(offsetof(CairnMaterialExtension, clearcoat_factor) == 36);
CAIRN_ASSERT(offsetof(CairnMaterialExtension, clearcoat_roughness) == 40);
CAIRN_ASSERT(offsetof(CairnMaterialExtension, clearcoat_normal_scale) == 44);
CAIRN_ASSERT(offsetof(CairnMaterialExtension, clearcoat_tex) == 48);
CAIRN_ASSERT(offsetof(CairnMaterialExtension, clearcoat_roughness_tex) == 52);
CAIRN_ASSERT(offsetof(CairnMaterialExtension, clearcoat_normal_tex) == 56);
CAIRN_ASSERT(offsetof(CairnMaterialExtension, specular_tex) == 60);
CAIRN_ASSERT(offsetof(CairnMaterialExtension, specular_color_tex) == 64);
CAIRN_ASSERT(offsetof(CairnMaterialExtension, sheen_color_tex) == 68);
CAIRN_ASSERT(offsetof(CairnMaterialExtension, sheen_roughness_tex) == 72);
CAIRN_ASSERT(offsetof(CairnMaterialExtension, lobes) == 76);

typedef struct CairnEnvAliasHeader {
    float total_luminance;
    uint32_t entry_count;
    uint32_t width;
    uint32_t height;
} CairnEnvAliasHeader;
CAIRN_ASSERT(sizeof(CairnEnvAliasHeader) == 16);
CAIRN_ASSERT(offsetof(CairnEnvAliasHeader, total_luminance) == 0);
CAIRN_ASSERT(offsetof(CairnEnvAliasHeader, entry_count) == 4);
CAIRN_ASSERT(offsetof(CairnEnvAliasHeader, width) == 8);
CAIRN_ASSERT(offsetof(CairnEnvAliasHeader, height) == 12);

typedef struct CairnEnvAliasEntry {
    float prob;
    uint32_t alias_index;
    float luminance;
} CairnEnvAliasEntry;
CAIRN_ASSERT(sizeof(CairnEnvAliasEntry) == 12);
CAIRN_ASSERT(offsetof(CairnEnvAliasEntry, prob) == 0);
CAIRN_ASSERT(offsetof(CairnEnvAliasEntry, alias_index) == 4);
CAIRN_ASSERT(offsetof(CairnEnvAliasEntry, luminance) == 8);

typedef struct CairnEmissiveAliasHeader {
    uint32_t count;
    float total_power;
} CairnEmissiveAliasHeader;
CAIRN_ASSERT(sizeof(CairnEmissiveAliasHeader) == 8);
CAIRN_ASSERT(offsetof(CairnEmissiveAliasHeader, count) == 0);
CAIRN_ASSERT(offsetof(CairnEmissiveAliasHeader, total_power) == 4);

typedef struct CairnEmissiveAliasEntry {
    float prob;
    uint32_t alias_index;
} CairnEmissiveAliasEntry;
CAIRN_ASSERT(sizeof(CairnEmissiveAliasEntry) == 8);
CAIRN_ASSERT(offsetof(CairnEmissiveAliasEntry, prob) == 0);
CAIRN_ASSERT(offsetof(CairnEmissiveAliasEntry, alias_index) == 4);

/* The root. */

/* A list: `offset` bytes from the place of this field lie `length` elements. */
typedef struct CairnList {
    int64_t offset;
    uint64_t length;
} CairnList;
CAIRN_ASSERT(sizeof(CairnList) == 16);

/* A text in UTF-8: read with cairn_text. */
typedef union CairnString {
    uint8_t bytes[16];
    struct {
        uint64_t length;
        int64_t offset;
    } outside;
} CairnString;
CAIRN_ASSERT(sizeof(CairnString) == 16);

/* First element of a list. */
static inline const void *cairn_items(const CairnList *list) {
    return (const char *)list + list->offset;
}

/* Bytes of a text, and their number; they do not end with zero. Up to 16 bytes lie in the field itself, the rest of it
 * filled with 0xff; the first byte of a longer one, which no text begins with, has the form 10xxxxxx. */
static inline const char *cairn_text(const CairnString *text, size_t *length) {
    const uint64_t stored = text->outside.length;
    if ((text->bytes[0] & 0xc0) != 0x80) {
        *length = 0;
        while (*length < 16 && text->bytes[*length] != 0xff) {
            *length += 1;
        }
        return (const char *)text->bytes;
    }
    *length = (size_t)((stored & 0x3f) | (stored & ~(uint64_t)0xff) >> 2);
    return (const char *)text + text->outside.offset;
}

typedef struct CairnBounds {
    float min[3];
    float max[3];
} CairnBounds;
CAIRN_ASSERT(sizeof(CairnBounds) == 24);
CAIRN_ASSERT(offsetof(CairnBounds, min) == 0);
CAIRN_ASSERT(offsetof(CairnBounds, max) == 12);

typedef struct CairnMesh {
    CairnString name;
    uint32_t first_primitive;
    uint32_t primitive_count;
} CairnMesh;
CAIRN_ASSERT(sizeof(CairnMesh) == 24);
CAIRN_ASSERT(offsetof(CairnMesh, name) == 0);
CAIRN_ASSERT(offsetof(CairnMesh, first_primitive) == 16);
CAIRN_ASSERT(offsetof(CairnMesh, primitive_count) == 20);

typedef struct CairnMaterialInfo {
    CairnString name;
} CairnMaterialInfo;
CAIRN_ASSERT(sizeof(CairnMaterialInfo) == 16);
CAIRN_ASSERT(offsetof(CairnMaterialInfo, name) == 0);

typedef struct CairnTexture {
    uint32_t image;
    uint32_t sampler;
} CairnTexture;
CAIRN_ASSERT(sizeof(CairnTexture) == 8);
CAIRN_ASSERT(offsetof(CairnTexture, image) == 0);
CAIRN_ASSERT(offsetof(CairnTexture, sampler) == 4);

typedef uint8_t CairnImageRole;
#define CAIRN_IMAGE_ROLE_COLOR 0u
#define CAIRN_IMAGE_ROLE_DATA 1u
#define CAIRN_IMAGE_ROLE_NORMAL 2u
#define CAIRN_IMAGE_ROLE_ENVIRONMENT 3u

typedef uint8_t CairnSwizzle;
#define CAIRN_SWIZZLE_RED 0u
#define CAIRN_SWIZZLE_GREEN 1u
#define CAIRN_SWIZZLE_BLUE 2u
#define CAIRN_SWIZZLE_ALPHA 3u
#define CAIRN_SWIZZLE_ZERO 4u
#define CAIRN_SWIZZLE_ONE 5u

typedef struct CairnLevel {
    uint64_t offset;
    uint64_t length;
} CairnLevel;
CAIRN_ASSERT(sizeof(CairnLevel) == 16);
CAIRN_ASSERT(offsetof(CairnLevel, offset) == 0);
CAIRN_ASSERT(offsetof(CairnLevel, length) == 8);

typedef uint8_t CairnWrap;
#define CAIRN_WRAP_REPEAT 0u
#define CAIRN_WRAP_MIRRORED_REPEAT 1u
#define CAIRN_WRAP_CLAMP_TO_EDGE 2u

typedef uint8_t CairnMipFilter;
#define CAIRN_MIP_FILTER_NONE 0u
#define CAIRN_MIP_FILTER_NEAREST 1u
#define CAIRN_MIP_FILTER_LINEAR 2u

typedef uint8_t CairnLightKind;
#define CAIRN_LIGHT_KIND_DIRECTIONAL 0u
#define CAIRN_LIGHT_KIND_POINT 1u
#define CAIRN_LIGHT_KIND_SPOT 2u

typedef uint8_t CairnProjectionKind;
#define CAIRN_PROJECTION_KIND_PERSPECTIVE 0u
#define CAIRN_PROJECTION_KIND_ORTHOGRAPHIC 1u

typedef struct CairnSun {
    float direction[3];
    float color[3];
    float illuminance;
    float angular_radius;
} CairnSun;
CAIRN_ASSERT(sizeof(CairnSun) == 32);
CAIRN_ASSERT(offsetof(CairnSun, direction) == 0);
CAIRN_ASSERT(offsetof(CairnSun, color) == 12);
CAIRN_ASSERT(offsetof(CairnSun, illuminance) == 24);
CAIRN_ASSERT(offsetof(CairnSun, angular_radius) == 28);

typedef struct CairnProvenance {
    CairnString tool;
    CairnList settings /* of CairnSetting */;
    CairnList sources /* of CairnSourceFile */;
} CairnProvenance;
CAIRN_ASSERT(sizeof(CairnProvenance) == 48);
CAIRN_ASSERT(offsetof(CairnProvenance, tool) == 0);
CAIRN_ASSERT(offsetof(CairnProvenance, settings) == 16);
CAIRN_ASSERT(offsetof(CairnProvenance, sources) == 32);

typedef struct CairnSetting {
    CairnString name;
    CairnString value;
} CairnSetting;
CAIRN_ASSERT(sizeof(CairnSetting) == 32);
CAIRN_ASSERT(offsetof(CairnSetting, name) == 0);
CAIRN_ASSERT(offsetof(CairnSetting, value) == 16);

typedef struct CairnSourceFile {
    CairnString path;
    uint64_t bytes;
    uint8_t hash[32];
} CairnSourceFile;
CAIRN_ASSERT(sizeof(CairnSourceFile) == 56);
CAIRN_ASSERT(offsetof(CairnSourceFile, path) == 0);
CAIRN_ASSERT(offsetof(CairnSourceFile, bytes) == 16);
CAIRN_ASSERT(offsetof(CairnSourceFile, hash) == 24);

typedef struct CairnReportRow {
    CairnString stage;
    CairnString item;
    CairnString setting;
    CairnString metric;
    double error;
    uint64_t bytes;
} CairnReportRow;
CAIRN_ASSERT(sizeof(CairnReportRow) == 80);
CAIRN_ASSERT(offsetof(CairnReportRow, stage) == 0);
CAIRN_ASSERT(offsetof(CairnReportRow, item) == 16);
CAIRN_ASSERT(offsetof(CairnReportRow, setting) == 32);
CAIRN_ASSERT(offsetof(CairnReportRow, metric) == 48);
CAIRN_ASSERT(offsetof(CairnReportRow, error) == 64);
CAIRN_ASSERT(offsetof(CairnReportRow, bytes) == 72);

typedef struct CairnPrimitive {
    uint32_t first_index;
    uint32_t index_count;
    uint32_t traced_index_count;
    uint32_t first_vertex;
    uint32_t vertex_count;
    uint32_t material;
    uint8_t opaque;
    CairnBounds bounds;
} CairnPrimitive;
CAIRN_ASSERT(sizeof(CairnPrimitive) == 52);
CAIRN_ASSERT(offsetof(CairnPrimitive, first_index) == 0);
CAIRN_ASSERT(offsetof(CairnPrimitive, index_count) == 4);
CAIRN_ASSERT(offsetof(CairnPrimitive, traced_index_count) == 8);
CAIRN_ASSERT(offsetof(CairnPrimitive, first_vertex) == 12);
CAIRN_ASSERT(offsetof(CairnPrimitive, vertex_count) == 16);
CAIRN_ASSERT(offsetof(CairnPrimitive, material) == 20);
CAIRN_ASSERT(offsetof(CairnPrimitive, opaque) == 24);
CAIRN_ASSERT(offsetof(CairnPrimitive, bounds) == 28);

typedef struct CairnImage {
    CairnString name;
    CairnImageRole role;
    uint8_t format;
    CairnSwizzle swizzle[4];
    uint32_t width;
    uint32_t height;
    uint32_t layers;
    CairnList levels /* of CairnLevel */;
} CairnImage;
CAIRN_ASSERT(sizeof(CairnImage) == 56);
CAIRN_ASSERT(offsetof(CairnImage, name) == 0);
CAIRN_ASSERT(offsetof(CairnImage, role) == 16);
CAIRN_ASSERT(offsetof(CairnImage, format) == 17);
CAIRN_ASSERT(offsetof(CairnImage, swizzle) == 18);
CAIRN_ASSERT(offsetof(CairnImage, width) == 24);
CAIRN_ASSERT(offsetof(CairnImage, height) == 28);
CAIRN_ASSERT(offsetof(CairnImage, layers) == 32);
CAIRN_ASSERT(offsetof(CairnImage, levels) == 40);

typedef struct CairnSampler {
    uint8_t mag_linear;
    uint8_t min_linear;
    CairnMipFilter mip;
    CairnWrap wrap_u;
    CairnWrap wrap_v;
} CairnSampler;
CAIRN_ASSERT(sizeof(CairnSampler) == 5);
CAIRN_ASSERT(offsetof(CairnSampler, mag_linear) == 0);
CAIRN_ASSERT(offsetof(CairnSampler, min_linear) == 1);
CAIRN_ASSERT(offsetof(CairnSampler, mip) == 2);
CAIRN_ASSERT(offsetof(CairnSampler, wrap_u) == 3);
CAIRN_ASSERT(offsetof(CairnSampler, wrap_v) == 4);

typedef struct CairnLight {
    CairnString name;
    CairnLightKind kind;
    float color[3];
    float intensity;
    float position[3];
    float direction[3];
    float range;
    float inner_angle;
    float outer_angle;
} CairnLight;
CAIRN_ASSERT(sizeof(CairnLight) == 72);
CAIRN_ASSERT(offsetof(CairnLight, name) == 0);
CAIRN_ASSERT(offsetof(CairnLight, kind) == 16);
CAIRN_ASSERT(offsetof(CairnLight, color) == 20);
CAIRN_ASSERT(offsetof(CairnLight, intensity) == 32);
CAIRN_ASSERT(offsetof(CairnLight, position) == 36);
CAIRN_ASSERT(offsetof(CairnLight, direction) == 48);
CAIRN_ASSERT(offsetof(CairnLight, range) == 60);
CAIRN_ASSERT(offsetof(CairnLight, inner_angle) == 64);
CAIRN_ASSERT(offsetof(CairnLight, outer_angle) == 68);

typedef struct CairnCamera {
    CairnString name;
    CairnProjectionKind projection;
    float extent;
    float znear;
    float zfar;
    float position[3];
    float forward[3];
    float up[3];
} CairnCamera;
CAIRN_ASSERT(sizeof(CairnCamera) == 72);
CAIRN_ASSERT(offsetof(CairnCamera, name) == 0);
CAIRN_ASSERT(offsetof(CairnCamera, projection) == 16);
CAIRN_ASSERT(offsetof(CairnCamera, extent) == 20);
CAIRN_ASSERT(offsetof(CairnCamera, znear) == 24);
CAIRN_ASSERT(offsetof(CairnCamera, zfar) == 28);
CAIRN_ASSERT(offsetof(CairnCamera, position) == 32);
CAIRN_ASSERT(offsetof(CairnCamera, forward) == 44);
CAIRN_ASSERT(offsetof(CairnCamera, up) == 56);

typedef struct CairnOptionSun {
    uint8_t present;
    CairnSun value;
} CairnOptionSun;
CAIRN_ASSERT(sizeof(CairnOptionSun) == 36);

typedef struct CairnEnvironment {
    uint32_t sky;
    uint32_t irradiance;
    uint32_t prefiltered;
    CairnList prefiltered_roughness /* of float */;
    float scale;
    CairnOptionSun sun;
    float irradiance_sh[9][3];
    uint32_t source_width;
    uint32_t source_height;
    uint64_t replaced_texels;
    uint64_t clamped_texels;
} CairnEnvironment;
CAIRN_ASSERT(sizeof(CairnEnvironment) == 208);
CAIRN_ASSERT(offsetof(CairnEnvironment, sky) == 0);
CAIRN_ASSERT(offsetof(CairnEnvironment, irradiance) == 4);
CAIRN_ASSERT(offsetof(CairnEnvironment, prefiltered) == 8);
CAIRN_ASSERT(offsetof(CairnEnvironment, prefiltered_roughness) == 16);
CAIRN_ASSERT(offsetof(CairnEnvironment, scale) == 32);
CAIRN_ASSERT(offsetof(CairnEnvironment, sun) == 36);
CAIRN_ASSERT(offsetof(CairnEnvironment, irradiance_sh) == 72);
CAIRN_ASSERT(offsetof(CairnEnvironment, source_width) == 180);
CAIRN_ASSERT(offsetof(CairnEnvironment, source_height) == 184);
CAIRN_ASSERT(offsetof(CairnEnvironment, replaced_texels) == 192);
CAIRN_ASSERT(offsetof(CairnEnvironment, clamped_texels) == 200);

typedef struct CairnOptionEnvironment {
    uint8_t present;
    CairnEnvironment value;
} CairnOptionEnvironment;
CAIRN_ASSERT(sizeof(CairnOptionEnvironment) == 216);

typedef struct CairnOptionU32 {
    uint8_t present;
    uint32_t value;
} CairnOptionU32;
CAIRN_ASSERT(sizeof(CairnOptionU32) == 8);

typedef struct CairnScene {
    CairnString name;
    uint32_t features;
    CairnBounds bounds;
    CairnList meshes /* of CairnMesh */;
    CairnList primitives /* of CairnPrimitive */;
    CairnList materials /* of CairnMaterialInfo */;
    CairnList textures /* of CairnTexture */;
    CairnList images /* of CairnImage */;
    CairnList samplers /* of CairnSampler */;
    CairnList lights /* of CairnLight */;
    CairnList cameras /* of CairnCamera */;
    CairnOptionEnvironment environment;
    CairnOptionU32 brdf_lut;
    CairnProvenance provenance;
    CairnList report /* of CairnReportRow */;
} CairnScene;
CAIRN_ASSERT(sizeof(CairnScene) == 464);
CAIRN_ASSERT(offsetof(CairnScene, name) == 0);
CAIRN_ASSERT(offsetof(CairnScene, features) == 16);
CAIRN_ASSERT(offsetof(CairnScene, bounds) == 20);
CAIRN_ASSERT(offsetof(CairnScene, meshes) == 48);
CAIRN_ASSERT(offsetof(CairnScene, primitives) == 64);
CAIRN_ASSERT(offsetof(CairnScene, materials) == 80);
CAIRN_ASSERT(offsetof(CairnScene, textures) == 96);
CAIRN_ASSERT(offsetof(CairnScene, images) == 112);
CAIRN_ASSERT(offsetof(CairnScene, samplers) == 128);
CAIRN_ASSERT(offsetof(CairnScene, lights) == 144);
CAIRN_ASSERT(offsetof(CairnScene, cameras) == 160);
CAIRN_ASSERT(offsetof(CairnScene, environment) == 176);
CAIRN_ASSERT(offsetof(CairnScene, brdf_lut) == 392);
CAIRN_ASSERT(offsetof(CairnScene, provenance) == 400);
CAIRN_ASSERT(offsetof(CairnScene, report) == 448);

/* The root: the last bytes of its part of the file. */
static inline const CairnScene *cairn_root(const void *file) {
    const CairnHeader *header = (const CairnHeader *)file;
    return (const CairnScene *)((const char *)file + header->root_offset + header->root_length - sizeof(CairnScene));
}

/* Row of a section, or a null pointer where it is absent. */
static inline const CairnSectionEntry *cairn_section(const void *file, uint32_t kind) {
    const CairnHeader *header = (const CairnHeader *)file;
    const CairnSectionEntry *table = (const CairnSectionEntry *)((const char *)file + sizeof(CairnHeader));
    uint32_t row;
    for (row = 0; row < header->section_count; row += 1) {
        if (table[row].kind == kind) {
            return &table[row];
        }
    }
    return NULL;
}

#endif
