"""Screen tessellations: solve a few layouts of each at once, to have one early and to share the time of searches."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

import numpy as np

from jld_core.arrays import Bits
from jld_core.assembly import Assembly
from jld_core.build import build_assembly
from jld_core.deadline import Deadline, DeadlinePassed
from jld_core.limit import Status
from jld_core.scene import Scene
from jld_explore.drivers.genetic import Genetic
from jld_explore.evaluation import EvaluatorSettings, evaluator_of
from jld_explore.evaluation.field_time import COARSE_RATE, mesh_seconds
from jld_explore.space import search_space
from jld_practice.design.crushing import why_no_fields, with_crushing

_TABLES: Final = 1.0  # time of a short search and its tables, s

_TRIANGLES: Final = 2.5  # triangles of a coarsest mesh, as a multiple of those that the corners of the cells alone need

_MESHES: Final = 2.0  # time of bounds by fields, as a multiple of that of the coarsest mesh


@dataclass(frozen=True)
class Screening:
    """Strongest of a few layouts of a tessellation.

    assembly: assembly that was searched. labels: (m,) labels of the strongest layout, True = dry; None if none was
    found that stands. load_factor: λ of this layout, −inf without one. count: number of layouts solved. search_seconds:
    least time of a search of this tessellation that is worth its while, with bounds by fields on λ of its best, s.
    """

    assembly: Assembly
    labels: Bits | None
    load_factor: float
    count: int
    search_seconds: float


def searched_scene(scene: Scene) -> Scene:
    """Return the scene in which the labels of a tessellation are searched: faces crush where bounds by fields apply."""
    crushes = scene.dimension == 2 and not why_no_fields(build_assembly(scene))
    return with_crushing(scene) if crushes else scene


def screen(scene: Scene, seed: int, seconds: float, deadline: Deadline) -> Screening:
    """Solve generations of the genetic driver for some time, at least one.

    A search by this driver with the same seed begins with the same layouts.

    seconds: time after which no further generation is begun, s. To prepare the solver takes as long besides. deadline:
    time after which also the first generation ends. Raises InputError if the limits of the scene cannot be met.
    """
    assembly = build_assembly(searched_scene(scene))
    driver = Genetic(search_space(scene, assembly), seed)
    evaluator = evaluator_of(assembly, EvaluatorSettings())
    best, most, count = None, -math.inf, 0
    until = deadline.within(seconds)
    with suppress(DeadlinePassed), deadline.enforced():
        while count == 0 or not until.passed():
            rows = driver.ask()
            if not len(rows):
                break
            found = evaluator.evaluate_all(rows)
            driver.tell(rows, found)
            count += len(found)
            values = [
                math.inf if one.status is Status.LOCKED else one.load_factor if one.status is Status.COLLAPSE else -1.0
                for one in found
            ]
            if (place := int(np.argmax(values))) >= 0 and values[place] >= 0.0 and values[place] > most:
                best, most = rows[place], values[place]
    return Screening(assembly, best, most, count, _search_seconds(assembly))


def _search_seconds(assembly: Assembly) -> float:
    """Return the least time of a search of an assembly, s: its tables, and bounds by fields on two meshes."""
    if assembly.dimension == 3 or why_no_fields(assembly):
        return _TABLES
    corners = sum(len(assembly.elements.shape[element]) - 2 for element in assembly.elements.free)
    return _TABLES + _MESHES * len(assembly.by_case) * mesh_seconds(COARSE_RATE, _TRIANGLES * corners)
