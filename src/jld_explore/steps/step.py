"""What follows a search: steps that add entries and columns, the runner of all, and the check by fields."""

from __future__ import annotations

import math
import time
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Final

import numpy as np

from jld_core import plugins
from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.deadline import Deadline
from jld_core.errors import InputError
from jld_core.fields.bounds import CoarseBounds, FieldSetting
from jld_core.fields.problem import require_planar
from jld_core.limit import number
from jld_core.limit.options import Status
from jld_core.models import CaseAnalysis
from jld_core.scene.schema import Scene
from jld_core.threads import one_thread
from jld_explore.evaluation.field_evaluator import COARSE_RATE, mesh_seconds
from jld_explore.report.columns import require_own_columns
from jld_explore.report.folder import save_tables
from jld_explore.report.reading import FIELD_PICTURE, Exploration
from jld_explore.report.tables import Summary
from jld_explore.search.settings import ExploreSettings
from jld_explore.space import from_string
from jld_explore.space.search_space import SearchSpace


@dataclass(frozen=True)
class StepContext:
    """What a step may use beside the finished search.

    Attributes
    ----------
    space : SearchSpace
        The search space.
    settings : ExploreSettings
        The settings.
    deadline : Deadline
        After it nothing long is begun.
    """

    space: SearchSpace
    settings: ExploreSettings
    deadline: Deadline


class Step(ABC):
    """What follows a search (abstract base class of the group ``jld.steps``).

    A subclass defines `entries`, which go into summary.json; one that adds columns to results overrides `run`.

    Attributes
    ----------
    name : str
        Key in summary.json.
    """

    name: ClassVar[str]

    def wanted(self, settings: ExploreSettings) -> bool:
        """Return whether the settings ask for the step; by default always."""
        return True

    def refuse(self, scene: Scene, assembly: Assembly, settings: ExploreSettings) -> None:  # noqa: B027
        """Raise InputError before the search if the step cannot follow it."""

    def seconds(self, settings: ExploreSettings) -> float:
        """Return the part of the time limit that is kept back for the step, s."""
        return 0.0

    @abstractmethod
    def entries(self, done: Exploration, context: StepContext) -> Mapping[str, Any]:
        """Return what the summary holds under the name of the step, as JSON data."""

    def run(self, done: Exploration, context: StepContext) -> Exploration:
        """Return the search with what the step adds; nothing is written."""
        return with_entries(done, {self.name: dict(self.entries(done, context))})


def with_entries(
    done: Exploration, entries: Mapping[str, Any], columns: Mapping[str, Any] | None = None
) -> Exploration:
    """Return a search with further entries of its summary and columns of its results; nothing is written.

    Parameters
    ----------
    done : Exploration
        Finished search.
    entries : Mapping of str to Any
        Entries of the summary.
    columns : Mapping of str to Any, optional
        Columns of the results.

    Returns
    -------
    Exploration
        Search with both.
    """
    results = done.results.assign(**columns) if columns else done.results
    return replace(done, results=results, summary=Summary.of({**done.summary.facts, **entries}))


def steps_of(settings: ExploreSettings, scene: Scene, assembly: Assembly, own: Iterable[Step] = ()) -> list[Step]:
    """Return the steps that settings ask for: own ones, then those of packages by name; or InputError."""
    require_own_columns()
    steps = list(own)
    for name, kind in plugins.load_all("jld.steps").items():
        if not (isinstance(kind, type) and issubclass(kind, Step) and getattr(kind, "name", None) == name):
            raise plugins.refuse_type("jld.steps", name, f"a subclass of jld_explore.Step with name = {name!r}")
        if name in Summary.__dataclass_fields__:
            raise plugins.refuse_type("jld.steps", name, "another name: every summary has an entry of this one")
        with plugins.guarded("jld.steps", name):
            steps.append(kind())
    active = []
    for step in steps:
        with plugins.guarded("jld.steps", getattr(step, "name", "")):
            if step.wanted(settings):
                step.refuse(scene, assembly, settings)
                active.append(step)
    return active


