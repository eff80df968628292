"""Advice on results without a load factor: causes, and the next option to try."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from jld_core.arrays import Floats
from jld_core.errors import SolverError
from jld_core.limit.analysis import LimitAnalysis
from jld_core.limit.options import Status
from jld_core.limit.result import LimitAnalysisResult
from jld_core.solvers import installed_solvers, make_solver

_NAMED: Final = 6  # largest number of elements named; the others are counted

_MOVES: Final = 0.05  # share of the largest movement below which an element is not reported as moving

_CARRIES: Final = 1e-3  # share of the largest force below which a face does not count as pressed


def advice(result: LimitAnalysisResult) -> dict[str, str]:
    """Return causes of a result without a load factor ("falls", "confined") and the option to try ("next").

    Empty for several load cases, and where the bracket is as narrow as asked.
    """
    if result.cases:
        return {}
    if result.status is Status.UNSTABLE:
        return _of_unstable(result)
    if result.status is Status.LOCKED:
        return _of_locked(result)
    return {"next": _of_open(result)} if result.reason else {}


def _of_unstable(result: LimitAnalysisResult) -> dict[str, str]:
    """Describe which elements fall and how, and a remedy; keys "falls" and "next"."""
    found = {"next": "support what falls, or give its faces friction, a shear strength or an inner label"}
    if result.instability_mechanism is None:
        return {"falls": "it does under any λ ≥ 0; by which motion is not known", **found}
    assembly, d = result.assembly, result.assembly.dimension
    speed = result.instability_mechanism[:, :d]
    turning = np.linalg.norm(result.instability_mechanism[:, d:], axis=1) * assembly.size
    size = np.maximum(np.linalg.norm(speed, axis=1), turning)
    moving = np.flatnonzero(size > _MOVES * size.max(initial=0.0))
    moving = moving[np.argsort(-size[moving], kind="stable")]
    way = _way(speed[moving].sum(axis=0), float(turning[moving].sum()))
    words = f"{_listed([assembly.elements.ids[k] for k in moving])} {way}, whatever the live load"
    return {"falls": words + "; the motion is in the pictures of --out", **found}


def _way(speed: Floats, turning: float) -> str:
    """Describe a motion: "turn", or "move along" a direction; speed: (d,) summed velocity of the moving elements."""
    length = float(np.linalg.norm(speed))
    if length < 0.1 * turning:
        return "turn"
    return "move along (" + ", ".join(f"{x:.2g}" for x in speed / length + 0.0) + ")"


def _of_locked(result: LimitAnalysisResult) -> dict[str, str]:
    """Describe the supports between which forces are unbounded, and a remedy."""
    # The keys are "confined", absent without unbounded forces, and "next".
    found = {"next": "a compressive_strength of dry and inner faces, which crushing then limits, gives a finite λ"}
    if result.unbounded_forces is None:
        return found
    faces, support = result.assembly.interfaces, result.assembly.elements.support
    size = np.linalg.norm(result.unbounded_forces, axis=1)
    pressed = size > _CARRIES * size.max(initial=0.0)
    ends = np.concatenate([faces.a[pressed], faces.b[pressed]])
    names = [result.assembly.elements.ids[k] for k in np.unique(ends[support[ends]])]
    between = "between" if len(names) > 1 else "against"
    words = f"{between} {_listed(names)}, through {int(pressed.sum())} faces: forces there grow with λ without an end"
    return {"confined": words, **found}


def _of_open(result: LimitAnalysisResult) -> str:
    """Name the command-line option that may narrow the bracket, or find the missing bound."""
    if result.friction == "zero-dilation":
        return "--range seeks the lowest and the highest λ from every side, each with its own evidence"
    low, high = result.bracket
    others = _other_solvers(result)
    solver = f"--solver {' or '.join(others)}" if others else "another --condense"
    if math.isfinite(low) and math.isfinite(high):
        return f"{solver} may narrow the bracket"
    lacking = " and ".join(w for w, end in (("lower", low), ("upper", high)) if not math.isfinite(end))
    return f"no {lacking} bound was proven: {solver} may find one; so may strengths nearer to the forces"


def _other_solvers(result: LimitAnalysisResult) -> list[str]:
    """Return the installed solvers that accept the program of a result and were not asked for it."""
    used = {name.split(" ")[0] for name in result.solve_log}
    structure = LimitAnalysis(result.assembly, inner_bending=result.model.inner_bending).template.structure
    found = []
    for name in installed_solvers():
        if name == "auto" or name in used:
            continue
        try:
            make_solver(name).require(structure)
        except SolverError:
            continue
        found.append(name)
    return found


def _listed(names: list[str]) -> str:
    """Join up to `_NAMED` names by commas, and state how many more there are."""
    if len(names) <= _NAMED:
        return ", ".join(names)
    return f"{', '.join(names[:_NAMED])} and {len(names) - _NAMED} more"
