// @ts-check
/** Fields of one part of the scene. What is typed is judged by the core; a refusal stands beside its field. */
import { el, say, shown } from "./dom.js";

/** @typedef {(string | number)[]} Path from the part to a value */
/**
 * @typedef {object} Desk what holds the state
 * @property {(part: string) => any} now value of a part
 * @property {(part: string, value: any) => Promise<any>} judge the value as a scene file holds it, or an error with a `key`
 * @property {(change: any) => void} change one step
 * @property {(change: any) => void} preview part of a step
 * @property {(change: any) => void} finish the step that previews began
 * @property {() => void} cancel it
 * @property {() => string} context what else the forms show, as the name of the scene and the load case
 */

/** @param {any} object @param {Path} path */
export function at(object, path) {
  return path.reduce((value, key) => value?.[key], object);
}

/**
 * Put a value at a path; undefined deletes it, and objects that become empty.
 * @param {any} object @param {Path} path @param {any} value
 */
export function put(object, path, value) {
  const [key, ...rest] = path;
  if (rest.length) {
    if (object[key] === undefined || object[key] === null) {
      if (value === undefined) return;
      object[key] = typeof rest[0] === "number" ? [] : {};
    }
    put(object[key], rest, value);
    const inner = object[key];
    if (value === undefined && !Array.isArray(inner) && !Object.keys(inner).length) delete object[key];
  } else if (value === undefined && !Array.isArray(object)) delete object[key];
  else object[key] = value === undefined ? null : value;
}

