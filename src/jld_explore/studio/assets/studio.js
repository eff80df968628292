// @ts-check
/** The studio: a layout that is changed by hand, and λ that follows. */
import { bytesOf, differing, lettersOf, slitsOf } from "./blocks.js";
import { Candidates } from "./candidates.js";
import { loadList } from "./controls.js";
import { checked } from "./data.js";
import { byId, el, save, say, shown, shownBracket } from "./dom.js";
import { liveOf, nextFace, painted, toggled } from "./editing.js";
import { dragged, handlesOf, placed, verticesOf } from "./joints.js";
import { ask } from "./live.js";
import { materialSliders } from "./materials.js";
import { Live } from "./newest.js";
import { Searches } from "./searches.js";
import { Steps } from "./steps.js";
import { Viewer } from "./viewer.js";

const TOOLS = [
  ["toggle", "toggle faces", "Click a face to make it dry or inner; drag over faces to do so with many. With the keyboard: arrow keys go from face to face, Enter toggles."],
  ["paint", "paint a block", "Drag over elements: they become one block of their own."],
  ["joint", "move joints", "Drag a vertex of a joint: λ follows. Crack planes that end in it move with it, and λ by faces may then be false: the line of blocks that crack anywhere counts."],
  ["load", "loads", "Drag the tip of a load to move it; click an element to put a load there."],
];

class Studio {
  /** @param {import("./contract.js").PageData} data */
  constructor(data) {
    this.data = data;
    const given = /** @type {any} */ (data.studio);
    this.first = data.structure;
    /** @type {import("./joints.js").Joints | null} null where no vertex may move */
    this.joints = given.joints;
    const own = Object.values(data.solutions)[0];
    const first = own?.labelling ?? "";
    this.original = structuredClone(given.changes);
    this.steps = new Steps({ labelling: first, ...structuredClone(given.changes) });
    this.tool = "toggle";
    /** @type {import("./contract.js").Solution | null} */
    this.solution = null;
    /** @type {any} */
    this.act = null;
    this.live = new Live((state) => ask("solve", state), (answer, ms) => this.answered(answer, ms), (message) => this.failed(message), crypto.randomUUID());
    byId("title").textContent = data.title;
    document.title = `${data.title} – jld studio`;
    byId("folder").textContent = given.folder;
    this.viewer = new Viewer(byId("viewer"), data, {
      pointer: (what, event, figure) => this.pointer(what, event, figure), key: (event) => this.key(event), changed: () => this.lists(),
    });
    this.#tools();
    this.candidates = new Candidates(byId("candidates"), given.candidates ?? [], {
      now: () => ({ labelling: this.steps.now.labelling, changes: this.changes(), text: byId("answer").querySelector(".value")?.textContent ?? "" }),
      show: (candidate) => this.take({ labelling: candidate.labelling, ...structuredClone({ ...this.original, ...candidate.changes }) }),
      compare: (candidate) => this.compare(candidate), complain: (message) => this.complain(message),
    });
    new Searches(byId("searches"), () => ({ labelling: this.steps.now.labelling, changes: this.changes() }), {
      show: (found, job) => this.results(found, job.name), complain: (message) => this.complain(message),
    });
    this.#export();
    document.addEventListener("keydown", (event) => {
      if (!(event.ctrlKey || event.metaKey) || /** @type {Element} */ (event.target).matches("input, textarea")) return;
      const key = event.key.toLowerCase();
      if (key === "z" && !event.shiftKey) this.undo();
      else if (key === "y" || (key === "z" && event.shiftKey)) this.redo();
      else return;
      event.preventDefault();
    });
    window.addEventListener("pointerup", () => this.end()); // also outside the drawing
    if (data.table) this.results(data, "this folder");
    this.controls();
    this.refresh();
  }

  /** Materials, loads and vertices where they differ from the scene's. */
  changes() {
    const { materials, loads, vertices } = this.steps.now;
    return Object.fromEntries(Object.entries({ materials, loads, vertices }).filter(([key, value]) => JSON.stringify(value) !== JSON.stringify(this.original[key])));
  }

