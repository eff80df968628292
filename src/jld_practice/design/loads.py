"""Loads of a design: forces along the outline of a structure, and a push to either side."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import shapely

from jld_core import Assembly, Floats, ParameterError
from jld_core.build import build_assembly
from jld_core.refinement import prism_of
from jld_core.scene import Scene, parse_scene
from jld_practice.design.options import DesignOptions, loaded_line

_SPREAD: Final = 0.1  # default length over which a load is spread, relative to the length that it acts along

# Share of its width by which a load in space lies beside the middle, which is a joint of many tessellations
_BESIDE: Final = 1e-3


def with_loads(scene: Scene, options: DesignOptions, side: Floats | None = None) -> Scene:
    """Replace the live loads of a scene by those of the options, along `side` (d,)."""
    # The scene is returned as it is if the options state no load. The force at each place is a load case, as is the
    # push to either side. A force is spread on the pieces below it by their lengths, so that every tessellation carries
    # the same load.
    if options.load is None and options.push is None:
        return scene
    assembly = build_assembly(scene)
    side = side_of(assembly) if side is None else side
    document = scene.model_dump(mode="json", exclude_defaults=True)
    cases: list[dict[str, Any]] = []
    size = options.force(assembly.units[1])
    if size is not None:
        for at, live in _forces(assembly, size, options, side):
            cases.append({"name": f"load at {at:.4g}", "live": live})
    if options.push is not None:
        for name, sign in (("push to the right", 1.0), ("push to the left", -1.0)):
            cases.append({"name": name, "live": [{"body": (sign * options.push * side + 0.0).tolist()}]})
    loads = {key: value for key, value in document["loads"].items() if key == "dead"}
    document["loads"] = loads | ({"cases": cases} if len(cases) > 1 else {"live": cases[0]["live"]})
    return parse_scene(document, scene.name)


def side_of(assembly: Assembly) -> Floats:
    """Return the horizontal unit vector (d,) along which a structure spans."""
    # In the plane it is at right angles to gravity. In space it is a horizontal axis of the scene. If the largest free
    # element is a prism that does not stand upright, it is the axis most nearly across the prism. Otherwise it is the
    # longer side of the plan.
    down = _down(assembly)
    if assembly.dimension == 2:
        return np.array([-down[1], down[0]])
    elements = assembly.elements
    largest = int(max(elements.free, key=lambda k: elements.volume[k]))
    flat = [axis for axis in range(3) if abs(down[axis]) < 0.5]
    prism = prism_of(elements.shape[largest], elements.faces[largest])
    if prism is not None and abs(float(prism.axes[2] @ down)) < 0.5:
        axis = min(flat, key=lambda k: abs(prism.axes[2][k]))
    else:
        extent = elements.upper[elements.free].max(axis=0) - elements.lower[elements.free].min(axis=0)
        axis = max(flat, key=lambda k: extent[k])
    return np.asarray(np.eye(3)[axis])


def _down(assembly: Assembly) -> Floats:
    """Return the unit vector (d,) of the total weight; the negative last axis without weight."""
    total = assembly.elements.weight.sum(axis=0)
    length = float(np.linalg.norm(total))
    return np.asarray(total / length) if length > 0.0 else -np.asarray(np.eye(assembly.dimension)[-1])


def _forces(
    assembly: Assembly, size: float, options: DesignOptions, side: Floats
) -> list[tuple[float, list[dict[str, Any]]]]:
    """Return the coordinate along `side` (d,) and the point loads of the force at each place."""
    # in the plane places lie along the edges that the options name, and the force is spread on the outermost ones
    if assembly.dimension == 3:
        if options.along != "top":
            raise ParameterError("along", "loads in space act from above", "top, or a planar outline")
        return _forces_in_space(assembly, size, options, side)
    down = _down(assembly)
    line = loaded_line(assembly, options.along, down)
    low, high = line.ends
    width = options.width if options.width is not None else _SPREAD * (high - low)
    if not width < high - low:
        raise ParameterError("width", f"{width:g} is not below the loaded length, {high - low:g}", "a shorter length")
    found = []
    for share in options.shares():
        middle = min(max(low + share * (high - low), low + 0.5 * width), high - 0.5 * width)
        parts = line.spread(middle - 0.5 * width, middle + 0.5 * width)
        total = sum(right - left for _, left, right in parts)
        if not total > 0.0:
            problem = f"no free edge lies at the place {middle:.4g}"
            raise ParameterError("places", problem, "a place at the structure, away from its supports")
        live = []
        for edge, a, b in parts:
            along = (0.5 * (a + b) - edge.low) / (edge.high - edge.low)
            reach = float(np.hypot(*(edge.q - edge.p))) * (b - a) / (edge.high - edge.low)
            live.append(
                {
                    "element": assembly.elements.ids[edge.element],
                    "force": ((b - a) / total * size * down).tolist(),
                    "at": (edge.p + along * (edge.q - edge.p)).tolist(),
                    # a patch that ends at a corner must not pass it by rounding
                    "width": (1.0 - 1e-9) * reach,
                }
            )
        found.append((middle, live))
    return found


def _forces_in_space(
    assembly: Assembly, size: float, options: DesignOptions, direction: Floats
) -> list[tuple[float, list[dict[str, Any]]]]:
    """Return the coordinate along `direction` (3,) and the point load at each place, on the uppermost face."""
    # across it the load acts near the middle of the plan, or of the nearest wall where nothing lies there
    if options.width is not None:
        raise ParameterError("width", "loads in space act at points", "a planar outline, or no width")
    elements = assembly.elements
    down = _down(assembly)
    vertical = int(np.argmax(abs(down)))
    flat = [axis for axis in range(3) if axis != vertical]
    side = int(np.argmax(abs(direction)))
    other = next(axis for axis in flat if axis != side)
    every = np.concatenate([elements.shape[k] for k in elements.free])
    lower, upper = every.min(axis=0), every.max(axis=0)
    outlines = [
        (k, elements.shape[k][list(loop)], shapely.Polygon(elements.shape[k][list(loop)][:, flat]))
        for k in elements.free.tolist()
        for loop in elements.faces[k]
    ]
    outlines = [one for one in outlines if one[2].area > 0.0]
    below = shapely.union_all([shapely.buffer(outline, 0.0) for _, _, outline in outlines])
    found = []
    for share in options.shares():
        plan = np.zeros(3)
        plan[side] = lower[side] + share * (upper[side] - lower[side])
        ends = np.array([lower, upper])
        ends[:, side] = plan[side]
        parts = shapely.get_parts(shapely.intersection(below, shapely.LineString(ends[:, flat])))
        spans = [shapely.get_coordinates(part)[:, flat.index(other)] for part in parts]
        if not spans:
            raise ParameterError("places", f"nothing lies below the place {plan[side]:.4g}", "another place")
        middle = lower[other] + (0.5 - _BESIDE) * (upper[other] - lower[other])
        over = [span for span in spans if span.min() <= middle <= span.max()]
        span = min(over or spans, key=lambda one: (round(float(abs(one - middle).min() / np.ptp(ends)), 2), one.min()))
        plan[other] = middle if over else span.min() + (0.5 - _BESIDE) * np.ptp(span)
        point = shapely.Point(plan[flat])
        hits = [
            (_height(corners, plan, flat, vertical, down), -k)
            for k, corners, outline in outlines
            if outline.covers(point)
        ]
        level, k = max(hits)
        at = plan.copy()
        at[vertical] = -level * np.sign(down[vertical])
        live = [{"element": elements.ids[-k], "force": (size * down).tolist(), "at": at.tolist()}]
        found.append((float(plan[side]), live))
    return found


def _height(corners: Floats, plan: Floats, flat: list[int], vertical: int, down: Floats) -> float:
    """Return the height of a plane face (k, 3) above a point (3,) of the plan; −inf for an upright face."""
    middle = corners.mean(axis=0)
    normal = np.linalg.svd(corners - middle)[2][2]
    if abs(normal[vertical]) < 1e-9:
        return -np.inf
    level = middle[vertical] - (normal[flat] @ (plan[flat] - middle[flat])) / normal[vertical]
    return float(-level * np.sign(down[vertical]))
