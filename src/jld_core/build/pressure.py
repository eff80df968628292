"""Conversion of a scene's load entries to loads as they act, with their places on the boundary of the structure."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Floats
from jld_core.assembly import Elements, Interfaces
from jld_core.build.fill import Backing, PointEntry
from jld_core.build.loads import body_forces, couple_of, force_of
from jld_core.build.patches import patch_tractions, surface_tractions
from jld_core.errors import InputError
from jld_core.loads import Loads, Traction, edge_traction, points_of
from jld_core.scene import FillLoad, PointLoad
from jld_core.scene.loads import OUTSIDE, BodyLoad, FaceLoad, LoadEntry


@dataclass(frozen=True)
class Boundary:
    """Elements and interfaces of a structure, from which free boundaries follow."""

    elements: Elements
    interfaces: Interfaces  # all interfaces, also those that a scene states
    thickness: float  # thickness of planar elements, length
    backing: Backing | None = None  # fill on the structure, None without fill

    def loads(self, entries: Sequence[LoadEntry], key: str) -> Loads:
        """Return load entries of a scene as loads on elements.

        Result: pressures and loads on fill are tractions on straight pieces of free boundary, in space on free faces.
        Raises InputError for an unknown element, a support, or a vector of the wrong length; if a pressure names no
        free boundary, or varies where it has no direction to vary along; if a load stands on fill where there is none.
        """
        d = self.elements.centroid.shape[1]
        body = np.zeros((len(self.elements), d))
        couples = np.zeros((len(self.elements), 1 if d == 2 else 3))
        points, tractions = [], list[Traction]()
        for position, entry in enumerate(entries):
            where = f"{key}[{position}]"
            if isinstance(entry, BodyLoad):
                body += body_forces(entry, self.elements, where)
            elif isinstance(entry, PointLoad):
                index, couple = couple_of(entry, self.elements, where)
                couples[index] += couple
                if entry.force is not None:
                    points.append(force_of(entry, index, self.elements, where))
            elif isinstance(entry, FillLoad):
                spread = self._on_fill(entry, where)
                tractions += [one for one in spread if isinstance(one, Traction)]
                points += [one for one in spread if not isinstance(one, Traction)]
            elif entry.face.along is not None:
                tractions += self._along(entry, entry.face.along, where)
            elif entry.face.patch is not None:
                tractions += patch_tractions(self.elements, self.interfaces, entry, where)
            else:
                tractions += self._around(entry, where)
        return Loads(body, couples, points_of(points, d), tuple(tractions))

    def _on_fill(self, entry: FillLoad, where: str) -> list[Traction | PointEntry]:
        """Return a load on the surface of the fill; raise InputError without fill."""
        if self.backing is None:
            raise InputError(f"{where}.on_fill", "the scene has no fill", '"fill" with level, density and friction')
        return self.backing.spread(entry, where)

    @property
    def _reach(self) -> float:
        """Return the distance up to which a point counts as on an outline, length."""
        return tolerances.ON_OUTLINE * self.elements.size

    def _around(self, entry: FaceLoad, where: str) -> list[Traction]:
        """Return the tractions of a uniform pressure on the whole free boundary of one element.

        Raises InputError for a support or an unknown element, pressure that varies, or no free boundary.
        """
        name, other = entry.face.between or ("", "")
        if other != OUTSIDE or name not in self.elements.index:
            problem = f"no free face lies between {name!r} and {other!r}"
            raise InputError(f"{where}.face.between", problem, f'the id of a free element, and "{OUTSIDE}"')
        index = self.elements.index[name]
        if self.elements.support[index]:
            raise InputError(f"{where}.face.between", f"{name!r} is a support", "the id of a free element")
        first, last = entry.ends
        if first != last:
            problem = "the pressure varies, and the faces of an element have no first and last point"
            raise InputError(f"{where}.pressure", problem, 'one number, or "along" with two points')
        if self.elements.centroid.shape[1] == 3:
            return surface_tractions(self.elements, self.interfaces, index, first)
        free = [
            self._piece(index, start, end, (first, first))
            for _, _, pieces in self._edges(index)
            for start, end in pieces
        ]
        if not free:
            raise InputError(f"{where}.face.between", f"no face of {name!r} is free", "an element with a free face")
        return free

    def _along(self, entry: FaceLoad, along: list[list[float]], where: str) -> list[Traction]:
        """Return the tractions of a pressure or line load along a polyline on the free boundary.

        Raises InputError for a spatial scene, coinciding points, or a part of the polyline that is no free boundary.
        """
        if self.elements.centroid.shape[1] == 3 or any(len(point) != 2 for point in (*along, entry.line or (0, 0))):
            raise InputError(f"{where}.face.along", "it is for planar scenes", '"between" or "patch"')
        points = np.array(along, dtype=float)
        legs = np.linalg.norm(np.diff(points, axis=0), axis=1)
        if not (legs > self._reach).all():
            raise InputError(f"{where}.face.along", "two of its points coincide", "points apart from each other")
        place = np.append(0.0, np.cumsum(legs)) / legs.sum()
        first, last = entry.ends
        found: list[Traction] = []
        for k, leg in enumerate(legs.tolist()):
            ends = [first + (last - first) * share for share in (place[k], place[k + 1])]
            pieces = list(self._on_leg(points[k], (points[k + 1] - points[k]) / leg, leg))
            covered = sum(high - low for _, low, high, _ in pieces)
            if abs(covered - leg) > self._reach * (1 + len(pieces)):
                problem = f"of its {leg:.6g} from point {k + 1} to {k + 2}, {covered:.6g} is free boundary"
                raise InputError(f"{where}.face.along", problem, "points on the outline of the structure")
            for index, low, high, forward in pieces:
                values = [ends[0] + (ends[1] - ends[0]) * share / leg for share in (low, high)]
                start, end = (points[k] + share * (points[k + 1] - points[k]) / leg for share in (low, high))
                if self.elements.support[index]:
                    continue
                if entry.line is not None:
                    found.append(edge_traction(index, np.array([start, end]), np.array([entry.line, entry.line])))
                elif forward:
                    found.append(self._piece(index, start, end, (values[0], values[1])))
                else:
                    found.append(self._piece(index, end, start, (values[1], values[0])))
        return found

    def _on_leg(self, start: Floats, unit: Floats, length: float) -> Iterator[tuple[int, float, float, bool]]:
        """Yield the pieces of free boundary along one leg of a polyline.

        start: (2,) first point of the leg. unit: (2,) direction.
        """
        reach = self._reach
        ends = np.array([start, start + length * unit])
        low, high = ends.min(axis=0) - reach, ends.max(axis=0) + reach
        near = ((self.elements.lower <= high) & (low <= self.elements.upper)).all(axis=1)
        for index in np.flatnonzero(near).tolist():
            for first, last, pieces in self._edges(index):
                sideways = [abs((p - start)[0] * unit[1] - (p - start)[1] * unit[0]) for p in (first, last)]
                if max(sideways) > reach:
                    continue
                forward = bool((last - first) @ unit > 0.0)
                for one, other in pieces:
                    least, most = sorted((float((one - start) @ unit), float((other - start) @ unit)))
                    least, most = max(least, 0.0), min(most, length)
                    if most - least > reach:
                        yield index, least, most, forward

    def _edges(self, index: int) -> Iterator[tuple[Floats, Floats, list[tuple[Floats, Floats]]]]:
        """Yield the ends of each edge of a planar element, with its free intervals."""
        reach = self._reach
        outline = self.elements.shape[index]
        mine = np.flatnonzero((self.interfaces.a == index) | (self.interfaces.b == index))
        for first, last in zip(outline, np.roll(outline, -1, axis=0), strict=True):
            length = float(np.hypot(*(last - first)))
            if length <= reach:
                continue
            unit = (last - first) / length
            taken = []
            for face in mine.tolist():
                arm = self.interfaces.polygon[face] - first
                if abs(arm[:, 0] * unit[1] - arm[:, 1] * unit[0]).max() <= reach:
                    low, high = sorted((arm @ unit).tolist())
                    taken.append((max(low, 0.0), min(high, length)))
            free, place = [], 0.0
            for low, high in [*sorted(span for span in taken if span[1] > span[0]), (length, length)]:
                if low - place > reach:
                    free.append((first + place * unit, first + low * unit))
                place = max(place, high)
            yield first, last, free

    def _piece(self, index: int, start: Floats, end: Floats, pressures: tuple[float, float]) -> Traction:
        """Return a linear pressure on a straight free piece of an outline (planar)."""
        inward = np.array([start[1] - end[1], end[0] - start[0]]) / np.hypot(*(end - start))
        return edge_traction(index, np.array([start, end]), np.outer(pressures, self.thickness * inward))
