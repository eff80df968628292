"""Steps of assembly orders in the plane: what moves along its direction never cuts what is already there."""

from __future__ import annotations

from typing import Final

import numpy as np
import shapely

from benchmarks.claims.geometry import Move, document, planar_grid, polygon_entry, random_move
from benchmarks.claims.tally import Tally, run_cases
from jld_core import InputError, build_assembly, parse_scene
from jld_practice.laying import assembly_order

CLAIM: Final = "No step of an assembly order cuts a neighbour"
CUT: Final = 1e-9
"""Area, relative to the square of the unit of the grid, that a sweep may share with what rests."""
_FAR: Final = 30.0
"""Length of a sweep, in units of the grid."""


def run(first_seed: int, cases: int, seconds: float) -> Tally:
    """Test the claim on random walls of dry blocks: see `run_cases`."""
    return run_cases(CLAIM, case, first_seed, cases, seconds)


def case(seed: int, tally: Tally) -> str:
    """Return "" where no step of the order of one random wall cuts another block, else the first that does."""
    rng = np.random.default_rng([seed, 1994])
    labels, nodes, straight = planar_grid(rng)
    names = [label for label in np.unique(labels).tolist() if label > 0]
    if len(names) < 2:
        return ""
    move = Move(random_move(rng, 2).turn, 1.0, np.zeros(2))
    elements = [polygon_entry(rng, labels, name, nodes, move, straight) for name in names]
    try:
        built = build_assembly(parse_scene(document(elements, move)))
    except InputError as error:
        return f"refused: {error}"
    order = assembly_order(built, np.ones(len(built.interfaces), dtype=bool))
    of, shapes = order.blocks.of, [shapely.Polygon(shape) for shape in built.elements.shape]
    resting = set(of[built.elements.support].tolist())
    for number, step in enumerate(order.steps):
        still = [shapes[k] for k in range(len(shapes)) if of[k] in resting]
        moving = [shapes[k] for k in np.flatnonzero(np.isin(of, step.blocks)).tolist()]
        cut = max(_shared(shape, still, _FAR * step.direction) for shape in moving)
        if cut > CUT:
            return f"step {number} of {len(order.steps)} cuts {cut:.2g}"
        resting.update(step.blocks)
    tally.notes["steps"] = tally.notes.get("steps", 0) + len(order.steps)
    return ""


def _shared(shape: shapely.Polygon, still: list[shapely.Polygon], way: np.ndarray) -> float:
    """Largest area that the sweep of a triangle of a polygon along a vector shares with a polygon at rest."""
    most = 0.0
    for part in shapely.get_parts(shapely.constrained_delaunay_triangles(shape)):
        corners = shapely.get_coordinates(part)[:3]
        swept = shapely.convex_hull(shapely.multipoints(np.concatenate([corners, corners + way])))
        most = max(most, *(float(shapely.intersection(swept, other, grid_size=1e-12).area) for other in still))
    return most
