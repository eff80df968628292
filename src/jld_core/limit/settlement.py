"""Thrust of a structure on supports that move, and the mechanism that follows them.

While supports move along ū at a rate q, the structure resists with R q, where R = Σ ū·(forces that it puts on its
supports). R varies over the states in equilibrium with the dead load. Where supports yield, R decreases to its least
value, that of the mechanism of least resistance. Where supports are forced against the structure, R increases to its
greatest value. Each end is a limit analysis with R in the place of λ: one more row, R(F) ∓ λ = 0, and one more
velocity, q. λ is counted from a reaction that no state reaches, so that it is positive. Both ends have the two bounds
of every λ (docs/method.md (3.3) and "Supports that move").
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.build.settlements import Settlement
from jld_core.limit.analysis import LimitAnalysis
from jld_core.limit.brackets import relative_width
from jld_core.limit.options import SolveOptions
from jld_core.limit.proof import Proof
from jld_core.limit.result import LimitAnalysisResult, number
from jld_core.limit.status import Status
from jld_core.mechanics import Scaling, equilibrium_matrix, require_materials, scaling_of, yield_set
from jld_core.mechanics.scaling import reference_load
from jld_core.program import Template
from jld_core.program.template import Beside
from jld_core.threads import one_thread

_REACHES: Final = (2.0, 32.0, 1024.0)
"""Reactions from which λ is counted, in weights of the structure; the first one that no state reaches is used."""


@dataclass(frozen=True)
class Thrust:
    """Least or greatest thrust after a support movement.

    Attributes
    ----------
    value : float
        R, work of the reactions per unit of movement, scene units; NaN where there is no end.
    bracket : (float, float)
        Proven bounds on R, NaN where unproven.
    gap : float
        Width of the bracket over max(|R|, 1e-3 · weight · speed).
    status : str
        "certified" (bracket narrow enough), "unbounded" or "uncertified".
    state : LimitAnalysisResult or None
        Forces at this end and the mechanism, supports included; its λ is R. None where there is no end.
    """

    value: float
    bracket: tuple[float, float]
    gap: float
    status: str
    state: LimitAnalysisResult | None

    def to_json(self) -> dict[str, Any]:
        """Return this end of the range as plain numbers.

        Returns
        -------
        dict
            Reaction, bracket, gap, status, mechanism and forces in the form of `jld solve --json`; None where missing.
        """
        whole = None if self.state is None else self.state.to_json()
        return {
            "reaction": number(self.value),
            "bracket": [number(end) for end in self.bracket],
            "gap": number(self.gap),
            "status": self.status,
            "mechanism": None if whole is None else whole["mechanism"],
            "forces": None if whole is None else whole["forces"],
        }


@dataclass(frozen=True)
class Settled:
    """Range of thrust after a support movement.

    Attributes
    ----------
    settlement : Settlement
        The support movement.
    assembly : Assembly
        The structure under its dead load, with the settlement's share of live load added.
    labels : (m,) bool array
        Labels, True = dry.
    stands : bool or None
        Whether the structure stands under this load; None where undecided.
    least, most : Thrust or None
        Ends of the range of R; None if the structure does not stand.
    seconds : float
        Wall-clock time.
    """

    settlement: Settlement
    assembly: Assembly
    labels: Bits
    stands: bool | None
    least: Thrust | None
    most: Thrust | None
    seconds: float

    def to_json(self) -> dict[str, Any]:
        """Return the object that `jld settlement --json` prints for each settlement.

        Returns
        -------
        dict
            Name, moved supports with their velocities, load, whether it stands, and both ends of the range.
        """
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
    assembly: Assembly, settlement: Settlement, labels: Bits | None = None, *, gap: float = tolerances.GAP
) -> Settled:
    """Compute the range of thrust after a support movement, and the mechanisms at its ends.

    The model has associative friction and convex contact.

    Parameters
    ----------
    assembly : Assembly
        Structure, analysed under its dead load; of several load cases the first counts.
    settlement : Settlement
        Velocities of the supports, and the factor of the live load that is added to the dead load.
    labels : (m,) bool array or None
        Labels, True = dry. Default: those of the assembly.
    gap : float
        Relative width of a bracket up to which an end counts as certified.

    Returns
    -------
    Settled
        Range of thrust with its mechanisms.

    Raises
    ------
    InputError
        If a material that the labelling needs is missing, or the assembly has members.
    """
    assembly.members.refuse("the range of reactions under a movement of supports")
    start = time.perf_counter()
    assembly = assembly.by_case[0]
    if settlement.load:
        assembly = replace(assembly, dead=assembly.dead + settlement.load * assembly.live)
    own = assembly.labels if labels is None else np.asarray(labels, dtype=bool)
    require_materials(assembly, own, ~own)
    stands = LimitAnalysis(assembly).stands(own)
    least = most = None
    if stands is not False:
        least, most = (_end(assembly, settlement, own, gap, sign) for sign in (-1.0, 1.0))
    return Settled(settlement, assembly, own, stands, least, most, time.perf_counter() - start)


def reactions(assembly: Assembly, forces: Floats, elements: Floats) -> Floats:
    """Compute the resultants of the interface forces on some elements, supports included.

    Parameters
    ----------
    assembly : Assembly
        The structure.
    forces : (m, q) float array
        Resultants of the faces, scene units.
    elements : (k,) int array
        Indices of the elements.

    Returns
    -------
    (k, q) float array
        Force and moment on each element about its centroid, scene units.
    """
    matrix, rows = _support_rows(assembly, np.isin(np.arange(len(assembly.elements)), elements))
    found = np.zeros((len(assembly.elements), assembly.freedoms))
    found[rows] = (matrix @ forces.ravel()).reshape(len(rows), -1)
    return np.asarray(found[elements])


def _support_rows(assembly: Assembly, moving: Any) -> tuple[Any, Any]:
    """Return the equilibrium matrix with some supports set free, and the elements of its rows.

    moving: (n,) True for supports to set free.
    """
    elements = replace(assembly.elements, support=assembly.elements.support & ~moving)
    return equilibrium_matrix(replace(assembly, elements=elements)), elements.free


def _end(assembly: Assembly, settlement: Settlement, labels: Bits, gap: float, sign: float) -> Thrust:
    """Compute the least or the greatest thrust after a support movement.

    The movement is scaled to speed 1 for the solve. labels: (m,) True = dry. gap: relative width of the bracket up to
    which the end counts as certified. sign: −1 for the least, +1 for the greatest.
    """
    speed = float(np.linalg.norm(settlement.velocity[:, : assembly.dimension], axis=1).max()) or (
        assembly.size * float(abs(settlement.velocity).max())
    )
    proof, unit = Proof(), settlement.velocity / speed
    for reach in _REACHES:
        origin = -sign * reach * max(assembly.total_dead, 1e-3 * assembly.total_live)
        analysis = _analysis(assembly, unit, gap, sign, origin)
        proof = analysis.prove(labels)
        if proof.status is not Status.UNSTABLE:
            break
    return _thrust(analysis, proof, settlement, labels, gap, sign, origin, speed)


def _analysis(assembly: Assembly, velocity: Floats, gap: float, sign: float, origin: float) -> LimitAnalysis:
    """Create the analysis that maximises λ where the thrust is R(F) = origin + sign λ.

    velocity: (n, q) of the supports, with speed 1. gap: as in `settle`. sign, origin: see the equation; origin in scene
    units.
    """
    scaling = scaling_of(assembly)
    # Here λ is a force times a speed, scaled like a force.
    scaling = Scaling(scaling.force, scaling.face, scaling.row, scaling.force)
    matrix, rows = _support_rows(assembly, velocity.any(axis=1))
    weights = np.where(assembly.elements.support[:, None], velocity, 0.0)[rows].ravel()
    row = (matrix.T @ weights) * scaling.face.ravel() / scaling.force
    beside = Beside(row=row, dead=-origin / scaling.force, live=-sign)
    template = Template(assembly, scaling, yield_set(assembly, scaling, "uncoupled"), beside)
    analysis = LimitAnalysis(assembly, template=template, gap=gap, solver="clarabel")
    analysis.load_scale = tolerances.GAP_FLOOR * reference_load(assembly) / scaling.force
    return analysis


def _thrust(
    analysis: LimitAnalysis,
    proof: Proof,
    settlement: Settlement,
    labels: Bits,
    gap: float,
    sign: float,
    origin: float,
    speed: float,
) -> Thrust:
    """Convert a proof about scaled λ to an end of the range of thrust.

    labels: (m,) True = dry. gap: as in `settle`. sign, origin: as in `_analysis`. speed: of the movement, scene units.
    """
    assembly, scaling = analysis.assembly, analysis.template.scaling
    if proof.status is Status.LOCKED:
        return Thrust(math.nan, (math.nan, math.nan), math.nan, "unbounded", None)
    ends = [speed * (origin + sign * scaling.load * end) for end in proof.bracket]
    low, high = min(ends), max(ends)
    value = 0.5 * (low + high)
    width = relative_width(low, high, tolerances.GAP_FLOOR * reference_load(assembly) * speed)
    motion, state = proof.motion, proof.state
    if motion is None or state is None or not math.isfinite(value):
        return Thrust(math.nan, (math.nan, math.nan), math.nan, "uncertified", None)
    mechanism = np.zeros_like(settlement.velocity)
    moves = speed * scaling.load * motion.velocity[:-1] / scaling.row.ravel()
    mechanism[assembly.elements.free] = moves.reshape(-1, assembly.freedoms)
    # At the greatest reaction the supports move against the structure.
    mechanism += -sign * settlement.velocity
    certified = width <= gap
    found = LimitAnalysisResult(
        assembly=assembly,
        labels=labels,
        status=Status.COLLAPSE if certified else Status.UNCERTIFIED,
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
    return Thrust(value, (low, high), width, "certified" if certified else "uncertified", found)
