// @ts-check
/** Searches that run behind the page. */
import { el, save, shown } from "./dom.js";
import { ask } from "./live.js";

/** @param {any} job */
function progressOf(job) {
  const { done, total, best, bound, seconds } = { ...job.progress };
  const { summary } = job;
  const parts = [];
  const [top, roof] = job.state === "running" || job.state === "stopping" ? [best, bound] : [summary.best ?? best, summary.bound ?? bound];
  if (done !== undefined) parts.push(`${done}${total ? ` of ${total}` : ""} layouts`);
  if (typeof top === "number") parts.push(`best λ ${shown(top, 6)}`);
  if (typeof roof === "number") parts.push(`bound ${shown(roof, 6)}`);
  if (typeof top === "number" && typeof roof === "number" && roof > 0) parts.push(`gap ${shown(Math.max(0, (100 * (roof - top)) / roof), 2)} %`);
  if (seconds !== undefined) parts.push(`${shown(seconds, 3)} s`);
  if (summary.proven) parts.push("proven strongest");
  return parts.join(", ");
}

export class Searches {
  /**
   * @param {HTMLElement} host
   * @param {() => {labelling: string, changes: any}} state
   * @param {{show: (data: any, job: any) => void, complain: (message: string) => void}} tell
   */
  constructor(host, state, tell) {
    this.tell = tell;
    this.seconds = el("input", { type: "number", min: 1, max: 86400, value: 60, "aria-label": "seconds" });
    const begin = (/** @type {string} */ kind, /** @type {string} */ name, /** @type {string} */ title) => el("button", {
      type: "button", title, "data-search": kind, onclick: () => this.#act("start", { kind, seconds: Number(this.seconds.value), ...state() }),
    }, name);
    this.list = el("ul", { class: "entries" });
    host.replaceChildren(
      el("div", { class: "row" },
        begin("improve", "improve this", "local search from the layout shown"),
        begin("prove", "prove", "the best there is, with proof"),
        begin("explore", "explore", "many layouts, and the front"),
        el("label", {}, "for ", this.seconds, " s")),
      this.list,
    );
    this.seen = "";
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

  async refresh() {
    const { jobs } = await ask("jobs");
    const text = JSON.stringify(jobs);
    if (text !== this.seen) this.#fill(jobs);
    this.seen = text;
    return jobs.some((/** @type {any} */ job) => job.state === "running" || job.state === "stopping");
  }

  /** @param {any[]} jobs */
  #fill(jobs) {
    this.list.replaceChildren(...jobs.map((job) => {
      const running = job.state === "running";
      const button = (/** @type {string} */ name, /** @type {() => void} */ act) => el("button", { type: "button", onclick: act }, name);
      const results = job.summary.best !== undefined && job.summary.best !== null;
      return el("li", { "data-job": job.name, "data-state": job.state },
        el("span", { class: "name" }, job.name), el("span", {}, job.state),
        el("span", { class: "grow" }, job.error || progressOf(job)),
        running && job.progress.total ? el("progress", { max: job.progress.total, value: job.progress.done, "aria-label": `progress of ${job.name}` }) : null,
        running ? button("stop", () => this.#act("stop", { name: job.name })) : null,
        job.state === "stopped" || job.kind === "study" && job.state === "done" && !job.summary.proven ? button("resume", () => this.#act("resume", { name: job.name })) : null,
        results && !running ? button("show best", () => this.#results(job)) : null,
        results && !running ? button("page", () => this.#page(job)) : null);
    }));
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
    const { name, text } = await ask("report", { name: job.name });
    save(name, "text/html", text);
  }
}
