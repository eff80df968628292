"""Proven ranges of reactions of supports and of resultants across joints, under a given load."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from jld_core import (
    Assembly,
    Bits,
    Floats,
    Ints,
    LimitAnalysis,
    LimitAnalysisResult,
    ParameterError,
    Route,
    SolveOptions,
    Status,
    one_thread,
    tolerances,
)
from jld_core.build import loads as built
from jld_core.geometry import moment_about
from jld_core.limit import Proof, State, number, relative_width, without_idle
from jld_core.mechanics import (
    Scaling,
    equilibrium_matrix,
    reference_load,
    require_materials,
    scaling_of,
    used,
    yield_set,
)
from jld_core.program import Beside, Template

# Values from which λ is counted, in weights of the structure; the first one that no state reaches is used
_REACHES: Final = (2.0, 32.0, 1024.0)


@dataclass(frozen=True)
class ForceFunction:
    """Linear function R(F) = Σ weights · F of the resultants at interfaces."""

    weights: Floats  # (m, q) coefficient of each resultant; R is in scene units
    # size of R for which R / unit is a force: 1 for forces, a length for moments, a speed for work rates
    unit: float = 1.0


@dataclass(frozen=True)
class Thrust:
    """Least or greatest value of a linear function of forces, such as a reaction."""

    value: float  # R, scene units; NaN where there is no end
    bracket: tuple[float, float]  # proven bounds on R, NaN where unproven
    gap: float  # width of the bracket over max(|R|, 1e-3 · weight · unit of the function)
    status: str  # "certified" (both bounds are proven), "unbounded" or "uncertified"
    # forces at this end and the mechanism, moved supports included; its λ is R. None where there is no end.
    state: LimitAnalysisResult | None

    def to_json(self) -> dict[str, Any]:
        state = None if self.state is None else self.state.to_json()
        return {
            "reaction": number(self.value),
            "bracket": [number(end) for end in self.bracket],
            "gap": number(self.gap),
            "status": self.status,
            "mechanism": None if state is None else state["mechanism"],
            "forces": None if state is None else state["forces"],
        }


def extreme_value(
    assembly: Assembly,
    function: ForceFunction,
    labels: Bits,
    *,
    greatest: bool,
    gap: float = tolerances.GAP,
    moved: Floats | None = None,
) -> Thrust:
    """Compute the least or the greatest value of a function of forces, with both bounds.

    moved: (n, q) velocities of supports, scene units, of which R is the work rate.
    """
    # R takes the place of λ in a limit analysis, by one more row R(F) ∓ λ = 0 (docs/method.md, "Supports that move"); λ
    # is counted from a value that no state reaches, so that it is positive
    # The model has associative friction and convex contact. All states in equilibrium with the dead load count.
    sign = 1.0 if greatest else -1.0
    if not function.weights.any():
        return Thrust(0.0, (0.0, 0.0), 0.0, "certified", None)
    proof = Proof()
    for reach in _REACHES:
        origin = -sign * reach * max(assembly.total_dead, 1e-3 * assembly.total_live)
        analysis = _analysis(assembly, function, gap, sign, origin)
        proof = analysis.prove(labels)
        if proof.status is not Status.UNSTABLE:
            break
    return _thrust(analysis, proof, function, labels, gap, sign, origin, moved)


def _analysis(assembly: Assembly, function: ForceFunction, gap: float, sign: float, origin: float) -> LimitAnalysis:
    """Create the analysis that maximises λ where R(F) / unit = origin + sign λ; sign ±1, origin a force."""
    scaling = scaling_of(assembly)
    scaling = replace(scaling, load=scaling.force)  # here λ is a force, and scaled like one
    row = (function.weights / function.unit * scaling.face).ravel() / scaling.force
    defines_load = Beside(row=row, dead=-origin / scaling.force, live=-sign)  # R(F) / unit − origin − sign λ = 0
    template = Template(assembly, scaling, yield_set(assembly, scaling, "uncoupled"), defines_load)
    analysis = LimitAnalysis(assembly, template=template, gap=gap, solver="clarabel")
    analysis.load_scale = tolerances.GAP_FLOOR * reference_load(assembly) / scaling.force
    return analysis


def _thrust(
    analysis: LimitAnalysis,
    proof: Proof,
    function: ForceFunction,
    labels: Bits,
    gap: float,
    sign: float,
    origin: float,
    moved: Floats | None,
) -> Thrust:
    """Convert a proof about scaled λ to the least or greatest value of R; NaN where it lacks one."""
    assembly, scaling, unit = analysis.assembly, analysis.template.scaling, function.unit
    if proof.status is Status.LOCKED:
        return Thrust(math.nan, (math.nan, math.nan), math.nan, "unbounded", None)
    ends = [unit * (origin + sign * scaling.load * end) for end in proof.bracket]
    low, high = min(ends), max(ends)
    value = 0.5 * (low + high)
    width = relative_width(low, high, tolerances.GAP_FLOOR * reference_load(assembly) * unit)
    motion, state = proof.motion, proof.state
    if motion is None or state is None or not math.isfinite(value):
        return Thrust(math.nan, (math.nan, math.nan), math.nan, "uncertified", None)
    mechanism = np.zeros((len(assembly.elements), assembly.freedoms))
    moves = unit * scaling.load * motion.velocity[:-1] / scaling.row.ravel()
    mechanism[assembly.elements.free] = moves.reshape(-1, assembly.freedoms)
    if moved is not None:
        # At the greatest reaction the supports move against the structure.
        mechanism += -sign * moved
    result = LimitAnalysisResult(
        assembly=assembly,
        labels=labels,
        status=Status.COLLAPSE,
        load_factor=value,
        bracket=(low, high),
        gap=width,
        stands_at_zero=True,
        forces=state.forces * scaling.face,
        mechanism=mechanism,
        iterations=proof.solves,
        solve_log=tuple(proof.solve_log),
        seconds={"assemble": analysis.seconds, "solve": proof.seconds, "total": analysis.seconds + proof.seconds},
        model=SolveOptions(gap=gap),
    )
    return Thrust(value, (low, high), width, "certified", result)


@dataclass(frozen=True)
class Settled:
    """Range of thrust after a support movement.

    Attributes
    ----------
    settlement : Settlement
        Settlement.
    assembly : Assembly
        The structure under its dead load, with the settlement's share of live load added.
    labels : (m,) bool array
        Labels, True = dry.
    stands : bool or None
        Whether it stands under this load; None where undecided.
    least, most : Thrust or None
        Ends of the range; None if it does not stand.
    seconds : float
        Time, s.
    """

    settlement: built.Settlement
    assembly: Assembly
    labels: Bits
    stands: bool | None
    least: Thrust | None
    most: Thrust | None
    seconds: float

    def to_json(self) -> dict[str, Any]:
        """Return the object that `jld settlement --json` prints for each settlement."""
        ids = self.assembly.elements.ids
        moved = np.flatnonzero(self.settlement.velocity.any(axis=1)).tolist()
        return {
            "name": self.settlement.name,
            "supports": {ids[k]: self.settlement.velocity[k].tolist() for k in moved},
            "load": self.settlement.load,
            "stands": self.stands,
            "least": None if self.least is None else self.least.to_json(),
            "most": None if self.most is None else self.most.to_json(),
            "seconds": self.seconds,
        }


@one_thread()
def settle(
    assembly: Assembly, settlement: built.Settlement, labels: Bits | None = None, *, gap: float = tolerances.GAP
) -> Settled:
    """Compute the range of thrust after a support movement, by the assembly's labels unless given."""
    # The model has associative friction and convex contact.
    assembly.members.refuse("the range of reactions under a movement of supports")
    start = time.perf_counter()
    assembly = assembly.by_case[0]
    if settlement.load:
        assembly = replace(assembly, dead_loads=assembly.dead_loads + settlement.load * assembly.live_loads)
    layout_labels = assembly.labels if labels is None else np.asarray(labels, dtype=bool)
    require_materials(assembly, layout_labels, ~layout_labels)
    stands = LimitAnalysis(assembly).stands(layout_labels)
    least = most = None
    if stands is not False:
        velocity = settlement.velocity
        # the function of forces that gives the work rate of supports moving at `velocity` (n, q)
        # its unit is the largest speed of a translation
        speed = float(np.linalg.norm(velocity[:, : assembly.dimension], axis=1).max()) or (
            assembly.size * float(abs(velocity).max())
        )
        matrix, rows = _support_rows(assembly, velocity.any(axis=1))
        weights = np.where(assembly.elements.support[:, None], velocity, 0.0)[rows].ravel()
        function = ForceFunction((matrix.T @ weights).reshape(-1, assembly.freedoms), speed)
        least, most = (
            extreme_value(assembly, function, layout_labels, greatest=greatest, gap=gap, moved=velocity)
            for greatest in (False, True)
        )
    return Settled(settlement, assembly, layout_labels, stands, least, most, time.perf_counter() - start)


