"""Search the labellings of a scene: ranking, Pareto front and proof of optimality.

- `BudgetSettings`: when a search ends at the latest
- `Driver`: base class of search drivers, which propose labellings
- `Evaluation`: result of evaluating one labelling
- `Exploration`: finished search with its tables
- `ExploreSettings`: settings of a search, all concerns together
- `Interrupted`: exception of the command line's signal handlers; finished results are on disk
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
- `busy_factor`: return the factor by which a busy machine prolongs work, 1 to `BUSY`
- `explore`: search the labellings of a scene and write the results into a folder
- `most_without_cuts`: return the upper bound on λ by faces where every face that may be inner is inner
- `read_folder`: read a results folder as an `Exploration`
- `search_space`: build the search space of a scene
- `sweep`: compute λ over a grid of values of a scene
- `with_entries`: return a search with further entries of its summary and columns of its results; nothing is written
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core.lazy_exports import export_lazily

if TYPE_CHECKING:
    from jld_explore.drivers.base import Driver
    from jld_explore.evaluation.protocol import Evaluation
    from jld_explore.explore import explore
    from jld_explore.report.reading import Exploration, read_folder
    from jld_explore.report.tables import Summary
    from jld_explore.search.settings import (
        BudgetSettings,
        ExploreSettings,
        ModelSettings,
        OutputSettings,
        ParallelSettings,
        SearchMethod,
    )
    from jld_explore.search.state import Interrupted, Progress, StopReason
    from jld_explore.space.search_space import SearchSpace, search_space
    from jld_explore.steps.step import Step, StepContext, busy_factor, most_without_cuts, with_entries
    from jld_explore.sweep import sweep

__all__ = [
    "BudgetSettings",
    "Driver",
    "Evaluation",
    "Exploration",
    "ExploreSettings",
    "Interrupted",
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
    "busy_factor",
    "explore",
    "most_without_cuts",
    "read_folder",
    "search_space",
    "sweep",
    "with_entries",
]

export_lazily(
    __name__,
    {
        "drivers.base": ["Driver"],
        "evaluation.protocol": ["Evaluation"],
        "explore": ["explore"],
        "report.reading": ["Exploration", "read_folder"],
        "report.tables": ["Summary"],
        "search.settings": [
            "BudgetSettings",
            "ExploreSettings",
            "ModelSettings",
            "OutputSettings",
            "ParallelSettings",
            "SearchMethod",
        ],
        "space.search_space": ["SearchSpace", "search_space"],
        "steps.step": ["with_entries", "Step", "StepContext", "busy_factor", "most_without_cuts"],
        "search.state": ["Interrupted", "Progress", "StopReason"],
        "sweep": ["sweep"],
    },
)
