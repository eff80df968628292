// @ts-check
/** Help: the keys, and what each thing on the page means. */
import { el } from "./dom.js";

const KEYS = [
  ["?", "this help"],
  ["Tab", "to the next tool, field or drawing"],
  ["arrow keys", "in the drawing: to the next face (spatial drawings turn; with Alt to the next face)"],
  ["Enter or space", "in the drawing: toggle the face, or keep its label with that tool; in a field: take the value"],
  ["Escape", "in a field: the value as it was; here: close"],
  ["Ctrl+Z, Ctrl+Y", "take back, do again: labels, geometry, loads, supports, materials, limits, opened files"],
  ["Ctrl+O", "open a file; Ctrl+Z takes back what was said of its layers"],
];
const WORDS = [
  ["λ", "the load factor at collapse: the live loads times λ are the most that the layout carries."],
  ["λ × load", "each live load at collapse, in newtons, kilonewtons, or per metre and square metre for pressures."],
  ["[lower, upper]", "the proven bracket: λ is not below the first number and not above the second."],
  ["collapse, locked, unstable", "collapse: λ is a number. Locked: no live load brings it down. Unstable: it falls without live load."],
  ["dry face", "thick line with a short stroke across: a joint without mortar, which opens and slides with friction."],
  ["inner face", "thin dashed line: a plane inside a stone, which cracks at the strengths of the material."],
  ["block", "elements joined by inner faces: one stone. Colours tell neighbours apart and mean nothing else."],
  ["support", "hatched: an element that does not move."],
  ["live and dead load", "live loads are multiplied by λ; weight and dead loads are not."],
  ["load case", "loads that act together. The least of λ by what is required governs."],
  ["limits", "what a search admits, as the number and mass of blocks. A layout that you draw may break them; the page says so."],
  ["search", "improve: local steps from this layout. Prove: the strongest layout, with proof. Explore: many layouts, and the front."],
  ["best, bound, gap", "of a search: λ of the best layout so far, what no layout exceeds, and the difference by the bound."],
  ["blocks that crack anywhere", "the bracket of λ if stones may crack along any plane, not only along faces."],
];

/** @returns {{open: () => void}} */
export function help() {
  const rows = (/** @type {string[][]} */ all, /** @type {string} */ tag) => el("dl", { class: "facts" }, all.map(([name, words]) => [el("dt", {}, tag ? el(tag, {}, name) : name), el("dd", {}, words)]));
  const close = el("button", { type: "button", onclick: () => box.close() }, "close");
  const box = el("dialog", { id: "help", "aria-labelledby": "help-name" },
    el("div", { class: "row" }, el("h2", { id: "help-name" }, "Help"), close),
    el("h3", {}, "Keys"), rows(KEYS, "kbd"), el("h3", {}, "What it means"), rows(WORDS, ""),
    el("p", { class: "hint" }, "Drop a file on the page: a scene (.json) opens at once; of a drawing (.dxf, .svg, .csv), of solids (.3dm, .ifc, .step, .obj, .ply, .stl) and of COMPAS (.json) the page first shows what was understood, and you say what is ground, opening, load, or to be ignored."));
  document.body.append(box);
  return { open: () => { if (!box.open) box.showModal(); } };
}
