// @ts-check
/** Newest state first, and no answer to anything but the state that is shown. */

export class Live {
  /**
   * @param {(state: any) => Promise<any>} send a state, for its answer
   * @param {(answer: any, milliseconds: number) => void} show an answer to the newest state
   * @param {(message: string) => void} complain
   * @param {string} page name of this page where others ask as well
   */
  constructor(send, show, complain, page = "") {
    this.send = send;
    this.show = show;
    this.complain = complain;
    this.page = page;
    this.revision = 0;
    this.answered = 0;
    /** @type {any} */
    this.wanted = null;
    this.busy = false;
    this.asked = 0;
  }

  /** Whether what is shown lacks its answer. */
  get waiting() {
    return this.answered < this.revision;
  }

  /** @param {{labelling: string, changes: any}} state */
  want(state) {
    this.revision += 1;
    this.wanted = { page: this.page, revision: this.revision, ...state };
    this.asked = performance.now();
    if (!this.busy) this.#send();
  }

  async #send() {
    this.busy = true;
    while (this.wanted) {
      const sent = this.wanted;
      this.wanted = null;
      try {
        const answer = await this.send(sent);
        // an answer to anything but the newest state is stale, and dropped
        if (sent.revision === this.revision && answer.revision === this.revision && !answer.superseded) {
          this.answered = sent.revision;
          this.show(answer, performance.now() - this.asked);
        }
      } catch (error) {
        if (sent.revision === this.revision) this.complain(error instanceof Error ? error.message : String(error));
      }
    }
    this.busy = false;
  }
}
