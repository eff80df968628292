// @ts-check
/** The picture of a drawing before it is opened: every role has a colour, and a hatch, dash or text of its own. */
import { shown, svg } from "./dom.js";

/** Roles: words, fill, colour of lines, dashes. */
export const ROLES = /** @type {Record<string, [string, string, string, string]>} */ ({
  block: ["block or wall", "#ead9b8", "#5b4a2e", ""],
  support: ["ground (support)", "url(#ask-support)", "#333333", ""],
  hole: ["opening", "url(#ask-hole)", "#0b57a4", "10 4"],
  load: ["load", "none", "#b8321a", ""],
  dead: ["dead load", "none", "#7a2a6a", "6 3"],
  dry: ["dry joint", "none", "#00705a", "14 3"],
  inner: ["crack plane (inner face)", "none", "#7a2a6a", "3 3"],
  skip: ["ignored", "none", "#77756d", "1 4"],
  id: ["names of blocks", "none", "#77756d", "2 7"],
  unused: ["nothing became of it", "none", "#b35c00", "8 3 2 3"],
  doubtful: ["doubtful: an opening?", "url(#ask-doubtful)", "#7d5a00", ""],
});
const [WIDE, TALL, EDGE] = [900, 560, 74];
const MOST_NAMES = 60;

/** Patterns and the arrow head, which the page holds once. */
export function patterns() {
  const hatch = (/** @type {string} */ id, /** @type {string} */ ground, /** @type {any[]} */ ...lines) => svg("pattern", { id, width: 10, height: 10, patternUnits: "userSpaceOnUse" }, svg("rect", { width: 10, height: 10, fill: ground }), lines);
  const line = (/** @type {string} */ d, /** @type {string} */ stroke) => svg("path", { d, stroke, "stroke-width": 1.4, fill: "none" });
  const rising = "M -2 2 L 2 -2 M 0 10 L 10 0 M 8 12 L 12 8";
  return svg("svg", { class: "visually-hidden", "aria-hidden": "true" }, svg("defs", {},
    hatch("ask-support", "#d3d3d3", line(rising, "#333333")),
    hatch("ask-hole", "#ffffff", svg("circle", { cx: 5, cy: 5, r: 1.2, fill: "#0b57a4" })),
    hatch("ask-doubtful", "#ffe28a", line(rising, "#7d5a00"), line("M 0 0 L 10 10", "#7d5a00")),
    svg("marker", { id: "ask-arrow", viewBox: "0 0 10 10", refX: 9, refY: 5, markerWidth: 7, markerHeight: 7, orient: "auto-start-reverse" }, svg("path", { d: "M 0 0 L 10 5 L 0 10 z", fill: "#b8321a" }))));
}

/** What a role looks like, for the legend and the list of layers. @param {string} role */
export function swatch(role) {
  const [, fill, stroke, dashes] = ROLES[role] ?? ROLES.block;
  const node = svg("svg", { width: 30, height: 14, viewBox: "0 0 30 14", "aria-hidden": "true" });
  node.append(fill === "none" ? svg("line", { x1: 2, y1: 7, x2: 28, y2: 7, ...lineOf(role) }) : svg("rect", { x: 1, y: 1, width: 28, height: 12, fill, stroke, "stroke-dasharray": dashes || null }));
  return node;
}

/** @param {string} role */
function lineOf(role) {
  const [, , stroke, dashes] = ROLES[role] ?? ROLES.block;
  const arrow = role === "load" || role === "dead";
  return { stroke, "stroke-width": arrow || role === "dry" ? 2.6 : 1.4, "stroke-dasharray": dashes || null, "marker-end": arrow ? "url(#ask-arrow)" : null };
}

/** @param {any} found what the server understood */
export function rolesIn(found) {
  const all = [...found.shapes.map((/** @type {any} */ one) => one.role), ...found.marks.map((/** @type {any} */ one) => one.role)];
  for (const one of found.elements) all.push(one.doubtful ? "doubtful" : one.support ? "support" : "block");
  return Object.keys(ROLES).filter((role) => all.includes(role));
}

/**
 * Points of the file to those of the picture.
 * @param {number[][]} points
 */
function frame(points) {
  const [xs, ys] = [0, 1].map((k) => points.reduce(([least, most], p) => [Math.min(least, p[k]), Math.max(most, p[k])], [Infinity, -Infinity]));
  const scale = Math.min((WIDE - 2 * EDGE) / Math.max(xs[1] - xs[0], 1e-300), (TALL - 2 * EDGE) / Math.max(ys[1] - ys[0], 1e-300));
  const left = (WIDE - scale * (xs[1] - xs[0])) / 2;
  return { height: scale * (ys[1] - ys[0]) + 2 * EDGE, at: (/** @type {number[]} */ p) => [left + scale * (p[0] - xs[0]), EDGE + scale * (ys[1] - p[1])] };
}

