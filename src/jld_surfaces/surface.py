"""The criterion "surface": its keys (docs/guide/yield_surfaces.md), and the rows and gauges of its parts."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Annotated, Final, Literal, Self

import numpy as np
import shapely
from pydantic import BaseModel, ConfigDict, Field, model_validator

from jld_core import Floats, InputError
from jld_core.mechanics import FaceGeometry, FaceRows, Gauge, enclosing_rows

NonNegative = Annotated[float, Field(ge=0)]
Positive = Annotated[float, Field(gt=0)]
Vector = Annotated[list[float], Field(min_length=2, max_length=3)]
Two = Annotated[list[NonNegative], Field(min_length=2, max_length=2)]
Ring = Annotated[list[Annotated[list[float], Field(min_length=2, max_length=2)]], Field(min_length=3)]


class Part(BaseModel):
    """Base class: immutable, without unknown keys, NaN or infinities."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)


class Point(Part):
    """Resultants over their units; those that are absent are 0."""

    N: float = 0.0
    V: float = 0.0
    V1: float = 0.0
    V2: float = 0.0
    M: float = 0.0
    M1: float = 0.0
    M2: float = 0.0
    MT: float = 0.0


class Row(Point):
    most: Annotated[float, Field(ge=0, description="a number of at least 0: no force is inside a yield surface")]


class Cone(Part):
    """Limit √((b1 V1)² + (b2 V2)²) + k |MT| ≤ c + μN in space, as multiples of the reference strength."""

    shear: Annotated[list[Positive], Field(min_length=2, max_length=2)] | None = None
    torsion: NonNegative = 0.0
    capacity: NonNegative = 0.0
    friction: NonNegative = 0.0
    direction: Vector | None = None


class Friction(Part):
    """Friction and cohesion; in space along a direction, and across it."""

    coefficients: Annotated[NonNegative | Two, Field(description="a number of at least 0, or two in space")]
    cohesion: Annotated[NonNegative | Two, Field(description="a stress of at least 0, or two in space")] = 0.0
    direction: Vector | None = None
    cone: Literal["elliptic", "product"] = "elliptic"
    torsion: Annotated[NonNegative | None, Field(description="the coefficient of friction in torsion")] = None


class Bending(Part):
    """Limits on N and moments of a rectangle or hull: at the edges of the face, or elastic stress in its kern."""

    within: Literal["edges", "kern"] = "edges"
    tensile_strength: NonNegative = 0.0
    compressive_strength: Positive | None = None


class Section(Part):
    """Plastic cross-section of polygons in the unit square of a face, with a tension cut-off."""

    polygons: Annotated[list[Ring], Field(min_length=1, description="a list of polygons in the unit square")]
    holes: list[Ring] = []
    tensile_strength: NonNegative = 0.0
    compressive_strength: Positive | None = None
    shear_strength: NonNegative | None = None
    direction: Vector | None = None
    steps: Annotated[int, Field(ge=2, le=24)] = 6


class HoekBrown(Part):
    """Shear envelope of rock by tangents, in space by one cone."""

    compressive_strength: Positive
    m: Annotated[float, Field(gt=0, le=40)]
    s: Annotated[float, Field(ge=0, le=1)] = 1.0
    points: Annotated[list[Positive], Field(min_length=1, max_length=12)] = [0.02, 0.1, 0.3, 1.0]


class SurfaceKeys(Part):
    """A yield surface: every part that it states holds."""

    reference_strength: Positive = 1.0
    rows: list[Row] = []
    vertices: list[Point] = []
    rays: list[Point] = []
    symmetric: list[Literal["V", "V1", "V2", "M", "M1", "M2", "MT"]] = []
    cones: list[Cone] = []
    friction: Friction | None = None
    bending: Bending | None = None
    section: Section | None = None
    hoek_brown: HoekBrown | None = None

    @model_validator(mode="after")
    def _something(self) -> Self:
        """Check that some limit is stated, and vertices where there are rays."""
        if not self.model_fields_set - {"reference_strength", "symmetric", "rays"}:
            raise InputError(
                "", "it states no limit", '"rows", "vertices", "cones", "friction", "bending" or "section"'
            )
        if self.rays and not self.vertices:
            raise InputError(".rays", "they start at no vertex", '"vertices"')
        return self


