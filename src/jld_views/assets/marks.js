// @ts-check
/** Marks, ramps and legends: what the drawing rules from Python look like on a page. */
import { el, svg, shown } from "./dom.js";

/** @typedef {import("./contract.js").Look} Look */
/** @typedef {import("./contract.js").Mark} Mark */

/**
 * Outline of a mark about a point.
 * @param {Mark["shape"]} shape
 * @param {number} x
 * @param {number} y
 * @param {number} size half its height
 */
export function outline(shape, x, y, size) {
  const s = size;
  switch (shape) {
    case "diamond": return `M${x},${y - s}L${x + s},${y}L${x},${y + s}L${x - s},${y}Z`;
    case "thin diamond": return `M${x},${y - 1.3 * s}L${x + 0.75 * s},${y}L${x},${y + 1.3 * s}L${x - 0.75 * s},${y}Z`;
    case "triangle": return `M${x},${y - s}L${x + s},${y + 0.8 * s}L${x - s},${y + 0.8 * s}Z`;
    case "cross": {
      const [a, b] = [s, 0.45 * s];
      const steps = [[-a + b, -a], [0, -b], [a - b, -a], [a, -a + b], [b, 0], [a, a - b], [a - b, a], [0, b], [-a + b, a], [-a, a - b], [-b, 0], [-a, -a + b]];
      return `M${steps.map(([i, j]) => `${x + i},${y + j}`).join("L")}Z`;
    }
    default: return `M${x - s},${y}a${s},${s} 0 1 0 ${2 * s},0a${s},${s} 0 1 0 ${-2 * s},0Z`;
  }
}

/**
 * @param {Mark} mark
 * @param {number} x
 * @param {number} y
 * @param {number} size
 * @param {Record<string, any>} [more]
 */
export function markNode(mark, x, y, size, more = {}) {
  return svg("path", { d: outline(mark.shape, x, y, size), fill: mark.fill, stroke: mark.edge, "stroke-width": 1, ...more });
}

/**
 * Colour between the stops of a ramp.
 * @param {string[]} stops #rrggbb
 * @param {number} share 0 … 1
 */
export function ramp(stops, share) {
  const at = Math.min(Math.max(share, 0), 1) * (stops.length - 1);
  const low = Math.min(Math.floor(at), stops.length - 2);
  /** @param {string} text */
  const channels = (text) => [1, 3, 5].map((k) => parseInt(text.slice(k, k + 2), 16));
  const [from, to] = [channels(stops[low]), channels(stops[low + 1])];
  return `#${from.map((c, k) => Math.round(c + (at - low) * (to[k] - c)).toString(16).padStart(2, "0")).join("")}`;
}

/**
 * An arrow from foot to tip, px.
 * @param {number[]} foot
 * @param {number[]} tip
 * @param {number} width of the shaft
 */
export function arrowPath(foot, tip, width) {
  const [dx, dy] = [tip[0] - foot[0], tip[1] - foot[1]];
  const length = Math.hypot(dx, dy) || 1e-9;
  const [ux, uy] = [dx / length, dy / length];
  const head = Math.min(4.2 * width, 0.7 * length);
  const [half, wing] = [width / 2, 1.8 * width];
  const neck = [tip[0] - head * ux, tip[1] - head * uy];
  /** @param {number[]} p @param {number} side */
  const off = (p, side) => `${p[0] - side * uy},${p[1] + side * ux}`;
  return `M${off(foot, half)}L${off(neck, half)}L${off(neck, wing)}L${tip[0]},${tip[1]}L${off(neck, -wing)}L${off(neck, -half)}L${off(foot, -half)}Z`;
}

/**
 * A turning arrow about a point, px; counter-clockwise for `sense` > 0.
 * @param {number[]} at
 * @param {number} radius
 * @param {number} sense
 */
export function turnPath(at, radius, sense) {
  const [x, y] = at;
  const side = sense > 0 ? -1 : 1;
  const end = [x + side * 0.5 * radius, y - 0.87 * radius];
  const tip = [end[0] - side * 0.75 * radius, end[1] - 0.1 * radius];
  return `M${x + side * 0.5 * radius},${y + 0.87 * radius}A${radius},${radius} 0 1 ${side > 0 ? 1 : 0} ${end[0]},${end[1]}` +
    `M${tip[0] + side * 0.55 * radius},${tip[1] - 0.45 * radius}L${tip[0]},${tip[1]}L${tip[0] + side * 0.6 * radius},${tip[1] + 0.5 * radius}`;
}

