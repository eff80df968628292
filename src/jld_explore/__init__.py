"""Search the labellings of a scene: ranking, Pareto front and proof of optimality.

- `BudgetSettings`: when a search ends at the latest
- `Driver`: base class of search drivers, which propose labellings
- `Evaluation`: result of evaluating one labelling
- `Exploration`: finished search with its tables
- `ExploreSettings`: settings of a search, all concerns together
- `ModelSettings`: what is modelled, and what a search maximises
- `OutputSettings`: what a search writes
- `ParallelSettings`: where labellings are evaluated
- `Progress`: state of a running search
- `SearchMethod`: which labellings are tried, and in which order
- `SearchSpace`: labellings that may be searched
- `Step`: what follows a search, and adds to its summary
- `StepContext`: what a step may use beside the search
- `StopReason`: reason why a search ended
- `Summary`: outcome of a search by named fields
- `explore`: search the labellings of a scene and write the results into a folder
- `read_folder`: read a results folder as an `Exploration`
- `search_space`: build the search space of a scene
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core.lazy_exports import export_lazily

if TYPE_CHECKING:
    from jld_explore.drivers import Driver
    from jld_explore.evaluation import Evaluation
    from jld_explore.explore import explore
    from jld_explore.report import Exploration, Summary, read_folder
    from jld_explore.search.settings import (
        BudgetSettings,
        ExploreSettings,
        ModelSettings,
        OutputSettings,
        ParallelSettings,
        SearchMethod,
    )
    from jld_explore.search.state import Progress, StopReason
    from jld_explore.space import SearchSpace, search_space
    from jld_explore.steps.step import Step, StepContext

__all__ = [
    "BudgetSettings",
    "Driver",
    "Evaluation",
    "Exploration",
    "ExploreSettings",
    "ModelSettings",
    "OutputSettings",
    "ParallelSettings",
    "Progress",
    "SearchMethod",
    "SearchSpace",
    "Step",
    "StepContext",
    "StopReason",
    "Summary",
    "explore",
    "read_folder",
    "search_space",
]

export_lazily(
    __name__,
    {
        "drivers": ["Driver"],
        "evaluation": ["Evaluation"],
        "explore": ["explore"],
        "report": ["Exploration", "Summary", "read_folder"],
        "search.settings": [
            "BudgetSettings",
            "ExploreSettings",
            "ModelSettings",
            "OutputSettings",
            "ParallelSettings",
            "SearchMethod",
        ],
        "space": ["SearchSpace", "search_space"],
        "steps.step": ["Step", "StepContext"],
        "search.state": ["Progress", "StopReason"],
    },
)
