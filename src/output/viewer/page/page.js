/* The viewer: data to the graphics card once, then a handful of numbers a frame. No frame touches a vertex here. */

/** What `#` in the address may hold, and `window.glowtree.set` takes; see there. */
const asked = Object.fromEntries(new URLSearchParams(location.hash.slice(1)));
const part = (id) => document.getElementById(id);
const header = JSON.parse(part("header").textContent);
const canvas = part("canvas");

/** The bytes of a block of the page; the text is let go. */
function block(id) {
  const text = part(id).textContent;
  part(id).remove();
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
  return Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
}

/* ---- vectors ---- */

const add = (a, b, k = 1) => a.map((x, i) => x + k * b[i]);
const times = (a, k) => a.map((x) => k * x);
const dot = (a, b) => a.reduce((sum, x, i) => sum + x * b[i], 0);
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const size = (a) => Math.sqrt(dot(a, a));
const unit = (a) => times(a, 1 / (size(a) || 1));
/** `a` turned about a unit `axis`. */
function turned(a, axis, angle) {
  const [s, c] = [Math.sin(angle), Math.cos(angle)];
  return add(add(times(a, c), cross(axis, a), s), axis, (1 - c) * dot(axis, a));
}
const toLinear = (s) => (s <= 0.04045 ? s / 12.92 : ((s + 0.055) / 1.055) ** 2.4);

/* ---- state ---- */

const SUBFRAMES = 16; // 4 × 4 places in a pixel, as the program's own pictures have
const start = () => ({
  camera: structuredClone(header.camera),
  weights: header.lights.map(() => [1, 1, 1]),
  turn: 0, // of the sky, degrees counter-clockwise from above
  exposure: header.exposure,
  view: VIEW.light,
});
let state = start();
const fixed = asked.width && asked.height ? [Number(asked.width), Number(asked.height)] : null;

/** The camera's axes, as the program's pinhole has them: `right` and `above` reach the picture's edges. */
function axes(aspect) {
  const { eye, target, up, fov } = state.camera;
  const ahead = unit(add(target, eye, -1));
  let side = cross(ahead, up);
  side = size(side) < 1e-6 ? unit(cross(ahead, Math.abs(ahead[0]) < 0.5 ? [1, 0, 0] : [0, 1, 0])) : unit(side);
  const half = Math.tan((fov * Math.PI) / 360);
  return { eye, ahead, side, top: cross(side, ahead), right: half * aspect, above: half };
}

/** From local coordinates to clip space, column by column. */
function clipMatrix({ eye, ahead, side, top, right, above }) {
  const far = (size(add(eye, header.centre, -1)) + header.radius) * 1.01;
  const nearest = size(add(eye, header.centre, -1)) - header.radius;
  const near = Math.max(nearest * 0.99, far * 2e-4);
  const depth = [(far + near) / (far - near), (-2 * far * near) / (far - near)];
  const rows = [times(side, 1 / right), times(top, 1 / above), times(ahead, depth[0]), ahead];
  const last = rows.map((row, i) => -dot(row, eye) + (i === 2 ? depth[1] : 0));
  return new Float32Array([0, 1, 2].flatMap((column) => rows.map((row) => row[column])).concat(last));
}

/* ---- the graphics card ---- */

const gl = canvas.getContext("webgl2", { antialias: false, alpha: false, depth: false, preserveDrawingBuffer: true });
if (!gl || !(gl.getExtension("EXT_color_buffer_float"))) {
  part("problem").hidden = false;
  part("problem").textContent = "This page needs WebGL 2 with float targets, which this browser does not offer.";
  throw new Error("no WebGL 2");
}

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
  const uniforms = {};
  for (let i = 0; i < gl.getProgramParameter(made, gl.ACTIVE_UNIFORMS); i++) {
    const { name } = gl.getActiveUniform(made, i);
    uniforms[name] = gl.getUniformLocation(made, name);
  }
  return { made, uniforms };
}

