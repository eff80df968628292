// @ts-check
/** A planar structure as SVG: labels, forces or mechanism of one layout. */
import { shown, svg } from "./dom.js";
import { coloursOf, goneOf } from "./blocks.js";
import { arrowPath, markNode, ramp, turnPath } from "./marks.js";

/** @typedef {import("./contract.js").PageData} PageData */
/** @typedef {import("./contract.js").CaseSolution} CaseSolution */
/** @typedef {import("./contract.js").Point} Point */
/**
 * @typedef {object} Drawing what a figure is asked to show
 * @property {string} labelling
 * @property {"labels" | "forces" | "mechanism"} view
 * @property {CaseSolution | null} solved
 * @property {import("./contract.js").Load[]} loads
 * @property {Record<string, boolean>} show ids, values, thrust
 * @property {Set<number>} marked faces that differ from another layout, or are no segmentation
 * @property {number} [current] face under the keyboard
 * @property {{vertex: number, place: Point}[]} [handles] vertices that can be dragged
 */

/** Longest side of the paper, px, before the page scales it. */
const PAPER = 760;

export class PlanarFigure {
  /**
   * @param {HTMLElement} host
   * @param {PageData} data
   */
  constructor(host, data) {
    this.host = host;
    this.data = data;
    const { structure } = data;
    const points = [...structure.elements.flatMap((element) => element.shape), ...structure.fill.flat()];
    const reach = 0.15 * structure.size;
    const tips = data.loads.flatMap((load) => (load.kind === "live" ? [load.at, back(load, reach)] : load.kind === "body" ? [beside(structure, load, 0.19).foot] : []));
    const all = [...points, ...tips];
    const [low, high] = [0, 1].map((axis) => all.map((p) => p[axis])).reduce(
      ([a, b], values) => [[...a, values.reduce((x, y) => Math.min(x, y))], [...b, values.reduce((x, y) => Math.max(x, y))]],
      /** @type {[number[], number[]]} */ ([[], []]),
    );
    const margin = 0.12 * structure.size; // as far as a mechanism is drawn
    this.low = [low[0] - margin, low[1] - margin];
    this.high = [high[0] + margin, high[1] + margin];
    const span = [this.high[0] - this.low[0], this.high[1] - this.low[1]];
    this.k = Math.min(PAPER / span[0], (0.8 * PAPER) / span[1]);
    this.wide = span[0] * this.k;
    this.high_px = span[1] * this.k;
    this.typical = structure.typical * this.k;
    this.root = svg("svg", { viewBox: `0 0 ${this.wide} ${this.high_px}`, role: "img", class: "figure", tabindex: 0 });
    this.node = this.root;
    host.replaceChildren(this.root);
    /** @type {[number, number, number, number]} */
    this.box = [0, 0, this.wide, this.high_px];
    this.#zoomable();
    new ResizeObserver(() => this.#legible()).observe(this.root);
    /** @type {any[]} */
    this.groups = [];
    this.hatch = `hatch${Math.random().toString(36).slice(2)}`;
  }

  /** Scene to paper. @param {Point} p @returns {[number, number]} */
  at(p) {
    return [(p[0] - this.low[0]) * this.k, (this.high[1] - p[1]) * this.k];
  }

  /**
   * Paper to scene, from a pointer.
   * @param {PointerEvent | MouseEvent} event
   * @param {DOMMatrix} [screen] paper to screen when a drag began, since texts above may push the paper on meanwhile
   * @returns {Point}
   */
  under(event, screen) {
    const place = new DOMPoint(event.clientX, event.clientY).matrixTransform((screen ?? this.root.getScreenCTM()).inverse());
    return [place.x / this.k + this.low[0], this.high[1] - place.y / this.k];
  }

  /** @param {Drawing} what */
  draw(what) {
    const { look, structure } = this.data;
    const { labelling, view, solved, show } = what;
    this.what = what;
    const colours = coloursOf(structure, labelling, look.tints.length);
    const thick = clamp(0.07 * this.typical, 1.4, 4.2);
    const thin = clamp(0.035 * this.typical, 0.9, 1.8);
    const forces = view === "forces" && solved?.forces ? solved : null;
    const moving = view === "mechanism" && solved?.mechanism ? solved : null;
    const gone = goneOf(structure, labelling);
    /** @type {any[]} */
    const groups = structure.elements.map((element, k) => {
      if (gone.has(k)) return svg("g", { class: "element" }, svg("g"));
      const fill = element.support ? `url(#${this.hatch})` : view === "forces" ? look.plain : look.tints[colours[k]];
      return svg("g", { class: "element" }, svg("polygon", { points: this.#line(element.shape), fill, "data-element": k }));
    });
    this.groups = groups;
    for (const edge of structure.edges) {
      if (gone.has(edge.element)) continue;
      groups[edge.element].append(this.#segment(edge.from, edge.to, { stroke: look.soft, "stroke-width": thin }));
    }
    structure.faces.forEach((face, k) => {
      const dry = labelling[k] === "d";
      if (labelling[k] === "v") {
        for (const side of face.elements) {
          if (!gone.has(side)) groups[side].append(this.#segment(face.polygon[0], face.polygon[1], { stroke: look.soft, "stroke-width": thin }));
        }
        return;
      }
      const used = forces?.utilisation ? forces.utilisation[k] : null;
      const style = {
        stroke: used !== null ? ramp(look.used, used) : dry ? look.ink : look.soft,
        "stroke-width": used !== null ? thick * (0.6 + 1.15 * used) : dry ? thick : thin,
        "stroke-dasharray": dry ? null : look.inner_dash.map((d) => d * thin * 1.6).join(" "),
        class: dry ? "dry" : "inner",
      };
      const sides = moving ? face.elements : [face.elements[1]];
      for (const side of sides) {
        if (what.marked.has(k)) groups[side].append(this.#segment(face.polygon[0], face.polygon[1], { class: "differs", "stroke-width": 3.4 * thick }));
        groups[side].append(this.#segment(face.polygon[0], face.polygon[1], style));
        if (what.current === k) groups[side].append(this.#segment(face.polygon[0], face.polygon[1], { class: "current", "stroke-width": 2.2 * thick + 4 }));
      }
      if (dry && !moving && this.typical > 20) {
        const arm = 1.2 * thick + 2;
        const [x, y] = this.at(face.origin);
        groups[face.elements[1]].append(svg("line", {
          x1: x - arm * face.normal[0], y1: y + arm * face.normal[1], x2: x + arm * face.normal[0], y2: y - arm * face.normal[1],
          stroke: style.stroke, "stroke-width": 0.5 * thick,
        }));
      }
      groups[face.elements[1]].append(this.#segment(face.polygon[0], face.polygon[1], { class: "touch", "data-face": k, "stroke-width": clamp(0.3 * this.typical, 7, 16) }));
    });
    // whatever lies on a face shall not be hidden by a neighbour's fill
    const soil = structure.fill.map((outline) => svg("polygon", { points: this.#line(outline), fill: `url(#${this.hatch}-fill)`, class: "fill" }, svg("title", {}, "fill")));
    const fills = groups.map((group, k) => {
      const own = svg("g", {}, group.firstChild);
      return own;
    });
    this.pairs = groups.map((group, k) => [fills[k], group]);
    const rest = moving ? svg("g", { class: "rest" }, structure.elements.filter((e, k) => !e.support && !gone.has(k)).map((e) => svg("polygon", { points: this.#line(e.shape), fill: "none", stroke: look.rest, "stroke-width": 0.9 }))) : null;
    const over = svg("g", { class: "over" });
    if (forces) this.#forces(over, forces, labelling, show);
    if (view !== "mechanism") this.#loads(over, what.loads, show);
    this.members = svg("g", { class: "over" });
    this.#members(forces, show, null);
    this.movements = svg("g", { class: "over" });
    this.root.replaceChildren(
      svg("title", {}, title(this.data.title, view)),
      svg("defs", {}, svg("pattern", { id: this.hatch, width: 7, height: 7, patternUnits: "userSpaceOnUse", patternTransform: "rotate(45)" },
        svg("rect", { width: 7, height: 7, fill: look.support }), svg("line", { x1: 0, y1: 0, x2: 0, y2: 7, stroke: look.hatch, "stroke-width": 1.4 })),
        svg("pattern", { id: `${this.hatch}-fill`, width: 7, height: 7, patternUnits: "userSpaceOnUse" }, svg("circle", { cx: 2, cy: 2, r: 1, fill: look.hatch }))),
      ...[...soil, ...fills, rest, ...groups, this.members, over, this.movements].filter(Boolean),
    );
    if (show.ids) this.#ids(over);
    for (const { vertex, place } of what.handles ?? []) {
      const [cx, cy] = this.at(place);
      over.append(svg("circle", { cx, cy, r: clamp(0.09 * this.typical, 4, 9), class: "handle", "data-vertex": vertex }));
    }
    this.#scaleBar();
    this.move(1);
  }

  /** Displace the elements by a share of what the mechanism is drawn with. @param {number} share 0 … 1 */
  move(share) {
    const solved = this.what?.view === "mechanism" ? this.what.solved : null;
    const { look, structure } = this.data;
    if (!solved?.mechanism || !this.pairs) return;
    const s = solved.scale * share;
    const { mechanism } = solved;
    const maps = structure.elements.map((element, k) => {
      const [ux, uy, turn] = mechanism[k];
      const [x, y] = this.at(element.centroid);
      return [1, -s * turn, s * turn, 1, this.k * s * ux - s * turn * y, -this.k * s * uy + s * turn * x];
    });
    maps.forEach((m, k) => this.pairs?.[k].forEach((/** @type {any} */ group) => group.setAttribute("transform", `matrix(${m.join(" ")})`)));
    const nodes = (solved.movements ?? []).flatMap((kind, k) => {
      const mark = look.movements[kind];
      if (!mark || !solved.places) return [];
      const [x, y] = this.at(solved.places[k]);
      const [i, j] = structure.faces[k].elements.map((side) => {
        const m = maps[side];
        return [m[0] * x + m[2] * y + m[4], m[1] * x + m[3] * y + m[5]];
      });
      return [markNode(mark, (i[0] + j[0]) / 2, (i[1] + j[1]) / 2, clamp(0.09 * this.typical, 3.2, 7), { "data-face": k })];
    });
    this.movements.replaceChildren(...nodes);
    this.#members(null, {}, maps);
  }

  /**
   * Ties, tendons and pins, with their forces where these are known.
   * @param {CaseSolution | null} solved @param {Record<string, boolean>} show @param {number[][] | null} maps of the elements
   */
  #members(solved, show, maps) {
    const { look, structure } = this.data;
    const values = solved?.members ?? null;
    const largest = Math.max(1e-300, ...(values ?? []).map(Math.abs));
    const nodes = structure.members.flatMap((member, k) => {
      const places = member.points.map((point, i) => {
        const [x, y] = this.at(point);
        const m = maps?.[member.elements[i]];
        return m ? [m[0] * x + m[2] * y + m[4], m[1] * x + m[3] * y + m[5]] : [x, y];
      });
      const width = clamp(0.05 * this.typical, 1.2, 3) * (values ? 1 + Math.abs(values[k]) / largest : 1);
      const text = values ? `${member.name}: ${shown(values[k], 4)} ${structure.units.force}` : member.name;
      const line = svg("polyline", { points: places.map((p) => p.map((v) => v.toFixed(2)).join(",")).join(" "), fill: "none", stroke: look.member, "stroke-width": width, class: "member" }, svg("title", {}, text));
      const held = member.kind === "fill" ? places.slice(0, 1) : places; // the other end stands for soil
      const ends = held.map(([x, y]) => svg("circle", { cx: x, cy: y, r: 0.9 * width + 1.2, fill: look.member }));
      const [[x, y], [u, v]] = [places[(places.length - 1) >> 1], places[places.length >> 1]];
      return [line, ...ends, ...(values && show.values ? [label(0.5 * (x + u) + 5, 0.5 * (y + v) - 5, shown(values[k], 3))] : [])];
    });
    this.members.replaceChildren(...nodes);
  }

  /** @param {any} over @param {CaseSolution} solved @param {string} labelling @param {Record<string, boolean>} show */
  #forces(over, solved, labelling, show) {
    const { look, structure } = this.data;
    const { pressure, vectors, forces, utilisation, on_face: onFace } = solved;
    if (!pressure || !vectors || !forces || !utilisation || !onFace) return;
    const sizes = vectors.map((v) => Math.hypot(...v));
    const largest = Math.max(0, ...sizes);
    if (show.thrust) {
      for (const piece of solved.thrust) {
        over.append(svg("polyline", { points: this.#line(piece), fill: "none", stroke: look.thrust, "stroke-width": 2.2, "stroke-dasharray": look.thrust_dash.map((d) => 2 * d).join(" "), class: "thrust" }));
      }
    }
    const seen = sizes.filter((size) => size > look.small * largest).sort((a, b) => a - b);
    const median = seen.length ? seen[seen.length >> 1] : 1;
    const longest = clamp((0.35 * largest) / median, 0.85, 2) * this.typical;
    const shaft = clamp(0.045 * this.typical, 1, 2.6);
    structure.faces.forEach((face, k) => {
      const size = sizes[k];
      const [x, y] = this.at(pressure[k]);
      if (size > look.small * largest) {
        const half = [(0.5 * longest * vectors[k][0]) / largest, (-0.5 * longest * vectors[k][1]) / largest];
        const pulls = forces[k][0] < 0;
        over.append(svg("path", {
          d: arrowPath([x - half[0], y - half[1]], [x + half[0], y + half[1]], shaft), class: "force", "data-face": k,
          fill: pulls ? "#ffffff" : look.press, stroke: pulls ? look.press : "none", "stroke-width": 1,
        }));
        if (show.values) over.append(label(x + 5, y - 5, shown(size, 3)));
      }
      if (!onFace[k] && Math.abs(forces[k][2]) > look.small * largest * structure.typical) {
        over.append(svg("path", { d: turnPath([x, y], clamp(0.1 * this.typical, 4, 8), forces[k][2]), fill: "none", stroke: look.press, "stroke-width": 1.4 }));
      }
      if (utilisation[k] >= look.yields) {
        const along = [face.polygon[1][0] - face.polygon[0][0], face.polygon[1][1] - face.polygon[0][1]];
        const side = (pressure[k][0] - face.origin[0]) * along[0] + (pressure[k][1] - face.origin[1]) * along[1] > 0 ? -0.3 : 0.3;
        const [mx, my] = this.at([face.origin[0] + side * along[0], face.origin[1] + side * along[1]]);
        over.append(markNode(look.yielding[labelling[k] === "d" ? "dry" : "inner"], mx, my, clamp(0.07 * this.typical, 3, 6.5), { "data-face": k }));
      }
    });
  }

  /** @param {any} over @param {import("./contract.js").Load[]} loads @param {Record<string, boolean>} show */
  #loads(over, loads, show) {
    const { look, structure } = this.data;
    const length = 0.13 * structure.size;
    const most = Math.max(1e-300, ...loads.filter((l) => l.kind === "live").map((l) => Math.hypot(...l.vector)));
    loads.forEach((load) => {
      const tip = load.kind === "body" ? beside(structure, load, 0.04).tip : load.at;
      if (load.kind === "couple") {
        const [x, y] = this.at(tip);
        over.append(svg("path", { d: turnPath([x, y], 11, load.vector[0]), fill: "none", stroke: look.load, "stroke-width": 2.2, "data-load": this.data.loads.indexOf(load) }));
        if (show.values) over.append(label(x + 13, y, `${shown(load.vector[0], 3)} × λ`, "load"));
        return;
      }
      const share = load.kind === "body" ? length / Math.hypot(...load.vector) : length / most;
      const foot = [tip[0] - share * load.vector[0], tip[1] - share * load.vector[1]];
      over.append(svg("path", { d: arrowPath(this.at(foot), this.at(tip), load.kind === "body" ? 5 : 3), fill: look.load, class: "load", "data-load": this.data.loads.indexOf(load) }));
      if (show.values) {
        const [x, y] = this.at(foot);
        over.append(label(x + 6, y + 4, `${shown(Math.hypot(...load.vector), 3)} × λ`, "load"));
      }
    });
  }

  /** @param {any} over */
  #ids(over) {
    for (const element of this.data.structure.elements) {
      const [x, y] = this.at(element.centroid);
      over.append(label(x, y + 4, element.id, "id"));
    }
  }

  #scaleBar() {
    const { size, units } = this.data.structure;
    const length = roundLength(0.2 * size);
    const [x, y] = [12, this.high_px - 10];
    this.root.append(svg("g", { class: "scalebar" },
      svg("path", { d: `M${x},${y - 4}v8M${x},${y}h${length * this.k}M${x + length * this.k},${y - 4}v8` }),
      svg("text", { x: x + length * this.k + 6, y: y + 4 }, `${shown(length)} ${units.length}`)));
  }

  /** @param {Point[]} points */
  #line(points) {
    return points.map((p) => this.at(p).map((v) => v.toFixed(2)).join(",")).join(" ");
  }

  /** @param {Point} from @param {Point} to @param {Record<string, any>} style */
  #segment(from, to, style) {
    const [[x1, y1], [x2, y2]] = [this.at(from), this.at(to)];
    return svg("line", { x1, y1, x2, y2, ...style });
  }

  /** Texts keep their size on the screen where the page makes the paper smaller. */
  #legible() {
    const { width, height } = this.root.getBoundingClientRect();
    if (!width || !height) return;
    const per = Math.max(this.wide / width, this.high_px / height);
    this.root.style.setProperty("--per-px", String(clamp(per, 1, 3)));
  }

  #zoomable() {
    const set = () => this.root.setAttribute("viewBox", this.box.join(" "));
    this.root.addEventListener("wheel", (/** @type {WheelEvent} */ event) => {
      if (!event.ctrlKey && !event.shiftKey) return; // the page scrolls; Ctrl or Shift and the wheel zoom
      event.preventDefault();
      const place = new DOMPoint(event.clientX, event.clientY).matrixTransform(this.root.getScreenCTM().inverse());
      this.#zoom(event.deltaY + event.deltaX > 0 ? 1.2 : 1 / 1.2, place.x, place.y);
    }, { passive: false });
    this.root.addEventListener("keydown", (/** @type {KeyboardEvent} */ event) => {
      const [x, y, w, h] = this.box;
      if (event.key === "+" || event.key === "=") this.#zoom(1 / 1.3, x + w / 2, y + h / 2);
      else if (event.key === "-") this.#zoom(1.3, x + w / 2, y + h / 2);
      else if (event.key === "0") this.box = [0, 0, this.wide, this.high_px];
      else return;
      event.preventDefault();
      set();
    });
  }

  /** @param {number} by @param {number} x @param {number} y */
  #zoom(by, x, y) {
    const [x0, y0, w, h] = this.box;
    const factor = clamp(w * by, this.wide / 30, this.wide) / w;
    this.box = factor * w >= this.wide * 0.999 ? [0, 0, this.wide, this.high_px] : [x - (x - x0) * factor, y - (y - y0) * factor, w * factor, h * factor];
    this.root.setAttribute("viewBox", this.box.join(" "));
  }

  /**
   * What lies under the pointer.
   * @param {PointerEvent | MouseEvent} event
   * @returns {{face?: number, element?: number, load?: number, vertex?: number} | null}
   */
  pick(event) {
    const { face, element, load, vertex } = /** @type {SVGElement | null} */ (document.elementFromPoint(event.clientX, event.clientY))?.dataset ?? {};
    if (vertex !== undefined) return { vertex: Number(vertex) };
    if (face !== undefined) return { face: Number(face) };
    if (load !== undefined) return { load: Number(load) };
    return element === undefined ? null : { element: Number(element) };
  }

  /** The picture as a file. */
  takeaway() {
    return { name: "layout.svg", kind: "image/svg+xml", content: this.text() };
  }

  /** A picture of what is shown, as SVG text. */
  text() {
    const copy = /** @type {Element} */ (this.root.cloneNode(true));
    copy.setAttribute("xmlns", "http://www.w3.org/2000/svg");
    copy.setAttribute("width", this.wide.toFixed(0));
    copy.setAttribute("height", this.high_px.toFixed(0));
    for (const hidden of copy.querySelectorAll(".touch, .handle")) hidden.remove();
    for (const node of copy.querySelectorAll("text")) {
      node.setAttribute("font-family", "sans-serif");
      node.setAttribute("font-size", "12");
    }
    for (const node of copy.querySelectorAll(".scalebar path")) {
      node.setAttribute("fill", "none");
      node.setAttribute("stroke", this.data.look.soft);
    }
    return new XMLSerializer().serializeToString(copy);
  }

  dispose() {
    this.root.remove();
  }
}

/** @param {string} name @param {string} view */
export function title(name, view) {
  return `${name}: ${view}`;
}

/** @param {number} x @param {number} y @param {string} text @param {string} [kind] */
function label(x, y, text, kind = "value") {
  return svg("text", { x, y, class: `note ${kind}` }, text);
}

/** @param {import("./contract.js").Load} load @param {number} length */
function back(load, length) {
  const size = Math.hypot(...load.vector) || 1;
  return load.at.map((x, k) => x - (length * load.vector[k]) / size);
}

/**
 * Where the arrow of a load on all bodies stands: outside the structure, against its direction.
 * @param {import("./contract.js").Structure} structure @param {import("./contract.js").Load} load @param {number} gap share of the size
 */
export function beside(structure, load, gap) {
  const size = Math.hypot(...load.vector) || 1;
  const along = load.vector.map((v) => v / size);
  const points = structure.elements.flatMap((element) => element.shape);
  const low = along.map((_, k) => points.reduce((m, p) => Math.min(m, p[k]), Infinity));
  const high = along.map((_, k) => points.reduce((m, p) => Math.max(m, p[k]), -Infinity));
  const leave = Math.min(...along.map((a, k) => (a === 0 ? Infinity : (0.5 * (high[k] - low[k])) / Math.abs(a))));
  const tip = along.map((a, k) => 0.5 * (low[k] + high[k]) - a * (leave + gap * structure.size));
  return { tip, foot: tip, along };
}

/** 1, 2 or 5 times a power of ten, no longer than asked. @param {number} most */
export function roundLength(most) {
  const power = 10 ** Math.floor(Math.log10(most));
  return Math.max(...[1, 2, 5].map((step) => step * power).filter((length) => length <= most));
}

/** @param {number} value @param {number} low @param {number} high */
export function clamp(value, low, high) {
  return Math.min(Math.max(value, low), high);
}
