"""Drivers: what proposes the next labellings, by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from jld_core.errors import InputError
from jld_explore.drivers.base import Driver
from jld_explore.drivers.enumeration import Enumeration
from jld_explore.drivers.exact import Exact
from jld_explore.drivers.genetic import Genetic
from jld_explore.drivers.hillclimb import HillClimb
from jld_explore.drivers.random import Random
from jld_explore.space import SearchSpace


def _optuna(space: SearchSpace, seed: int, **options: Any) -> Driver:
    from jld_explore.drivers.optuna import Optuna  # slow to import, and only for those who ask for it

    return Optuna(space, seed, **options)


def _genetic(space: SearchSpace, seed: int, aim: str = "front", **options: Any) -> Driver:
    if aim not in AIMS:
        raise InputError("--aim", f"there is no aim {aim!r}", "best or front")
    return Genetic(space, seed, aims=AIMS[aim], **options)


AIMS: Final = {"best": 1, "front": 2}
"""Number of objectives of the genetic driver: λ alone, or λ and the count of the scene's front."""

DRIVERS: Final[dict[str, Callable[..., Driver]]] = {
    "enumeration": lambda space, seed: Enumeration(space),
    "random": Random,
    "hillclimb": HillClimb,
    "genetic": _genetic,
    "optuna": _optuna,
    "exact": Exact,
}

OPTIONS: Final[dict[str, tuple[str, ...]]] = {
    "genetic": ("population", "aim"),
    "exact": ("aim",),
    "hillclimb": ("start",),
    "optuna": ("sampler", "storage", "title"),
}
"""Options that the drivers take from a study, beside space and seed."""


def make_driver(name: str, space: SearchSpace, seed: int, **options: Any) -> Driver:
    """A fresh driver for a space. name: one of DRIVERS; options: the driver's own."""
    return DRIVERS[name](space, seed, **options)
