"""Many labellings of one assembly → ranking, front, proof.

`explore` (with `ExploreSettings`) gives an `Exploration`, read back by `read_folder`; `search_space` the `SearchSpace`,
what may be labelled; `Driver`, what asks, and `Evaluation`, what it is told; `Progress` and `StopReason` of a run.
"""

from __future__ import annotations

from jld_explore.drivers import Driver
from jld_explore.evaluation import Evaluation
from jld_explore.explore import ExploreSettings, explore
from jld_explore.report import Exploration, read_folder
from jld_explore.space import SearchSpace, search_space
from jld_explore.study import Progress, StopReason

__all__ = [
    "Driver",
    "Evaluation",
    "Exploration",
    "ExploreSettings",
    "Progress",
    "SearchSpace",
    "StopReason",
    "explore",
    "read_folder",
    "search_space",
]
