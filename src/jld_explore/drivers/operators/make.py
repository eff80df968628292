"""Make the operators that suit a search space."""

from __future__ import annotations

from jld_explore.drivers.operators.free_bits import FreeBits
from jld_explore.drivers.operators.interface import Operators
from jld_explore.drivers.operators.segmentations import Segmentations
from jld_explore.space import SearchSpace


def operators(space: SearchSpace) -> Operators:
    """Make the operators on the labellings of a space.

    Parameters
    ----------
    space : SearchSpace
        The search space.

    Returns
    -------
    Operators
        Operators on segmentations, or on single labels if slits are allowed.
    """
    return Segmentations(space) if space.search.segmentation else FreeBits(space)
