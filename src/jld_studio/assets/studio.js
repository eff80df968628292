// @ts-check
/** The studio: a layout that is changed by hand, and λ that follows. */
import { bytesOf, differing, lettersOf, slitsOf } from "./blocks.js";
import { Candidates } from "./candidates.js";
import { checked } from "./data.js";
import { byId, el, say, shown, shownBracket } from "./dom.js";
import { Files } from "./files.js";
import { Hand, TOOLS } from "./hand.js";
import { help } from "./help.js";
import { handlesOf, placed } from "./joints.js";
import { keptFace, limitForm } from "./limits.js";
import { ask } from "./live.js";
import { loadForm, showCollapse } from "./loads.js";
import { materialForm } from "./material_fields.js";
import { Live } from "./newest.js";
import { Opening } from "./opening.js";
import { Searches } from "./searches.js";
import { Steps } from "./steps.js";
import { supportList } from "./supports.js";
import { Viewer } from "./viewer.js";

const PARTS = ["materials", "loads", "search", "vertices"];

class Studio {
  /** @param {import("./contract.js").PageData} data */
  constructor(data) {
    const given = /** @type {any} */ (data.studio);
    /** scenes of the states, by name @type {Map<string, {data: any, first: any}>} */
    this.scenes = new Map();
    this.home = given.scene;
    this.#remember(given.scene, data);
    const own = Object.values(data.solutions)[0];
    this.steps = new Steps({ scene: given.scene, labelling: own?.labelling ?? "", ...structuredClone(given.changes) });
    this.tool = "toggle";
    /** name of the scene that is shown @type {string | undefined} */
    this.using = undefined;
    /** @type {any} */
    this.viewer = null;
    /** forms by part of the scene @type {any} */
    this.forms = null;
    /** @type {import("./contract.js").Solution | null} */
    this.solution = null;
    /** texts of λ × load, by case @type {string[][]} */
    this.collapse = [];
    this.hand = new Hand(this);
    this.live = new Live((state) => ask("solve", state), (answer, ms) => this.answered(answer, ms), (message) => this.failed(message), crypto.randomUUID());
    byId("folder").textContent = given.folder;
    const state = () => this.state();
    const complain = (/** @type {string} */ message) => this.complain(message);
    this.opening = new Opening(byId("opened"), (found) => this.opened(found), (job) => this.searches.entry(job));
    this.files = new Files(byId("export"), given.formats, state, complain);
    this.#forms();
    this.#use();
    this.#tools();
    this.candidates = new Candidates(byId("candidates"), given.candidates ?? [], {
      now: () => ({ ...state(), text: [...byId("answer").querySelectorAll(".value:not([hidden])")].map((node) => node.textContent).join("; ") }),
      show: (candidate) => this.go(candidate), compare: (candidate) => this.compare(candidate), complain,
    });
    this.searches = new Searches(byId("searches"), state, { show: (found, job) => this.results(found, job), take: (found) => this.go(found), complain });
    this.help = help();
    byId("open").addEventListener("click", () => this.opening.choose());
    byId("show-help").addEventListener("click", () => this.help.open());
    document.addEventListener("keydown", (event) => this.shortcut(event));
    if (data.table) this.results({ ...data, studio: { scene: given.scene, changes: {} } }, { name: "this folder" });
    this.controls();
    this.refresh();
    if (given.drawing) this.opening.begin(given.drawing, given.drawing.options);
  }

