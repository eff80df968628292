"""Check the best layouts of a search by faces: bound λ of blocks that may crack anywhere.

λ by faces depends on the grid of candidate faces, since blocks crack along these alone. Bounds by fields do not. They
are computed on the coarsest mesh, for the best layouts and for the structure without cuts.
"""

from __future__ import annotations

import json
import time
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.deadline import Deadline
from jld_core.errors import InputError
from jld_core.fields.bounds import CoarseBounds, FieldSetting
from jld_core.fields.problem import require_planar_fields
from jld_core.files import write_text
from jld_core.limit import Status, number
from jld_core.scene import Scene
from jld_core.threads import one_thread
from jld_explore.evaluation.field_evaluator import COARSE_RATE, mesh_seconds
from jld_explore.report import Exploration, Summary
from jld_explore.report.result_files import write_results
from jld_explore.settings import ExploreSettings
from jld_explore.space import SearchSpace, from_string

MOST: Final = 2.0
"""Longest expected processor time of the check, s: fewer layouts are checked where it would take longer."""

SHARE: Final = 0.05
"""Largest share of a time limit that is kept back for the check."""

FALL: Final = 0.05
"""Share of λ by faces that fields must leave, or else it is said."""


@dataclass(frozen=True)
class CheckPlan:
    """Plan for a check of the best layouts by fields."""

    count: int  # layouts checked beside the structure without cuts, 0 for no check
    seconds: float  # expected processor time, s
    skipped: str  # reason why nothing is checked, "" if something is


def plan_check(scene: Scene, assembly: Assembly, space: SearchSpace, settings: ExploreSettings) -> CheckPlan | None:
    """Decide how many layouts of a search by faces can be checked by fields.

    Result: plan. None for spatial scenes, other crack models, cells left out, and searches without dilation, by
    experiment or at low values. Also None for `check_fields` = 0, and if `require_planar_fields` refuses the assembly.
    """
    plain = scene.cracks == "faces" and space.void is None and not assembly.has_low_values
    if (
        not settings.check_fields
        or not plain
        or not settings.model.supports_bounds_over_labellings
        or settings.by_experiment
    ):
        return None
    cases = len(assembly.by_case)
    # meshes of large scenes take seconds; each element with k corners has k − 2 triangles or more
    least = sum(len(assembly.elements.shape[element]) - 2 for element in assembly.elements.free)
    if (each := cases * mesh_seconds(COARSE_RATE, least)) > 0.5 * MOST:
        return CheckPlan(0, 0.0, _too_long(f"{least} or more", each))
    try:
        require_planar_fields(assembly)
    except InputError as error:
        # A criterion is news to those who know that faces of this kind are checked.
        return CheckPlan(0, 0.0, error.problem) if assembly.face_strengths.criteria else None
    triangles = sum(len(FieldSetting.of(case).coarse) for case in assembly.by_case) / cases
    each = cases * mesh_seconds(COARSE_RATE, triangles)
    count = min(settings.check_fields, int(MOST / each) - 1)
    if count < 1:
        return CheckPlan(0, 0.0, _too_long(f"{triangles:.0f}", each))
    return CheckPlan(count, (count + 1) * each, "")


def _too_long(triangles: str, seconds: float) -> str:
    """Return the reason to check no layout: the estimated time for one."""
    return f"{triangles} triangles would take some {seconds:.1f} s for each layout"


def time_for(plan: CheckPlan | None, settings: ExploreSettings) -> float:
    """Return the part of a time limit that is kept back for a check, s; 0 without a limit."""
    return 0.0 if plan is None or settings.seconds is None else min(2.0 * plan.seconds, SHARE * settings.seconds)


