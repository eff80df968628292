"""λ by faces of a structure without cuts, reported if a cut layout is proven stronger."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

from jld_core.assembly import Assembly
from jld_core.limit import Status
from jld_core.models import CaseAnalysis
from jld_core.scene import Scene
from jld_explore.report import Exploration
from jld_explore.space import SearchSpace
from jld_explore.steps.step import Step, StepContext, with_entries

MOST: Final = 2000
"""Largest number of interfaces of an assembly that is solved without its cuts."""


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
    if not plain or len(assembly.labels) > MOST:
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
