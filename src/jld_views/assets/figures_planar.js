// @ts-check
/** Stands for figures.js in pages of planar scenes, which need no WebGL. */
import { PlanarFigure } from "./planar.js";

/**
 * @param {HTMLElement} host
 * @param {import("./contract.js").PageData} data
 * @returns {any}
 */
export function figureOf(host, data) {
  return new PlanarFigure(host, data);
}
