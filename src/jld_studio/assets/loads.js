// @ts-check
/** Load cases, and the loads of the one that is shown. */
import { el } from "./dom.js";
import { Form } from "./fields.js";

/**
 * @typedef {object} Shown what the form needs of the page
 * @property {() => import("./contract.js").PageData} data
 * @property {() => string} caseName name of the case shown
 * @property {(name: string) => void} showCase
 */

/**
 * @param {HTMLElement} host
 * @param {import("./fields.js").Desk} desk
 * @param {Shown} page
 */
export function loadForm(host, desk, page) {
  return new Form(host, "loads", desk, (form) => {
    const { structure } = page.data();
    const loads = form.now;
    const number = (loads.cases ?? []).findIndex((/** @type {any} */ one) => one.name === page.caseName());
    const own = number >= 0 ? ["cases", number] : [];
    const moving = (loads.moving || loads.pushes) && number < 0;
    const take = (/** @type {(value: any) => void} */ act) => {
      const value = structuredClone(form.now);
      act(value);
      form.take(value);
    };
    const lists = moving ? [el("p", { class: "hint" }, `${page.caseName()} belongs to a moving load or to pushes, which the scene file states.`)] : [
      ...entries(form, structure, [...own, "live"], "Live loads, × λ", take, true),
      ...(number >= 0 ? entries(form, structure, [...own, "dead"], "Dead loads of this case", take) : []),
    ];
    return [...cases(form, page, take), ...lists, ...entries(form, structure, ["dead"], "Dead loads, beside the weight", take), ...(moving ? [] : adding(structure, take, own))];
  });
}

/** @param {Form} form @param {Shown} page @param {(act: (value: any) => void) => void} take */
function cases(form, page, take) {
  const all = form.now.cases ?? [];
  const rows = all.map((/** @type {any} */ one, /** @type {number} */ k) => el("li", { class: one.name === page.caseName() ? "current" : null },
    el("button", { type: "button", "data-key": `case ${k}`, "aria-pressed": String(one.name === page.caseName()), onclick: () => page.showCase(one.name) }, "show"),
    form.text("load case", ["cases", k, "name"], { wide: true, bare: true }),
    form.text("required λ", ["cases", k, "required"], { hint: "1" }),
    el("button", { type: "button", "data-key": `remove case ${k}`, "aria-label": `remove the load case ${one.name}`, onclick: () => take((value) => {
      value.cases.splice(k, 1);
      if (!value.cases.length && !value.moving && !value.pushes) {
        delete value.cases;
        value.live = one.live;
        if (one.dead) value.dead = [...(value.dead ?? []), ...one.dead];
      } else if (!value.cases.length) delete value.cases;
    }) }, "remove")));
  const add = el("button", { type: "button", "data-key": "add case", onclick: () => take((value) => {
    if (!value.cases && !value.moving && !value.pushes) {
      value.cases = [{ name: "case 1", live: value.live }];
      delete value.live;
    }
    value.cases ??= [];
    let k = value.cases.length + 1;
    while (value.cases.some((/** @type {any} */ one) => one.name === `case ${k}`)) k += 1;
    value.cases.push({ name: `case ${k}`, live: structuredClone(value.cases[0]?.live ?? [{ body: [1, ...Array(page.data().structure.dimension - 1).fill(0)] }]) });
  }) }, "add a load case");
  return [all.length ? el("ul", { class: "entries", "aria-label": "load cases" }, rows) : el("span"), el("div", { class: "row" }, add)];
}

/**
 * @param {Form} form
 * @param {import("./contract.js").Structure} structure
 * @param {import("./fields.js").Path} path of the list
 * @param {string} title
 * @param {(act: (value: any) => void) => void} take
 * @param {boolean} [live]
 */
