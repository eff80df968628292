// @ts-check
/** Labellings: their letters and bits, the blocks they make, and the tint of each block. */

/** @typedef {import("./contract.js").Structure} Structure */

/**
 * Bits of many labellings from base64.
 * @param {string} text
 * @returns {Uint8Array<ArrayBuffer>}
 */
export function bytesOf(text) {
  return Uint8Array.from(atob(text), (character) => character.charCodeAt(0));
}

/**
 * The letters of one labelling.
 * @param {Uint8Array} bytes all rows
 * @param {number} row
 * @param {number} faces
 * @param {Uint8Array} beside bits of faces beside what is left out, none where nothing is
 */
export function lettersOf(bytes, row, faces, beside = new Uint8Array()) {
  const wide = Math.ceil(faces / 8);
  const bit = (/** @type {Uint8Array} */ of, /** @type {number} */ k) => (of[row * wide + (k >> 3)] >> (7 - (k & 7))) & 1;
  let text = "";
  for (let k = 0; k < faces; k++) {
    text += beside.length && bit(beside, k) ? "v" : bit(bytes, k) ? "d" : "i";
  }
  return text;
}

/**
 * Elements that a labelling leaves out: those whose every face is beside nothing.
 * @param {Structure} structure
 * @param {string} labelling
 * @returns {Set<number>}
 */
export function goneOf(structure, labelling) {
  if (!labelling.includes("v")) return new Set();
  const stays = new Set(structure.elements.flatMap((element, k) => (element.support ? [k] : [])));
  structure.faces.forEach(({ elements: [a, b] }, k) => {
    if (labelling[k] !== "v") stays.add(a).add(b);
  });
  return new Set(structure.elements.flatMap((_, k) => (stays.has(k) ? [] : [k])));
}

/**
 * Number of the block of each element: components joined through inner faces or of supports that touch, numbered in the order of elements.
 * @param {Structure} structure
 * @param {string} labelling
 * @returns {number[]}
 */
export function blocksOf(structure, labelling) {
  const up = structure.elements.map((_, k) => k);
  /** @param {number} k */
  const root = (k) => {
    while (up[k] !== k) {
      up[k] = up[up[k]];
      k = up[k];
    }
    return k;
  };
  const join = (/** @type {number} */ a, /** @type {number} */ b) => {
    const [i, j] = [root(a), root(b)];
    up[Math.max(i, j)] = Math.min(i, j);
  };
  structure.faces.forEach(({ elements: [a, b] }, k) => {
    if (labelling[k] !== "d" && labelling[k] !== "v") join(a, b);
  });
  for (const [a, b] of structure.touching) join(a, b);
  /** @type {Map<number, number>} */
  const number = new Map();
  return up.map((_, k) => {
    const at = root(k);
    if (!number.has(at)) number.set(at, number.size);
    return /** @type {number} */ (number.get(at));
  });
}

/**
 * Colour number of each element, −1 for supports: blocks in contact differ as long as the colours last. The rule is
 * that of jld_core's pictures (the block with most neighbours first; of the free colours the least used one).
 * @param {Structure} structure
 * @param {string} labelling
 * @param {number} available
 * @returns {number[]}
 */
export function coloursOf(structure, labelling, available) {
  const block = blocksOf(structure, labelling);
  const support = structure.elements.map((element) => element.support);
  /** @type {Set<number>[]} */
  const neighbours = Array.from({ length: Math.max(-1, ...block) + 1 }, () => new Set());
  for (const { elements: [a, b] } of structure.faces) {
    if (block[a] === block[b]) continue;
    neighbours[block[a]].add(block[b]);
    neighbours[block[b]].add(block[a]);
  }
  const free = new Set(block.filter((_, k) => !support[k]));
  const order = [...free].sort((a, b) => neighbours[b].size - neighbours[a].size || a - b);
  /** @type {Map<number, number>} */
  const colour = new Map();
  const used = new Array(available).fill(0);
  for (const k of order) {
    const taken = new Set([...neighbours[k]].map((j) => colour.get(j)));
    let best = 0;
    for (let c = 1; c < available; c++) {
      if (taken.has(c) !== taken.has(best) ? taken.has(best) : used[c] < used[best]) best = c;
    }
    colour.set(k, best);
    used[best] += 1;
  }
  return block.map((k, element) => (support[element] ? -1 : /** @type {number} */ (colour.get(k))));
}

/**
 * Dry faces with one block on both sides (supports in contact count as one block): what a segmentation has none of.
 * @param {Structure} structure
 * @param {string} labelling
 * @returns {number[]}
 */
export function slitsOf(structure, labelling) {
  const supports = structure.faces.map(({ elements: [a, b] }, k) =>
    structure.elements[a].support && structure.elements[b].support ? "i" : labelling[k]);
  const block = blocksOf(structure, supports.join(""));
  return structure.faces.flatMap(({ elements: [a, b] }, k) =>
    labelling[k] === "d" && supports[k] === "d" && block[a] === block[b] ? [k] : []);
}

/**
 * Faces whose labels differ.
 * @param {string} one
 * @param {string} other
 */
export function differing(one, other) {
  return new Set([...one].flatMap((letter, k) => (letter === other[k] ? [] : [k])));
}
