"""Least and greatest value of a linear function of forces, in equilibrium with the dead load."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from jld_core import (
    Assembly,
    Bits,
    Floats,
    LimitAnalysis,
    LimitAnalysisResult,
    SolveOptions,
    Status,
    one_thread,
    tolerances,
)
from jld_core.build import loads as built
from jld_core.limit import Proof, number, relative_width
from jld_core.mechanics import Scaling, equilibrium_matrix, reference_load, require_materials, scaling_of, yield_set
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
        whole = None if self.state is None else self.state.to_json()
        return {
            "reaction": number(self.value),
            "bracket": [number(end) for end in self.bracket],
            "gap": number(self.gap),
            "status": self.status,
            "mechanism": None if whole is None else whole["mechanism"],
            "forces": None if whole is None else whole["forces"],
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
    """Create the analysis that maximises λ where R(F) / unit = origin + sign λ."""
    scaling = scaling_of(assembly)
    # Here λ is a force, and scaled like one.
    scaling = Scaling(scaling.force, scaling.face, scaling.row, scaling.force)
    row = (function.weights / function.unit * scaling.face).ravel() / scaling.force
    beside = Beside(row=row, dead=-origin / scaling.force, live=-sign)
    template = Template(assembly, scaling, yield_set(assembly, scaling, "uncoupled"), beside)
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
    found = LimitAnalysisResult(
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
    return Thrust(value, (low, high), width, "certified", found)


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
    own = assembly.labels if labels is None else np.asarray(labels, dtype=bool)
    require_materials(assembly, own, ~own)
    stands = LimitAnalysis(assembly).stands(own)
    least = most = None
    if stands is not False:
        velocity = settlement.velocity
        function = _work_of_reactions(assembly, velocity)
        least, most = (
            extreme_value(assembly, function, own, greatest=greatest, gap=gap, moved=velocity)
            for greatest in (False, True)
        )
    return Settled(settlement, assembly, own, stands, least, most, time.perf_counter() - start)


def reactions(assembly: Assembly, forces: Floats, elements: Floats) -> Floats:
    """Compute the resultants (k, q) of forces (m, q) at faces on elements (k,), about their centroids."""
    matrix, rows = _support_rows(assembly, np.isin(np.arange(len(assembly.elements)), elements))
    found = np.zeros((len(assembly.elements), assembly.freedoms))
    found[rows] = (matrix @ forces.ravel()).reshape(len(rows), -1)
    return np.asarray(found[elements])


def _support_rows(assembly: Assembly, moving: Any) -> tuple[Any, Any]:
    """Build the equilibrium matrix in which some supports (n,) are free; return the free elements too."""
    elements = replace(assembly.elements, support=assembly.elements.support & ~moving)
    return equilibrium_matrix(replace(assembly, elements=elements)), elements.free


def _work_of_reactions(assembly: Assembly, velocity: Floats) -> ForceFunction:
    """Build the function of forces that gives the work rate of supports moving at `velocity` (n, q)."""
    # its unit is the largest speed of a translation
    speed = float(np.linalg.norm(velocity[:, : assembly.dimension], axis=1).max()) or (
        assembly.size * float(abs(velocity).max())
    )
    matrix, rows = _support_rows(assembly, velocity.any(axis=1))
    weights = np.where(assembly.elements.support[:, None], velocity, 0.0)[rows].ravel()
    return ForceFunction((matrix.T @ weights).reshape(-1, assembly.freedoms), speed)
