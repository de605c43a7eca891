// A triangle that covers the viewport.
#ifndef CAIRN_FULLSCREEN_GLSL
#define CAIRN_FULLSCREEN_GLSL

vec2 fullscreen_ndc(int vertex) {
    return vec2((vertex << 1) & 2, vertex & 2) * 2.0 - 1.0;
}

#endif
