"""Yield sets stated as rows, one class for plane and space: what every route needs follows from rows and gauges.

x are the three resultants of the core of a face, (N, V, m) in the plane and (N, m1, m2) in space, scaled. The set is
C x + d ≥ 0, and in space also |B (V1, V2)| + k|mT| ≤ c + μN, or one such limit for shear and one for torsion. The
dissipation of a jump is its greatest work over the vertices of the core, after its opening has lost μ g°(s, ω), where
g° is the dual of the gauge. It is finite where no ray of the core works, docs/method.md (2.19), (2.20).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property, lru_cache
from itertools import combinations
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.errors import InputError
from jld_core.mechanics.bending import Bending, InnerBending, bending_of
from jld_core.mechanics.criteria import FaceRows, Gauge, geometry_of, rows_of
from jld_core.mechanics.scaling import Scaling
from jld_core.mechanics.yield_set import CoulombWedge, FrictionSet, Hull, ParabolicBending, RowPattern, Rows, used
from jld_core.strengths import CRITERIA, STANDARD, Route, StatedCriterion, Strengths

# Violation of a row, relative to its terms, above which a point of intersection is no vertex in floats
_NEAR: Final = 1e-6

# Determinant of unit rows below which their point of intersection is found in exact arithmetic alone
_FLAT: Final = 1e-9

_SAME: Final = 1e-9  # distance below which two unit normals of facets are one

# Distance of a vertex beyond a row, relative to all, below which the row is a facet; rows are moved out then
_INSIDE: Final = 1e-11

Vector = tuple[Fraction, ...]


def corners(rows: Floats, constants: Floats) -> tuple[Floats, Floats]:
    """Return the vertices (p, 3) and extreme rays (q, 3) of {x : C x + d ≥ 0}, C (r, 3) and d (r,).

    Both are exact for the numbers given, then rounded. A ray has N = 1 where its N is positive, else size 1. Rows of
    zeros are ignored. The set must hold no line.
    """
    used = np.any(rows != 0.0, axis=1)
    return _corners(rows[used].tobytes(), constants[used].tobytes())


@lru_cache(maxsize=4096)
def _corners(rows: bytes, constants: bytes) -> tuple[Floats, Floats]:
    """Return vertices and rays, as `corners`, of numbers given as bytes."""
    c, d = np.frombuffer(rows).reshape(-1, 3), np.frombuffer(constants)
    exact = [[Fraction(x) for x in row] for row in c.tolist()]
    sides = [Fraction(x) for x in d.tolist()]
    points: dict[Vector, None] = {}
    for i, j, k in _candidates(c, d):
        cross = _cross(exact[j], exact[k])
        size = _dot(exact[i], cross)
        if size == 0:
            continue
        # Cramer's rule with C x = −d in the three rows
        parts = (sides[i], cross), (sides[j], _cross(exact[k], exact[i])), (sides[k], _cross(exact[i], exact[j]))
        point = tuple(-sum(side * way[axis] for side, way in parts) / size for axis in range(3))
        if all(_dot(row, point) + side >= 0 for row, side in zip(exact, sides, strict=True)):
            points[point] = None
    ways: dict[Vector, None] = {}
    for i, j in combinations(range(len(exact)), 2):
        along = _cross(exact[i], exact[j])
        if not any(along):
            continue
        products = [_dot(row, along) for row in exact]
        for sign in (1, -1):
            if all(sign * product >= 0 for product in products):
                size = along[0] * sign if along[0] * sign > 0 else max(abs(part) for part in along)
                ways[tuple(sign * part / size for part in along)] = None
    found = [np.array([[float(x) for x in point] for point in many]).reshape(-1, 3) for many in (points, ways)]
    return found[0], found[1]


def _candidates(rows: Floats, constants: Floats) -> list[list[int]]:
    """Return the triples of rows that may meet in a vertex: those whose point violates no row by far in floats."""
    threes = np.array(list(combinations(range(len(rows)), 3)), dtype=np.int64).reshape(-1, 3)
    size = np.linalg.norm(rows, axis=1)
    unit, side = rows / size[:, None], constants / size
    systems = unit[threes]
    flat = abs(np.linalg.det(systems)) < _FLAT
    systems[flat] = np.eye(3)
    points = -np.linalg.solve(systems, side[threes][..., None])[..., 0]
    least = (points @ unit.T + side).min(axis=1, initial=np.inf)
    reach = 1.0 + abs(points).max(axis=1, initial=0.0) + abs(side).max(initial=0.0)
    return [list(map(int, three)) for three in threes[flat | (least > -_NEAR * reach)]]


def _cross(a: list[Fraction], b: list[Fraction]) -> list[Fraction]:
    """Return the cross product of two vectors."""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def _dot(a: list[Fraction], b: list[Fraction] | Vector) -> Fraction:
    """Return the scalar product of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def enclosing_rows(vertices: Floats, rays: Floats) -> tuple[Floats, Floats]:
    """Return rows C x + d ≥ 0 of the closed hull of vertices (p, k) and rays (q, k), k = 2 or 3."""
    # C is (r, k) with largest entry 1. Every vertex and ray satisfies the rows up to rounding.
    k = vertices.shape[1]
    reach = float(abs(vertices).max(initial=0.0)) or 1.0
    sizes = np.linalg.norm(rays, axis=1, keepdims=True)
    generators = np.unique(
        np.vstack([
            np.column_stack([vertices / reach, np.ones(len(vertices))]),
            np.column_stack([rays / np.where(sizes > 0.0, sizes, 1.0), np.zeros(len(rays))]),
        ]),
        axis=0,
    )  # fmt: skip
    generators = np.vstack([generators, np.append(np.zeros(k), 1.0)]) if len(generators) < k else generators
    groups = generators[np.array(list(combinations(range(len(generators)), k)), dtype=np.int64).reshape(-1, k)]
    normals = _normals(groups)
    size = np.linalg.norm(normals[:, :k], axis=1)
    normals = normals[size > _SAME] / size[size > _SAME, None]
    normals = np.vstack([normals, -normals])
    normals = normals[(normals @ generators.T).min(axis=1, initial=np.inf) > -_INSIDE]
    normals = normals[_firsts(normals)]
    rows = normals[:, :k] / abs(normals[:, :k]).max(axis=1, keepdims=True)
    rows[abs(rows) < 1e-14] = 0.0
    return rows, -(rows @ vertices.T).min(axis=1)


