// @ts-check
/** Limits on the layouts of a search, and the faces that keep their label. */
import { el } from "./dom.js";
import { Form } from "./fields.js";

/**
 * @param {HTMLElement} host
 * @param {import("./fields.js").Desk} desk
 * @param {() => import("./contract.js").PageData} data
 */
export function limitForm(host, desk, data) {
  return new Form(host, "search", desk, (form) => {
    const { length, force } = data().structure.units;
    const bounds = [
      ["blocks", "blocks", ""], ["block_cells", "elements in a block", ""], ["dry_faces", "dry faces", ""], ["shapes", "different shapes", ""],
      ["sawn_length", "sawn length", length], ["saw_cuts", "saw cuts", ""], ["saw_set_ups", "set-ups of the saw", ""],
      ["block_mass", "mass of a block", length === "m" && force === "N" ? "kg" : "weight over gravity"], ["block_weight", "weight of a block", force], ["block_extent", "extent of a block", length], ["block_aspect", "longest by shortest side", ""],
    ];
    const row = (/** @type {string[]} */ [key, name, unit]) => el("tr", {}, el("th", { scope: "row" }, name, unit ? ` [${unit}]` : ""),
      ["least", "most"].map((side, i) => el("td", {}, form.text(`${side} ${name}`, [key, i], { bare: true, hint: i ? "no limit" : "no limit" }))));
    const keep = form.now.keep ?? {};
    const kept = (keep.dry ?? []).length + (keep.inner ?? []).length;
    return [
      el("table", { class: "limits" }, el("thead", {}, el("tr", {}, el("td"), el("th", { scope: "col" }, "least"), el("th", { scope: "col" }, "most"))), el("tbody", {}, bounds.map(row))),
      el("div", { class: "stacked" },
        form.choice("faces that a search chooses", ["candidates"], [["all", "all between free elements"], ["all+supports", "all, those at supports too"], ["inside-blocks", "inside the blocks of the scene"]], "all"),
        form.choice("every dry face separates two blocks", ["segmentation"], [[true, "yes"], [false, "no: slits are admitted"]], true),
        form.choice("convex blocks", ["convex_blocks"], [[false, "not required"], [true, "required"]], false),
        form.choice("blocks can be laid one by one", ["assemble"], [[null, "not required"], ["translation", "moved in straight lines"], ["standing", "and what is laid stands"]], null),
        form.choice("mirrored layouts", ["symmetry"], [["auto", "are the same layout, where the scene is symmetric"], ["none", "are different layouts"]], "auto"),
        form.text("required λ", ["require", "load_factor"], { hint: "none" })),
      el("div", { class: "row" }, el("span", {}, kept ? `${kept} ${kept === 1 ? "pair of elements keeps" : "pairs of elements keep"} the label of their faces.` : "No face keeps its label: use the tool “keep labels”."),
        kept ? el("button", { type: "button", "data-key": "free faces", onclick: () => {
          const value = structuredClone(form.now);
          delete value.keep;
          form.take(value);
        } }, "let them free") : null),
    ];
  });
}

/**
 * The limits after a click on a face with the tool “keep labels”: its pair keeps the label, or no longer does.
 * @param {any} search
 * @param {string[]} pair ids of two elements
 * @param {"dry" | "inner"} label that it has now
 */
export function keptFace(search, pair, label) {
  const value = structuredClone(search);
  const same = (/** @type {string[]} */ one) => one.includes(pair[0]) && one.includes(pair[1]);
  const before = ["dry", "inner"].some((name) => (value.keep?.[name] ?? []).some(same));
  const keep = Object.fromEntries(["dry", "inner"].map((name) => [name, (value.keep?.[name] ?? []).filter((/** @type {string[]} */ one) => !same(one))]));
  if (!before) keep[label].push(pair);
  value.keep = keep;
  return value;
}
