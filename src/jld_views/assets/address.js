// @ts-check
/** What a link to a page remembers: `#rank=4&view=mechanism`. */

/**
 * @typedef {object} Place
 * @property {string} [rank]
 * @property {string} [row]
 * @property {string} [compare]
 * @property {string} [view]
 * @property {string} [case]
 * @property {string} [x]
 */
const KEYS = ["rank", "row", "compare", "view", "case", "x"];

/** @returns {Record<string, string>} */
export function read() {
  const given = new URLSearchParams(location.hash.slice(1));
  return Object.fromEntries(KEYS.flatMap((key) => (given.has(key) ? [[key, /** @type {string} */ (given.get(key))]] : [])));
}

/** @param {Record<string, string | null>} place */
export function write(place) {
  const kept = new URLSearchParams();
  for (const key of KEYS) if (place[key]) kept.set(key, /** @type {string} */ (place[key]));
  const hash = `#${kept}`;
  // a frame of a notebook has no address of its own to write
  if (hash !== location.hash && location.protocol !== "about:") history.replaceState(null, "", hash);
}
