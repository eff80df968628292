// @ts-check
/** Joints that are dragged: which vertices may move and how, and the structure with vertices at other places. */

/** @typedef {import("./contract.js").Structure} Structure */
/** @typedef {import("./contract.js").Point} Point */
/** @typedef {Record<string, Point>} Vertices places of the vertices that moved, by number */
/**
 * @typedef {object} Joints what the core says of the vertices of a structure
 * @property {Point[]} places of all vertices at the start
 * @property {number[][]} loops vertices around each element
 * @property {[number, number][]} ends vertices of each face
 * @property {Record<string, {direction?: Point, circle?: Point}>} paths how a vertex moves; freely if neither is given
 * @property {Record<string, [number, number][]>} ties vertices that move with one, and the factor on x
 */

/**
 * @param {Joints} joints
 * @param {Vertices} vertices
 * @param {number} vertex
 */
export function placeOf(joints, vertices, vertex) {
  return vertices[vertex] ?? joints.places[vertex];
}

/**
 * The vertices of dry faces that may move, with their places.
 * @param {Joints} joints
 * @param {Vertices} vertices
 * @param {string} labelling
 */
export function handlesOf(joints, vertices, labelling) {
  const dry = new Set(joints.ends.filter((_, k) => labelling[k] === "d").flat());
  return [...dry].filter((vertex) => vertex in joints.paths).sort((a, b) => a - b).map((vertex) => ({ vertex, place: placeOf(joints, vertices, vertex) }));
}

/**
 * The places after a vertex was dragged to a point, as far as its path and its ties let it.
 * @param {Joints} joints
 * @param {Vertices} from places when the drag began
 * @param {number} vertex
 * @param {Point} point
 * @returns {Vertices}
 */
export function dragged(joints, from, vertex, point) {
  const start = placeOf(joints, from, vertex);
  const { direction, circle } = joints.paths[vertex];
  let end = point;
  if (direction) {
    const along = (point[0] - start[0]) * direction[0] + (point[1] - start[1]) * direction[1];
    end = [start[0] + along * direction[0], start[1] + along * direction[1]];
  } else if (circle) {
    const radius = Math.hypot(start[0] - circle[0], start[1] - circle[1]);
    const far = Math.hypot(point[0] - circle[0], point[1] - circle[1]);
    if (!far) return from;
    end = [circle[0] + ((point[0] - circle[0]) * radius) / far, circle[1] + ((point[1] - circle[1]) * radius) / far];
  }
  /** @type {Vertices} */
  const found = { ...from, [vertex]: end };
  for (const [other, factor] of joints.ties[vertex] ?? []) {
    const place = placeOf(joints, from, other);
    found[other] = [place[0] + factor * (end[0] - start[0]), place[1] + end[1] - start[1]];
  }
  return found;
}

/**
 * The structure with its vertices at other places; centroids and weights are those of the last answer.
 * @param {Structure} first as the core sent it
 * @param {Joints} joints
 * @param {Vertices} vertices
 * @returns {Structure}
 */
export function placed(first, joints, vertices) {
  if (!Object.keys(vertices).length) return first;
  const at = (/** @type {number} */ vertex) => placeOf(joints, vertices, vertex);
  const moved = (/** @type {number} */ vertex) => vertex in vertices;
  const elements = first.elements.map((element, k) => {
    if (!joints.loops[k].some(moved)) return element;
    const shape = joints.loops[k].map(at);
    return { ...element, shape, centroid: centroidOf(shape) };
  });
  const faces = first.faces.map((face, k) => {
    if (!joints.ends[k].some(moved)) return face;
    const [p, q] = joints.ends[k].map(at);
    const old = joints.ends[k].map((vertex) => joints.places[vertex]);
    const length = Math.hypot(q[0] - p[0], q[1] - p[1]) || 1;
    const before = Math.hypot(old[1][0] - old[0][0], old[1][1] - old[0][1]);
    // vertices run so that the normal, from the first element to the second, lies to their right
    const normal = [(q[1] - p[1]) / length, (p[0] - q[0]) / length];
    return { ...face, polygon: [p, q], origin: [(p[0] + q[0]) / 2, (p[1] + q[1]) / 2], normal, area: (face.area * length) / before };
  });
  const edges = first.edges.map((edge) => {
    const [i, j] = [edge.from, edge.to].map((point) => nearest(joints, joints.loops[edge.element], point));
    return moved(i) || moved(j) ? { ...edge, from: at(i), to: at(j) } : edge;
  });
  return { ...first, elements, faces, edges };
}

/** @param {Joints} joints @param {number[]} loop @param {Point} point */
function nearest(joints, loop, point) {
  const far = (/** @type {number} */ v) => Math.hypot(joints.places[v][0] - point[0], joints.places[v][1] - point[1]);
  return loop.reduce((best, vertex) => (far(vertex) < far(best) ? vertex : best));
}

/** @param {Point[]} shape @returns {Point} */
function centroidOf(shape) {
  let [area, x, y] = [0, 0, 0];
  const [x0, y0] = shape[0]; // sums about a corner keep their digits far from the origin
  shape.forEach((p, k) => {
    const q = shape[(k + 1) % shape.length];
    const turn = (p[0] - x0) * (q[1] - y0) - (q[0] - x0) * (p[1] - y0);
    area += turn;
    x += (p[0] + q[0] - 2 * x0) * turn;
    y += (p[1] + q[1] - 2 * y0) * turn;
  });
  return area ? [x0 + x / (3 * area), y0 + y / (3 * area)] : shape[0];
}
