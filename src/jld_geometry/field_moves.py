"""Move the joints of blocks that may crack anywhere."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from functools import partial
from typing import Final, Unpack

from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.errors import InputError
from jld_core.fields.requirements import require_fields
from jld_core.models import solve_rigid
from jld_core.scene import Scene
from jld_core.threads import one_thread
from jld_geometry.evaluation import Evaluated
from jld_geometry.field_search import FieldPoint, FieldSearch
from jld_geometry.move_run import MoveOptions, MoveRun
from jld_geometry.optimise import MovedJoints, moved_result
from jld_geometry.search import GeometrySearch

# Parts of each edge of the coarsest meshes, in the order of the search: a coarse optimum begins the finer search
_PARTS: Final = (1, 2)

_FIRST: Final = 0.5  # share of a limited time after which the first mesh is left: the second lies nearer to λ

# Expected time of the first step on the second mesh, over that of one solve on the first: 8 solves, each 6 times
_FINER: Final = 50.0


@one_thread()
def move_by_fields(
    scene: Scene,
    assembly: Assembly,
    labels: Bits,
    **options: Unpack[MoveOptions],
) -> MovedJoints:
    """Move joints to raise λ of blocks that may crack anywhere (docs/method.md (11.9)).

    Steps raise the bound by fields from above on a mesh that moves with the blocks. Values and brackets of the points
    returned are those of these meshes; `before` and `after`, `start` and `value` are λ by faces.

    Result: best geometry found. Bound it by `bounds_by_fields` to know what it carries. Raises InputError as
    `move_joints`; for a scene in space, another objective, low values, or one that fields do not take.
    """
    run = MoveRun(**options)
    if assembly.dimension != 2:
        raise InputError("cracks", "joints in space move by faces alone", '"faces"')
    if scene.move is not None and scene.move.maximise != "load_factor":
        raise InputError("move.maximise", f'"{scene.move.maximise}" is not supported by fields', '"load_factor"')
    if assembly.has_low_values:
        raise InputError("cracks", "fields take nominal values of materials alone", '"faces", or nominal values')
    require_fields(assembly)
    search = GeometrySearch(scene, assembly, labels, run.trust)
    fields = FieldSearch(search)
    best: tuple[FieldPoint, str] | None = None
    # the last point accepted: finer meshes refute what coarser ones found, so that it is the one to keep
    last: FieldPoint | None = None

    def report(number: int, point: FieldPoint, predicted: float, radius: float) -> None:
        """Record an accepted point of a start, with predicted objective and trust radius."""
        nonlocal last
        last = point
        bracket = fields.bracket(point) if run.watched else (math.nan, math.nan)
        run.record(number, point.objective, bracket, predicted, radius, fields.solves)

    for number, values in run.each_start(search):
        if values is None:
            continue
        try:
            end = _improve(fields, search, values, run.deadline, partial(report, number))
        except KeyboardInterrupt:
            point = best[0] if best is not None else last
            if point is None:
                raise
            best = point, "interrupted"
            break
        if end is not None and (best is None or end[0].objective > best[0].objective):
            best, run.best = end, end[0].values
    if best is None:
        problem = "blocks that crack anywhere do not stand, nor at any position of joints that was tried"
        raise InputError("move", problem, "a scene that stands, more vertices that move, or more `starts`")
    found = search.evaluator.assembly(best[0].values)
    result = None if found is None else solve_rigid(found, labels)
    before = search.first()
    value = math.nan if result is None else result.load_factor
    return moved_result(search, before, (Evaluated(best[0].values, value, result, []), best[1]), run.points)


def _improve(
    fields: FieldSearch,
    search: GeometrySearch,
    values: Floats,
    deadline: float,
    report: Callable[[FieldPoint, float, float], None],
) -> tuple[FieldPoint, str] | None:
    """Improve variables z (k,) on coarse, then finer meshes; return last point and reason.

    Where blocks do not stand at z, joints first move by faces. deadline: time of `time.perf_counter`, s. None where
    blocks stand nowhere on the way.
    """
    point = fields.start(values, _PARTS[0])
    if point is None:
        moved = _stood(search, values, deadline)
        point = None if moved is None else fields.start(moved, _PARTS[0])
    if point is None:
        return None
    end, spent = "time", 0.0
    for parts in _PARTS:
        if time.perf_counter() + _FINER * spent > deadline:  # too late for the finer mesh: spend what is left on this
            return (point, end) if end != "time" else fields.improve(point, deadline, report)
        began = time.perf_counter()
        finer = point if parts == _PARTS[0] else fields.start(point.values, parts)
        if finer is None:  # the finer mesh refutes this position: what the coarse one found stands for nothing
            return None
        report(finer, finer.objective, search.trust.first * search.unit)
        now = time.perf_counter()
        until = now + _FIRST * (deadline - now) if parts == _PARTS[0] and deadline < math.inf else deadline
        solves = fields.solves
        point, end = fields.improve(finer, until, report)
        spent = (time.perf_counter() - began) / max(fields.solves - solves, 1)
    return point, end


def _stood(search: GeometrySearch, values: Floats, deadline: float) -> Floats | None:
    """Return variables z (k,) at which the structure stands by faces, moved for a larger λ.

    None where no such position is found in half of the time until `deadline`.
    """
    now = time.perf_counter()
    until = now + 0.5 * (deadline - now)
    first = search.evaluate(values, None) or search.standing(values, until)
    if first is None:
        return None
    return search.improve(first, until, lambda *_: None, search.trust.coarse)[0].values
