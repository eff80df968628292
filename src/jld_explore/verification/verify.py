"""Check a certificate: its scene, every reason by work balances in integers, and that no labelling is left."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Final

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Floats
from jld_core.assembly import Assembly
from jld_core.build.assemble import build_assembly
from jld_core.build.elements import faces_of_pairs
from jld_core.errors import InputError
from jld_core.mechanics import Gauge
from jld_core.mechanics.criteria import stated_rows
from jld_core.scene.reading import parse_scene
from jld_core.scene.schema import Scene
from jld_core.scene.standard import key_of
from jld_core.strengths import CRITERIA, STANDARD, Route
from jld_explore.verification.certificate import BlockMechanism, Claim, Lemma, Mechanism, Reason, Rule, at_least, read

_ROUTE: Final = Route("certificates", STANDARD | CRITERIA)

# velocities of moving elements as integers: (ux, uy, ω), in space (u, ω); supports never move
Moves = Mapping[int, Sequence[int]]

# Columns of the sizes and strengths of a face
_TENSION, _SHEAR, _DRY_CRUSH, _INNER_CRUSH, _DRY_SHEAR, _FRICTION = range(4, 10)

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
        points, point_digits = whole(np.concatenate([*centres, *(index for _, _, index, _ in anchors)])[None])
        positions = [points[0][k : k + assembly.dimension] for k in range(0, len(points[0]), assembly.dimension)]
        frames_of_members = [frame.ravel() for *_, frame in anchors]
        frames, frame_digits = whole(np.concatenate([np.stack(axes, axis=1).ravel(), *frames_of_members])[None])
        d = assembly.dimension
        vectors = [frames[0][k : k + d] for k in range(0, len(frames[0]), d)]
        self._coefficient_digits = point_digits + frame_digits
        first_interface = len(assembly.elements)
        self._sides: list[list[tuple[int, int, list[list[int]]]]] = []
        for face in range(self._count):
            frame = vectors[d * face : d * face + d]
            sides = []
            for sign, element in ((-1, int(faces.a[face])), (1, int(faces.b[face]))):
                if not (self._of_member[face] or assembly.elements.support[element]):
                    arm = [o - c for o, c in zip(positions[first_interface + face], positions[element], strict=True)]
                    sides.append((element, sign, _rows(frame, arm, point_digits, frame_digits)))
            self._sides.append(sides)
        for anchor, (face, element, _, _) in enumerate(anchors):
            if not assembly.elements.support[element]:
                index, first = first_interface + self._count + anchor, d * (self._count + anchor)
                arm = [o - c for o, c in zip(positions[index], positions[element], strict=True)]
                rows = _rows(vectors[first : first + d], arm, point_digits, frame_digits)
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
            for end, (element, at, force) in enumerate(zip(elements.tolist(), points, forces, strict=True)):
                frame = np.zeros((d, d))
                frame[0] = force if members.axial[k] else 0.0
                if members.kinds[k] == "pin":
                    frame[1:] = (-1.0 if end == 0 else 1.0) * np.array(sides)
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
            label = labels.get(face)
            worst = 0
            label = False if self._of_member[face] else label
            for dry in (True, False) if label is None else (label,):
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
        """Return the relative velocity of a face under integer moves of elements."""
        jump = [0] * self.assembly.freedoms
        for element, sign, rows in self._sides[face]:
            velocity = moves.get(element)
            if velocity is not None:
                for k, row in enumerate(rows):
                    jump[k] += sign * sum(c * v for c, v in zip(row, velocity, strict=True) if c)
        return jump

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
        finite, digits = self._finite[face], self._digits
        opening, slip, turn = jump[0] << digits, abs(jump[1]), length * abs(jump[2])
        if dry:
            if not finite[_FRICTION]:
                return None
            stuck = _PARTS * area * sticks * slip << digits
            closing = turn - 2 * (opening - friction * slip)
            if closing <= 0:
                return stuck
            if not finite[_DRY_CRUSH] or not limit:
                return None
            if closing < 2 * turn:
                return stuck + -(-3 * area * limit * closing * closing // turn)
            return stuck + 12 * area * limit * (closing - turn)
        if not (finite[_TENSION] and finite[_SHEAR]):
            return None
        cracked = opening - rough * slip
        sheared = _PARTS * area * shear * slip << digits
        if not finite[_INNER_CRUSH]:
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
        finite, digits = self._finite[face], self._digits
        slide = math.isqrt(jump[1] * jump[1] + jump[2] * jump[2])
        slide += slide * slide < jump[1] * jump[1] + jump[2] * jump[2]
        slip = max(slide << digits, arm * abs(jump[5]))
        opening = jump[0] << 2 * digits
        turn = (l2 * abs(jump[3]) + l1 * abs(jump[4])) << digits
        if self._of_member[face]:
            axial = max(tension * opening, -compression * opening)
            return _PARTS * area * ((shear * slip << digits) + axial)
        if dry:
            if not finite[_FRICTION] or 2 * (opening - friction * slip) < turn:
                return None
            return _PARTS * area * sticks * slip << digits
        if not (finite[_TENSION] and finite[_SHEAR]) or 6 * (opening - rough * slip) < turn:
            return None
        return _PARTS * area * ((shear * slip << digits) + tension * (opening - rough * slip))


def _work(rows: Floats, sides: Floats, jump: Sequence[Fraction]) -> Fraction | None:
    """Return the greatest work −x·jump of forces with C x + d ≥ 0; None if infinite."""
    # It is the least d·y of all y ≥ 0 with Cᵀ y = jump, by the simplex method in fractions; any such y is a bound.
    # Costs are pairs, first those of the artificial columns that it begins with; Bland's rule ends it.
    used = np.any(rows != 0.0, axis=1)
    columns = [[Fraction(x) for x in row] for row in rows[used].tolist()]
    count, height = len(columns), len(jump)
    zero, one = Fraction(0), Fraction(1)
    costs = [(zero, Fraction(d)) for d in sides[used].tolist()] + [(one, zero)] * height
    table = []
    for i, value in enumerate(jump):
        sign = -1 if value < 0 else 1
        table.append(
            [*(sign * column[i] for column in columns), *(Fraction(i == j) for j in range(height)), sign * value]
        )
    basis = list(range(count, count + height))

    def reduced(index: int) -> tuple[Fraction, Fraction]:
        parts = [(costs[name], row[index]) for name, row in zip(basis, table, strict=True) if row[index]]
        first, second = (costs[index][k] - sum((cost[k] * x for cost, x in parts), zero) for k in (0, 1))
        return first, second

    while (enters := next((j for j in range(count) if j not in basis and reduced(j) < (zero, zero)), None)) is not None:
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
    return sum((costs[name][1] * row[-1] for name, row in zip(basis, table, strict=True)), zero)


def _slip(gauge: Gauge, jump: Sequence[Fraction]) -> Fraction:
    """Return the dual of a gauge of shear and torsion at a jump (6,), rounded up."""
    slide, torsion = Fraction(0), Fraction(float(np.squeeze(gauge.torsion)))
    if gauge.shear is not None:
        (a, b), (c, d) = ([Fraction(float(x)) for x in row] for row in gauge.shear[0])
        slip1, slip2 = ((d * jump[1] - c * jump[2]) / (a * d - b * c), (a * jump[2] - b * jump[1]) / (a * d - b * c))
        square = slip1 * slip1 + slip2 * slip2
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


Clause = list[int]

_MOST_BLOCKS: Final = 100_000  # possible blocks that a check lists

# Keys under "search" from which rules follow
_STATED: Final = {
    "candidates",
    "keep",
    "segmentation",
    "block_cells",
    "block_weight",
    "block_extent",
    "block_mass",
    "dry_faces",
}

# Keys under "search" that never add labellings; a proof without them holds with them as well
_NARROWER: Final = {
    "block_aspect",
    "convex_blocks",
    "blocks",
    "shapes",
    "moulds",
    "require",
    "assemble",
    "assemble_out_of_plane",
    "sawn_length",
    "saw_cuts",
    "saw_set_ups",
}

_IDLE: Final = {"symmetry", "front"}  # keys under "search" that do not affect which labellings are admissible


class Labellings:
    def __init__(self, scene: Scene, assembly: Assembly) -> None:
        # literals: face + 1 states that a face is inner, −(face + 1) that it is dry; limits that clauses cannot express
        # are ignored, so that the proof covers more labellings
        self.assembly, self.search = assembly, scene.search
        self._refuse_other_keys()
        faces, elements = assembly.interfaces, assembly.elements
        self._ends = list(zip(faces.a.tolist(), faces.b.tolist(), strict=True))
        self.fixed = self._fixed()
        self._around: dict[int, list[int]] = {e: [] for e in range(len(elements))}
        for face, pair in enumerate(self._ends[: assembly.faces]):  # members bound no block
            for element in pair:
                self._around[element].append(face)
        self._support = elements.support.tolist()
        self.between_free = {f for f, pair in enumerate(self._ends) if not any(self._support[e] for e in pair)}
        self._blocks: list[Block] | None = None
        self._touching: dict[int, list[int]] = {e: [] for e in range(len(elements))}
        for a, b in assembly.touching:
            self._touching[a].append(b)
            self._touching[b].append(a)
        self.beginning: list[Clause] = [[-(face + 1)] if dry else [face + 1] for face, dry in self.fixed.items()]
        self.beginning += self._limit_dry_faces()

    def _refuse_other_keys(self) -> None:
        """Raise InputError for a key that admits more labellings, or is unknown."""
        for name, field in type(self.search).model_fields.items():
            other = name not in _STATED | _NARROWER | _IDLE
            if other and getattr(self.search, name) != field.get_default(call_default_factory=True):
                key = f"search.{field.alias or name}"
                raise InputError(key, "certificates do not support this key", "a search without it")

    def _limit_dry_faces(self) -> list[Clause]:
        """Return clauses that limit the number of dry faces between free elements."""
        low, high = self.search.dry_faces
        members = self.assembly.of_members.tolist()
        counted = [face for face in range(len(self._ends)) if face in self.between_free and not members[face]]
        last_variable, clauses = len(self._ends), list[Clause]()
        if low is not None and low > 0 and counted:
            clauses, last_variable = at_least([-(face + 1) for face in counted], int(low), last_variable)
        # at most `high` dry: at least the others are inner
        if high is not None and len(counted) > high:
            more, _ = at_least([face + 1 for face in counted], int(len(counted) - high), last_variable)
            clauses += more
        return clauses

    def _fixed(self) -> dict[int, bool]:
        """Return the labels that are fixed: of faces that are no candidates or are kept."""
        assembly, search = self.assembly, self.search
        elements, faces = assembly.elements, assembly.interfaces
        dry = faces_of_pairs(search.keep.dry, elements, faces, "search.keep.dry")
        inner = faces_of_pairs(search.keep.inner, elements, faces, "search.keep.inner")
        listed = None
        if isinstance(search.candidates, list):
            listed = faces_of_pairs(search.candidates, elements, faces, "search.candidates")
        fixed: dict[int, bool] = {}
        members = assembly.of_members.tolist()
        for face, (a, b) in enumerate(self._ends):
            inside = not (elements.support[a] or elements.support[b])
            if members[face]:
                free = False
            elif listed is not None:
                free = bool(listed[face])
            elif search.candidates == "all+supports":
                free = True
            elif search.candidates == "all":
                free = inside
            else:
                same = elements.blocks[a] is not None and elements.blocks[a] == elements.blocks[b]
                free = inside and same
            if dry[face] or inner[face]:
                fixed[face] = bool(dry[face])
            elif not free:
                fixed[face] = bool(assembly.labels[face])
        return fixed

    @property
    def blocks(self) -> list[Block]:
        """Every set of free elements that may be one block of a segmentation; InputError above `_MOST_BLOCKS`."""
        if self._blocks is None:
            self._blocks = self._listed()
        return self._blocks

    def _listed(self) -> list[Block]:
        joined = {f for f in self.between_free if not self.fixed.get(f, False)}
        same_size = {frozenset([e]) for e, support in enumerate(self._support) if not support}
        blocks: list[Block] = []
        while same_size and self.search.segmentation:
            larger: set[frozenset[int]] = set()
            for members in same_size:
                sizes = self._sizes(members)
                if any(high is not None and size > high * (1.0 + slack) for size, (_, high), slack in sizes):
                    continue
                touched = {f for e in members for f in self._around[e]}
                inside = [f for f in touched if members.issuperset(self._ends[f])]
                border = sorted(touched.difference(inside))
                larger |= {members.union(self._ends[f]) for f in joined.intersection(border)}
                small = any(low is not None and size < low * (1.0 - slack) for size, (low, _), slack in sizes)
                if not small and joined.issuperset(inside):
                    blocks.append(Block(tuple(sorted(members)), tuple(sorted(inside)), tuple(border)))
                if len(blocks) > _MOST_BLOCKS:
                    raise InputError("search", "too many blocks are possible", f"at most {_MOST_BLOCKS}")
            same_size = larger
        return blocks

    # --- clauses that a certificate gives ---------------------------------------------------------------

    def slit(self, face: int, through: Sequence[int]) -> Clause | None:
        """Return the clause that forbids a slit: a dry face whose sides inner faces join; None if unfounded."""
        if not self.search.segmentation or face in through or not self._are_faces([face, *through]):
            return None
        a, b = self._ends[face]
        return [face + 1, *(-(f + 1) for f in through)] if b in self._joined(a, through) else None

    def too_large(self, joined: Sequence[int]) -> Clause | None:
        """Return the clause that not all given faces, whose block is too large, are inner, or None."""
        # The inner faces must join a block that exceeds a limit.
        if not joined or not self._are_faces(joined):
            return None
        start = self._ends[joined[0]][0]
        members = self._joined(start, joined)
        if any(a not in members for face in joined for a in self._ends[face]):
            return None
        for size, (_, high), slack in self._sizes(members):
            if high is not None and size > high * (1.0 + slack):
                return [-(face + 1) for face in joined]
        return None

    def too_small(self, within: Sequence[int]) -> Clause | None:
        """Return the clause that not all faces around given elements are dry, or None."""
        members = set(within)
        valid = all(0 <= e < len(self._support) for e in members) and not all(self._support[e] for e in members)
        # Supports that touch belong to one block without a face between them.
        if not valid or any(other not in members for e in members for other in self._touching[e]):
            return None
        border = {f for e in members for f in self._around[e] if len(members.intersection(self._ends[f])) == 1}
        for size, (low, _), slack in self._sizes(members):
            if low is not None and size < low * (1.0 - slack):
                return [face + 1 for face in sorted(border)]
        return None

    def _are_faces(self, faces: Iterable[int]) -> bool:
        """Return whether all numbers are faces of the assembly, not interfaces of members."""
        return all(0 <= face < self.assembly.faces for face in faces)

    def _joined(self, start: int, faces: Sequence[int]) -> set[int]:
        """Return the elements reachable from one across given faces and between touching supports."""
        reached, waiting = {start}, [start]
        while waiting:
            at = waiting.pop()
            across = (b if a == at else a for a, b in (self._ends[face] for face in faces) if at in (a, b))
            for other in (*across, *self._touching[at]):
                if other not in reached:
                    reached.add(other)
                    waiting.append(other)
        return reached

    def _sizes(self, members: Iterable[int]) -> list[tuple[float, Sequence[float | None], float]]:
        """Return size, limits and relative rounding of a set of elements for each measure."""
        # Only free elements contribute to the size.
        elements, search = self.assembly.elements, self.search
        free = sorted(e for e in members if not self._support[e])
        weights = [math.sqrt(math.fsum(w * w for w in elements.weight[e].tolist())) for e in free]
        extent = 0.0
        if free:
            corners = np.concatenate([elements.shape[e] for e in free])
            extent = float((corners.max(axis=0) - corners.min(axis=0)).max())
        weight = math.fsum(weights)
        mass = weight / elements.gravity if elements.gravity else 0.0
        slack = tolerances.DECIMALS
        return [
            (float(len(free)), search.block_cells, 0.0),
            (weight, search.block_weight, slack),
            (mass, search.block_mass, slack),
            (extent, search.block_extent, slack),
        ]


@dataclass(frozen=True)
class Block:
    """Elements of a possible block, the faces inside it and those around it."""

    members: tuple[int, ...]
    inside: tuple[int, ...]
    around: tuple[int, ...]


def follows(lemma: Sequence[int], by: Sequence[int], clauses: Mapping[int, Sequence[int]]) -> bool:
    """Return whether a lemma follows by reverse unit propagation from given clauses in order."""
    # With the lemma false, each of these clauses in turn must have one literal left, and the last one none.
    false = set(lemma)
    if any(-literal in false for literal in lemma):
        return True
    for name in by:
        clause = clauses.get(name)
        if clause is None:
            return False
        undecided = [literal for literal in clause if literal not in false]
        if not undecided:
            return True
        if len(set(undecided)) > 1:
            return False
        false.add(-undecided[0])
    return False


@dataclass(frozen=True)
class Verified:
    """Result of a successful check: no labelling of the scene carries a λ above `claim.bound`."""

    claim: Claim  # statement of the certificate
    scene: Scene  # scene that the certificate holds
    # mechanisms, rules, lemmas: number of reasons of each kind
    mechanisms: int
    rules: int
    lemmas: int
    size: int  # size of the file, bytes
    seconds: float  # time of the check, s


def verify(path: Path, scene: Scene | None = None) -> Verified:
    """Check a certificate, without the program that searched, solved or wrote it.

    Parameters
    ----------
    path : Path
        Path.
    scene : Scene, optional
        Scene that the certificate must be of; by default the scene it holds.

    Returns
    -------
    Verified

    Raises
    ------
    InputError
        For the first reason that does not hold, a damaged file, or another scene.
    """
    start = time.perf_counter()
    claim, reasons = read(path)
    own_scene = parse_scene(claim.scene, str(path))
    if scene is not None and scene.fingerprint != own_scene.fingerprint:
        problem = f"it is of another scene ({own_scene.name!r})"
        raise InputError(str(path), problem, f"a certificate of {scene.name!r} as it stands")
    try:
        Checker(own_scene, build_assembly(own_scene), claim).check(reasons)
    except InputError as error:
        raise error.within(str(path)) from None
    kinds = Counter(type(reason) for reason in reasons)
    seconds = time.perf_counter() - start
    return Verified(
        claim,
        own_scene,
        kinds[Mechanism] + kinds[BlockMechanism],
        kinds[Rule],
        kinds[Lemma],
        path.stat().st_size,
        seconds,
    )


class Checker:
    """Checker of the reasons of one certificate, in whole numbers.

    Parameters
    ----------
    scene : Scene
        Scene of the certificate.
    assembly : Assembly
        Assembly of that scene.
    claim : certificate.Claim
        What the reasons are to prove.

    Attributes
    ----------
    labellings : Labellings
        What is known of the labellings of the scene, as clauses.
    balances : list of Balances
        Balance of power of mechanisms, of each load case.

    Raises
    ------
    InputError
        For a labelling that the scene does not have.
    """

    def __init__(self, scene: Scene, assembly: Assembly, claim: Claim) -> None:
        self.labellings = Labellings(scene, assembly)
        cases = assembly.by_case
        self.balances = [Balances(case) for case in cases]
        self._bounds = [Fraction(claim.bound) * Fraction(required) for required in assembly.required.tolist()]
        self.ceilings: list[Fraction | None] = [None] * len(cases)  # λ that no labelling exceeds, by mechanisms so far
        self._faces = len(assembly.interfaces)
        self.clauses: dict[int, list[int]] = dict(enumerate(self.labellings.beginning, 1))
        self._refuted = any(not clause for clause in self.labellings.beginning)
        self._check_labelling(claim.labelling)

    def _check_labelling(self, labelling: str | None) -> None:
        """Raise InputError if a labelling has the wrong length or contradicts a fixed label."""
        if labelling is None:
            return
        if len(labelling) != self._faces:
            problem = f"its labelling has {len(labelling)} letters"
            raise InputError("labelling", problem, f"{self._faces}, one for each face")
        for face, dry in self.labellings.fixed.items():
            if (labelling[face] == "d") is not dry:
                fixed = "dry" if dry else "inner"
                raise InputError("labelling", f"letter {face + 1} is {labelling[face]!r}", f"a face that is {fixed}")

    def check(self, reasons: list[Reason]) -> None:
        """Check all reasons; InputError for the first that does not hold, or if labellings remain."""
        for number, reason in enumerate(reasons, len(self.clauses) + 1):
            clause = self.clause(reason)
            if clause is None and isinstance(reason, Mechanism) and self.lowers_ceiling(reason):
                clause = [1, -1]  # always true: it holds the number of a reason that serves later block mechanisms
            if clause is None:
                raise InputError(f"reason {number}", _wrong(reason), "reasons that hold")
            self.clauses[number] = clause
            self._refuted |= not clause
        if not self._refuted:
            raise InputError("reasons", "they leave labellings that may carry more", "a proof that leaves none")

    def clause(self, reason: Reason) -> list[int] | None:
        # The clause is not stored. Its literals are those of `Labellings`.
        if isinstance(reason, Mechanism):
            return self._of_mechanism(reason)
        if isinstance(reason, BlockMechanism):
            return self._of_blocks(reason)
        if isinstance(reason, Lemma):
            literals = list(reason.literals)
            return literals if 0 not in literals and follows(literals, reason.by, self.clauses) else None
        numbers = list(reason.numbers)
        if reason.kind == "slit" and numbers:
            return self.labellings.slit(numbers[0], numbers[1:])
        if reason.kind == "large":
            return self.labellings.too_large(numbers)
        return self.labellings.too_small(numbers) if reason.kind == "small" else None

    def _of_mechanism(self, reason: Mechanism) -> list[int] | None:
        """Return the clause that a mechanism proves, or None if its balance exceeds the bound."""
        balance = self._balance_of(reason)
        return _labels(reason) if balance is not None and balance.proves(self._bounds[reason.case]) else None

    def lowers_ceiling(self, reason: Mechanism) -> bool:
        """Take the λ that a mechanism proves of all labellings, for the blocks to come; return whether it does."""
        balance = None if reason.dry or reason.inner else self._balance_of(reason)
        if balance is None or balance.spent is None or balance.work <= 0:
            return False
        ceiling, load_factor = self.ceilings[reason.case], balance.spent / balance.work
        self.ceilings[reason.case] = load_factor if ceiling is None else min(ceiling, load_factor)
        return True

    def _balance_of(self, reason: Mechanism) -> Balance | None:
        """Return the balance of power of a mechanism; None if its labels, case or velocities are not of the scene."""
        decided = self._decided(reason)
        if decided is None or not self._fits_elements(reason.moves, self.balances[reason.case].assembly.freedoms):
            return None
        return self.balances[reason.case].weigh(reason.moves, reason.digits, decided)

    def _decided(self, reason: Mechanism | BlockMechanism) -> dict[int, bool] | None:
        """Return the labels of a reason and those that are fixed; None if they disagree, or its case is none."""
        decided = dict(self.labellings.fixed)
        for face, dry in [*((f, True) for f in reason.dry), *((f, False) for f in reason.inner)]:
            if not 0 <= face < self._faces or decided.get(face, dry) is not dry:
                return None
            decided[face] = dry
        return decided if 0 <= reason.case < len(self.balances) else None

    def _fits_elements(self, moves: Mapping[int, Sequence[int]], numbers: int) -> bool:
        """Return whether all keys are free elements, with so many numbers each."""
        elements = self.labellings.assembly.elements
        free = all(0 <= element < len(elements) and not elements.support[element] for element in moves)
        return free and all(len(values) == numbers for values in moves.values())

    def _of_blocks(self, reason: BlockMechanism) -> list[int] | None:
        # The clause that mechanisms of possible blocks prove, or None. The left side of (6.6), `excess`, is concave in
        # λ: positive at the ceiling and not negative at the bound, it is positive for all λ between them. Blocks
        # without velocities stand still.
        assembly, decided = self.labellings.assembly, self._decided(reason)
        q, walls = assembly.freedoms, reason.walls
        if decided is None or not self._fits_elements(reason.prices, 2) or any(len(w) != q for w in walls.values()):
            return None
        bound, ceiling = self._bounds[reason.case], self.ceilings[reason.case]
        free = self.labellings.between_free
        if not free.issuperset(walls) or assembly.of_members.any() or ceiling is None:
            return None
        if not all(decided.get(f) for f in range(self._faces) if f not in free):
            return None  # a block may hold a support
        lengths_match = all(len(velocity) == q * len(members) for members, velocity in reason.blocks.items())
        if not self.labellings.search.segmentation or not lengths_match:
            return None
        scale, still = 1 << reason.digits, (0,) * q
        # of each element the multipliers v and σ of (6.6)
        price = {e: [Fraction(part, scale) for part in values] for e, values in reason.prices.items()}
        load_factors = bound, max(bound, ceiling)
        excess = [sum((factor * sigma - v for v, sigma in price.values()), Fraction(0)) for factor in load_factors]
        for block in self.labellings.blocks:
            if any(decided.get(f) for f in block.inside) or any(decided.get(f) is False for f in block.around):
                continue  # labels that the reason decides forbid this block
            velocity = reason.blocks.get(block.members, still * len(block.members))
            moves = {e: velocity[q * k : q * k + q] for k, e in enumerate(block.members)}
            sides = {f: walls.get(f, still) for f in block.around}
            balance = self.balances[reason.case].weigh_block(moves, reason.digits, block.inside, sides)
            if balance.spent is None:
                return None
            members = [price[e] for e in block.members if e in price]
            for k, factor in enumerate(load_factors):
                gain = factor * balance.work - balance.spent
                excess[k] += min(Fraction(0), gain - sum(factor * sigma - v for v, sigma in members))
        at_bound, at_ceiling = excess
        return _labels(reason) if at_bound >= 0 and (at_ceiling > 0 or ceiling <= bound) else None


def _labels(reason: Mechanism | BlockMechanism) -> list[int]:
    return [*(face + 1 for face in reason.dry), *(-(face + 1) for face in reason.inner)]


def _wrong(reason: Reason) -> str:
    if isinstance(reason, Mechanism | BlockMechanism):
        return "its mechanism does not prove the bound for all labellings of the reason"
    if isinstance(reason, Lemma):
        return "the lemma does not follow from the reasons it names"
    return f"the rule {reason.kind!r} does not follow from the scene"
