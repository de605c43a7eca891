// Generated from cairn-format's records; `cargo run -p cairn-shaders --bin cairn-glsl` writes it anew.
// Offsets hold in scalar layout, and GlobalUniform's in std140 too.
#ifndef CAIRN_GPU_GLSL
#define CAIRN_GPU_GLSL

const uint NO_TEXTURE = 0xffffffffu;
const uint TEXTURE_UV1 = 0x80000000u;
const uint MATERIAL_DOUBLE_SIDED = 0x1u;
const uint MATERIAL_UNLIT = 0x2u;
const uint LOBE_CLEARCOAT = 0x1u;
const uint LOBE_SPECULAR = 0x2u;
const uint LOBE_SHEEN = 0x4u;
const uint ALPHA_OPAQUE = 0x0u;
const uint ALPHA_MASK = 0x1u;
const uint ALPHA_BLEND = 0x2u;
const uint DRAW_DOUBLE_SIDED = 0x1u;
const uint DRAW_MIRRORED = 0x2u;
const uint NO_EMISSION = 0xffffffffu;
const uint LIGHT_ENVIRONMENT = 0x1u;
const uint LIGHT_SUN = 0x2u;
const uint LIGHT_PUNCTUAL = 0x4u;
const uint LIGHT_EMITTERS = 0x8u;
const uint FEATURE_SHADOWS = 0x1u;
const uint FEATURE_AO = 0x2u;
const uint FEATURE_CONTACT_SHADOWS = 0x4u;
const uint BRDF_TABLE_SIZE = 0x40u;
const float MIN_LIGHT_ROUGHNESS = 0.045;

// 56 bytes
struct Vertex {
    vec3 position;
    vec3 normal;
    vec2 uv0;
    vec4 tangent;
    vec2 uv1;
};

// 928 bytes
struct GlobalUniform {
    mat4 view;
    mat4 projection;
    mat4 view_projection;
    mat4 inv_view_projection;
    vec4 camera_position_and_exposure;
    vec2 screen_size;
    float time;
    uint directional_light_count;
    float ibl_intensity;
    uint irradiance_cubemap_index;
    uint prefiltered_cubemap_index;
    uint brdf_lut_index;
    uint prefiltered_mip_count;
    uint skybox_cubemap_index;
    float ibl_rotation_sin;
    float ibl_rotation_cos;
    uint debug_render_mode;
    uint feature_flags;
    uint shadow_cascade_count;
    float shadow_normal_offset;
    float shadow_texel_size;
    float shadow_max_distance;
    float shadow_blend_width;
    uint shadow_pcf_radius;
    mat4 cascade_view_proj[4];
    vec4 cascade_splits;
    float shadow_distance_fade_width;
    uint pad_628;
    uint pad_632;
    uint pad_636;
    vec4 cascade_texel_world_size;
    uint shadow_mode;
    uint pcss_flags;
    uint pcss_blocker_samples;
    uint pcss_pcf_samples;
    vec4 cascade_light_size_uv;
    vec4 cascade_pcss_scale;
    vec4 cascade_uv_scale_y;
    mat4 inv_projection;
    mat4 prev_view_projection;
    uint frame_index;
    uint ao_so_mode;
    uint pad_856;
    uint pad_860;
    mat4 inv_view;
};

// 32 bytes
struct DirectionalLight {
    vec4 direction_and_intensity;
    vec4 color_and_shadow;
};

// 80 bytes
struct Material {
    vec4 base_color_factor;
    vec4 emissive_factor;
    float metallic_factor;
    float roughness_factor;
    float normal_scale;
    float occlusion_strength;
    uint base_color_tex;
    uint emissive_tex;
    uint metallic_roughness_tex;
    uint normal_tex;
    uint occlusion_tex;
    float alpha_cutoff;
    uint alpha_mode;
    uint double_sided;
};

// 128 bytes
struct Instance {
    mat4 model;
    vec4 normal_matrix[3];
    uint material_index;
    uint pad_116;
    uint pad_120;
    uint pad_124;
};

