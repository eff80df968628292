// @ts-check
/** λ against a count: every layout a mark by its evidence; wheel zooms, drag brushes, click picks. */
import { el, shown } from "./dom.js";
import { Axes, extentOf, pageColours } from "./axes.js";
import { outline } from "./marks.js";

/** @typedef {import("./contract.js").Table} Table */

export class Scatter {
  /**
   * @param {HTMLElement} host
   * @param {Table} table
   * @param {import("./contract.js").Look} look
   * @param {{pick: (row: number) => void, compare: (row: number) => void, brush: (test: ((row: number) => boolean) | null) => void, across: (name: string) => void}} tell
   */
  constructor(host, table, look, tell) {
    this.table = table;
    this.look = look;
    this.tell = tell;
    const value = table.columns.find((column) => column.name === "load_factor");
    this.value = /** @type {(number | null)[]} */ (value?.values ?? []);
    this.count = table.count;
    this.selected = -1;
    this.compared = -1;
    /** @type {Set<number> | null} */
    this.passed = null;
    /** @type {{x: [number, number], y: [number, number]} | null} */
    this.box = null;
    this.brushing = false;
    this.canvas = el("canvas", { class: "scatter", tabindex: 0, role: "img" });
    this.tip = el("div", { class: "tip", hidden: true });
    this.axes = new Axes(this.canvas, { left: 66, right: 14, top: 10, bottom: 44 });
    this.choice = el("select", { "aria-label": "count across", onchange: (/** @type {any} */ e) => { this.setCount(e.target.value); tell.across(e.target.value); } },
      table.counts.map((name) => el("option", { value: name, selected: name === table.count }, this.#title(name))));
    const reset = el("button", { type: "button", class: "reset", onclick: () => this.reset() }, "whole picture");
    const drawn = (/** @type {string} */ name) => table.evidence.filter((e, row) => e === name && this.value[row] !== null && this.value[row] !== undefined).length;
    const without = table.rows - this.value.filter((v) => v !== null).length;
    const marks = Object.entries(look.evidence).filter(([name]) => drawn(name) > 0).map(([name, mark]) => {
      const key = el("canvas", { width: 14, height: 14, "aria-hidden": "true" });
      const pen = key.getContext("2d");
      this.#mark(pen, mark, 7, 7, name === "visited" ? 3 : 5, true);
      return el("li", {}, key, `${mark.meaning} (${drawn(name)})`);
    });
    host.replaceChildren(
      el("div", { class: "row" }, el("label", {}, `${this.#title("load_factor")} against `, this.choice), reset),
      el("div", { class: "plot" }, this.canvas, this.tip),
      el("ul", { class: "legend" }, marks),
      without ? el("p", { class: "hint" }, `${without} of ${table.rows} layouts have no ${this.#title("load_factor")}: the table says why.`) : "",
      el("p", { class: "hint" }, "Drag to choose a part, click a point to see its layout; Ctrl or Shift with the wheel zooms. Arrow keys go along the points."),
    );
    this.#listen();
    new ResizeObserver(() => this.draw()).observe(this.canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
    this.setCount(this.count);
  }

  /** @param {string} name */
  #title(name) {
    const column = this.table.columns.find((c) => c.name === name);
    return column ? column.title + (column.unit ? ` [${column.unit}]` : "") : name;
  }

  /** @param {string} name */
  setCount(name) {
    if (!this.table.columns.some((column) => column.name === name)) return;
    this.count = name;
    this.choice.value = name;
    this.across = /** @type {(number | null)[]} */ (this.table.columns.find((c) => c.name === name)?.values ?? []);
    this.points = this.value.flatMap((v, row) => (v !== null && typeof this.across?.[row] === "number" ? [row] : []));
    this.box = null;
    this.tell.brush(null);
    this.whole();
  }

  whole() {
    this.axes.x = extentOf((this.points ?? []).map((row) => /** @type {number} */ (this.across?.[row])), 0.05);
    this.axes.y = extentOf((this.points ?? []).map((row) => /** @type {number} */ (this.value[row])), 0.07);
    this.draw();
  }

  reset() {
    this.box = null;
    this.tell.brush(null);
    this.whole();
  }

  /** @param {number} row @param {number} compared */
  select(row, compared) {
    this.selected = row;
    this.compared = compared;
    this.draw();
  }

  /** @param {number[]} rows what the table lets through */
  filter(rows) {
    this.passed = rows.length === this.table.rows ? null : new Set(rows);
    this.draw();
  }

  /** @param {any} pen @param {import("./contract.js").Mark} mark @param {number} x @param {number} y @param {number} size @param {boolean} [onPaper] */
  #mark(pen, mark, x, y, size, onPaper = false) {
    const path = new Path2D(outline(mark.shape, x, y, size));
    // the key stands on white paper whatever the scheme
    const front = onPaper ? "" : pageColours().front;
    const colour = (/** @type {string} */ one) => (front && one === this.look.front ? front : one);
    pen.fillStyle = colour(mark.fill);
    pen.strokeStyle = colour(mark.edge);
    pen.lineWidth = 1.1;
    pen.fill(path);
    if (mark.edge !== mark.fill) pen.stroke(path);
  }

  draw() {
    const pen = this.axes.begin();
    const colours = pageColours();
    const column = this.table.columns.find((c) => c.name === this.count);
    this.axes.frame(pen, this.#title(this.count), `load factor ${this.#title("load_factor")} [–]`, { whole: column?.kind === "integer", ink: colours.ink, faint: colours.faint });
    const { x, y, w, h } = this.axes.inner;
    pen.save();
    pen.beginPath();
    pen.rect(x - 6, y - 6, w + 12, h + 12);
    pen.clip();
    const rows = this.points ?? [];
    if (!rows.length) {
      pen.fillStyle = colours.ink;
      pen.textAlign = "center";
      pen.fillText("no layout collapses at a finite load factor", x + w / 2, y + h / 2);
    }
    const many = rows.length > 3000;
    const inside = (/** @type {number} */ row) => (!this.passed || this.passed.has(row)) && (!this.box || this.#boxed(row));
    const dots = this.look.evidence.visited ?? Object.values(this.look.evidence)[0];
    for (const strong of [false, true]) {
      pen.globalAlpha = strong ? (many ? 0.45 : 0.8) : 0.12;
      pen.fillStyle = dots.fill;
      for (const row of rows) {
        if (this.table.evidence[row] !== "visited" || inside(row) !== strong) continue;
        const [px, py] = this.#at(row);
        pen.beginPath();
        pen.arc(px, py, many ? 2.2 : 3, 0, 7);
        pen.fill();
      }
    }
    pen.globalAlpha = 1;
    if (this.table.line && this.count === this.table.count) this.#front(pen, rows);
    for (const row of rows) {
      const name = this.table.evidence[row];
      if (name === "visited") continue;
      pen.globalAlpha = inside(row) ? 1 : 0.25;
      const [px, py] = this.#at(row);
      this.#mark(pen, this.look.evidence[name], px, py, 5.5);
    }
    pen.globalAlpha = 1;
    for (const [row, dash] of /** @type {[number, number[]][]} */ ([[this.compared, [3, 2]], [this.selected, []]])) {
      if (row < 0 || this.value[row] === null) continue;
      const [px, py] = this.#at(row);
      pen.strokeStyle = colours.accent;
      pen.lineWidth = 2.5;
      pen.setLineDash(dash);
      pen.beginPath();
      pen.arc(px, py, 9, 0, 7);
      pen.stroke();
      pen.setLineDash([]);
    }
    if (this.box) {
      pen.strokeStyle = colours.accent;
      pen.lineWidth = 1.2;
      pen.setLineDash([4, 3]);
      pen.strokeRect(this.axes.px(this.box.x[0]), this.axes.py(this.box.y[1]), this.axes.px(this.box.x[1]) - this.axes.px(this.box.x[0]), this.axes.py(this.box.y[0]) - this.axes.py(this.box.y[1]));
      pen.setLineDash([]);
    }
    pen.restore();
    const name = this.#title(this.count);
    this.canvas.setAttribute("aria-label", rows.length ? `Scatter of ${rows.length} layouts: load factor ${this.#title("load_factor")} against ${name}. ${this.#spoken(this.selected)}` : "Scatter of no layouts: none collapses at a finite load factor.");
  }

  /** @param {any} pen @param {number[]} rows */
  #front(pen, rows) {
    const best = rows.filter((row) => this.table.evidence[row] !== "visited")
      .sort((i, j) => /** @type {number} */ (this.across?.[i]) - /** @type {number} */ (this.across?.[j]));
    if (!best.length) return;
    pen.strokeStyle = pageColours().front || this.look.front;
    pen.lineWidth = 1.5;
    pen.beginPath();
    best.forEach((row, k) => {
      const [px, py] = this.#at(row);
      if (k === 0) return pen.moveTo(px, py);
      const [qx, qy] = this.#at(best[k - 1]);
      // between two counts the front has what the better side guarantees
      if (this.table.sense === "max") pen.lineTo(qx, py);
      else pen.lineTo(px, qy);
      pen.lineTo(px, py);
    });
    pen.stroke();
  }

  /** @param {number} row @returns {[number, number]} */
  #at(row) {
    return [this.axes.px(/** @type {number} */ (this.across?.[row])), this.axes.py(/** @type {number} */ (this.value[row]))];
  }

  /** @param {number} row */
  #boxed(row) {
    const [x, y] = [/** @type {number} */ (this.across?.[row]), this.value[row]];
    return this.box !== null && y !== null && x >= this.box.x[0] && x <= this.box.x[1] && y >= this.box.y[0] && y <= this.box.y[1];
  }

  /** @param {number} row */
  #spoken(row) {
    if (row < 0) return "None is chosen.";
    const rank = this.table.columns.find((c) => c.name === "rank")?.values[row];
    return `Chosen: rank ${rank ?? "none"}, λ ${shown(this.value[row])}, ${this.#title(this.count)} ${shown(this.across?.[row])}, ${this.table.evidence[row]}.`;
  }

