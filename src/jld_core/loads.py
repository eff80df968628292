"""Loads as they act: forces per volume, tractions on parts of faces, and forces at points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol, Self

import numpy as np

from jld_core.arrays import Bools, Floats, Ints
from jld_core.linalg.factors import without_rounding


class Bodies(Protocol):
    """Centroids and supports of n elements, on which resultants of loads depend."""

    @property
    def centroid(self) -> Floats:
        """(n, d)."""

    @property
    def support(self) -> Bools:
        """(n,) True for supports."""


@dataclass(frozen=True)
class Traction:
    """Linear traction on a plane part of the surface of an element, scene units."""

    element: int  # index
    rings: tuple[Floats, ...]  # closed outlines (k, d) of the part, the outer one first; planar: its two ends (2, 2)
    origin: Floats  # (d,) centroid of the part
    mean: Floats  # (d,) force per area there, planar per length over the whole thickness
    slope: Floats  # (d, d) derivatives of this force; column k by coordinate k

    def at(self, places: Floats) -> Floats:
        """Return the force per area (..., d), planar per length, at places (..., d)."""
        return np.asarray(self.mean + (places - self.origin) @ self.slope.T)

    def resultant(self) -> tuple[Floats, Floats]:
        """Return the force (d,) and the moment (1,) or (3,) about the origin."""
        size, second = _moments(self.rings, self.origin)
        # x × (slope x), summed over the part, from the second moments of x
        moments = second @ self.slope.T
        if len(self.origin) == 2:
            return size * self.mean, np.array([moments[0, 1] - moments[1, 0]])
        axes = ((1, 2), (2, 0), (0, 1))
        return size * self.mean, np.array([moments[i, j] - moments[j, i] for i, j in axes])


@dataclass(frozen=True)
class PointForces:
    """Arrays over p forces at points, scene units."""

    element: Ints  # (p,) indices
    # at, force: (p, d)
    at: Floats
    force: Floats
    width: Floats  # (p,) length of the patch on a free face that each is spread on, NaN where none is stated
    centred: Bools  # (p,) True where the point is the centroid of the element, and moves with it

    def __len__(self) -> int:
        return len(self.element)


@dataclass(frozen=True)
class Loads:
    """Loads of one kind, dead or live, on n elements, scene units.

    Parameters
    ----------
    body : (n, d) array
        Forces that are uniform over the volume of each element: self-weight and body loads.
    couples : (n, 1) or (n, 3) array
        Moments that act on elements without a place.
    points : PointForces
        Forces at points.
    tractions : tuple of Traction
        Pressures, line loads and loads on patches.
    """

    body: Floats
    couples: Floats
    points: PointForces
    tractions: tuple[Traction, ...] = ()

    @classmethod
    def of_resultants(cls, resultants: Floats) -> Self:
        """Return uniform forces and couples of given resultants (n, 3) or (n, 6)."""
        d = 2 if resultants.shape[1] == 3 else 3
        return cls(resultants[:, :d], resultants[:, d:], points_of([], d))

    def __add__(self, other: Loads) -> Loads:
        joined = [
            np.concatenate([first, second])
            for first, second in zip(vars(self.points).values(), vars(other.points).values(), strict=True)
        ]
        points = PointForces(*joined)
        tractions = self.tractions + other.tractions
        return Loads(self.body + other.body, self.couples + other.couples, points, tractions)

    def __rmul__(self, factor: float) -> Loads:
        return self.weighted(np.full(len(self.body), factor))

    def weighted(self, factors: Floats) -> Loads:
        by_element, by_point = factors[:, None], factors[self.points.element][:, None]
        return Loads(
            by_element * self.body,
            by_element * self.couples,
            replace(self.points, force=by_point * self.points.force),
            tuple(
                replace(
                    traction,
                    mean=factors[traction.element] * traction.mean,
                    slope=factors[traction.element] * traction.slope,
                )
                for traction in self.tractions
            ),
        )

    def __bool__(self) -> bool:
        return bool(
            self.body.any()
            or self.couples.any()
            or self.points.force.any()
            or any(traction.mean.any() or traction.slope.any() for traction in self.tractions)
        )

    def take(self, rows: Ints) -> Loads:
        new_index = np.full(len(self.body), -1, dtype=np.int64)
        new_index[rows] = np.arange(len(rows))
        points_kept = np.flatnonzero(new_index[self.points.element] >= 0)
        points = PointForces(*(values[points_kept] for values in vars(self.points).values()))
        return Loads(
            self.body[rows],
            self.couples[rows],
            replace(points, element=new_index[points.element]),
            tuple(
                replace(traction, element=int(new_index[traction.element]))
                for traction in self.tractions
                if new_index[traction.element] >= 0
            ),
        )

    def padded(self) -> Loads:
        """Return the same loads with one more element, which has none."""
        padded = [np.vstack([values, np.zeros(values.shape[1])]) for values in (self.body, self.couples)]
        return replace(self, body=padded[0], couples=padded[1])

    def stretched(self, factor: float) -> Loads:
        """Return the same forces with all lengths multiplied by a factor."""
        d = self.body.shape[1]
        tractions = tuple(
            Traction(
                traction.element,
                tuple(factor * ring for ring in traction.rings),
                factor * traction.origin,
                traction.mean / factor ** (d - 1),
                traction.slope / factor**d,
            )
            for traction in self.tractions
        )
        points = replace(self.points, at=factor * self.points.at, width=factor * self.points.width)
        return Loads(self.body, factor * self.couples, points, tractions)

    @property
    def at_centroids(self) -> Floats:
        """Return the forces (n, d) that act at centroids and move with them, with body forces."""
        total, at_centroid = self.body.copy(), self.points.centred
        np.add.at(total, self.points.element[at_centroid], self.points.force[at_centroid])
        return total

    def arrows(self) -> list[tuple[int, Floats, Floats]]:
        """Return element, place (d,) and force (d,) of each force at a point or of a traction, without zeros."""
        arrows = [
            (int(k), at, force)
            for k, at, force in zip(self.points.element, self.points.at, self.points.force, strict=True)
        ]
        arrows += [(traction.element, traction.origin, traction.resultant()[0]) for traction in self.tractions]
        return [arrow for arrow in arrows if arrow[2].any()]


def points_of(entries: Sequence[tuple[int, Floats, Floats, float | None, bool]], dimension: int) -> PointForces:
    """Return forces given by element, place, force, width or None, and whether the place is the centroid."""
    return PointForces(
        element=np.array([entry[0] for entry in entries], dtype=np.int64),
        at=np.array([entry[1] for entry in entries], dtype=float).reshape(-1, dimension),
        force=np.array([entry[2] for entry in entries], dtype=float).reshape(-1, dimension),
        width=np.array([np.nan if entry[3] is None else entry[3] for entry in entries], dtype=float),
        centred=np.array([entry[4] for entry in entries], dtype=bool),
    )


def edge_traction(element: int, ends: Floats, values: Floats) -> Traction:
    """Return the traction that is linear between two ends (2, 2), from its values (2, 2) there, force per length."""
    edge = ends[1] - ends[0]
    slope = np.outer(values[1] - values[0], edge) / (edge @ edge)
    return Traction(element, (ends,), ends.mean(axis=0), values.mean(axis=0), slope)


def resultants(loads: Loads, elements: Bodies) -> Floats:
    """Sum loads to forces and moments about the centroids of elements.

    Parameters
    ----------
    loads : Loads
        Loads on n elements.
    elements : Elements
        The elements.

    Returns
    -------
    (n, 3) or (n, 6) float array
        Forces and moments, planar or spatial.
    """
    # The moment of a force at p is (p − c) × f about centroid c. Supports have none. Sums within rounding of zero
    # become exactly zero.
    d = loads.body.shape[1]
    points, of_tractions = loads.points, [traction.resultant() for traction in loads.tractions]
    element = np.concatenate(
        [points.element, np.array([traction.element for traction in loads.tractions], dtype=np.int64)]
    )
    place = np.concatenate([points.at, np.array([traction.origin for traction in loads.tractions]).reshape(-1, d)])
    force = np.concatenate([points.force, np.array([force for force, _ in of_tractions]).reshape(-1, d)])
    couples = np.zeros((len(element), loads.couples.shape[1]))
    for k, (_, moment) in enumerate(of_tractions, len(points)):
        couples[k] = moment
    arm = place - elements.centroid[element]
    cross = np.cross(arm, force) if d == 3 else (arm[:, 0] * force[:, 1] - arm[:, 1] * force[:, 0])[:, None]
    total = np.concatenate([loads.body, loads.couples], axis=1)
    size = np.linalg.norm(force, axis=1)[:, None]
    # components of forces may cancel within a moment, whose rounding is that of arm times force
    magnitudes, moment_magnitudes = np.abs(total), np.linalg.norm(arm, axis=1)[:, None] * size + np.abs(couples)
    np.add.at(total, element, np.concatenate([force, cross + couples], axis=1))
    np.add.at(magnitudes, element, np.concatenate([np.repeat(size, d, axis=1), moment_magnitudes], axis=1))
    total = without_rounding(total, magnitudes)
    total[elements.support] = 0.0
    return total


def _moments(rings: tuple[Floats, ...], origin: Floats) -> tuple[float, Floats]:
    """Return the size of a plane part, and ∫ x xᵀ (d, d) of places x from a point of its plane."""
    if len(origin) == 2:
        edge = rings[0][1] - rings[0][0]
        length = float(np.hypot(*edge))
        return length, np.outer(edge, edge) * (length / 12.0)
    size, second, normal = 0.0, np.zeros((3, 3)), np.zeros(3)
    for k, ring in enumerate(rings):
        corner = ring - origin
        following = np.roll(corner, -1, axis=0)
        cross = np.cross(corner, following)
        vector = cross.sum(axis=0)
        if k == 0:
            normal = vector / np.linalg.norm(vector)
        # triangles from the point to each side, with the sign of their turn; holes count against the outer ring
        area = (0.5 if k == 0 else -0.5 * np.sign(vector @ normal)) * (cross @ normal)
        size += float(area.sum())
        for point in (corner, following, corner + following):
            second += np.einsum("k,ki,kj->ij", area, point, point) / 12.0
    return size, second
