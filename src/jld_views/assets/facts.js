// @ts-check
/** What a study found, in words, and the files to take away. */
import { el, save } from "./dom.js";

/**
 * @param {HTMLElement} host
 * @param {import("./contract.js").PageData} data
 */
export function facts(host, data) {
  host.replaceChildren(
    ...data.warnings.map((warning) => el("p", { class: "warning", role: "note" }, warning)),
    el("dl", { class: "facts" }, data.facts.map(({ name, value }) => [el("dt", {}, name), el("dd", {}, value)])),
  );
}

/**
 * @param {HTMLElement} host
 * @param {import("./contract.js").PageData} data
 */
export function downloads(host, data) {
  const button = (/** @type {string} */ name, /** @type {string} */ file, /** @type {() => any} */ content) => el("button", {
    type: "button", "data-file": file, onclick: () => save(file, file.endsWith("json") ? "application/json" : "text/csv", content()),
  }, name);
  host.replaceChildren(...[
    Object.keys(data.scene).length ? button("scene (JSON)", "scene.json", () => JSON.stringify(data.scene, null, 1)) : null,
    button("summary (JSON)", "summary.json", () => JSON.stringify(data.summary, null, 1)),
    data.table ? button("table (CSV)", "layouts.csv", () => csv(/** @type {any} */ (data.table))) : null,
  ].filter(Boolean));
}

/**
 * Pictures that Python drew.
 * @param {HTMLElement} host
 * @param {import("./contract.js").Picture[]} given
 */
export function pictures(host, given) {
  host.replaceChildren(...given.map(({ title, png }) => el("figure", { class: "drawn" },
    el("img", { src: `data:image/png;base64,${png}`, alt: title }), el("figcaption", { class: "hint" }, title))));
}

/** @param {import("./contract.js").Table} table */
function csv(table) {
  // a text that a spreadsheet would run stands after an apostrophe, as in results.csv
  const safe = (/** @type {any} */ v) => (typeof v === "string" && /^[=+\-@\t\r]/.test(v) ? `'${v}` : v);
  const quoted = (/** @type {any} */ v) => (v === null ? "" : /[",\n]/.test(String(v)) ? `"${String(v).replaceAll('"', '""')}"` : String(v));
  const lines = [[...table.columns.map((c) => c.name), "evidence"].join(",")];
  for (let row = 0; row < table.rows; row++) {
    lines.push([...table.columns.map((c) => c.values[row]), table.evidence[row]].map(safe).map(quoted).join(","));
  }
  return `${lines.join("\n")}\n`;
}
