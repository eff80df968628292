"""Search drivers: strategies that choose the labellings to evaluate next.

- `DRIVERS`: driver classes by name
- `BufferedRandom`: random choices from numbers that are generated in batches
- `Driver`: abstract base class of all search strategies
- `DriverOptions`: base class of the options of a driver
- `Register`: set of the classes that a driver has proposed
- `driver_kinds`: all driver classes by name, those of plug-ins too
- `make_driver`: make a driver by its name
- `operators`: make the operators on the labellings of a space
"""

from __future__ import annotations

from jld_explore.drivers.base import Driver, DriverOptions
from jld_explore.drivers.operators.atom_graph import BufferedRandom
from jld_explore.drivers.operators.segmentations import operators
from jld_explore.drivers.registry import DRIVERS, driver_kinds, make_driver
from jld_explore.drivers.searcher import Register

__all__ = [
    "DRIVERS",
    "BufferedRandom",
    "Driver",
    "DriverOptions",
    "Register",
    "driver_kinds",
    "make_driver",
    "operators",
]
