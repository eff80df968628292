// @ts-check
/** Files that are dropped on the page: what was read of them, what was skipped, and the options to read them with. */
import { el } from "./dom.js";
import { ask } from "./live.js";

const OPTIONS = /** @type {const} */ ([
  ["unit", "unit of its lengths", "mm, cm, m, in, ft; default its own"],
  ["layer", "layers that alone are read", "default: all"],
  ["skip", "layers that are not read", ""],
  ["support", "layers of supports", "or: lowest"],
  ["dry", "layers of dry joints", ""],
  ["inner", "layers of inner faces", ""],
  ["load", "layers of live loads", ""],
  ["hole", "layers of openings", ""],
  ["thickness", "thickness, m", "1"],
  ["tolerance", "tolerance, in its unit", "0.0005 of the size"],
  ["up", "axis that points upwards (solids)", "z, or y"],
  ["facet", "chords from arcs, in its unit", "0.001 of the size"],
]);
const NUMBERS = ["thickness", "tolerance", "facet"];

/** @param {ArrayBuffer} buffer */
function base64(buffer) {
  const bytes = new Uint8Array(buffer);
  let text = "";
  for (let k = 0; k < bytes.length; k += 0x8000) text += String.fromCharCode(...bytes.subarray(k, k + 0x8000));
  return btoa(text);
}

export class Opening {
  /**
   * @param {HTMLElement} host
   * @param {(found: any) => void} take the answer to a file that was opened
   */
  constructor(host, take) {
    this.host = host;
    this.take = take;
    /** @type {{name: string, content: string} | null} */
    this.file = null;
    /** @type {Record<string, any>} */
    this.options = {};
    /** reports by the name of the scene @type {Map<string, any>} */
    this.reports = new Map();
    this.chooser = el("input", { type: "file", class: "visually-hidden", tabindex: -1, "aria-label": "file to open", onchange: () => this.#chosen(this.chooser.files) });
    document.body.append(this.chooser);
    document.addEventListener("dragover", (event) => {
      if (![...(event.dataTransfer?.types ?? [])].includes("Files")) return;
      event.preventDefault();
      document.body.classList.add("dropping");
    });
    document.addEventListener("dragleave", (event) => {
      if (!event.relatedTarget) document.body.classList.remove("dropping");
    });
    document.addEventListener("drop", (event) => {
      document.body.classList.remove("dropping");
      if (!event.dataTransfer?.files.length) return;
      event.preventDefault();
      this.#chosen(event.dataTransfer.files);
    });
  }

  choose() {
    this.chooser.value = "";
    this.chooser.click();
  }

  /** @param {FileList | null} files */
  async #chosen(files) {
    if (!files?.length) return;
    this.file = { name: files[0].name, content: base64(await files[0].arrayBuffer()) };
    this.options = {};
    await this.read();
  }

  /** Read the file with the options stated. */
  async read() {
    if (!this.file) return;
    this.host.hidden = false;
    this.host.replaceChildren(el("h2", {}, this.file.name), el("p", { class: "hint", role: "status" }, "being read …"));
    try {
      const found = await ask("open", { ...this.file, options: this.options });
      this.reports.set(found.scene, { file: this.file, options: this.options, report: found.report, unit: found.unit });
      this.take(found);
    } catch (error) {
      const { key, message } = /** @type {any} */ (error);
      this.#fill(this.file.name, [], message, key ?? "");
    }
  }

  /** Show what was read of a scene, if it came from a file. @param {string} scene its name */
  show(scene) {
    const found = this.reports.get(scene);
    this.host.hidden = !found;
    if (!found) return;
    this.file = found.file;
    this.options = found.options;
    this.#fill(found.file.name, found.report, "", "");
  }

  /** @param {string} name @param {string[][]} report @param {string} problem @param {string} key of the option that is wrong */
  #fill(name, report, problem, key) {
    const beside = OPTIONS.some(([option]) => option === key);
    const drawing = !/\.json$/i.test(name) || report.length > 0;
    const fields = OPTIONS.map(([option, label, hint]) => {
      const id = `option-${option}`;
      return el("label", { class: "field" }, el("span", { class: "label" }, label),
        el("input", { type: "text", "data-option": option, value: this.options[option] ?? "", placeholder: hint, "aria-invalid": key === option ? "true" : null, "aria-describedby": key === option ? id : null }),
        key === option ? el("span", { class: "problem", id, role: "alert" }, problem) : null);
    });
    this.host.replaceChildren(
      el("div", { class: "row" }, el("h2", {}, name), el("button", { type: "button", class: "reset", onclick: () => { this.host.hidden = true; } }, "close")),
      problem && !beside ? el("p", { class: "warning", role: "alert" }, problem) : el("span"),
      !report.length && !problem ? el("p", { class: "hint" }, "The scene as its file states it.") : el("span"),
      el("dl", { class: "facts report" }, report.map(([kind, text]) => [el("dt", { class: kind === "doubtful" ? "doubtful" : null }, kind), el("dd", {}, text)])),
      drawing ? el("details", { open: problem !== "" }, el("summary", {}, "read it in another way"),
        el("form", { class: "stacked", onsubmit: (/** @type {Event} */ event) => {
          event.preventDefault();
          const form = /** @type {HTMLElement} */ (event.target);
          this.options = Object.fromEntries([...form.querySelectorAll("[data-option]")].map((/** @type {any} */ one) => {
            const text = one.value.trim();
            const number = NUMBERS.includes(one.dataset.option) && text !== "" && !Number.isNaN(Number(text.replace(",", ".")));
            return [one.dataset.option, number ? Number(text.replace(",", ".")) : text];
          }).filter(([, value]) => value !== ""));
          this.read();
        } }, fields, el("button", { type: "submit" }, "read again"))) : el("span"),
    );
  }
}
