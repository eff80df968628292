// @ts-check
/** Which elements are supports. */
import { el } from "./dom.js";

/**
 * @param {HTMLElement} host
 * @param {import("./contract.js").Structure} structure
 * @param {(element: string, support: boolean) => void} tell
 */
export function supportList(host, structure, tell) {
  const held = structure.elements.filter((element) => element.support);
  const free = structure.elements.filter((element) => !element.support);
  const element = el("select", { "aria-label": "element that becomes a support" }, free.map(({ id }) => el("option", { value: id }, id)));
  host.replaceChildren(
    el("ul", { class: "entries" }, held.map(({ id }) => el("li", {}, el("span", { class: "name grow" }, id),
      el("button", { type: "button", "aria-label": `make ${id} free`, onclick: () => tell(id, false) }, "make free")))),
    el("div", { class: "row" }, element, el("button", { type: "button", onclick: () => tell(element.value, true) }, "make it a support")),
    el("p", { class: "problem", role: "alert", hidden: true }),
  );
}