def _normals(groups: Floats) -> Floats:
    """Return the vector (g, k + 1) orthogonal to each group (g, k, k + 1) of vectors."""
    k = groups.shape[1]
    columns = [np.delete(groups, axis, axis=2) for axis in range(k + 1)]
    return np.column_stack([(-1.0) ** axis * np.linalg.det(part) for axis, part in enumerate(columns)])


def _firsts(normals: Floats) -> Bools:
    """Return a mask of the rows that are equal to no earlier one."""
    near = abs(normals[:, None] - normals[None]).max(axis=2, initial=0.0) < 10.0 * _SAME
    return np.asarray(~np.any(np.tril(near, -1), axis=1))


_ROUTE: Final = Route("yield sets stated as rows", STANDARD - {"dry crushing"} | CRITERIA)

_ROUNDED: Final = 1e-12  # share of a strength by which N may pass the apex of friction in rounding

_TOUCHES: Final = 1e-12  # distance of a vertex from a row, relative to strengths, below which the row touches it


@dataclass(frozen=True)
class LabelRows:
    """Yield sets of m faces under one label, stated as rows, in stresses or scaled."""

    C: Floats  # (m, r, 3) rows of the core, C x + d ≥ 0; zeros are idle
    d: Floats  # (m, r) constants of these rows
    B: Floats  # (m, 2, 2) matrix of the gauge of shear |B V|
    # k, c, mu: (m, 2) factor of the torsion, cohesion and friction of the gauge of shear, then of the one of torsion
    k: Floats
    c: Floats
    mu: Floats
    coupled: Bools  # (m,) True where one gauge limits both; its numbers stand twice
    # vertices, rays: (m, p, 3) of the core, filled up with the first vertex, and with zeros
    vertices: Floats
    rays: Floats
    kind: Ints  # (m,) class of the core of each face: faces of one class have the same rows of stresses

    def scaled(self, unit: Floats) -> LabelRows:
        """Return the sets of resultants from those of stresses; unit: (m,) area over the force scale."""
        return replace(
            self,
            d=self.d * unit[:, None],
            c=self.c * unit[:, None],
            vertices=self.vertices * unit[:, None, None],
        )

    @cached_property
    def idle(self) -> Bools:
        """Return a mask (m, r) of rows that limit no resultant that may be non-zero."""
        return np.asarray(~np.any((self.C != 0.0) & self.acts[:, None, :], axis=2))

    @cached_property
    def acts(self) -> Bools:
        """Return a mask (m, 3) of the core resultants that may be non-zero."""
        return np.asarray(np.any(self.vertices != 0.0, axis=1) | np.any(self.rays != 0.0, axis=1))

    @cached_property
    def grows(self) -> Bools:
        """Return a mask (m, 3) of the core resultants that may be non-zero in the recession cone."""
        return np.asarray(np.any(self.rays != 0.0, axis=1))

    @cached_property
    def endless(self) -> Bools:
        """Return a mask (m,) of faces that can be loaded without limit in some direction."""
        return np.asarray(np.any(self.rays != 0.0, axis=(1, 2)))

    @cached_property
    def held(self) -> Bools:
        """Return a mask (m, 2) of faces that resist shear, and torsion."""
        return np.asarray(self.c + self.mu > 0.0)

    @cached_property
    def inverse(self) -> Floats:
        """Return the matrices B⁻ᵀ (m, 2, 2) of the dual gauge of shear."""
        return np.swapaxes(np.linalg.inv(self.B), 1, 2)


def _either(labels: Bits, dry: Floats, inner: Floats) -> Floats:
    """Return the numbers (m, ...) of the label of each face."""
    return np.where(labels.reshape(-1, *([1] * (dry.ndim - 1))), dry, inner)


