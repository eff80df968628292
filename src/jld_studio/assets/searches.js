// @ts-check
/** Searches that run behind the page: how far they are, and the best layout of those that run. */
import { el, save, shown } from "./dom.js";
import { figureOf } from "./figures.js";
import { ask } from "./live.js";

/** @param {any} job */
function progressOf(job) {
  const { done, total, best, bound, seconds } = { ...job.progress };
  const { summary } = job;
  const parts = job.progress.line ? [job.progress.line] : [];
  const [top, roof] = job.state === "running" || job.state === "stopping" ? [best, bound] : [summary.best ?? best, summary.bound ?? bound];
  if (summary.proven && typeof top !== "number") return summary.unbounded ? "a layout is locked: no live load brings it down" : "proven: no layout stands under any λ";
  if (done !== undefined) parts.push(`${done}${total ? ` of ${total}` : ""} layouts`);
  if (typeof top === "number") parts.push(`best λ ${shown(top, 6)}`);
  if (typeof roof === "number") parts.push(`bound ${shown(roof, 6)}${summary.bound_by ? ` (${summary.bound_by})` : ""}`);
  if (typeof top === "number" && typeof roof === "number" && roof > 0) parts.push(`gap ${shown(Math.max(0, (100 * (roof - top)) / roof), 2)} %`);
  if (seconds !== undefined && (job.kind !== "design" || job.state !== "running")) parts.push(`${shown(seconds, 3)} s`);
  if (typeof job.seconds_left === "number") parts.push(`at most ${timeOf(job.seconds_left)} left`);
  if (summary.proven) parts.push("proven strongest");
  return parts.join(", ");
}

/** @param {number} seconds */
function timeOf(seconds) {
  return seconds < 99.5 ? `${Math.round(seconds)} s` : seconds < 5940 ? `${Math.round(seconds / 60)} min` : `${(seconds / 3600).toFixed(1)} h`;
}

export class Searches {
  /**
   * @param {HTMLElement} host
   * @param {() => {labelling: string, changes: any, scene: string}} state
   * @param {{show: (data: any, job: any) => void, take: (state: any) => void, complain: (message: string) => void}} tell
   */
  constructor(host, state, tell) {
    this.tell = tell;
    this.seconds = el("input", { type: "number", min: 1, max: 86400, value: 60, "aria-label": "seconds" });
    const begin = (/** @type {string} */ kind, /** @type {string} */ name, /** @type {string} */ title) => el("button", {
      type: "button", title, "data-search": kind, onclick: () => this.#act("start", { kind, seconds: Number(this.seconds.value), ...state() }),
    }, name);
    this.list = el("ul", { class: "entries searches" });
    /** entries of the list by job @type {Map<string, any>} */
    this.entries = new Map();
    host.replaceChildren(
      el("div", { class: "row" },
        begin("improve", "improve this", "local search from the layout shown"),
        begin("prove", "prove", "the best there is, with proof"),
        begin("explore", "explore", "many layouts, and the front"),
        el("label", {}, "for ", this.seconds, " s")),
      this.list,
    );
    this.#poll();
  }