/** @param {number[][]} points x, y and bulge, or x and y @param {boolean} closed @param {(p: number[]) => number[]} at */
function outlineOf(points, closed, at) {
  const place = points.map(at);
  let d = `M ${place[0].join(" ")}`;
  for (let k = 0; k < points.length - (closed ? 0 : 1); k++) {
    const [from, to, bulge] = [place[k], place[(k + 1) % points.length], points[k][2] ?? 0];
    const chord = Math.hypot(to[0] - from[0], to[1] - from[1]);
    const radius = bulge ? chord * (1 + bulge * bulge) / (4 * Math.abs(bulge)) : 0;
    d += bulge ? ` A ${radius} ${radius} 0 ${Math.abs(bulge) > 1 ? 1 : 0} ${bulge > 0 ? 0 : 1} ${to.join(" ")}` : ` L ${to.join(" ")}`;
  }
  return closed ? `${d} Z` : d;
}

/** @param {number[][]} places of the picture */
function boxOf(places) {
  const xs = places.map((p) => p[0]);
  const ys = places.map((p) => p[1]);
  const [x, y] = [Math.min(...xs), Math.min(...ys)];
  return { x, y, wide: Math.max(...xs) - x, tall: Math.max(...ys) - y };
}

/** @param {number[][]} places @param {string} text @param {string} [name] */
function inside(places, text, name = "note") {
  const box = boxOf(places);
  return box.wide < 8 * text.length || box.tall < 16 ? null : svg("text", { x: box.x + box.wide / 2, y: box.y + box.tall / 2 + 5, class: name }, text);
}

/** Width and height of all blocks, with their unit. @param {number[][]} places @param {any} found */
function measures(places, found) {
  if (!found.size) return [];
  const box = boxOf(places);
  const [bottom, right] = [box.y + box.tall + 16, box.x + box.wide + 16];
  const up = found.size.length - 1;
  const line = (/** @type {string} */ d) => svg("path", { d, stroke: "#1b1b1b", fill: "none" });
  return [
    line(`M ${box.x} ${bottom - 5} v 10 m 0 -5 h ${box.wide} m 0 -5 v 10`),
    svg("text", { x: box.x + box.wide / 2, y: bottom + 18, class: "note" }, `${shown(found.size[0], 3)} ${found.length}`),
    line(`M ${right - 5} ${box.y} h 10 m -5 0 v ${box.tall} m -5 0 h 10`),
    svg("text", { x: right + 6, y: box.y + box.tall / 2 + 5, class: "note start" }, `${shown(found.size[up], 3)} ${found.length}`),
  ];
}

/** Rings around the gaps that sentences name, which are in the unit of the file. @param {any} found @param {(p: number[]) => number[]} at */
function gaps(found, at) {
  const lines = [...found.report.map((/** @type {any} */ line) => line[1]), found.refused?.[0] ?? ""].filter((text) => /gaps?\b/.test(text));
  return lines.flatMap((text) => [...text.matchAll(/at \(([-\d.e+]+), ([-\d.e+]+)\)/g)]).map(([, x, y]) => {
    const [cx, cy] = at([Number(x), Number(y)]);
    return svg("g", {}, svg("circle", { cx, cy, r: 12, fill: "none", stroke: "#b8321a", "stroke-width": 2.4 }), svg("text", { x: cx + 15, y: cy - 8, class: "note start" }, "gap"));
  });
}

/** @param {any} found */
function planar(found) {
  const all = [...found.shapes.flatMap((/** @type {any} */ s) => s.points), ...found.elements.flatMap((/** @type {any} */ e) => e.outline), ...found.marks.map((/** @type {any} */ m) => m.at)];
  const { at, height } = frame(all);
  const holds = found.elements.length > 0;
  const drawn = found.elements.map((/** @type {any} */ one) => {
    const role = one.doubtful ? "doubtful" : one.support ? "support" : "block";
    const places = one.outline.map(at);
    const name = role === "doubtful" ? `${one.id}?` : role === "support" ? "ground" : found.elements.length <= MOST_NAMES ? one.id : "";
    return [svg("path", { d: outlineOf(one.outline, true, at), fill: ROLES[role][1], stroke: ROLES[role][2], "stroke-width": 1, "data-element": one.id }, svg("title", {}, `${one.id}: ${ROLES[role][0]}`)), name ? inside(places, name) : null];
  });
  const size = (/** @type {any} */ shape) => { const box = boxOf(shape.points); return shape.closed ? box.wide * box.tall : -1; };
  const shapes = [...found.shapes].sort((a, b) => size(b) - size(a)).map((shape) => {
    const words = ROLES[shape.role]?.[0] ?? shape.role;
    const fill = !shape.closed ? "none" : shape.role === "hole" || !holds ? ROLES[shape.role][1] : "none";
    const d = [outlineOf(shape.points, shape.closed, at), ...shape.holes.map((/** @type {number[][]} */ hole) => outlineOf(hole, true, at))].join(" ");
    const title = svg("title", {}, `${shape.layer || "(no layer)"}: ${words}`);
    const line = shape.role === "block" && holds ? { stroke: ROLES.block[2], "stroke-width": 1 } : lineOf(shape.role);
    return svg("g", { "data-layer": shape.layer, class: "shape" }, title,
      svg("path", { d, fill, "fill-rule": "evenodd", ...line }),
      svg("path", { d, fill: shape.closed ? "transparent" : "none", "fill-rule": "evenodd", class: "touch", "stroke-width": 9 }),
      shape.role === "hole" && shape.closed ? inside(shape.points.map(at), "opening") : null);
  });
  const box = holds ? found.elements.flatMap((/** @type {any} */ one) => one.outline.map(at)) : [];
  return { height, parts: [drawn, shapes, ...marks(found, at), gaps(found, at), holds ? measures(box, found) : []] };
}