def run_steps(done: Exploration, steps: Iterable[Step], context: StepContext) -> Exploration:
    """Run steps in order, and write what they change after each, so that a killed one loses itself alone."""
    for step in steps:
        with plugins.guarded("jld.steps", getattr(step, "name", "")):
            done = save_tables(step.run(done, context), done, csv=context.settings.csv)
    return done


# Time by which a command may pass its time limit: seconds, or a share of the limit if that is larger.
LATENESS: Final = (2.0, 0.05)
TABLES: Final = 0.2  # share of `lateness` until which shapes of blocks are counted for tables
PAGE: Final = 0.5  # share of `lateness` until which layouts are solved for the page
PICTURES: Final = 0.85  # share of `lateness` at which the last picture is finished; the process ends in the remainder

# Share of `lateness` at which the tables of a search without pictures are written: others go on with them
_TABLES_ALONE: Final = 0.3
_WRITING: Final = 1.0  # processor time of tables and page of a small search, s

# Further processor time for each face, s: tables of blocks and the drawing on the page grow with the structure
_WRITING_FACE: Final = 2e-4
_PICTURES: Final = 1.0  # processor time of all pictures of a small search, s, imports included
_FIELDS: Final = 0.05  # share of a time limit in which bounds by fields are refined for a picture
_MOST_KEPT: Final = 0.5  # largest share of a time limit that is kept back
BUSY: Final = 6.0  # largest factor by which a busy machine may prolong the writing


def lateness(seconds: float | None) -> float:
    """Return the time by which a command may pass its time limit `seconds`, s."""
    return max(LATENESS[0], LATENESS[1] * (seconds or 0.0))


def later(deadline: Deadline, settings: ExploreSettings, share: float) -> Deadline:
    """Return a deadline that is later than a time limit, by a share of `lateness`."""
    return deadline.earlier(-share * lateness(settings.seconds))


def busy_factor(clock: float, processor: float) -> float:
    """Return the factor by which a busy machine prolongs work.

    Parameters
    ----------
    clock, processor : float
        Time by the clock and processor time of the same work, s.

    Returns
    -------
    float
        1 to `BUSY`.
    """
    return min(max(1.0, clock / max(processor, 1e-9)), BUSY)


def field_seconds(limit: float | None) -> float:
    """Return the time in which bounds by fields are refined for a picture, s."""
    return FIELD_PICTURE if limit is None else min(FIELD_PICTURE, _FIELDS * limit)


def search_deadline(deadline: Deadline, settings: ExploreSettings, assembly: Assembly, *, fields: bool) -> Deadline:
    """Return the deadline of the search itself, which leaves time to write tables, page and pictures."""
    if settings.seconds is None:
        return deadline
    # What has been done so far tells how much longer writing takes on a busy machine.
    busy = busy_factor(deadline.elapsed(), time.process_time())
    expected, late_share = busy * (_WRITING + _WRITING_FACE * assembly.faces), _TABLES_ALONE
    if settings.pictures:
        expected, late_share = expected + busy * _PICTURES, PICTURES
        expected += field_seconds(settings.seconds) if fields else 0.0
    # Writing may go on after the time limit for that share of `lateness`; the search leaves the rest.
    reserved = max(0.0, expected - late_share * lateness(settings.seconds))
    return deadline.earlier(min(reserved, _MOST_KEPT * settings.seconds))


MOST: Final = 2.0
"""Longest expected processor time of the check, s: fewer layouts are checked where it would take longer."""

SHARE: Final = 0.05  # largest share of a time limit that is kept back for the check
FALL: Final = 0.05  # share of λ by faces that fields must leave, or else it is said


@dataclass(frozen=True)
class CheckPlan:
    count: int  # layouts checked beside the structure without cuts, 0 for no check
    seconds: float  # expected processor time, s
    skipped: str  # reason why nothing is checked, "" if something is
    meshed: tuple[FieldSetting, ...] = ()  # mesh and loads of each load case


