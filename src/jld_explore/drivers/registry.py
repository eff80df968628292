"""Drivers: what proposes the next labellings, by name."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

from jld_core.errors import InputError
from jld_explore.drivers.anneal import Anneal
from jld_explore.drivers.base import Driver
from jld_explore.drivers.enumeration import Enumeration
from jld_explore.drivers.exact import Exact, MinimumCount
from jld_explore.drivers.genetic import Genetic
from jld_explore.drivers.hillclimb import HillClimb
from jld_explore.drivers.optuna import Optuna
from jld_explore.drivers.random import Random
from jld_explore.space import SearchSpace

DRIVERS: Final[dict[str, type[Driver]]] = {
    kind.name: kind for kind in (Enumeration, Random, HillClimb, Anneal, Genetic, Optuna, Exact)
}
"""All that go by a name; one of your own that is put here goes by its name as well."""


def owners(option: str) -> Iterator[type[Driver]]:
    """The drivers that take an option."""
    return (kind for kind in DRIVERS.values() if option in kind.Options.model_fields)


def make_driver(name: str, space: SearchSpace, seed: int, **options: Any) -> Driver:
    """A fresh driver for a space. name: one of DRIVERS; options: the driver's own, None for its default.

    Raises InputError for an option that is wrong, or that is another driver's.
    """
    given = {key: value for key, value in options.items() if value is not None}
    for key in given:
        if key not in DRIVERS[name].Options.model_fields:
            others = " or ".join(f"--driver {kind.name}" for kind in owners(key)) or "an option that it has"
            raise InputError(f"--{key}", f"the driver {name} has no such option", others)
    kind = DRIVERS[name]
    if kind is Exact and space.search.require is not None:
        # a count is what is proven then
        return MinimumCount.made(space, seed, given)
    return kind.made(space, seed, given)
