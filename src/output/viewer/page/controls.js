/* The panel, pointers and keys. */

const stops = () => Math.log2(state.exposure / header.exposure);
const sliders = header.lights.map((light, k) => {
  const box = document.createElement("div");
  box.className = "light";
  const make = (tag, properties) => box.appendChild(Object.assign(document.createElement(tag), properties));
  make("span", { className: "name", textContent: light.name, title: light.name });
  const number = make("output", {});
  const colour = make("input", { type: "color", value: "#ffffff", title: "Colour" });
  const range = make("input", { type: "range", min: 0, max: 3, step: 0.01, value: 1 });
  colour.setAttribute("aria-label", `colour of ${light.name}`);
  range.setAttribute("aria-label", `strength of ${light.name}`);
  const changed = () => {
    const rgb = [1, 3, 5].map((at) => toLinear(parseInt(colour.value.slice(at, at + 2), 16) / 255));
    state.weights[k] = times(rgb, Number(range.value));
    number.textContent = Number(range.value).toFixed(2);
    renew();
  };
  colour.oninput = range.oninput = changed;
  range.ondblclick = () => ((range.value = 1), (colour.value = "#ffffff"), changed());
  part("lights").append(box);
  return { number, colour, range };
});

/** The turn of the sky: of an image whose turned light the page holds, or the program that serves it solves for. */
const turn = header.sky.turned.length > 0 || (header.live && header.live.rotate !== null) ? part("turn") : null;
if (turn) part("turning").hidden = false;
part("turn").oninput = (event) => glowtree.set({ turn: Number(event.target.value) });

/** Puts the state into the panel. */
function showState() {
  part("turn").value = state.turn;
  part("degrees").textContent = `${Math.round(state.turn)}°`;
  part("exposure").value = stops();
  part("stops").textContent = `${stops() < 0 ? "−" : "+"}${Math.abs(stops()).toFixed(2)} EV`;
  part("view").value = state.view;
  const toByte = (l) => Math.round(255 * (l <= 0.0031308 ? 12.92 * l : 1.055 * l ** (1 / 2.4) - 0.055));
  sliders.forEach(({ number, colour, range }, k) => {
    const most = Math.max(...state.weights[k]);
    range.value = most;
    number.textContent = most.toFixed(2);
    const hex = state.weights[k].map((w) => toByte(most > 0 ? w / most : 1).toString(16).padStart(2, "0"));
    colour.value = `#${hex.join("")}`;
  });
  showLegend();
}

/** What the colours mean, in views whose colours are no light. */
function showLegend() {
  const percent = (x) => `${Number((100 * x).toPrecision(2))} %`;
  const viridis = SCALE.map((c) => `rgb(${c})`);
  const [ends, colours] = {
    [VIEW.error]: [["0", percent(header.error_top / 2), `≥ ${percent(header.error_top)} of the mean`], viridis],
    [VIEW.sites]: [["fine", "", "coarse"], viridis],
    [VIEW.ambient]: [["no sky", "", "all of it"], ["#000", "#bcbcbc", "#fff"]],
  }[state.view] || [null, null];
  part("legend").hidden = !ends;
  if (!ends) return;
  part("bar").style.background = `linear-gradient(90deg, ${colours})`;
  ends.forEach((text, k) => (part("ends").children[k].textContent = text));
}

part("exposure").oninput = (event) => glowtree.set({ exposure: header.exposure * 2 ** event.target.value });
part("view").onchange = (event) => glowtree.set({ view: Number(event.target.value) });
part("fold").onclick = () => part("panel").classList.toggle("closed");

/* Moving about. Angles in radians; distances as shares of the distance to the target. */

function orbit(right, up) {
  const { camera } = state;
  const axis = unit(camera.up);
  let arm = add(camera.eye, camera.target, -1);
  const side = unit(cross(axis, arm));
  const height = Math.acos(Math.min(Math.max(dot(unit(arm), axis), -1), 1));
  // The poles stay a little away: there the picture would spin.
  const lift = Math.min(Math.max(height - up, 0.02), Math.PI - 0.02) - height;
  if (size(side) > 0.5) arm = turned(arm, side, lift);
  camera.eye = add(camera.target, turned(arm, axis, -right));
  renew();
}

function pan(right, up) {
  const { camera } = state;
  const seen = axes(1);
  const reach = size(add(camera.eye, camera.target, -1));
  const move = add(times(seen.side, right * reach), seen.top, up * reach);
  camera.eye = add(camera.eye, move);
  camera.target = add(camera.target, move);
  renew();
}