def reactions(assembly: Assembly, forces: Floats, elements: Floats) -> Floats:
    """Compute the resultants (k, q) of forces (m, q) at faces on elements (k,), about their centroids."""
    matrix, rows = _support_rows(assembly, np.isin(np.arange(len(assembly.elements)), elements))
    forces_on = np.zeros((len(assembly.elements), assembly.freedoms))
    forces_on[rows] = (matrix @ forces.ravel()).reshape(len(rows), -1)
    return np.asarray(forces_on[elements])


def _support_rows(assembly: Assembly, moving: Any) -> tuple[Any, Any]:
    """Build the equilibrium matrix in which some supports (n,) are free; return the free elements too."""
    elements = replace(assembly.elements, support=assembly.elements.support & ~moving)
    return equilibrium_matrix(replace(assembly, elements=elements)), elements.free


# Components in the axes of the scene, by dimension
_GLOBAL: Final = {2: ("Fx", "Fy", "M"), 3: ("Fx", "Fy", "Fz", "Mx", "My", "Mz")}

# Components in the axes of a face, by dimension
_LOCAL: Final = {2: ("N", "V", "M"), 3: ("N", "V1", "V2", "M1", "M2", "MT")}


@dataclass(frozen=True)
class Resultant:
    """One component of the resultant of some faces, as a function of the forces."""

    place: str  # name of the faces: "support NAME", "joint A, B" or "section x, y to x, y"
    # fx, Fy, Fz, Mx, My, Mz or, planar, M in the axes of the scene; N, V, V1, V2, M, M1, M2 or MT in those of a face
    component: str
    point: Floats  # (d,) point about which moments are taken, scene units
    function: ForceFunction  # value of the component for any forces at the interfaces, scene units


