"""Model and solver options that results, evaluators and search settings share."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any, Final, Literal, get_args

import numpy as np

from jld_core import tolerances
from jld_core.errors import ParameterError
from jld_core.mechanics.standard import InnerBending
from jld_core.parameters import documented, require_field_types, setting
from jld_core.scene.cracks import CrackModel, FieldCracks, cracks_of, cracks_to_json
from jld_core.solvers import SOLVERS, Solver, require_solver

Friction = Literal["associative", "zero-dilation"]
"""Friction model of dry faces: flow rule associated with the yield sets, or sliding without uplift."""
Contacts = Literal["convex", "concave"]
"""Contact model of dry faces: resultants at the centre of pressure, or point contacts at the corners."""
Condense = Literal["auto", "on", "off"]
"""When uncracked blocks are modelled as rigid bodies; "auto" does so where inner faces are very strong."""

Start = Literal["associative", "gravity", "vertex"]  # forces from which the iteration without dilation starts
FLOOR_SECONDS: Final = 60.0
"""Default processor time, in seconds, for the lower bound on λ over all non-dilatant solutions."""

# Default time for the bounds of one load case by fields, s. No mesh is begun that is not expected to end in it.
FIELD_SECONDS: Final = 60.0

# Allowed values of each option that takes one of several words
_WORDS: Final = {
    "friction": Friction,
    "start": Start,
    "contact": Contacts,
    "inner_bending": InnerBending,
    "condense": Condense,
}


@documented
@dataclass(frozen=True)
class Model:
    """How a structure is modelled and solved: crack model, friction, contact, bending, solver.

    Options of spatial models have no effect in planar scenes. An option that is not allowed, or two that exclude each
    other, raise InputError.
    """

    friction: Friction = setting(
        "associative", "Associative, or sliding without uplift, where λ is not unique (docs/method.md, chapter 4)."
    )
    range: bool = setting(
        False, 'With `friction="zero-dilation"`: the lowest and the highest λ found, and a bound below all of them.'
    )
    floor_seconds: float = setting(
        FLOOR_SECONDS, "With `range=True`: processor time for that bound below the lowest λ, s; 0 for none."
    )
    start: Start = setting(
        "associative",
        'With `friction="zero-dilation"`: forces that the iteration starts from: those with dilation, the least ones '
        "under dead load, or a vertex of the problem with dilation (planar).",
    )
    alpha: float = setting(0.01, "Without dilation: share of the present N in friction at the first step, 0 to 1.")
    contact: Contacts = setting("convex", "Resultants at centres of pressure, or points at the corners of dry faces.")
    effective_area: bool = setting(
        False, "Base torsion on the area in compression, by iteration (spatial; docs/method.md (2.14), (2.15))."
    )
    inner_bending: InnerBending = setting(
        "uncoupled",
        "Bending of spatial inner faces: uncoupled, or by elastic edge stress (docs/method.md (2.5), (2.6)).",
    )
    condense: Condense = setting(
        "auto", "Rigid blocks that crack where needed; auto: where inner faces are very strong."
    )
    solver: str | Solver = setting(
        "auto", f"First solver: {', '.join(SOLVERS)}; others follow where it proves nothing."
    )
    gap: float = setting(
        tolerances.GAP, "Relative width of the bracket to aim at; by fields that of `cracks` by default."
    )
    cracks: CrackModel | str | None = setting(
        None, "How blocks crack: faces, cells:SIZE or fields[:GAP]; default: as the scene says, or along its faces."
    )
    seconds: float | None = setting(
        None, "Time after which nothing further is tried, of each load case, s; 60 by fields.", min=0.0
    )

    def __post_init__(self) -> None:
        require_field_types(self)
        if self.cracks is not None:
            object.__setattr__(self, "cracks", cracks_of(self.cracks))
        for key, words in _WORDS.items():
            value, allowed = getattr(self, key), get_args(words)
            if value not in allowed:
                raise ParameterError(key, f"no {key.replace('_', ' ')} is named {value!r}", " or ".join(allowed))
        if self.range and self.friction != "zero-dilation":
            raise ParameterError(
                "range", "λ of associative friction is one number", '`friction="zero-dilation"` with it'
            )
        for key in ("start", "alpha"):
            if getattr(self, key) != getattr(Model, key) and self.friction != "zero-dilation":
                raise ParameterError(
                    key, "friction with dilation needs no iteration", '`friction="zero-dilation"` with it'
                )
        if not (_is_number(self.alpha) and 0.0 <= self.alpha <= 1.0):
            raise ParameterError("alpha", f"{_shown(self.alpha)} is no share", "a number from 0 to 1")
        if self.effective_area and self.contact == "concave":
            raise ParameterError(
                "effective_area", "point contacts have no effective area", '`contact="convex"` with it'
            )
        if not (_is_number(self.floor_seconds) and self.floor_seconds >= 0.0):
            raise ParameterError(
                "floor_seconds", f"{_shown(self.floor_seconds)} is no number of seconds", "seconds, 0 for no bound"
            )
        if not (_is_number(self.gap) and 0.0 < self.gap < math.inf):
            raise ParameterError("gap", f"{_shown(self.gap)} is no relative width", "a number above 0")
        if self.seconds is not None and not (_is_number(self.seconds) and self.seconds >= 0.0):
            raise ParameterError("seconds", f"{_shown(self.seconds)} is no time", "seconds, at least 0")
        if isinstance(self.solver, str):
            require_solver(self.solver)

    @property
    def supports_bounds_over_labellings(self) -> bool:
        """Return True if bounds over many labellings hold: associative friction on whole faces."""
        return not self.beyond_whole_faces

    @property
    def dilating(self) -> Model:
        """Return the model with associative friction, without the options of friction without dilation."""
        defaults = {name: getattr(Model, name) for name in ("friction", "range", "floor_seconds", "start", "alpha")}
        return replace(self, **defaults)

    @property
    def beyond_whole_faces(self) -> dict[str, Any]:
        """Return the options that differ from associative friction on whole faces, by name."""
        names = ("friction", "range", "floor_seconds", "start", "alpha", "contact", "effective_area", "inner_bending")
        return {name: getattr(self, name) for name in names if getattr(self, name) != getattr(Model, name)}

    @property
    def by_fields(self) -> FieldCracks | None:
        """Return the crack model with the gap asked for where blocks crack by fields, else None."""
        if not isinstance(self.cracks, FieldCracks):
            return None
        return self.cracks if self.gap == tolerances.GAP else FieldCracks(kind="fields", gap=self.gap)

    @property
    def ranks_by_lower_bound(self) -> bool:
        """Return True if a search ranks by the lower bound over all non-dilatant solutions.

        Requires `range` and a positive `floor_seconds`.
        """
        return self.range and self.floor_seconds > 0.0

    def facts(self) -> dict[str, Any]:
        """Return the fields that are not None as plain values, a solver object by its name."""
        solver = self.solver if isinstance(self.solver, str) else self.solver.name
        options = {name: value for name, value in vars(self).items() if value is not None}
        cracks = {"cracks": cracks_to_json(cracks_of(self.cracks))} if self.cracks else {}
        return options | {"solver": solver} | cracks


SolveOptions = Model
"""Name of `Model` before version 0.4."""


def _is_number(value: object) -> bool:
    """Return True for a real number, and False for truth values and other objects."""
    return isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)


def _shown(value: object) -> str:
    """Return a number in short, and any other object as Python writes it."""
    return f"{value:g}" if _is_number(value) else repr(value)


@dataclass(frozen=True)
class ZeroDilation:
    """Evidence that a solution without dilation was found, and the range of such solutions.

    λ is not unique without dilation. The fields from `lowest_found` on are None unless the range was computed
    (`range=True`). Load factors are in scene units.

    Attributes
    ----------
    associative_load_factor : float or None
        λ with associative friction: the only upper bound on every solution. None where there is none.
    friction_violation : float or None
        max(|V| − μN)⁺ / max N over dry faces; None if no solution was found.
    complementarity_gap : float or None
        Complementarity gap divided by the dissipation; None if no solution was found.
    dilation : float or None
        Largest opening of faces in compression divided by the largest slip; None if no solution was found.
    converged : bool
        True if the search ended with a solution.
    iterations : int
        Number of programs solved in the search.
    lowest_found, highest_found : float or None
        Lowest and highest λ of certified solutions.
    solutions_found : int or None
        Number of certified solutions with different λ.
    lowest_proven : float or None
        Proven lower bound on λ of all solutions with λ ≥ 0; None without a bound above zero.
    lowest_bound : float or None
        Highest lower bound, which may depend on a solver.
    bound_tolerance : float or None
        Relative tolerance to which `lowest_bound` depends on a solver.
    proven : bool or None
        True if `lowest_bound` is proven.
    closed : bool or None
        True if `lowest_bound` meets `lowest_found` within 1e-6.
    """

    associative_load_factor: float | None
    friction_violation: float | None
    complementarity_gap: float | None
    dilation: float | None
    converged: bool
    iterations: int
    lowest_found: float | None = None
    highest_found: float | None = None
    solutions_found: int | None = None
    lowest_proven: float | None = None
    lowest_bound: float | None = None
    bound_tolerance: float | None = None
    proven: bool | None = None
    closed: bool | None = None

    @classmethod
    def of(cls, facts: Mapping[str, Any]) -> ZeroDilation | None:
        """Return the evidence in the facts of a result; None for associative friction."""
        if "complementarity_gap" not in facts:
            return None
        named = {name: facts[name] for name in cls.__dataclass_fields__ if name in facts}
        return cls(**named, iterations=facts["zero_dilation_iterations"])


@dataclass(frozen=True)
class EffectiveAreas:
    """Agreement of the torsion limits of dry faces with their areas in compression.

    Attributes
    ----------
    change : float or None
        Largest change of effective areas from those assumed in the proof to those under the forces found. It is the
        change of c_T,e / c_T or of x / c_T, see docs/method.md (2.14); 0 at a proven fixed point. None without forces.
    load_factor_whole_faces : float or None
        λ with torsion on whole faces, scene units; None where there is none.
    """

    change: float | None
    load_factor_whole_faces: float | None

    @classmethod
    def of(cls, facts: Mapping[str, Any]) -> EffectiveAreas | None:
        if "effective_area" not in facts:
            return None
        areas = facts["effective_area"]
        return cls(None if areas is None else areas["fixed_point"], facts.get("load_factor_whole_faces"))


class Status(StrEnum):
    """Outcome of a limit analysis, backed by a proof where it is conclusive.

    Attributes
    ----------
    COLLAPSE
        Both bounds on λ are proven.
    LOCKED
        Every larger λ is admissible, by proof (docs/method.md (3.14)).
    UNSTABLE
        No λ ≥ 0 is admissible, by proof (docs/method.md (3.15)).
    UNCERTIFIED
        A bound is missing.
    FAILED
        The analysis ended without a result.
    """

    COLLAPSE = "collapse"
    LOCKED = "locked"
    UNSTABLE = "unstable"
    UNCERTIFIED = "uncertified"
    FAILED = "failed"


@dataclass(frozen=True)
class CaseBounds:
    """Status and bounds of one load case.

    Attributes
    ----------
    status : Status
        Outcome of the case.
    low, high : float
        Proven bounds on λ; NaN where a bound is missing.
    load_factor : float
        λ of the case; NaN where there is none.
    """

    status: Status
    low: float
    high: float
    load_factor: float


@dataclass(frozen=True)
class Governing:
    """Status and bounds of the governing factor; case: index of least upper bound, the first of equal ones."""

    # With the first of equal cases, methods that find the same λ name the same case.

    status: Status
    low: float
    high: float
    load_factor: float
    case: int


def governing(cases: Sequence[CaseBounds], required: Sequence[float]) -> Governing:
    """Compute the governing factor of a labelling from the bounds of its load cases.

    The first of these statuses that applies counts: failed if any case is, unstable if any case is, locked if all cases
    are, collapse if both bounds are known and the case of least lower bound has this status or lacks an upper bound,
    uncertified. A locked case carries any load and never governs. The lower bound is the least of all cases,
    missing if one case has none. The upper bound is the least of those that are known.

    Parameters
    ----------
    cases : sequence of CaseBounds
        Status and bounds of each case; at least one.
    required : sequence of float
        Required factor of each case.

    Returns
    -------
    Governing
        Status, bounds, value and index of the governing case.
    """
    nan, inf = math.nan, math.inf
    for status in (Status.FAILED, Status.UNSTABLE):
        for position, case in enumerate(cases):
            if case.status is status:
                return Governing(status, nan, nan, nan, position)
    # over the required factors; what is unknown is −inf below and inf above, and NaN as a value
    lows, highs, values = [], [], []
    for case, factor in zip(cases, required, strict=True):
        if case.status is Status.LOCKED:
            low = high = value = inf
        else:
            low = -inf if math.isnan(case.low) else case.low / factor
            high = inf if math.isnan(case.high) else case.high / factor
            value = case.load_factor / factor
        lows.append(low)
        highs.append(high)
        values.append(value)
    if all(case.status is Status.LOCKED for case in cases):
        known_lows = [case.low / factor for case, factor in zip(cases, required, strict=True)]
        position = min(range(len(cases)), key=lambda k: inf if math.isnan(known_lows[k]) else known_lows[k])
        return Governing(Status.LOCKED, known_lows[position], nan, nan, position)
    least_low = min(range(len(cases)), key=lambda k: (lows[k], highs[k]))
    least_high = min(range(len(cases)), key=lambda k: (highs[k], lows[k]))
    low, high = lows[least_low], highs[least_high]
    proven = [case.status is Status.COLLAPSE or math.isnan(case.high) for case in cases]
    if proven[least_low] and math.isfinite(low) and math.isfinite(high):
        # cases whose brackets cannot be told apart from that of the least lower bound: the first of them is named
        limit = high + (high - low) + tolerances.GAP * abs(high)
        indistinguishable = (k for k in range(len(cases)) if proven[k] and lows[k] <= high and highs[k] <= limit)
        value = min((value for value in values if not math.isnan(value)), default=low)
        return Governing(Status.COLLAPSE, low, high, min(max(value, low), high), next(indistinguishable, least_low))
    known_values = [value for value in values if not math.isnan(value)]
    bounded = math.isfinite(low) and math.isfinite(high)
    guess = 0.5 * (low + high) if bounded else min(known_values, default=nan)
    if not math.isfinite(guess):
        guess = nan
    low, high = (end if math.isfinite(end) else nan for end in (low, high))
    return Governing(Status.UNCERTIFIED, low, high, guess, least_high)


def reason_of(status: Status, bracket: tuple[float, float], gap: float, gap_limit: float, extra: dict[str, Any]) -> str:
    """Say which bound is missing and why, or how far they are apart; "" where nothing is missing."""
    difference = f"the bounds are {gap:.1e} apart, relative (asked {gap_limit:.0e})"
    if status is not Status.UNCERTIFIED:
        return difference if status is Status.COLLAPSE and gap > gap_limit else ""
    has_low, has_high = (math.isfinite(end) for end in bracket)
    lower = "no lower bound: no forces were found that balance the loads in every yield set, within rounding (1e-12)"
    upper = (
        f"no upper bound: no mechanism was found whose jumps all faces allow, within rounding ({tolerances.EXACT:.0e})"
    )
    areas = extra.get("effective_area")
    if isinstance(areas, dict) and areas["fixed_point"] > tolerances.FIXED_POINT:
        at_face = f", most at face {areas['face']}" if "face" in areas else ""
        change, asked = areas["fixed_point"], tolerances.FIXED_POINT
        return f"effective areas did not settle: they still change by {change:.1e}{at_face} (asked {asked:.0e})"
    if isinstance(areas, dict) and "above" in areas:
        above = areas["above"]
        stays = f"stays {above:.1e} above the forces (asked {gap_limit:.0e})"
        return f"effective areas: the bound of the frozen areas {stays}"
    if "effective_area" in extra and areas is None:
        return (
            "effective areas: with whole faces no forces are in balance at any λ, so that there are none to begin from"
        )
    if not has_low and not has_high:
        return f"{lower}; {upper}"
    if not has_low:
        return lower
    if not has_high and isinstance(areas, dict):
        return f"{upper}, nor forces that grow without end within the effective areas they ask for"
    if not has_high:
        return upper
    if isinstance(areas, dict) and gap <= gap_limit:
        return "effective areas: the forces that fit their own areas carry less than the bracket of the frozen areas"
    if gap <= gap_limit:
        return "the evidence that this model asks for is missing, see the numbers beside λ"
    return difference
