// The panel: premultiplied sRGB colours, into a target that encodes.
#version 460
#extension GL_GOOGLE_include_directive : require

layout(set = 3, binding = 4) uniform sampler2D atlas;

layout(location = 0) in vec2 uv;
layout(location = 1) in vec4 color;
layout(location = 0) out vec4 out_color;

// IEC 61966-2-1.
vec3 decode(vec3 encoded) {
    vec3 curved = pow((encoded + 0.055) / 1.055, vec3(2.4));
    return mix(curved, encoded / 12.92, lessThanEqual(encoded, vec3(0.04045)));
}

void main() {
    vec4 shown = color * texture(atlas, uv);
    // Premultiplied in encoded values: decode the colour itself, then multiply again.
    vec3 encoded = shown.a > 0.0 ? min(shown.rgb / shown.a, 1.0) : shown.rgb;
    out_color = vec4(decode(encoded) * max(shown.a, step(shown.a, 0.0)), shown.a);
}