@dataclass(frozen=True)
class ResultantRange:
    """Least and greatest value of a resultant over all admissible states."""

    resultant: Resultant
    # least, most: both ends, each with its bracket
    least: Thrust
    most: Thrust

    @property
    def interval(self) -> tuple[float | None, float | None]:
        """Proven interval of the resultant in every admissible state; None where unproven."""
        return number(self.least.bracket[0]), number(self.most.bracket[1])

    def to_json(self) -> dict[str, Any]:
        resultant = self.resultant
        return {
            "place": resultant.place,
            "component": resultant.component,
            "point": resultant.point.tolist(),
            "interval": list(self.interval),
            **{
                name: {
                    "value": number(end.value),
                    "bracket": [number(bound) for bound in end.bracket],
                    "gap": number(end.gap),
                    "status": end.status,
                }
                for name, end in (("least", self.least), ("most", self.most))
            },
        }


@dataclass(frozen=True)
class ThrustRanges:
    """Ranges of reactions and resultants of one structure under one load."""

    assembly: Assembly  # the structure; its dead load holds the given part of the live load
    labels: Bits  # (m,) True = dry
    load_factor: float  # factor of the live load that acts
    stands: bool | None  # True if the structure stands under this load, False if not; None where undecided
    ranges: tuple[ResultantRange, ...]  # one per resultant; empty if the structure does not stand
    seconds: float  # wall-clock time

    def to_json(self) -> dict[str, Any]:
        """Return the object that `jld thrust --json` prints for each load case."""
        return {
            "load_factor": self.load_factor,
            "stands": self.stands,
            "ranges": [range_.to_json() for range_ in self.ranges],
            "seconds": self.seconds,
        }


