// @ts-check
/** Layouts worth keeping. */
import { el } from "./dom.js";
import { ask } from "./live.js";

/** @typedef {{name: string, scene?: string, labelling: string, changes: any, text: string}} Candidate the scene is that of the start if none is named */

export class Candidates {
  /**
   * @param {HTMLElement} host
   * @param {Candidate[]} kept
   * @param {{now: () => Omit<Candidate, "name">, show: (c: Candidate) => void, compare: (c: Candidate | null) => void, complain: (message: string) => void}} tell
   */
  constructor(host, kept, tell) {
    this.all = kept;
    this.tell = tell;
    /** @type {Candidate | null} */
    this.compared = null;
    this.list = el("ul", { class: "entries" });
    host.replaceChildren(
      el("div", { class: "row" }, el("button", { type: "button", id: "keep", onclick: () => this.keep() }, "keep this layout")),
      this.list,
    );
    this.#fill();
  }

  keep() {
    const number = this.all.filter((c) => /^layout \d+$/.test(c.name)).length + 1;
    this.add([{ name: `layout ${number}`, ...this.tell.now() }]);
  }

  /** @param {Candidate[]} more */
  add(more) {
    const same = (/** @type {Candidate} */ a, /** @type {Candidate} */ b) => a.scene === b.scene && a.labelling === b.labelling && JSON.stringify(a.changes) === JSON.stringify(b.changes);
    this.all = [...more.filter((c) => !this.all.some((own) => same(own, c))), ...this.all].slice(0, 500);
    this.#keep();
  }

  #keep() {
    this.#fill();
    ask("candidates", { candidates: this.all }).catch((error) => this.tell.complain(error.message));
  }

  #fill() {
    const button = (/** @type {string} */ text, /** @type {boolean} */ pressed, /** @type {() => void} */ act) => el("button", { type: "button", "aria-pressed": String(pressed), onclick: act }, text);
    this.list.replaceChildren(...this.all.map((candidate) => el("li", {},
      el("span", { class: "name" }, candidate.name), el("span", { class: "grow" }, candidate.text),
      el("button", { type: "button", onclick: () => this.tell.show(candidate) }, "show"),
      button("compare", candidate === this.compared, () => {
        this.compared = candidate === this.compared ? null : candidate;
        this.tell.compare(this.compared);
        this.#fill();
      }),
      el("button", { type: "button", "aria-label": `forget ${candidate.name}`, onclick: () => {
        this.all = this.all.filter((own) => own !== candidate);
        this.#keep();
      } }, "forget"))));
  }
}
