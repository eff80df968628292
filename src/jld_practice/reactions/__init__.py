"""Ranges of reactions and of forces across joints, and the thrust that is left where supports give way.

- `Settled`: range of thrust after a support movement
- `thrust_ranges`: bracket the least and greatest value of reactions or other resultants
"""

from __future__ import annotations

from jld_practice.reactions.force_range import Settled
from jld_practice.reactions.thrust import thrust_ranges

__all__ = ["Settled", "thrust_ranges"]
