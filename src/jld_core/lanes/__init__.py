"""Labellings in the lanes of a register: a compiled interior point over many labellings of one assembly."""

from jld_core.lanes.kernel import FALLS, OPEN, PROVEN, LaneAnswers, Lanes
from jld_core.lanes.library import chosen, described
from jld_core.lanes.rows import fits

__all__ = ["FALLS", "OPEN", "PROVEN", "LaneAnswers", "Lanes", "chosen", "described", "fits"]
