"""Prepare an assembly for loading: springs, loads and state, and the ways to advance it."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np

from jld_core import Assembly, Bits, Bools, Floats, InputError, Ints, Route
from jld_core.geometry import moment_about
from jld_experiment.moving_spatial import Plane, Space, plane_of, space_of
from jld_experiment.settings import DAMPING_SCHEMES, REST, Joints, Settings
from jld_experiment.subcontacts import HALF, Bench, Drive, EnergyBalance, Motion, SubContacts, sub_contacts
from jld_experiment.time_stepping import march, march_in_plane, march_in_space

_BITS: Final = 32  # Binary digits of masses, periods and lengths: 2e-10 of them, far below what changes an experiment.


@dataclass(frozen=True)
class System:
    """Elastic assembly of n rigid elements on springs; a time step is the share `step` of the critical one."""

    ends: Ints  # (m, 2) elements a and b of each face
    frame: Floats  # (m, 6) or (m, 15) normals and arms for the time stepping, columns as in `Bench.frame`
    inverse: Floats  # (n, 2) inverse of mass and inertia, 0 on supports
    radius: Floats  # (n,) radius of gyration √(inertia/mass), length; 1 on supports
    period: float  # slowest period, steps
    reach: float  # elastic displacement live·u under the live loads with λ = 1
    # sag, swing: largest elastic displacement of an element under the dead loads, and under the live loads with λ = 1
    sag: float
    swing: float


def system_of(assembly: Assembly, points: SubContacts, kn: Floats, ks: Floats, step: float) -> System:
    """Compute stiffness, scaled masses and periods; kn, ks: (m,) springs of faces, stress per length."""
    elements, q, d = assembly.elements, assembly.freedoms, assembly.dimension
    ends = np.column_stack([assembly.interfaces.a, assembly.interfaces.b]).astype(np.int64)
    count = len(elements)
    stiffness = _stiffness(assembly, points, kn, ks)
    # masses in proportion to the stiffness, so that all elements have about the same period
    diagonal = stiffness[np.arange(count), :, np.arange(count), :]
    mass = np.einsum("ijj->i", diagonal[:, :d, :d]) / d
    inertia = np.einsum("ijj->i", diagonal[:, d:, d:]) / (q - d)
    free = elements.free
    masses = np.column_stack([mass, inertia])[free]
    scaled = np.repeat(masses**-0.5, (d, q - d), axis=1).ravel()
    matrix = stiffness[free][:, :, free].reshape(q * len(free), q * len(free))
    values = np.linalg.eigvalsh(matrix * scaled[:, None] * scaled)
    # A time step of one is stable up to ω = 2.
    factor = float(values[-1]) / (2.0 * step) ** 2
    inverse = np.zeros((count, 2))
    inverse[free] = rounded(1.0 / (factor * masses))
    live, dead = (load[free].ravel() for load in (assembly.live, assembly.dead))
    moved = np.linalg.solve(matrix, np.column_stack([live, dead]))
    radius = np.ones(count)
    squared = masses[:, 1] / masses[:, 0]
    radius[free] = rounded(np.sqrt(squared))
    slowest_and_reach = np.array([2.0 * np.pi * np.sqrt(factor / values[0]), live @ moved[:, 0]])
    sizes = np.abs(moved.reshape(-1, q, 2)[:, :d]).max(axis=(0, 1))
    period, reach, swing, sag = rounded(np.concatenate([slowest_and_reach, sizes])).tolist()
    return System(
        ends=ends,
        frame=_frame(assembly),
        inverse=inverse,
        radius=radius,
        period=period,
        reach=reach,
        sag=sag,
        swing=swing,
    )


def _stiffness(assembly: Assembly, points: SubContacts, kn: Floats, ks: Floats) -> Floats:
    """Return the stiffness (n, q, n, q) of all elements on the springs (m,) of faces."""
    count, q = len(assembly.elements), assembly.freedoms
    stiffness = np.zeros((count, q, count, q))
    jumps = jump_matrices(assembly)
    for face, ends in enumerate(zip(assembly.interfaces.a, assembly.interfaces.b, strict=True)):
        part = points.place[points.first[face] : points.first[face + 1]]
        spring = _spring(part, float(kn[face]), float(ks[face]))
        block = np.einsum("ji,jk,kl->il", jumps[face], spring, jumps[face])
        for i, x in enumerate(ends):
            for j, y in enumerate(ends):
                stiffness[x, :, y, :] += block[i * q : (i + 1) * q, j * q : (j + 1) * q]
    return stiffness


def rounded(values: Floats) -> Floats:
    """Round numbers to `_BITS` binary digits, so that experiments have equal digits on all machines."""
    fraction, exponent = np.frexp(values)
    return np.asarray(np.ldexp(np.round(np.ldexp(fraction, _BITS)), exponent - _BITS))


def jump_matrices(assembly: Assembly) -> Floats:
    """Return matrices (m, q, 2q) from motions of elements a and b to jumps of faces."""
    # Columns are the q freedoms of a, then those of b. The q jumps are opening, slips and rotations, conjugate to the
    # resultants of `Specimen.resultants`.
    faces, q, d = assembly.interfaces, assembly.freedoms, assembly.dimension
    matrices = np.zeros((len(faces), q, 2 * q))
    axes = [faces.normal, faces.e1] if d == 2 else [faces.normal, faces.e1, faces.e2]
    turns = [np.ones((1, 1))] if d == 2 else [faces.e1, faces.e2, faces.normal]
    for column, element, sign in ((0, faces.a, -1.0), (q, faces.b, 1.0)):
        arm = faces.origin - assembly.elements.centroid[element]
        for j, axis in enumerate(axes):
            matrices[:, j, column : column + d] = sign * axis
            matrices[:, j, column + d : column + q] = sign * moment_about(arm, axis)
        for j in range(q - d):
            matrices[:, d + j, column + d : column + q] = sign * turns[j]
    return matrices


def _spring(points: Floats, kn: float, ks: float) -> Floats:
    """Return the (q, q) stiffness of one face in its jumps."""
    if points.shape[1] == 2:
        s, area = points.T
        opening, slip = np.column_stack([np.ones_like(s), 0 * s, -s]), np.column_stack([0 * s, np.ones_like(s), 0 * s])
        rows, weights = [opening, slip], [kn * area, ks * area]
    else:
        x1, x2, area = points.T
        ones, zeros = np.ones_like(x1), np.zeros_like(x1)
        rows = [
            np.column_stack([ones, zeros, zeros, x2, -x1, zeros]),
            np.column_stack([zeros, ones, zeros, zeros, zeros, -x2]),
            np.column_stack([zeros, zeros, ones, zeros, zeros, x1]),
        ]
        weights = [kn * area, ks * area, ks * area]
    return np.asarray(sum((row * w[:, None]).T @ row for row, w in zip(rows, weights, strict=True)))


def _frame(assembly: Assembly) -> Floats:
    """Return normals and arms of all faces for the time stepping, columns as in `Bench.frame`."""
    # (m, 6) in the plane: normal n, then r × n and r × t for the arms r from a and from b; (m, 15) in space: n, e1, e2
    # and both arms.
    faces, centroid = assembly.interfaces, assembly.elements.centroid
    near, far = faces.origin - centroid[faces.a], faces.origin - centroid[faces.b]
    if assembly.dimension == 3:
        return np.ascontiguousarray(np.hstack([faces.normal, faces.e1, faces.e2, near, far]))
    columns = [faces.normal]
    for arm in (near, far):
        columns += [moment_about(arm, axis) for axis in (faces.normal, faces.e1)]
    return np.ascontiguousarray(np.hstack(columns))


_ROUTE: Final = Route("the virtual experiment")

SETTLE = 20.0  # Slowest periods in which the dead loads are applied.
PATIENCE = 600.0  # Slowest periods after which a structure that still moves counts as creeping.
FAR = 1e3  # Displacement, in elastic displacements, beyond which a structure counts as falling.


class Standing(StrEnum):
    """Behaviour under constant loads: rests, creeps after `PATIENCE` periods, or falls beyond `FAR`."""

    RESTS = "rests"
    CREEPS = "creeps"
    FALLS = "falls"


@dataclass
class State:
    """Variables that change during loading, for n elements and s sub-contacts.

    Attributes
    ----------
    moved, velocity : (n, q) float array
        Displacements and rotations about the centroids, and their change per time step.
    overlap, pressure : (s,) float array
        Elastic overlap (length) and compressive stress of sub-contacts.
    shear : (s, d − 1) float array
        Their shear stress.
    broken : (s,) bool array
        True where a sub-contact is broken.
    before : (n, q) float array
        Unbalanced forces of the step before, for combined damping.
    work : (8,) float array
        Work of the loads and losses of energy.
    geometry : Plane, Space or None
        State of a moving geometry.
    """

    moved: Floats
    velocity: Floats
    overlap: Floats
    pressure: Floats
    shear: Floats
    broken: Bools
    before: Floats
    work: Floats
    geometry: Plane | Space | None


@dataclass(frozen=True)
class Specimen:
    """One labelling of an assembly, ready to be loaded; loading changes its states, not it.

    Attributes
    ----------
    assembly : Assembly
        The structure.
    labels : (m,) bool array
        Labels, True = dry.
    points : SubContacts
        Sub-contacts of all faces.
    system : System
        Elastic system.
    bench : Bench
        Constant arrays of the time stepping.
    largest : float
        Largest dead load on an element, or live load without any, to which unbalanced forces are relative.
    geometry : Plane, Space or None
        Initial state of a moving geometry.
    settings : Settings
        The settings.
    """

    assembly: Assembly
    labels: Bits
    points: SubContacts
    system: System
    bench: Bench
    largest: float
    geometry: Plane | Space | None
    settings: Settings

    def fresh(self) -> State:
        """Return a new state at rest without any load."""
        n, q = len(self.assembly.elements), self.assembly.freedoms
        s = len(self.points.face)
        return State(
            moved=np.zeros((n, q)),
            velocity=np.zeros((n, q)),
            overlap=np.zeros(s),
            pressure=np.zeros(s),
            shear=np.zeros((s, self.assembly.dimension - 1)),
            broken=np.zeros(s, dtype=bool),
            before=np.zeros((n, q)),
            work=np.zeros(HALF + 1),
            geometry=copy.deepcopy(self.geometry),
        )

    def march(
        self,
        state: State,
        steps: int,
        *,
        dead: tuple[float, float] = (1.0, 1.0),
        load_factor: tuple[float, float] = (0.0, 0.0),
        rate: tuple[float, float] | None = None,
    ) -> tuple[float, float, float]:
        """Advance a state in place by a number of time steps.

        Parameters
        ----------
        state : State
            Changed in place.
        steps : int
            Number of time steps.
        dead, load_factor, rate : tuple of (float, float)
            Share of the dead loads, λ, and rate of live·u, whose multiplier λ then is, at the first and last step.

        Returns
        -------
        tuple of (float, float, float)
            Mean λ, largest unbalanced force over `largest`, and largest speed.
        """
        scheme, damping = DAMPING_SCHEMES.index(self.settings.damping_scheme), self.settings.damping
        if self.settings.damping_scheme == "viscous":
            damping *= 4.0 * np.pi / self.system.period  # Critical damping is a drag of twice mass × frequency.
        drive: Drive = (rate is not None, dead, load_factor, rate or (0.0, 0.0), scheme, damping)
        stresses = (state.overlap, state.pressure, state.shear, state.broken)
        motion = Motion(state.moved, state.velocity, *stresses, state.before, state.work)
        if isinstance(state.geometry, Plane):
            factor, worst, speed = march_in_plane(steps, drive, self.bench, motion, state.geometry)
        elif isinstance(state.geometry, Space):
            factor, worst, speed = march_in_space(steps, drive, self.bench, motion, state.geometry)
        else:
            factor, worst, speed = march(steps, drive, self.bench, motion)
        return factor, worst / self.largest, speed

    def settle(self) -> tuple[State, Standing]:
        """Apply the dead loads within `SETTLE` slowest periods and wait for rest; return state and standing."""
        state, period = self.fresh(), self.system.period
        self.march(state, max(1, round(SETTLE * period)), dead=(0.0, 1.0))
        return state, self.rest(state, 0.0)

    def rest(self, state: State, load_factor: float) -> Standing:
        """Wait for rest at a load factor, changing the state; return whether it rests, falls or creeps."""
        period = max(1, round(self.system.period))
        limit = FAR * (self.system.sag + abs(load_factor) * self.system.swing)
        for _ in range(int(PATIENCE)):
            _, worst, _ = self.march(state, period, load_factor=(load_factor, load_factor))
            if worst <= REST:
                return Standing.RESTS
            size = float(np.abs(state.moved[:, : self.assembly.dimension]).max())
            if not size <= limit:
                return Standing.FALLS
        return Standing.CREEPS

    def energy(self, state: State) -> EnergyBalance:
        """Return the energies of a state, from work of the loads to losses."""
        d, inverse = self.assembly.dimension, self.bench.inverse
        inverse_mass = np.repeat(inverse, (d, self.assembly.freedoms - d), axis=1)
        is_fixed = inverse_mass == 0.0
        kinetic = 0.5 * float(np.sum(state.velocity[~is_fixed] ** 2 / inverse_mass[~is_fixed]))
        area = self.points.place[:, -1] * (1.0 if state.geometry is None else state.geometry.kept)
        kn, ks = self.bench.law[self.points.face, :2].T
        stored = state.pressure**2 / kn + (state.shear**2).sum(axis=1) / ks
        elastic = 0.5 * float((area * stored).sum()) - float(state.work[HALF])
        dead, live, damping, friction, flow, fracture, corners = state.work[:HALF].tolist()
        return EnergyBalance(dead, live, damping, friction, flow, fracture, corners, kinetic, elastic)

    def resultants(self, state: State) -> Floats:
        """Return the resultants (m, q) of all faces with the signs of limit analysis, scene units."""
        place, face, count = self.points.place, self.points.face, len(self.labels)
        area = place[:, -1]
        normal, shear = state.pressure * area, state.shear * area[:, None]
        if self.assembly.dimension == 2:
            columns = [normal, shear[:, 0], -place[:, 0] * normal]
        else:
            x1, x2 = place[:, 0], place[:, 1]
            torsion = x1 * shear[:, 1] - x2 * shear[:, 0]
            columns = [normal, shear[:, 0], shear[:, 1], x2 * normal, -x1 * normal, torsion]
        return np.column_stack([np.bincount(face, weights=column, minlength=count) for column in columns])


def copied(state: State) -> State:
    return copy.deepcopy(state)


def specimen_of(assembly: Assembly, labels: Bits, joints: Joints, settings: Settings) -> Specimen:
    """Prepare an assembly under one labelling for loading.

    Parameters
    ----------
    assembly : Assembly
        The structure.
    labels : (m,) bool array
        Labels, True = dry.
    joints : Joints
        Laws of the joints.
    settings : Settings
        The settings.

    Returns
    -------
    Specimen

    Raises
    ------
    InputError
        If a required material is missing.
    """
    points = sub_contacts(assembly, labels, settings.scheme, settings.segments)
    # (m,) normal and shear springs per area
    normal = joints.normal_stiffness
    if normal is None:
        load = assembly.total_dead or assembly.total_live
        normal = 1e6 * load / (float(assembly.interfaces.area.mean()) * assembly.size)
    shear = normal if joints.shear_stiffness is None else joints.shear_stiffness
    ratio = np.where(labels, 1.0, joints.inner_ratio)
    kn, ks = rounded(normal * ratio), rounded(shear * ratio)
    law = _law(assembly, labels, joints, kn, ks)
    system = system_of(assembly, points, kn, ks, settings.step)
    bench = Bench(
        dead=assembly.dead,
        live=assembly.live,
        inverse=system.inverse,
        radius=system.radius,
        ends=system.ends,
        frame=system.frame,
        first=points.first,
        place=points.place,
        law=law,
        brittle=~labels & (joints.inner == "brittle"),
        gaps=labels & (settings.gaps == "free"),
        dry=np.asarray(labels, dtype=bool),
    )
    d = assembly.dimension
    geometry = None
    if settings.moving:
        geometry = plane_of(assembly, points, kn, ks) if d == 2 else space_of(assembly, points, kn, ks)
    forces = np.linalg.norm(assembly.dead[:, :d], axis=1)
    largest = float(forces.max()) or float(np.linalg.norm(assembly.live[:, :d], axis=1).max())
    return Specimen(assembly, labels, points, system, bench, largest, geometry, settings)


def _law(assembly: Assembly, labels: Bits, joints: Joints, kn: Floats, ks: Floats) -> Floats:
    """Return the (m, 8) law of every face; InputError if a material is missing."""
    # Tension is limited by the apex of the friction cone.
    strengths = assembly.strengths(_ROUTE).under(labels)
    friction, tension = strengths.friction, strengths.tension
    lacking = np.flatnonzero(np.isnan(friction + strengths.shear + tension))
    if lacking.size:
        face = int(lacking[0])
        name = "dry" if labels[face] else "inner"
        raise InputError(f"materials.{name}", "missing", f"this material, since face {assembly.pair(face)} is {name}")
    with np.errstate(divide="ignore", invalid="ignore"):
        tension = np.where(friction > 0.0, np.minimum(tension, strengths.shear / friction), tension)
    dilation = friction if joints.dilation == "friction" else np.where(labels, joints.dilation, 0.0)
    residual = np.full(len(labels), joints.residual_friction)
    return np.ascontiguousarray(
        np.column_stack([kn, ks, friction, dilation, strengths.shear, tension, strengths.crush, residual])
    )