@one_thread()
def thrust_ranges(
    assembly: Assembly,
    labels: Bits | None = None,
    *,
    resultants: Sequence[Resultant] | None = None,
    load_factor: float = 0.0,
    gap: float = tolerances.GAP,
) -> ThrustRanges:
    """Bracket the least and greatest value of reactions or other resultants.

    labels: (m,) labels, True = dry. Default: those of the assembly. Result: one range per resultant; none if the
    structure does not stand. Raises InputError if a material that the labelling needs is missing, or the assembly has
    members. Raises ParameterError if the load factor is not finite; the parameter is `load_factor`.
    """
    # The model has associative friction and convex contact.
    assembly.members.refuse("the range of reactions and joint forces")
    if not np.isfinite(load_factor):
        raise ParameterError("load_factor", f"{load_factor} is wrong", "a finite number")
    start = time.perf_counter()
    layout_labels = assembly.labels if labels is None else np.asarray(labels, dtype=bool)
    require_materials(assembly, layout_labels, ~layout_labels)
    if load_factor:
        assembly = replace(assembly, dead_loads=assembly.dead_loads + load_factor * assembly.live_loads)
    stands = LimitAnalysis(assembly).stands(layout_labels)
    ranges: list[ResultantRange] = []
    if stands is not False:
        for resultant in reactions_of_supports(assembly) if resultants is None else resultants:
            least, most = (
                extreme_value(assembly, resultant.function, layout_labels, greatest=greatest, gap=gap)
                for greatest in (False, True)
            )
            ranges.append(ResultantRange(resultant, least, most))
    return ThrustRanges(assembly, layout_labels, load_factor, stands, tuple(ranges), time.perf_counter() - start)


def reactions_of_supports(assembly: Assembly, names: Sequence[str] | None = None) -> tuple[Resultant, ...]:
    """Return all components of the reactions of supports, in the axes of the scene."""
    # Moments are about the centroid of the contact with the structure.
    elements, faces = assembly.elements, assembly.interfaces
    bearing = [k for k in np.flatnonzero(elements.support).tolist() if ((faces.a == k) | (faces.b == k)).any()]
    if names is not None:
        index_of = {elements.ids[k]: k for k in bearing}
        for name in names:
            if name not in index_of:
                raise ParameterError(
                    "support", f"no support that bears something is named {name!r}", ", ".join(index_of)
                )
        bearing = [index_of[name] for name in names]
    resultants: list[Resultant] = []
    for k in bearing:
        own_faces = np.flatnonzero((faces.a == k) | (faces.b == k))
        title = f"support {elements.ids[k]}"
        side = np.where(faces.a[own_faces] == k, faces.b[own_faces], faces.a[own_faces])
        resultants += _resultant(assembly, title, own_faces, side, local=False)
    return tuple(resultants)


def resultant_of_joint(assembly: Assembly, first: str, second: str) -> tuple[Resultant, ...]:
    """Return all components of the resultant between two elements, as it acts on the second one."""
    # Components are in the axes of the faces if these are parallel (N is positive in compression), else in the axes of
    # the scene.
    elements, faces = assembly.elements, assembly.interfaces
    for name in (first, second):
        if name not in elements.index:
            raise ParameterError("joint", f"no element is named {name!r}", "names of two elements, as A,B")
    a, b = elements.index[first], elements.index[second]
    joint_faces = np.flatnonzero(((faces.a == a) & (faces.b == b)) | ((faces.a == b) & (faces.b == a)))
    if not len(joint_faces):
        raise ParameterError(
            "joint", f"{first!r} and {second!r} do not touch", "names of two elements that share a face"
        )
    return _resultant(assembly, f"joint {first}, {second}", joint_faces, np.full(len(joint_faces), b), local=True)


