"""Profiles of shaped joints on a face of length 1: keys, sine waves and inclined joints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from jld_core.arrays import Floats
from jld_core.errors import ParameterError

_SEGMENTS: Final = 8  # number of straight segments of half a sine wave


@dataclass(frozen=True)
class Key:
    """Trapezoidal key in the middle of a face; lengths relative to the face.

    depth: height of the key. width: width at its root. flank: how much narrower its top is on each side, measured along
    the face.
    """

    depth: float
    width: float
    flank: float

    def teeth(self) -> list[tuple[Floats, int]]:
        """Return the outline (k, 2) of the key and side 1, along and across a face of length 1.

        A tooth of side 1 reaches into the second element.
        """
        low, high = 0.5 - 0.5 * self.width, 0.5 + 0.5 * self.width
        outline = [[low, 0.0], [high, 0.0], [high - self.flank, self.depth], [low + self.flank, self.depth]]
        return [(np.array(outline), 1)]

    def check(self) -> None:
        """Raise ParameterError for lengths that make no key."""
        if not (self.depth > 0.0 and 0.0 < self.width < 1.0 and 0.0 <= self.flank < 0.5 * self.width):
            problem = f"depth {self.depth:g}, width {self.width:g}, flank {self.flank:g} are no key"
            raise ParameterError("joint", problem, "depth > 0, 0 < width < 1, 0 <= flank < width/2, shares of the face")


@dataclass(frozen=True)
class Sine:
    """Sine wave along a face.

    amplitude: amplitude relative to the length of the face. waves: number of whole waves.
    """

    amplitude: float
    waves: int

    def teeth(self) -> list[tuple[Floats, int]]:
        """Return outline (k, 2) and side of each half wave, along and across a face of length 1.

        A tooth of side 1 reaches into the second element, one of side −1 into the first.
        """
        found, count = [], 2 * self.waves
        share = np.linspace(0.0, 1.0, _SEGMENTS + 1)
        for k in range(count):
            side = 1 if k % 2 == 0 else -1
            across = side * self.amplitude * np.sin(np.pi * share)
            across[[0, -1]] = 0.0
            found.append((np.column_stack([(k + share) / count, across]), side))
        return found

    def check(self) -> None:
        """Raise ParameterError for an amplitude or number that makes no wave."""
        if not (self.amplitude > 0.0 and self.waves >= 1):
            problem = f"amplitude {self.amplitude:g} with {self.waves} waves is no sine wave"
            raise ParameterError("joint", problem, "an amplitude > 0, a share of the face, and at least 1 wave")


@dataclass(frozen=True)
class Incline:
    """Joint turned about the middle of its face.

    slope: tangent of the angle between both; above 0 the joint rises along the face into the second element.
    """

    slope: float

    def teeth(self) -> list[tuple[Floats, int]]:
        """Return outline (k, 2) and side of both wedges, along and across a face of length 1.

        The wedge of side −1 reaches into the first element and the other, equally large, into the second.
        """
        rise, side = 0.5 * abs(self.slope), 1 if self.slope > 0.0 else -1
        first = np.array([[0.0, 0.0], [0.0, -side * rise], [0.5, 0.0]])
        second = np.array([[0.5, 0.0], [1.0, side * rise], [1.0, 0.0]])
        return [(first, -side), (second, side)]

    def check(self) -> None:
        """Raise ParameterError for a slope that leaves the joint straight."""
        if not 0.0 < abs(self.slope) < np.inf:
            raise ParameterError("joint", f"slope {self.slope:g} leaves the joint straight", "a slope above or below 0")


Shape = Key | Sine | Incline
"""Shape of a joint."""
