// @ts-check
/** One layout, or two side by side: labels, forces or mechanism, by load case. */
import { blocksOf, differing, goneOf } from "./blocks.js";
import { el, save, say } from "./dom.js";
import { legend } from "./marks.js";
import { figureOf } from "./figures.js";
import { about, verdicts } from "./words.js";

/** @typedef {import("./contract.js").PageData} PageData */
/** @typedef {import("./contract.js").Solution} Solution */
/**
 * @typedef {object} Layout
 * @property {string} name
 * @property {string} labelling
 * @property {Solution | null} solution
 * @property {string} [lacking] what to say where there is no solution
 * @property {string} [line] what is known of λ without one
 */
/** @typedef {{face?: number, element?: number, load?: number, vertex?: number}} Thing */

const VIEWS = /** @type {const} */ (["labels", "forces", "mechanism"]);
const PERIOD = 2400; // ms from rest to the drawn displacement and back

export class Viewer {
  /**
   * @param {HTMLElement} host
   * @param {PageData} data
   * @param {{changed?: () => void, pointer?: (what: Thing | null, event: PointerEvent, figure: any) => boolean, key?: (event: KeyboardEvent) => boolean, stem?: () => string}} [tell]
   */
  constructor(host, data, tell = {}) {
    this.data = data;
    this.tell = tell;
    /** @type {"labels" | "forces" | "mechanism"} */
    this.view = "labels";
    this.case = 0;
    this.caseGiven = false;
    this.show = { ids: false, values: false, thrust: true };
    this.share = 1;
    this.playing = false;
    /** @type {Layout[]} */
    this.layouts = [];
    /** @type {Set<number>} */
    this.slits = new Set();
    this.current = -1;
    /** @type {{vertex: number, place: number[]}[]} vertices that can be dragged */
    this.handles = [];
    /** what the places of the structure follow from, where they change */
    this.places = {};
    this.panes = el("div", { class: "panes" });
    this.tip = el("div", { class: "tip", hidden: true });
    this.bar = el("div", { class: "bar" });
    this.motion = el("div", { class: "motion", hidden: true });
    host.replaceChildren(this.bar, this.motion, el("div", { class: "stage" }, this.panes, this.tip));
    this.stage = /** @type {HTMLElement} */ (this.panes.parentElement);
    /** @type {any[]} */
    this.drawn = [];
    this.#toolbar();
  }

