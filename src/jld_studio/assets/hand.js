// @ts-check
/** What a hand does to the drawing, tool by tool. */
import { say } from "./dom.js";
import { liveOf, nextFace, painted, toggled } from "./editing.js";
import { dragged } from "./joints.js";

export const TOOLS = [
  ["toggle", "toggle faces", "Click a face to make it dry or inner; drag over faces to do so with many. With the keyboard: arrow keys go from face to face, Enter toggles."],
  ["paint", "paint a block", "Drag over elements: they become one block of their own."],
  ["joint", "move joints", "Drag a vertex of a joint: λ follows. Crack planes that end in it move with it, and λ by faces may then be false: the line of blocks that crack anywhere counts."],
  ["load", "loads", "Drag the tip of a load to move it; click an element to put a load there. With the keyboard: the list of loads."],
  ["support", "supports", "Click an element to make it a support, or free. With the keyboard: the list of supports."],
  ["keep", "keep labels", "Click a face: searches keep its label, or choose it again. With the keyboard: arrow keys and Enter."],
];

export class Hand {
  /** @param {any} studio */
  constructor(studio) {
    this.studio = studio;
    /** @type {any} */
    this.act = null;
    window.addEventListener("pointerup", () => this.end()); // also outside the drawing
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
    const { act, studio } = this;
    const { steps } = studio;
    if (act.kind === "toggle" && what?.face !== undefined && steps.now.labelling[what.face] !== act.to) {
      studio.preview({ labelling: toggled(steps.now.labelling, what.face) });
    } else if (act.kind === "paint" && what?.element !== undefined && !act.block.has(what.element) && this.isFree(what.element)) {
      act.block.add(what.element);
      studio.preview({ labelling: painted(studio.data.structure, act.from, act.block) });
    } else if (act.kind === "load") {
      const loads = structuredClone(steps.now.loads);
      liveOf(loads, studio.caseName())[act.load].at = figure.under(event).map((/** @type {number} */ v) => Number(v.toPrecision(6)));
      studio.preview({ loads });
    } else if (act.kind === "joint") {
      studio.preview({ vertices: dragged(act.joints, act.from, act.vertex, figure.under(event, act.screen)) });
    }
    return true;
  }

  /** A stroke is one step. */
  end() {
    if (!this.act) return false;
    this.act = null;
    this.studio.steps.commit();
    this.studio.draw();
    this.studio.lists();
    return true;
  }

  /** @param {any} what @param {PointerEvent} event @param {any} figure */
  begin(what, event, figure) {
    const { studio } = this;
    const { tool, steps } = studio;
    if (event.button !== 0 || !what) return false;
    const { labelling } = steps.now;
    if (tool === "toggle" && what.face !== undefined) {
      this.act = { kind: "toggle", to: labelling[what.face] === "d" ? "i" : "d" };
      studio.preview({ labelling: toggled(labelling, what.face) });
    } else if (tool === "paint" && what.element !== undefined && this.isFree(what.element)) {
      this.act = { kind: "paint", from: labelling, block: new Set([what.element]) };
      studio.preview({ labelling: painted(studio.data.structure, labelling, this.act.block) });
    } else if (tool === "joint" && what.vertex !== undefined) {
      this.act = { kind: "joint", joints: studio.joints, from: steps.now.vertices, vertex: what.vertex, screen: figure.root.getScreenCTM() };
    } else if (tool === "load") {
      return this.beginLoad(what, event, figure);
    } else if (tool === "support" && what.element !== undefined) {
      studio.support(studio.data.structure.elements[what.element].id, this.isFree(what.element));
    } else if (tool === "keep" && what.face !== undefined) {
      studio.keepFace(what.face);
    } else return false;
    // a spatial view would turn with the same stroke
    event.stopImmediatePropagation();
    return true;
  }

  /** @param {any} what @param {PointerEvent} event @param {any} figure */
  beginLoad(what, event, figure) {
    const { studio } = this;
    const planar = studio.data.structure.dimension === 2;
    if (what.load !== undefined && studio.data.loads[what.load].kind === "live" && planar) {
      const name = studio.caseName();
      const drawn = studio.data.loads.filter((/** @type {any} */ load) => load.kind === "live" && load.case === name).indexOf(studio.data.loads[what.load]);
      const forces = liveOf(studio.steps.now.loads, name).flatMap((load, k) => (load.force ? [k] : []));
      if (drawn < 0 || forces[drawn] === undefined) return false;
      this.act = { kind: "load", load: forces[drawn] };
      return true;
    }
    if (what.element === undefined || !this.isFree(what.element)) return false;
    const element = studio.data.structure.elements[what.element];
    const weight = Number(Math.max(element.weight, 1e-12).toPrecision(2));
    const loads = structuredClone(studio.steps.now.loads);
    const entry = planar
      ? { element: element.id, force: [0, -weight], at: figure.under(event).map((/** @type {number} */ v) => Number(v.toPrecision(6))) }
      : { element: element.id, force: [0, 0, -weight] };
    liveOf(loads, studio.caseName()).push(entry);
    studio.change({ loads });
    return true;
  }

  /** @param {number} element */
  isFree(element) {
    return !this.studio.data.structure.elements[element].support;
  }

  /** @param {KeyboardEvent} event */
  key(event) {
    const { studio } = this;
    const { structure } = studio.data;
    if (event.ctrlKey || event.metaKey) return false;
    if (structure.dimension === 3 && !event.altKey && event.key.startsWith("Arrow")) return false;
    if (event.key.startsWith("Arrow")) {
      studio.viewer.current = nextFace(structure, studio.viewer.current, event.key);
      const face = structure.faces[studio.viewer.current];
      const names = face.elements.map((/** @type {number} */ k) => structure.elements[k].id).join(" – ");
      say(`face ${names}, ${studio.steps.now.labelling[studio.viewer.current] === "d" ? "dry" : "inner"}${face.candidate ? "" : ", keeps its label"}`);
      studio.draw();
      return true;
    }
    if ((event.key === "Enter" || event.key === " ") && studio.viewer.current >= 0) {
      if (studio.tool === "keep") studio.keepFace(studio.viewer.current);
      else studio.change({ labelling: toggled(studio.steps.now.labelling, studio.viewer.current) });
      return true;
    }
    return false;
  }
}