_DIRECTIONS = 8  # directions of neutral axes in space

_WIDE = 10.0  # side of a half-plane, unit squares


def shape_of(section: Section) -> shapely.Geometry:
    """Return the cross-section about the middle of its face, which is a unit square."""
    solid, holes = ([shapely.Polygon(ring) for ring in rings] for rings in (section.polygons, section.holes))
    valid = all(part.is_valid for part in (*solid, *holes))
    shape = shapely.union_all(solid).difference(shapely.union_all(holes)) if valid else shapely.Polygon()
    if not shape.area > 0.0:
        raise InputError(".section", "its polygons hold no area", "simple polygons with corners in order")
    if not shapely.box(-1e-9, -1e-9, 1 + 1e-9, 1 + 1e-9).covers(shape):
        raise InputError(".section", "it reaches beyond its face", "corners from 0 to 1")
    return shapely.affinity.translate(shape, -0.5, -0.5)


def resultants(shape: shapely.Geometry, section: Section, dimension: int) -> tuple[Floats, Floats]:
    """Return vertices (p, 2 or 3) and rays of (n, m) or (n, m1, m2): pressure, moments of a unit square, as stress."""
    # Each vertex has one neutral axis, compression on one side of it and tension on the other. Moments are scaled as
    # those of a face: twice stress times arm.
    tension, compression = section.tensile_strength, section.compressive_strength
    total = _moments(shape)
    if compression is None:
        hull = np.array(shape.convex_hull.exterior.coords)[:-1]
        rays = _of(np.column_stack([np.ones(len(hull)), hull]), dimension)
        return _of(-tension * total[None], dimension), rays
    angles = [0.0, np.pi] if dimension == 2 else 2.0 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    points = [-tension * total, compression * total]
    for angle in angles:
        direction = np.array([np.cos(angle), np.sin(angle)])
        heights = np.array(shape.convex_hull.exterior.coords) @ direction
        for height in np.linspace(heights.min(), heights.max(), section.steps + 1)[1:-1]:
            pressed = _moments(shape.intersection(_beyond(direction, height)))
            points.append((compression + tension) * pressed - tension * total)
    return _of(np.array(points), dimension), np.zeros((0, dimension))


def _beyond(direction: Floats, height: float) -> shapely.Geometry:
    """Return the half-plane of points x with x·direction ≥ height."""
    across = np.array([-direction[1], direction[0]])
    start = height * direction
    return shapely.Polygon([start - _WIDE * across, start + _WIDE * across, start + _WIDE * (across + direction),
                            start + _WIDE * (direction - across)])  # fmt: skip


def _moments(shape: shapely.Geometry) -> Floats:
    centre = shape.centroid
    return np.zeros(3) if shape.is_empty else shape.area * np.array([1.0, centre.x, centre.y])


def _of(table: Floats, dimension: int) -> Floats:
    """Return resultants from stress times (area, ∫x, ∫y): a force at (x, y) turns by −x about e2, and y about e1."""
    n, x, y = table.T
    columns: Sequence[Floats] = (n, -2.0 * x) if dimension == 2 else (n, 2.0 * y, -2.0 * x)
    return np.column_stack(columns)


_NAMES: Final = {2: ("N", "V", "M"), 3: ("N", "V1", "V2", "M1", "M2", "MT")}

_MOST: Final = 600_000  # groups of vertices and rays that are tried for facets of a polytope

# Rows C (k, r, q) and constants d (k, r) of C x + d ≥ 0, in stresses.
Limits = tuple[Floats, Floats]