function texture(target = gl.TEXTURE_2D) {
  const made = gl.createTexture();
  gl.bindTexture(target, made);
  for (const which of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(target, which, gl.NEAREST);
  for (const which of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(target, which, gl.CLAMP_TO_EDGE);
  return made;
}

const surface = program(SURFACE_VERTEX, SURFACE_FRAGMENT);
const backdrop = program(COVER_VERTEX, SKY_FRAGMENT);
const points = program(DOT_VERTEX, DOT_FRAGMENT);
const summing = program(COVER_VERTEX, SUM_FRAGMENT);
const showing = program(COVER_VERTEX, SHOW_FRAGMENT);

/** Vertex arrays: `layout` has [location, count, type, offset] each; unsigned integers stay integers. */
function arrays(bytes, stride, layout, indices) {
  const made = gl.createVertexArray();
  gl.bindVertexArray(made);
  gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ARRAY_BUFFER, bytes, gl.STATIC_DRAW);
  for (const [at, count, type, offset] of layout) {
    gl.enableVertexAttribArray(at);
    if (type === gl.UNSIGNED_INT) gl.vertexAttribIPointer(at, count, type, stride, offset);
    else gl.vertexAttribPointer(at, count, type, false, stride, offset);
  }
  if (indices) {
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, indices, gl.STATIC_DRAW);
  }
  return made;
}

const surfaceArrays = arrays(block("vertices"), 20,
  [[0, 3, gl.FLOAT, 0], [1, 2, gl.HALF_FLOAT, 12], [2, 1, gl.UNSIGNED_INT, 16]], block("indices"));
const dotBytes = block("dots");
const dotArrays = arrays(dotBytes, 20, [[0, 3, gl.FLOAT, 0], [1, 1, gl.FLOAT, 12], [2, 1, gl.FLOAT, 16]]);
const emptyArrays = gl.createVertexArray();

/** Albedo, the lights and the sky turned, a layer each, rows of 2,048 vertices. */
const fields = texture(gl.TEXTURE_2D_ARRAY);
const rows = Math.max(Math.ceil(header.count / 2048), 1);
const layers = 1 + header.lights.length + header.sky.turned.length;
gl.texStorage3D(gl.TEXTURE_2D_ARRAY, 1, gl.RGB9_E5, 2048, rows, layers);
/** Puts a word for each vertex into a layer. */
function putLayer(layer, words) {
  const filled = new Uint32Array(2048 * rows);
  filled.set(words);
  gl.bindTexture(gl.TEXTURE_2D_ARRAY, fields);
  gl.texSubImage3D(gl.TEXTURE_2D_ARRAY, 0, 0, 0, layer, 2048, rows, 1, gl.RGB, gl.UNSIGNED_INT_5_9_9_9_REV, filled);
}
{
  const words = new Uint32Array(block("fields").buffer);
  for (let layer = 0; layer < layers; layer++)
    putLayer(layer, words.subarray(layer * header.count, (layer + 1) * header.count));
}
const sky = texture();
gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB9_E5, ...header.sky.size, 0, gl.RGB, gl.UNSIGNED_INT_5_9_9_9_REV,
  new Uint32Array(block("sky").buffer));
const weights = texture();
const emitters = texture();

/** Puts a short list of colours into a texture of one row. */
function table(into, colours) {
  const row = new Float32Array(4 * Math.max(colours.length, 1));
  colours.forEach((colour, k) => row.set(colour, 4 * k));
  gl.bindTexture(gl.TEXTURE_2D, into);
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, row.length / 4, 1, 0, gl.RGBA, gl.FLOAT, row);
}

