"""Translations of planar blocks: arcs of directions in which convex pieces meet.

A convex piece that moves to infinity along d meets another piece at rest under a condition on their Minkowski
difference: the ray along d from the origin passes through its interior. These directions form an open arc of less than
a half turn, and of a half turn where the pieces touch along a face. The blocked directions of a body are the union of
the arcs of its pieces. This decides exactly whether a free direction exists; blocking changes only at ends of arcs.
Source: Wilson & Latombe, Geometric reasoning about mechanical assembly, Artificial Intelligence 71 (1994) 371–396.
"""

from __future__ import annotations

from functools import cached_property
from typing import Final

import numpy as np
import shapely

from jld_core.arrays import Bools, Floats, Ints
from jld_core.assembly import Assembly

_SMALLER: Final = 1e-6  # relative shrinkage of pieces at rest, so that touching pieces do not overlap by rounding

TURN: Final = 1e-7
"""Angle, radians, by which a direction may point into an obstacle: accuracy of normals in drawings."""

_SAME: Final = 1e-9  # distance, relative to the largest element, up to which two corners coincide

# Angle, radians, up to which the end of an exact arc belongs to the end of an arc of the shrunk pieces
_NEAR: Final = 1e-5

_PIECES: Final = 150  # largest number of pieces for which groups are tried at all ends of arcs

# Largest number of directions in which groups are tried. With more ends of arcs, or more than `_PIECES` pieces,
# directions along contacts replace them.
_TURNS: Final = 2000

_CHUNK: Final = 1 << 22  # number of entries of one batch of the blocking table


