"use strict";
// The viewer of a glowtree export. Irradiance of each light by itself lies in a layer of a texture; the vertex shader adds
// the layers up, each times its light's strength, so that no frame does work per vertex on the processor.

const header = JSON.parse(document.getElementById("header").textContent);
const canvas = document.getElementById("canvas");
const hash = new URLSearchParams(location.hash.slice(1));
const gl = canvas.getContext("webgl2", { antialias: true, alpha: false });

// Bytes of a block of the page.
function block(name) {
  const text = atob(document.getElementById(name).textContent);
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  document.getElementById(name).remove();
  return bytes;
}

const VERTEX = `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2DArray;
in vec3 position;
in vec4 paint;   // albedo as sRGB; what the back shows: 0 nothing, 1 a mesh of its own, 2 the same
in vec2 extra;   // share of the sky; error over its largest
in uint emitter; // the light that the surface is, counted from 1
uniform mat4 camera;
uniform sampler2DArray lights;
uniform int count, view;
uniform vec3 weights[LIGHTS], glow[LIGHTS];
out vec3 colour;
flat out int back;

float linear(float value) {
  return value <= 0.04045 ? value / 12.92 : pow((value + 0.055) / 1.055, 2.4);
}

void main() {
  ivec2 at = ivec2(gl_VertexID % WIDTH, gl_VertexID / WIDTH);
  vec3 irradiance = vec3(0.0);
  for (int k = 0; k < count; k++) irradiance += texelFetch(lights, ivec3(at, k), 0).rgb * weights[k];
  vec3 albedo = vec3(linear(paint.r), linear(paint.g), linear(paint.b));
  colour = albedo * irradiance;
  if (emitter > 0u) colour += glow[emitter - 1u];
  if (view == 1) colour = 0.5 * irradiance;
  if (view == 2) colour = vec3(extra.x);
  if (view == 3) colour = vec3(extra.y);
  back = int(paint.a * 255.0 + 0.5);
  gl_Position = camera * vec4(position, 1.0);
}`;

const FRAGMENT = `#version 300 es
precision highp float;
precision highp int;
in vec3 colour;
flat in int back;
uniform int view;
uniform bool seeThrough;
uniform float exposure;
out vec4 shown;

vec3 srgb(vec3 value) {
  value = clamp(value, 0.0, 1.0);
  return mix(1.055 * pow(value, vec3(1.0 / 2.4)) - 0.055, 12.92 * value, lessThanEqual(value, vec3(0.0031308)));
}

// Dark blue, teal, yellow: light grows with the value.
vec3 scale(float value) {
  vec3 low = mix(vec3(0.15, 0.1, 0.35), vec3(0.1, 0.55, 0.55), clamp(2.0 * value, 0.0, 1.0));
  return mix(low, vec3(1.0, 0.9, 0.25), clamp(2.0 * value - 1.0, 0.0, 1.0));
}

void main() {
  if (!gl_FrontFacing && (back == 1 || (back == 0 && seeThrough))) discard;
  vec3 value = !gl_FrontFacing && back == 0 ? vec3(0.0) : colour;
  if (view <= 1) value *= exposure;
  shown = vec4(view == 3 ? scale(value.r) : srgb(value), 1.0);
}`;

const SITE_VERTEX = `#version 300 es
precision highp float;
in vec3 position;
in vec3 paint;
uniform mat4 camera;
out vec3 colour;
void main() {
  colour = paint;
  gl_Position = camera * vec4(position, 1.0);
  gl_PointSize = 2.5;
}`;

const SITE_FRAGMENT = `#version 300 es
precision highp float;
in vec3 colour;
out vec4 shown;
void main() { shown = vec4(colour, 1.0); }`;

const WIDTH = 2048;
const state = { weights: header.lights.map(() => [1, 1, 1]), stops: 0, view: 0, camera: null };

function program(vertex, fragment) {
  const made = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(made, shader);
  }
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made));
  return made;
}

