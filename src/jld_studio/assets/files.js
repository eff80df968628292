// @ts-check
/** Save and export: files are named after the scene. */
import { bytesOf } from "./blocks.js";
import { byId, el, save, say } from "./dom.js";
import { ask } from "./live.js";

export class Files {
  /**
   * @param {HTMLElement} host
   * @param {string[]} formats
   * @param {() => any} state what is shown
   * @param {(message: string) => void} complain
   */
  constructor(host, formats, state, complain) {
    const name = this.name = el("input", { type: "text", "aria-label": "name of the file", maxlength: 60 });
    const doing = (/** @type {() => Promise<string>} */ act) => async () => {
      try {
        complain("");
        say(await act());
      } catch (error) {
        complain(error instanceof Error ? error.message : String(error));
      }
    };
    const button = (/** @type {string} */ text, /** @type {string} */ id, /** @type {() => Promise<string>} */ act) => el("button", { type: "button", id, onclick: doing(act) }, text);
    const format = el("select", { "aria-label": "format" }, formats.map((kind) => el("option", { value: kind }, kind)));
    const saved = el("p", { class: "hint", role: "status" });
    host.replaceChildren(
      el("div", { class: "row" }, name, button("save the scene", "save", async () => {
        const wanted = { name: name.value, ...state() };
        let made = await ask("save", wanted);
        if (made.exists && confirm(`${made.path} exists. Replace it?`)) made = await ask("save", { ...wanted, overwrite: true });
        saved.textContent = made.exists ? `not saved: ${made.path} exists` : `saved as ${made.path}`;
        return saved.textContent;
      })),
      el("div", { class: "row" }, button("scene (JSON)", "export-scene", async () => {
        save(`${name.value}.json`, "application/json", JSON.stringify(await ask("scene", state()), null, 1));
        return "The scene was downloaded.";
      })),
      el("div", { class: "row" }, format, button("export the blocks", "export-blocks", async () => {
        const made = await ask("export", { name: name.value, format: format.value, ...state() });
        save(made.name, "application/octet-stream", bytesOf(made.content));
        return `${made.name} was downloaded.`;
      })),
      saved,
    );
  }

  /** @param {string} name of the files of a scene */
  rename(name) {
    this.name.value = name;
    byId("export").querySelector("[role=status]").textContent = "";
  }
}