  /** Show the state at once, without any answer to an earlier one, and ask for its own. */
  refresh() {
    this.solution = null;
    this.draw();
    const box = byId("answer");
    box.classList.add("waiting");
    this.live.want({ labelling: this.steps.now.labelling, changes: this.changes() });
  }

  /** @param {any} answer @param {number} ms */
  answered(answer, ms) {
    this.complain("");
    this.solution = answer.solution;
    this.data.loads = answer.loads;
    answer.bodies?.weights.forEach((/** @type {number} */ weight, /** @type {number} */ k) => {
      this.data.structure.elements[k] = { ...this.data.structure.elements[k], weight, centroid: answer.bodies.centroids[k] };
    });
    const found = answer.solution;
    const governing = found.cases[found.governing];
    const sign = found.cases.length > 1 ? "λ / required" : "λ";
    const box = byId("answer");
    box.classList.remove("waiting");
    box.dataset.revision = String(answer.revision);
    const slits = slitsOf(this.data.structure, this.steps.now.labelling).length;
    box.replaceChildren(...[
      el("span", { class: "value" }, found.load_factor === null ? found.status : `${sign} = ${shown(found.load_factor, 6)}`),
      el("span", { class: "bracket" }, `${shownBracket(found.bracket)}, ${found.status}${governing.name ? `, governed by ${governing.name}` : ""}`),
      el("span", { class: "how" }, `${shown(ms, 3)} ms (solve ${shown(1000 * answer.seconds.solve, 2)})`),
      slits ? el("span", { class: "note", id: "slits" }, `no segmentation: ${slits} dry ${slits === 1 ? "face has" : "faces have"} one block on both sides`) : null,
      !slits && answer.against?.length ? el("span", { class: "note", id: "against" }, `outside what a search admits: ${answer.against.join("; ")}`) : null,
    ].filter(Boolean));
    this.draw();
    this.lists();
    if (this.data.structure.dimension === 2) this.blocks(answer.revision);
  }

  /** Bracket the blocks by fields, mesh by mesh as long as this state is shown. @param {number} revision */
  async blocks(revision) {
    const box = byId("answer");
    const line = el("span", { class: "bracket", id: "blocks" }, "blocks that crack anywhere: …");
    box.append(line);
    const state = { page: this.live.page, revision, labelling: this.steps.now.labelling, changes: this.changes() };
    for (let more = true; more;) {
      let found;
      try {
        found = await ask("fields", state);
      } catch (error) {
        found = { refused: error instanceof Error ? error.message : String(error), more: false };
      }
      // of another state nothing is said here
      if (revision !== this.live.revision || found.superseded) return;
      more = found.more;
      line.textContent = found.refused ? `blocks that crack anywhere: not bounded (${found.refused})`
        : found.status === "unstable" ? "blocks that crack anywhere: they fall under their own weight"
          : `blocks that crack anywhere: ${shownBracket(found.bracket)} by ${found.triangles} triangles${more ? " …" : ""}`;
      line.dataset.more = String(more);
    }
  }

  /** @param {string} message */
  failed(message) {
    byId("answer").replaceChildren(el("span", { class: "value" }, "–"), ...(this.act ? [el("span", { class: "note" }, message)] : []));
    if (!this.act) this.complain(message);
  }

  /** @param {string} message */
  complain(message) {
    const box = byId("complaint");
    box.hidden = message === "";
    box.textContent = message;
  }

  draw() {
    const { labelling, vertices } = this.steps.now;
    if (this.joints && this.viewer.places !== vertices) {
      this.viewer.places = vertices;
      this.data.structure = placed(this.first, this.joints, vertices);
    }
    this.viewer.handles = this.joints && this.tool === "joint" && this.viewer.view !== "mechanism" ? handlesOf(this.joints, vertices, labelling) : [];
    this.viewer.slits = new Set(slitsOf(this.data.structure, labelling));
    const own = { name: "now", labelling, solution: this.solution, lacking: "being solved …", line: "" };
    this.viewer.set(this.other ? [own, this.other] : [own]);
    byId("undo").disabled = !this.steps.past.length && !this.steps.before;
    byId("redo").disabled = !this.steps.future.length;
  }

