"use strict";
/* The shaders. Colours are linear until the last pass; light is radiance, W/m²/sr. */

/** Names of views by number, as the shaders and the menu have them. */
const VIEW = { light: 0, white: 1, ambient: 2, error: 3, sites: 4, albedo: 5, depth: 6 };

/** Viridis (Smith and van der Walt 2015) at quarters, sRGB: dark is little, bright is much. */
const SCALE = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];

const SCALE_GLSL = `
const vec3 scale[5] = vec3[5](${SCALE.map((c) => `vec3(${c.map((x) => (x / 255).toFixed(4))})`)});
vec3 linear(vec3 s) { return mix(s / 12.92, pow((s + 0.055) / 1.055, vec3(2.4)), step(0.04045, s)); }
vec3 scaled(float x) {
  float at = 4.0 * clamp(x, 0.0, 1.0);
  int k = min(int(at), 3);
  return linear(mix(scale[k], scale[k + 1], at - float(k)));
}`;

/* Adds the lights up at a vertex: layer 0 of \`fields\` is albedo, layer 1 + k the irradiance of light k. Waves may swing below 0. */
const SURFACE_VERTEX = `#version 300 es
precision highp float;
precision highp sampler2DArray;
layout(location = 0) in vec3 position;
layout(location = 1) in vec2 measures;
layout(location = 2) in uint emitter;
uniform mat4 clip;
uniform vec2 shift;
uniform int lights;
uniform sampler2DArray fields;
uniform sampler2D weights;
uniform sampler2D emitters;
out vec3 albedo, irradiance;
out vec2 ambientError;
flat out vec3 emitted;
void main() {
  ivec2 at = ivec2(gl_VertexID & 2047, gl_VertexID >> 11);
  albedo = texelFetch(fields, ivec3(at, 0), 0).rgb;
  irradiance = vec3(0);
  for (int k = 0; k < lights; k++)
    irradiance += texelFetch(weights, ivec2(k, 0), 0).rgb * texelFetch(fields, ivec3(at, k + 1), 0).rgb;
  irradiance = max(irradiance, vec3(0));
  emitted = emitter == 0u ? vec3(0) : texelFetch(emitters, ivec2(int(emitter) - 1, 0), 0).rgb;
  ambientError = measures;
  gl_Position = clip * vec4(position, 1);
  gl_Position.xy += shift * gl_Position.w;
}`;

const SURFACE_FRAGMENT = `#version 300 es
precision highp float;
in vec3 albedo, irradiance;
in vec2 ambientError;
flat in vec3 emitted;
uniform int view;
uniform float exposure, errorTop;
out vec4 colour;
${SCALE_GLSL}
void main() {
  const float over_pi = 0.3183098861837907;
  vec3 shown;
  if (view == ${VIEW.ambient}) shown = vec3(ambientError.x);
  else if (view == ${VIEW.error}) shown = scaled(ambientError.y / errorTop);
  else if (view == ${VIEW.albedo}) shown = albedo;
  else if (view == ${VIEW.white}) shown = exposure * (emitted + irradiance * over_pi);
  else shown = exposure * (emitted + albedo * irradiance * over_pi);
  if (view == ${VIEW.depth}) shown = vec3(1.0 / gl_FragCoord.w);
  if (view == ${VIEW.sites}) shown = 0.25 * min(shown, vec3(1));
  colour = vec4(gl_FrontFacing || view == ${VIEW.depth} ? min(shown, vec3(60000)) : vec3(0), 1);
}`;

/* One triangle over the whole picture. */
const COVER_VERTEX = `#version 300 es
out vec2 place;
void main() {
  place = vec2(gl_VertexID == 1 ? 3 : -1, gl_VertexID == 2 ? 3 : -1);
  gl_Position = vec4(place, 1, 1);
}`;

/* The sky behind, by direction. */
const SKY_FRAGMENT = `#version 300 es
precision highp float;
in vec2 place;
uniform vec3 ahead, right, above, weight;
uniform vec2 shift;
uniform sampler2D sky;
out vec4 colour;
void main() {
  vec2 p = place - shift;
  vec3 d = normalize(ahead + p.x * right + p.y * above);
  float turn = atan(d.z, d.x) / 6.283185307179586;
  vec2 size = vec2(textureSize(sky, 0));
  vec2 at = vec2(fract(turn), acos(clamp(d.y, -1.0, 1.0)) / 3.141592653589793) * size;
  colour = vec4(min(weight * texelFetch(sky, ivec2(min(at, size - 1.0)), 0).rgb, vec3(60000)), 1);
}`;

const DOT_VERTEX = `#version 300 es
precision highp float;
layout(location = 0) in vec3 position;
layout(location = 1) in float level;
layout(location = 2) in float spacing;
uniform mat4 clip;
uniform vec2 shift;
uniform float pixels, levels;
flat out vec3 shade;
${SCALE_GLSL}
void main() {
  gl_Position = clip * vec4(position, 1);
  gl_PointSize = clamp(0.45 * spacing * pixels / gl_Position.w, 1.5, 24.0);
  gl_Position.xy += shift * gl_Position.w;
  shade = scaled(1.0 - level / max(levels - 1.0, 1.0));
}`;

const DOT_FRAGMENT = `#version 300 es
precision highp float;
flat in vec3 shade;
out vec4 colour;
void main() {
  if (length(gl_PointCoord - 0.5) > 0.5) discard;
  colour = vec4(shade, 1);
}`;

/* Adds a frame to the sum of those before it. */
const SUM_FRAGMENT = `#version 300 es
precision highp float;
uniform sampler2D frame, before;
uniform float keep;
out vec4 colour;
void main() {
  ivec2 at = ivec2(gl_FragCoord.xy);
  colour = texelFetch(frame, at, 0);
  if (keep > 0.0) colour += texelFetch(before, at, 0);
}`;

/* From linear to the display: IEC 61966-2-1. */
const SHOW_FRAGMENT = `#version 300 es
precision highp float;
uniform sampler2D frame;
uniform float over;
out vec4 colour;
void main() {
  vec3 c = clamp(texelFetch(frame, ivec2(gl_FragCoord.xy), 0).rgb * over, 0.0, 1.0);
  colour = vec4(mix(12.92 * c, 1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, c)), 1);
}`;
