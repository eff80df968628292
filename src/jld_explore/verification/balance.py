"""Compute work balances of mechanisms exactly in integers; formulas of docs/method.md, restated here."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Final

import numpy as np

from jld_core.arrays import Floats
from jld_core.assembly import Assembly
from jld_core.errors import InputError
from jld_core.mechanics import Gauge
from jld_core.mechanics.compiled_rows import stated_rows
from jld_core.scene.standard import key_of
from jld_core.strengths import CRITERIA, STANDARD, Route

_ROUTE: Final = Route("certificates", STANDARD | CRITERIA)

# velocities of moving elements as integers: (ux, uy, ω), in space (u, ω); supports never move
Moves = Mapping[int, Sequence[int]]

_PARTS: Final = 24  # denominator of dissipation, so that halves, sixths and twelfths of strengths are integers


@dataclass(frozen=True)
class Balance:
    """Work balance of a mechanism, λ · work ≤ spent, that holds for a set of labellings."""

    work: Fraction  # power of the live load at λ = 1
    spent: Fraction | None  # dissipation minus power of the dead load; None if unbounded

    def proves(self, bound: Fraction) -> bool:
        """Return whether the balance excludes every λ ≥ 0 above the bound; with work 0: every λ."""
        if self.spent is None or self.work < 0:
            return False
        return self.spent <= bound * self.work if self.work > 0 else self.spent < 0


class Balances:
    """Exact work balances of one assembly under one load."""

    def __init__(self, assembly: Assembly) -> None:
        # a double is an integer over a power of two; square roots in space and quotients under crushing are rounded up,
        # which weakens the bound
        self.assembly = assembly
        self._count = len(assembly.interfaces)
        self._planar = assembly.dimension == 2
        self._of_member = assembly.of_members.tolist()
        strengths, faces = assembly.strengths(_ROUTE), assembly.interfaces
        if not self._planar:
            if (strengths.crushes & ~assembly.of_members).any():
                raise InputError(
                    "materials", "crushing in space has no certificate", f"no {key_of('dry', 'crush')} in space"
                )
            if not faces.rectangle.all():
                raise InputError("interfaces", "a face is no rectangle", "rectangular faces, for a certificate")
        sizes = [faces.area, faces.l1, np.zeros(self._count) if self._planar else faces.l2, faces.c_t]
        dry, inner = strengths.side(dry=True), strengths.side(dry=False)
        stresses = [inner.tension, inner.shear, dry.crush, inner.crush, dry.shear]
        numbers = np.array([*sizes, *stresses, dry.friction, inner.friction])
        self._finite = np.isfinite(numbers).T.tolist()
        table, self._digits = whole(np.nan_to_num(numbers, nan=0.0, posinf=0.0))
        self._numbers: list[list[int]] = [list(column) for column in zip(*table, strict=True)]
        self._stated = stated_rows(assembly) if assembly.face_strengths.criteria else {}
        self._lay_out()

    def _lay_out(self) -> None:
        """Compute the integer rows of A_eqᵀ of both sides of each face, and the integer loads."""
        assembly, faces = self.assembly, self.assembly.interfaces
        axes = [faces.normal, faces.e1] if self._planar else [faces.normal, faces.e1, faces.e2]
        anchors = list(self._anchors())
        centres = [assembly.elements.centroid.ravel(), faces.origin.ravel()]
        points, far = whole(np.concatenate([*centres, *(at for _, _, at, _ in anchors)])[None])
        places = [points[0][k : k + assembly.dimension] for k in range(0, len(points[0]), assembly.dimension)]
        held = [frame.ravel() for *_, frame in anchors]
        frames, near = whole(np.concatenate([np.stack(axes, axis=1).ravel(), *held])[None])
        d = assembly.dimension
        vectors = [frames[0][k : k + d] for k in range(0, len(frames[0]), d)]
        self._coefficient_digits = far + near
        number = len(assembly.elements)
        self._sides: list[list[tuple[int, int, list[list[int]]]]] = []
        for face in range(self._count):
            frame = vectors[d * face : d * face + d]
            both = []
            for sign, element in ((-1, int(faces.a[face])), (1, int(faces.b[face]))):
                if not (self._of_member[face] or assembly.elements.support[element]):
                    arm = [o - c for o, c in zip(places[number + face], places[element], strict=True)]
                    both.append((element, sign, _rows(frame, arm, far, near)))
            self._sides.append(both)
        for place, (face, element, _, _) in enumerate(anchors):
            if not assembly.elements.support[element]:
                at, first = number + self._count + place, d * (self._count + place)
                arm = [o - c for o, c in zip(places[at], places[element], strict=True)]
                rows = _rows(vectors[first : first + d], arm, far, near)
                none = [0] * assembly.freedoms
                self._sides[face].append((element, 1, [*rows[:d], *([none] * (assembly.freedoms - d))]))
        self._dead, self._dead_digits = whole(assembly.dead)
        self._live, self._live_digits = whole(assembly.live)

    def _anchors(self) -> Iterator[tuple[int, int, Floats, Floats]]:
        """Yield interface, element, point (d,) and unit forces (d, d) where members act on elements."""
        # A point is given by interface, element, position (d,), and forces (d, d) for unit N, V1 and V2 of the
        # interface.
        members, faces, d = self.assembly.members, self.assembly.interfaces, self.assembly.dimension
        for k in np.flatnonzero(members.face >= 0).tolist():
            face = int(members.face[k])
            sides = [faces.e1[face], faces.e2[face]][: d - 1]
            elements, points, forces = members.push(k)
            for place, (element, at, force) in enumerate(zip(elements.tolist(), points, forces, strict=True)):
                frame = np.zeros((d, d))
                frame[0] = force if members.axial[k] else 0.0
                if members.kinds[k] == "pin":
                    frame[1:] = (-1.0 if place == 0 else 1.0) * np.array(sides)
                yield face, element, at, frame

    def weigh(self, moves: Moves, digits: int, labels: Mapping[int, bool]) -> Balance:
        """Evaluate the work balance of a mechanism, valid for all labellings with these labels."""
        scale = self._coefficient_digits + digits
        work = self._power(self._live, self._live_digits, moves, digits)
        total = 0
        for face in range(self._count):
            jump = self._jump(face, moves)
            if not any(jump):
                continue
            known = labels.get(face)
            worst = 0
            known = False if self._of_member[face] else known
            for dry in (True, False) if known is None else (known,):
                cost = self._cost(face, jump, dry)
                if cost is None:
                    return Balance(work, None)
                worst = max(worst, cost)
            total += worst
        return self._balance(work, total, scale, moves, digits)

    def weigh_block(
        self, moves: Moves, digits: int, inside: Sequence[int], walls: Mapping[int, Sequence[int]]
    ) -> Balance:
        """Evaluate the work balance of a block, (6.5): inner faces `inside`, half jumps to dry `walls`."""
        work, total = self._power(self._live, self._live_digits, moves, digits), 0
        for face in (*inside, *walls):
            jump = self._jump(face, moves)
            if face in walls:
                sign = 1 if int(self.assembly.interfaces.a[face]) in moves else -1
                jump = [j + sign * (w << self._coefficient_digits) for j, w in zip(jump, walls[face], strict=True)]
            cost = self._cost(face, jump, face in walls) if any(jump) else 0
            if cost is None:
                return Balance(work, None)
            total += cost
        return self._balance(work, total, self._coefficient_digits + digits, moves, digits)

    def _balance(self, work: Fraction, total: int, scale: int, moves: Moves, digits: int) -> Balance:
        dissipated = Fraction(total, _PARTS << (scale + (3 if self._planar else 4) * self._digits))
        return Balance(work, dissipated - self._power(self._dead, self._dead_digits, moves, digits))

    def _cost(self, face: int, jump: Sequence[int], dry: bool) -> int | None:
        """Return the dissipation of a face in its integer unit, rounded up; None if infinite."""
        if (face, dry) in self._stated:
            return self._stated_cost(face, jump, dry)
        return self._planar_cost(face, jump, dry) if self._planar else self._spatial_cost(face, jump, dry)

    def _jump(self, face: int, moves: Moves) -> list[int]:
        found = [0] * self.assembly.freedoms
        for element, sign, rows in self._sides[face]:
            velocity = moves.get(element)
            if velocity is not None:
                for k, row in enumerate(rows):
                    found[k] += sign * sum(c * v for c, v in zip(row, velocity, strict=True) if c)
        return found

    def _power(self, forces: list[list[int]], shared: int, moves: Moves, digits: int) -> Fraction:
        """Return the exact power of integer forces over 2^shared under velocities over 2^digits."""
        total = sum(
            f * v for element, velocity in moves.items() for f, v in zip(forces[element], velocity, strict=True)
        )
        return Fraction(total, 1 << (shared + digits))

    def _planar_cost(self, face: int, jump: Sequence[int], dry: bool) -> int | None:
        """Return the dissipation of a planar face, (3.4) to (3.7), rounded up; None if infinite."""
        # The unit is 1/24 of 2**−(jumps + 3 digits).
        area, length, _, _, tension, shear, limit, compression, sticks, friction, rough = self._numbers[face]
        known, digits = self._finite[face], self._digits
        opening, slip, turn = jump[0] << digits, abs(jump[1]), length * abs(jump[2])
        if dry:
            if not known[9]:
                return None
            stuck = _PARTS * area * sticks * slip << digits
            closing = turn - 2 * (opening - friction * slip)
            if closing <= 0:
                return stuck
            if not known[6] or not limit:
                return None
            if closing < 2 * turn:
                return stuck + -(-3 * area * limit * closing * closing // turn)
            return stuck + 12 * area * limit * (closing - turn)
        if not (known[4] and known[5]):
            return None
        cracked = opening - rough * slip
        sheared = _PARTS * area * shear * slip << digits
        if not known[7]:
            return None if 6 * cracked < turn else sheared + _PARTS * area * tension * cracked
        corner = 2 * area * (compression + tension) * turn - 12 * area * (compression - tension) * cracked
        ends = _PARTS * area * max(tension * cracked, -compression * cracked)
        return sheared + max(ends, corner)

    def _stated_cost(self, face: int, jump: Sequence[int], dry: bool) -> int | None:
        """Return the dissipation of a face under a criterion of a plug-in, (2.19), rounded up; None if infinite."""
        rows = self._stated[face, dry]
        area, l1, l2, arm = (Fraction(number, 1 << self._digits) for number in self._numbers[face][:4])
        half = [l1 / 2] if self._planar else [l2 / 2, l1 / 2, arm]
        core = [
            *map(Fraction, jump[: -len(half)]),
            *(x * size for x, size in zip(jump[-len(half) :], half, strict=True)),
        ]
        spent = Fraction(0)
        for gauge in rows.gauges:
            capacity, friction = (Fraction(float(np.squeeze(part))) for part in (gauge.capacity, gauge.friction))
            slip = _slip(gauge, core)
            spent, core[0] = spent + capacity * slip, core[0] - friction * slip
        if not self._planar and rows.C.shape[1] == 3:
            core = [core[0], core[3], core[4]]
        work = _work(rows.C, rows.d, core)
        if work is None:
            return None
        spent += work
        return math.ceil(spent * area * (_PARTS << (3 if self._planar else 4) * self._digits))

    def _spatial_cost(self, face: int, jump: Sequence[int], dry: bool) -> int | None:
        """Return the dissipation of a spatial face, (3.4) and (3.5), rounded up; None if infinite."""
        # The unit is 1/24 of 2**−(jumps + 4 digits).
        area, l1, l2, arm, tension, shear, _, compression, sticks, friction, rough = self._numbers[face]
        known, digits = self._finite[face], self._digits
        slide = math.isqrt(jump[1] * jump[1] + jump[2] * jump[2])
        slide += slide * slide < jump[1] * jump[1] + jump[2] * jump[2]
        slip = max(slide << digits, arm * abs(jump[5]))
        opening = jump[0] << 2 * digits
        turn = (l2 * abs(jump[3]) + l1 * abs(jump[4])) << digits
        if self._of_member[face]:
            axial = max(tension * opening, -compression * opening)
            return _PARTS * area * ((shear * slip << digits) + axial)
        if dry:
            if not known[9] or 2 * (opening - friction * slip) < turn:
                return None
            return _PARTS * area * sticks * slip << digits
        if not (known[4] and known[5]) or 6 * (opening - rough * slip) < turn:
            return None
        return _PARTS * area * ((shear * slip << digits) + tension * (opening - rough * slip))


def _work(rows: Floats, sides: Floats, jump: Sequence[Fraction]) -> Fraction | None:
    """Return the greatest work −x·jump of forces with C x + d ≥ 0; None if infinite."""
    # It is the least d·y of all y ≥ 0 with Cᵀ y = jump, by the simplex method in fractions; any such y is a bound.
    # Costs are pairs, first those of the artificial columns that it begins with; Bland's rule ends it.
    used = np.any(rows != 0.0, axis=1)
    columns = [[Fraction(x) for x in row] for row in rows[used].tolist()]
    count, own = len(columns), len(jump)
    none, one = Fraction(0), Fraction(1)
    costs = [(none, Fraction(d)) for d in sides[used].tolist()] + [(one, none)] * own
    table = []
    for i, value in enumerate(jump):
        sign = -1 if value < 0 else 1
        table.append([*(sign * column[i] for column in columns), *(Fraction(i == j) for j in range(own)), sign * value])
    basis = list(range(count, count + own))

    def reduced(place: int) -> tuple[Fraction, Fraction]:
        parts = [(costs[name], row[place]) for name, row in zip(basis, table, strict=True) if row[place]]
        first, second = (costs[place][k] - sum((cost[k] * x for cost, x in parts), none) for k in (0, 1))
        return first, second

    while (enters := next((j for j in range(count) if j not in basis and reduced(j) < (none, none)), None)) is not None:
        ratios = [(row[-1] / row[enters], basis[i], i) for i, row in enumerate(table) if row[enters] > 0]
        if not ratios:
            return None
        leaves = min(ratios)[2]
        pivot = table[leaves][enters]
        table[leaves] = [x / pivot for x in table[leaves]]
        for i, row in enumerate(table):
            if i != leaves and (factor := row[enters]):
                table[i] = [x - factor * y for x, y in zip(row, table[leaves], strict=True)]
        basis[leaves] = enters
    if any(name >= count and row[-1] for name, row in zip(basis, table, strict=True)):
        return None
    return sum((costs[name][1] * row[-1] for name, row in zip(basis, table, strict=True)), none)


def _slip(gauge: Gauge, jump: Sequence[Fraction]) -> Fraction:
    """Return the dual of a gauge of shear and torsion at a jump (6,), rounded up."""
    slide, torsion = Fraction(0), Fraction(float(np.squeeze(gauge.torsion)))
    if gauge.shear is not None:
        (a, b), (c, d) = ([Fraction(float(x)) for x in row] for row in gauge.shear[0])
        one, two = ((d * jump[1] - c * jump[2]) / (a * d - b * c), (a * jump[2] - b * jump[1]) / (a * d - b * c))
        square = one * one + two * two
        root = math.isqrt(square.numerator * square.denominator)
        root += root * root < square.numerator * square.denominator
        slide = Fraction(root, square.denominator)
    return max(slide, abs(jump[5]) / torsion) if torsion else slide


def whole(values: Floats) -> tuple[list[list[int]], int]:
    """Convert finite numbers (r, c) exactly to integers over one power of two; return it as digits."""
    pairs = [[float(value).as_integer_ratio() for value in row] for row in values]
    digits = max((below.bit_length() - 1 for row in pairs for _, below in row), default=0)
    return [[above << (digits - below.bit_length() + 1) for above, below in row] for row in pairs], digits


def _rows(frame: Sequence[Sequence[int]], arm: Sequence[int], far: int, near: int) -> list[list[int]]:
    """Return the jump of a face per unit velocity of an element, (1.1) and (3.1), as integers."""
    if len(arm) == 2:
        along = [[x << far, y << far, arm[0] * y - arm[1] * x] for x, y in frame]
        return [*along, [0, 0, 1 << far + near]]
    slides = []
    for x, y, z in frame:
        across = [arm[1] * z - arm[2] * y, arm[2] * x - arm[0] * z, arm[0] * y - arm[1] * x]
        slides.append([x << far, y << far, z << far, *across])
    normal, e1, e2 = frame
    turns = [[0, 0, 0, *(value << far for value in axis)] for axis in (e1, e2, normal)]
    return [*slides, *turns]