def resultant_of_section(assembly: Assembly, start: Sequence[float], end: Sequence[float]) -> tuple[Resultant, ...]:
    """Return N, V and M of the faces on a line, as they act on the part to its left; planar."""
    if assembly.dimension != 2:
        raise ParameterError("section", "a line cuts planar structures only", "joint A,B in space")
    first, last = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
    length = float(np.linalg.norm(last - first))
    if not length > tolerances.CONTACT * assembly.size:
        raise ParameterError("section", "both ends of the line are the same point", "two points, as X,Y,X,Y")
    along = (last - first) / length
    to_left = np.array([-along[1], along[0]])
    near = tolerances.SNAP * assembly.size
    faces = assembly.interfaces
    crossing = [
        k
        for k, polygon in enumerate(faces.polygon)
        if (abs((polygon - first) @ to_left) <= near).all()
        and ((polygon - first) @ along >= -near).all()
        and ((polygon - first) @ along <= length + near).all()
    ]
    if not crossing:
        raise ParameterError("section", "no face lies on the line", "a line along faces")
    rows = np.array(crossing)
    side = np.where(faces.normal[rows] @ to_left > 0.0, faces.b[rows], faces.a[rows])
    title = "section " + " to ".join(f"{x:.6g}, {y:.6g}" for x, y in (first, last))
    return _resultant(assembly, title, rows, side, local=True)


def _resultant(assembly: Assembly, title: str, faces: Ints, side: Ints, *, local: bool) -> tuple[Resultant, ...]:
    """Build the functions of each component of the resultant of faces (k,) on elements `side` (k,)."""
    # The resultant acts on the elements beside the faces. Moments are about the mean of the face centroids, weighted by
    # area.
    joints, d, q = assembly.interfaces, assembly.dimension, assembly.freedoms
    point = np.average(joints.origin[faces], axis=0, weights=joints.area[faces])
    free = replace(assembly.elements, support=np.zeros(len(assembly.elements), dtype=bool))
    matrix = equilibrium_matrix(replace(assembly, elements=free)).tocsr()
    total = np.zeros((q, len(joints), q))
    for face, element in zip(faces.tolist(), side.tolist(), strict=True):
        block = matrix[q * element : q * (element + 1), q * face : q * (face + 1)].toarray()
        arm = assembly.elements.centroid[element] - point
        block[d:] += moment_about(np.tile(arm, (q, 1)), block[:d].T).T.reshape(q - d, q)
        total[:, face] = block
    names, axes = _GLOBAL[d], np.eye(q)
    first, towards = int(faces[0]), joints.normal[faces] * np.where(joints.b[faces] == side, 1.0, -1.0)[:, None]
    if local and (towards @ towards[0] > 1.0 - tolerances.CONTACT).all():
        names, axes = _LOCAL[d], _axes_of_face(assembly, first, towards[0])
    total = np.tensordot(axes, total, axes=1)
    return tuple(
        Resultant(title, name, point, ForceFunction(total[k], 1.0 if k < d else assembly.size))
        for k, name in enumerate(names)
    )


def _axes_of_face(assembly: Assembly, face: int, normal: Floats) -> Floats:
    """Return the matrix (q, q) from axes of the scene to N, V, M, or N, V1, V2, M1, M2, MT, of a face."""
    # normal: (d,) unit normal, maybe opposite to the face's own; e1 and e2 stay the face's.
    joints, d = assembly.interfaces, assembly.dimension
    if d == 2:
        return np.array([[normal[0], normal[1], 0.0], [-normal[1], normal[0], 0.0], [0.0, 0.0, 1.0]])
    frame = np.stack([normal, joints.e1[face], joints.e2[face]])
    axes = np.zeros((6, 6))
    axes[:3, :3], axes[3:, 3:] = frame, frame[[1, 2, 0]]
    return axes


def words_of_range(resultant_range: ResultantRange, force: str, length: str) -> str:
    """Describe one range in a line, such as "N  1.2 to 3.4 kN"."""
    unit = (
        force
        if resultant_range.resultant.function.unit == 1.0 and resultant_range.resultant.component[0] != "M"
        else f"{force}·{length}"
    )
    ends = []
    for end, name in ((resultant_range.least, "least"), (resultant_range.most, "greatest")):
        if math.isfinite(end.value):
            ends.append(f"{end.value:.6g}" + ("" if end.status == "certified" else " (uncertified)"))
        else:
            ends.append(f"no {name}" if end.status == "unbounded" else "uncertified")
    return f"{resultant_range.resultant.component:<2}  {ends[0]} to {ends[1]} {unit}"