@dataclass(frozen=True, eq=False)
class RowYield:
    """Yield sets of m faces of either dimension, stated as rows; the interface is that of `YieldSet`."""

    dimension: int  # 2 or 3
    # dry, inner, enclosing: scaled sets of either label, and sets that enclose both, with as many rows each
    dry: LabelRows
    inner: LabelRows
    enclosing: LabelRows
    criteria: tuple[StatedCriterion, ...] = ()  # criteria of plug-ins among them, for messages

    @property
    def _core(self) -> list[int]:
        """Return the places of the core resultants among all of a face."""
        return [0, 1, 2] if self.dimension == 2 else [0, 3, 4]

    @property
    def _freedoms(self) -> int:
        return 3 if self.dimension == 2 else 6

    def _of(self, labels: Bits, name: str) -> Floats:
        """Return an array of `LabelRows` by its name, for the label of each face."""
        return _either(labels, getattr(self.dry, name), getattr(self.inner, name))

    def _full(self, labels: Bits, core: str, shear: Bools) -> Bools:
        """Return a mask (m, q) from one of core resultants, and from masks (m, 2) of shear and torsion."""
        mask = np.ones((len(labels), self._freedoms), dtype=bool)
        mask[:, self._core] = self._of(labels, core)
        if self.dimension == 3:
            mask[:, 1:3], mask[:, 5] = shear[:, :1], shear[:, 1]
        return mask

    def active(self, labels: Bits) -> Bools:
        """Return the mask (m, q) of resultants that may be non-zero."""
        return self._full(labels, "acts", self._of(labels, "held") != 0.0)

    def recession_active(self, labels: Bits) -> Bools:
        """Return the mask (m, q) of resultants in recession cones."""
        grows = (self._of(labels, "mu") > 0.0) & (self._of(labels, "endless") != 0.0)[:, None]
        return self._full(labels, "grows", grows)

    def _demands(self, forces: Floats, labels: Bits) -> Floats:
        """Return the values (m, 2) of the gauges of shear and of torsion; a coupled gauge stands twice."""
        shear = np.linalg.norm(np.einsum("mij,mj->mi", self._of(labels, "B"), forces[:, 1:3]), axis=1)
        k, coupled = self._of(labels, "k"), self._of(labels, "coupled") != 0.0
        torsion = k[:, 1] * abs(forces[:, 5])
        both = shear + torsion
        return np.column_stack([np.where(coupled, both, shear), np.where(coupled, both, torsion)])

    def slack(self, forces: Floats, labels: Bits) -> Floats:
        """Return the slack (m,) of scaled forces (m, q)."""
        d, idle = self._of(labels, "d"), self._of(labels, "idle") != 0.0
        rows = np.einsum("mrj,mj->mr", self._of(labels, "C"), forces[:, self._core]) + d
        slack = np.where(idle, np.inf, rows).min(axis=1)
        if self.dimension == 2:
            return np.asarray(slack)
        c, mu = self._of(labels, "c"), self._of(labels, "mu")
        spare = c + mu * forces[:, :1] - self._demands(forces, labels)
        return np.asarray(np.minimum(slack, np.where(c + mu > 0.0, spare, np.inf).min(axis=1)))

    def recession_slack(self, forces: Floats, labels: Bits) -> Floats:
        """Return the slack (m,) of scaled forces (m, q) in recession cones."""
        c = self._of(labels, "C")
        grows = self._of(labels, "grows") != 0.0
        limits = np.any((c != 0.0) & grows[:, None, :], axis=2)
        slack = np.where(limits, np.einsum("mrj,mj->mr", c, forces[:, self._core]), np.inf).min(axis=1)
        if self.dimension == 3:
            mu = self._of(labels, "mu")
            spare = mu * forces[:, :1] - self._demands(forces, labels)
            slack = np.minimum(slack, np.where(mu > 0.0, spare, np.inf).min(axis=1))
        return np.where(self._of(labels, "endless") != 0.0, slack, np.inf)

    def _reduced(self, jumps: Floats, labels: Bits) -> tuple[Floats, Floats | float]:
        """Return the jumps (..., m, 3) of the core, less dilation, and the work of the cohesion of shear (..., m)."""
        core = jumps[..., self._core]
        if self.dimension == 2:
            return core, 0.0
        slip = np.linalg.norm(np.einsum("mij,...mj->...mi", self._of(labels, "inverse"), jumps[..., 1:3]), axis=-1)
        c, mu, coupled = self._of(labels, "c"), self._of(labels, "mu"), self._of(labels, "coupled") != 0.0
        spin = abs(jumps[..., 5]) / self._of(labels, "k")[:, 1]
        # A coupled gauge is dual to the larger of slip and spin; two gauges add.
        first, second = np.where(coupled, np.maximum(slip, spin), slip), np.where(coupled, 0.0, spin)
        core = core.copy()
        core[..., 0] -= mu[:, 0] * first + mu[:, 1] * second
        return core, c[:, 0] * first + c[:, 1] * second

    def dissipation(self, jumps: Floats, labels: Bits) -> Floats:
        """Return the dissipation of scaled jumps (m, q) or (k, m, q)."""
        core, held = self._reduced(jumps, labels)
        work = -np.einsum("mpj,...mj->...mp", self._of(labels, "vertices"), core)
        return np.asarray(work.max(axis=-1) + held)

    def margin(self, jumps: Floats, labels: Bits) -> Floats:
        """Return the margin of scaled jumps (m, q) or (k, m, q)."""
        core, _ = self._reduced(jumps, labels)
        rays = self._of(labels, "rays")
        if not rays.shape[1]:
            return np.full(core.shape[:-1], np.inf)
        spare = np.einsum("mpj,...mj->...mp", rays, core)
        return np.asarray(np.where(np.any(rays != 0.0, axis=2), spare, np.inf).min(axis=-1))

    def strength(self, labels: Bits) -> Floats:
        """Return the largest dissipation (m,) of a jump of size 1."""
        size = abs(self._of(labels, "vertices")).max(axis=(1, 2))
        return np.asarray(size + (self._of(labels, "c").sum(axis=1) if self.dimension == 3 else 0.0))

    def utilisation(self, forces: Floats, labels: Bits) -> Floats:
        """Return the largest ratio (m,) of a demand to its capacity."""
        # The demand of a row are its shear and moments, and its capacity the rest. Along N, it is N over the end of N.
        core, c, d = forces[:, self._core], self._of(labels, "C"), self._of(labels, "d")
        least = 1e-6 * max(float(abs(forces[:, :3]).max(initial=0.0)), 1e-300)
        demand = -np.einsum("mrj,mj->mr", c[:, :, 1:], core[:, 1:])
        idle = self._of(labels, "idle") != 0.0
        along = c[:, :, 0] * core[:, :1]
        shares = np.where(idle, 0.0, used(demand, d + along, least)).max(axis=1)
        shares = np.maximum(shares, np.where(idle, 0.0, used(-along, d, least)).max(axis=1))
        if self.dimension == 3:
            capacity = self._of(labels, "c") + self._of(labels, "mu") * forces[:, :1]
            shares = np.maximum(shares, used(self._demands(forces, labels), capacity, least).max(axis=1))
        return np.asarray(np.clip(shares, 0.0, 1.0))

    @cached_property
    def _laid_out(self) -> tuple[RowPattern, RowPattern]:
        """Return the rows of both labels, and the same with enclosing rows in place of the dry ones."""
        return _patterns(self.dimension, (self.dry, self.inner, self.enclosing))

    @property
    def pattern(self) -> RowPattern:
        """Return the sparsity and numbers of the yield rows of all faces."""
        return self._laid_out[0]

    def hull(self) -> Rows:
        """Return yield rows that enclose the sets of both labels of each face."""
        every = np.ones(len(self.dry.d), dtype=bool)
        return Hull(self._laid_out[1], self.active(every) | self.active(~every))

    def parabolic_bending(self, *, undecided: bool) -> ParabolicBending | None:
        """Return None: rows are no parabolas."""
        return None

    def coulomb_wedge(self, dry: bool) -> CoulombWedge | None:
        """Return None: rows are no wedges."""
        return None

    def facets(self, labels: Bits) -> tuple[Floats, Floats] | None:
        """Return None: the rows have no fixed order."""
        return None

    @property
    def associative(self) -> FrictionSet:
        """Raise InputError: friction is not stated apart from the other rows."""
        one = self.criteria[0]
        problem = f'"{one.name}" is unknown to prescribed friction, and to all that asks for cohesion and μ'
        raise InputError(f"materials.{one.label}.criterion", problem, "standard strengths in place of it")


