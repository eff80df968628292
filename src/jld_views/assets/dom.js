// @ts-check
/** Making elements. Text goes in as text nodes only: no string is ever read as markup. */

/** @typedef {Record<string, any>} Attributes */

/** @param {Element} node @param {Attributes} attributes @param {any[]} children */
function furnish(node, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (value === null || value === undefined || value === false) continue;
    if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
    else node.setAttribute(name, value === true ? "" : String(value));
  }
  for (const child of children.flat(Infinity)) {
    if (child !== null && child !== undefined && child !== false) node.append(child);
  }
  return node;
}

/**
 * An HTML element.
 * @param {string} tag
 * @param {Attributes} [attributes] `onclick: f` listens
 * @param {...any} children
 * @returns {any}
 */
export function el(tag, attributes = {}, ...children) {
  return furnish(document.createElement(tag), attributes, children);
}

/**
 * An SVG element.
 * @param {string} tag
 * @param {Attributes} [attributes]
 * @param {...any} children
 * @returns {any}
 */
export function svg(tag, attributes = {}, ...children) {
  return furnish(document.createElementNS("http://www.w3.org/2000/svg", tag), attributes, children);
}

/**
 * The element with an id, which the page always has.
 * @param {string} id
 * @returns {any}
 */
export function byId(id) {
  const found = document.getElementById(id);
  if (!found) throw new Error(`the page has no element ${id}`);
  return found;
}

/**
 * A number for people: few digits, a true minus, an en dash for none.
 * @param {any} value
 * @param {number} [digits]
 */
export function shown(value, digits = 4) {
  if (value === null || value === undefined || value === "") return "–";
  if (typeof value !== "number") return String(value);
  if (!Number.isFinite(value)) return "–";
  if (Number.isInteger(value) && Math.abs(value) < 1e6) return String(value).replace("-", "−");
  const size = Math.abs(value);
  const text = size !== 0 && (size >= 1e6 || size < 1e-4)
    ? value.toExponential(digits - 1).replace(/\.?0+e/, "e")
    : String(Number(value.toPrecision(digits)));
  return text.replaceAll("-", "−");
}

/**
 * A bracket [lo, hi] with as many digits as tell its ends apart.
 * @param {[number | null, number | null]} bracket
 */
export function shownBracket(bracket) {
  const [low, high] = bracket;
  if (low === null && high === null) return "no bracket";
  if (low === null || high === null) return `[${low === null ? "unproven" : shown(low, 7)}, ${high === null ? "unproven" : shown(high, 7)}]`;
  const width = Math.abs(high - low) / Math.max(Math.abs(low), Math.abs(high), 1e-300);
  const digits = width > 0 ? Math.min(14, Math.max(5, Math.ceil(-Math.log10(width)) + 2)) : 7;
  return `[${shown(low, digits)}, ${shown(high, digits)}]`;
}

/**
 * Hand a file to the reader, made here and now.
 * @param {string} name
 * @param {string} kind
 * @param {BlobPart} content
 */
export function save(name, kind, content) {
  const address = URL.createObjectURL(new Blob([content], { type: kind }));
  const link = el("a", { href: address, download: name });
  document.body.append(link);
  link.click();
  link.remove();
  setTimeout(() => URL.revokeObjectURL(address), 2000);
}

/** @param {string} text what a screen reader says now */
export function say(text) {
  byId("news").textContent = text;
}