function zoom(factor) {
  const { camera } = state;
  const arm = add(camera.eye, camera.target, -1);
  const least = 1e-4 * header.radius;
  const most = 50 * header.radius;
  camera.eye = add(camera.target, times(unit(arm), Math.min(Math.max(size(arm) * factor, least), most)));
  renew();
}

/** Makes the surface under the pointer the target: its depth is read from one picture of depths. */
function aim(event) {
  const { width, height, frame } = targets;
  const [x, y] = [event.offsetX / canvas.clientWidth, event.offsetY / canvas.clientHeight];
  drawScene(frame.frame, [0, 0], VIEW.depth);
  gl.bindFramebuffer(gl.FRAMEBUFFER, frame.frame);
  const found = new Float32Array(4);
  gl.readPixels(Math.floor(x * width), Math.floor((1 - y) * height), 1, 1, gl.RGBA, gl.FLOAT, found);
  if (found[0] > 0) {
    const seen = axes(width / height);
    const ray = add(add(seen.ahead, seen.side, (2 * x - 1) * seen.right), seen.top, (1 - 2 * y) * seen.above);
    state.camera.target = add(seen.eye, ray, found[0]);
  }
  renew();
}

const held = new Map();
canvas.onpointerdown = (event) => {
  canvas.setPointerCapture(event.pointerId);
  canvas.focus();
  held.set(event.pointerId, [event.clientX, event.clientY]);
};
canvas.onpointerup = canvas.onpointercancel = (event) => held.delete(event.pointerId);
canvas.onpointermove = (event) => {
  const before = held.get(event.pointerId);
  if (!before) return;
  const now = [event.clientX, event.clientY];
  const spread = () => {
    const [a, b] = [...held.values()];
    return Math.hypot(a[0] - b[0], a[1] - b[1]);
  };
  const apart = held.size === 2 ? spread() : 0;
  held.set(event.pointerId, now);
  // Lengths of the screen: its height is `2 tan(fov / 2)` of the distance, and 180 degrees of orbit.
  const [dx, dy] = [0, 1].map((k) => (now[k] - before[k]) / canvas.clientHeight);
  const screen = 2 * Math.tan((state.camera.fov * Math.PI) / 360);
  if (held.size === 2) {
    zoom(apart / Math.max(spread(), 1));
    pan((-dx * screen) / 2, (dy * screen) / 2);
  } else if (event.buttons & 6 || event.shiftKey) pan(-dx * screen, dy * screen);
  else orbit(dx * Math.PI, dy * Math.PI);
};
canvas.onwheel = (event) => {
  event.preventDefault();
  const lines = event.deltaMode === 1 ? 16 * event.deltaY : event.deltaY;
  zoom(Math.exp(Math.min(Math.max(lines, -200), 200) * 0.0015));
};
canvas.addEventListener("wheel", (event) => event.preventDefault(), { passive: false });
canvas.ondblclick = aim;
canvas.oncontextmenu = (event) => event.preventDefault();

window.onkeydown = (event) => {
  const typing = event.target.tagName === "INPUT" || event.target.tagName === "SELECT";
  if (event.ctrlKey || event.metaKey || event.altKey || (typing && event.key.length > 1)) return;
  const turn = (right, up) => (event.shiftKey ? pan(0.1 * right, 0.1 * up) : orbit(0.1 * right, 0.1 * up));
  const expose = (by) => glowtree.set({ exposure: state.exposure * 2 ** by });
  const act = {
    ArrowLeft: () => turn(-1, 0), ArrowRight: () => turn(1, 0), ArrowUp: () => turn(0, 1),
    ArrowDown: () => turn(0, -1), "+": () => zoom(0.9), "=": () => zoom(0.9), "-": () => zoom(1 / 0.9),
    ",": () => expose(-0.25), ".": () => expose(0.25), r: () => glowtree.set(start()),
    h: () => part("panel").classList.toggle("closed"),
  }[event.key.length === 1 ? event.key.toLowerCase() : event.key];
  if (act) act();
  else if (event.key >= "1" && event.key <= "6") glowtree.set({ view: Number(event.key) - 1 });
  else return;
  event.preventDefault();
};
window.onresize = renew;

/* The first picture. In the address: `#width=…&height=…` for a bare picture of that size, `set={…}` as above. */
part("title").textContent = document.title = header.title;
if (fixed) {
  [canvas.style.width, canvas.style.height] = fixed.map((pixels) => `${pixels}px`);
  part("panel").hidden = true;
}
if (canvas.clientWidth < 600) part("panel").classList.add("closed");
glowtree.set(asked.set ? JSON.parse(asked.set) : {});