def row_yield(assembly: Assembly, scaling: Scaling, inner_bending: InnerBending = "uncoupled") -> RowYield:
    """Make the yield sets of all faces of an assembly from rows: of the standard criterion, and of plug-ins.

    Raises InputError where joints crush, and for rows that are no yield set.
    """
    dry, inner = _of_stresses(assembly, inner_bending)
    sets = _aligned(assembly.dimension, [dry, inner, _enclosing(assembly.dimension, dry, inner)])
    dry, inner, both = (one.scaled(assembly.interfaces.area / scaling.force) for one in sets)
    return RowYield(assembly.dimension, dry, inner, both, assembly.face_strengths.criteria)


def _of_stresses(assembly: Assembly, inner_bending: InnerBending) -> tuple[LabelRows, LabelRows]:
    """Return the sets of dry and of inner faces in stresses; raise InputError as `row_yield`."""
    numbers, bending = assembly.strengths(_ROUTE), None
    if assembly.dimension == 3:
        none = np.zeros(len(assembly.interfaces), dtype=bool)
        bending = bending_of(assembly.interfaces, none, inner_bending, none)
    dry, inner = (_compiled(assembly, _rows(assembly, numbers, bending, label), label) for label in (True, False))
    return dry, inner


def maps_criteria(assembly: Assembly, face_to: Ints, matrix: Floats) -> bool:
    """Return True if a symmetry maps the yield set of each face onto that of its image, under both labels.

    Under a map, V and m of a face may change sign, so that equal parameters are no equal sets. Sets are known to be
    mapped where the axes of a face are mapped onto those of its image.

    Parameters
    ----------
    assembly : Assembly
        A planar or spatial structure.
    face_to : (m,) int array
        Image of each face.
    matrix : (d, d) array
        Rotation or reflection.

    Returns
    -------
    bool
        True without criteria of plug-ins: strengths then say all.
    """
    if not assembly.face_strengths.criteria:
        return True
    faces, turned = assembly.interfaces, float(np.sign(np.linalg.det(matrix)))
    to = faces.take(face_to)
    swapped = np.sign(np.einsum("mi,mi->m", faces.normal @ matrix.T, to.normal))
    count = len(faces)
    core, shear = np.tile(np.eye(3), (count, 1, 1)), np.tile(np.eye(2), (count, 1, 1))
    if assembly.dimension == 2:
        core[:, 1, 1], core[:, 2, 2] = turned, turned * swapped
    else:
        axes = [np.stack([one.e1, one.e2], axis=2) for one in (faces, to)]
        turn = np.round(np.swapaxes(axes[1], 1, 2) @ matrix @ axes[0], 9)
        if not np.isin(turn, (-1.0, 0.0, 1.0)).all():
            return False
        core[:, 1:, 1:], shear = turned * swapped[:, None, None] * turn, swapped[:, None, None] * turn
    return all(_mapped(one, face_to, core, shear) for one in _of_stresses(assembly, "uncoupled"))


