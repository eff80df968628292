"""Exact search: refute labellings by conflicts until none can exceed the best one known.

- `Conflict`: labels on some faces that no labelling above a load factor has together
- `Exact`: driver that proves the largest load factor, or the front of a count, by conflicts
- `Formula`: Boolean formula whose models are the labellings that no clause rules out yet
- `MinimumCount`: driver that proves the best count among labellings of a required load factor
- `PossibleBlocks`: list of all blocks that a segmentation of a space may contain
- `admissible_layout`: construct one labelling of a space, or prove that there is none
- `certify`: write the proof of a bound as a certificate file that `jld verify` checks
- `check_certifiable`: raise InputError if the proof of a driver cannot have a certificate
- `conflict_of`: minimise one labelling that is too weak to a conflict
- `possible_blocks`: list the possible blocks of a space
"""

from __future__ import annotations

from jld_explore.drivers.exact.admissible import admissible_layout
from jld_explore.drivers.exact.certifying import certify, check_certifiable
from jld_explore.drivers.exact.conflict_minimization import Conflict, conflict_of
from jld_explore.drivers.exact.driver import Exact
from jld_explore.drivers.exact.formula import Formula
from jld_explore.drivers.exact.minimum_count import MinimumCount
from jld_explore.drivers.exact.possible_blocks import PossibleBlocks, possible_blocks

__all__ = [
    "Conflict",
    "Exact",
    "Formula",
    "MinimumCount",
    "PossibleBlocks",
    "admissible_layout",
    "certify",
    "check_certifiable",
    "conflict_of",
    "possible_blocks",
]
