"""Search drivers: strategies that choose the labellings to evaluate next.

- `DRIVERS`: driver classes by name
- `BufferedRandom`: random choices from numbers that are generated in batches
- `DriverOptions`: base class of the options of a driver
- `Genetic`: driver that breeds many children, and evaluates the most promising of a pool
- `Register`: set of the classes that a driver has proposed
- `make_driver`: make a driver by its name
- `operators`: make the operators on the labellings of a space
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core.lazy_exports import export_lazily
from jld_explore.drivers.base import DriverOptions
from jld_explore.drivers.operators.atom_graph import BufferedRandom
from jld_explore.drivers.operators.segmentations import operators
from jld_explore.drivers.registry import DRIVERS, make_driver
from jld_explore.drivers.searcher import Register

if TYPE_CHECKING:
    from jld_explore.drivers.genetic import Genetic

__all__ = [
    "DRIVERS",
    "BufferedRandom",
    "DriverOptions",
    "Genetic",
    "Register",
    "make_driver",
    "operators",
]

export_lazily(
    __name__,
    {
        "genetic": ["Genetic"],
    },
)