def _mapped(sets: LabelRows, to: Ints, core: Floats, shear: Floats) -> bool:
    """Return True if maps of the core (m, 3, 3) and of shear (m, 2, 2) turn each set into that of its image."""
    for points in (sets.vertices, sets.rays):
        if not points.shape[1]:
            continue
        moved, there = points @ np.swapaxes(core, 1, 2), points[to]
        size = max(1e-300, float(abs(points).max()))
        near = abs(moved[:, :, None] - there[:, None]).max(axis=3) <= 1e-9 * size
        if not (near.any(axis=1).all() and near.any(axis=2).all()):
            return False
    metric = np.swapaxes(sets.B, 1, 2) @ sets.B
    if not np.allclose(np.swapaxes(shear, 1, 2) @ metric[to] @ shear, metric, rtol=1e-9, atol=1e-12):
        return False
    numbers = np.column_stack([sets.k, sets.c, sets.mu, sets.coupled])
    return bool(np.allclose(numbers[to], numbers, rtol=1e-9, atol=0.0))


def _standard(dimension: int, numbers: Strengths, bending: Bending | None, dry: bool) -> FaceRows:
    """Return the rows of the standard criterion under one label, in stresses."""
    count, one = len(numbers.friction), np.ones(len(numbers.friction))
    friction = np.nan_to_num(numbers.friction if dry else numbers.inner_friction)
    shear = np.nan_to_num(numbers.cohesion if dry else numbers.shear)
    tension = 0.0 * one if dry else np.nan_to_num(numbers.tension)
    crush = np.inf * one if dry else np.where(np.isnan(numbers.crush_inner), np.inf, numbers.crush_inner)
    ends = np.where(np.isfinite(crush), 1.0, 0.0), np.where(np.isfinite(crush), crush, 0.0)
    if bending is None:
        steep = (1.0 if dry else 3.0) * one
        rows = [(one, 0.0 * one, sign * steep, tension) for sign in (-1.0, 1.0)]
        rows += [(friction, sign * one, 0.0 * one, shear) for sign in (-1.0, 1.0)]
        rows += [(-ends[0], 0.0 * one, sign * steep * ends[0], ends[1]) for sign in (-1.0, 1.0)]
        table = np.array(rows).transpose(2, 0, 1)
        return FaceRows(table[..., :3], table[..., 3])
    most = int(np.diff(bending.start).max(initial=0))
    table = np.zeros((count, 2 * most, 4))
    face = bending.face
    place = np.arange(len(face)) - bending.start[face]
    edges = bending.dry if dry else bending.inner
    table[face, place] = np.column_stack([np.ones(len(face)), -edges, tension[face]])
    table[face, most + place] = ends[0][face, None] * np.column_stack([-np.ones(len(face)), edges, ends[1][face]])
    gauge = Gauge(np.tile(np.eye(2), (count, 1, 1)), one, shear, friction)
    return FaceRows(table[..., :3], table[..., 3], (gauge,))


def _rows(assembly: Assembly, numbers: Strengths, bending: Bending | None, dry: bool) -> list[tuple[Ints, FaceRows]]:
    """Return the rows of one label by groups of faces (k,): standard ones, and those of each criterion."""
    label = "dry" if dry else "inner"
    plain, found = np.ones(len(assembly.interfaces), dtype=bool), []
    for one in assembly.face_strengths.criteria:
        which = np.flatnonzero(one.faces)
        if one.label == label and which.size:
            found.append((which, rows_of(one, geometry_of(assembly.interfaces, which, bending))))
            plain[which] = False
    standard = _standard(assembly.dimension, numbers, bending, dry)
    gauges = tuple(_taken(gauge, plain) for gauge in standard.gauges)
    return [(np.flatnonzero(plain), FaceRows(standard.C[plain], standard.d[plain], gauges)), *found]