/** @param {any[]} inside @param {string} text */
function entry(inside, text) {
  return el("li", {}, svg("svg", { viewBox: "0 0 28 14", width: 28, height: 14, "aria-hidden": "true" }, inside), text);
}

/** @param {Record<string, any>} look */
const line = (look) => svg("line", { x1: 2, y1: 7, x2: 26, y2: 7, ...look });

/**
 * What the signs of a view mean.
 * @param {Look} look
 * @param {{view: string, labelling: string, solved: import("./contract.js").CaseSolution | null, blocks: number,
 *   largest: number | null, unit: string, loads: Set<string>, thrust: boolean, differs: boolean, members: boolean}} what
 */
export function legend(look, what) {
  const { view, labelling, solved } = what;
  const items = [];
  const tint = view === "forces" ? look.plain : look.tints[0];
  if (view !== "forces") {
    items.push(entry([svg("rect", { x: 3, y: 1, width: 22, height: 12, fill: tint, stroke: look.soft })], what.blocks === 1 ? "1 block" : `${what.blocks} blocks, by tint`));
  }
  if (labelling.includes("d")) {
    items.push(entry([line({ stroke: look.ink, "stroke-width": 3 }), svg("line", { x1: 14, y1: 2, x2: 14, y2: 12, stroke: look.ink, "stroke-width": 1.4 })], "dry face"));
  }
  if (labelling.includes("i")) items.push(entry([line({ stroke: look.soft, "stroke-width": 1.6, "stroke-dasharray": "1.6 2.6" })], "inner face"));
  items.push(entry([svg("rect", { x: 3, y: 1, width: 22, height: 12, fill: look.support, stroke: look.hatch }), svg("path", { d: "M6,13L14,1M12,13L20,1M18,13L25,3", stroke: look.hatch })], "support"));
  if (what.members) items.push(entry([line({ stroke: look.member, "stroke-width": 3 }), svg("circle", { cx: 4, cy: 7, r: 3, fill: look.member }), svg("circle", { cx: 24, cy: 7, r: 3, fill: look.member })], "member"));
  const arrow = (/** @type {Record<string, any>} */ more) => svg("path", { d: arrowPath([2, 7], [26, 7], 2), ...more });
  if (what.loads.has("live")) items.push(entry([arrow({ fill: look.load })], "live load, × λ"));
  if (what.loads.has("body")) items.push(entry([svg("path", { d: arrowPath([2, 7], [26, 7], 3), fill: look.load })], "live load on all bodies, × λ"));
  if (what.loads.has("couple")) items.push(entry([svg("path", { d: turnPath([14, 7], 5, 1), fill: "none", stroke: look.load, "stroke-width": 1.4 })], "live couple, × λ"));
  if (view === "forces" && solved?.forces) {
    for (const share of [0, 0.5, 1]) {
      items.push(entry([line({ stroke: ramp(look.used, share), "stroke-width": 1.5 + 3 * share })], `utilisation ${share}`));
    }
    items.push(entry([arrow({ fill: look.press })], `pressing, longest ${shown(what.largest, 3)} ${what.unit}`));
    if (solved.forces.some((row) => row[0] < 0)) items.push(entry([arrow({ fill: "#ffffff", stroke: look.press })], "pulling (hollow)"));
    if (what.thrust && solved.thrust.length) items.push(entry([line({ stroke: look.thrust, "stroke-width": 2, "stroke-dasharray": look.thrust_dash.map((d) => 2 * d).join(" ") })], "thrust line"));
    for (const [name, letter] of [["dry", "d"], ["inner", "i"]]) {
      if (solved.utilisation?.some((u, k) => u >= look.yields && labelling[k] === letter)) {
        items.push(entry([markNode(look.yielding[name], 14, 7, 5)], look.yielding[name].meaning));
      }
    }
  }
  if (view === "mechanism" && solved?.mechanism) {
    items.push(entry([line({ stroke: look.rest, "stroke-width": 1 })], "at rest"));
    for (const [kind, mark] of Object.entries(look.movements)) {
      if (solved.movements?.includes(kind)) items.push(entry([markNode(mark, 14, 7, 5)], mark.meaning));
    }
  }
  if (what.differs) items.push(entry([line({ class: "differs", "stroke-width": 9 })], "labels differ between the two"));
  return el("ul", { class: "legend", "aria-label": "Legend" }, items);
}
