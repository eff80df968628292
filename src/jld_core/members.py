"""Members of an assembly: ties, tendons and pins between points of its elements."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from jld_core.arrays import Bools, Floats, Ints
from jld_core.errors import InputError


def _none() -> Ints:
    return np.zeros(0, dtype=np.int64)


@dataclass(frozen=True)
class Members:
    """Ties, tendons and pins of an assembly, in scene units.

    A member whose force may vary has an inner interface of its own after those of the geometry, without bending and
    torsion. N, its compression beyond the prestress, and V of a pin act at the points that stand here.
    """

    # names, kinds: names, and "tie", "tendon", "pin", or "fill" for the horizontal pressure of fill
    names: tuple[str, ...] = ()
    kinds: tuple[str, ...] = ()
    # (k,) interface of each member; −1 for a constant force, which only loads the assembly
    face: Ints = field(default_factory=_none)
    elements: tuple[Ints, ...] = ()  # elements to which each member is fixed, in order
    points: tuple[Floats, ...] = ()  # points of these elements
    # (k, d) unit vector of each member from its first point to the next
    axis: Floats = field(default_factory=lambda: np.zeros((0, 2)))
    # tension, compression, shear, prestress: (k,) capacities, and prestress: the tension that always acts; forces
    tension: Floats = field(default_factory=lambda: np.zeros(0))
    compression: Floats = field(default_factory=lambda: np.zeros(0))
    shear: Floats = field(default_factory=lambda: np.zeros(0))
    prestress: Floats = field(default_factory=lambda: np.zeros(0))
    # (f,) tensile strength times area of the faces as dry joints; None where no joint has any. N of the program is the
    # normal force plus this.
    bond: Floats | None = None
    # (n, q) part of the dead loads that is prestress and bond; None where there is none
    self_stress: Floats | None = None

    def __len__(self) -> int:
        return len(self.names)

    def __bool__(self) -> bool:
        return bool(self.names)

    @property
    def axial(self) -> Bools:
        """Return a mask (k,) of members whose axial force may vary."""
        return np.asarray((self.tension > self.prestress) | (self.compression > 0.0))

    def push(self, member: int) -> tuple[Ints, Floats, Floats]:
        """Return elements (r,), points (r, d) and forces (r, d), in balance, of a unit compression in a member."""
        elements, points = self.elements[member], self.points[member]
        if self.kinds[member] == "pin":
            middle = np.broadcast_to(points.mean(axis=0), points.shape)
            return elements, middle, np.array([-self.axis[member], self.axis[member]])
        step = np.diff(points, axis=0)
        along = step / np.linalg.norm(step, axis=1)[:, None]
        forces = np.zeros_like(points)
        forces[:-1] -= along
        forces[1:] += along
        return elements, points, forces

    @cached_property
    def ends(self) -> Ints | None:
        """Return the two elements (k, 2) of each member; None if some member has more elements."""
        for elements in self.elements:
            if len(np.unique(elements)) > 2:
                return None
        found = [(elements[0], elements[np.flatnonzero(elements != elements[0])[0]]) for elements in self.elements]
        return np.array(found, dtype=np.int64).reshape(-1, 2)

    def joined(self, group: Ints, kept: Ints) -> Members:
        """Return the members after elements joined to groups (n,), with the remaining interfaces `kept` (k,)."""
        place = {int(face): number for number, face in enumerate(kept)}
        rows = [k for k, face in enumerate(self.face.tolist()) if face in place]
        return replace(
            self.take(rows),
            face=np.array([place[int(self.face[k])] for k in rows], dtype=np.int64),
            elements=tuple(group[self.elements[k]] for k in rows),
        )

    def __add__(self, other: Members) -> Members:
        """Return the members of both, without interfaces, bond and self-stress."""

        def both(name: str) -> Floats:
            return np.concatenate([getattr(self, name), getattr(other, name)])

        return Members(
            names=self.names + other.names,
            kinds=self.kinds + other.kinds,
            face=np.full(len(self) + len(other), -1, dtype=np.int64),
            elements=self.elements + other.elements,
            points=self.points + other.points,
            axis=np.concatenate([one.axis for one in (self, other) if len(one)] or [self.axis]),
            tension=both("tension"),
            compression=both("compression"),
            shear=both("shear"),
            prestress=both("prestress"),
        )

    def take(self, rows: list[int]) -> Members:
        arrays = {name: getattr(self, name)[rows] for name in ("face", "axis", "tension", "compression", "shear")}
        return Members(
            names=tuple(self.names[k] for k in rows),
            kinds=tuple(self.kinds[k] for k in rows),
            elements=tuple(self.elements[k] for k in rows),
            points=tuple(self.points[k] for k in rows),
            prestress=self.prestress[rows],
            **arrays,
        )

    def refuse(self, what: str) -> None:
        """Raise InputError for members, fill or bonded joints, which the computation `what` does not model."""
        if "fill" in self.kinds:
            problem = f"{what} does not model its variable pressure"
            raise InputError("fill", problem, 'a scene without fill, or with "active" and "passive" 0')
        if self.names:
            raise InputError("members", f"{what} does not model them ({self.names[0]!r})", "a scene without members")
        if self.bond is not None:
            where = "materials.dry.tensile_strength"
            raise InputError(where, f"{what} does not model it", "joints without tensile strength")
