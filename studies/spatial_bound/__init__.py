"""Lower bound on λ over all solutions without dilation, in space: a study, since it closes small scenes only.

`python -m studies.spatial_bound.scenes` says how far it goes, `python -m studies.spatial_bound.adversary` holds
certified solutions against it. Scenes of up to 10 faces close; of 18 faces they do not (scenes.md).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

from jld_core import Assembly
from jld_core.arrays import Bits, Floats
from jld_core.limit import LimitAnalysis, SolveOptions
from jld_core.models import limit_analysis
from jld_core.models.zero_dilation.fixed_point_search import ProximalOptions
from jld_core.models.zero_dilation.lower_bound_problem import LowerBound, LowerBoundProblem
from jld_core.models.zero_dilation.multi_start_search import MultiStartSearch
from jld_core.models.zero_dilation.range import RangeOptions, load_range
from jld_core.models.zero_dilation.starts import repair_and_evaluate
from studies.spatial_bound.lower_bound import SpaceLowerBoundSearch
from studies.spatial_bound.modes import space_modes_of

_TRIED: Final = 3
"""Number of states of a relaxation that are certified as solutions."""


def bound_in_space(analysis: LimitAnalysis, labels: Bits, side: MultiStartSearch, seconds: float) -> LowerBound | None:
    """Compute the lower bound of a spatial labelling; certify the states of its relaxations directly.

    These states are often solutions that no other start finds. None where there is no bound, see `space_modes_of`.
    """
    found, modes = side.found, space_modes_of(analysis.template, labels)
    if modes is None:
        return None

    def offer(states: Floats) -> float:
        """Certify states of a relaxation and search from the first; return the lowest λ."""
        for state in states[:_TRIED]:
            found.offer(repair_and_evaluate(side.fixed_point, state))
        for state in states[:1]:
            side.search_from(state[:-1], thorough=False)
        return found.lowest_load

    return SpaceLowerBoundSearch(analysis, labels, modes, LowerBoundProblem(found.lowest_load, seconds, offer)).search()


def range_in_space(assembly: Assembly, seconds: float = 60.0, **options: Any) -> dict[str, Any]:
    """The entries of `load_range` for the labels of a spatial assembly, with a bound; options: of `SolveOptions`."""
    analysis = limit_analysis(assembly, replace(SolveOptions(), **options))
    associative = analysis.prove(assembly.labels)
    proof = load_range(
        analysis, assembly.labels, ProximalOptions(), associative, RangeOptions(seconds, bound=bound_in_space)
    )
    unit = analysis.template.scaling.load
    return {**proof.extra, "associative_load_factor": associative.load_factor * unit}