// 24 bytes
struct GeometryInfo {
    uint64_t vertex_buffer_address;
    uint64_t index_buffer_address;
    uint material_buffer_offset;
    uint emissive_offset;
};

// 12 bytes
struct EnvAliasEntry {
    float prob;
    uint alias_index;
    float luminance;
};

// 16 bytes
struct EnvAliasHeader {
    float total_luminance;
    uint entry_count;
    uint width;
    uint height;
};

// 96 bytes
struct EmissiveTriangle {
    vec3 v0;
    uint pad_12;
    vec3 v1;
    uint pad_28;
    vec3 v2;
    uint pad_44;
    vec3 emission;
    float area;
    uint material_index;
    float power;
    vec2 uv0;
    vec2 uv1;
    vec2 uv2;
};

// 8 bytes
struct EmissiveAliasEntry {
    float prob;
    uint alias_index;
};

// 8 bytes
struct EmissiveAliasHeader {
    uint count;
    float total_power;
};

// 4 bytes
struct ShadowPush {
    uint cascade_index;
};

// 12 bytes
struct GtaoPush {
    float radius;
    float thin_compensation;
    uint noise_frame;
};

// 8 bytes
struct AoTemporalPush {
    float weight;
    uint valid;
};

// 12 bytes
struct ContactPush {
    float reach;
    float thickness;
    uint steps;
};

// 112 bytes
struct PathTracePush {
    uint64_t mesh_instances;
    vec3 sun_direction;
    float sun_sin2;
    vec3 sun_radiance;
    float max_clamp;
    vec3 center;
    float cone_spread;
    uint max_bounces;
    uint first_sample;
    uint sample_count;
    uint batch;
    uint sampled_lights;
    uint punctual_light_count;
    float occlusion_distance;
    uint seed;
    uint show_sky;
    uint directional_light_count;
    uint64_t vertices;
    uint emissive_count;
    uint merged_geometries;
};

// 32 bytes
struct DrawGroup {
    uint first_index;
    uint index_count;
    uint vertex_offset;
    uint first_instance;
    uint instance_count;
    uint primitive;
    uint alpha_mode;
    uint flags;
};

// 64 bytes
struct MeshInstance {
    vec4 transform[3];
    uint mesh;
    uint first_geometry;
    uint flags;
    uint first_emissive;
};

// 32 bytes
struct TextureTransform {
    vec4 matrix;
    vec2 offset;
    uint pad_24;
    uint pad_28;
};

// 8 bytes
struct VertexColor {
    uint red_green;
    uint blue_alpha;
};

// 64 bytes
struct PunctualLight {
    vec4 position_and_range;
    vec4 direction_and_spot_scale;
    vec4 color_and_shadow;
    float spot_offset;
    uint pad_52;
    uint pad_56;
    uint pad_60;
};

// 80 bytes
struct MaterialExtension {
    vec3 sheen_color;
    float sheen_roughness;
    vec3 specular_color;
    float specular_factor;
    float dielectric_f0;
    float clearcoat_factor;
    float clearcoat_roughness;
    float clearcoat_normal_scale;
    uint clearcoat_tex;
    uint clearcoat_roughness_tex;
    uint clearcoat_normal_tex;
    uint specular_tex;
    uint specular_color_tex;
    uint sheen_color_tex;
    uint sheen_roughness_tex;
    uint lobes;
};

// 4 bytes
struct AoSpatialPush {
    float intensity;
};

// 20 bytes
struct VisiblePush {
    uint draw_groups;
    uvec4 layer;
};

// Coordinates of the BRDF table (cairn-format's brdf_table.rs).
vec2 brdf_table_uv(float n_dot_v, float roughness) {
    float x = pow(clamp(n_dot_v, 0.0, 1.0), 1.0 / 3.0);
    float y = sqrt(clamp((roughness - MIN_LIGHT_ROUGHNESS) / (1.0 - MIN_LIGHT_ROUGHNESS), 0.0, 1.0));
    float size = float(BRDF_TABLE_SIZE);
    return (vec2(x, y) * (size - 1.0) + 0.5) / size;
}

#endif
