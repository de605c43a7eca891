// The sky's triangle on the far plane (0 in reverse-Z), with view rays.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "bindings.glsl"
#include "fullscreen.glsl"

layout(location = 0) out vec3 out_direction;

void main() {
    vec2 ndc = fullscreen_ndc(gl_VertexIndex);
    gl_Position = vec4(ndc, 0.0, 1.0);
    // Only the rotation of inv_view counts: world coordinates of any size cost no precision.
    vec3 ray = vec3(0.0, 0.0, -1.0);
    bool perspective = global.projection[3][3] == 0.0;
    if (perspective) {
        // The near plane's point scaled to depth 1; linear in ndc, so interpolation is exact.
        ray = vec3(ndc.x * global.inv_projection[0][0], ndc.y * global.inv_projection[1][1], -1.0);
    }
    out_direction = mat3(global.inv_view) * ray;
}
