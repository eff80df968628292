"""Ranges of reactions and of forces across joints, and the thrust that is left where supports give way."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core import export_lazily

if TYPE_CHECKING:
    from jld_practice.reactions.thrust import (
        Settled,
        reactions,
        reactions_of_supports,
        resultant_of_joint,
        resultant_of_section,
        settle,
        thrust_ranges,
    )

__all__ = [
    "Settled",
    "reactions",
    "reactions_of_supports",
    "resultant_of_joint",
    "resultant_of_section",
    "settle",
    "thrust_ranges",
]

export_lazily(
    __name__,
    {
        "thrust": [
            "Settled",
            "reactions",
            "settle",
            "reactions_of_supports",
            "resultant_of_joint",
            "resultant_of_section",
            "thrust_ranges",
        ]
    },
)
