// @ts-check
/** The list of live loads. */
import { el, shown } from "./dom.js";
import { liveOf } from "./editing.js";

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
