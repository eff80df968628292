// @ts-check
/** What is said about an element, a face, a load or a layout: for tooltips and screen readers. */
import { shown, shownBracket } from "./dom.js";

/** @typedef {import("./contract.js").PageData} PageData */
/** @typedef {import("./contract.js").CaseSolution} CaseSolution */

/**
 * @param {PageData} data
 * @param {{face?: number, element?: number, load?: number}} what
 * @param {string} labelling
 * @param {CaseSolution | null} solved
 * @param {number[]} blocks
 * @returns {string[]} lines
 */
export function about(data, what, labelling, solved, blocks) {
  const { structure } = data;
  const { force, length } = structure.units;
  if (what.load !== undefined) {
    const load = data.loads[what.load];
    const where = load.kind === "body" ? "on all bodies, in total" : `on ${load.element}`;
    const values = load.vector.map((v) => shown(v)).join(", ");
    return [`live load ${where}`, load.kind === "couple" ? `(${values}) ${force}·${length} × λ` : `(${values}) ${force} × λ`];
  }
  if (what.face !== undefined) {
    const face = structure.faces[what.face];
    const [a, b] = face.elements.map((k) => structure.elements[k].id);
    const lines = [`face ${what.face}: ${a} – ${b}`, labelling[what.face] === "d" ? "dry" : "inner"];
    if (!face.candidate) lines[1] += ", not up for choice";
    if (solved?.forces) {
      const row = solved.forces[what.face];
      lines.push(structure.resultants.map((name, k) => {
        const moment = name.startsWith("M");
        return `${name} = ${shown(row[k])} ${force}${moment ? `·${length}` : ""}`;
      }).join(", "));
      if (solved.utilisation) lines.push(`utilisation ${shown(solved.utilisation[what.face], 3)}`);
    }
    const kind = solved?.movements?.[what.face];
    if (kind && kind !== "still") lines.push(`in the mechanism: ${data.look.movements[kind]?.meaning ?? kind}`);
    return lines;
  }
  if (what.element !== undefined) {
    const element = structure.elements[what.element];
    const mates = structure.elements.filter((other, k) => blocks[k] === blocks[/** @type {number} */ (what.element)] && !other.support);
    return element.support
      ? [element.id, "support"]
      : [element.id, `weight ${shown(element.weight)} ${force}`, mates.length === 1 ? "a block of its own" : `in a block of ${mates.length} elements`];
  }
  return [];
}

/**
 * What is known of a layout with several load cases: what governs, and the case shown.
 * @param {import("./contract.js").Solution} solution
 * @param {CaseSolution} shownCase
 */
export function verdicts(solution, shownCase) {
  if (solution.cases.length < 2) return verdict(shownCase);
  const { load_factor: value, bracket, status, cases, governing } = solution;
  const all = value === null ? status : `least λ / required = ${shown(value, 6)} in ${shownBracket(bracket)}, governed by ${cases[governing].name}`;
  return `${all}. Case ${shownCase.name}: ${verdict(shownCase)}, required ${shown(shownCase.required)}`;
}

/**
 * One line about λ.
 * @param {{load_factor: number | null, bracket: [number | null, number | null], status: string}} found
 */
export function verdict(found) {
  const { load_factor: value, bracket, status } = found;
  if (status === "locked") return "locked: no live load, however large, brings it down";
  if (status === "unstable") return "unstable: it does not stand under any λ ≥ 0";
  if (value === null) return status;
  return `λ = ${shown(value, 6)} in ${shownBracket(bracket)}, ${status}, as drawn`;
}
