"""λ by faces of a structure without cuts, reported if a cut layout is proven stronger."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Final

from jld_core.assembly import Assembly
from jld_core.deadline import Deadline
from jld_core.files import write_text
from jld_core.limit import Status
from jld_core.models.case_analysis import CaseAnalysis
from jld_core.scene import Scene
from jld_explore.report import Exploration, Summary
from jld_explore.settings import ExploreSettings
from jld_explore.space import SearchSpace

MOST: Final = 2000
"""Largest number of interfaces of an assembly that is solved without its cuts."""


def most_without_cuts(scene: Scene, assembly: Assembly, space: SearchSpace) -> float | None:
    """Return the upper bound on λ by faces where every face that may be inner is inner.

    Result: upper bound on the governing factor. None where it is not finite, beside other crack models, uncertain
    values or cells left out, and above MOST interfaces.
    """
    plain = scene.cracks == "faces" and space.void is None and not assembly.has_low_values
    if not plain or len(assembly.labels) > MOST:
        return None
    high = CaseAnalysis(assembly, single_labelling=True).solve(space.fixed & ~space.candidates).bracket[1]
    return float(high) if math.isfinite(high) else None


def add_uncut(done: Exploration, space: SearchSpace, settings: ExploreSettings, deadline: Deadline) -> Exploration:
    """Compare the best layout of a search by faces with the structure without cuts.

    Result: the search; where the best is proven stronger, its summary has `uncut_at_most`, the upper bound without
    cuts.
    """
    facts = done.summary.facts
    other = settings.by_experiment or settings.own_objective is not None or facts.get("require")
    model = type(settings.model)()
    if other or settings.model != model or facts["best"] is None or facts["unbounded"] or deadline.passed():
        return done
    best = done.results.iloc[0]
    high = most_without_cuts(done.scene, done.assembly, space) if best["status"] == str(Status.COLLAPSE) else None
    if high is None or not float(best["bracket_lo"]) > high:
        return done
    found = replace(done, summary=Summary.of({**facts, "uncut_at_most": high}))
    write_text(done.folder / "summary.json", json.dumps(found.summary.facts, indent=1))
    return found
