// @ts-check
/** Axes of charts on a canvas: round ticks, names with units, from values to px and back. */
import { shown } from "./dom.js";

/** @param {number} low @param {number} high @param {number} most @param {boolean} whole */
export function ticks(low, high, most, whole) {
  const span = Math.max(high - low, 1e-300);
  let step = 10 ** Math.floor(Math.log10(span / most));
  const steps = [1, 2, 5, 10].map((by) => by * step);
  let at = steps.findIndex((one) => span / one <= most);
  if (at < 0) at = steps.length - 1;
  const along = (/** @type {number} */ one) => {
    const by = whole ? Math.max(1, Math.round(one)) : one;
    const found = [];
    for (let k = Math.ceil(low / by - 1e-9); k * by <= high + 1e-9 * span; k++) found.push(Number((k * by).toPrecision(12)));
    return found;
  };
  const found = along(steps[at]);
  return found.length < 2 && at > 0 ? along(steps[at - 1]) : found; // one number alone is no scale
}

export class Axes {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {{left: number, right: number, top: number, bottom: number}} margin px
   */
  constructor(canvas, margin) {
    this.canvas = canvas;
    this.margin = margin;
    /** @type {[number, number]} */
    this.x = [0, 1];
    /** @type {[number, number]} */
    this.y = [0, 1];
  }

  /** Fit the canvas to its place. @returns {CanvasRenderingContext2D} */
  begin() {
    const ratio = window.devicePixelRatio || 1;
    this.wide = this.canvas.clientWidth || 600;
    this.high = this.canvas.clientHeight || 320;
    this.canvas.width = Math.round(this.wide * ratio);
    this.canvas.height = Math.round(this.high * ratio);
    const pen = /** @type {CanvasRenderingContext2D} */ (this.canvas.getContext("2d"));
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, this.wide, this.high);
    return pen;
  }

  get inner() {
    const { left, right, top, bottom } = this.margin;
    return { x: left, y: top, w: Math.max(10, (this.wide ?? 600) - left - right), h: Math.max(10, (this.high ?? 320) - top - bottom) };
  }

  /** @param {number} v */
  px(v) {
    const { x, w } = this.inner;
    return x + ((v - this.x[0]) / (this.x[1] - this.x[0])) * w;
  }

  /** @param {number} v */
  py(v) {
    const { y, h } = this.inner;
    return y + h - ((v - this.y[0]) / (this.y[1] - this.y[0])) * h;
  }

  /** @param {number} px */
  vx(px) {
    const { x, w } = this.inner;
    return this.x[0] + ((px - x) / w) * (this.x[1] - this.x[0]);
  }

  /** @param {number} py */
  vy(py) {
    const { y, h } = this.inner;
    return this.y[0] + ((y + h - py) / h) * (this.y[1] - this.y[0]);
  }

  /** Ticks and names; it makes the room that its numbers need, so it comes first. @param {CanvasRenderingContext2D} pen @param {string} across @param {string} up @param {{whole: boolean, ink: string, faint: string}} look */
  frame(pen, across, up, look) {
    pen.font = "12px system-ui, sans-serif";
    const rungs = ticks(this.y[0], this.y[1], Math.max(2, this.inner.h / 45), false);
    this.margin.left = 34 + Math.max(20, ...rungs.map((t) => pen.measureText(shown(t, 6)).width));
    const { x, y, w, h } = this.inner;
    pen.fillStyle = look.ink;
    pen.strokeStyle = look.faint;
    pen.lineWidth = 1;
    pen.textAlign = "center";
    pen.textBaseline = "top";
    for (const t of ticks(this.x[0], this.x[1], Math.max(2, w / 70), look.whole)) {
      line(pen, this.px(t), y, this.px(t), y + h + 4);
      pen.fillText(shown(t, 6), this.px(t), y + h + 7);
    }
    pen.textAlign = "right";
    pen.textBaseline = "middle";
    for (const t of rungs) {
      line(pen, x - 4, this.py(t), x + w, this.py(t));
      pen.fillText(shown(t, 6), x - 7, this.py(t));
    }
    pen.textAlign = "center";
    pen.textBaseline = "bottom";
    pen.fillText(across, x + w / 2, y + h + this.margin.bottom - 2);
    pen.save();
    pen.translate(13, y + h / 2);
    pen.rotate(-Math.PI / 2);
    pen.textBaseline = "middle";
    pen.fillText(up, 0, 0);
    pen.restore();
  }
}

/** @param {CanvasRenderingContext2D} pen @param {number} a @param {number} b @param {number} c @param {number} d */
function line(pen, a, b, c, d) {
  pen.beginPath();
  pen.moveTo(a, b);
  pen.lineTo(c, d);
  pen.stroke();
}

/** Relative: λ closer than brackets are wide is one λ, and what parts them is no picture. */
const ALIKE = 1e-6;

/** Room beside the extreme values. @param {number[]} values @param {number} share @returns {[number, number]} */
export function extentOf(values, share) {
  let [low, high] = [Infinity, -Infinity];
  for (const v of values) {
    if (v < low) low = v;
    if (v > high) high = v;
  }
  if (low > high) return [0, 1];
  const size = Math.max(Math.abs(low), Math.abs(high));
  const room = high - low > ALIKE * size ? share * (high - low) : 0.05 * size || 0.5;
  return [low - room, high + room];
}

/** Colours of the page, which change with its scheme. front: "" where it is that of the drawing rules. @returns {{ink: string, faint: string, paper: string, accent: string, front: string}} */
export function pageColours() {
  const style = getComputedStyle(document.documentElement);
  const get = (/** @type {string} */ name) => style.getPropertyValue(name).trim();
  return { ink: get("--ink"), faint: get("--faint"), paper: get("--paper"), accent: get("--accent"), front: get("--front") };
}
