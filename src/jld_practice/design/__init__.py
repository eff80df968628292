"""From an outline to numbered stones: tessellations tried, searched, moved, checked and explained."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core import export_lazily

if TYPE_CHECKING:
    from jld_practice.design import run, tessellations, trials
    from jld_practice.design.options import DesignOptions, Outline, read_outline, with_loads
    from jld_practice.design.page import facts_of, write_design
    from jld_practice.design.run import Task
    from jld_practice.design.tessellations import Tessellation, uniaxial_strength, with_crushing
    from jld_practice.design.trials import Design, Screening, Trial

__all__ = [
    "Design",
    "DesignOptions",
    "Outline",
    "Screening",
    "Task",
    "Tessellation",
    "Trial",
    "facts_of",
    "read_outline",
    "run",
    "tessellations",
    "trials",
    "uniaxial_strength",
    "with_crushing",
    "with_loads",
    "write_design",
]

export_lazily(
    __name__,
    {
        "options": ["with_loads", "DesignOptions", "Outline", "read_outline"],
        "page": ["facts_of", "write_design"],
        "run": ["Task"],
        "tessellations": ["uniaxial_strength", "with_crushing", "Tessellation"],
        "trials": ["Design", "Screening", "Trial"],
    },
    submodules=["run", "tessellations", "trials"],
)
