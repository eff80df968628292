// @ts-check
/** How the best λ grew with the solves. */
import { el } from "./dom.js";
import { Axes, extentOf, pageColours } from "./axes.js";

/**
 * @param {HTMLElement} host
 * @param {import("./contract.js").Curve[]} curves
 * @param {string} colour
 * @param {string} value what layouts are ranked by: λ, or λ / required
 */
export function convergence(host, curves, colour, value) {
  const told = curves.filter((curve) => curve.solves.length);
  if (!told.length) {
    host.replaceChildren(el("p", { class: "hint" }, "Nothing was found that has a finite load factor."));
    return;
  }
  const last = told.map((c) => `${c.name}: ${c.best[c.best.length - 1]} after ${c.solves[c.solves.length - 1]} solves`).join("; ");
  const canvas = el("canvas", { class: "curve", role: "img", "aria-label": `Best ${value} against solves. ${last}` });
  host.replaceChildren(el("div", { class: "plot" }, canvas));
  const axes = new Axes(canvas, { left: 66, right: 14, top: 8, bottom: 40 });
  const draw = () => {
    const pen = axes.begin();
    const page = pageColours();
    axes.x = [0, Math.max(...told.map((c) => c.solves[c.solves.length - 1]), 1)];
    axes.y = extentOf(told.flatMap((c) => c.best), 0.08);
    axes.frame(pen, "solves", `best ${value} so far [–]`, { whole: true, ink: page.ink, faint: page.faint });
    pen.strokeStyle = page.front || colour;
    pen.lineWidth = 2;
    for (const curve of told) {
      pen.beginPath();
      curve.solves.forEach((n, k) => {
        const [x, y] = [axes.px(n), axes.py(curve.best[k])];
        if (k === 0) pen.moveTo(x, y);
        else {
          pen.lineTo(x, axes.py(curve.best[k - 1]));
          pen.lineTo(x, y);
        }
      });
      pen.stroke();
    }
  };
  new ResizeObserver(draw).observe(canvas);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  draw();
}
