"""Exact search: a formula of the labellings that may still be better, and conflicts that rule out the others.

- `Conflict`: labels that no labelling worth finding has together
- `Exact`: proof by conflicts
- `Formula`: labellings that nothing rules out yet
- `MinimumCount`: the best count among labellings that carry enough, proven
- `PossibleBlocks`: all blocks there can be
- `certify`: write the proof of a bound as a file that others can check
- `check_certifiable`: refuse a proof that has no certificate
- `conflict_of`: a labelling that is too weak → all that are for the same reason
- `possible_blocks`: the possible blocks of a space
"""

from __future__ import annotations

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
    "certify",
    "check_certifiable",
    "conflict_of",
    "possible_blocks",
]
