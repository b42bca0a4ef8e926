#version 300 es
// The colour of a point of an element: of its light, by an exposure, or of its number, on a scale.

precision highp float;
precision highp int;

uniform bool u_is_light;
uniform float u_exposure;
// The exposed radiance that is mapped to full white.
uniform float u_burn;
uniform vec2 u_range;
uniform sampler2D u_palette;
uniform bool u_lines;
// The element to point out, or one beyond all.
uniform uint u_picked;

in vec3 v_value;
in vec3 v_edges;
flat in highp uint v_element;

out vec4 o_colour;

// The transfer curve of sRGB (IEC 61966-2-1).
vec3 srgb(vec3 linear) {
  vec3 curve = 1.055 * pow(linear, vec3(1.0 / 2.4)) - 0.055;
  return mix(curve, 12.92 * linear, lessThanEqual(linear, vec3(0.0031308)));
}

// Reinhard's curve x (1 + x/w^2)/(1 + x) of every band, as the pictures of the program have it.
vec3 light(vec3 radiance) {
  vec3 x = u_exposure * max(radiance, 0.0);
  return srgb(clamp(x * (1.0 + x / (u_burn * u_burn)) / (1.0 + x), 0.0, 1.0));
}

vec3 number(float value) {
  float width = u_range.y - u_range.x;
  float t = width > 0.0 ? clamp((value - u_range.x) / width, 0.0, 1.0) : 0.5;
  // From the middle of the first colour to that of the last one.
  float size = float(textureSize(u_palette, 0).x);
  return texture(u_palette, vec2((t * (size - 1.0) + 0.5) / size, 0.5)).rgb;
}

void main() {
  vec3 colour = u_is_light ? light(v_value) : number(v_value.x);
  // How far the nearest edge is, in pixels.
  vec3 pixels = v_edges / max(fwidth(v_edges), 1e-9);
  float near = min(pixels.x, min(pixels.y, pixels.z));
  float brightness = dot(colour, vec3(0.2126, 0.7152, 0.0722));
  if (u_lines) {
    vec3 ink = brightness > 0.4 ? vec3(0.0) : vec3(1.0);
    colour = mix(colour, ink, 0.4 * (1.0 - smoothstep(0.2, 0.9, near)));
  }
  if (v_element == u_picked) {
    colour = mix(colour, vec3(1.0, 0.62, 0.1), 0.22);
    colour = mix(colour, vec3(1.0, 0.55, 0.0), 1.0 - smoothstep(1.2, 2.2, near));
  }
  o_colour = vec4(colour, 1.0);
}
