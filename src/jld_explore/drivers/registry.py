"""Registry of drivers by name."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

from jld_core import plugins
from jld_core.errors import ParameterError
from jld_core.parameters import near, typed
from jld_explore.drivers.anneal import Anneal
from jld_explore.drivers.base import Driver
from jld_explore.drivers.enumeration import Enumeration
from jld_explore.drivers.exact.driver import Exact, MinimumCount
from jld_explore.drivers.genetic import Genetic
from jld_explore.drivers.hillclimb import HillClimb
from jld_explore.drivers.optuna import Optuna
from jld_explore.drivers.portfolio import Portfolio
from jld_explore.drivers.searcher import Random
from jld_explore.space.search_space import SearchSpace

DRIVERS: Final[dict[str, type[Driver]]] = {
    kind.name: kind for kind in (Enumeration, Random, HillClimb, Anneal, Genetic, Portfolio, Optuna, Exact)
}
"""Driver classes of jld by name."""


def driver_kinds() -> dict[str, type[Driver]]:
    """Return all driver classes by name, plug-ins last; InputError for one unusable, or of a taken name."""
    added = plugins.load_all("jld.drivers", tuple(DRIVERS))
    for name, kind in added.items():
        if not (isinstance(kind, type) and issubclass(kind, Driver) and getattr(kind, "name", None) == name):
            raise plugins.refuse_type("jld.drivers", name, f"a subclass of jld_explore.Driver with name = {name!r}")
    return DRIVERS | added


def owners(option: str) -> Iterator[type[Driver]]:
    return (kind for kind in driver_kinds().values() if option in kind.Options.model_fields)


def driver_named(name: str) -> type[Driver]:
    kinds = driver_kinds()
    if name not in kinds:
        raise ParameterError("driver", f"no driver is named {name!r}", near(str(name), kinds))
    return kinds[name]


@typed
def make_driver(name: str, space: SearchSpace, seed: int, **options: Any) -> Driver:
    """Make a driver by its name.

    Parameters
    ----------
    name : str
        A name of `driver_kinds`; "exact" gives `MinimumCount` where `search.require` is set.
    space : SearchSpace
        The search space.
    seed : int
        Seed of the random choices.
    **options
        Options of the driver; None for the default.

    Returns
    -------
    Driver

    Raises
    ------
    InputError
        If no driver has the name, or an option is wrong or another driver's.
    """
    kind = driver_named(name)
    given = {key: value for key, value in options.items() if value is not None}
    for key in given:
        if key not in kind.Options.model_fields:
            others = " or ".join(f'`driver="{kind.name}"`' for kind in owners(key)) or "an option that it has"
            raise ParameterError(key, f"the driver {name} has no such option", others)
    if kind is Exact and space.search.require is not None:
        # with a required load factor the exact driver optimises a count
        return MinimumCount.made(space, seed, given)
    with plugins.guarded("jld.drivers", name):
        return kind.made(space, seed, given)
