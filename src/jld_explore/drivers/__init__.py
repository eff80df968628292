"""Drivers: what proposes the next labellings, by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from jld_explore.candidates import SearchSpace
from jld_explore.drivers.base import Driver
from jld_explore.drivers.enumeration import Enumeration

DRIVERS: Final[dict[str, Callable[..., Driver]]] = {
    "enumeration": lambda space, seed: Enumeration(space),
}


def make_driver(name: str, space: SearchSpace, seed: int, **options: Any) -> Driver:
    """A fresh driver for a space. name: one of DRIVERS; options: the driver's own."""
    return DRIVERS[name](space, seed, **options)
