"""Conversion of pressure on boundary faces to forces and moments on elements.

Source: docs/method.md (1.7) and (1.8).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Floats
from jld_core.assembly import Elements, Interfaces
from jld_core.build.fill import Backing
from jld_core.build.loads import PlacedLoad
from jld_core.build.patches import patch_loads
from jld_core.errors import InputError
from jld_core.scene import PointLoad
from jld_core.scene.fill import FillLoad
from jld_core.scene.loads import OUTSIDE, BodyLoad, FaceLoad, LoadEntry


@dataclass(frozen=True)
class Boundary:
    """Elements and interfaces of a structure, from which free boundaries follow.

    Attributes
    ----------
    elements : Elements
        The elements.
    interfaces : Interfaces
        All interfaces, also those that a scene states.
    thickness : float
        Thickness of planar elements, length.
    backing : Backing or None
        Fill on the structure, None without fill.
    """

    elements: Elements
    interfaces: Interfaces
    thickness: float
    backing: Backing | None = None

    def plain(self, entries: Sequence[LoadEntry], key: str) -> list[PlacedLoad]:
        """Replace pressures and loads on fill by statically equivalent forces and moments.

        Parameters
        ----------
        entries : sequence of LoadEntry
            Load entries of a scene.
        key : str
            Key of the entries in the scene, for error messages.

        Returns
        -------
        list of PlacedLoad
            Other entries unchanged. In the plane, a pressure gives one force and moment for each straight piece of free
            boundary. On a solid it gives one force at each interface, see `_solid`.

        Raises
        ------
        InputError
            If a pressure names no free boundary, or varies where it has no direction to vary along; if a load stands on
            fill where there is none.
        """
        found: list[PlacedLoad] = []
        for position, entry in enumerate(entries):
            where = f"{key}[{position}]"
            loads: Sequence[PointLoad | BodyLoad]
            if isinstance(entry, FillLoad):
                loads = self._on_fill(entry, where)
            elif not isinstance(entry, FaceLoad):
                loads = [entry]
            elif entry.face.along is not None:
                loads = self._along(entry, entry.face.along, where)
            elif entry.face.patch is not None:
                loads = patch_loads(self.elements, self.interfaces, entry, where)
            else:
                loads = self._around(entry, where)
            found += [PlacedLoad(where, load, isinstance(entry, FaceLoad | FillLoad)) for load in loads]
        return found

    def _on_fill(self, entry: FillLoad, where: str) -> list[PointLoad]:
        """Return the forces of a load on the surface of the fill; raise InputError without fill.

        where: key of the entry.
        """
        if self.backing is None:
            raise InputError(f"{where}.on_fill", "the scene has no fill", '"fill" with level, density and friction')
        return self.backing.spread(entry, where)

    @property
    def _reach(self) -> float:
        """Return the distance up to which a point counts as on an outline, length."""
        return tolerances.ON_OUTLINE * self.elements.size

    def _around(self, entry: FaceLoad, where: str) -> list[PointLoad]:
        """Return the loads of a uniform pressure on the whole free boundary of one element.

        where: key of the entry. Raises InputError for a support or an unknown element, pressure that varies, or no free
        boundary.
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
            return self._solid(index, first)
        free = [
            self._piece(index, start, end, (first, first))
            for _, _, pieces in self._edges(index)
            for start, end in pieces
        ]
        if not free:
            raise InputError(f"{where}.face.between", f"no face of {name!r} is free", "an element with a free face")
        return free

    def _solid(self, index: int, pressure: float) -> list[PointLoad]:
        """Return the forces of a uniform pressure on the free surface of a solid.

        Pressure on the whole closed surface is in balance. The forces are therefore those of the opposite pressure on
        its interfaces, one at each centroid.
        """
        found: list[PointLoad] = []
        for face in range(len(self.interfaces)):
            for element, sign in ((self.interfaces.a[face], 1.0), (self.interfaces.b[face], -1.0)):
                if element == index:
                    force = sign * pressure * self.interfaces.area[face] * self.interfaces.normal[face]
                    at = self.interfaces.origin[face].tolist()
                    found.append(PointLoad(element=self.elements.ids[index], force=force.tolist(), at=at))
        return found

    def _along(self, entry: FaceLoad, along: list[list[float]], where: str) -> list[PointLoad]:
        """Return the forces of a pressure or line load along a polyline on the free boundary.

        Planar scenes only. entry: supplies the pressures at both ends, between which it is linear. along: points of the
        polyline. where: key in the scene. Supports get no load. Raises InputError for a spatial scene, coinciding
        points, or a part of the polyline that is no free boundary.
        """
        if self.elements.centroid.shape[1] == 3 or any(len(point) != 2 for point in (*along, entry.line or (0, 0))):
            raise InputError(f"{where}.face.along", "it is for planar scenes", '"between" or "patch"')
        points = np.array(along, dtype=float)
        legs = np.linalg.norm(np.diff(points, axis=0), axis=1)
        if not (legs > self._reach).all():
            raise InputError(f"{where}.face.along", "two of its points coincide", "points apart from each other")
        place = np.append(0.0, np.cumsum(legs)) / legs.sum()
        first, last = entry.ends
        found: list[PointLoad] = []
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
                    force = [(high - low) * part for part in entry.line]
                    middle, name = (0.5 * (start + end)).tolist(), self.elements.ids[index]
                    found.append(PointLoad(element=name, force=force, at=middle, width=high - low))
                elif forward:
                    found.append(self._piece(index, start, end, (values[0], values[1])))
                else:
                    found.append(self._piece(index, end, start, (values[1], values[0])))
        return found

    def _on_leg(self, start: Floats, unit: Floats, length: float) -> Iterator[tuple[int, float, float, bool]]:
        """Yield the pieces of free boundary along one leg of a polyline.

        start: (2,) first point of the leg. unit: (2,) direction. length: of the leg. A piece is given by its element,
        its first and last distance along the leg, and True if the edge of the element has the direction of the leg.
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
        """Yield the ends of each edge of a planar element, with its free intervals.

        index: of the element. A free interval is a pair of points in the direction of the edge, covered by no
        interface. Edges shorter than `_reach` are left out.
        """
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

    def _piece(self, index: int, start: Floats, end: Floats, pressures: tuple[float, float]) -> PointLoad:
        """Return the load of a linear pressure on a straight free piece of an outline (planar).

        It is a force at the middle of the piece, and a moment about this point. index: of the element. start, end: in
        the direction of the outline, which is counter-clockwise. pressures: at start and end, positive inwards.
        """
        length = float(np.hypot(*(end - start)))
        inward = np.array([start[1] - end[1], end[0] - start[0]]) / length
        first, last = pressures
        force = 0.5 * (first + last) * length * self.thickness * inward
        moment = (last - first) * length**2 * self.thickness / 12.0
        middle = (0.5 * (start + end)).tolist()
        name = self.elements.ids[index]
        return PointLoad(element=name, force=force.tolist(), at=middle, moment=moment, width=length)
