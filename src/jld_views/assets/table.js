// @ts-check
/** The table of all layouts: filtered and sorted by every column, drawn for the rows in sight only. */
import { el, shown } from "./dom.js";
import { filterOf, sorted } from "./filters.js";
import { bytesOf, lettersOf } from "./blocks.js";

/** @typedef {import("./contract.js").Table} Table */

const HEIGHT = 26; // px, as in page.css

export class LayoutTable {
  /**
   * @param {HTMLElement} host
   * @param {Table} table
   * @param {Uint8Array} bits
   * @param {number} faces
   * @param {{pick: (row: number) => void, compare: (row: number) => void, filtered: (rows: number[]) => void}} tell
   */
  constructor(host, table, bits, faces, tell) {
    Object.assign(this, { host });
    this.table = table;
    this.bits = bits;
    this.beside = bytesOf(table.beside);
    this.faces = faces;
    this.tell = tell;
    this.columns = [...table.columns.slice(0, 4), { name: "evidence", title: "evidence", unit: "", kind: /** @type {"text"} */ ("text"), values: table.evidence }, ...table.columns.slice(4)];
    /** @type {Record<string, string>} */
    this.wishes = {};
    /** @type {{name: string, down: boolean} | null} */
    this.order = null;
    /** @type {((row: number) => boolean) | null} */
    this.brush = null;
    this.selected = -1;
    this.compared = -1;
    this.rows = Array.from({ length: table.rows }, (_, k) => k);
    this.count = el("p", { class: "count", role: "status" });
    this.head = el("thead");
    this.body = el("tbody");
    this.grid = el("table", { role: "grid", "aria-label": "All layouts", "aria-multiselectable": "false" }, this.head, this.body);
    this.scroll = el("div", { class: "scroll", tabindex: 0, "aria-label": "Layouts; arrow keys move, Enter shows, C compares" }, this.grid);
    this.scroll.addEventListener("scroll", () => this.#fill());
    this.scroll.addEventListener("keydown", (/** @type {KeyboardEvent} */ event) => this.#key(event));
    host.replaceChildren(this.count, this.scroll);
    this.#heads();
    new ResizeObserver(() => this.#fill()).observe(this.scroll);
    this.refresh();
  }

  #heads() {
    const names = el("tr", { role: "row" });
    const fields = el("tr", { role: "row", class: "filters" });
    for (const column of [...this.columns, { name: "labelling", title: "labelling", unit: "", kind: "text" }]) {
      const unit = column.unit ? ` [${column.unit}]` : "";
      const button = el("button", { type: "button", title: column.name, onclick: () => this.sortBy(column.name) }, column.title + unit);
      names.append(el("th", { scope: "col", role: "columnheader", "aria-sort": "none", "data-column": column.name, class: column.kind }, button));
      fields.append(el("td", {}, el("input", {
        type: "text", "aria-label": `filter ${column.title}`, placeholder: column.kind === "text" ? "part" : ">, <, a..b", "data-filter": column.name,
        oninput: (/** @type {any} */ event) => { this.wishes[column.name] = event.target.value; this.refresh(); },
      })));
    }
    this.head.replaceChildren(names, fields);
  }

  /** @param {string} name */
  sortBy(name) {
    if (this.order?.name === name && this.order.down) this.order = null;
    else this.order = { name, down: this.order?.name === name };
    for (const th of this.head.querySelectorAll("th")) {
      const own = this.order?.name === th.dataset.column;
      th.setAttribute("aria-sort", own ? (this.order?.down ? "descending" : "ascending") : "none");
    }
    this.refresh();
  }

  /** @param {((row: number) => boolean) | null} brush what the picture lets through */
  setBrush(brush) {
    this.brush = brush;
    this.refresh();
  }

  /** @param {number} row @param {string} name */
  value(row, name) {
    if (name === "labelling") return lettersOf(this.bits, row, this.faces, this.beside);
    return this.columns.find((column) => column.name === name)?.values[row] ?? null;
  }

  refresh() {
    let rows = Array.from({ length: this.table.rows }, (_, k) => k);
    for (const field of this.head.querySelectorAll("input")) {
      const name = field.dataset.filter;
      const wish = this.wishes[name] ?? "";
      const column = this.columns.find((c) => c.name === name);
      const test = wish.trim() === "" ? undefined : filterOf(wish, column?.kind ?? "text");
      field.setAttribute("aria-invalid", String(test === null));
      if (!test) continue;
      rows = rows.filter((row) => test(column ? column.values[row] : lettersOf(this.bits, row, this.faces, this.beside)));
    }
    this.passed = rows;
    if (this.brush) rows = rows.filter(this.brush);
    const order = this.order;
    if (order) {
      const column = this.columns.find((c) => c.name === order.name);
      const values = column ? column.values : Array.from({ length: this.table.rows }, (_, k) => lettersOf(this.bits, k, this.faces, this.beside));
      rows = sorted(rows, values, order.down);
    }
    this.rows = rows;
    const all = this.table.rows;
    this.count.textContent = rows.length === all ? `${all} layouts` : `${rows.length} of ${all} layouts`;
    this.grid.setAttribute("aria-rowcount", String(rows.length + 2));
    this.#fill();
    this.tell.filtered(this.passed);
  }

  #fill() {
    const top = Math.max(0, this.scroll.scrollTop - 60);
    const first = Math.max(0, Math.floor(top / HEIGHT) - 10);
    const last = Math.min(this.rows.length, first + Math.ceil((this.scroll.clientHeight || 400) / HEIGHT) + 24);
    const wide = this.columns.length + 1;
    const room = (/** @type {number} */ rows) => {
      const row = el("tr", { "aria-hidden": "true", class: "room" }, el("td", { colspan: wide }));
      row.firstChild.style.height = `${rows * HEIGHT}px`;
      return row;
    };
    const shownRows = this.rows.slice(first, last).map((row, k) => {
      const line = el("tr", {
        role: "row", "data-row": row, "aria-rowindex": first + k + 3, "aria-selected": String(row === this.selected),
        class: row === this.compared ? "compared" : null,
        onclick: (/** @type {MouseEvent} */ event) => (event.shiftKey || event.altKey ? this.tell.compare(row) : this.tell.pick(row)),
      });
      for (const column of this.columns) {
        const value = column.values[row];
        line.append(el("td", { role: "gridcell", class: column.kind, title: typeof value === "number" ? String(value) : null }, shown(value, column.name === "load_factor" || column.name.startsWith("bracket") ? 7 : 5)));
      }
      line.append(el("td", { role: "gridcell", class: "labelling" }, lettersOf(this.bits, row, this.faces, this.beside)));
      return line;
    });
    this.body.replaceChildren(room(first), ...shownRows, room(this.rows.length - last));
  }

  /** @param {KeyboardEvent} event */
  #key(event) {
    if (/** @type {Element} */ (event.target).tagName === "INPUT") return;
    const at = this.rows.indexOf(this.selected);
    const page = Math.max(1, Math.floor(this.scroll.clientHeight / HEIGHT) - 3);
    /** @type {Record<string, number>} */
    const steps = { ArrowDown: at + 1, ArrowUp: at - 1, PageDown: at + page, PageUp: at - page, Home: 0, End: this.rows.length - 1 };
    if (event.key in steps && this.rows.length) {
      event.preventDefault();
      this.tell.pick(this.rows[Math.min(Math.max(steps[event.key], 0), this.rows.length - 1)]);
    } else if (event.key.toLowerCase() === "c" && at >= 0 && !event.ctrlKey && !event.metaKey) {
      this.tell.compare(this.selected);
    }
  }

  /** @param {number} row @param {number} compared */
  select(row, compared) {
    this.selected = row;
    this.compared = compared;
    const at = this.rows.indexOf(row);
    if (at >= 0) {
      const [top, room] = [at * HEIGHT, this.scroll.clientHeight - 90];
      if (top < this.scroll.scrollTop || top > this.scroll.scrollTop + room) this.scroll.scrollTop = top - room / 2;
    }
    this.#fill();
  }
}
