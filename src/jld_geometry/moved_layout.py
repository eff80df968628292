"""Move the joints of one layout, and bound its λ by fields before and after."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.build import build_assembly
from jld_core.errors import InputError
from jld_core.fields.governing import governing_bounds
from jld_core.scene import Scene
from jld_core.threads import one_thread
from jld_geometry.field_moves import move_by_fields
from jld_geometry.moved_scene import MovedScene
from jld_geometry.vertex_mesh import vertex_mesh

_MOVING: Final = 0.8  # share of a task's time in which joints move; first bounds by fields take the rest

_FIRST: Final = 10.0  # longest time for the first bounds by fields of one layout, s

_REFINED: Final = 120.0  # longest time for refined bounds by fields of one layout, s

_NONE: Final = (-math.inf, math.inf)  # bounds where nothing is proven


@dataclass(frozen=True, eq=False)
class MovedLayout:
    """One layout whose joints were moved.

    number: round, from 1. row: row of the layout in the results of that round; 0 for the layout that the scene states.
    labels: (m,) True = dry. start, load_factor: λ by faces before and after; NaN where the layout did not stand.
    fields_start, fields: (float, float) bounds on λ by fields before and after, with blocks that crack anywhere;
    infinite where there are none. end: reason why the optimisation ended, or why the joints cannot move. scene: scene
    with the joints where the lower bound by fields is larger: at the end, or at the start. places, moved: (v, 2)
    positions of the vertices of this scene, and how far each moved in this round.
    """

    number: int
    row: int
    labels: Bits
    start: float
    load_factor: float
    fields_start: tuple[float, float]
    fields: tuple[float, float]
    end: str
    scene: Scene
    places: Floats
    moved: Floats

    @property
    def low(self) -> float:
        """Return the largest proven lower bound on λ by fields."""
        return max(self.fields_start[0], self.fields[0])

    @property
    def high(self) -> float:
        """Return the upper bound on λ by fields of the layout in `scene`; inf if there is none."""
        return self.fields[1] if self.moved.any() else self.fields_start[1]


@one_thread()
def move_one(
    scene: Scene, assembly: Assembly, labels: Bits, number: int, row: int, seconds: float, gap: float
) -> MovedLayout:
    """Move the joints of one layout, and bound λ by fields before and after.

    The bounds before are computed only for the layout of the scene (row 0). labels: (m,) True = dry. number: of the
    round. row: in the results of the round. seconds: time for all steps, s; inf for no limit. gap: relative width at
    which bounds are narrow enough. If the joints cannot move, `end` of the result says why.
    """
    limit = min((1.0 - _MOVING) * seconds, _FIRST)
    # the layout that the scene states is what a gain is measured by
    before = _bounds(assembly, labels, limit, gap) if row == 0 else _NONE
    mesh = vertex_mesh(assembly)
    stated = MovedScene(scene, assembly, labels, mesh).at(mesh.places)
    still = MovedLayout(
        number, row, labels, math.nan, math.nan, before, _NONE, "", stated, mesh.places, np.zeros_like(mesh.places)
    )
    try:
        done = move_by_fields(scene, assembly, labels, seconds=_MOVING * seconds)
    except InputError as error:
        # this layout stays where it is; the reason stands in the table
        return replace(still, end=f"{error.where}: {error.problem}")
    end, after = done.end, _NONE
    try:
        if done.after is not None:
            after = _bounds(done.after.assembly, labels, limit, gap)
    except InputError as error:  # a load may have lost the face on which it is spread
        end = f"{error.where}: {error.problem}"
    still = replace(still, start=done.start, load_factor=done.value, fields=after, end=end)
    if not done.moved.any() or not after > before:
        return still
    return replace(still, scene=done.scene, places=done.places, moved=done.moved)


def refine_one(layout: MovedLayout, seconds: float, gap: float) -> MovedLayout:
    """Return a moved layout with refined bounds by fields.

    seconds: largest time, s. gap: relative width at which refinement ends.
    """
    assembly = build_assembly(layout.scene)
    low, high = _bounds(assembly, assembly.labels, min(seconds, _REFINED), gap)
    known = layout.fields if layout.moved.any() else layout.fields_start
    best = (max(known[0], low), min(known[1], high))
    return replace(layout, fields=best) if layout.moved.any() else replace(layout, fields_start=best)


@one_thread()
def _bounds(assembly: Assembly, labels: Bits, seconds: float, gap: float) -> tuple[float, float]:
    """Return the bounds by fields on the governing factor of one layout.

    labels: (m,) True = dry. seconds: time for all load cases, s. gap: relative width at which refinement ends.
    """
    return governing_bounds(assembly, labels, seconds, gap=gap, lower_first=False)


def rank_key(layout: MovedLayout) -> tuple[float, int, int]:
    """Return the sort key of a moved layout: by lower bound, then round, then row."""
    return -layout.low, layout.number, layout.row