/** Pictures in the making, of the canvas' size: one frame, the sum of several, and one smoothed while things move. */
let targets = null;
function targetsOf(width, height) {
  if (targets && targets.width === width && targets.height === height) return targets;
  for (const old of targets ? targets.all : []) old();
  const all = [];
  const image = (format) => {
    const made = texture();
    gl.texStorage2D(gl.TEXTURE_2D, 1, format, width, height);
    const frame = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, made, 0);
    all.push(() => (gl.deleteTexture(made), gl.deleteFramebuffer(frame)));
    return { texture: made, frame };
  };
  const buffer = (attachment, samples, format) => {
    const made = gl.createRenderbuffer();
    gl.bindRenderbuffer(gl.RENDERBUFFER, made);
    gl.renderbufferStorageMultisample(gl.RENDERBUFFER, samples, format, width, height);
    gl.framebufferRenderbuffer(gl.FRAMEBUFFER, attachment, gl.RENDERBUFFER, made);
    all.push(() => gl.deleteRenderbuffer(made));
  };
  const frame = image(gl.RGBA16F);
  buffer(gl.DEPTH_ATTACHMENT, 0, gl.DEPTH_COMPONENT24);
  const sums = [image(gl.RGBA32F), image(gl.RGBA32F)];
  const smooth = gl.createFramebuffer();
  gl.bindFramebuffer(gl.FRAMEBUFFER, smooth);
  buffer(gl.COLOR_ATTACHMENT0, 4, gl.RGBA16F);
  buffer(gl.DEPTH_ATTACHMENT, 4, gl.DEPTH_COMPONENT24);
  all.push(() => gl.deleteFramebuffer(smooth));
  return (targets = { width, height, all, frame, sums, smooth });
}

/* ---- a frame ---- */

function use({ made, uniforms }, textures) {
  gl.useProgram(made);
  Object.entries(textures).forEach(([name, [target, which]], slot) => {
    gl.activeTexture(gl.TEXTURE0 + slot);
    gl.bindTexture(target, which);
    gl.uniform1i(uniforms[name], slot);
  });
  return uniforms;
}

/** Draws sky, surfaces and sites into `frame`, moved by `shift` in clip units. */
function drawScene(frame, shift, view) {
  const { width, height } = targets;
  const seen = axes(width / height);
  const clip = clipMatrix(seen);
  gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
  gl.viewport(0, 0, width, height);
  gl.clearColor(0, 0, 0, 1);
  gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  if (view !== VIEW.depth && header.sky.light !== null) {
    const u = use(backdrop, { sky: [gl.TEXTURE_2D, sky] });
    const dim = view === VIEW.light || view === VIEW.white ? state.exposure : 0;
    const weight = state.weights[header.sky.light].map((w, c) => w * header.sky.scale[c] * dim);
    const back = (direction) => turned(direction, unit(header.sky.up), (-state.turn * Math.PI) / 180);
    gl.uniform3fv(u.ahead, back(seen.ahead));
    gl.uniform3fv(u.right, times(back(seen.side), seen.right));
    gl.uniform3fv(u.above, times(back(seen.top), seen.above));
    gl.uniform3fv(u.weight, weight);
    gl.uniform2fv(u.shift, shift);
    gl.bindVertexArray(emptyArrays);
    gl.disable(gl.DEPTH_TEST);
    gl.disable(gl.CULL_FACE);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }
  gl.enable(gl.DEPTH_TEST);
  const u = use(surface, { fields: [gl.TEXTURE_2D_ARRAY, fields], weights: [gl.TEXTURE_2D, weights],
    emitters: [gl.TEXTURE_2D, emitters] });
  gl.uniformMatrix4fv(u.clip, false, clip);
  gl.uniform2fv(u.shift, shift);
  gl.uniform1i(u.lights, layers - 1);
  gl.uniform1i(u.view, view);
  gl.uniform1f(u.exposure, state.exposure);
  gl.uniform1f(u.errorTop, header.error_top);
  gl.bindVertexArray(surfaceArrays);
  (header.see_through ? gl.enable : gl.disable).call(gl, gl.CULL_FACE);
  gl.drawElements(gl.TRIANGLES, header.one_sided, gl.UNSIGNED_INT, 0);
  gl.enable(gl.CULL_FACE);
  gl.drawElements(gl.TRIANGLES, header.two_sided, gl.UNSIGNED_INT, 4 * header.one_sided);
  if (view === VIEW.sites) {
    const u = use(points, {});
    gl.uniformMatrix4fv(u.clip, false, clip);
    gl.uniform2fv(u.shift, shift);
    gl.uniform1f(u.pixels, height / seen.above / 2);
    gl.uniform1f(u.levels, header.levels);
    gl.bindVertexArray(dotArrays);
    gl.drawArrays(gl.POINTS, 0, dotBytes.length / 20);
  }
}

