"""Search drivers: strategies that choose the labellings to evaluate next.

- `DRIVERS`: driver classes by name
- `MEMORY`: number of labellings that the surrogate remembers
- `REACH`: largest number of undecided faces for which the exact driver is the default
- `BufferedRandom`: random choices from numbers that are generated in batches
- `Driver`: abstract base class of all search strategies
- `DriverOptions`: base class of the options of a driver
- `Enumeration`: driver that enumerates all classes of a space
- `Exact`: driver that proves the largest load factor, or the front of a count, by conflicts
- `Formula`: Boolean formula whose models are the labellings that no clause rules out yet
- `Genetic`: driver that runs a genetic algorithm with a surrogate
- `PossibleBlocks`: list of all blocks that a segmentation of a space may contain
- `Register`: set of the classes that a driver has proposed
- `Segmentations`: operators on the segmentations of a space
- `Surrogate`: Gaussian process that predicts the rank of labellings
- `Tally`: numbers of labellings and classes of a space
- `bound_of_all`: compute an upper bound on λ of all labellings of a space
- `certify`: write the proof of a bound as a certificate file that `jld verify` checks
- `check_certifiable`: raise InputError if the proof of a driver cannot have a certificate
- `conflict_of`: minimise one labelling that is too weak to a conflict
- `driver_for`: choose the driver where none is named
- `first_layout`: return one labelling of a space quickly
- `make_driver`: make a driver by its name
- `operators`: make the operators on the labellings of a space
- `owners`: list the drivers that have an option
- `possible_blocks`: list the possible blocks of a space
- `size_up_to`: count the classes of a space, up to a limit
- `what_would_prove`: describe in one line what is left to prove
"""

from __future__ import annotations

from jld_explore.drivers.base import Driver, DriverOptions
from jld_explore.drivers.choice import REACH, bound_of_all, driver_for, what_would_prove
from jld_explore.drivers.enumeration import Enumeration, Tally, size_up_to
from jld_explore.drivers.exact import (
    Exact,
    Formula,
    PossibleBlocks,
    certify,
    check_certifiable,
    conflict_of,
    possible_blocks,
)
from jld_explore.drivers.first import first_layout
from jld_explore.drivers.genetic import Genetic
from jld_explore.drivers.operators import BufferedRandom, Segmentations, operators
from jld_explore.drivers.registry import DRIVERS, make_driver, owners
from jld_explore.drivers.searcher import Register
from jld_explore.drivers.surrogate import MEMORY, Surrogate

__all__ = [
    "DRIVERS",
    "MEMORY",
    "REACH",
    "BufferedRandom",
    "Driver",
    "DriverOptions",
    "Enumeration",
    "Exact",
    "Formula",
    "Genetic",
    "PossibleBlocks",
    "Register",
    "Segmentations",
    "Surrogate",
    "Tally",
    "bound_of_all",
    "certify",
    "check_certifiable",
    "conflict_of",
    "driver_for",
    "first_layout",
    "make_driver",
    "operators",
    "owners",
    "possible_blocks",
    "size_up_to",
    "what_would_prove",
]