def _taken(gauge: Gauge, faces: Bools) -> Gauge:
    """Return a gauge of some faces (m,)."""
    numbers = (np.asarray(part)[faces] for part in (gauge.torsion, gauge.cohesion, gauge.friction))
    return Gauge(None if gauge.shear is None else gauge.shear[faces], *numbers)


def _compiled(assembly: Assembly, groups: list[tuple[Ints, FaceRows]], dry: bool) -> LabelRows:
    """Return the sets of one label in stresses: rows without redundant ones, vertices and rays of each class of faces.

    Raises InputError for rows that are no yield set.
    """
    count, most = len(assembly.interfaces), max(rows.C.shape[1] for _, rows in groups)
    table = np.zeros((count, most, 4))
    for which, rows in groups:
        size = abs(rows.C).max(axis=2, initial=0.0)[..., None]
        whole = np.concatenate([rows.C, rows.d[..., None]], axis=2)
        table[which, : rows.C.shape[1]] = whole / np.where(size > 0.0, size, 1.0)
    kinds, first, kind = np.unique(table.reshape(count, -1), axis=0, return_index=True, return_inverse=True)
    kind, key = kind.ravel(), f"materials.{'dry' if dry else 'inner'}.criterion"
    own = [one for one in assembly.face_strengths.criteria if (one.label == "dry") == dry]
    names = [next((one.name for one in own if one.faces[face]), "standard") for face in first.tolist()]
    parts = [_core(one, key, name) for one, name in zip(kinds.reshape(-1, most, 4), names, strict=True)]
    limits, vertices, rays = (_padded([part[k] for part in parts], repeat=k == 1)[kind] for k in range(3))
    shear, numbers, coupled = _gauges(groups, count)
    k, c, mu = numbers
    found = LabelRows(limits[..., :3], limits[..., 3], shear, k, c, mu, coupled, vertices, rays, kind)
    for one in own:
        low = vertices[one.faces, :, 0].min(axis=1, initial=np.inf)[:, None]
        spare = c[one.faces] + mu[one.faces] * low
        if spare.min(initial=0.0) < -_ROUNDED * max(1e-300, float(c[one.faces].max(initial=0.0))):
            problem = f'N of "{one.name}" reaches {float(low.min()):g}, where c + μN is negative'
            raise InputError(key, problem, "N of at least −c/μ")
    return found


def _gauges(groups: list[tuple[Ints, FaceRows]], count: int) -> tuple[Floats, Floats, Bools]:
    """Return B (m, 2, 2); k, c and μ (3, m, 2) of the gauges of shear and torsion; and a mask (m,) of those in one."""
    # Gauges are divided by the larger of the size of B and k.
    shear, coupled = np.tile(np.eye(2), (count, 1, 1)), np.zeros(count, dtype=bool)
    numbers = np.zeros((3, count, 2))
    numbers[0] = 1.0
    for which, rows in groups:
        for gauge in rows.gauges:
            torsion, cohesion, friction = (np.asarray(one) for one in (gauge.torsion, gauge.cohesion, gauge.friction))
            size = np.array(torsion)
            if gauge.shear is not None:
                size = np.maximum(size, np.linalg.norm(gauge.shear, ord=2, axis=(1, 2)))
                shear[which] = gauge.shear / size[:, None, None]
                coupled[which] = torsion > 0.0
            for place, limits in ((0, gauge.shear is not None), (1, bool(np.all(torsion > 0.0)))):
                if limits and len(which):
                    numbers[:, which, place] = np.array([torsion if place else size, cohesion, friction]) / size
    return shear, numbers, coupled


def _padded(parts: list[Floats], *, repeat: bool) -> Floats:
    """Return arrays (r, q) of several lengths as one (k, most, q), filled with zeros or with their first row."""
    most = max(len(part) for part in parts)
    found = np.zeros((len(parts), most, parts[0].shape[1]))
    for place, part in enumerate(parts):
        found[place, : len(part)] = part
        if repeat:
            found[place, len(part) :] = part[0]
    return found


def _core(table: Floats, key: str, name: str) -> tuple[Floats, Floats, Floats]:
    """Return the rows (r, 4) that bound a core, its vertices (p, 3) and its rays (q, 3).

    Raises InputError for an unusable set.
    """
    table = np.unique(table[np.any(table[:, :3] != 0.0, axis=1)], axis=0)
    rows, constants = table[:, :3], table[:, 3]
    if np.linalg.matrix_rank(rows) < 3 if len(rows) else True:
        raise InputError(key, f'"{name}" leaves a force or moment without limit', "rows that limit all three")
    vertices, rays = corners(rows, constants)
    if not len(vertices):
        raise InputError(key, f'no force satisfies all rows of "{name}"', "a set that is not empty")
    if rays[:, 0].min(initial=0.0) < 0.0:
        raise InputError(key, f'"{name}" lets N fall without limit', "a tensile strength")
    if not (vertices[:, 0].any() or rays[:, 0].any()):
        raise InputError(key, f'"{name}" carries no N', "rows that let N act")
    generators = np.vstack([np.column_stack([vertices, np.ones(len(vertices))]), np.pad(rays, ((0, 0), (0, 1)))])
    if np.linalg.matrix_rank(generators) == 4:
        # A facet holds three extreme points or rays; other rows touch the set, or stay away.
        gap = abs(generators @ table.T) / np.maximum(abs(generators).max(axis=1), 1e-300)[:, None]
        table = table[(gap <= _TOUCHES * max(1.0, float(constants.max()))).sum(axis=0) >= 3]
    return table, vertices, rays