// Puts an attribute's bytes into a buffer of the vertex array that is bound.
function attribute(of, name, bytes, size, type, normalised) {
  gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ARRAY_BUFFER, bytes, gl.STATIC_DRAW);
  const place = gl.getAttribLocation(of, name);
  if (place < 0) return;
  gl.enableVertexAttribArray(place);
  if (normalised === null) gl.vertexAttribIPointer(place, size, type, 0, 0);
  else gl.vertexAttribPointer(place, size, type, normalised, 0, 0);
}

function start() {
  const constants = (text) => text.replaceAll("LIGHTS", Math.max(1, header.lights.length)).replaceAll("WIDTH", WIDTH);
  const surface = program(constants(VERTEX), FRAGMENT);
  const mesh = gl.createVertexArray();
  gl.bindVertexArray(mesh);
  attribute(surface, "position", block("positions"), 3, gl.FLOAT, false);
  attribute(surface, "paint", block("paints"), 4, gl.UNSIGNED_BYTE, true);
  attribute(surface, "extra", block("extras"), 2, gl.UNSIGNED_BYTE, true);
  attribute(surface, "emitter", block("emitters"), 1, gl.UNSIGNED_BYTE, null);
  gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, block("corners"), gl.STATIC_DRAW);

  const rows = Math.max(1, Math.ceil(header.vertices / WIDTH));
  const layers = Math.max(1, header.lights.length);
  gl.bindTexture(gl.TEXTURE_2D_ARRAY, gl.createTexture());
  gl.texStorage3D(gl.TEXTURE_2D_ARRAY, 1, gl.RGB9_E5, WIDTH, rows, layers);
  gl.texParameteri(gl.TEXTURE_2D_ARRAY, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
  gl.texParameteri(gl.TEXTURE_2D_ARRAY, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
  header.lights.forEach((_, k) => {
    const texels = new Uint32Array(WIDTH * rows);
    texels.set(new Uint32Array(block("light" + k).buffer));
    gl.texSubImage3D(gl.TEXTURE_2D_ARRAY, 0, 0, 0, k, WIDTH, rows, 1, gl.RGB, gl.UNSIGNED_INT_5_9_9_9_REV, texels);
  });

  const points = program(SITE_VERTEX, SITE_FRAGMENT);
  const sites = gl.createVertexArray();
  gl.bindVertexArray(sites);
  attribute(points, "position", block("sites"), 3, gl.FLOAT, false);
  attribute(points, "paint", block("site-paints"), 3, gl.UNSIGNED_BYTE, true);
  gl.enable(gl.DEPTH_TEST);
  return { surface, mesh, points, sites };
}

const add = (a, b, s) => [a[0] + b[0] * s, a[1] + b[1] * s, a[2] + b[2] * s];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => { const l = Math.hypot(...a); return l > 0 ? a.map((v) => v / l) : a; };

// Axes of the camera: to the right, up, and back towards the eye.
function axes({ eye, target, up }) {
  const back = unit(add(eye, target, -1));
  let right = unit(cross(up, back));
  if (!(Math.hypot(...right) > 0.5)) right = unit(cross([back[1], back[2], back[0]], back));
  return [right, cross(back, right), back];
}

// Column by column: from local coordinates to what the screen shows.
function cameraMatrix(camera, aspect) {
  const [right, up, back] = axes(camera);
  const distance = Math.hypot(...add(camera.eye, camera.target, -1));
  const near = Math.max(1e-4, 0.01 * Math.min(distance, 1)), far = distance + 8;
  const high = 1 / Math.tan((camera.fov * Math.PI) / 360), wide = high / aspect;
  const deep = (far + near) / (near - far), shift = (2 * far * near) / (near - far);
  const place = (axis) => -dot(axis, camera.eye);
  const row = [[right, wide, place(right)], [up, high, place(up)]].map(([axis, s, t]) => [axis[0] * s, axis[1] * s, axis[2] * s, t * s]);
  row.push([back[0] * deep, back[1] * deep, back[2] * deep, place(back) * deep + shift]);
  row.push([-back[0], -back[1], -back[2], -place(back)]);
  return new Float32Array([0, 1, 2, 3].flatMap((c) => row.map((r) => r[c])));
}

const toShown = (value) => (value <= 0.0031308 ? 12.92 * value : 1.055 * Math.min(value, 1) ** (1 / 2.4) - 0.055);

// What is seen past the surfaces: the sky if it is the same everywhere.
function background() {
  if (!header.sky) return [0, 0, 0];
  const weight = state.weights[header.sky.light] ?? [0, 0, 0];
  return header.sky.radiance.map((value, c) => toShown(Math.PI * value * weight[c] * header.exposure * 2 ** state.stops));
}

let drawn = null, wanted = false;

function draw() {
  wanted = false;
  const ratio = hash.has("size") ? 1 : window.devicePixelRatio;
  const [wide, high] = [canvas.clientWidth * ratio, canvas.clientHeight * ratio].map((v) => Math.max(1, Math.round(v)));
  if (canvas.width !== wide || canvas.height !== high) Object.assign(canvas, { width: wide, height: high });
  gl.viewport(0, 0, wide, high);
  gl.clearColor(...background(), 1);
  gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  const matrix = cameraMatrix(state.camera, wide / high);
  const showsSites = state.view === 4;
  const { surface, mesh, points, sites } = drawn;
  const at = (name) => gl.getUniformLocation(surface, name);
  gl.useProgram(surface);
  gl.uniformMatrix4fv(at("camera"), false, matrix);
  gl.uniform1i(at("count"), header.lights.length);
  gl.uniform1i(at("view"), showsSites ? 0 : state.view);
  gl.uniform1i(at("seeThrough"), header.seeThrough ? 1 : 0);
  gl.uniform1f(at("exposure"), header.exposure * 2 ** state.stops * (showsSites ? 0.25 : 1));
  if (header.lights.length > 0) {
    const scaled = (of) => new Float32Array(header.lights.flatMap((light, k) => state.weights[k].map((w, c) => w * of(light)[c])));
    gl.uniform3fv(at("weights"), scaled((light) => [light.scale, light.scale, light.scale]));
    gl.uniform3fv(at("glow"), scaled((light) => light.exitance));
  }
  gl.bindVertexArray(mesh);
  gl.drawElements(gl.TRIANGLES, 3 * header.triangles, gl.UNSIGNED_INT, 0);
  if (showsSites) {
    gl.useProgram(points);
    gl.uniformMatrix4fv(gl.getUniformLocation(points, "camera"), false, matrix);
    gl.bindVertexArray(sites);
    gl.drawArrays(gl.POINTS, 0, header.sites);
  }
}

function redraw() {
  if (!wanted) requestAnimationFrame(draw);
  wanted = true;
}

// --- the hand ---

function turn(across, along) {
  const { eye, target } = state.camera, up = unit(header.up);
  const [right, , back] = axes(state.camera);
  const distance = Math.hypot(...add(eye, target, -1));
  const around = (v, axis, angle) => {
    const c = Math.cos(angle), s = Math.sin(angle), d = dot(axis, v) * (1 - c), x = cross(axis, v);
    return v.map((value, k) => value * c + x[k] * s + axis[k] * d);
  };
  let next = around(back, up, across);
  const tilted = around(next, around(right, up, across), along);
  if (Math.abs(dot(tilted, up)) < 0.995) next = tilted;
  Object.assign(state.camera, { eye: add(target, next, distance), up });
  redraw();
}

function move(across, along) {
  const [right, up] = axes(state.camera), { eye, target, fov } = state.camera;
  const step = (2 * Math.hypot(...add(eye, target, -1)) * Math.tan((fov * Math.PI) / 360)) / canvas.clientHeight;
  for (const name of ["eye", "target"]) state.camera[name] = add(add(state.camera[name], right, -across * step), up, along * step);
  redraw();
}

function approach(factor) {
  const { eye, target } = state.camera, away = add(eye, target, -1);
  state.camera.eye = add(target, away, Math.min(Math.max(factor, 1e-3 / Math.hypot(...away)), 40 / Math.hypot(...away)));
  redraw();
}

function listen() {
  const fingers = new Map();
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
  });
  for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, (event) => fingers.delete(event.pointerId));
  canvas.addEventListener("pointermove", (event) => {
    const before = fingers.get(event.pointerId);
    if (!before) return;
    const [across, along] = [event.clientX - before[0], event.clientY - before[1]];
    const spread = () => { const [a, b] = [...fingers.values()]; return Math.hypot(a[0] - b[0], a[1] - b[1]); };
    if (fingers.size === 2) {
      const wide = spread();
      fingers.set(event.pointerId, [event.clientX, event.clientY]);
      approach(wide / Math.max(1, spread()));
      move(across / 2, along / 2);
      return;
    }
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
    if (event.buttons & 6 || event.shiftKey) move(across, along);
    else turn(-across * 0.006, -along * 0.006);
  });
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => { event.preventDefault(); approach(Math.exp(event.deltaY * 0.0012)); }, { passive: false });
  window.addEventListener("resize", redraw);
  window.addEventListener("keydown", (event) => {
    const panel = document.getElementById("panel");
    if (event.key === "r" || event.key === "R") set({ camera: header.camera });
    else if (event.key === "h" || event.key === "H") panel.hidden = !panel.hidden;
    else if (event.key >= "1" && event.key <= "5") set({ view: Number(event.key) - 1 });
    else if (event.key === "ArrowLeft" || event.key === "ArrowRight") turn(event.key === "ArrowLeft" ? -0.06 : 0.06, 0);
  });
}

