// @ts-check
/** The fields of materials: density, and every strength of dry joints and inner faces. */
import { el, shown } from "./dom.js";
import { Form, at } from "./fields.js";

const DRY = [["cohesion", "cohesion, dry"], ["tensile_strength", "tensile strength, dry"], ["compressive_strength", "compressive strength, dry"]];
const INNER = [["tensile_strength", "tensile strength, inner"], ["shear_strength", "shear strength, inner"], ["compressive_strength", "compressive strength, inner"]];
const NONE = { cohesion: "0", tensile_strength: "0", compressive_strength: "unlimited", friction_coefficient: "0" };

/** @param {{length: string, force: string}} units */
export function densityUnit({ length, force }) {
  return length === "m" && force === "N" ? "kg/m³" : length === "m" && force === "kN" ? "t/m³" : `mass/${length}³`;
}

/**
 * @param {HTMLElement} host
 * @param {import("./fields.js").Desk} desk
 * @param {() => import("./contract.js").PageData} data
 */
export function materialForm(host, desk, data) {
  return new Form(host, "materials", desk, (form) => {
    const { units } = data().structure;
    const stress = `${units.force}/${units.length}²`;
    /** @param {string} label @param {import("./fields.js").Path} path @param {string} unit @param {string} [hint] */
    const rows = (label, path, unit, hint) => {
      const value = at(form.now, path);
      if (value !== null && typeof value === "object") {
        // a low value or a coefficient of variation beside the value itself
        return Object.keys(value).filter((kind) => typeof value[kind] === "number").map((kind) => el("div", { class: "slider" }, form.text(`${label}, ${kind}`, [...path, kind], { unit: kind === "cov" ? "" : unit })));
      }
      const range = typeof value === "number" && value > 0 ? form.slider(label, path, { min: -2, max: 2, step: 0.01, value: 0 }, (x) => value * 10 ** x) : el("span");
      return [el("div", { class: "slider" }, range, form.text(label, path, { unit, hint }))];
    };
    const friction = (/** @type {string} */ part, /** @type {string} */ name) => {
      const angle = at(form.now, [part, "friction_angle"]);
      const own = angle ?? at(form.now, [part, "friction_coefficient"]);
      const stated = angle === undefined ? "friction_coefficient" : "friction_angle";
      const label = angle === undefined ? `friction μ, ${name}` : `friction angle, ${name}`;
      if (own !== null && typeof own === "object") return rows(label, [part, stated], angle === undefined ? "" : "°");
      const mu = angle === undefined ? own : Math.tan((angle * Math.PI) / 180);
      const slider = typeof mu === "number" ? form.slider(`friction μ, ${name}`, [part, stated], { min: 0, max: Math.max(1.5, 1.2 * mu), step: 0.01, value: mu }, (x) => x, (value, found) => {
        delete value[part].friction_angle;
        value[part].friction_coefficient = found;
      }) : el("span");
      const turn = own === undefined ? null : el("button", {
        type: "button", "data-key": `turn ${part}`, onclick: () => {
          const value = structuredClone(form.now);
          delete value[part][stated];
          if (angle === undefined) value[part].friction_angle = Number(((Math.atan(mu) * 180) / Math.PI).toPrecision(12));
          else value[part].friction_coefficient = Number(mu.toPrecision(12));
          form.take(value);
        },
      }, angle === undefined ? `as angle (${shown((Math.atan(mu) * 180) / Math.PI, 3)}°)` : `as μ (${shown(mu, 3)})`);
      return [el("div", { class: "slider" }, slider, form.text(label, [part, stated], { unit: angle === undefined ? "" : "°", hint: part === "inner" ? "0" : "" }), turn)];
    };
    const { elements = [] } = /** @type {any} */ (data().scene);
    const own = elements.filter((/** @type {any} */ one) => !one.support && (one.weight !== undefined || one.density !== undefined)).length;
    const faces = (form.now.faces ?? []).length;
    return [
      ...rows("density", ["density"], densityUnit(units)),
      own ? el("p", { class: "hint" }, `${own} elements state a weight or density of their own, which this one does not change.`) : el("span"),
      el("h3", {}, "Dry joints"), ...friction("dry", "dry"), ...DRY.flatMap(([key, label]) => rows(label, ["dry", key], stress, NONE[/** @type {"cohesion"} */ (key)])),
      el("h3", {}, "Inner faces (cracks through the material)"),
      ...INNER.flatMap(([key, label]) => rows(label, ["inner", key], stress, key === "compressive_strength" ? "unlimited" : form.now.inner ? "" : "no material")),
      ...friction("inner", "inner"),
      faces ? el("p", { class: "hint" }, `${faces} pairs of elements have materials of their own, which stay.`) : el("span"),
      el("p", { class: "hint" }, "A number in the unit of the scene, or one with its unit, as 0.2 MPa. An empty field is the default."),
    ];
  });
}
