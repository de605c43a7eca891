// Covers the target; the fragment shader reads texels by gl_FragCoord.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "fullscreen.glsl"

void main() {
    gl_Position = vec4(fullscreen_ndc(gl_VertexIndex), 0.0, 1.0);
}
