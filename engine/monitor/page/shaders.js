// @ts-check
/** Shader texts. One program draws everything solid or translucent, one the floor, one the shadow map. */

const HEAD = `#version 300 es
precision highp float;
`;

export const SOLID_VERTEX = `${HEAD}
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
// Centre and scale of an instance; (0, 0, 0, 1) where there are none.
layout(location = 2) in vec4 instance;
uniform mat4 model;
uniform mat4 viewProjection;
uniform mat4 lightFromWorld;
out vec3 worldNormal;
out vec3 world;
out vec4 inLight;
void main() {
  vec4 at = model * vec4(instance.xyz + position * instance.w, 1.0);
  world = at.xyz;
  worldNormal = mat3(model) * normal;
  inLight = lightFromWorld * vec4(world + 0.004 * normalize(worldNormal), 1.0);
  gl_Position = viewProjection * at;
}`;

const SHADOW_TERM = `
uniform highp sampler2DShadow shadowMap;
const vec2 DISC[12] = vec2[](
  vec2(-0.33, -0.41), vec2(0.40, -0.25), vec2(0.05, 0.47), vec2(-0.77, 0.12), vec2(0.79, 0.31), vec2(-0.22, -0.93),
  vec2(-0.55, 0.71), vec2(0.61, -0.74), vec2(0.35, 0.91), vec2(-0.92, -0.36), vec2(0.97, -0.14), vec2(0.02, -0.02));
float lit(vec4 inLight, float bias) {
  vec3 at = inLight.xyz / inLight.w * 0.5 + 0.5;
  if (any(lessThan(at, vec3(0.0))) || any(greaterThan(at, vec3(1.0)))) return 1.0;
  float angle = fract(52.9829189 * fract(dot(gl_FragCoord.xy, vec2(0.06711056, 0.00583715)))) * 6.2831853;
  mat2 turn = mat2(cos(angle), sin(angle), -sin(angle), cos(angle));
  float sum = 0.0;
  for (int i = 0; i < 12; i++) sum += texture(shadowMap, vec3(at.xy + turn * DISC[i] * 0.0026, at.z - bias));
  return sum / 12.0;
}`;

export const SOLID_FRAGMENT = `${HEAD}
in vec3 worldNormal;
in vec3 world;
in vec4 inLight;
uniform vec4 colour;
uniform vec3 eye;
uniform vec3 sun;
uniform vec3 sky;
uniform vec3 ground;
uniform float glow;
uniform float gloss;
out vec4 result;
${SHADOW_TERM}
void main() {
  vec3 n = normalize(worldNormal);
  vec3 toEye = normalize(eye - world);
  if (dot(n, toEye) < 0.0) n = -n;
  vec3 base = pow(colour.rgb, vec3(2.2));
  float facing = max(dot(n, sun), 0.0);
  float light = facing > 0.0 ? facing * lit(inLight, 0.0012) : 0.0;
  // Light from all sides: bluish from above, warm from the floor; corners near the floor get less.
  vec3 around = mix(ground, sky, 0.5 + 0.5 * n.z);
  float fill = 0.16 * max(dot(n, normalize(vec3(0.5, -0.8, 0.35))), 0.0);
  vec3 halfway = normalize(sun + toEye);
  float shine = gloss * pow(max(dot(n, halfway), 0.0), 48.0) * light;
  float rim = 0.10 * gloss * pow(1.0 - max(dot(n, toEye), 0.0), 3.0);
  vec3 shade = base * (around + fill + 1.15 * light) + vec3(shine * 0.5 + rim) + base * glow;
  shade = shade * 1.06 / (1.0 + 0.16 * shade);
  result = vec4(pow(shade, vec3(1.0 / 2.2)), colour.a);
}`;

export const SHADOW_VERTEX = `${HEAD}
layout(location = 0) in vec3 position;
layout(location = 2) in vec4 instance;
uniform mat4 model;
uniform mat4 lightFromWorld;
void main() {
  gl_Position = lightFromWorld * model * vec4(instance.xyz + position * instance.w, 1.0);
}`;

export const SHADOW_FRAGMENT = `${HEAD}
void main() {}`;

export const FLOOR_VERTEX = `${HEAD}
layout(location = 0) in vec3 position;
uniform mat4 viewProjection;
uniform mat4 lightFromWorld;
out vec3 world;
out vec4 inLight;
void main() {
  world = position;
  inLight = lightFromWorld * vec4(position, 1.0);
  gl_Position = viewProjection * vec4(position, 1.0);
}`;

/** The floor: lines every half metre, fading into the background, with the shadows on it. */
export const FLOOR_FRAGMENT = `${HEAD}
in vec3 world;
in vec4 inLight;
uniform vec3 background;
uniform vec3 line;
uniform float shade;
uniform vec3 eye;
out vec4 result;
${SHADOW_TERM}
float grid(vec2 at, float every) {
  vec2 cell = at / every;
  vec2 near = abs(fract(cell - 0.5) - 0.5) / max(fwidth(cell), vec2(1e-5));
  return 1.0 - min(min(near.x, near.y), 1.0);
}
void main() {
  float away = length(world.xy - vec2(0.4, 0.0));
  float fade = 1.0 - smoothstep(1.5, 4.2, away);
  float below = eye.z < 0.0 ? 0.25 : 1.0;
  float lines = 0.55 * grid(world.xy, 0.5) + 0.2 * grid(world.xy, 0.1) * (1.0 - smoothstep(0.8, 2.0, away));
  float dark = (1.0 - lit(inLight, 0.002)) * shade;
  vec3 colour = mix(line, vec3(0.0), dark / max(dark + lines, 1e-4));
  result = vec4(colour, max(lines * fade, dark * fade) * below);
}`;