_ROUTE: Final = Route("the geometric reserve")

_WIDTH: Final = 2e-3  # width of the bracket of the share at which its bisection ends

_IDLE: Final = 1e-6  # shear over the largest force of the structure up to which it counts as none


@dataclass(frozen=True)
class Reserve:
    """State in which the faces use the least possible share of their capacity."""

    # proven bounds on the share: with less than the first one there is no state, with the second one there is
    bracket: tuple[float, float]
    forces: Floats  # (m, q) resultants of this state, scene units
    share: Floats  # (m,) share of its capacity that each face uses, 0 to 1
    bending: Floats  # (m,) share of the eccentricity, tension or compression alone
    slip: Floats  # (m,) share of shear and torsion alone; reserve against slip is 1 minus it


@one_thread()
def least_share(assembly: Assembly, labels: Bits) -> Reserve | None:
    """Find the state under the dead load in which faces use the least share of capacity, or None."""
    # Bisection of θ with yield sets whose eccentricities, friction and strengths are θ times those of the faces, which
    # are nested. docs/method.md (3.16).
    require_materials(assembly, labels, ~labels)
    state = _state(assembly, labels, 1.0)
    if state is None:
        return None
    least, high = 0.0, 1.0
    while high - least > _WIDTH:
        middle = 0.5 * (least + high)
        middle_state = _state(assembly, labels, middle)
        if middle_state is None:
            least = middle
        else:
            high, state = middle, middle_state
    refuted = least > 0.0 and LimitAnalysis(shrunk(assembly, least)).stands(labels) is False
    low = least if refuted else 0.0
    forces = state[0].forces * state[1].face
    return _reserve(assembly, labels, (low, high), forces)


def shrunk(assembly: Assembly, share: float) -> Assembly:
    """Return a structure whose faces have a share of their size, friction and strength."""
    # Forces act where they did; members have the share of their capacity.
    faces, strengths = assembly.interfaces, assembly.strengths(_ROUTE)
    members = assembly.of_members
    size = np.where(members, 1.0, share)
    area = size if assembly.dimension == 2 else size**2
    polygon = tuple(
        origin + scale * (corners - origin) if scale < 1.0 else corners
        for corners, origin, scale in zip(faces.polygon, faces.origin, size, strict=True)
    )
    smaller = replace(
        faces,
        l1=faces.l1 * size,
        l2=faces.l2 * (size if assembly.dimension == 3 else 1.0),
        area=faces.area * area,
        polygon=polygon,
    )
    stress = share / area
    weaker = strengths.changed(lambda values: values * stress, lambda mu: mu * share)
    return replace(assembly, interfaces=smaller).with_strengths(weaker)


def _state(assembly: Assembly, labels: Bits, share: float) -> tuple[State, Scaling] | None:
    """Return an admissible state of a shrunk structure with its scaling, None if none is found."""
    analysis = LimitAnalysis(shrunk(assembly, share))
    state = analysis.repair.standing_state(labels)
    return None if state is None else (state, analysis.template.scaling)


def _reserve(assembly: Assembly, labels: Bits, bracket: tuple[float, float], forces: Floats) -> Reserve:
    """Return the shares of capacity that faces use in forces (m, q), with bounds on the least share."""
    scaling = scaling_of(assembly)
    yields = yield_set(assembly, scaling, "uncoupled")
    scaled, friction = forces / scaling.face, yields.associative
    # `turned` has neither shear nor torsion, so that its utilisation is that of bending, tension and compression alone
    turned = scaled.copy()
    turned[:, 1 : assembly.dimension] = 0.0
    turned[:, 5:] = 0.0
    share, bending = yields.utilisation(scaled, labels), yields.utilisation(turned, labels)
    if share is None or bending is None:
        raise ValueError("the yield sets of this structure define no share of capacity")
    shear = friction.shear_of(scaled)
    capacity = friction.capacity_of(labels) + friction.friction_of(labels) * scaled[:, 0]
    slip = np.minimum(used(shear, capacity, _IDLE * float(np.abs(scaled[:, :2]).max(initial=0.0))), 1.0)
    return Reserve(bracket, without_idle(assembly, forces), share, bending, slip)
