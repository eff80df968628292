"""Add the derivatives of λ by strengths, weight and vertices to the result of a solve."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from jld_core.limit import LimitAnalysisResult
from jld_core.models import geometry_sensitivities, sensitivities

_KINKS: Final = 40  # number of faces up to which `jld solve` looks for kinks of the derivatives by vertices
_UNASKED: Final = 128  # number of faces up to which `jld solve` computes rates that nobody asked for: .3 s


def with_rates(result: LimitAnalysisResult, *, asked: bool | None, vertices: bool) -> LimitAnalysisResult:
    """Return a result with the derivatives of λ in its `facts`, and their time in its `seconds`.

    asked: compute the rates by strengths and weight; None: where there are few faces. vertices: by vertices as well.
    """
    start = time.perf_counter()
    faces = len(result.assembly.interfaces)
    wanted = faces <= _UNASKED if asked is None else asked
    rates = {name: rate.to_json() for name, rate in sensitivities(result).items()} if wanted else {}
    why = f"{faces} faces: ask for them with --sensitivities" if asked is None else "--no-sensitivities"
    facts: dict[str, Any] = {"sensitivities": rates} if wanted else {"sensitivities": {"not_computed": why}}
    if vertices:
        moves = geometry_sensitivities(result, one_sided=wanted and faces <= _KINKS)
        facts["geometry_sensitivities"] = None if moves is None else moves.to_json()
    took = time.perf_counter() - start
    seconds = dict(result.seconds)
    seconds |= {"sensitivities": took, "total": seconds.pop("total") + took}
    return replace(result, facts=result.facts | facts, seconds=seconds)


def draw_rates(result: LimitAnalysisResult, out: Path) -> None:
    """Write `vertices.png`, the derivatives of λ by vertices, into a folder."""
    # Nothing is written for a result without them.
    rates = result.facts.get("geometry_sensitivities")
    if rates is None:
        return
    from jld_core.views.figures import save_figure
    from jld_core.views.moved_joints import figure_of_vertex_rates

    places, values = (np.array(rates[name], dtype=float) for name in ("vertices", "derivative"))
    save_figure(figure_of_vertex_rates(result.assembly, result.labels, places, values), out / "vertices.png")
