"""Reliability of a layout: first-order method, simulation, comparison of layouts.

- `Form`: result of the first-order method
- `GoverningBounds`: bounds on the governing factor of k samples: least λ / required of all load cases
- `Limit`: value and gradient of the limit function at a point of the standard normal space
- `LimitFunction`: governing factor less the required one, as a function of standard normal variables
- `ReliabilityOptions`: required factor, samples, seed and processes
- `SampleBounds`: bounds on the governing load factor of samples of one layout; thread-safe
- `Variables`: independent normal and lognormal random variables, docs/method.md (12.1), (12.2)
- `analyse`: compute the reliability of a layout (m,) by the first-order method and by simulation
- `compare`: compare two layouts of a structure on the same samples, by proven bounds on λ
- `design_point`: find the point of the failure surface nearest to the means, in standard normal space
- `estimate`: estimate the probability of failure by simulation around design points
- `explore_failures`: find design points with samples of larger variance, from that of the first-order method
- `random_structure`: return a structure as it depends on uncertain values; InputError for one that acts otherwise
- `simulate`: estimate the probability that a layout carries less than `required`
- `structure_of`: return the random structure of a scene; InputError for models that samples do not have
"""

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