class Arcs:
    """Blocked translation directions between the elements of a planar assembly.

    Elements that are not convex are split into triangles. The resulting convex *pieces* are numbered over all elements;
    `owner` (p,) is the element of each. For each pair, the directions in which one piece meets the other at rest form
    one arc of angles. The arcs do not depend on the labelling.
    """

    def __init__(self, assembly: Assembly) -> None:
        self.assembly = assembly
        pieces, owner = [], []
        for element, shape in enumerate(assembly.elements.shape):
            found = _convex_pieces(shape)
            pieces += found
            owner += [element] * len(found)
        self.owner = np.array(owner, dtype=np.int64)
        size = max(len(piece) for piece in pieces)
        # Pad pieces to equally many corners by repeating the last one: only minima and maxima are taken over corners.
        self._corner = np.array([piece[np.minimum(np.arange(size), len(piece) - 1)] for piece in pieces])
        self._middle = np.array([piece.mean(axis=0) for piece in pieces])
        self._smaller = self._middle[:, None] + (1.0 - _SMALLER) * (self._corner - self._middle[:, None])
        self._size = float(max(np.ptp(shape, axis=0).max() for shape in assembly.elements.shape))
        self._of: dict[int, Floats] = {}
        self._exact: dict[int, Floats] = {}

    def of(self, piece: int) -> Floats:
        """Return the directions in which a piece would meet each of the p pieces, as arcs (p, 2).

        A row has the begin in [0, 2π) and the width of the arc, radians. A width below 0 means that the piece is never
        met. The pieces at rest are shrunk by a relative 1e-6, so that sliding along a contact is free.
        """
        if piece not in self._of:
            begin, width = self._seen(piece, self._smaller, 0.0)
            found = np.column_stack([(begin + TURN) % (2.0 * np.pi), width - 2.0 * TURN])
            found[piece, 1] = -1.0
            self._of[piece] = found
        return self._of[piece]

    def ends(self, piece: int) -> Floats:
        """Return the directions in which a piece would meet each piece at its exact size, (p, 2).

        A row has the angles of begin and end, radians; NaN for a piece that is never met. Motion along an end is
        parallel to the faces in contact, which the shrunk pieces of `of` do not give exactly.
        """
        if piece not in self._exact:
            begin, width = self._seen(piece, self._corner, _SAME * self._size)
            found = np.column_stack([begin, begin + width])
            found[self.of(piece)[:, 1] <= 0.0] = np.nan
            self._exact[piece] = found
        return self._exact[piece]

    def _seen(self, piece: int, resting: Floats, same: float) -> tuple[Floats, Floats]:
        """Compute the begin (p,) and width (p,) of the directions that each resting piece blocks.

        piece: index of the moving piece. resting: (p, k, 2) corners of the pieces at rest. same: distance up to which
        coinciding corners are ignored. Angles are in radians; begins are not reduced to one turn.
        """
        arm = resting[:, None] - self._corner[piece][None, :, None]
        arm = arm.reshape(len(self._corner), -1, 2)
        towards = self._middle - self._middle[piece]
        along = np.einsum("pki,pi->pk", arm, towards)
        across = towards[:, None, 0] * arm[:, :, 1] - towards[:, None, 1] * arm[:, :, 0]
        angle = np.where(np.hypot(arm[:, :, 0], arm[:, :, 1]) <= same, 0.0, np.arctan2(across, along))
        low, high = angle.min(axis=1), angle.max(axis=1)
        # pieces that overlap by more than rounding only block directions towards one another
        over = high - low >= np.pi + (TURN if same else 0.0)
        low, high = np.where(over, -0.5 * np.pi, low), np.where(over, 0.5 * np.pi, high)
        return np.arctan2(towards[:, 1], towards[:, 0]) + low, high - low

    def way_out(self, moving: Bools, still: Bools, up: Floats) -> Floats | None:
        """Return the direction nearest to `up` in which elements can leave others, or None.

        moving, still: (n,) bool masks of the elements that move together and of those at rest. up: (2,) unit vector.
        The result is a unit vector (2,); it is None where every direction is blocked.
        """
        mine, others = np.flatnonzero(moving[self.owner]), still[self.owner]
        arcs = np.concatenate([self.of(int(piece))[others] for piece in mine])
        arcs = arcs[arcs[:, 1] > 0.0]
        wanted = float(np.arctan2(up[1], up[0])) % (2.0 * np.pi)
        if not len(arcs):
            return up
        begin = arcs[np.argsort(arcs[:, 0], kind="stable")]
        end = np.maximum.accumulate(begin[:, 0] + begin[:, 1])
        # gaps between arcs: from the largest end so far, modulo a full turn, to the next begin
        before = np.concatenate([[end[-1] - 2.0 * np.pi], np.maximum(end[:-1], end[-1] - 2.0 * np.pi)])
        free = before <= begin[:, 0]
        if not free.any():
            return None
        low, high = before[free], begin[free, 0]
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        angle = _nearest(wanted, middle, half)
        best = int(np.argmin(np.round(abs(_turned(angle - wanted)), 6)))
        ends = np.concatenate([self.ends(int(piece))[others] for piece in mine])
        # the same gap between exact arcs, whose ends differ from those of the shrunk pieces
        after, before = _turned(ends[:, 1] - low[best]), _turned(ends[:, 0] - high[best])
        low_end = low[best] + np.max(after, initial=0.0, where=abs(after) <= _NEAR)
        high_end = high[best] + np.min(before, initial=0.0, where=abs(before) <= _NEAR)
        between = float(_nearest(wanted, 0.5 * (low_end + high_end), max(0.5 * float(high_end - low_end), 0.0)))
        direction = np.round([np.cos(between), np.sin(between)], 15)
        return np.asarray(direction / np.linalg.norm(direction)) + 0.0

    @cached_property
    def turns(self) -> Floats:
        """Angles (k,) of the directions tried for groups of blocks, radians, from 0 to 2π.

        They are the ends of all arcs, at which blocking changes. An assembly with too many pieces or ends has the
        directions along its contacts instead, at most 2000.
        """
        if len(self.owner) <= _PIECES:
            every = np.concatenate([self.ends(piece) for piece in range(len(self.owner))]).ravel()
            found = _different(every[np.isfinite(every)])
            if len(found) <= _TURNS:
                return found
        tangent = self.assembly.interfaces.e1
        angles = np.arctan2(tangent[:, 1], tangent[:, 0])
        return _different(np.concatenate([angles, angles + np.pi]))[:_TURNS]

    def blocking(self, of: Ints, count: int) -> Bools:
        """Return a table (k, b, b) of the blocks that obstruct others, by direction of `turns`.

        of: (n,) block of each element. count: number b of blocks. Entry (direction, i, j) is True where block i, moved
        along the direction, meets block j.
        """
        place = of[self.owner]
        table = np.array([self.of(piece) for piece in range(len(self.owner))])
        found = np.zeros((len(self.turns), count, count), dtype=bool)
        step = max(1, _CHUNK // max(1, table[:, :, 0].size))
        holds = np.zeros((len(place), count), dtype=np.float32)
        holds[np.arange(len(place)), place] = 1.0
        for first in range(0, len(self.turns), step):
            angle = self.turns[first : first + step, None, None]
            # angles that differ by less than 1e-6 are equal: an arc blocks directions inside it by more than that
            inside = (angle - table[:, :, 0] - 1e-6) % (2.0 * np.pi) < table[:, :, 1] - 2e-6
            found[first : first + step] = (holds.T @ inside.astype(np.float32) @ holds) > 0.0
        found[:, np.arange(count), np.arange(count)] = False
        return found


def _turned(angle: Floats | float) -> Floats:
    """Reduce angles of any shape to −π … π, radians."""
    return np.asarray((angle + np.pi) % (2.0 * np.pi) - np.pi)


def _nearest(wanted: float, middle: Floats | float, half: Floats | float) -> Floats:
    """Return the angle nearest to the wanted one in each interval (middle ± half)."""
    return np.asarray(middle + np.clip(_turned(wanted - middle), -half, half))


def _different(angles: Floats) -> Floats:
    """Reduce angles to [0, 2π) and drop repeated ones, equal when rounded to 1e-6.

    The order is that of the rounded angles, modulo 2π. An angle just below 2π therefore counts as 0 and may come first.
    """
    angles = angles % (2.0 * np.pi)
    _, first = np.unique(np.round(angles, 6) % round(2.0 * np.pi, 6), return_index=True)
    return angles[first]


def _convex_pieces(shape: Floats) -> list[Floats]:
    """Split a polygon (k, 2) into convex polygons: itself if convex, else triangles."""
    edge = np.roll(shape, -1, axis=0) - shape
    turn = edge[:, 0] * np.roll(edge, -1, axis=0)[:, 1] - edge[:, 1] * np.roll(edge, -1, axis=0)[:, 0]
    size = float(abs(edge).max())
    if turn.min() >= -1e-9 * size * size:
        return [shape]
    parts = shapely.get_parts(shapely.constrained_delaunay_triangles(shapely.Polygon(shape)))
    return [shapely.get_coordinates(part)[:3] for part in parts]