def add_check(
    done: Exploration, space: SearchSpace, plan: CheckPlan, deadline: Deadline, settings: ExploreSettings
) -> Exploration:
    """Check the best layouts by fields; write the results with the bounds, and add these to the summary on disk.

    Result: the search with columns `fields_lo` and `fields_hi`, and `fields` in its summary.
    """
    start = time.perf_counter()
    ranked = done.results[done.results["status"] == str(Status.COLLAPSE)].head(plan.count)
    low, high = np.full((2, len(done.results)), np.nan)
    uncut: tuple[float, float] | None = None
    skipped, checked = plan.skipped, 0
    if plan.count and len(ranked):
        labellings = [from_string(str(text)) for text in ranked["labelling"]]
        bounds = _bounds(done.assembly, [space.fixed & ~space.candidates, *labellings], deadline)
        checked = max(len(bounds) - 1, 0)
        skipped = "" if checked else "the time limit left no time for it"
        if checked:
            uncut = bounds[0]
            low[:checked], high[:checked] = np.array(bounds[1:]).T
    results = done.results.assign(
        fields_lo=np.where(np.isfinite(low), low, np.nan), fields_hi=np.where(np.isfinite(high), high, np.nan)
    )
    values = ranked["load_factor"].to_numpy(dtype=float)[:checked]
    findings = _findings(values, low[:checked], high[:checked], uncut)
    facts: dict[str, Any] = {
        "checked": checked,
        "uncut": None if uncut is None else [number(end) for end in uncut],
        "findings": findings,
        "skipped": skipped or None,
        "next": f"jld explore {done.folder / 'scene.json'} --cracks fields --out DIR searches by fields"
        if findings
        else None,
        "seconds": time.perf_counter() - start,
    }
    best = [number(low[0]), number(high[0])] if checked else None
    of_blocks = {"fields": facts, "by_fields": best, "uncut": facts["uncut"]}
    found = replace(done, results=results, summary=Summary.of({**done.summary.facts, **of_blocks}))
    write_results(done.folder, found.results, csv=settings.csv)
    write_text(done.folder / "summary.json", json.dumps(found.summary.facts, indent=1))
    return found


@one_thread()
def _bounds(assembly: Assembly, labellings: list[Bits], deadline: Deadline) -> list[tuple[float, float]]:
    """Bound the governing factor of labellings on the coarsest mesh, until the deadline.

    labellings: each (m,), True = dry. The result has (lower, upper) bound for each of the first labellings, as many as
    there was time for.
    """
    coarse = [CoarseBounds(FieldSetting.of(case), many=False) for case in assembly.by_case]
    required = assembly.required
    found: list[tuple[float, float]] = []
    for labels in labellings:
        if deadline.passed():
            break
        low = min(one.lower(labels)[0] / factor for one, factor in zip(coarse, required, strict=True))
        high = min(one.upper(labels)[0] / factor for one, factor in zip(coarse, required, strict=True))
        found.append((float(low), float(high)))
    return found


def _findings(values: Floats, low: Floats, high: Floats, uncut: tuple[float, float] | None) -> list[str]:
    """Describe in sentences how bounds by fields differ from λ by faces.

    values: (k,) λ by faces of the best layouts, the best first. low, high: (k,) bounds by fields.
    """
    # Bounds by fields may change λ of the best layout, the order of the layouts, and whether cuts are of use.
    if not len(values):
        return []
    found = []
    fallen, falls = high < (1.0 - FALL) * values, high < 0.0
    if falls[0]:
        more = int(falls.sum()) - 1
        others = f", and so do {more} more of the best {len(values)}" if more else ""
        found.append(f"wherever its blocks crack, the best falls under its own weight{others}")
    elif fallen[0]:
        share = 1.0 - high[0] / values[0]
        more = int(fallen.sum()) - 1
        others = f", and {more} more of the best {len(values)} fall by over {FALL:.0%}" if more else ""
        found.append(f"the blocks of the best carry at most {high[0]:.4g}, {share:.0%} less than by faces{others}")
    elif fallen.any():
        found.append(f"{int(fallen.sum())} of the best {len(values)} carry over {FALL:.0%} less than by faces")
    stronger = np.flatnonzero(low[1:] > max(high[0], 0.0)) + 1
    if stronger.size:
        row = int(stronger[np.argmax(low[stronger])])
        found.append(f"row {row + 1} carries at least {low[row]:.4g}, more than the best can")
    if uncut is not None and uncut[0] > max(high.max(), 0.0):
        found.append(f"without cuts it carries at least {uncut[0]:.4g}, more than any of the best {len(values)}")
    return found
