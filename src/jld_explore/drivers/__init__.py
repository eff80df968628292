"""Search drivers: strategies that choose the labellings to evaluate next."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core.lazy_exports import export_lazily
from jld_explore.drivers.base import DriverOptions
from jld_explore.drivers.choice import DRIVERS, make_driver
from jld_explore.drivers.operators.atom_graph import BufferedRandom
from jld_explore.drivers.operators.segmentations import operators
from jld_explore.drivers.searcher import Register

if TYPE_CHECKING:
    from jld_explore.drivers.genetic import Genetic

__all__ = ["DRIVERS", "BufferedRandom", "DriverOptions", "Genetic", "Register", "make_driver", "operators"]

export_lazily(__name__, {"genetic": ["Genetic"]})
