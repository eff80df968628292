"""Tilting tables: the angle at which a structure falls that is tilted with its ground, between proven bounds.

At an angle θ the weights turn from W g to W (g cos θ + t sin θ), t the direction of the tilt. The set of pairs (a, b)
under which W (a g + b t) is carried is convex, and holds (0, 0): a load factor λ along the tangent of the unit circle
at θ proves that the structure stands from θ to θ + arctan λ. Where no strength but friction acts the set is a cone, and
the angle is arctan λ; else it is found step by step from below, and what falls just above proves the end.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

import numpy as np

from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.limit.options import Model, Status
from jld_core.limit.result import LimitAnalysisResult
from jld_core.loads import Loads
from jld_core.models.rigid_blocks import limit_analysis, solve_labelling

_STEPS: Final = 20  # largest number of steps from below
_SMALL: Final = 1e-10  # step, radians, at which they end
_INCREMENTS: Final = tuple(10.0**k for k in range(-9, -2))  # radians above the last step, at which falling is tried
Bracket = tuple[float, float]  # bounds on an angle, degrees; NaN where one is unknown, infinite where nothing falls


def directions(assembly: Assembly) -> dict[str, Floats]:
    """Return the direction of tilt of each load case that tilts, by its name; "" for a scene without cases."""
    if assembly.scene is None:
        return {}
    loads = assembly.scene.loads
    entries = {"": loads.live or [], **{case.name: case.live for case in loads.cases or []}}
    return {name: np.array(load.body) for name, live in entries.items() for load in live if hasattr(load, "tilt")}


def tilt_bracket(assembly: Assembly, labels: Bits, model: Model, towards: Floats, low: float, high: float) -> Bracket:
    """Return bounds on the angle to which a structure under one load case tilts, degrees.

    It must stand without live load. low, high: bounds on λ at 0°, infinite where locked. towards: (d,) way of the tilt.
    """
    analysis = limit_analysis(assembly, model, reference=labels, single_labelling=True)
    is_cone = assembly.members.bond is None and not analysis.template.yield_set.strength(labels).any()
    if is_cone and not math.isinf(low):
        return _degrees(low), _degrees(high)
    if model.friction != "associative" or model.effective_area:
        return math.nan, math.nan  # the states are not convex
    angle, step = 0.0, math.atan(max(low, 0.0))
    for _ in range(_STEPS):
        angle += step
        if angle >= 2.0 * math.pi:
            return math.inf, math.inf
        if step < _SMALL:
            break
        status, low, _ = _bound_at(assembly, labels, model, towards, angle)
        # locked: it stands a quarter turn further
        step = math.pi / 2.0 if status is Status.LOCKED else math.atan(max(low, 0.0)) if math.isfinite(low) else 0.0
    falls = (angle + step for step in _INCREMENTS if _bound_at(assembly, labels, model, towards, angle + step)[2])
    return math.degrees(angle), math.degrees(next(falls, math.nan))


def _degrees(load_factor: float) -> float:
    return math.degrees(math.atan(load_factor))


def _bound_at(
    assembly: Assembly, labels: Bits, model: Model, towards: Floats, angle: float
) -> tuple[Status, float, bool]:
    """Return status and proven λ along the tangent at an angle, and whether the structure is proven to fall there."""
    weight = np.where(assembly.elements.support[:, None], 0.0, assembly.elements.weight)
    tilted_weight = np.linalg.norm(weight, axis=1)[:, None] * towards
    cos, sin = math.cos(angle), math.sin(angle)
    live = replace(assembly.live_loads, body=cos * tilted_weight - sin * weight)
    body = assembly.dead_loads.body + (cos - 1.0) * weight + sin * tilted_weight
    dead: Loads = replace(assembly.dead_loads, body=body)
    tilted = replace(assembly, dead_loads=dead, live_loads=live)
    analysis = limit_analysis(tilted, model, reference=labels, single_labelling=True)
    proof = solve_labelling(analysis, labels, model)
    low, high = (end * analysis.template.scaling.load for end in proof.bracket)
    return proof.status, low, proof.status is Status.UNSTABLE or high < 0.0


def with_tilt(result: LimitAnalysisResult) -> LimitAnalysisResult:
    """Return a result with the angles of its load cases that tilt among its facts."""
    towards_by_case = directions(result.assembly)
    if not towards_by_case:
        return result
    cases = {
        name: replace(case, facts=case.facts | _facts(case, towards_by_case[name])) if name in towards_by_case else case
        for name, case in result.cases.items()
    }
    single_case_facts = _facts(result, towards_by_case[""]) if "" in towards_by_case else {}
    return replace(result, cases=cases, facts=result.facts | single_case_facts)


def _facts(result: LimitAnalysisResult, towards: Floats) -> dict[str, Any]:
    """Return the angle of one load case and its bracket as facts."""
    low, high = result.bracket
    ends = math.nan, math.nan
    if result.stands_at_zero and (result.status is Status.LOCKED or math.isfinite(low)):
        low = math.inf if result.status is Status.LOCKED else low
        ends = tilt_bracket(result.assembly, result.labels, result.model, towards, low, high)
    return tilt_facts(ends)


def tilt_in_words(facts: Mapping[str, Any], name: str = "") -> dict[str, str]:
    if "tilt_bracket" not in facts:
        return {}
    angle, *ends = ("none" if end is None else f"{end:.9g}" for end in (facts["tilt_angle"], *facts["tilt_bracket"]))
    bound = facts.get("tilt_bound")
    proven_limit = "" if bound is None else f"; no layout tilts beyond {bound:.6g}°, proven"
    return {f"tilt angle{name}": f"{angle}°   (bracket {' '.join(ends)}{proven_limit})"}


def tilt_facts(ends: Bracket) -> dict[str, Any]:
    """Return an angle and its bracket for JSON, None where unknown: the proven angle where the end above is."""
    low, high = (end if math.isfinite(end) else None for end in ends)
    return {"tilt_angle": low if low is None or high is None else 0.5 * (low + high), "tilt_bracket": [low, high]}