/** @param {any} found @param {(p: number[]) => number[]} at */
function marks(found, at) {
  return found.marks.map((/** @type {any} */ mark) => {
    const [x, y] = at(mark.at);
    const end = mark.end ? at(mark.end) : null;
    const stroke = ROLES[mark.role]?.[2] ?? ROLES.block[2];
    return svg("g", { "data-layer": mark.layer, class: "shape" },
      end ? svg("line", { x1: x, y1: y, x2: end[0], y2: end[1], ...lineOf(mark.role) }) : svg("circle", { cx: x, cy: y, r: 3, fill: stroke }),
      mark.text ? svg("text", { x: x + 5, y: y - 5, class: "note start", fill: stroke }, mark.text) : null);
  });
}

/** Twice the area of a loop as a vector. @param {number[][]} points */
function areaOf(points) {
  return [0, 1, 2].map((k) => {
    const [i, j] = [(k + 1) % 3, (k + 2) % 3];
    return points.reduce((sum, p, n) => sum + p[i] * points[(n + 1) % points.length][j] - p[j] * points[(n + 1) % points.length][i], 0);
  });
}

/** @param {any} found @param {number} turn degrees about z */
function spatial(found, turn) {
  const [c, s] = [Math.cos(turn * Math.PI / 180), Math.sin(turn * Math.PI / 180)];
  const tilt = 0.45;
  // across, up, and away from the eye
  const seen = (/** @type {number[]} */ [x, y, z]) => [c * x - s * y, z * Math.cos(tilt) + (s * x + c * y) * Math.sin(tilt), (s * x + c * y) * Math.cos(tilt) - z * Math.sin(tilt)];
  const faces = found.shapes.flatMap((/** @type {any} */ shape) => {
    const corners = shape.corners.map(seen);
    return shape.faces.map((/** @type {number[]} */ loop) => ({ shape, points: loop.map((k) => corners[k]), away: loop.reduce((sum, k) => sum + corners[k][2], 0) / loop.length }));
  });
  const { at, height } = frame([...found.shapes.flatMap((/** @type {any} */ shape) => shape.corners), ...found.marks.map((/** @type {any} */ mark) => mark.at)].map(seen));
  faces.sort((/** @type {any} */ a, /** @type {any} */ b) => b.away - a.away);
  const drawn = faces.map((/** @type {any} */ { shape, points }) => {
    const [, fill, stroke, dashes] = ROLES[shape.role];
    const normal = areaOf(points);
    if (shape.outward && normal[2] < 0) return null; // turned away: the axes are left-handed
    const light = Math.abs(normal[1] * 0.8 + normal[0] * 0.6) / Math.max(Math.hypot(...normal), 1e-300);
    const d = outlineOf(points.map((/** @type {number[]} */ one) => one.slice(0, 2)), true, at);
    return svg("g", { "data-layer": shape.layer, class: "shape" }, svg("title", {}, `${shape.name || shape.layer || "(no layer)"}: ${ROLES[shape.role][0]}`),
      svg("path", { d, fill: fill === "none" ? "#ffffff" : fill, "fill-opacity": fill === "none" ? 0.2 : 1, stroke, "stroke-width": 0.8, "stroke-dasharray": dashes || null }),
      svg("path", { d, fill: "#000000", "fill-opacity": fill === "none" ? 0 : 0.22 * (1 - light), class: "touch" }));
  });
  return { height, parts: [drawn, ...marks(found, (/** @type {number[]} */ p) => at(seen(p)))] };
}

/**
 * @param {any} found what the server understood
 * @param {string} words for screen readers
 * @param {number} turn of solids, degrees
 */
export function pictureOf(found, words, turn) {
  const { height, parts } = found.planar ? planar(found) : spatial(found, turn);
  return svg("svg", { class: "figure understood", viewBox: `0 0 ${WIDE} ${height}`, role: "img", "aria-label": words }, parts);
}
