"""Ranges of reactions and of forces across joints, and the thrust that is left where supports give way.

- `Settled`: range of thrust after a support movement
- `reactions`: compute the resultants (k, q) of forces (m, q) at faces on elements (k,), about their centroids
- `reactions_of_supports`: return all components of the reactions of supports, in the axes of the scene
- `resultant_of_joint`: return all components of the resultant between two elements, as it acts on the second one
- `resultant_of_section`: return N, V and M of the faces on a line, as they act on the part to its left; planar
- `settle`: compute the range of thrust after a support movement, by the assembly's labels unless given
- `thrust_ranges`: bracket the least and greatest value of reactions or other resultants
"""

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
