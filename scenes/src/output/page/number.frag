#version 300 es
// The number of an element, from 1 on, as four bytes.

precision highp float;
precision highp int;

flat in highp uint v_element;

out vec4 o_colour;

void main() {
  uint k = v_element + 1u;
  uvec4 bytes = uvec4(k, k >> 8u, k >> 16u, k >> 24u) & 255u;
  o_colour = vec4(bytes) / 255.0;
}