def plan_check(scene: Scene, assembly: Assembly, space: SearchSpace, settings: ExploreSettings) -> CheckPlan | None:
    """Decide how many layouts of a search can be checked by fields; None where fields do not apply."""
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
        require_planar(assembly)
        meshed = tuple(FieldSetting.of(case) for case in assembly.by_case)
    except InputError as error:
        # A criterion is news to those who know that faces of this kind are checked.
        return CheckPlan(0, 0.0, error.problem) if assembly.face_strengths.criteria else None
    triangles = sum(len(coarse.coarse) for coarse in meshed) / cases
    each = cases * mesh_seconds(COARSE_RATE, triangles)
    count = min(settings.check_fields, int(MOST / each) - 1)
    if count < 1:
        return CheckPlan(0, 0.0, _too_long(f"{triangles:.0f}", each))
    return CheckPlan(count, (count + 1) * each, "", meshed)


def _too_long(triangles: str, seconds: float) -> str:
    """Return the reason to check no layout: the estimated time for one."""
    return f"{triangles} triangles would take some {seconds:.1f} s for each layout"


class FieldCheck(Step):
    """Check of the best layouts by fields; columns `fields_lo` and `fields_hi`."""

    name = "fields"

    def __init__(self, plan: CheckPlan) -> None:
        self.plan = plan

    def seconds(self, settings: ExploreSettings) -> float:
        """Return the part of the time limit that is kept back for the check, s."""
        return min(2.0 * self.plan.seconds, SHARE * (settings.seconds or 0.0))

    def entries(self, done: Exploration, context: StepContext) -> Mapping[str, Any]:
        entries: dict[str, Any] = self.run(done, context).summary.facts[self.name]
        return entries

    def run(self, done: Exploration, context: StepContext) -> Exploration:
        start, space = time.perf_counter(), context.space
        ranked = done.results[done.results["status"] == str(Status.COLLAPSE)].head(self.plan.count)
        low, high = np.full((2, len(done.results)), np.nan)
        uncut: tuple[float, float] | None = None
        skipped, checked = self.plan.skipped, 0
        if self.plan.count and len(ranked):
            labellings = [from_string(str(text)) for text in ranked["labelling"]]
            bounds = _bounds(done.assembly, self.plan, [space.fixed & ~space.candidates, *labellings], context.deadline)
            checked = max(len(bounds) - 1, 0)
            skipped = "" if checked else "the time limit left no time for it"
            if checked:
                uncut = bounds[0]
                low[:checked], high[:checked] = np.array(bounds[1:]).T
        values = ranked["load_factor"].to_numpy(dtype=float)[:checked]
        findings = _findings(values, low[:checked], high[:checked], uncut)
        command = f"jld explore {done.folder / 'scene.json'} --cracks fields --out DIR searches by fields"
        facts: dict[str, Any] = {
            "checked": checked,
            "uncut": None if uncut is None else [number(end) for end in uncut],
            "findings": findings,
            "skipped": skipped or None,
            "next": command if findings else None,
            "seconds": time.perf_counter() - start,
        }
        best = [number(low[0]), number(high[0])] if checked else None
        low[~np.isfinite(low)] = high[~np.isfinite(high)] = np.nan
        entries = {self.name: facts, "by_fields": best, "uncut": facts["uncut"]}
        return with_entries(done, entries, {"fields_lo": low, "fields_hi": high})


@one_thread()
def _bounds(
    assembly: Assembly, plan: CheckPlan, labellings: list[Bits], deadline: Deadline
) -> list[tuple[float, float]]:
    """Bound labellings (m,) on the coarsest mesh: (lower, upper) of the first ones, until the deadline."""
    coarse = [CoarseBounds(meshes, many=False) for meshes in plan.meshed]
    required = assembly.required
    bounds: list[tuple[float, float]] = []
    for labels in labellings:
        if deadline.passed():
            break
        low = min(meshes.lower(labels)[0] / factor for meshes, factor in zip(coarse, required, strict=True))
        high = min(meshes.upper(labels)[0] / factor for meshes, factor in zip(coarse, required, strict=True))
        bounds.append((float(low), float(high)))
    return bounds


