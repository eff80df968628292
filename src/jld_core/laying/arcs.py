"""Planar blocks that move along a direction: the arc of directions in which one convex piece meets another.

A convex piece that moves to infinity along d meets another one, at rest, where the ray along d from the origin passes
through the inside of their Minkowski difference: for directions between two angles, an open arc of less than a half
turn, and of a half turn where they touch along a face. What blocks a body is the union of the arcs of its pieces, so
whether a direction is left is decided exactly, and the directions at which anything changes are the ends of arcs.
Source: Wilson & Latombe, Geometric reasoning about mechanical assembly, Artificial Intelligence 71 (1994) 371–396.
"""

from __future__ import annotations

from functools import cached_property
from typing import Final

import numpy as np
import shapely

from jld_core.arrays import Bools, Floats, Ints
from jld_core.assembly import Assembly

_SMALLER: Final = 1e-6
"""Part by which what is at rest is made smaller, so that what touches does not overlap by rounding."""

TURN: Final = 1e-7
"""Angle by which a direction may point into an obstacle: what the normals of a drawing leave."""

_PIECES: Final = 150
_TURNS: Final = 2000
"""Pieces, and directions, up to which groups are tried wherever anything changes, and not along contacts alone."""

_CHUNK: Final = 1 << 22
"""Entries of one table of who blocks whom."""


class Arcs:
    """Directions in which the elements of a planar assembly meet one another, whatever its blocks are."""

    def __init__(self, assembly: Assembly) -> None:
        self.assembly = assembly
        pieces, owner = [], []
        for element, shape in enumerate(assembly.elements.shape):
            found = _convex_pieces(shape)
            pieces += found
            owner += [element] * len(found)
        self.owner = np.array(owner, dtype=np.int64)
        size = max(len(piece) for piece in pieces)
        # corners repeated to one number for all: what is asked of them is a least and a most
        self._corner = np.array([piece[np.minimum(np.arange(size), len(piece) - 1)] for piece in pieces])
        self._middle = np.array([piece.mean(axis=0) for piece in pieces])
        self._smaller = self._middle[:, None] + (1.0 - _SMALLER) * (self._corner - self._middle[:, None])
        self._of: dict[int, Floats] = {}

    def of(self, piece: int) -> Floats:
        """(p, 2) where the arc of each other piece begins, in [0, 2π), and how wide it is; below 0: never met."""
        if piece not in self._of:
            arm = self._smaller[:, None] - self._corner[piece][None, :, None]
            arm = arm.reshape(len(self._corner), -1, 2)
            towards = self._middle - self._middle[piece]
            along = np.einsum("pki,pi->pk", arm, towards)
            across = towards[:, None, 0] * arm[:, :, 1] - towards[:, None, 1] * arm[:, :, 0]
            angle = np.arctan2(across, along)
            low, high = angle.min(axis=1), angle.max(axis=1)
            # pieces that overlap by more than rounding keep one another from coming closer, and nothing else
            over = high - low >= np.pi
            low, high = np.where(over, -0.5 * np.pi, low), np.where(over, 0.5 * np.pi, high)
            begin = (np.arctan2(towards[:, 1], towards[:, 0]) + low + TURN) % (2.0 * np.pi)
            found = np.column_stack([begin, high - low - 2.0 * TURN])
            found[piece, 1] = -1.0
            self._of[piece] = found
        return self._of[piece]

    def way_out(self, moving: Bools, still: Bools, up: Floats) -> Floats | None:
        """The direction (2,) nearest to another in which some elements leave others; None where there is none.

        moving, still: (n,) elements. up: (2,) unit.
        """
        mine, others = np.flatnonzero(moving[self.owner]), still[self.owner]
        arcs = np.concatenate([self.of(int(piece))[others] for piece in mine])
        arcs = arcs[arcs[:, 1] > 0.0]
        wanted = float(np.arctan2(up[1], up[0])) % (2.0 * np.pi)
        if not len(arcs):
            return up
        begin = arcs[np.argsort(arcs[:, 0], kind="stable")]
        end = np.maximum.accumulate(begin[:, 0] + begin[:, 1])
        # from the end of what came before, round the turn, to where the next begins
        before = np.concatenate([[end[-1] - 2.0 * np.pi], np.maximum(end[:-1], end[-1] - 2.0 * np.pi)])
        free = before <= begin[:, 0]
        if not free.any():
            return None
        low, high = before[free], begin[free, 0]
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        aside = (wanted - middle + np.pi) % (2.0 * np.pi) - np.pi
        angle = middle + np.clip(aside, -half, half)
        best = int(np.argmin(np.round(abs((angle - wanted + np.pi) % (2.0 * np.pi) - np.pi), 6)))
        if half[best] < 1e-5:
            angle[best] = middle[best]
        direction = np.round([np.cos(angle[best]), np.sin(angle[best])], 5)
        return np.asarray(direction / np.linalg.norm(direction)) + 0.0

    @cached_property
    def turns(self) -> Floats:
        """Angles (k,) at which it changes who blocks whom, ends of arcs; along contacts alone where those are many."""
        if len(self.owner) <= _PIECES:
            every = np.concatenate([self.of(piece) for piece in range(len(self.owner))])
            every = every[every[:, 1] > 0.0]
            found = _different(np.concatenate([every[:, 0] - TURN, every[:, 0] + every[:, 1] + TURN]))
            if len(found) <= _TURNS:
                return found
        tangent = self.assembly.interfaces.e1
        angles = np.arctan2(tangent[:, 1], tangent[:, 0])
        return _different(np.concatenate([angles, angles + np.pi]))[:_TURNS]

    def blocking(self, of: Ints, count: int) -> Bools:
        """(k, b, b) for every angle in `turns`: who keeps whom from moving along it. of: (n,) blocks."""
        place = of[self.owner]
        table = np.array([self.of(piece) for piece in range(len(self.owner))])
        found = np.zeros((len(self.turns), count, count), dtype=bool)
        step = max(1, _CHUNK // max(1, table[:, :, 0].size))
        holds = np.zeros((len(place), count), dtype=np.float32)
        holds[np.arange(len(place)), place] = 1.0
        for first in range(0, len(self.turns), step):
            angle = self.turns[first : first + step, None, None]
            # angles were rounded: an arc blocks what lies inside it by more than that
            inside = (angle - table[:, :, 0] - 1e-6) % (2.0 * np.pi) < table[:, :, 1] - 2e-6
            found[first : first + step] = (holds.T @ inside.astype(np.float32) @ holds) > 0.0
        found[:, np.arange(count), np.arange(count)] = False
        return found


def _different(angles: Floats) -> Floats:
    return np.unique(np.round(angles % (2.0 * np.pi), 6) % round(2.0 * np.pi, 6))


def _convex_pieces(shape: Floats) -> list[Floats]:
    """Convex polygons that make up a polygon (k, 2): itself, or triangles."""
    edge = np.roll(shape, -1, axis=0) - shape
    turn = edge[:, 0] * np.roll(edge, -1, axis=0)[:, 1] - edge[:, 1] * np.roll(edge, -1, axis=0)[:, 0]
    size = float(abs(edge).max())
    if turn.min() >= -1e-9 * size * size:
        return [shape]
    parts = shapely.get_parts(shapely.constrained_delaunay_triangles(shapely.Polygon(shape)))
    return [shapely.get_coordinates(part)[:3] for part in parts]
