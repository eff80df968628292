"""Add the derivatives of λ by strengths, weight and vertices to the result of a solve."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from jld_core import plugins
from jld_core.limit import LimitAnalysisResult
from jld_core.models import sensitivities

_FACES: Final = 40  # number of faces up to which `jld solve` looks for kinks of the derivatives by vertices


def with_rates(result: LimitAnalysisResult, *, vertices: bool) -> LimitAnalysisResult:
    """Return a result with the derivatives of λ by strengths and weight in its `facts`."""
    rates = {name: rate.to_json() for name, rate in sensitivities(result).items()}
    if not vertices:
        return replace(result, facts={**result.facts, "sensitivities": rates})

    few = len(result.assembly.interfaces) <= _FACES
    moves = plugins.part("geometry_sensitivities")(result, one_sided=few)
    by_vertex = None if moves is None else moves.to_json()
    return replace(result, facts={**result.facts, "sensitivities": rates, "geometry_sensitivities": by_vertex})


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