def _findings(values: Floats, low: Floats, high: Floats, uncut: tuple[float, float] | None) -> list[str]:
    """Say how bounds by fields, low and high (k,), differ from λ by faces of the best layouts (k,)."""
    # Bounds by fields may change λ of the best layout, the order of the layouts, and whether cuts are of use.
    if not len(values):
        return []
    findings = []
    fallen, falls = high < (1.0 - FALL) * values, high < 0.0
    if falls[0]:
        more = int(falls.sum()) - 1
        others = f", and so do {more} more of the best {len(values)}" if more else ""
        findings.append(f"wherever its blocks crack, the best falls under its own weight{others}")
    elif fallen[0]:
        share = 1.0 - high[0] / values[0]
        more = int(fallen.sum()) - 1
        others = f", and {more} more of the best {len(values)} fall by over {FALL:.0%}" if more else ""
        findings.append(f"the blocks of the best carry at most {high[0]:.4g}, {share:.0%} less than by faces{others}")
    elif fallen.any():
        findings.append(f"{int(fallen.sum())} of the best {len(values)} carry over {FALL:.0%} less than by faces")
    stronger = np.flatnonzero(low[1:] > max(high[0], 0.0)) + 1
    if stronger.size:
        row = int(stronger[np.argmax(low[stronger])])
        findings.append(f"row {row + 1} carries at least {low[row]:.4g}, more than the best can")
    if uncut is not None and uncut[0] > max(high.max(), 0.0):
        findings.append(f"without cuts it carries at least {uncut[0]:.4g}, more than any of the best {len(values)}")
    return findings


MOST_UNCUT: Final = 2000  # largest number of interfaces of an assembly that is solved without its cuts


def most_without_cuts(scene: Scene, assembly: Assembly, space: SearchSpace) -> float | None:
    """Return the upper bound on λ by faces where every face that may be inner is inner.

    Parameters
    ----------
    scene : Scene
        Scene.
    assembly : Assembly
        Its structure.
    space : SearchSpace
        Labellings that may be searched.

    Returns
    -------
    float or None
        Upper bound on the governing factor. None where it is not finite, beside other crack models, uncertain values or
        cells left out, and above MOST interfaces.
    """
    plain = scene.cracks == "faces" and space.void is None and not assembly.has_low_values
    if not plain or len(assembly.labels) > MOST_UNCUT:
        return None
    high = CaseAnalysis(assembly, single_labelling=True).solve(space.fixed & ~space.candidates).bracket[1]
    return float(high) if math.isfinite(high) else None


class Uncut(Step):
    """Comparison of the best layout of a search by faces with the structure without cuts."""

    name = "uncut_at_most"

    def entries(self, done: Exploration, context: StepContext) -> Mapping[str, Any]:
        """Return the upper bound without cuts under the name of the step where the best is proven stronger."""
        facts, settings = done.summary.facts, context.settings
        other = settings.by_experiment or settings.own_objective is not None or facts.get("require")
        plain = settings.model == type(settings.model)()
        if other or not plain or facts["best"] is None or facts["unbounded"] or context.deadline.passed():
            return {}
        best = done.results.iloc[0]
        if best["status"] != str(Status.COLLAPSE):
            return {}
        high = most_without_cuts(done.scene, done.assembly, context.space)
        return {} if high is None or not float(best["bracket_lo"]) > high else {self.name: high}

    def run(self, done: Exploration, context: StepContext) -> Exploration:
        """Return the search with the bound in its summary, if it says something."""
        entries = self.entries(done, context)
        return with_entries(done, entries) if entries else done