class Surface:
    """Yield surface of parts that all hold: rows, vertices, cones, friction, bending, a section, Hoek–Brown.

    Attributes
    ----------
    label : str
        "either": for inner and for dry faces.
    parameters : type
        Keys that a scene states.
    """

    label: Literal["dry", "inner", "either"] = "either"
    parameters = SurfaceKeys

    def rows(self, faces: FaceGeometry, values: SurfaceKeys) -> FaceRows:
        """Return the yield set of faces, see `jld_core.mechanics.FaceRows`.

        Parameters
        ----------
        faces : FaceGeometry
            Faces.
        values : SurfaceKeys
            What a scene states.

        Returns
        -------
        FaceRows
            Rows and gauges.

        Raises
        ------
        InputError
            A part does not suit the dimension, or zero is outside.
        """
        parts = _Parts(faces, values)
        limits = list(parts.limits())
        table = np.concatenate([rows for rows, _ in limits], axis=1)
        if faces.dimension == 3 and not table[:, :, [1, 2, 5]].any():
            table = table[:, :, [0, 3, 4]]
        return FaceRows(table, np.concatenate([sides for _, sides in limits], axis=1), tuple(parts.gauges))


class _Parts:
    """Limits of one surface on some faces, collected part by part; `gauges` fills as `limits` is read."""

    def __init__(self, faces: FaceGeometry, keys: SurfaceKeys) -> None:
        self.faces, self.keys = faces, keys
        self.names, self.gauges = _NAMES[faces.dimension], list[Gauge]()

    def limits(self) -> Iterator[Limits]:
        """Yield rows (k, r, q) and sides (k, r); other parts add gauges or cones."""
        keys, strength = self.keys, self.keys.reference_strength
        yield self._same(np.zeros((1, len(self.names))), np.zeros(1))
        if keys.rows:
            table = self._points(keys.rows, "rows")
            sides = np.repeat([strength * row.most for row in keys.rows], len(table) // len(keys.rows))
            yield self._same(-table, sides)
        if keys.vertices:
            yield self._polytope(*(self._points(getattr(keys, name), name) for name in ("vertices", "rays")))
        for number, cone in enumerate(keys.cones):
            self._cone(cone, f"cones[{number}]")
        if keys.friction is not None:
            yield from self._friction(keys.friction)
        if keys.bending is not None:
            bending = keys.bending
            yield from self._bending(bending.within, bending.tensile_strength, bending.compressive_strength)
        if keys.section is not None:
            yield from self._section()
        if keys.hoek_brown is not None:
            yield from self._hoek_brown(keys.hoek_brown)

    def _same(self, rows: Floats, sides: Floats) -> Limits:
        count = len(self.faces)
        return np.broadcast_to(rows, (count, *rows.shape)), np.broadcast_to(sides, (count, len(sides)))

    def _points(self, entries: Sequence[Point], part: str) -> Floats:
        """Return resultants (p, q) of entries, each followed by those with the other signs of `symmetric`."""
        allowed = {*self.names, "most"}
        for number, point in enumerate(entries):
            unknown = next((name for name in sorted(point.model_fields_set) if name not in allowed), None)
            if unknown is not None:
                names = ", ".join(self.names)
                raise InputError(f".{part}[{number}].{unknown}", f"a {self.faces.dimension}D scene has none", names)
        unknown = next((name for name in self.keys.symmetric if name not in self.names), None)
        if unknown is not None:
            raise InputError(
                ".symmetric", f"a {self.faces.dimension}D scene has no {unknown}", ", ".join(self.names[1:])
            )
        table = np.array([[getattr(entry, name) for name in self.names] for entry in entries]).reshape(
            -1, len(self.names)
        )
        for name in dict.fromkeys(self.keys.symmetric):
            mirrored = np.repeat(table, 2, axis=0)
            mirrored[1::2, self.names.index(name)] *= -1.0
            table = mirrored
        return table

    def _polytope(self, vertices: Floats, rays: Floats) -> Limits:
        """Return the rows of vertices (p, q) and rays, multiples of the reference strength, in what they name."""
        used = np.any(vertices != 0.0, axis=0) | np.any(rays != 0.0, axis=0)
        count = len(vertices) + len(rays)
        if math.comb(count, int(used.sum())) > _MOST:
            raise InputError(".vertices", f"{count} with mirror images, of {used.sum()} resultants", "fewer, or rows")
        spread = np.vstack([vertices[1:] - vertices[0], rays])[:, used]
        if np.linalg.matrix_rank(spread) < used.sum():
            raise InputError(".vertices", "they are flat in the resultants that they name", "a solid")
        strength = self.keys.reference_strength
        rows, sides = enclosing_rows(vertices[:, used] * strength, rays[:, used])
        table = np.zeros((len(rows), len(self.names)))
        table[:, used] = rows
        return self._same(table, self._inside(sides, "vertices"))

    def _inside(self, sides: Floats, part: str) -> Floats:
        """Return the constants of rows; raise InputError where zero is outside."""
        if sides.min(initial=0.0) < -1e-12 * abs(sides).max(initial=0.0):
            raise InputError(f".{part}", "no force at all lies outside of it", "zero inside the yield surface")
        return np.maximum(sides, 0.0)

    def _along(self, direction: list[float] | None, part: str) -> Floats:
        """Return the unit vectors (k, 2) of a direction in the axes of each face; None: along e1."""
        if self.faces.dimension == 2:
            raise InputError(f".{part}", "it is for spatial scenes", '"rows", or one number of "friction"')
        if direction is None:
            return np.tile([1.0, 0.0], (len(self.faces), 1))
        if len(direction) != 3 or not any(direction):
            raise InputError(f".{part}.direction", "it is no direction", "three numbers, not all 0")
        vector = np.array(direction) / np.linalg.norm(direction)
        along = np.column_stack([self.faces.e1 @ vector, self.faces.e2 @ vector])
        size = np.linalg.norm(along, axis=1)
        if size.min(initial=1.0) < 1e-6:
            raise InputError(f".{part}.direction", "it stands across a face", "a direction along the faces")
        return np.asarray(along / size[:, None])

    def _signs(self, direction: list[float]) -> Floats:
        """Return whether e1 (k,) of planar faces runs along a direction, 1, or against it, −1."""
        if len(direction) != 2:
            raise InputError(".section.direction", f"it has {len(direction)} numbers", "2 in this scene")
        along = self.faces.e1 @ np.array(direction)
        if not any(direction) or abs(along).min(initial=1.0) < 1e-6 * math.hypot(*direction):
            raise InputError(".section.direction", "it stands across a face", "a direction along the faces")
        return np.asarray(np.sign(along))

    def _cone(self, cone: Cone, part: str) -> None:
        along = self._along(cone.direction, part)
        shear = None if cone.shear is None else _shear_matrix(along, np.array(cone.shear))
        capacity = cone.capacity * self.keys.reference_strength
        self.gauges.append(Gauge(shear, cone.torsion, capacity, cone.friction))

    def _friction(self, friction: Friction) -> Iterator[Limits]:
        """Yield rows of friction; an elliptic cone adds a gauge instead."""
        pairs = [
            value if isinstance(value, list) else [value] * 2 for value in (friction.coefficients, friction.cohesion)
        ]
        (first, second), (cohesion_along, cohesion_across) = pairs
        isotropic = first == second and cohesion_along == cohesion_across
        if self.faces.dimension == 2:
            if not isotropic or friction.direction is not None or friction.torsion is not None:
                raise InputError(".friction", "a planar joint slides one way", "one coefficient, and one cohesion")
            yield self._same(
                np.array([[first, 1.0, 0.0], [first, -1.0, 0.0]]), np.array([cohesion_along, cohesion_along])
            )
            return
        along = self._along(friction.direction, "friction")
        turning = min(first, second) if friction.torsion is None else friction.torsion
        if friction.cone == "product":
            across = along @ np.array([[0.0, 1.0], [-1.0, 0.0]])
            table = np.zeros((len(along), 6, 6))
            for position, (direction, mu) in enumerate(((along, first), (across, second))):
                table[:, 2 * position : 2 * position + 2, 0] = mu
                table[:, 2 * position, 1:3], table[:, 2 * position + 1, 1:3] = direction, -direction
            table[:, 4:, 0], table[:, 4, 5], table[:, 5, 5] = turning, 1.0, -1.0
            # two rows each of sliding along, sliding across and torsion
            sides = np.repeat([cohesion_along, cohesion_across, min(cohesion_along, cohesion_across)], 2)
            yield table, np.broadcast_to(sides, (len(along), 6))
            return
        if not isotropic and (
            first == 0.0 or second == 0.0 or not np.isclose(cohesion_along * second, cohesion_across * first, rtol=1e-9)
        ):
            problem = "an elliptic cone has one apex, the same c/μ along and across"
            raise InputError(".friction", problem, 'such cohesion, or "cone": "product"')
        if turning == 0.0 and first > 0.0:
            raise InputError(".friction.torsion", "nothing resists torsion", "a coefficient above 0")
        ratio = first / second if second else 1.0
        self.gauges.append(
            Gauge(
                _shear_matrix(along, np.array([1.0, ratio])), first / turning if turning else 1.0, cohesion_along, first
            )
        )

    def _bending(self, within: str, tension: float, compression: float | None) -> Iterator[Limits]:
        """Yield the rows of N and moments at edges or in the kern."""
        edge_rows = self.faces.bending(self.faces.edges if within == "edges" else self.faces.kern)
        rows = edge_rows if self.faces.dimension == 2 else np.zeros((*edge_rows.shape[:2], 6))
        if self.faces.dimension == 3:
            rows[:, :, [0, 3, 4]] = edge_rows
        stands = np.any(edge_rows != 0.0, axis=2)
        yield rows, np.where(stands, tension, 0.0)
        if compression is not None:
            yield -rows, np.where(stands, compression, 0.0)

    def _section(self) -> Iterator[Limits]:
        """Yield the rows of a cross-section; its shear strength acts on its area."""
        section, faces = self.keys.section, self.faces
        assert section is not None
        shape = shape_of(section)
        vertices, rays = resultants(shape, section, faces.dimension)
        rows, sides = enclosing_rows(vertices, rays)
        sides = self._inside(sides, "section")
        table = np.zeros((len(faces), len(rows), len(self.names)))
        if faces.dimension == 2:
            table[:, :, [0, 2]] = rows
            if section.direction is not None:
                table[:, :, 2] *= self._signs(section.direction)[:, None]
        else:
            turn = self._along(section.direction, "section")
            if abs(abs(turn).max(axis=1, initial=1.0) - 1.0).max(initial=0.0) > 1e-6:
                raise InputError(".section.direction", "it runs along no edge of a face", "a direction along edges")
            # m1 and m2 about the axes of the section are those of the face, exchanged where it is turned
            table[:, :, 0] = rows[:, 0]
            table[:, :, 3] = turn[:, :1] * rows[:, 1] - turn[:, 1:] * rows[:, 2]
            table[:, :, 4] = turn[:, 1:] * rows[:, 1] + turn[:, :1] * rows[:, 2]
        yield table, np.broadcast_to(sides, table.shape[:2])
        if section.shear_strength is not None:
            force = section.shear_strength * shape.area
            if faces.dimension == 3:
                self.gauges.append(Gauge(np.eye(2), 1.0, force))
            else:
                yield self._same(np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]]), np.array([force, force]))

    def _hoek_brown(self, rock: HoekBrown) -> Iterator[Limits]:
        """Yield tangents of τ(n) = ½ √(m σc (n + σt)), σt = s σc/m, and bending by elastic stress unless stated."""
        if self.faces.dimension == 3 and len(rock.points) > 1:
            raise InputError(".hoek_brown.points", f"in space one cone touches it, not {len(rock.points)}", "one point")
        strength, tension = rock.compressive_strength, rock.s * rock.compressive_strength / rock.m
        over = np.array(rock.points) * strength
        height = 0.5 * np.sqrt(rock.m * strength * over)
        slope = 0.5 * height / over
        sides = height + slope * (tension - over)
        if self.faces.dimension == 3:
            self.gauges.append(Gauge(np.eye(2), 1.0, float(sides[0]), float(slope[0])))
        else:
            rows = np.array([[k, sign, 0.0] for k in slope for sign in (-1.0, 1.0)])
            yield self._same(rows, np.repeat(sides, 2))
        if self.keys.bending is None and self.keys.section is None:
            yield from self._bending("kern", tension, None)


def _shear_matrix(along: Floats, factors: Floats) -> Floats:
    """Return B (k, 2, 2) whose rows are factors times a direction (k, 2) and the one across it."""
    across = along @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    return np.stack([factors[0] * along, factors[1] * across], axis=1)