  #forms() {
    const desk = {
      now: (/** @type {"materials"} */ part) => this.steps.now[part],
      judge: async (/** @type {string} */ part, /** @type {any} */ value) => {
        const { scene, changes } = this.state();
        return (await ask("edit", { scene, part, changes: { ...changes, [part]: value } })).value;
      },
      change: (/** @type {any} */ change) => this.change(change),
      preview: (/** @type {any} */ change) => this.preview(change),
      finish: (/** @type {any} */ change) => { this.steps.preview(change); this.steps.commit(); this.refresh(); this.controls(); },
      context: () => `${this.steps.now.scene} ${this.caseName()}`,
      cancel: () => { this.steps.cancel(); this.refresh(); this.controls(); },
    };
    const data = () => this.data;
    this.forms = {
      materials: materialForm(byId("materials"), /** @type {any} */ (desk), data),
      loads: loadForm(byId("loads"), /** @type {any} */ (desk), {
        data, caseName: () => this.caseName(), showCase: (name) => this.viewer.setCase(this.data.cases.indexOf(name)),
      }),
      limits: limitForm(byId("limits"), /** @type {any} */ (desk), data),
    };
  }

  /** @param {string} name @param {any} data */
  #remember(name, data) {
    this.scenes.set(name, { data, first: data.structure });
  }

  /** Show the scene of the state: its structure, viewer, title and file name. */
  #use() {
    const { scene } = this.steps.now;
    if (this.using === scene) return;
    this.using = scene;
    const { data, first } = /** @type {any} */ (this.scenes.get(scene));
    this.data = data;
    this.first = first;
    /** @type {import("./joints.js").Joints | null} null where no vertex may move */
    this.joints = data.studio.joints;
    this.original = data.studio.changes;
    this.other = undefined;
    byId("title").textContent = data.title;
    document.title = `${data.title} – jld studio`;
    this.files.rename(data.studio.file);
    this.opening.show(scene);
    this.#view();
    if (this.tool === "joint" && !this.joints) this.tool = "toggle";
    if (byId("tools").firstChild) this.#tools();
  }

  /** Another viewer, for another structure or other load cases. */
  #view() {
    const before = this.viewer;
    before?.set([]);
    this.viewer = new Viewer(byId("viewer"), this.data, {
      pointer: (what, event, figure) => this.hand.pointer(what, event, figure), key: (event) => this.hand.key(event), changed: () => this.lists(),
      stem: () => this.files.name.value || this.data.studio.file,
    });
    if (!before) return;
    this.viewer.show = before.show;
    this.viewer.view = before.view;
    const place = before.caseGiven ? this.data.cases.indexOf(before.data.cases[before.case]) : -1;
    if (place >= 0) this.viewer.setCase(place);
  }

  /** What is asked of the core: scene, labels, and materials, loads, limits and vertices where they differ from the scene's. */
  state() {
    const { now } = this.steps;
    const changes = Object.fromEntries(PARTS.map((part) => [part, now[/** @type {"loads"} */ (part)]]).filter(([part, value]) => JSON.stringify(value) !== JSON.stringify(this.original[part])));
    return { scene: now.scene, labelling: now.labelling, changes };
  }

  /** Show the state at once, without any answer to an earlier one, and ask for its own. */
  refresh() {
    this.#use();
    this.solution = null;
    this.draw();
    byId("answer").classList.add("waiting");
    this.collapse = [];
    showCollapse(byId("loads"), []);
    this.live.want(this.state());
  }

  /** @param {any} answer @param {number} ms */
  answered(answer, ms) {
    this.complain("");
    this.solution = answer.solution;
    this.collapse = answer.collapse;
    this.data.loads = answer.loads;
    const { elements, faces } = this.data.structure;
    answer.bodies.weights.forEach((/** @type {number} */ weight, /** @type {number} */ k) => {
      elements[k] = { ...elements[k], weight, centroid: answer.bodies.centroids[k] };
    });
    answer.candidates?.forEach((/** @type {boolean} */ candidate, /** @type {number} */ k) => { faces[k] = { ...faces[k], candidate }; });
    if (JSON.stringify(answer.cases) !== JSON.stringify(this.data.cases)) {
      this.data.cases = answer.cases;
      this.#view();
    }
    this.draw();
    this.lists();
    this.#say(answer, ms);
    if (this.data.structure.dimension === 2) this.blocks(answer.revision, answer);
  }

  /** Say what is known of λ. @param {any} answer @param {number} ms */
  #say(answer, ms) {
    const found = answer.solution;
    const governing = found.cases[found.governing];
    const sign = found.cases.length > 1 ? "λ / required" : "λ";
    const box = byId("answer");
    box.classList.remove("waiting");
    box.dataset.revision = String(answer.revision);
    const slits = slitsOf(this.data.structure, this.steps.now.labelling).length;
    const drawn = found.status === "locked" ? "no live load brings it down" : found.load_factor === null ? found.status : `${sign} = ${shown(found.load_factor, 6)}`;
    box.replaceChildren(...[
      el("span", { class: "value", id: "by-faces" }, drawn, el("small", {}, " by the faces drawn")),
      el("span", { class: "value", id: "anywhere", hidden: true }),
      el("span", { id: "lambda-load", class: "collapse" }),
      el("span", { class: "note", id: "carried", hidden: true }),
      el("span", { class: "bracket" }, `${shownBracket(found.bracket)}, ${found.status}${governing.name ? `, governed by ${governing.name}` : ""}`),
      el("span", { class: "how" }, `${shown(ms, 3)} ms (solve ${shown(1000 * answer.seconds.solve, 2)})`),
      slits ? el("span", { class: "note", id: "slits" }, `no segmentation: ${slits} dry ${slits === 1 ? "face has" : "faces have"} one block on both sides`) : null,
      !slits && answer.against?.length ? el("span", { class: "note", id: "against" }, `outside what a search admits: ${answer.against.join("; ")}`) : null,
      answer.unsearched ? el("span", { class: "note" }, `no search: ${answer.unsearched}`) : null,
    ].filter(Boolean));
    this.#verdict(answer, null);
  }

  /** Let the weaker of both crack models head the answer. @param {any} answer @param {any} fields null before the first mesh */
  #verdict(answer, fields) {
    const found = answer.solution;
    const sign = found.cases.length > 1 ? "λ / required" : "λ";
    const [low, high] = fields?.bracket ?? [null, null];
    const falls = fields?.status === "unstable";
    const known = falls || low !== null || high !== null;
    const governs = falls || (high !== null && (found.load_factor === null || high <= found.load_factor)) || (low !== null && found.load_factor === null);
    const place = byId("anywhere");
    place.hidden = !known;
    if (known) {
      const bounds = low === null || low < 0 ? `${sign} ≤ ${shown(high, 3)}` : high === null ? `${sign} ≥ ${shown(low, 3)}` : `${sign} = ${shown(low, 3)} to ${shown(high, 3)}`;
      place.replaceChildren(falls ? "falls under its own weight" : bounds, el("small", {}, " wherever blocks crack"));
    }
    byId("by-faces").classList.toggle("weaker", governs);
    place.classList.toggle("weaker", known && !governs);
    this.collapse = governs ? fields.collapse : answer.collapse;
    showCollapse(byId("loads"), this.collapse[this.viewer.case] ?? []);
    const texts = (this.collapse[this.viewer.case] ?? []).filter(Boolean);
    const more = found.cases.length > 1 ? ` (${this.caseName()})` : "";
    const loads = texts.length > 3 ? `${texts.slice(0, 3).join(", ")} and ${texts.length - 3} more` : texts.join(", ");
    byId("lambda-load").textContent = loads ? `λ × load = ${loads}${more}` : "";
    const most = governs ? (falls ? 0 : high) : found.status === "unstable" ? 0 : found.load_factor;
    const least = governs ? low : known ? (low ?? 0) : 0;
    const note = byId("carried");
    note.hidden = (most === null || most >= 1) && !(known && least >= 1);
    note.textContent = most !== null && most < 1 ? "the load drawn is not carried" : "the load drawn is carried";
    note.classList.toggle("good", !(most !== null && most < 1));
  }

  /** Bracket the blocks by fields, mesh by mesh as long as this state is shown. @param {number} revision @param {any} answer */
  async blocks(revision, answer) {
    const box = byId("answer");
    const line = el("span", { class: "bracket", id: "blocks" }, "blocks that crack anywhere: …");
    box.append(line);
    const state = { page: this.live.page, revision, ...this.state() };
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
      if (!found.refused) this.#verdict(answer, found);
      line.dataset.more = String(more);
    }
  }

  /** @param {string} message */
  failed(message) {
    byId("answer").replaceChildren(el("span", { class: "value" }, "–"), ...(this.hand.act ? [el("span", { class: "note" }, message)] : []));
    if (!this.hand.act) this.complain(message);
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
    this.#use();
    this.forms.materials.render();
    this.forms.limits.render();
    supportList(byId("supports"), this.data.structure, (element, support) => this.support(element, support));
    this.opening.show(this.steps.now.scene);
    this.lists();
  }

  lists() {
    this.forms.loads.render();
    showCollapse(byId("loads"), this.collapse[this.viewer.case] ?? []);
  }

  /** One step. @param {any} change */
  change(change) {
    this.steps.step(change);
    this.refresh();
    this.controls();
  }

  /** Part of a step that goes on. @param {any} change */
  preview(change) {
    this.steps.preview(change);
    this.refresh();
  }

  /** Go to a layout of any scene, as one step. @param {{scene?: string, labelling: string, changes: any}} wanted */
  async go(wanted) {
    const scene = wanted.scene ?? this.home;
    try {
      if (!this.scenes.has(scene)) this.#remember(scene, checked((await ask("show", { scene })).data));
      const { changes } = /** @type {any} */ (this.scenes.get(scene)).data.studio;
      this.change({ scene, labelling: wanted.labelling, ...structuredClone({ ...changes, ...wanted.changes }) });
    } catch (error) {
      this.complain(error instanceof Error ? error.message : String(error));
    }
  }

  /** Show a scene that the core has made, with its own labels. @param {any} found */
  opened(found) {
    this.complain("");
    const data = checked(found.data);
    if (!this.scenes.has(found.scene)) this.#remember(found.scene, data);
    const labelling = Object.values(data.solutions)[0].labelling;
    this.change({ scene: found.scene, labelling, ...structuredClone(/** @type {any} */ (data.studio).changes) });
    say(`${data.title} was opened.`);
  }

  /** @param {string} element @param {boolean} support */
  async support(element, support) {
    const revision = this.live.revision;
    try {
      const found = await ask("support", { ...this.state(), element, support });
      if (revision === this.live.revision) this.opened(found);
    } catch (error) {
      const message = error instanceof Error ? error.message : String(error);
      const box = byId("supports").querySelector(".problem");
      box.hidden = false;
      box.textContent = message;
      this.complain(message);
    }
  }

  /** Let searches keep the label of a face, or choose it again. @param {number} face */
  keepFace(face) {
    const { elements, faces } = this.data.structure;
    const pair = faces[face].elements.map((/** @type {number} */ k) => elements[k].id);
    this.forms.limits.take(keptFace(this.steps.now.search, pair, this.steps.now.labelling[face] === "d" ? "dry" : "inner"));
  }

  undo() {
    if (this.steps.undo()) this.#stepped("Taken back.");
  }

  redo() {
    if (this.steps.redo()) this.#stepped("Done again.");
  }

  /** @param {string} words */
  #stepped(words) {
    this.complain("");
    this.refresh();
    this.controls();
    say(words);
  }

  /** @param {KeyboardEvent} event */
  shortcut(event) {
    const target = /** @type {any} */ (event.target);
    const typing = target.matches("input:not([type=range]):not([type=checkbox]), textarea");
    const key = event.key.toLowerCase();
    if (event.ctrlKey || event.metaKey) {
      // a field with changes of its own takes back what was typed
      if (typing && key !== "o" && (target.dataset.was === undefined || target.value !== target.dataset.was)) return;
      if (key === "z" && !event.shiftKey && this.opening.asking.open) this.opening.asking.undo();
      else if (key === "z" && !event.shiftKey) this.undo();
      else if (key === "y" || (key === "z" && event.shiftKey)) this.redo();
      else if (key === "o") this.opening.choose();
      else return;
      event.preventDefault();
    } else if (event.key === "?" && !typing) {
      this.help.open();
      event.preventDefault();
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
      el("button", { type: "button", id: "undo", title: "Ctrl+Z", onclick: () => this.undo() }, "undo"),
      el("button", { type: "button", id: "redo", title: "Ctrl+Y", onclick: () => this.redo() }, "redo"),
    );
    choose(this.tool);
  }

  /** Let the core move the joints by some steps from what is drawn; one step to take back. */
  async improve() {
    const button = byId("improve-joints");
    const revision = this.live.revision;
    button.disabled = true;
    try {
      this.complain("");
      const found = await ask("improve", this.state());
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

  caseName() {
    return this.data.cases[this.viewer.case];
  }

  /** @param {any} candidate null to stop comparing */
  async compare(candidate) {
    this.other = undefined;
    if (candidate && (candidate.scene ?? this.home) !== this.steps.now.scene) {
      this.complain(`${candidate.name} has another structure: show it instead`);
    } else if (candidate && JSON.stringify(candidate.changes.vertices ?? {}) !== JSON.stringify(this.steps.now.vertices)) {
      this.complain(`${candidate.name} has its joints elsewhere: show it instead`);
    } else if (candidate) {
      try {
        const { scene, labelling, changes } = candidate;
        const answer = await ask("solve", { page: `${this.live.page}-beside`, revision: 0, scene, labelling, changes });
        this.other = { name: candidate.name, labelling, solution: answer.solution };
        say(`${differing(labelling, this.steps.now.labelling).size} faces differ from ${candidate.name}`);
      } catch (error) {
        this.complain(error instanceof Error ? error.message : String(error));
      }
    }
    this.draw();
  }

  /** The best layouts of a search join the candidates, in the scene that was searched; that of a design is opened. @param {any} found @param {any} job */
  results(found, { name, kind }) {
    if (kind === "design") {
      this.opening.asking.close();
      return this.opened(found);
    }
    const data = checked(found);
    if (!data.table) return;
    const { scene, changes } = found.studio;
    const bits = bytesOf(data.table.labellings);
    const value = data.table.columns.find((column) => column.name === "load_factor")?.values ?? [];
    const faces = data.structure.faces.length;
    this.candidates.add(Array.from({ length: Math.min(10, data.table.rows) }, (_, row) => ({
      name: `${name}, rank ${row + 1}`, scene, labelling: lettersOf(bits, row, faces), text: `λ = ${shown(value[row], 6)}`, changes,
    })));
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
