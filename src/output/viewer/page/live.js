/* Live solves: what weights cannot do is asked of the program that serves this page. */

/** What differs from the bake, as the program takes it; `have` are versions of the layers here. */
const edits = { albedo: {}, lamps: {}, rotate: null };
const versions = new Array(1 + header.lights.length).fill(0);
const live = document.createElement("section");
part("view").parentElement.insertBefore(live, part("help"));
const element = (parent, tag, properties) => parent.appendChild(Object.assign(document.createElement(tag), properties));
element(live, "h2", { textContent: "Solved anew" });

const said = element(live, "output", { id: "solving", ariaLive: "polite" });
let newest = 0; // of the edits sent
let due = null;

/** Asks for the edits as they are now, and shows the answer unless a newer one was asked for. */
async function solve() {
  const own = ++newest;
  const began = performance.now();
  const tell = () => (said.textContent = `solving … ${((performance.now() - began) / 1000).toFixed(1)} s`);
  tell();
  const ticking = setInterval(() => own === newest && tell(), 100);
  try {
    const body = JSON.stringify({ ...edits, have: versions });
    const answer = await fetch("edit", { method: "POST", headers: { "Content-Type": "application/json" }, body });
    if (!answer.ok) throw new Error((await answer.text()).trim());
    const bytes = await answer.arrayBuffer();
    if (own === newest) said.textContent = take(bytes);
  } catch (problem) {
    if (own === newest) said.textContent = problem.message;
  } finally {
    clearInterval(ticking);
  }
}

/** Swaps the layers that an answer holds; what to say of it. */
function take(bytes) {
  const length = new DataView(bytes).getUint32(0, true);
  const told = JSON.parse(new TextDecoder().decode(new Uint8Array(bytes, 4, length)));
  told.layers.forEach(({ layer, version, scale }, k) => {
    putLayer(layer, new Uint32Array(bytes, 4 + length + 4 * k * header.count, header.count));
    versions[layer] = version;
    if (layer > 0) header.lights[layer - 1].scale = scale;
  });
  renew();
  if (told.lights === 0) return "";
  const lights = told.lights === 1 ? "1 light" : `${told.lights} lights`;
  return `${lights} in ${told.seconds.toFixed(2)} s, ${told.iterations} products, ${told.rays} rays`;
}

/** Solves when hands have rested for a moment. */
function changed() {
  clearTimeout(due);
  due = setTimeout(solve, 200);
}

/** Adds `{albedo, lamps, turn}` to the edits and solves at once: the tests' and scripts' way in. */
glowtree.edit = ({ albedo = {}, lamps = {}, turn }) => {
  Object.assign(edits.albedo, albedo);
  for (const name of Object.keys(albedo)) pickers[name]?.(albedo[name]);
  Object.assign(edits.lamps, lamps);
  if (turn !== undefined) {
    edits.rotate = header.live.rotate + turn;
    plainSet({ turn });
  }
  return solve();
};

const byte = (l) => Math.round(255 * (l <= 0.0031308 ? 12.92 * l : 1.055 * l ** (1 / 2.4) - 0.055));
const hexOf = (rgb) => `#${rgb.map((l) => byte(Math.min(l, 1)).toString(16).padStart(2, "0")).join("")}`;

/** Shows the albedo of a mesh, by name. */
const pickers = {};
for (const { name, albedo } of header.live.meshes) {
  const box = element(live, "div", { className: "light" });
  element(box, "span", { className: "name", textContent: name, title: name });
  const reset = element(box, "button", { textContent: "as baked", hidden: true });
  const colour = element(box, "input", { type: "color", value: hexOf(albedo), title: "Albedo" });
  colour.setAttribute("aria-label", `albedo of ${name}`);
  colour.oninput = () => {
    const linear = [1, 3, 5].map((at) => toLinear(parseInt(colour.value.slice(at, at + 2), 16) / 255));
    edits.albedo[name] = linear.map((l) => Math.min(l, 0.98));
    reset.hidden = false;
    changed();
  };
  pickers[name] = (now) => ((colour.value = hexOf(now)), (reset.hidden = false));
  reset.onclick = () => {
    delete edits.albedo[name];
    pickers[name](albedo);
    reset.hidden = true;
    changed();
  };
}

for (const { name, ...place } of header.live.lamps) {
  for (const [what, given] of Object.entries(place)) {
    const row = element(live, "div", { className: "place" });
    element(row, "span", { className: "name", textContent: `${name}: ${what}`, title: name });
    const fields = given.map((value, axis) => {
      const step = what === "position" ? Number(header.live.step.toPrecision(1)) : 0.05;
      const field = element(row, "input", { type: "number", step, value: Number(value.toPrecision(5)) });
      field.setAttribute("aria-label", `${what} of ${name}, ${"xyz"[axis]}`);
      return field;
    });
    fields.forEach((field) => (field.oninput = () => {
      const numbers = fields.map((one) => parseFloat(one.value));
      if (!numbers.every(Number.isFinite)) return;
      (edits.lamps[name] ??= {})[what] = numbers;
      changed();
    }));
  }
}

/* The sky's turn is the page's own as well: its slider, the key for a reset, and scripts all end here. */
const plainSet = glowtree.set;
glowtree.set = (change) => {
  plainSet(change);
  const rotate = state.turn === 0 ? null : header.live.rotate + state.turn;
  if (header.live.rotate === null || rotate === edits.rotate) return;
  edits.rotate = rotate;
  changed();
};

if (fixed) live.hidden = true;
if (asked.edit) glowtree.edit(JSON.parse(asked.edit));
