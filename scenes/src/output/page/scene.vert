#version 300 es
// A corner of a triangle of an element.

uniform mat4 u_view;
// By how much elements grow in the picture, as shares of half its width and height: neighbours that are cut otherwise
// would show what is behind them.
uniform vec2 u_growth;

in vec3 a_position;
// What is shown there: a radiance, or one number in x.
in vec3 a_value;
// How far the corner is from each edge of the triangle, 0 or 1; 1 everywhere for edges within an element.
in vec3 a_edges;
in highp uint a_element;
// The middle of the element.
in vec3 a_middle;

out vec3 v_value;
out vec3 v_edges;
flat out highp uint v_element;

void main() {
  v_value = a_value;
  v_edges = a_edges;
  v_element = a_element;
  gl_Position = u_view * vec4(a_position, 1.0);
  vec4 middle = u_view * vec4(a_middle, 1.0);
  if (gl_Position.w > 0.0 && middle.w > 0.0) {
    vec2 outwards = gl_Position.xy / gl_Position.w - middle.xy / middle.w;
    gl_Position.xy += u_growth * sign(outwards) * gl_Position.w;
  }
}
