// @ts-check
/** Sliders for materials, and the list of live loads. */
import { el, shown } from "./dom.js";
import { liveOf } from "./editing.js";

/**
 * @param {HTMLElement} host
 * @param {any} materials as in the scene, changed in place by a copy that is handed on
 * @param {{length: string, force: string}} units
 * @param {(materials: any, finished: boolean) => void} tell
 */
export function materialSliders(host, materials, units, tell) {
  const stress = `${units.force}/${units.length}²`;
  /** @param {string} name @param {string} unit @param {number} value @param {boolean} powers @param {(copy: any, v: number) => void} put */
  const slider = (name, unit, value, powers, put) => {
    const read = (/** @type {any} */ input) => (powers ? value * 10 ** Number(input.value) : Number(input.value));
    const output = el("output", {}, `${shown(value)} ${unit}`);
    const use = (/** @type {any} */ event, /** @type {boolean} */ finished) => {
      const copy = structuredClone(materials);
      const found = Number(read(event.target).toPrecision(4));
      put(copy, found);
      output.textContent = `${shown(found)} ${unit}`;
      tell(copy, finished);
    };
    const range = powers ? { min: -2, max: 2, step: 0.01, value: 0 } : { min: 0, max: Math.max(1.5, 1.2 * value), step: 0.01, value };
    return el("label", { class: "slider" }, name, el("input", {
      type: "range", ...range, "data-material": name, "aria-label": name,
      oninput: (/** @type {any} */ e) => use(e, false), onchange: (/** @type {any} */ e) => use(e, true),
    }), output);
  };
  const { dry, inner } = materials;
  const rows = [];
  if (dry) {
    const mu = dry.friction_coefficient ?? Math.tan((dry.friction_angle * Math.PI) / 180);
    rows.push(slider("friction μ, dry", "", mu, false, (copy, v) => {
      delete copy.dry.friction_angle;
      copy.dry.friction_coefficient = v;
    }));
  }
  for (const [part, label] of [["inner", "inner"], ["dry", "dry"]]) {
    for (const [key, name] of [["tensile_strength", "tensile strength"], ["shear_strength", "shear strength"], ["cohesion", "cohesion"], ["compressive_strength", "compressive strength"]]) {
      const value = materials[part]?.[key];
      if (typeof value === "number" && value > 0) {
        rows.push(slider(`${name}, ${label}`, stress, value, true, (copy, v) => { copy[part][key] = v; }));
      }
    }
  }
  host.replaceChildren(...(rows.length ? rows : [el("p", { class: "hint" }, "This scene names no material.")]), ...(inner ? [] : [el("p", { class: "hint" }, "No inner material: every face has to stay dry.")]));
}

/**
 * @param {HTMLElement} host
 * @param {any} loads as in the scene
 * @param {string} name of the case
 * @param {{dimension: number, units: {force: string}}} structure
 * @param {(loads: any) => void} tell a changed copy
 */
export function loadList(host, loads, name, structure, tell) {
  const axes = ["x", "y", "z"].slice(0, structure.dimension);
  const change = (/** @type {(live: any[]) => void} */ act) => {
    const copy = structuredClone(loads);
    act(liveOf(copy, name));
    tell(copy);
  };
  const entries = liveOf(structuredClone(loads), name).map((load, k) => {
    const [key, title] = load.body ? ["body", "all bodies"] : ["force", load.element];
    const vector = load[key];
    const fields = vector ? axes.map((axis, i) => el("input", {
      type: "number", step: "any", value: vector[i], "aria-label": `${title}, ${axis}`, "data-load": k,
      onchange: (/** @type {any} */ e) => { if (e.target.value !== "") change((live) => { live[k][key][i] = Number(e.target.value); }); },
    })) : [el("span", {}, `moment ${shown(load.moment)}`)];
    return el("li", {}, el("span", { class: "name" }, title), fields, load.body ? "× weight" : structure.units.force,
      el("button", { type: "button", "aria-label": `remove the load on ${title}`, onclick: () => change((live) => live.splice(k, 1)) }, "remove"));
  });
  const push = el("button", { type: "button", onclick: () => change((live) => live.push({ body: axes.map((_, i) => (i === 0 ? 1 : 0)) })) }, "push all bodies sideways");
  host.replaceChildren(el("ul", { class: "entries" }, entries), el("div", { class: "row" }, push));
}
