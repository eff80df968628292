"""Which labelling is asked next.

- `DRIVERS`: drivers by name
- `MEMORY`: labellings the surrogate learns from
- `REACH`: faces up to which the exact driver is taken unasked
- `BufferedRandom`: random choices, drawn in blocks
- `Driver`: one strategy of search
- `DriverOptions`: what a driver takes besides, described
- `Enumeration`: all classes, in one order
- `Exact`: proof by conflicts
- `Formula`: labellings that nothing rules out yet
- `Genetic`: a population that is crossed and varied
- `PossibleBlocks`: all blocks there can be
- `Register`: what was proposed before
- `Segmentations`: how a segmentation is changed
- `Surrogate`: learns λ and guesses at the rest
- `Tally`: labellings and classes of a space
- `bound_of_all`: λ that no labelling of a space exceeds
- `certify`: write the proof of a bound as a file that others can check
- `check_certifiable`: refuse a proof that has no certificate
- `conflict_of`: a labelling that is too weak → all that are for the same reason
- `driver_for`: the driver where none is named
- `first_layout`: one labelling of a space, as soon as can be
- `make_driver`: a driver by its name
- `operators`: how labellings of a space are changed
- `owners`: the drivers that take an option
- `possible_blocks`: the possible blocks of a space
- `size_up_to`: the number of classes, if soon found
- `what_would_prove`: one line on what is left to prove
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