  /** What must follow the state but not every stroke of a slider. */
  controls() {
    materialSliders(byId("materials"), this.steps.now.materials, this.data.structure.units, (materials, finished) => {
      this.steps.preview({ materials });
      if (finished) this.steps.commit();
      this.refresh();
    });
    this.lists();
  }

  lists() {
    const active = document.activeElement;
    if (active && byId("loads").contains(active) && active.tagName === "INPUT") return;
    loadList(byId("loads"), this.steps.now.loads, this.data.cases[this.viewer.case], this.data.structure, (loads) => this.change({ loads }));
  }

  /** @param {any} change */
  change(change) {
    this.steps.step(change);
    this.refresh();
    this.lists();
  }

  /** @param {any} state */
  take(state) {
    this.steps.step(state);
    this.controls();
    this.refresh();
  }

  undo() {
    if (this.steps.undo()) {
      this.controls();
      this.refresh();
      say("Taken back.");
    }
  }

  redo() {
    if (this.steps.redo()) {
      this.controls();
      this.refresh();
      say("Done again.");
    }
  }

  #tools() {
    const choose = (/** @type {string} */ name) => {
      this.tool = name;
      for (const button of byId("tools").querySelectorAll("[data-tool]")) button.setAttribute("aria-pressed", String(button.dataset.tool === name));
      byId("hint").textContent = TOOLS.find(([own]) => own === name)?.[2] ?? "";
      if (this.live.revision) this.draw();
    };
    const tools = TOOLS.filter(([name]) => name !== "joint" || this.joints);
    byId("tools").replaceChildren(
      ...tools.map(([name, title]) => el("button", { type: "button", "data-tool": name, onclick: () => choose(name) }, title)),
      ...(this.joints ? [el("button", { type: "button", id: "improve-joints", title: "some steps of jld move from what is drawn", onclick: () => this.improve() }, "improve joints")] : []),
      el("button", { type: "button", id: "undo", onclick: () => this.undo() }, "undo"),
      el("button", { type: "button", id: "redo", onclick: () => this.redo() }, "redo"),
    );
    choose("toggle");
  }

  /**
   * @param {{face?: number, element?: number, load?: number} | null} what
   * @param {PointerEvent} event
   * @param {any} figure
   */
  pointer(what, event, figure) {
    if (event.type === "pointerdown") return this.begin(what, event, figure);
    if (!this.act) return false;
    if (event.type === "pointerup") return this.end();
    const { act } = this;
    if (act.kind === "toggle" && what?.face !== undefined && this.steps.now.labelling[what.face] !== act.to) {
      this.steps.preview({ labelling: toggled(this.steps.now.labelling, what.face) });
      this.refresh();
    } else if (act.kind === "paint" && what?.element !== undefined && !act.block.has(what.element) && this.isFree(what.element)) {
      act.block.add(what.element);
      this.steps.preview({ labelling: painted(this.data.structure, act.from, act.block) });
      this.refresh();
    } else if (act.kind === "load") {
      const loads = structuredClone(this.steps.now.loads);
      liveOf(loads, this.caseName())[act.load].at = figure.under(event).map((/** @type {number} */ v) => Number(v.toPrecision(6)));
      this.steps.preview({ loads });
      this.refresh();
    } else if (act.kind === "joint") {
      this.steps.preview({ vertices: dragged(act.joints, act.from, act.vertex, figure.under(event, act.screen)) });
      this.refresh();
    }
    return true;
  }

  /** Let the core move the joints by some steps from what is drawn; one step to take back. */
  async improve() {
    const button = byId("improve-joints");
    const state = { labelling: this.steps.now.labelling, changes: this.changes() };
    const revision = this.live.revision;
    button.disabled = true;
    try {
      this.complain("");
      const found = await ask("improve", state);
      // what was drawn meanwhile stays
      if (revision !== this.live.revision) say("The joints were not moved: the layout changed meanwhile.");
      else {
        this.change({ vertices: found.vertices });
        const from = found.start === null ? "a layout that does not stand" : `λ = ${shown(found.start, 6)}`;
        say(`${found.steps} steps from ${from}, ended: ${found.end}.`);
      }
    } catch (error) {
      this.complain(error instanceof Error ? error.message : String(error));
    }
    button.disabled = false;
  }

  /** A stroke is one step. */
  end() {
    if (!this.act) return false;
    this.act = null;
    byId("answer").style.minHeight = "";
    this.steps.commit();
    this.draw();
    this.lists();
    return true;
  }

  /** @param {any} what @param {PointerEvent} event @param {any} figure */
  begin(what, event, figure) {
    if (event.button !== 0 || !what) return false;
    const { labelling } = this.steps.now;
    if (this.tool === "toggle" && what.face !== undefined) {
      this.act = { kind: "toggle", to: labelling[what.face] === "d" ? "i" : "d" };
      this.steps.preview({ labelling: toggled(labelling, what.face) });
      this.refresh();
    } else if (this.tool === "paint" && what.element !== undefined && this.isFree(what.element)) {
      this.act = { kind: "paint", from: labelling, block: new Set([what.element]) };
      this.steps.preview({ labelling: painted(this.data.structure, labelling, this.act.block) });
      this.refresh();
    } else if (this.tool === "joint" && what.vertex !== undefined) {
      this.act = { kind: "joint", joints: this.joints, from: this.steps.now.vertices, vertex: what.vertex, screen: figure.root.getScreenCTM() };
      // the drawing stays where it is while the answer above it changes
      byId("answer").style.minHeight = `${byId("answer").offsetHeight}px`;
    } else if (this.tool === "load") {
      return this.beginLoad(what, event, figure);
    } else return false;
    // a spatial view would turn with the same stroke
    event.stopImmediatePropagation();
    return true;
  }

  /** @param {any} what @param {PointerEvent} event @param {any} figure */
  beginLoad(what, event, figure) {
    const planar = this.data.structure.dimension === 2;
    if (what.load !== undefined && this.data.loads[what.load].kind === "live" && planar) {
      const name = this.caseName();
      const drawn = this.data.loads.filter((load) => load.kind === "live" && load.case === name).indexOf(this.data.loads[what.load]);
      const forces = liveOf(this.steps.now.loads, name).flatMap((load, k) => (load.force ? [k] : []));
      if (drawn < 0 || forces[drawn] === undefined) return false;
      this.act = { kind: "load", load: forces[drawn] };
      return true;
    }
    if (what.element === undefined || !this.isFree(what.element)) return false;
    const element = this.data.structure.elements[what.element];
    const weight = Number(Math.max(element.weight, 1e-12).toPrecision(2));
    const loads = structuredClone(this.steps.now.loads);
    const entry = planar
      ? { element: element.id, force: [0, -weight], at: figure.under(event).map((/** @type {number} */ v) => Number(v.toPrecision(6))) }
      : { element: element.id, force: [0, 0, -weight] };
    liveOf(loads, this.caseName()).push(entry);
    this.change({ loads });
    return true;
  }

  caseName() {
    return this.data.cases[this.viewer.case];
  }

  /** @param {number} element */
  isFree(element) {
    return !this.data.structure.elements[element].support;
  }

  /** @param {KeyboardEvent} event */
  key(event) {
    if (this.data.structure.dimension === 3 && !event.altKey && event.key.startsWith("Arrow")) return false;
    if (event.key.startsWith("Arrow")) {
      this.viewer.current = nextFace(this.data.structure, this.viewer.current, event.key);
      const face = this.data.structure.faces[this.viewer.current];
      const names = face.elements.map((k) => this.data.structure.elements[k].id).join(" – ");
      say(`face ${names}, ${this.steps.now.labelling[this.viewer.current] === "d" ? "dry" : "inner"}`);
      this.draw();
      return true;
    }
    if ((event.key === "Enter" || event.key === " ") && this.viewer.current >= 0) {
      this.change({ labelling: toggled(this.steps.now.labelling, this.viewer.current) });
      return true;
    }
    return false;
  }

  /** @param {any} candidate null to stop comparing */
  async compare(candidate) {
    this.other = undefined;
    if (candidate && JSON.stringify(candidate.changes.vertices ?? {}) !== JSON.stringify(this.steps.now.vertices)) {
      this.complain(`${candidate.name} has its joints elsewhere: show it instead`);
    } else if (candidate) {
      try {
        const answer = await ask("solve", { page: `${this.live.page}-beside`, revision: 0, labelling: candidate.labelling, changes: candidate.changes });
        this.other = { name: candidate.name, labelling: candidate.labelling, solution: answer.solution };
        say(`${differing(candidate.labelling, this.steps.now.labelling).size} faces differ from ${candidate.name}`);
      } catch (error) {
        this.complain(error instanceof Error ? error.message : String(error));
      }
    }
    this.draw();
  }

  /** The best layouts of a search join the candidates. @param {any} found @param {string} name */
  results(found, name) {
    const data = checked(found);
    if (!data.table) return;
    const bits = bytesOf(data.table.labellings);
    const value = data.table.columns.find((column) => column.name === "load_factor")?.values ?? [];
    const faces = this.data.structure.faces.length;
    const vertices = this.joints ? verticesOf(this.first, this.joints, data.scene) : {};
    const best = Array.from({ length: Math.min(10, data.table.rows) }, (_, row) => ({
      name: `${name}, rank ${row + 1}`, labelling: lettersOf(bits, row, faces), text: `λ = ${shown(value[row], 6)}`,
      // a search ran with the materials and loads of its own scene
      changes: {
        ...Object.fromEntries(["materials", "loads"].filter((key) => key in data.scene && JSON.stringify(data.scene[key]) !== JSON.stringify(this.original[key])).map((key) => [key, data.scene[key]])),
        ...(Object.keys(vertices).length ? { vertices } : {}),
      },
    }));
    this.candidates.add(best);
  }

  #export() {
    const name = el("input", { type: "text", value: "scene", "aria-label": "name of the file", maxlength: 60 });
    const state = () => ({ labelling: this.steps.now.labelling, changes: this.changes() });
    const doing = (/** @type {() => Promise<string>} */ act) => async () => {
      try {
        this.complain("");
        say(await act());
      } catch (error) {
        this.complain(error instanceof Error ? error.message : String(error));
      }
    };
    const button = (/** @type {string} */ text, /** @type {string} */ id, /** @type {() => Promise<string>} */ act) => el("button", { type: "button", id, onclick: doing(act) }, text);
    const format = el("select", { "aria-label": "format" }, /** @type {any} */ (this.data.studio).formats.map((/** @type {string} */ kind) => el("option", { value: kind }, kind)));
    const saved = el("p", { class: "hint", role: "status" });
    byId("export").replaceChildren(
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
        const made = await ask("export", { format: format.value, ...state() });
        save(made.name, "application/octet-stream", bytesOf(made.content));
        return `${made.name} was downloaded.`;
      })),
      saved,
    );
  }
}

try {
  const studio = new Studio(checked(await ask("data")));
  document.body.dataset.ready = "yes";
  Object.assign(globalThis, { studio }); // for those who look from the console
} catch (error) {
  byId("title").textContent = "The studio could not be opened";
  const box = byId("complaint");
  box.hidden = false;
  box.textContent = error instanceof Error ? error.message : String(error);
  document.body.dataset.ready = "failed";
}
