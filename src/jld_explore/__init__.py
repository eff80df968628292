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

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
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

_HOMES = {
    "drivers": ("Driver",),
    "evaluation": ("Evaluation",),
    "explore": ("explore",),
    "report": ("Exploration", "read_folder"),
    "space": ("SearchSpace", "search_space"),
    "study": ("ExploreSettings", "Progress", "StopReason"),
}


class _Face(ModuleType):
    """Names are loaded when they are asked for: `jld --help` needs none of them, and all take a second and a half."""

    def __getattr__(self, name: str) -> Any:
        home = next((home for home, names in _HOMES.items() if name in names), None)
        if home is None:
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")
        value = getattr(import_module(f"{self.__name__}.{home}"), name)
        super().__setattr__(name, value)
        return value

    def __setattr__(self, name: str, value: object) -> None:
        # `explore` is the function, though a module of that name is loaded
        if not (name in __all__ and isinstance(value, ModuleType)):
            super().__setattr__(name, value)

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *__all__]


sys.modules[__name__].__class__ = _Face
