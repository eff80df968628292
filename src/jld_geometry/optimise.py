"""Optimise joints by programs over forces and positions; every point is proven."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Unpack

from jld_core import tolerances
from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.build import build_assembly, build_robust
from jld_core.errors import InputError
from jld_core.limit import LimitAnalysisResult, Status
from jld_core.models import solve_rigid
from jld_core.scene import Scene, parse_scene
from jld_core.threads import one_thread
from jld_geometry.evaluation import Evaluated
from jld_geometry.move_run import MoveOptions, MoveRun, Point
from jld_geometry.search import GeometrySearch


@dataclass(frozen=True)
class MovedJoints:
    """Result of an optimisation of joints.

    scene: scene with the joints at the best positions found. before, after: analyses at start and end; None where the
    start does not stand. objective: the objective, as in the key "maximise". start, value: objective at start and end;
    NaN for a start that does not stand, inf for a locked end. end: why the best search ended: "stationary", "locked",
    "time", "points", or "interrupted" by KeyboardInterrupt. points: all accepted points of all starts. places: (v, d)
    positions of the vertices at the end. moved: (v, d) displacement of each vertex from the start, scene units.
    parameters: number of independent variables. warnings: reservations about the value, one line each.
    """

    scene: Scene
    before: LimitAnalysisResult | None
    after: LimitAnalysisResult | None
    objective: str
    start: float
    value: float
    end: str
    points: list[Point]
    places: Floats
    moved: Floats
    parameters: int
    warnings: list[str] = field(default_factory=list)


@one_thread()
def move_joints(
    scene: Scene,
    assembly: Assembly,
    labels: Bits,
    **options: Unpack[MoveOptions],
) -> MovedJoints:
    """Move the joints of a structure to optimise the objective that its key "move" states.

    The objective is the largest λ, or the least friction or thickness at which the dead load stands.

    scene: scene; its key "move" states variables, limits and objective. In space λ is the objective, of dry joints.
    assembly: its assembly; one of `build_robust` is optimised at the low values of materials. labels: (m,) True = dry.
    **options: time limit, number of starts, trust region and progress, as in `MoveOptions`. Result: best geometry
    found, every accepted point of all searches, and why the best one ended. Raises InputError: the key "move" does not
    fit the structure, or neither it nor any position tried stands. Raises KeyboardInterrupt: an interrupt before the
    first accepted point; a later one ends the search with the best so far.

    docs/method.md (11.6).
    """
    run = MoveRun(**options)
    search = GeometrySearch(scene, assembly, labels, run.trust)
    before = search.first()
    # the strongest point so far, for an interrupt
    kept: list[Evaluated] = []
    try:
        best = _best_of_starts(search, before, run, kept)
    except KeyboardInterrupt:
        if not kept:
            raise
        best = kept[0], "interrupted"
    return moved_result(search, before, best, run.points)


def _best_of_starts(
    search: GeometrySearch, before: Evaluated | None, run: MoveRun, kept: list[Evaluated]
) -> tuple[Evaluated, str]:
    """Optimise from every start, then from the best end; return best point and reason.

    before: the point of the scene itself, None where it does not stand. run: receives every accepted point. kept:
    receives the best point alone. Raises InputError where no position stands.
    """
    best: tuple[Evaluated, str] | None = None

    def report(number: int, point: Evaluated, predicted: float, radius: float) -> None:
        """Record an accepted point of a start, with predicted objective and trust radius."""
        bracket = (math.nan, math.nan) if point.result is None else point.result.bracket
        if search.goal != "load_factor":
            bracket = (math.nan, math.nan)
        if not kept or point.objective > kept[0].objective:
            kept[:] = [point]
        promised = search.value_of(replace(point, objective=predicted))
        run.record(number, search.value_of(point), bracket, promised, radius, search.evaluator.solves)

    for number, start in run.each_start(search):
        first = before if number == 0 else None if start is None else search.evaluate(start, before)
        if first is None and start is not None:
            first = search.standing(start, run.deadline)
        if first is None:
            continue
        own = partial(report, number)
        own(first, first.objective, search.trust.first * search.unit)
        end = search.improve(first, run.deadline, own, search.trust.coarse)
        # a geometry as strong as one before, up to the width of brackets, is no reason to move farther
        least = -math.inf if best is None else best[0].objective + tolerances.GAP * abs(best[0].objective)
        if best is None or end[0].objective > least:
            best, polish, run.best = end, own, end[0].values
    if best is None:
        problem = "it does not stand under its dead load, nor does any position of its joints that was tried"
        raise InputError("move", problem, "a scene that stands, more vertices that move, or more `starts`")
    if best[1] == "stationary":
        return search.improve(best[0], run.deadline, polish, search.trust.gain)
    return best


def moved_result(
    search: GeometrySearch, before: Evaluated | None, best: tuple[Evaluated, str], points: list[Point]
) -> MovedJoints:
    """Assemble the result of a search; best: the last point, and why its search ended."""
    point, end = best
    places = search.variables.places(point.values)
    scene = search.moved.at(places, point.friction)
    return MovedJoints(
        scene=scene,
        before=None if before is None else before.result,
        after=point.result,
        objective=search.move.maximise,
        start=math.nan if before is None else search.value_of(before),
        value=search.value_of(point),
        end=end,
        points=points,
        places=places,
        moved=places - search.variables.start,
        parameters=search.variables.basis.shape[1],
        warnings=_contacts_found(search, scene, point),
    )


def _contacts_found(search: GeometrySearch, scene: Scene, point: Evaluated) -> list[str]:
    """Return a warning (list of one) if contacts found anew give another λ; else no warning.

    Only results with λ as objective, dry joints alone and no strengths of single interfaces are compared.
    """
    result = point.result
    if search.goal != "load_factor" or result is None or result.status is not Status.COLLAPSE:
        return []
    if not search.evaluator.labels.all():
        return []
    document = scene.model_dump(mode="json", exclude_defaults=True)
    if any(set(entry) > {"elements", "polygon", "label"} for entry in document.pop("interfaces")):
        return []  # stated strengths of single interfaces would be lost
    found = parse_scene({**document, "labels": {"default": "dry"}})
    again = solve_rigid(build_robust(found) if result.assembly.has_low_values else build_assembly(found)).load_factor
    if abs(again - result.load_factor) <= tolerances.GAP * abs(result.load_factor):
        return []
    return [f"contacts found anew give λ = {again:.6g}: joints touch where none did before, or no longer do"]
