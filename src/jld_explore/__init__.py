"""Many labellings of one assembly → ranking, front, proof.

- `Driver`: what proposes labellings
- `Evaluation`: what is known of one labelling
- `Exploration`: a finished search
- `ExploreSettings`: how to search
- `Progress`: where a running search stands
- `SearchSpace`: what may be labelled
- `StopReason`: why a search ended
- `explore`: search the labellings of a scene into a folder
- `read_folder`: a folder → Exploration
- `search_space`: what a scene's "search" asks for
"""

from __future__ import annotations

from jld_explore.drivers import Driver
from jld_explore.evaluation import Evaluation
from jld_explore.explore import explore
from jld_explore.report import Exploration, read_folder
from jld_explore.space import SearchSpace, search_space
from jld_explore.study import ExploreSettings, Progress, StopReason

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
