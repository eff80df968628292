// @ts-check
/** A drawing before it is opened: what was read of it, and a hand that says what its layers are. */
import { byId, el, say } from "./dom.js";
import { ask } from "./live.js";
import { ROLES, patterns, pictureOf, rolesIn, swatch } from "./understood.js";

const CHOICES = ["block", "support", "hole", "load", "dry", "inner", "skip"];
const LAYERED = ["skip", "support", "dry", "inner", "load", "hole"];
const UNITS = [["", "its own"], ["mm", "mm"], ["cm", "cm"], ["m", "m"], ["in", "in"], ["ft", "ft"]];
const NUMBERS = ["tolerance", "thickness", "facet", "mass", "seconds"];
const HEADS = { found: "read", snapped: "closed", assumed: "assumed", skipped: "left out", doubtful: "doubtful" };

/** A pattern that names one layer alone. @param {string} name */
function patternOf(name) {
  return name === "lowest" ? "[l]owest" : name.replace(/[*?[]/g, "[$&]");
}

/**
 * Options by which one layer has another role, and the others keep theirs.
 * @param {{layers: {name: string, role: string, named: string}[]}} found
 * @param {Record<string, any>} options
 * @param {string} name
 * @param {string} role
 */
export function withRole(found, options, name, role) {
  const rows = found.layers.map((layer) => (layer.name === name ? { ...layer, role } : layer));
  const made = Object.fromEntries(Object.entries(options).filter(([key]) => key !== "layer" && !LAYERED.includes(key)));
  for (const own of LAYERED) {
    const is = (/** @type {string} */ one) => one === own || (own === "load" && one === "dead");
    const lowest = own === "support" && options.support?.includes("lowest") ? ["lowest"] : [];
    const names = rows.filter((row) => is(row.role)).map((row) => patternOf(row.name));
    // an option takes the place of what names say
    if (lowest.length || (names.length && rows.some((row) => is(row.role) !== is(row.named)))) made[own] = [...lowest, ...names];
  }
  if (rows.some((row) => row.role === "block" && row.named !== "block")) made.layer = rows.filter((row) => row.role === "block").map((row) => patternOf(row.name));
  return made;
}

export class Asking {
  /**
   * @param {HTMLElement} host
   * @param {{open: (file: any, options: any) => Promise<void>, entry: (job: string) => Promise<HTMLElement>}} tell
   */
  constructor(host, tell) {
    this.host = host;
    this.tell = tell;
    this.main = /** @type {HTMLElement} */ (document.querySelector("main.studio"));
    /** @type {any} */
    this.file = null;
    /** @type {Record<string, any>} */
    this.options = {};
    /** @type {Record<string, any>} */
    this.settings = {};
    /** @type {any[]} */
    this.past = [];
    /** @type {any} */
    this.found = null;
    this.turn = -30;
    this.asked = 0;
    document.body.append(patterns());
  }

  get open() {
    return !this.host.hidden;
  }

  /** Read a file; true where it is a scene, about which nothing is asked. @param {any} file @param {Record<string, any>} options */
  async begin(file, options) {
    Object.assign(this, { file, options, past: [], found: null, layer: null, settings: {} });
    this.#job = null;
    this.#front(true);
    this.host.replaceChildren(el("h2", { id: "asking-name" }, file.name), el("p", { class: "hint", role: "status" }, "being read …"), this.#close());
    return this.read();
  }

  /** @param {boolean} shown */
  #front(shown) {
    this.host.hidden = !shown;
    this.main.hidden = shown;
    byId("title").hidden = shown; // that of the scene behind
  }

  close() {
    this.#job = null;
    this.host.replaceChildren();
    this.#front(false);
  }

  #close() {
    return el("button", { type: "button", id: "asking-close", onclick: () => this.close() }, "close");
  }

  async read() {
    const number = ++this.asked;
    const { file, options, settings } = this;
    this.host.setAttribute("aria-busy", "true");
    try {
      const found = await ask("read", { ...file, options, settings });
      if (number !== this.asked) return false;
      this.host.removeAttribute("aria-busy");
      if (found.scene) return true;
      this.found = found;
      this.#fill("");
      say(`${file.name}: ${this.#first()}`);
    } catch (error) {
      if (number !== this.asked) return false;
      this.host.removeAttribute("aria-busy");
      const message = error instanceof Error ? error.message : String(error);
      // what cannot be met is taken back
      if (this.past.length) [this.options, this.settings] = this.past.pop();
      if (this.found) this.#fill(message);
      else this.host.replaceChildren(el("h2", { id: "asking-name" }, file.name), el("p", { class: "warning", role: "alert" }, message), this.#close());
    }
    return false;
  }

  /** One step, which can be taken back. @param {Record<string, any>} options @param {Record<string, any>} [settings] */
  set(options, settings = this.settings) {
    this.past.push([this.options, this.settings]);
    [this.options, this.settings] = [options, settings];
    this.read();
  }

  undo() {
    const last = this.past.pop();
    if (!last) return;
    [this.options, this.settings] = last;
    this.read();
  }

  /** @param {string} option @param {any} value */
  #with(option, value) {
    const own = value === "" || value === undefined ? {} : { [option]: value };
    const { [option]: _, ...rest } = this.options;
    this.set({ ...rest, ...own });
  }

  /** @param {string} name @param {string} role */
  role(name, role) {
    this.set(withRole(this.found, this.options, name, role));
  }

  #first() {
    const { report, refused, size } = this.found;
    return size ? report[0][1] : refused?.[0] ?? "";
  }

  /** A button that follows what a sentence advises. @param {any} advice */
  #remedy(advice) {
    if (!advice) return "";
    const { option, value } = advice;
    const words = { hole: `${value} is an opening`, support: "what lies lowest is ground", unit: `lengths are in ${value}`, up: `${value} points upwards`, tolerance: `close gaps up to ${value}` };
    return el("button", { type: "button", onclick: () => {
      if (option === "hole") this.role(value, "hole");
      else if (option === "support") this.#lowest(true);
      else this.#with(option, value);
    } }, words[/** @type {"up"} */ (option)]);
  }

  /** @param {string} problem */
  #fill(problem) {
    const { found, file } = this;
    const focused = /** @type {HTMLElement | null} */ (document.activeElement)?.dataset?.own;
    const scrolled = this.host.querySelector(".layers")?.scrollTop ?? 0;
    const first = this.#first();
    const rest = found.report.filter((/** @type {any} */ line) => line[1] !== first);
    const doubts = rest.filter((/** @type {any} */ [kind]) => kind === "doubtful");
    this.host.replaceChildren(
      el("div", { class: "row" }, el("h2", { id: "asking-name" }, file.name), el("span", { class: "reset" },
        el("button", { type: "button", id: "asking-open", "data-own": "open", disabled: found.refused !== null, title: "the blocks as they are drawn", onclick: () => this.#open() }, "open as blocks"), " ",
        el("button", { type: "button", id: "asking-design", "data-own": "design", disabled: found.undesigned !== null, title: found.undesigned ?? "jld design: blocks are found inside the outline", onclick: () => this.#design() }, "design"), " ",
        el("button", { type: "button", id: "asking-undo", "data-own": "undo", disabled: !this.past.length, title: "Ctrl+Z", onclick: () => this.undo() }, "take back"), " ",
        this.#close())),
      el("p", { class: found.size ? "first" : "first warning" }, first, " ", found.size ? "" : this.#remedy(found.refused[1])),
      problem ? el("p", { class: "warning", role: "alert" }, problem) : "",
      found.refused && found.refused[0] !== first ? el("p", { class: "warning", role: "alert" }, found.undesigned === null ? "It can be designed; as blocks it does not open yet. " : "", found.refused[0], " ", this.#remedy(found.refused[1])) : "",
      doubts.length ? el("ul", { class: "doubts" }, doubts.map((/** @type {any} */ [, text, advice]) => el("li", {}, el("strong", {}, "doubtful: "), text, " ", this.#remedy(advice)))) : "",
      el("div", { class: "asking" }, el("div", {}, this.#bar(), this.#picture(first), this.#legend(), this.#job ?? ""), el("div", {}, this.#layers(), this.#fields(), this.#report(rest), this.#commands())),
    );
    const list = this.host.querySelector(".layers");
    if (list) list.scrollTop = scrolled;
    if (focused) /** @type {any} */ ([...this.host.querySelectorAll("[data-own]")].find((node) => /** @type {any} */ (node).dataset.own === focused))?.focus({ preventScroll: true });
  }

  /** The layer that was clicked, and what it may be. */
  #bar() {
    const layer = this.found.layers.find((/** @type {any} */ one) => one.name === this.layer);
    if (!layer) return el("p", { class: "hint bar", id: "asking-bar" }, "Click an outline or a line to say what its layer is; with the keyboard, use the list of layers.");
    return el("div", { class: "bar", id: "asking-bar", role: "toolbar", "aria-label": `what layer ${layer.name || "without a name"} is` },
      el("strong", {}, layer.name || "(no layer)"), ` (${layer.count}) is`,
      this.#choices().map((role) => el("button", { type: "button", "data-own": `is ${role}`, "aria-pressed": String(role === layer.role), onclick: () => this.role(layer.name, role) }, ROLES[role][0])));
  }

  /** @param {boolean} ground whether what lies lowest is ground */
  #lowest(ground) {
    const { support = [], ...rest } = this.options;
    const named = this.found.layers.filter((/** @type {any} */ one) => one.role === "support").map((/** @type {any} */ one) => patternOf(one.name));
    const kept = ground ? ["lowest", ...named] : support.filter((/** @type {string} */ one) => one !== "lowest");
    this.set(kept.length ? { ...rest, support: kept } : rest);
  }

  #choices() {
    return this.found.planar ? CHOICES : ["block", "support", ...(this.found.marks.length ? ["load"] : []), "skip"];
  }

  /** @param {string} words */
  #picture(words) {
    const node = pictureOf(this.found, words, this.turn);
    for (const shape of node.querySelectorAll("[data-layer]")) shape.classList.toggle("chosen", shape.dataset.layer === this.layer);
    node.addEventListener("click", (/** @type {any} */ event) => {
      const layer = event.target.closest("[data-layer]")?.dataset.layer;
      this.choose(layer ?? null);
    });
    if (this.found.planar) return el("div", { class: "drawing" }, node);
    const slider = el("input", { type: "range", min: -180, max: 180, step: 5, value: this.turn, "data-own": "turn", "aria-label": "turn the picture", onchange: () => { this.turn = Number(slider.value); this.#fill(""); } });
    return el("div", { class: "drawing" }, node, el("div", { class: "spatial-controls" }, el("label", {}, "turn ", slider)));
  }

  /** @param {string | null} name */
  choose(name) {
    this.layer = name;
    this.#fill("");
    if (name !== null) say(`layer ${name || "without a name"} is chosen`);
  }

  #legend() {
    return el("ul", { class: "legend" }, rolesIn(this.found).map((role) => el("li", {}, swatch(role), ROLES[role][0])));
  }

  #layers() {
    const choices = this.#choices();
    const rows = this.found.layers.map((/** @type {any} */ layer) => {
      const select = el("select", { "data-own": `role ${layer.name}`, "aria-label": `layer ${layer.name || "without a name"} is`, onchange: () => this.role(layer.name, select.value) },
        [...new Set([layer.role, ...choices])].sort((a, b) => Object.keys(ROLES).indexOf(a) - Object.keys(ROLES).indexOf(b)).map((role) => el("option", { value: role, selected: role === layer.role, disabled: !choices.includes(role) }, ROLES[role][0])));
      return el("li", { class: layer.name === this.layer ? "current" : null }, swatch(layer.role),
        el("button", { type: "button", class: "name grow", "data-own": `layer ${layer.name}`, "aria-pressed": String(layer.name === this.layer), onclick: () => this.choose(layer.name) }, layer.name || "(no layer)"),
        el("span", { class: "count" }, String(layer.count)), select);
    });
    const lowest = el("input", { type: "checkbox", "data-own": "lowest", checked: Boolean(this.options.support?.includes("lowest")), onchange: () => this.#lowest(lowest.checked) });
    return el("section", {}, el("h3", {}, this.found.planar ? "Layers" : "Layers and groups"), el("ul", { class: "entries layers" }, rows),
      el("label", { class: "check" }, lowest, "what lies lowest is ground"));
  }

  #fields() {
    const { found, options, settings } = this;
    const unit = el("select", { "data-own": "unit", "aria-label": "unit of its lengths", onchange: () => this.#with("unit", unit.value) },
      UNITS.map(([value, words]) => el("option", { value, selected: (options.unit ?? "") === value }, value ? words : `${words} (${options.unit ? "as the file says" : found.unit})`)));
    const up = el("select", { "data-own": "up", "aria-label": "axis that points upwards", onchange: () => this.#with("up", up.value) },
      [["", "z"], ["y", "y"]].map(([value, words]) => el("option", { value, selected: (options.up ?? "") === value }, words)));
    const text = (/** @type {string} */ own, /** @type {string} */ label, /** @type {string} */ hint, /** @type {any} */ of) => {
      const node = el("input", { type: "text", "data-own": own, "data-option": own, value: of[own] ?? "", placeholder: hint, onchange: () => {
        const plain = node.value.trim().replace(",", ".");
        const value = NUMBERS.includes(own) && plain !== "" && !Number.isNaN(Number(plain)) ? Number(plain) : node.value.trim();
        if (of === options) this.#with(own, value);
        else this.set(options, Object.fromEntries(Object.entries({ ...settings, [own]: value }).filter(([, one]) => one !== "")));
      } });
      return el("label", { class: "field" }, el("span", { class: "label" }, label), node);
    };
    return el("section", { class: "stacked" },
      el("label", { class: "field" }, el("span", { class: "label" }, "unit of its lengths"), unit),
      found.planar ? text("thickness", "thickness, m", "1", options) : el("label", { class: "field" }, el("span", { class: "label" }, "axis that points upwards"), up),
      text("tolerance", `gaps are closed up to, ${found.unit}`, "0.0005 of the size", options),
      el("details", { open: Boolean(Object.keys(settings).length) }, el("summary", {}, "what a design has to keep"),
        text("mass", "largest mass of a block, kg", "none", settings),
        text("force", "force downwards on top", "as 10 kN", settings),
        text("seconds", "time limit, s", "300", settings)));
  }

  /** @param {string[][]} lines */
  #report(lines) {
    return el("dl", { class: "facts report" }, lines.filter(([kind]) => kind !== "doubtful").map(([kind, text]) => [el("dt", {}, HEADS[/** @type {"found"} */ (kind)]), el("dd", {}, text)]));
  }

  #commands() {
    return el("details", { open: true }, el("summary", {}, "the same by the command line"), Object.values(this.found.commands).map((line) => el("pre", { class: "command", tabindex: 0 }, line)));
  }

  async #open() {
    try {
      await this.tell.open(this.file, this.options);
      this.close();
    } catch (error) {
      this.#fill(error instanceof Error ? error.message : String(error));
    }
  }

  async #design() {
    const { file, options, settings } = this;
    try {
      const job = await ask("design", { ...file, options, settings });
      this.#job = el("ul", { class: "entries" }, await this.tell.entry(job.name));
      this.#fill("");
      say(`${job.name} was begun.`);
    } catch (error) {
      this.#fill(error instanceof Error ? error.message : String(error));
    }
  }

  /** the design that was begun here @type {any} */
  #job = null;
}
