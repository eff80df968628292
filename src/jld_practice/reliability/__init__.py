"""Reliability of a layout: first-order method, simulation, comparison of layouts."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core import export_lazily

if TYPE_CHECKING:
    from jld_practice.reliability.monte_carlo import (
        Form,
        Limit,
        LimitFunction,
        ReliabilityOptions,
        analyse,
        compare,
        design_point,
        estimate,
        explore_failures,
        simulate,
        structure_of,
    )
    from jld_practice.reliability.structure import GoverningBounds, SampleBounds, Variables, random_structure

__all__ = [
    "Form",
    "GoverningBounds",
    "Limit",
    "LimitFunction",
    "ReliabilityOptions",
    "SampleBounds",
    "Variables",
    "analyse",
    "compare",
    "design_point",
    "estimate",
    "explore_failures",
    "random_structure",
    "simulate",
    "structure_of",
]

export_lazily(
    __name__,
    {
        "monte_carlo": [
            "ReliabilityOptions",
            "analyse",
            "estimate",
            "explore_failures",
            "structure_of",
            "Form",
            "Limit",
            "LimitFunction",
            "design_point",
            "compare",
            "simulate",
        ],
        "structure": ["GoverningBounds", "SampleBounds", "Variables", "random_structure"],
    },
)
