"""Best shape of keyed, wavy or inclined joints by compass search; every value is proven."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import astuple, dataclass, fields
from typing import Final

from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.build import build_assembly
from jld_core.errors import InputError
from jld_core.limit import LimitAnalysisResult, Status
from jld_core.models import solve_rigid
from jld_core.scene import Scene
from jld_core.threads import one_thread
from jld_geometry.joint_profiles import Shape
from jld_geometry.joint_shapes import shaped_scene

_FIRST: Final = 0.4  # relative change of a parameter in the first step

_LAST: Final = 0.02  # relative change at which the search ends

_LEAST: Final = 0.005  # first value of a parameter that is 0, as a share of the length of a face

_NOTHING: Final = 1e-4  # value of a parameter below which it is taken as 0, as a share of the length of a face


@dataclass(frozen=True)
class ShapedJoints:
    """Result of a search for the best shape of joints.

    scene: scene with joints of the best shape. shape: that shape. before, after: analyses with straight joints and with
    the best shape. trials: all shapes tried with their λ; NaN where a tooth does not fit or λ is not proven, inf where
    locked. end: why the search ended: "stationary", "time" or "interrupted".
    """

    scene: Scene
    shape: Shape
    before: LimitAnalysisResult
    after: LimitAnalysisResult
    trials: list[tuple[Shape, float]]
    end: str


@one_thread()
def shape_joints(
    scene: Scene,
    assembly: Assembly,
    labels: Bits,
    shape: Shape,
    direction: Floats | None = None,
    *,
    seconds: float = math.inf,
    progress: Callable[[Shape, float], None] | None = None,
) -> ShapedJoints:
    """Find the parameters of a shape, the same for all joints, with the largest λ.

    Each parameter in turn is raised and lowered by a factor; the factor shrinks where nothing improves. Whole numbers
    stay. λ is that of cracks by faces, with crack planes at the roots of teeth.

    scene: scene, as for `shaped_scene`. labels: (m,) True = dry. shape: shape from which the search begins. direction:
    (3,) in space, direction along which shapes run, as for `shaped_scene`. seconds: time limit, s; the first shape is
    always analysed. progress: called with every shape and its λ. Result: best shape found, and all that were tried.
    Raises InputError as `shaped_scene`, for the first shape. Raises KeyboardInterrupt: an interrupt before the first
    shape is analysed; a later one ends the search with the best so far.
    """
    trials: list[tuple[Shape, float]] = []
    known: dict[tuple[float, ...], float] = {}

    def value(one: Shape) -> float:
        """Return the proven lower bound on λ with a shape, NaN without one."""
        key: tuple[float, ...] = astuple(one)
        if key not in known:
            result = solve_rigid(build_assembly(shaped_scene(scene, assembly, labels, one, direction)))
            locked = result.status is Status.LOCKED
            known[key] = math.inf if locked else result.bracket[0]
            if result.status not in (Status.COLLAPSE, Status.LOCKED):
                known[key] = math.nan
            trials.append((one, known[key]))
            if progress is not None:
                progress(one, known[key])
        return known[key]

    until = time.perf_counter() + seconds
    kept = [(shape, value(shape))]
    try:
        end = _improve(kept, value, trials, until)
    except KeyboardInterrupt:
        end = "interrupted"
    best = kept[0][0]
    shaped = shaped_scene(scene, assembly, labels, best, direction)
    return ShapedJoints(shaped, best, solve_rigid(assembly, labels), solve_rigid(build_assembly(shaped)), trials, end)


def _improve(
    kept: list[tuple[Shape, float]], value: Callable[[Shape], float], trials: list[tuple[Shape, float]], until: float
) -> str:
    """Search from the shape in `kept`, replace it by stronger ones; return why it ended.

    kept: one shape and its λ. value: returns λ of a shape, NaN where it is not proven. trials: receives shapes that do
    not fit. until: end of the search, a time of `time.perf_counter`, s.
    """
    best, most = kept[0]
    names = [one.name for one in fields(best) if isinstance(getattr(best, one.name), float)]
    step = _FIRST
    while step >= _LAST and most < math.inf:
        start = best
        for name in names:
            for sign in (1.0, -1.0):
                if time.perf_counter() > until:
                    return "time"
                now = getattr(best, name)
                changed = now * (1.0 + step) ** sign if now != 0.0 else max(sign, 0.0) * _LEAST
                changed = changed if abs(changed) >= _NOTHING else 0.0
                trial = type(best)(**{**vars(best), name: changed})
                try:
                    found = value(trial)
                except InputError:
                    trials.append((trial, math.nan))  # a tooth does not fit: a trial without a value
                    continue
                if found > most or (math.isnan(most) and not math.isnan(found)):
                    best, most = kept[0] = trial, found
                    break
        if best == start:
            step *= 0.5
    return "stationary"
