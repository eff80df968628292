"""λ of one labelling whose blocks crack anywhere: bounds by fields under every load case, as one result."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Final

import numpy as np

from jld_core.arrays import Bits
from jld_core.assembly import Assembly, labels_of
from jld_core.errors import InputError
from jld_core.fields import bounds_by_fields
from jld_core.fields.bounds import FieldBounds, FieldStatus
from jld_core.limit import FIELD_SECONDS, CaseBounds, governing, number
from jld_core.limit.options import Governing, Status
from jld_core.limit.result import Result, stands_in_words
from jld_core.models.tilting import directions, tilt_facts, tilt_in_words
from jld_core.parameters import typed
from jld_core.scene.cracks import FieldCracks, cracks_in_words
from jld_core.threads import one_thread

_COARSE: Final = 0.9  # gap of bounds of which only the sign counts

# Least time for the question whether a structure stands without live load, s; else that of its bounds
_LEAST_SECONDS: Final = 5.0


@dataclass(frozen=True, repr=False)
class FieldResult(Result):
    """λ of one labelling by stress and velocity fields, with what every `Result` has."""

    assembly: Assembly  # the structure analysed
    labels: Bits  # (m,) True = dry
    cracks: FieldCracks  # the crack model, with the gap asked for
    cases: dict[str, FieldBounds]  # bounds of each load case by its name; a single load has the name ""
    seconds: dict[str, float]  # wall-clock time: total, s

    shown_by: ClassVar[str] = "jld_views.notebook:FieldResultView"
    notes = ()
    forces = mechanism = instability_mechanism = None

    @property
    def governing(self) -> str | None:
        """Return the name of the governing load case; None without load cases."""
        return list(self.cases)[self.decided.case] if self.assembly.cases else None

    @property
    def decided(self) -> Governing:
        """Return the governing factor, the least lower bound over load cases of λ / required."""
        case_bounds = [case_bounds_of(bounds) for bounds in self.cases.values()]
        outcome = governing(case_bounds, self.assembly.required.tolist())
        return Governing(outcome.status, outcome.low, outcome.high, outcome.low, outcome.case)

    @property
    def governing_case(self) -> tuple[Assembly, Bits, FieldBounds]:
        """Return structure under its governing case alone, labels (m,), planar bounds; InputError in space."""
        case = self.decided.case
        bounds = list(self.cases.values())[case]
        if bounds.dimension != 2:
            raise InputError("cracks", "fields in space have no picture", "a planar scene")
        return self.assembly.by_case[case], self.labels, bounds

    @property
    def status(self) -> Status:  # type: ignore[override]
        """Return collapse where both bounds are known, unstable where an upper one is below 0, else uncertified."""
        return self.decided.status

    @property
    def load_factor(self) -> float:  # type: ignore[override]
        """Return the lower bound on λ; with load cases the least of λ / required."""
        return self.decided.low

    @property
    def bracket(self) -> tuple[float, float]:  # type: ignore[override]
        """Return the proven bounds on λ, NaN where one is missing."""
        return self.decided.low, self.decided.high

    @property
    def gap(self) -> float:  # type: ignore[override]
        return _width(*self.bracket)

    @property
    def facts(self) -> dict[str, Any]:  # type: ignore[override]
        """Return the angle to which a structure tilts, at least: by fields λ has a proven lower bound alone."""
        if "" not in directions(self.assembly):
            return {}
        return tilt_facts((math.degrees(math.atan(max(0.0, self.bracket[0]))), math.nan))

    @cached_property
    def _reversed(self) -> list[tuple[float, float]]:
        """Return bounds on the least λ of each load case."""
        return [
            least_by_fields(case, self.labels, bounds, max(self.seconds["total"], _LEAST_SECONDS))
            for case, bounds in zip(self.assembly.by_case, self.cases.values(), strict=True)
        ]

    @property
    def stands_at_zero(self) -> bool | None:  # type: ignore[override]
        """Return whether the structure stands without live load in every case; None where undecided."""
        stands = [stands_by(bounds, least) for bounds, least in zip(self.cases.values(), self._reversed, strict=True)]
        return False if False in stands else None if None in stands else True

    @property
    def least_bracket(self) -> tuple[float, float]:  # type: ignore[override]
        """Return the proven bounds on the least λ from which on the structure stands, NaN where unknown."""
        if self.stands_at_zero:
            return 0.0, 0.0
        ends = np.array(self._reversed) / self.assembly.required[:, None]
        low, high = np.maximum(ends, 0.0).max(axis=0).tolist()
        return low, high

    @property
    def reason(self) -> str | None:  # type: ignore[override]
        """Explain why the bounds of the governing case did not reach the gap; None where they did."""
        bounds = list(self.cases.values())[self.decided.case]
        if bounds.status is FieldStatus.CLOSED or self.status is Status.UNSTABLE:
            return None
        words = {
            FieldStatus.NO_LOWER: "no stress field was found: the blocks may be too weak for their own weight",
            FieldStatus.NO_UPPER: "no velocity field could be certified",
            FieldStatus.NO_TIME: f"time ended on {bounds.simplices} {bounds.shape}; more --seconds may bound λ",
        }
        limit = f"time or {bounds.shape} ended refinement before the gap of {self.cracks.gap:g}"
        return words.get(bounds.status, f"{limit}; a larger gap or more --seconds may narrow it")

    def to_json(self) -> dict[str, Any]:
        """Return the object that `jld solve --cracks fields --json` prints, see `Result.to_json`."""
        outcome, has_cases = self.decided, bool(self.assembly.cases)
        ids, faces = self.assembly.elements.ids, self.assembly.interfaces
        first = next(iter(self.cases.values()))
        return {
            **self._head(),
            "friction": "associative",
            "contact": "convex",
            "dimension": self.assembly.dimension,
            "elements": len(ids),
            "interfaces": len(faces),
            "seconds": dict(self.seconds),
            "warnings": self.warnings,
            **self.facts,
            **(
                {
                    "governing": list(self.cases)[outcome.case],
                    "cases": {name: _bounds_to_json(bounds) for name, bounds in self.cases.items()},
                }
                if has_cases
                else {key: value for key, value in _bounds_to_json(first).items() if key in (first.shape, "history")}
            ),
            "faces": [
                {"index": k, "elements": [ids[a], ids[b]], "label": "dry" if dry else "inner"}
                for k, (a, b, dry) in enumerate(zip(faces.a, faces.b, self.labels, strict=True))
            ],
        }

    def facts_in_words(self) -> dict[str, str]:
        outcome, has_cases = self.decided, bool(self.assembly.cases)
        width = _width(outcome.low, outcome.high)
        bracket = f"{_shown(outcome.low)} {_shown(outcome.high)}"
        facts = {
            "cracks": cracks_in_words(self.cracks),
            "status": str(outcome.status),
            **({"governing": list(self.cases)[outcome.case]} if has_cases else {}),
            "λ / required" if has_cases else "λ": _shown(outcome.load_factor),
            "bracket": bracket + (f"   (relative width {width:.1e})" if math.isfinite(width) else ""),
        }
        if self.reason:
            facts["reason"] = self.reason
        for (name, bounds), required in zip(self.cases.items(), self.assembly.required, strict=True):
            ends = f"{_shown(bounds.lower)} {_shown(bounds.upper)}"
            if has_cases:
                facts[f"λ {name}"] = f"{ends} of {required:g} required ({bounds.status.value})"
        facts |= tilt_in_words(self.facts)
        facts["stands at 0"] = stands_in_words(self)
        all_bounds = list(self.cases.values())
        facts[all_bounds[0].shape] = ", ".join(str(bounds.simplices) for bounds in all_bounds)
        facts["seconds"] = f"{self.seconds['total']:.3g}"
        return facts


def case_bounds_of(bounds: FieldBounds) -> CaseBounds:
    """Return status and bounds of one load case, NaN where one is missing."""
    if bounds.upper < 0.0:
        return CaseBounds(Status.UNSTABLE, math.nan, math.nan, math.nan)
    low = bounds.lower if math.isfinite(bounds.lower) else math.nan
    high = bounds.upper if math.isfinite(bounds.upper) else math.nan
    status = Status.UNCERTIFIED if math.isnan(low) or math.isnan(high) else Status.COLLAPSE
    return CaseBounds(status, low, high, low)


@typed
@one_thread()
def solve_by_fields(
    assembly: Assembly, labels: Bits | None = None, *, gap: float = 0.05, seconds: float = FIELD_SECONDS
) -> FieldResult:
    """Bound λ of one labelling whose blocks may crack anywhere, under every load case.

    Parameters
    ----------
    assembly : Assembly
        Assembly with or without load cases; in space of convex cells.
    labels : (m,) bool array, optional
        True = dry. Default: the labels of the scene.
    gap : float
        Relative width of the bracket at which refinement ends; above 0.
    seconds : float
        Time for each load case, s (see `bounds_by_fields`).

    Returns
    -------
    FieldResult
        Result in scene units; with load cases λ is the governing factor.

    Raises
    ------
    InputError
        As `bounds_by_fields`.

    Notes
    -----
    Formulas: docs/method.md (9.6) to (9.12), in space (10.1) to (10.6).
    """
    start = time.process_time()
    checked_labels = labels_of(assembly, labels)
    names = [case.name for case in assembly.cases] or [""]
    cases = {
        name: bounds_by_fields(case, checked_labels, gap=gap, seconds=seconds)
        for name, case in zip(names, assembly.by_case, strict=True)
    }
    seconds_spent = {"total": time.process_time() - start}
    return FieldResult(assembly, checked_labels, FieldCracks(kind="fields", gap=gap), cases, seconds_spent)


def _bounds_to_json(bounds: FieldBounds) -> dict[str, Any]:
    case_bounds = case_bounds_of(bounds)
    return {
        "load_factor": number(case_bounds.low),
        "bracket": [number(case_bounds.low), number(case_bounds.high)],
        "gap": number(_width(case_bounds.low, case_bounds.high)),
        "status": str(case_bounds.status),
        bounds.shape: bounds.simplices,
        "history": [
            {
                bounds.shape: step.simplices,
                "lower": number(step.lower),
                "upper": number(step.upper),
                "seconds": step.seconds,
            }
            for step in bounds.history
        ],
    }


def _width(low: float, high: float) -> float:
    """Return the width of a bracket over its larger end, NaN where a bound is missing."""
    return (high - low) / max(abs(high), abs(low), 1e-300)


def least_by_fields(case: Assembly, labels: Bits, bounds: FieldBounds, seconds: float) -> tuple[float, float]:
    """Bound the least λ, maybe below 0, within `seconds`, from below and above; NaN where unknown.

    bounds: those of the largest λ.
    """
    # The reversed live load that a structure carries is the opposite of that λ. A coarse mesh does: readers ask for
    # the sign. Below an upper bound under 0 the structure falls anyway; without dead load it stands at λ = 0.
    if bounds.upper < 0.0:
        return math.nan, math.nan
    if not case.dead_loads:
        return 0.0, 0.0
    if not math.isfinite(bounds.lower):
        return math.nan, math.nan
    reversed_case = replace(case, live_loads=-1.0 * case.live_loads)
    reversed_bounds = next(iter(solve_by_fields(reversed_case, labels, gap=_COARSE, seconds=seconds).cases.values()))
    low, high = -reversed_bounds.upper, -reversed_bounds.lower
    return low if math.isfinite(low) else math.nan, high if math.isfinite(high) else math.nan


def stands_by(bounds: FieldBounds, least: tuple[float, float]) -> bool | None:
    """Decide whether a structure stands without live load: it carries some of it and some of the reverse.

    None: undecided.
    """
    # The states between a load and the reversed one are admissible.
    if bounds.upper < 0.0 or least[0] > 0.0:
        return False
    return True if least[1] <= 0.0 <= bounds.lower or least == (0.0, 0.0) else None


def _shown(value: float) -> str:
    """Return a number in at most nine digits, or "none" if it is not finite."""
    return f"{value:.9g}" if math.isfinite(value) else "none"
