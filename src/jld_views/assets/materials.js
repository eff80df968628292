// @ts-check
/** Sliders for materials, in the studio and in notebooks. */
import { el, shown } from "./dom.js";

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
