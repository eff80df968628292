"""Conversion of fill to loads and bounded horizontal pressures on a planar structure, docs/method.md (1.14)–(1.16).

After W. J. M. Rankine, "On the stability of loose earth", Philosophical Transactions of the Royal Society 147 (1857),
9–27.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Final

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Floats, Ints
from jld_core.assembly import Elements, Members
from jld_core.errors import InputError
from jld_core.loads import Traction, edge_traction
from jld_core.scene import FillLoad
from jld_core.scene.materials import Fill

# Force at a point: element, place, vector, stated width or None, and whether the place is the centroid.
PointEntry = tuple[int, Floats, Floats, float | None, bool]

_DRAWN: Final = 0.025  # length of the line that stands for a horizontal pressure in pictures, in sizes of the structure


@dataclass(frozen=True)
class CoveredEdge:
    """Straight piece of the upper boundary of an element, under fill."""

    element: int  # index of the element
    x: Floats  # (2,) horizontal positions of both ends, ascending or equal
    height: Floats  # (2,) heights of both ends
    side: float  # horizontal direction in which the outward normal leans: 1, −1, or 0 for a level edge

    def between(self, low: float, high: float) -> CoveredEdge:
        share = np.array([low, high])
        x = self.x[0] + share * (self.x[1] - self.x[0])
        height = self.height[0] + share * (self.height[1] - self.height[0])
        return CoveredEdge(self.element, x, height, self.side)


@dataclass(frozen=True)
class Backing:
    """Fill on the upper boundary of elements. A position is measured along `right`, a height against gravity."""

    fill: Fill  # entry of the scene
    elements: Elements
    down: Floats  # (2,) direction of gravity, a unit vector
    gravity: float  # magnitude of its acceleration
    thickness: float  # thickness of the structure, length

    @cached_property
    def edges(self) -> tuple[CoveredEdge, ...]:
        """Return the covered edges from left to right, with those of supports; raise InputError if there are none."""
        upper = list(self._top())
        covered = [part for edge in [*upper, *self._walls(upper)] for part in self._below(edge, self.fill.level)]
        if not covered:
            highest = max(float(edge.height.max()) for edge in upper) if upper else 0.0
            problem = f"nothing lies below a surface at {self.fill.level:g}"
            raise InputError("fill.level", problem, f"a height above the structure, which reaches {highest:g}")
        return tuple(sorted(covered, key=lambda edge: float(edge.x.mean())))

    def permanent(self) -> list[Traction]:
        """Return weight of fill and surcharge, and active pressure, as tractions on free elements."""
        # Each covered edge has a vertical one, and a horizontal one unless it is level.
        tractions: list[Traction] = []
        for edge in self._free:
            depth = self.fill.level - edge.height
            width = float(edge.x[1] - edge.x[0])
            tractions += self._traction(edge, self._vertical(depth) * width, self.down)
            # Cohesion leaves no active pressure above a certain depth; below it the pressure is linear.
            for piece in self._below(edge, self.fill.level - self._free_depth):
                tractions += self._traction(piece, self._active(piece) * self._rise(piece), -piece.side * self._right)
        return tractions

    def spread(self, load: FillLoad, where: str) -> list[Traction | PointEntry]:
        """Return a load on the surface as tractions on covered edges, or a force at a point for no width."""
        # The load is uniform over a width that grows with the depth of the structure below the middle of the load. What
        # falls beside free elements is left out: supports and ground carry it.
        position, edges = load.on_fill.at, [edge for edge in self.edges if edge.x[1] > edge.x[0]]
        covering = [edge for edge in edges if edge.x[0] <= position <= edge.x[1]]
        if not covering:
            left, right = edges[0].x[0], max(float(edge.x[1]) for edge in edges)
            problem = f"no element lies below the fill at {position:g}"
            raise InputError(f"{where}.on_fill.at", problem, f"a position from {left:g} to {right:g}")
        depth = self.fill.level - float(np.interp(position, covering[0].x, covering[0].height))
        width = load.on_fill.width + 2.0 * depth * math.tan(math.radians(self.fill.dispersal))
        if width <= tolerances.ON_OUTLINE * self.elements.size:
            owner, height = covering[0], self.fill.level - depth
            force = load.weight * self.down
            point_load = (owner.element, self._point(position, height), force, None, False)
            return [] if self.elements.support[owner.element] else [point_load]
        loads: list[Traction | PointEntry] = []
        for edge in self._free:
            length = float(edge.x[1] - edge.x[0])
            left = max(float(edge.x[0]), position - 0.5 * width)
            right = min(float(edge.x[1]), position + 0.5 * width)
            if right > left:
                share = ((left - edge.x[0]) / length, (right - edge.x[0]) / length)
                part, level = edge.between(*share), (right - left) / (width * self.thickness)
                loads += self._traction(part, np.full(2, load.weight * level), self.down)
        return loads

    def outlines(self) -> tuple[Floats, ...]:
        """Return the outline (4, 2) of the fill above each covered edge that is not vertical."""
        found = []
        for edge in self.edges:
            if edge.x[1] > edge.x[0]:
                ends = [(edge.x[0], edge.height[0]), (edge.x[1], edge.height[1])]
                ends += [(edge.x[1], self.fill.level), (edge.x[0], self.fill.level)]
                found.append(np.array([self._point(*end) for end in ends]))
        return tuple(found)

    def carries(self, point: Floats) -> bool:
        """Return True if a point (2,) lies on the surface of the fill."""
        height = float(-(point @ self.down))
        return abs(height - self.fill.level) <= tolerances.ON_OUTLINE * self.elements.size

    def covers(self, x: float) -> bool:
        """Return True if some element lies below the fill at a horizontal position."""
        return any(edge.x[0] <= x <= edge.x[1] for edge in self.edges)

    def position(self, point: Floats) -> float:
        return float(point @ self._right)

    def pressures(self) -> Members:
        """Return the pressure beyond the active one as bars from free elements to supports."""
        # The bars act in compression. A bar pushes an element horizontally with a force between 0 and the difference of
        # passive and active pressure.
        supports = np.flatnonzero(self.elements.support)
        position_of_support = self.elements.centroid[supports] @ self._right
        names: list[str] = []
        ends: list[Ints] = []
        points: list[Floats] = []
        capacities: list[float] = []
        bars_of: Counter[str] = Counter()
        for edge in self._free:
            resultant = self._mobilised(edge)
            if resultant is None:
                continue
            force, point = resultant
            name = f"fill on {self.elements.ids[edge.element]}"
            bars_of[name] += 1
            names.append(name if bars_of[name] == 1 else f"{name} ({bars_of[name]})")
            ground = supports[np.argmax(edge.side * position_of_support)]
            ends.append(np.array([edge.element, ground]))
            points.append(np.array([point, point + edge.side * _DRAWN * self.elements.size * self._right]))
            capacities.append(force)
        zero = np.zeros(len(names))
        axis = [(end - start) / np.linalg.norm(end - start) for start, end in points]
        return Members(
            names=tuple(names),
            kinds=("fill",) * len(names),
            elements=tuple(ends),
            points=tuple(points),
            axis=np.array(axis).reshape(-1, 2),
            tension=zero,
            compression=np.array(capacities),
            shear=zero,
            prestress=zero,
        )

    def _mobilised(self, edge: CoveredEdge) -> tuple[float, Floats] | None:
        """Return the resultant of passive less active pressure on an edge and its point (2,); None for no force."""
        shares = [0.0, 1.0]
        kink = self.fill.level - self._free_depth  # the difference is linear on both sides of this height
        if edge.height.min() < kink < edge.height.max():
            shares.insert(1, float((kink - edge.height[0]) / (edge.height[1] - edge.height[0])))
        parts = [edge.between(*pair) for pair in pairwise(shares)]
        forces = [self.thickness * self._rise(part) * (self._passive(part) - self._active(part)) for part in parts]
        total = sum(float(ends.sum()) / 2.0 for ends in forces)
        if total <= 0.0:
            return None
        moment = sum(self._centre(part, ends) * ends.sum() / 2.0 for part, ends in zip(parts, forces, strict=True))
        return total, moment / total

    @property
    def _right(self) -> Floats:
        """Return the horizontal unit vector (2,): gravity turned by +90°."""
        return np.array([-self.down[1], self.down[0]])

    @property
    def _free(self) -> list[CoveredEdge]:
        return [edge for edge in self.edges if not self.elements.support[edge.element]]

    @property
    def _free_depth(self) -> float:
        """Return the depth down to which cohesion leaves no active pressure, at least 0."""
        # There the vertical stress is 2 c √Kp, at which `_active` begins: Ka σ = 2 c √Ka, and Ka = 1 / Kp.
        unit_weight = self.fill.density * self.gravity
        stress_of_weight = self.fill.cohesive_pressure(self.fill.passive_coefficient) - self.fill.surcharge
        return max(0.0, stress_of_weight / unit_weight) if unit_weight else 0.0

    def _vertical(self, depth: Floats) -> Floats:
        """Return the vertical stress at depths (k,) below the surface."""
        return self.fill.surcharge + self.fill.density * self.gravity * depth

    def _active(self, edge: CoveredEdge) -> Floats:
        coefficient = 1.0 / self.fill.passive_coefficient
        stress = self._vertical(self.fill.level - edge.height)
        full = coefficient * stress - self.fill.cohesive_pressure(coefficient)
        return np.asarray(self.fill.active * np.maximum(full, 0.0))

    def _passive(self, edge: CoveredEdge) -> Floats:
        coefficient = self.fill.passive_coefficient
        stress = self._vertical(self.fill.level - edge.height)
        return np.asarray(
            self.fill.passive * coefficient * stress
            + self.fill.passive_cohesion * self.fill.cohesive_pressure(coefficient)
        )

    def _rise(self, edge: CoveredEdge) -> float:
        return float(abs(edge.height[1] - edge.height[0])) if edge.side else 0.0

    def _point(self, x: float, height: float) -> Floats:
        return x * self._right - height * self.down

    def _centre(self, edge: CoveredEdge, ends: Floats) -> Floats:
        """Return the point (2,) at which a linear pressure, (2,) at the ends of the edge, acts."""
        share = (ends[0] + 2.0 * ends[1]) / (3.0 * (ends[0] + ends[1])) if ends.any() else 0.5
        middle = edge.between(share, share)
        return self._point(float(middle.x[0]), float(middle.height[0]))

    def _traction(self, edge: CoveredEdge, ends: Floats, direction: Floats) -> list[Traction]:
        """Return a linear pressure along `direction` as a traction, [] if there is none.

        ends: (2,) pressure times projected length.
        """
        if not ends.any():
            return []
        points = np.array([self._point(*end) for end in zip(edge.x, edge.height, strict=True)])
        length = float(np.hypot(*(points[1] - points[0])))
        return [edge_traction(edge.element, points, np.outer(ends * self.thickness / length, direction))]

    def _below(self, edge: CoveredEdge, level: float) -> Iterator[CoveredEdge]:
        """Yield the piece of an edge below a height, if it is longer than rounding."""
        first, last = edge.height.tolist()
        low, high = 0.0, 1.0
        if first > level and last > level:
            return
        if first > level:
            low = (level - first) / (last - first)
        if last > level:
            high = (level - first) / (last - first)
        part = edge.between(low, high)
        if math.hypot(part.x[1] - part.x[0], part.height[1] - part.height[0]) > self._reach:
            yield part

    @property
    def _reach(self) -> float:
        """Return the length up to which positions count as equal."""
        return tolerances.ON_OUTLINE * self.elements.size

    def _outlines(self) -> Iterator[tuple[int, Floats, Floats]]:
        """Yield element, start and end (position, height) of each edge, counter-clockwise."""
        turn = np.column_stack([self._right, -self.down])
        for index, shape in enumerate(self.elements.shape):
            corners = shape @ turn
            for first, last in zip(corners, np.roll(corners, -1, axis=0), strict=True):
                yield index, first, last

    def _top(self) -> Iterator[CoveredEdge]:
        """Yield the pieces of the highest boundary from left to right, one for each edge."""
        upper = [  # outlines are counter-clockwise, so that edges of the upper side run to the left
            (index, last, first) for index, first, last in self._outlines() if first[0] - last[0] > self._reach
        ]
        owner = np.array([index for index, _, _ in upper])
        left = np.array([start for _, start, _ in upper]).reshape(-1, 2)
        right = np.array([end for _, _, end in upper]).reshape(-1, 2)
        positions = np.unique(np.concatenate([left[:, 0], right[:, 0]]))
        first_position = -np.inf if self.fill.start is None else self.fill.start
        last_position = np.inf if self.fill.end is None else self.fill.end
        positions = np.unique(np.clip(positions, first_position, last_position))
        slope = (right[:, 1] - left[:, 1]) / (right[:, 0] - left[:, 0])
        pieces: list[tuple[int, float, float]] = []
        for start, end in pairwise(positions.tolist()):
            middle = 0.5 * (start + end)
            covering = np.flatnonzero((left[:, 0] <= middle) & (middle <= right[:, 0]))
            if end - start <= self._reach or not covering.size:
                continue
            highest = int(covering[np.argmax(left[covering, 1] + slope[covering] * (middle - left[covering, 0]))])
            if pieces and pieces[-1][0] == highest and start - pieces[-1][2] <= 2.0 * self._reach:
                pieces[-1] = (highest, pieces[-1][1], end)
            else:
                pieces.append((highest, start, end))
        for highest, start, end in pieces:
            x = np.array([start, end])
            height = left[highest, 1] + slope[highest] * (x - left[highest, 0])
            level = abs(height[1] - height[0]) <= self._reach
            yield CoveredEdge(int(owner[highest]), x, height, 0.0 if level else float(-np.sign(slope[highest])))

    def _walls(self, top: list[CoveredEdge]) -> Iterator[CoveredEdge]:
        """Yield the vertical edges between successive pieces of the highest boundary."""
        upright = [
            (index, first, last) for index, first, last in self._outlines() if abs(last[0] - first[0]) <= self._reach
        ]
        for left, right in pairwise(top):
            if right.x[0] - left.x[1] > 2.0 * self._reach:
                continue
            low, high = sorted((float(left.height[1]), float(right.height[0])))
            side = 1.0 if left.height[1] > right.height[0] else -1.0
            for index, first, last in upright:
                if abs(first[0] - right.x[0]) > 2.0 * self._reach or (last[1] - first[1]) * side <= 0.0:
                    continue
                bottom, top_height = max(low, min(first[1], last[1])), min(high, max(first[1], last[1]))
                if top_height - bottom > self._reach:
                    yield CoveredEdge(index, np.full(2, right.x[0]), np.array([bottom, top_height]), side)