function entries(form, structure, path, title, take, live = false) {
  const { force, length } = structure.units;
  const axes = ["x", "y", "z"].slice(0, structure.dimension);
  const list = path.reduce((value, key) => value?.[key], form.now) ?? [];
  if (!list.length && !live) return [];
  const rows = list.map((/** @type {any} */ load, /** @type {number} */ k) => {
    const place = [...path, k];
    const title = load.body ? "all bodies" : load.tilt ? "a tilting table" : load.on_fill ? "fill" : load.face ? `faces of ${load.face.between?.[0] ?? `a line of ${load.face.along?.length} points`}` : load.element;
    const vector = (/** @type {string} */ key, /** @type {string} */ name, /** @type {string} */ unit) => [
      ...axes.map((axis, i) => form.text(`${name}${axis}`, [...place, ...within(load, key), i], { more: live ? { "data-load": k } : {}, unit: i === axes.length - 1 ? unit : "" }))];
    const pressure = Array.isArray(load.pressure?.mean ?? load.pressure) ? [0, 1].map((i) => form.text(`pressure ${i ? "last" : "first"}`, [...place, ...within(load, "pressure"), i], { unit: i ? `${force}/${length}²` : "" }))
      : [form.text("pressure", [...place, ...within(load, "pressure")], { unit: `${force}/${length}²` })];
    const fields = load.body ? vector("body", "", "× weight") : load.tilt ? axes.map((axis, i) => form.text(`towards ${axis}`, [...place, "tilt", "towards", i])) : load.face ? pressure : load.on_fill ? [
      form.text("at", [...place, "on_fill", "at"], { unit: length }), form.text("width", [...place, "on_fill", "width"], { unit: length, hint: "0" }),
      form.text("weight", [...place, ...within(load, "weight")], { unit: force })] : [
      ...(load.force ? vector("force", "", force) : []),
      ...(load.at ? vector("at", "at ", length) : []),
      ...(load.moment === undefined ? [] : Array.isArray(load.moment?.mean ?? load.moment) ? axes.map((axis, i) => form.text(`moment ${axis}`, [...place, ...within(load, "moment"), i])) : [form.text("moment", [...place, ...within(load, "moment")], { unit: `${force}·${length}` })]),
      ...(load.width === undefined ? [] : [form.text("width", [...place, "width"], { unit: length })]),
    ];
    return el("li", {}, el("span", { class: "name" }, title), ...fields, live ? el("span", { class: "collapse", "data-collapse": k }) : null,
      el("button", { type: "button", "data-key": `remove ${place.join(" ")}`, "aria-label": `remove the load on ${title}`, onclick: () => take((value) => {
        path.reduce((inner, key) => inner[key], value).splice(k, 1);
      }) }, "remove"));
  });
  return [el("h3", {}, title), el("ul", { class: "entries" }, rows)];
}

/** Path to the number or vector of a key, whose size may be uncertain. @param {any} load @param {string} key */
function within(load, key) {
  return load[key]?.mean === undefined ? [key] : [key, "mean"];
}

/**
 * What adds a load by keyboard; the tool adds one by a click.
 * @param {import("./contract.js").Structure} structure
 * @param {(act: (value: any) => void) => void} take
 * @param {import("./fields.js").Path} own path of the case
 */
function adding(structure, take, own) {
  const planar = structure.dimension === 2;
  const free = structure.elements.filter((element) => !element.support);
  const element = el("select", { "aria-label": "element of the new load", "data-key": "new element" }, free.map(({ id }) => el("option", { value: id }, id)));
  const kind = el("select", { "aria-label": "kind of the new load", "data-key": "new kind" },
    [["force", "force"], ["moment", "moment"], ["pressure", "pressure on free faces"]].map(([value, words]) => el("option", { value }, words)));
  const when = el("select", { "aria-label": "live or dead", "data-key": "new list" }, el("option", { value: "live" }, "live, × λ"), el("option", { value: "dead" }, "dead"));
  const size = (/** @type {string} */ id) => Number(Math.max(free.find((one) => one.id === id)?.weight ?? 0, 1e-12).toPrecision(2));
  const entry = () => {
    const weight = size(element.value);
    if (kind.value === "pressure") return { face: { between: [element.value, "outside"] }, pressure: Number((weight / structure.typical ** 2).toPrecision(2)) };
    if (kind.value === "moment") return { element: element.value, moment: planar ? Number((weight * structure.typical).toPrecision(2)) : [0, 0, Number((weight * structure.typical).toPrecision(2))] };
    return { element: element.value, force: planar ? [0, -weight] : [0, 0, -weight] };
  };
  const push = () => ({ body: [1, ...Array(structure.dimension - 1).fill(0)] });
  const add = (/** @type {() => any} */ made) => take((value) => {
    const list = own.length ? own.reduce((inner, key) => inner[key], value) : value;
    (list[when.value] ??= []).push(made());
  });
  return [el("div", { class: "row" }, kind, " on ", element, when,
    el("button", { type: "button", "data-key": "add load", onclick: () => add(entry) }, "add this load"),
    el("button", { type: "button", "data-key": "add push", onclick: () => add(push) }, "push all bodies sideways"))];
}

/** Write λ times each load beside it. @param {HTMLElement} host @param {string[]} texts of the case shown */
export function showCollapse(host, texts) {
  for (const node of host.querySelectorAll("[data-collapse]")) {
    const text = texts[Number(/** @type {any} */ (node).dataset.collapse)];
    node.textContent = text ? `λ × load = ${text}` : "";
  }
}