/** What a text stands for: nothing, a number, or a text with a unit, which the core reads. @param {string} text */
export function valueOf(text) {
  const plain = text.trim().replace("−", "-");
  if (plain === "") return undefined;
  const decimal = /^[-+]?\d+,\d+$/.test(plain) ? plain.replace(",", ".") : plain;
  return /^[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?$/i.test(decimal) ? Number(decimal) : plain;
}

/** @param {string} part @param {Path} path */
function keyOf(part, path) {
  return part + path.map((key) => (typeof key === "number" ? `[${key}]` : `.${key}`)).join("");
}

export class Form {
  /**
   * @param {HTMLElement} host
   * @param {string} part materials, loads or search
   * @param {Desk} desk
   * @param {(form: Form) => any[]} content what the form holds
   */
  constructor(host, part, desk, content) {
    this.host = host;
    this.part = part;
    this.desk = desk;
    this.content = content;
    /** @type {{key: string, path: Path, read: () => any, text: () => string, was: string, node: any, problem: any}[]} */
    this.fields = [];
    /** texts that wait for a further field @type {Map<string, string>} */
    this.drafts = new Map();
    /** texts of the value that was taken last @type {Map<string, string>} */
    this.taken = new Map();
    this.turn = Promise.resolve();
    /** the value and the context that are shown @type {[any, string] | null} */
    this.shown = null;
    /** what was refused last */
    this.refused = "";
    this.problem = el("p", { class: "problem", role: "alert", hidden: true });
  }

  get now() {
    return this.desk.now(this.part);
  }

  /** Show the state if it is another one; the field under the cursor keeps it, and what is typed in it. @param {boolean} [again] in any case */
  render(again = false) {
    const context = this.desk.context();
    if (!again && this.shown && this.shown[0] === this.now && this.shown[1] === context) return;
    this.shown = [this.now, context];
    const active = /** @type {any} */ (document.activeElement);
    const own = active && this.host.contains(active) ? active.dataset.key : undefined;
    const typed = own && active.type === "text" && active.value !== active.dataset.was && active.value !== this.taken.get(own) ? active.value : undefined;
    const open = new Set([...this.host.querySelectorAll("details[open]")].map((node) => /** @type {any} */ (node).dataset.name));
    this.fields = [];
    this.host.replaceChildren(...this.content(this), this.problem);
    for (const node of this.host.querySelectorAll("details")) if (open.has(/** @type {any} */ (node).dataset.name)) node.open = true;
    this.#complain("", "");
    for (const field of this.fields) {
      const draft = this.drafts.get(field.key);
      if (draft !== undefined) field.node.value = draft;
    }
    this.drafts.clear();
    if (!own) return;
    const same = /** @type {any} */ ([...this.host.querySelectorAll("[data-key]")].find((node) => /** @type {any} */ (node).dataset.key === own));
    same?.focus({ preventScroll: true });
    if (same && typed !== undefined) same.value = typed;
  }

  /**
   * A field with a label, and a place for what is wrong with it.
   * @param {string} label
   * @param {Path} path
   * @param {{unit?: string, hint?: string, more?: any, wide?: boolean, bare?: boolean}} [how] bare: the label is for screen readers alone
   */
  text(label, path, how = {}) {
    const value = at(this.now, path);
    const was = value === undefined || value === null ? "" : typeof value === "object" ? JSON.stringify(value) : String(value);
    const key = keyOf(this.part, path);
    const node = el("input", {
      type: "text", inputmode: typeof value === "string" ? "text" : "decimal", value: was, "data-key": key, "data-was": was, "aria-label": label,
      placeholder: how.hint ?? "", autocomplete: "off", spellcheck: "false", class: how.wide ? "wide-field" : null, ...how.more,
      onchange: () => this.commit(),
      onblur: () => { if (node.value !== node.dataset.was) this.commit(); },
      onkeydown: (/** @type {KeyboardEvent} */ event) => {
        if (event.key === "Enter") this.commit();
        if (event.key === "Escape") { node.value = was; this.refused = ""; this.#complain("", ""); }
      },
    });
    const read = () => (typeof value === "string" || how.wide ? node.value.trim() || undefined : valueOf(node.value));
    return this.#field(key, path, read, () => node.value, was, node, how.bare ? null : label, how.unit);
  }

  /** @param {string} label @param {Path} path @param {[any, string][]} options value and words @param {any} standard value where the scene states none */
  choice(label, path, options, standard) {
    const value = at(this.now, path) ?? standard;
    const known = options.some(([one]) => JSON.stringify(one) === JSON.stringify(value));
    const all = known ? options : [...options, [value, "as in the scene"]];
    const key = keyOf(this.part, path);
    const place = all.findIndex(([one]) => JSON.stringify(one) === JSON.stringify(value));
    const node = el("select", { "data-key": key, "data-was": place, "aria-label": label, onchange: () => this.commit() },
      all.map(([, words], k) => el("option", { value: k, selected: k === place }, words)));
    return this.#field(key, path, () => all[Number(node.value)][0], () => node.value, String(place), node, label, "");
  }

  /** @param {string} key @param {Path} path @param {() => any} read @param {() => string} text @param {string} was @param {any} node @param {string | null} label @param {string} [unit] */
  #field(key, path, read, text, was, node, label, unit) {
    const problem = el("span", { class: "problem", hidden: true, id: `problem-${key}` });
    this.fields.push({ key, path, read, text, was, node, problem });
    return el("label", { class: "field" }, label === null ? null : el("span", { class: "label" }, label), node, unit ? el("span", { class: "unit" }, unit) : null, problem);
  }

  /** Take what is typed, once the core has judged it. */
  commit() {
    this.turn = this.turn.then(() => this.#commit());
    return this.turn;
  }

  async #commit() {
    const changed = this.fields.filter((field) => field.text() !== field.was);
    if (!changed.length) return this.#complain("", "");
    const value = structuredClone(this.now);
    const typed = new Map(this.fields.map((field) => [field.key, field.text()]));
    const all = JSON.stringify([...typed]);
    if (this.refused === all) return; // Enter and then Tab
    this.refused = all;
    for (const field of changed) put(value, field.path, field.read());
    await this.take(value, typed);
  }

  /**
   * Take a new value of the part, or say why not.
   * @param {any} value
   * @param {Map<string, string>} [typed] texts that made it; others are kept as drafts
   */
  async take(value, typed) {
    const before = this.now;
    try {
      const judged = await this.desk.judge(this.part, value);
      this.refused = "";
      if (this.now !== before) return; // undone meanwhile
      this.taken = typed ?? new Map();
      if (typed) {
        for (const field of this.fields) if (field.text() !== typed.get(field.key)) this.drafts.set(field.key, field.text());
      }
      if (JSON.stringify(judged) === JSON.stringify(before)) this.render(true);
      else this.desk.change({ [this.part]: judged });
    } catch (error) {
      const { key, message } = /** @type {any} */ (error);
      if (this.now === before) this.#complain(key ?? "", message);
    }
  }

  /** @param {string} key of the scene, or none @param {string} message */
  #complain(key, message) {
    const near = !key ? undefined : this.fields.find((field) => field.key === key)
      ?? this.fields.find((field) => field.key.startsWith(`${key}.`) || field.key.startsWith(`${key}[`) || key.startsWith(`${field.key}[`));
    for (const field of this.fields) {
      field.problem.hidden = field !== near;
      field.problem.textContent = field === near ? message : "";
      field.node.toggleAttribute("aria-invalid", field === near);
      if (field === near) field.node.setAttribute("aria-describedby", field.problem.id);
    }
    this.problem.hidden = !message || near !== undefined;
    this.problem.textContent = near ? "" : message;
    if (message) say(message);
  }

  /**
   * A slider beside a field: it shows at once, and is judged when it is let go.
   * @param {string} label @param {Path} path @param {any} range min, max, step, value
   * @param {(position: number) => any} read value at a position
   * @param {(value: any, found: number) => void} [write] puts a value into the part, if not at the path
   */
  slider(label, path, range, read, write = (value, found) => put(value, path, found)) {
    const valueAt = (/** @type {any} */ event) => {
      const value = structuredClone(this.now);
      write(value, Number(read(Number(event.target.value)).toPrecision(4)));
      return value;
    };
    const key = keyOf(this.part, path);
    return el("input", {
      type: "range", ...range, "aria-label": `${label}, slider`, "data-key": `slider ${key}`, "data-material": label,
      oninput: (/** @type {any} */ event) => {
        const value = valueAt(event);
        const field = this.fields.find((one) => one.key === key);
        if (field) field.node.value = field.node.dataset.was = shown(at(value, path), 4).replace("−", "-");
        this.desk.preview({ [this.part]: value });
      },
      onchange: async (/** @type {any} */ event) => {
        try {
          this.desk.finish({ [this.part]: await this.desk.judge(this.part, valueAt(event)) });
        } catch (error) {
          this.desk.cancel();
          this.render(true);
          const { key, message } = /** @type {any} */ (error);
          this.#complain(key ?? "", message);
        }
      },
    });
  }
}