/** Covers `frame` with what a program makes of textures. */
function cover(which, frame, textures, name, value) {
  gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
  gl.disable(gl.DEPTH_TEST);
  gl.disable(gl.CULL_FACE);
  const u = use(which, textures);
  gl.uniform1f(u[name], value);
  gl.bindVertexArray(emptyArrays);
  gl.drawArrays(gl.TRIANGLES, 0, 3);
}

/** A tent over two pixels, as the program's filter: [0, 1) to (−1, 1). */
const tent = (u) => (u < 0.5 ? Math.sqrt(2 * u) - 1 : 1 - Math.sqrt(2 - 2 * u));

let summed = -1; // subframes in the sum; −1 before the quick frame
let waiting = false;

/** Draws the next subframe; the quick one first while something moves. */
function step() {
  const { frame, sums, smooth, width, height } = targets;
  if (summed < 0) {
    drawScene(smooth, [0, 0], state.view);
    gl.bindFramebuffer(gl.READ_FRAMEBUFFER, smooth);
    gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, frame.frame);
    gl.blitFramebuffer(0, 0, width, height, 0, 0, width, height, gl.COLOR_BUFFER_BIT, gl.NEAREST);
    cover(showing, null, { frame: [gl.TEXTURE_2D, frame.texture] }, "over", 1);
  } else {
    const [i, j] = [summed % 4, Math.floor(summed / 4)];
    // Sixteen rows and columns of a pixel, one place in each: edges along the axes are as smooth as others.
    const [x, y] = [(i + (j + 0.5) / 4) / 4, (j + (i + 0.5) / 4) / 4].map(tent);
    drawScene(frame.frame, [(2 * x) / width, (2 * y) / height], state.view);
    const [into, before] = [sums[summed % 2], sums[(summed + 1) % 2]];
    cover(summing, into.frame,
      { frame: [gl.TEXTURE_2D, frame.texture], before: [gl.TEXTURE_2D, before.texture] }, "keep", summed);
    if (summed === SUBFRAMES - 1) {
      cover(showing, null, { frame: [gl.TEXTURE_2D, into.texture] }, "over", 1 / SUBFRAMES);
    }
  }
  summed += 1;
}

/**
 * What each layer but the albedo counts. The light of the sky is known at an odd number of places of its turn, and between them is
 * the one sum of waves that goes through all of them (the kernel of Dirichlet).
 */
function layerWeights() {
  const { light, turned } = header.sky;
  const parts = turned.length + 1;
  const share = (part) => {
    const x = ((state.turn / 360 - part / parts) * 2 * Math.PI) / 2;
    return Math.abs(Math.sin(x)) < 1e-9 ? 1 : Math.sin(parts * x) / (parts * Math.sin(x));
  };
  const own = state.weights.map((w, k) => times(w, header.lights[k].scale * (k === light && parts > 1 ? share(0) : 1)));
  return own.concat(turned.map((scale, k) => times(state.weights[light], scale * share(k + 1))));
}

function frame() {
  waiting = false;
  const scale = window.devicePixelRatio || 1;
  const [width, height] = fixed ||
    [Math.max(Math.round(canvas.clientWidth * scale), 1), Math.max(Math.round(canvas.clientHeight * scale), 1)];
  if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
  targetsOf(width, height);
  table(weights, layerWeights());
  table(emitters, header.emitters.map(({ light, radiance }) => radiance.map((r, c) => r * state.weights[light][c])));
  do step(); while (fixed && summed < SUBFRAMES);
  if (summed < SUBFRAMES) later();
}
function later() {
  if (!waiting) requestAnimationFrame(frame);
  waiting = true;
}
/** Something changed: draw anew. */
function renew() {
  summed = -1;
  later();
}

/* ---- the tests' and scripts' way in ---- */

window.glowtree = {
  /** Sets any of `camera` {eye, target, up, fov}, `weights` [[r, g, b] of each light], `turn` of an image sky in degrees, `exposure`,
   * `view` (a number). */
  set(change) {
    Object.assign(state, change, { camera: { ...state.camera, ...change.camera } });
    showState();
    renew();
  },
  state: () => structuredClone(state),
};