  #toolbar() {
    const tabs = el("div", { role: "tablist", "aria-label": "What is drawn", class: "tabs" }, VIEWS.map((view) => el("button", {
      type: "button", role: "tab", id: `tab-${view}`, "data-view": view, "aria-controls": "panes", onclick: () => this.setView(view),
      onkeydown: (/** @type {KeyboardEvent} */ event) => {
        const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
        if (!step) return;
        const next = VIEWS[(VIEWS.indexOf(view) + step + VIEWS.length) % VIEWS.length];
        this.setView(next);
        this.bar.querySelector(`#tab-${next}`)?.focus();
      },
    }, view[0].toUpperCase() + view.slice(1))));
    this.panes.id = "panes";
    this.panes.setAttribute("role", "tabpanel");
    const { cases } = this.data;
    const choice = cases.length > 1
      ? el("label", {}, "load case ", this.caseChoice = el("select", { onchange: (/** @type {any} */ e) => this.setCase(Number(e.target.value)) },
        cases.map((name, k) => el("option", { value: k }, name))))
      : null;
    const boxes = [["ids", "ids"], ["values", "values"], ["thrust", "thrust line"]]
      .filter(([key]) => this.data.structure.dimension === 2)
      .map(([key, name]) => el("label", { class: "check" }, el("input", {
        type: "checkbox", checked: this.show[/** @type {"ids"} */ (key)], "data-show": key,
        onchange: (/** @type {any} */ e) => { this.show[/** @type {"ids"} */ (key)] = e.target.checked; this.draw(); },
      }), name));
    const picture = el("button", { type: "button", class: "save-picture", onclick: () => this.#save() }, "save picture");
    this.bar.replaceChildren(...[tabs, choice, ...boxes, picture].filter(Boolean));
    const slider = el("input", {
      type: "range", min: 0, max: 1, step: 0.01, value: 1, id: "phase", "aria-label": "share of the drawn displacement",
      oninput: (/** @type {any} */ e) => { this.stop(); this.#move(Number(e.target.value)); },
    });
    this.slider = slider;
    this.button = el("button", { type: "button", class: "play", onclick: () => (this.playing ? this.stop() : this.play()) }, "play");
    this.scale = el("span", { class: "scale" });
    this.motion.replaceChildren(this.button, slider, this.scale);
  }

  /** @param {string} view */
  setView(view) {
    if (!VIEWS.includes(/** @type {"labels"} */ (view))) return;
    this.view = /** @type {"labels"} */ (view);
    this.stop();
    this.#move(1);
    this.draw();
    this.tell.changed?.();
  }

  /** @param {number} number */
  setCase(number) {
    if (!(number in this.data.cases)) return;
    this.case = number;
    this.caseGiven = true;
    if (this.caseChoice) this.caseChoice.value = String(number);
    this.draw();
    this.tell.changed?.();
  }

  /** @param {Layout[]} layouts one or two */
  set(layouts) {
    this.layouts = layouts;
    const governing = layouts[0]?.solution?.governing;
    if (!this.caseGiven && governing !== undefined) {
      this.case = governing;
      if (this.caseChoice) this.caseChoice.value = String(governing);
    }
    this.draw();
  }

  /** @param {Layout} layout */
  solved(layout) {
    return layout.solution?.cases[Math.min(this.case, (layout.solution?.cases.length ?? 1) - 1)] ?? null;
  }

  draw() {
    for (const tab of this.bar.querySelectorAll("[role=tab]")) {
      tab.setAttribute("aria-selected", String(tab.dataset.view === this.view));
      tab.tabIndex = tab.dataset.view === this.view ? 0 : -1;
    }
    const thrust = this.bar.querySelector('[data-show="thrust"]');
    if (thrust) thrust.parentElement.hidden = this.view !== "forces";
    this.panes.setAttribute("aria-labelledby", `tab-${this.view}`);
    while (this.drawn.length > this.layouts.length) {
      const gone = this.drawn.pop();
      gone.figure?.dispose();
      gone.pane.remove();
    }
    while (this.drawn.length < this.layouts.length) this.drawn.push(this.#pane());
    this.panes.classList.toggle("two", this.layouts.length > 1);
    const differs = this.layouts.length > 1 ? differing(this.layouts[0].labelling, this.layouts[1].labelling) : this.slits;
    let scale = 0;
    this.layouts.forEach((layout, k) => {
      const { pane, figure } = this.drawn[k];
      const solved = this.solved(layout);
      const name = this.data.cases[this.case];
      const loads = this.data.loads.filter((load) => load.case === name);
      const drawing = { labelling: layout.labelling, view: this.view, solved, loads, show: this.show, marked: differs, current: this.current, handles: this.handles };
      pane.querySelector("h3").textContent = layout.name;
      pane.querySelector(".verdict").textContent = solved && layout.solution ? verdicts(layout.solution, solved) : layout.line ?? "";
      const key = JSON.stringify({ ...drawing, solved: this.view === "labels" ? null : solved, marked: [...differs], places: this.places });
      if (figure && key !== this.drawn[k].key) figure.draw(drawing);
      this.drawn[k].key = key;
      const none = this.view !== "labels" && !solved ? layout.lacking ?? "" : this.view === "mechanism" && solved && !solved.mechanism ? "There is no mechanism." : this.view === "forces" && solved && !solved.forces ? "No admissible forces are known." : "";
      pane.querySelector(".lacking").textContent = none;
      const largest = solved?.vectors ? Math.max(0, ...solved.vectors.map((v) => Math.hypot(...v))) : null;
      const blocks = blocksOf(this.data.structure, layout.labelling);
      const gone = goneOf(this.data.structure, layout.labelling);
      const count = new Set(blocks.filter((_, e) => !this.data.structure.elements[e].support && !gone.has(e))).size;
      pane.querySelector(".legend-place").replaceChildren(legend(this.data.look, {
        view: this.view, labelling: layout.labelling, solved, blocks: count, largest, unit: this.data.structure.units.force,
        loads: new Set(this.view === "mechanism" ? [] : loads.map((load) => load.kind)), thrust: this.show.thrust && this.data.structure.dimension === 2, differs: this.layouts.length > 1 && differs.size > 0,
        members: this.data.structure.members.length > 0,
      }));
      figure?.node.setAttribute("aria-label", `${layout.name}, ${this.view}. ${pane.querySelector(".verdict").textContent}. ${count} blocks, ${[...layout.labelling].filter((l) => l === "d").length} dry faces.`);
      if (this.view === "mechanism" && solved?.mechanism) scale = solved.scale;
    });
    this.motion.hidden = scale === 0;
    this.scale.textContent = scale ? `velocities for live power 1, drawn × ${Number(scale.toPrecision(3))}` : "";
    if (scale) this.#move(this.share);
  }

  #pane() {
    const host = el("div", { class: "drawing" });
    const pane = el("section", { class: "pane" }, el("h3"), el("p", { class: "verdict" }), host, el("p", { class: "lacking" }), el("div", { class: "legend-place" }));
    this.panes.append(pane);
    const figure = figureOf(host, this.data);
    if (!figure) host.replaceChildren(el("p", {}, "This browser has no WebGL, which spatial drawings need; see the pictures in the folder."));
    const made = { pane, figure, key: "" };
    const node = figure?.node;
    node?.addEventListener("pointermove", (/** @type {PointerEvent} */ event) => this.#hover(made, event));
    node?.addEventListener("pointerleave", () => { this.tip.hidden = true; });
    for (const kind of ["pointerdown", "pointermove", "pointerup"]) {
      node?.addEventListener(kind, (/** @type {PointerEvent} */ event) => {
        if (!this.tell.pointer || (kind === "pointermove" && !event.buttons)) return;
        if (this.tell.pointer(figure.pick(event), event, figure)) event.preventDefault();
      }, { capture: true }); // before a spatial view takes the stroke for turning
    }
    node?.addEventListener("keydown", (/** @type {KeyboardEvent} */ event) => {
      if (this.tell.key?.(event)) event.preventDefault();
    });
    return made;
  }

  /** @param {{pane: any, figure: any}} made @param {PointerEvent} event */
  #hover(made, event) {
    const layout = this.layouts[this.drawn.indexOf(made)];
    if (!layout || event.buttons) return;
    const what = made.figure.pick(event);
    this.tip.hidden = !what || what.vertex !== undefined;
    if (!what || what.vertex !== undefined) return;
    const lines = about(this.data, what, layout.labelling, this.view === "labels" ? null : this.solved(layout), blocksOf(this.data.structure, layout.labelling));
    this.tip.replaceChildren(...lines.map((line) => el("div", {}, line)));
    const box = this.stage.getBoundingClientRect();
    const x = event.clientX - box.left;
    this.tip.style.left = `${Math.max(0, Math.min(x + 16, box.width - 240))}px`;
    this.tip.style.top = `${event.clientY - box.top + 16}px`;
  }

  /** @param {number} share */
  #move(share) {
    this.share = share;
    this.slider.value = String(share);
    for (const { figure } of this.drawn) figure?.move(share);
  }

  play() {
    this.playing = true;
    this.button.textContent = "pause";
    // there and back: the other way blocks would pass through one another
    const start = performance.now() - (Math.acos(1 - 2 * this.share) / (2 * Math.PI)) * PERIOD;
    const step = (/** @type {number} */ now) => {
      if (!this.playing) return;
      this.#move(0.5 - 0.5 * Math.cos((2 * Math.PI * (now - start)) / PERIOD));
      requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }

  stop() {
    this.playing = false;
    this.button.textContent = "play";
  }

  #save() {
    const [{ figure }] = this.drawn;
    if (!figure) return;
    const { name, kind, content } = figure.takeaway();
    save(name.replace(/^layout/, this.tell.stem?.() ?? "layout"), kind, content);
    say("The picture was saved.");
  }
}
