// @ts-check
/** What was done, so that it can be taken back and done again. */

/** @typedef {{scene: string, labelling: string, materials: any, loads: any, search: any, vertices: Record<string, number[]>}} State */

const MOST = 300;

export class Steps {
  /** @param {State} first */
  constructor(first) {
    this.now = structuredClone(first);
    /** @type {State[]} */
    this.past = [];
    /** @type {State[]} */
    this.future = [];
    /** the state before an act that goes on, such as a drag @type {State | null} */
    this.before = null;
  }

  /** Change the state for now; `commit` makes it a step. @param {Partial<State>} change */
  preview(change) {
    this.before ??= this.now;
    this.now = { ...this.now, ...structuredClone(change) };
  }

  /** End an act: one step, if anything changed. */
  commit() {
    if (this.before && JSON.stringify(this.before) !== JSON.stringify(this.now)) {
      this.past = [...this.past, this.before].slice(-MOST);
      this.future = [];
    }
    this.before = null;
  }

  /** Go back to before an act that goes on. */
  cancel() {
    if (this.before) this.now = this.before;
    this.before = null;
  }

  /** @param {Partial<State>} change */
  step(change) {
    this.commit();
    this.preview(change);
    this.commit();
  }

  undo() {
    this.commit();
    const last = this.past.pop();
    if (!last) return false;
    this.future.push(this.now);
    this.now = last;
    return true;
  }

  redo() {
    this.commit();
    const next = this.future.pop();
    if (!next) return false;
    this.past.push(this.now);
    this.now = next;
    return true;
  }
}
