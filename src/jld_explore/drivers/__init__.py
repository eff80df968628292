"""Which labelling is asked next."""

from __future__ import annotations

from jld_explore.drivers.base import Driver
from jld_explore.drivers.enumeration import Enumeration, Tally, size_up_to
from jld_explore.drivers.exact import (
    Conflict,
    Exact,
    Formula,
    PossibleBlocks,
    Record,
    conflict_of,
    front,
    front_of_all,
    possible_blocks,
)
from jld_explore.drivers.genetic import Genetic
from jld_explore.drivers.operators import BufferedRandom, Segmentations, operators
from jld_explore.drivers.registry import DRIVERS, OPTIONS, make_driver
from jld_explore.drivers.searcher import Register
from jld_explore.drivers.surrogate import MEMORY, Surrogate

__all__ = [
    "DRIVERS",
    "MEMORY",
    "OPTIONS",
    "BufferedRandom",
    "Conflict",
    "Driver",
    "Enumeration",
    "Exact",
    "Formula",
    "Genetic",
    "PossibleBlocks",
    "Record",
    "Register",
    "Segmentations",
    "Surrogate",
    "Tally",
    "conflict_of",
    "front",
    "front_of_all",
    "make_driver",
    "operators",
    "possible_blocks",
    "size_up_to",
]
