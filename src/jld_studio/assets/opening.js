// @ts-check
/** Files that are dropped on the page: scenes are opened, drawings are asked about first. */
import { Asking } from "./asking.js";
import { byId, el, say } from "./dom.js";
import { ask } from "./live.js";

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
   * @param {(job: string) => Promise<HTMLElement>} entry of a search in the list
   */
  constructor(host, take, entry) {
    this.host = host;
    this.take = take;
    this.asking = new Asking(byId("asking"), { open: (file, options) => this.read(file, options), entry });
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
    await this.begin({ name: files[0].name, content: base64(await files[0].arrayBuffer()) }, {});
  }

  /** @param {{name: string, content: string}} file @param {Record<string, any>} options of an import */
  async begin(file, options) {
    if (!(await this.asking.begin(file, options))) return;
    this.asking.close();
    try {
      await this.read(file, options);
    } catch (error) {
      this.#fill({ file, options, report: [], unit: "-" }, error instanceof Error ? error.message : String(error));
    }
  }

  /** Open a file as a scene. @param {{name: string, content: string}} file @param {Record<string, any>} options */
  async read(file, options) {
    const found = await ask("open", { ...file, options });
    this.reports.set(found.scene, { file, options, report: found.report, unit: found.unit });
    this.take(found);
  }

  /** Design the outline of a scene. @param {any} read */
  async #design(read) {
    try {
      await ask("design", read.file);
      say("A design was begun; it is listed under Searches.");
    } catch (error) {
      this.#fill(read, error instanceof Error ? error.message : String(error));
    }
  }

  /** Show what was read of a scene, if it came from a file. @param {string} scene its name */
  show(scene) {
    const found = this.reports.get(scene);
    this.host.hidden = !found;
    if (!found) return;
    this.#fill(found, "");
  }

  /** @param {{file: any, options: Record<string, any>, report: string[][], unit: string}} read a scene has no unit of its file @param {string} problem */
  #fill(read, problem) {
    const { file, options, report, unit } = read;
    this.host.hidden = false;
    this.host.replaceChildren(
      el("div", { class: "row" }, el("h2", {}, file.name), el("button", { type: "button", class: "reset", onclick: () => { this.host.hidden = true; } }, "close")),
      problem ? el("p", { class: "warning", role: "alert" }, problem) : "",
      unit ? "" : el("p", { class: "hint" }, "The scene as its file states it."),
      el("dl", { class: "facts report" }, report.map(([kind, text]) => [el("dt", { class: kind === "doubtful" ? "doubtful" : null }, kind), el("dd", {}, text)])),
      !report.length ? "" : unit ? el("button", { type: "button", onclick: () => this.asking.begin(file, options) }, "read it in another way")
        : el("button", { type: "button", title: "jld design: its free elements are one outline, which is cut anew", onclick: () => this.#design(read) }, "design"),
    );
  }
}