  /** @param {string} act @param {any} body */
  async #act(act, body) {
    try {
      await ask(act, body);
      await this.refresh();
    } catch (error) {
      this.tell.complain(error instanceof Error ? error.message : String(error));
    }
  }

  async #poll() {
    let running = false;
    try {
      running = await this.refresh();
    } catch {
      // the server is gone or busy; the next round says more
    }
    setTimeout(() => this.#poll(), running ? 500 : 2500);
  }

  /** The entry of a search in the list, which may be shown elsewhere. @param {string} name */
  async entry(name) {
    await this.refresh();
    return this.entries.get(name).node;
  }

  async refresh() {
    const { jobs } = await ask("jobs");
    for (const job of jobs) this.#fill(job);
    return jobs.some((/** @type {any} */ job) => job.state === "running" || job.state === "stopping");
  }

  /** Entries stay where they are: a button is not taken away under the hand. @param {any} job */
  #fill(job) {
    let entry = this.entries.get(job.name);
    if (!entry) {
      const node = el("li", { "data-job": job.name });
      entry = { node, text: el("span", { class: "grow" }), bar: el("progress", { "aria-label": `progress of ${job.name}` }), state: el("span"), buttons: el("span", { class: "buttons" }), picture: el("div", { class: "best", hidden: true }) };
      node.append(el("span", { class: "name" }, job.name), entry.state, entry.text, entry.bar, entry.buttons, entry.picture);
      this.entries.set(job.name, entry);
    }
    if (!entry.node.isConnected) this.list.append(entry.node); // it may have been shown elsewhere
    const running = job.state === "running";
    entry.job = job;
    entry.text.textContent = job.error || progressOf(job);
    entry.bar.hidden = !running || !job.progress.total;
    if (!entry.bar.hidden) [entry.bar.max, entry.bar.value] = [job.progress.total, job.progress.done];
    const key = JSON.stringify([job.state, job.summary]);
    if (entry.key !== key) this.#buttons(entry, job);
    entry.key = key;
    this.#picture(entry, running ? job.progress.labelling ?? "" : "");
  }

  /** @param {any} entry @param {any} job */
  #buttons(entry, job) {
    const running = job.state === "running";
    const button = (/** @type {string} */ name, /** @type {() => void} */ act) => el("button", { type: "button", onclick: act }, name);
    const results = job.summary.best !== undefined && job.summary.best !== null;
    entry.node.dataset.state = job.state;
    entry.state.textContent = job.state;
    entry.buttons.replaceChildren(...[
      running ? button("stop", () => this.#act("stop", { name: job.name })) : null,
      running && job.kind !== "design" ? button("take its best", () => this.#take(entry.job)) : null,
      (job.state === "stopped" && job.kind !== "design") || job.kind === "study" && job.state === "done" && !job.summary.proven ? button("resume", () => this.#act("resume", { name: job.name })) : null,
      results && !running ? button("show best", () => this.#results(job)) : null,
      results && !running ? button("page", () => this.#page(job)) : null,
    ].filter(Boolean));
  }

  /** The best layout of a search while it runs, drawn in the structure that it searches. @param {any} entry @param {string} labelling */
  async #picture(entry, labelling) {
    entry.picture.hidden = !labelling;
    if (!labelling) {
      entry.figure?.dispose();
      entry.figure = undefined;
      entry.drawn = "";
      entry.picture.replaceChildren();
      return;
    }
    if (entry.drawn === labelling || entry.asking) return;
    if (!entry.figure) {
      entry.asking = true;
      try {
        entry.data ??= await ask("drawing", { name: entry.job.name });
        if (entry.job.state === "running") entry.figure = figureOf(entry.picture, entry.data);
      } catch (error) {
        entry.picture.textContent = error instanceof Error ? error.message : String(error);
      }
      entry.asking = false;
      if (!entry.figure) return;
    }
    entry.drawn = labelling;
    entry.figure.draw({ labelling, view: "labels", solved: null, loads: [], show: {}, marked: new Set(), current: -1 });
    entry.figure.node.setAttribute("aria-label", `best layout of ${entry.job.name} so far: ${[...labelling].filter((one) => one === "d").length} dry faces`);
  }

  /** @param {any} job */
  #take(job) {
    const labelling = job.progress.labelling ?? "";
    if (!labelling || labelling.includes("v")) this.tell.complain(`${job.name}: there is no layout to take yet`);
    else this.tell.take({ scene: job.shown.scene, changes: job.shown.changes ?? {}, labelling });
  }

  /** @param {any} job */
  async #results(job) {
    try {
      this.tell.show(await ask("results", { name: job.name }), job);
    } catch (error) {
      this.tell.complain(error instanceof Error ? error.message : String(error));
    }
  }

  /** @param {any} job */
  async #page(job) {
    try {
      const { name, text } = await ask("report", { name: job.name });
      save(name, "text/html", text);
    } catch (error) {
      this.tell.complain(error instanceof Error ? error.message : String(error));
    }
  }
}
