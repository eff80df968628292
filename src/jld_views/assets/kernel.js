// @ts-check
/** Sliders of a page in a notebook: the kernel solves what they say, as long as it runs. */
import { el } from "./dom.js";
import { materialSliders } from "./materials.js";
import { Live } from "./newest.js";

/** @typedef {import("./viewer.js").Layout} Layout */

export class Kernel {
  /**
   * @param {HTMLElement} host
   * @param {import("./contract.js").PageData} data
   * @param {() => void} redraw what is shown, by `now`
   */
  constructor(host, data, redraw) {
    const given = /** @type {import("./contract.js").Notebook} */ (data.notebook);
    this.data = data;
    this.given = given;
    this.redraw = redraw;
    this.materials = given.materials;
    this.connected = false;
    this.asked = "";
    /** @type {Map<string, import("./contract.js").Solution>} by labels and materials */
    this.found = new Map();
    /** @type {((answer: any) => void) | null} */
    this.waits = null;
    this.sliders = el("div", {});
    this.note = el("p", { class: "hint", id: "kernel", role: "status" }, given.why);
    this.reset = el("button", { type: "button", class: "reset", disabled: true, onclick: () => this.use(given.materials, true) }, "materials of the scene");
    host.replaceChildren(this.sliders, this.note, el("div", { class: "row" }, this.reset));
    this.live = new Live((state) => this.#ask(state), (answer) => {
      this.note.textContent = given.fixed ? given.why : "";
      this.found.set(answer.key, answer.solution);
      redraw();
    }, (message) => { this.note.textContent = message; });
    this.#draw();
    window.addEventListener("message", (event) => {
      if (event.source !== window.parent || typeof event.data?.jld !== "string") return;
      if (event.data.jld === "connected") this.#connect();
      if (event.data.jld === "answer") this.waits?.(event.data);
    });
    if (window.parent !== window) window.parent.postMessage({ jld: "ready" }, "*");
  }

  #connect() {
    if (this.connected) return;
    this.connected = true;
    this.note.textContent = this.given.fixed ? this.given.why : "";
    this.#draw();
    this.redraw();
  }

  #draw() {
    materialSliders(this.sliders, this.materials, this.data.structure.units, (materials) => this.use(materials, false));
    for (const input of this.sliders.querySelectorAll("input")) input.disabled = !this.connected || this.given.fixed;
  }

  /** @param {any} materials @param {boolean} sliders whether they have to be drawn anew */
  use(materials, sliders) {
    this.materials = materials;
    this.reset.disabled = !this.changed;
    if (sliders) this.#draw();
    this.redraw();
  }

  get changed() {
    return JSON.stringify(this.materials) !== JSON.stringify(this.given.materials);
  }

  /** @param {string} labelling */
  #key(labelling) {
    return `${labelling} ${JSON.stringify(this.materials)}`;
  }

  /** @param {any} state @returns {Promise<any>} */
  #ask(state) {
    return new Promise((resolve, reject) => {
      this.waits = (answer) => (answer.error ? reject(new Error(answer.error)) : resolve({ ...answer, key: state.key }));
      window.parent.postMessage({ jld: "solve", state }, "*");
    });
  }

  /**
   * Layouts under the materials of the sliders; asks the kernel for the first one that it has not solved.
   * @param {Layout[]} layouts
   * @returns {Layout[]}
   */
  now(layouts) {
    if (!this.connected) return layouts;
    const shown = layouts.map((layout) => {
      const solution = this.found.get(this.#key(layout.labelling)) ?? null;
      if (!this.changed) return { ...layout, solution: layout.solution ?? solution };
      return { ...layout, name: `${layout.name}, materials changed`, solution, line: "", lacking: "" };
    });
    const left = layouts.findIndex((_, k) => !shown[k].solution && layouts[k].labelling !== "");
    if (left >= 0) {
      const { labelling } = layouts[left];
      const key = this.#key(labelling);
      if (key !== this.live.wanted?.key && key !== this.asked) {
        this.asked = key;
        this.live.want(/** @type {any} */ ({ key, labelling, materials: this.materials }));
      }
    }
    return shown;
  }
}
