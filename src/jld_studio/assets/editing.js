// @ts-check
/** What a hand does to a labelling: toggle a face, paint a block, go from face to face by keys. */

/** @typedef {import("./contract.js").Structure} Structure */

/**
 * @param {string} labelling
 * @param {number} face
 */
export function toggled(labelling, face) {
  return labelling.slice(0, face) + (labelling[face] === "d" ? "i" : "d") + labelling.slice(face + 1);
}

/**
 * Elements made one block of their own: inner among themselves, dry towards all others.
 * @param {Structure} structure
 * @param {string} labelling
 * @param {Set<number>} block
 */
export function painted(structure, labelling, block) {
  return structure.faces.map(({ elements: [a, b] }, k) => {
    if (block.has(a) && block.has(b)) return "i";
    return block.has(a) || block.has(b) ? "d" : labelling[k];
  }).join("");
}

/**
 * The nearest face in a direction, for arrow keys.
 * @param {Structure} structure
 * @param {number} from
 * @param {string} key
 */
export function nextFace(structure, from, key) {
  const wish = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[key];
  if (!wish) return from;
  if (from < 0) return 0;
  const place = structure.faces[from].origin;
  const up = structure.dimension - 1;
  let [best, least] = [from, Infinity];
  structure.faces.forEach(({ origin }, k) => {
    const [x, y] = [origin[0] - place[0], origin[up] - place[up]];
    const ahead = x * wish[0] + y * wish[1];
    if (k === from || ahead <= 1e-9 * structure.size) return;
    const aside = Math.abs(x * wish[1]) + Math.abs(y * wish[0]);
    const rest = structure.dimension === 3 ? Math.abs(origin[1] - place[1]) : 0;
    if (ahead + 2.5 * aside + 2.5 * rest < least) [best, least] = [k, ahead + 2.5 * aside + 2.5 * rest];
  });
  return best;
}

/**
 * The live loads that a state lets be edited: those of the case shown.
 * @param {any} loads
 * @param {string} name of the case
 * @returns {any[]}
 */
export function liveOf(loads, name) {
  const cases = loads.cases ?? [];
  const own = cases.find((/** @type {any} */ c) => c.name === name) ?? cases[0];
  return own ? (own.live ??= []) : (loads.live ??= []);
}
