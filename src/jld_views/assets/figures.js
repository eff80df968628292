// @ts-check
/** The figure that fits a structure. Pages of planar scenes are written with figures_planar.js in its place. */
import { PlanarFigure } from "./planar.js";
import { SpatialFigure, canDraw } from "./spatial.js";

/**
 * @param {HTMLElement} host
 * @param {import("./contract.js").PageData} data
 * @returns {any} null where this browser cannot draw it
 */
export function figureOf(host, data) {
  if (data.structure.dimension === 2) return new PlanarFigure(host, data);
  return canDraw() ? new SpatialFigure(host, data) : null;
}
