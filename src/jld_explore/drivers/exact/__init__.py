"""Exact search: a formula of the labellings that may still be better, and conflicts that rule out the others."""

from __future__ import annotations

from jld_explore.drivers.exact.conflicts import Conflict, conflict_of
from jld_explore.drivers.exact.driver import Exact
from jld_explore.drivers.exact.formula import Formula
from jld_explore.drivers.exact.optimum import front, front_of_all
from jld_explore.drivers.exact.possible_blocks import PossibleBlocks, possible_blocks
from jld_explore.drivers.exact.record import Record

__all__ = [
    "Conflict",
    "Exact",
    "Formula",
    "PossibleBlocks",
    "Record",
    "conflict_of",
    "front",
    "front_of_all",
    "possible_blocks",
]