def _enclosing(dimension: int, dry: LabelRows, inner: LabelRows) -> LabelRows:
    """Return sets of stresses that enclose those of both labels."""
    # The cores have hulls; in the plane those of (N, M) and of (N, V). A gauge is the widest circle in the two of
    # shear, with a line above the capacities of both labels.
    vertices = np.concatenate([dry.vertices, inner.vertices], axis=1)
    rays = np.concatenate([dry.rays, inner.rays], axis=1)
    _, first, kind = np.unique(np.column_stack([dry.kind, inner.kind]), axis=0, return_index=True, return_inverse=True)
    parts = [
        _hull_of(dimension, vertices[face], rays[face][np.any(rays[face] != 0.0, axis=1)]) for face in first.tolist()
    ]
    kind = kind.ravel()
    table = _padded(parts, repeat=False)[kind]
    ends = [(one.vertices[:, :, 0].min(axis=1), one.vertices[:, :, 0].max(axis=1)) for one in (dry, inner)]
    low = vertices[:, :, 0].min(axis=1)[:, None]
    steep = np.max([np.where(one.endless[:, None], one.mu, 0.0) for one in (dry, inner)], axis=0)
    # The line starts at the least N of both, above every end of the capacities.
    start = np.max(
        [
            one.c + one.mu * end[:, None] - steep * (end[:, None] - low)
            for one, (bottom, top) in zip((dry, inner), ends, strict=True)
            for end in (bottom, np.where(one.endless, bottom, top))
        ],
        axis=0,
    )
    narrow = np.min([np.linalg.svd(one.B, compute_uv=False)[:, 1] for one in (dry, inner)], axis=0)
    return LabelRows(
        table[..., :3],
        table[..., 3],
        narrow[:, None, None] * np.eye(2),
        np.minimum(dry.k, inner.k),
        start - steep * low,
        steep,
        dry.coupled & inner.coupled,
        vertices,
        rays,
        kind,
    )


def _hull_of(dimension: int, vertices: Floats, rays: Floats) -> Floats:
    """Return the rows (r, 4) of the hull of vertices (p, 3) and rays (q, 3) of cores."""
    if dimension == 3:
        return np.column_stack(enclosing_rows(vertices, rays))
    table = []
    for other in (2, 1):
        rows, constants = enclosing_rows(vertices[:, [0, other]], rays[:, [0, other]])
        part = np.zeros((len(rows), 4))
        part[:, [0, other]], part[:, 3] = rows, constants
        # Both projections have the same range of N.
        table.append(part if other == 2 else part[part[:, 1] != 0.0])
    return np.vstack(table)


def _aligned(dimension: int, sets: list[LabelRows]) -> list[LabelRows]:
    """Return sets whose rows have places of their own for bending, shear and others, so that they share sparsity."""
    # Within a kind rows stand by falling N, in space by the angle of the moments.
    ordered, kinds = [], []
    for one in sets:
        c = one.C
        idle = ~np.any(c != 0.0, axis=2)
        if dimension == 2:
            kind = np.where(c[..., 1] == 0.0, np.where(c[..., 2] == 0.0, 2, 0), np.where(c[..., 2] == 0.0, 1, 2))
            keys = [np.where(kind == 1, c[..., 1], c[..., 2]), -c[..., 0]]
        else:
            kind = np.where(c[..., 0] > 0.0, 0, 1)
            keys = [np.round(np.mod(np.arctan2(-c[..., 2], -c[..., 1]), 2.0 * np.pi), 12)]
        kind = np.where(idle, 3, kind)
        order = np.tile(np.arange(c.shape[1]), (len(c), 1))
        for key in (*keys, kind):
            order = np.take_along_axis(order, np.argsort(np.take_along_axis(key, order, 1), axis=1, kind="stable"), 1)
        ordered.append((np.take_along_axis(c, order[..., None], 1), np.take_along_axis(one.d, order, 1)))
        kinds.append(np.take_along_axis(kind, order, 1))
    slots = [max(int((kind == number).sum(axis=1).max(initial=0)) for kind in kinds) for number in range(3)]
    p, q = (max(getattr(one, name).shape[1] for one in sets) for name in ("vertices", "rays"))
    found = []
    for one, (c, d), kind in zip(sets, ordered, kinds, strict=True):
        rows, constants = np.zeros((len(c), sum(slots), 3)), np.zeros((len(c), sum(slots)))
        for number in range(3):
            face, place = np.nonzero(kind == number)
            first = np.argmax(kind == number, axis=1)[face]
            at = sum(slots[:number]) + place - first
            rows[face, at], constants[face, at] = c[face, place], d[face, place]
        found.append(replace(one, C=rows, d=constants, vertices=_widened(one.vertices, p), rays=_widened(one.rays, q)))
    return found