  /** @param {number} x @param {number} y @returns {number} row nearest to a place, or −1 */
  near(x, y) {
    let [best, least] = [-1, 14 ** 2];
    for (const row of this.points ?? []) {
      if (this.passed && !this.passed.has(row)) continue;
      const [px, py] = this.#at(row);
      const far = (px - x) ** 2 + (py - y) ** 2 - (this.table.evidence[row] === "visited" ? 0 : 20);
      if (far < least) [best, least] = [row, far];
    }
    return best;
  }

  #listen() {
    /** @type {[number, number] | null} */
    let start = null;
    const place = (/** @type {MouseEvent} */ event) => {
      const box = this.canvas.getBoundingClientRect();
      return /** @type {[number, number]} */ ([event.clientX - box.left, event.clientY - box.top]);
    };
    this.canvas.addEventListener("pointerdown", (/** @type {PointerEvent} */ event) => {
      start = place(event);
      this.canvas.setPointerCapture(event.pointerId);
    });
    this.canvas.addEventListener("pointermove", (/** @type {PointerEvent} */ event) => {
      const [x, y] = place(event);
      if (start && Math.hypot(x - start[0], y - start[1]) > 5) {
        this.tip.hidden = true;
        const xs = [start[0], x].map((v) => this.axes.vx(v)).sort((a, b) => a - b);
        const ys = [start[1], y].map((v) => this.axes.vy(v)).sort((a, b) => a - b);
        this.box = { x: [xs[0], xs[1]], y: [ys[0], ys[1]] };
        this.draw();
        return;
      }
      const row = this.near(x, y);
      this.tip.hidden = row < 0;
      if (row < 0) return;
      this.tip.textContent = this.#spoken(row).replace("Chosen: ", "");
      this.tip.style.left = `${Math.min(x + 14, (this.axes.wide ?? 600) - 210)}px`;
      this.tip.style.top = `${y + 14}px`;
    });
    this.canvas.addEventListener("pointerup", (/** @type {PointerEvent} */ event) => {
      const [x, y] = place(event);
      const from = start;
      start = null;
      if (from && Math.hypot(x - from[0], y - from[1]) > 5) {
        this.tell.brush((row) => this.#boxed(row));
        return;
      }
      const row = this.near(x, y);
      if (row >= 0) (event.shiftKey || event.altKey ? this.tell.compare : this.tell.pick)(row);
      else if (this.box) {
        this.box = null;
        this.tell.brush(null);
        this.draw();
      }
    });
    this.canvas.addEventListener("pointerleave", () => { this.tip.hidden = true; });
    this.canvas.addEventListener("wheel", (/** @type {WheelEvent} */ event) => {
      if (!event.ctrlKey && !event.shiftKey) return;
      event.preventDefault();
      const [x, y] = place(event);
      const by = event.deltaY + event.deltaX > 0 ? 1.25 : 0.8;
      const [cx, cy] = [this.axes.vx(x), this.axes.vy(y)];
      this.axes.x = /** @type {[number, number]} */ (this.axes.x.map((v) => cx + (v - cx) * by));
      this.axes.y = /** @type {[number, number]} */ (this.axes.y.map((v) => cy + (v - cy) * by));
      this.draw();
    }, { passive: false });
    this.canvas.addEventListener("keydown", (/** @type {KeyboardEvent} */ event) => {
      const rows = (this.points ?? []).filter((row) => !this.passed || this.passed.has(row)).sort((i, j) =>
        /** @type {number} */ (this.across?.[i]) - /** @type {number} */ (this.across?.[j]) || /** @type {number} */ (this.value[i]) - /** @type {number} */ (this.value[j]));
      const at = rows.indexOf(this.selected);
      if (event.key === "ArrowRight" || event.key === "ArrowUp") this.tell.pick(rows[Math.min(at + 1, rows.length - 1)]);
      else if (event.key === "ArrowLeft" || event.key === "ArrowDown") this.tell.pick(rows[Math.max(at - 1, 0)]);
      else if (event.key === "0" || event.key === "Escape") this.reset();
      else return;
      event.preventDefault();
    });
  }
}
