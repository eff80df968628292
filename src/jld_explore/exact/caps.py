"""Bounds on normal forces that every labelling worth finding keeps, by linear programs.

A labelling is worth finding when its λ is at least what is known already. Its forces are a point of the relaxation
with that λ, so the largest N there bounds its own; every bound found tightens the relaxation for the next.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Final

import highspy
import numpy as np

from jld_explore.exact.formulations import Builder, Caps
from jld_explore.exact.milp import INF

_ALLOWANCE: Final = 1e-6
"""Added to every bound, relative and scaled: far more than the residuals of the linear programs."""


def open_caps(faces: int, least: float) -> Caps:
    """Nothing known but a λ worth reaching."""
    none = np.full(faces, INF)
    return Caps(none, none.copy(), least, INF)


def tighten(builder: Builder, caps: Caps, rounds: int, stop: Callable[[], bool]) -> Caps | None:
    """Caps from the relaxation of formulation F, `rounds` times over; None where N or λ has no bound.

    Stopped early, some caps are left open.

    A relaxation without any point means that nothing reaches caps.least: then caps.most is −inf.
    """
    for _ in range(rounds):
        known = _round(builder, caps, stop)
        if known is None or known.most == -math.inf:
            return known
        gain = np.concatenate([_gain(caps.dry, known.dry), _gain(caps.inner, known.inner)])
        caps = known
        if stop() or float(gain.mean()) < 0.02:
            break
    return caps


def _gain(old: np.ndarray, new: np.ndarray) -> np.ndarray:
    with np.errstate(invalid="ignore"):
        return np.where(old >= INF, 1.0, 1.0 - new / np.maximum(old, 1e-12))


def _round(builder: Builder, caps: Caps, stop: Callable[[], bool]) -> Caps | None:
    form = builder.faces(caps)
    highs = form.program.load(relaxed=True)
    highs.setOptionValue("presolve", "off")  # a basis to go on from is worth more

    def largest(column: int) -> float | None:
        highs.changeColCost(column, 1.0)
        highs.run()
        status = highs.getModelStatus()
        value = float(highs.getInfo().objective_function_value)
        highs.changeColCost(column, 0.0)
        if status == highspy.HighsModelStatus.kInfeasible:
            return -math.inf
        return value if status == highspy.HighsModelStatus.kOptimal else None

    most = largest(form.load)
    if most is None:
        return None
    if most == -math.inf:
        return replace(caps, most=-math.inf)
    most = min(caps.most, most + _ALLOWANCE * max(1.0, abs(most)))
    highs.changeColBounds(form.load, -INF, most)
    dry, inner = caps.dry.copy(), caps.inner.copy()
    for table, columns in ((dry, form.normals[0]), (inner, form.normals[1])):
        for face in np.flatnonzero(columns >= 0).tolist():
            value = largest(int(columns[face]))
            if value is None:
                return None
            table[face] = min(float(table[face]), max(value, 0.0) * (1.0 + _ALLOWANCE) + _ALLOWANCE)
            if stop():
                return replace(caps, dry=dry, inner=inner, most=most)
    return replace(caps, dry=dry, inner=inner, most=most)
