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
- `StopReason`: reason why a search ended
- `Summary`: outcome of a search by named fields
- `explore`: search the labellings of a scene and write the results into a folder
- `read_folder`: read a results folder as an `Exploration`
- `search_space`: build the search space of a scene
"""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jld_explore.drivers import Driver
    from jld_explore.evaluation import Evaluation
    from jld_explore.explore import explore
    from jld_explore.report import Exploration, Summary, read_folder
    from jld_explore.settings import (
        BudgetSettings,
        ExploreSettings,
        ModelSettings,
        OutputSettings,
        ParallelSettings,
        SearchMethod,
    )
    from jld_explore.space import SearchSpace, search_space
    from jld_explore.study_state import Progress, StopReason

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
    "StopReason",
    "Summary",
    "explore",
    "read_folder",
    "search_space",
]

_HOMES = {
    "drivers": ("Driver",),
    "evaluation": ("Evaluation",),
    "explore": ("explore",),
    "report": ("Exploration", "Summary", "read_folder"),
    "settings": (
        "BudgetSettings",
        "ExploreSettings",
        "ModelSettings",
        "OutputSettings",
        "ParallelSettings",
        "SearchMethod",
    ),
    "space": ("SearchSpace", "search_space"),
    "study": ("Progress", "StopReason"),
}
"""Names by the module that defines them."""


class _Face(ModuleType):
    """Module that loads its names on first use.

    `jld --help` needs none of them, and loading all takes 1.5 s.
    """

    def __getattr__(self, name: str) -> Any:
        """Import the module that defines a name and return the name's value."""
        home = next((home for home, names in _HOMES.items() if name in names), None)
        if home is None:
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")
        value = getattr(import_module(f"{self.__name__}.{home}"), name)
        super().__setattr__(name, value)
        return value

    def __setattr__(self, name: str, value: object) -> None:
        """Set an attribute, except where a loaded module has the name of an exported object."""
        # `explore` must remain the function although a module of this name is loaded.
        if not (name in __all__ and isinstance(value, ModuleType)):
            super().__setattr__(name, value)

    def __dir__(self) -> list[str]:
        """Return all names, including those not yet loaded."""
        return [*super().__dir__(), *__all__]


sys.modules[__name__].__class__ = _Face