// --- the panel ---

const toLinear = (byte) => (byte <= 10.31475 ? byte / 3294.6 : ((byte / 255 + 0.055) / 1.055) ** 2.4);

function furnish() {
  document.getElementById("title").textContent = header.title;
  document.title = header.title;
  const list = document.getElementById("lights");
  header.lights.forEach((light, k) => {
    const row = document.createElement("label"), name = document.createElement("span");
    const strength = Object.assign(document.createElement("input"), { type: "range", min: 0, max: 4, step: 0.01, value: 1 });
    const tint = Object.assign(document.createElement("input"), { type: "color", value: "#ffffff", title: "tint" });
    Object.assign(name, { textContent: light.name, title: light.name });
    const change = () => {
      const bytes = [1, 3, 5].map((at) => parseInt(tint.value.slice(at, at + 2), 16));
      state.weights[k] = bytes.map((byte) => toLinear(byte) * Number(strength.value));
      redraw();
    };
    strength.addEventListener("input", change);
    tint.addEventListener("input", change);
    row.append(name, strength, tint);
    list.append(row);
  });
  const exposure = document.getElementById("exposure"), view = document.getElementById("view");
  exposure.addEventListener("input", () => { state.stops = Number(exposure.value); redraw(); });
  view.addEventListener("change", () => set({ view: Number(view.value) }));
  document.getElementById("figures").textContent =
    `${header.triangles.toLocaleString()} triangles shown, ${header.sites.toLocaleString()} sites; ${header.note}`;
}

// Changes what is shown: weights (a colour for each light), stops of exposure, view (0 to 4), camera {eye, target, up, fov}.
function set(change) {
  if (change.weights) state.weights = change.weights.map((weight) => [...weight]);
  if (change.stops !== undefined) document.getElementById("exposure").value = state.stops = change.stops;
  if (change.view !== undefined) document.getElementById("view").value = state.view = change.view;
  if (change.camera) state.camera = structuredClone(change.camera);
  redraw();
}

if (gl) {
  drawn = start();
  furnish();
  listen();
  // For pictures of one size: #size=256x192&w=1,1,1;0.5,0,0
  const size = (hash.get("size") ?? "").split("x").map(Number);
  if (size.length === 2) {
    Object.assign(canvas.style, { width: size[0] + "px", height: size[1] + "px" });
    document.getElementById("panel").hidden = true;
  }
  const weights = hash.get("w")?.split(";").map((colour) => colour.split(",").map(Number));
  set({ camera: header.camera, weights, view: Number(hash.get("view") ?? 0) });
  window.glowtree = { set, header };
} else {
  Object.assign(document.getElementById("problem"), { hidden: false, textContent: "This page needs WebGL 2, which this browser does not offer." });
}
