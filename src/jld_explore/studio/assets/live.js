// @ts-check
/** The line to the core: newest state first, and no answer to anything but the state that is shown. */

/**
 * Ask the server. Raises an error with its words, and the key of the scene that they are about.
 * @param {string} name
 * @param {any} [body] posted where given
 * @returns {Promise<any>}
 */
export async function ask(name, body) {
  const answer = await fetch(`api/${name}`, body === undefined ? {} : {
    method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(body),
  });
  const text = await answer.text();
  let found;
  try {
    found = JSON.parse(text);
  } catch {
    throw new Error(answer.ok ? "the answer is not JSON" : text.trim());
  }
  if (!answer.ok) throw Object.assign(new Error(found.error ?? `the server answers ${answer.status}`), { key: found.key });
  return found;
}

export class Live {
  /**
   * @param {(answer: any, milliseconds: number) => void} show an answer to the newest state
   * @param {(message: string) => void} complain
   */
  constructor(show, complain) {
    this.show = show;
    this.complain = complain;
    this.page = crypto.randomUUID();
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

  /** @param {{labelling: string, changes: any, scene: string}} state */
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
        const answer = await ask("solve", sent);
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