def _widened(points: Floats, most: int) -> Floats:
    """Return points (m, p, 3), the last of them repeated until there are `most`; zeros where there are none."""
    more = most - points.shape[1]
    last = points[:, -1:] if points.shape[1] else np.zeros((len(points), 1, 3))
    return np.concatenate([points, np.repeat(last, more, axis=1)], axis=1)


class _Sheet:
    """Rows of three sets of m faces, collected family by family: of dry faces, of inner ones, and enclosing ones."""

    def __init__(self, count: int, freedoms: int) -> None:
        self.face, self.freedoms, self.rows = np.arange(count), freedoms, 0
        self._entries: list[tuple[Ints, Ints, Ints, Floats]] = []
        self._sides: list[tuple[Ints, Floats]] = []

    def column(self, resultant: int) -> Ints:
        """Return the column (m,) of a resultant of each face."""
        return self.freedoms * self.face + resultant

    def add(self, terms: list[tuple[Ints, list[Floats]]], sides: list[Floats], *, step: int = 1) -> None:
        """Add one row for each face: columns with coefficients of each set, and right-hand sides."""
        place = self.rows + step * self.face
        for column, values in terms:
            table = np.array(values)
            used = np.any(table != 0.0, axis=0)
            self._entries.append((place[used], column[used], self.face[used], table[:, used]))
        self._sides.append((place, np.array(sides)))
        self.rows += len(self.face) if step == 1 else 1

    def patterns(self, linear: int, extra: int) -> tuple[RowPattern, RowPattern]:
        """Return the rows of both labels, and those with enclosing rows in the places of dry ones."""
        row, column, face, values = (np.concatenate(part, axis=-1) for part in zip(*self._entries, strict=True))
        order = np.argsort(np.concatenate([place for place, _ in self._sides]))
        h = np.concatenate([side for _, side in self._sides], axis=1)[:, order]
        plain = RowPattern(
            row=row,
            column=column,
            face=face,
            dry=values[0],
            inner=values[1],
            h_dry=h[0],
            h_inner=h[1],
            row_face=np.tile(self.face, len(self._sides))[order],
            linear=linear,
            cones=(3,) * extra,
            capacity=np.zeros(0, dtype=np.int64),
            extra=extra,
        )
        return plain, replace(plain, dry=values[2], h_dry=h[2])


def _patterns(dimension: int, sets: tuple[LabelRows, LabelRows, LabelRows]) -> tuple[RowPattern, RowPattern]:
    """Return the rows of a program for both labels, and those with enclosing rows in the places of dry ones."""
    sheet = _Sheet(len(sets[0].d), 3 if dimension == 2 else 6)
    core = [0, 1, 2] if dimension == 2 else [0, 3, 4]
    for r in range(sets[0].C.shape[1]):
        # An idle row keeps its coefficients with side one, so that a resultant that cannot act stays bounded.
        size = [np.maximum(1.0, one.d[:, r]) for one in sets]
        terms = []
        for j, resultant in enumerate(core):
            values = [-one.C[:, r, j] / much for one, much in zip(sets, size, strict=True)]
            kept = [one.idle[:, r] | one.acts[:, j] for one in sets]
            terms.append(
                (sheet.column(resultant), [np.where(on, value, 0.0) for on, value in zip(kept, values, strict=True)])
            )
        sides = [np.where(one.idle[:, r], 1.0, one.d[:, r] / much) for one, much in zip(sets, size, strict=True)]
        sheet.add(terms, sides)
    if dimension == 2:
        return sheet.patterns(sheet.rows, 0)
    return _with_shear(sheet, sets)


def _with_shear(sheet: _Sheet, sets: tuple[LabelRows, LabelRows, LabelRows]) -> tuple[RowPattern, RowPattern]:
    """Return the patterns of spatial faces, with rows of shear and torsion after those of the core."""
    # A variable t of each face bounds shear: |B V| ≤ t, and t ± k mT ≤ c + μN where one gauge limits both, else t and ±
    # k mT have rows of their own.
    count = len(sheet.face)
    bound = sheet.freedoms * count + sheet.face
    alone = not all(one.coupled.all() for one in sets)
    for which, sign in [(1, 1.0), (1, -1.0)] + [(0, 0.0)] * alone:
        sizes = [np.maximum(np.maximum(1.0, one.mu[:, which]), one.c[:, which]) for one in sets]
        parts = list(zip(sets, sizes, strict=True))
        terms = [
            (sheet.column(0), [-one.mu[:, which] / size for one, size in parts]),
            (sheet.column(5), [sign * one.k[:, 1] / size for one, size in parts]),
            (bound, [np.where(one.coupled | (which == 0), 1.0, 0.0) / size for one, size in parts]),
        ]
        sheet.add(terms, [np.where(one.held[:, which], one.c[:, which] / size, 1.0) for one, size in parts])
    linear = sheet.rows
    sheet.add([(bound, [-np.ones(count)] * 3)], [np.where(one.held[:, 0], 0.0, 1.0) for one in sets], step=3)
    for i in (0, 1):
        terms = [(sheet.column(1 + j), [-one.B[:, i, j] for one in sets]) for j in (0, 1)]
        sheet.add(terms, [np.zeros(count)] * 3, step=3)
    return sheet.patterns(linear, count)
