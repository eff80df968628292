"""Masonry bonds: positions of the head joints, course by course."""

from __future__ import annotations

from typing import Final

import numpy as np

from jld_core.arrays import Floats
from jld_core.errors import ParameterError

BONDS: Final = ("running", "third", "stack", "english", "flemish")
"""Names of the bonds.

running: every second course shifted by half a stretcher. third: courses shifted by 0, 1/3 and 2/3 of a stretcher.
stack: all head joints in line. english: courses of stretchers and of headers alternate. flemish: stretchers and headers
alternate in each course, headers over the middle of stretchers.
"""

_SLIVER: Final = 0.25  # shortest piece at the end of a course, in stretchers; a shorter one joins its neighbour


def course(bond: str, number: int, length: float, stretcher: float) -> Floats:
    """Return the positions of the head joints of one course, with its ends.

    Raises InputError for an unknown bond.
    """
    # The result (k + 1,) ascends from 0 to `length` and bounds k stones.
    if bond not in BONDS:
        raise ParameterError("bond", f"no bond is named {bond!r}", "one of " + ", ".join(BONDS))
    if bond == "flemish":
        pattern, start = [stretcher, 0.5 * stretcher], 0.75 * stretcher * (number % 2)
    elif bond == "english":
        header = number % 2 == 1
        pattern, start = [0.5 * stretcher if header else stretcher], 0.25 * stretcher if header else 0.0
    else:
        share = {"running": 0.5 * (number % 2), "third": (number % 3) / 3.0, "stack": 0.0}[bond]
        pattern, start = [stretcher], share * stretcher
    repeats = int(np.ceil(length / sum(pattern))) + 2
    joints = start - sum(pattern) + np.concatenate([[0.0], np.cumsum(np.tile(pattern, repeats))])
    inside = joints[
        (joints > _SLIVER * stretcher * (1.0 - 1e-9)) & (joints < length - _SLIVER * stretcher * (1.0 - 1e-9))
    ]
    return np.concatenate([[0.0], inside, [length]])


def without(pieces: list[tuple[float, float]], left: float, right: float, least: float) -> list[tuple[float, float]]:
    """Remove an interval, such as an opening, from the stones of a course.

    pieces: both ends of each stone. left, right: the interval. least: length below which what is left joins its
    neighbour.
    """
    before = [(float(a), float(min(b, left))) for a, b in pieces if a < left - 1e-12]
    after = [(float(max(a, right)), float(b)) for a, b in pieces if b > right + 1e-12]
    if len(before) > 1 and before[-1][1] - before[-1][0] < least:
        before = [*before[:-2], (before[-2][0], before[-1][1])]
    if len(after) > 1 and after[0][1] - after[0][0] < least:
        after = [(after[0][0], after[1][1]), *after[2:]]
    return before + after
