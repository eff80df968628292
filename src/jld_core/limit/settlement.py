"""Supports that are moved: the thrust that is left along the movement, and the mechanism that follows it.

While supports are moved along ū by a rate q, what resists is R q, R = Σ ū·(what the structure puts on its supports).
All states of equilibrium of the dead load leave R a range: where supports give way it falls to its least value, that
of the mechanism of least resistance, and where they are forced against the structure it rises to its greatest. Each end
is a limit analysis with R in the place of λ: one more row, R(F) ∓ λ = 0 with λ counted from a reaction out of reach, so
that it is positive, and one more velocity, q. Bounds are those of every λ (docs/method.md (3.15)).
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
from jld_core.build import Settlement
from jld_core.limit.analysis import LimitAnalysis
from jld_core.limit.bounds import relative_width
from jld_core.limit.options import SolveOptions
from jld_core.limit.proof import Proof
from jld_core.limit.result import LimitAnalysisResult, number
from jld_core.limit.status import Status
from jld_core.mechanics import (
    Scaling,
    equilibrium_matrix,
    reference_load,
    require_materials,
    scaling_of,
    yield_set,
)
from jld_core.program import Beside, Template
from jld_core.threads import one_thread

_REACHES: Final = (2.0, 32.0, 1024.0)
"""Reactions that λ is counted from, in weights of the structure, the first that is out of reach being taken."""


@dataclass(frozen=True)
class Thrust:
    """One end of the range.

    value: R, work of the reactions for a unit of movement. bracket: (lo, hi), NaN where unproven. gap: its width over
    max(|R|, 1e-3 · weight · speed). status: "certified", "unbounded" or "uncertified". state: the labelling with forces
    at this end and the mechanism (supports with it), λ being R; None where there is no end.
    """

    value: float
    bracket: tuple[float, float]
    gap: float
    status: str
    state: LimitAnalysisResult | None

    def to_json(self) -> dict[str, Any]:
        """Plain numbers, None where there is none; forces as `jld solve --json` has them."""
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
    """What a settlement leaves. stands: whether the dead load stands at all; then least and most are the range of R."""

    settlement: Settlement
    assembly: Assembly
    labels: Bits
    stands: bool | None
    least: Thrust | None
    most: Thrust | None
    seconds: float

    def to_json(self) -> dict[str, Any]:
        """The object that `jld settlement --json` prints for each."""
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
    """The range of thrust that a settlement leaves, and the mechanisms at its ends; associative, convex contact.

    assembly: its dead load, with cases that of the first. labels: (m,) True dry; default the scene's own. gap: relative
    width that certifies an end. Raises InputError where a material that the labelling needs is missing.
    """
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
    """(k, q) what interfaces put on some elements (k,), supports too, about their centroids. forces: (m, q)."""
    matrix, rows = _support_rows(assembly, np.isin(np.arange(len(assembly.elements)), elements))
    found = np.zeros((len(assembly.elements), assembly.freedoms))
    found[rows] = (matrix @ forces.ravel()).reshape(len(rows), -1)
    return np.asarray(found[elements])


def _support_rows(assembly: Assembly, moving: Any) -> tuple[Any, Any]:
    """Equilibrium rows with some supports set free, and the elements they are of."""
    elements = replace(assembly.elements, support=assembly.elements.support & ~moving)
    return equilibrium_matrix(replace(assembly, elements=elements)), elements.free


def _end(assembly: Assembly, settlement: Settlement, labels: Bits, gap: float, sign: float) -> Thrust:
    """The least (sign −1) or the greatest (+1) reaction, sought at a speed of one, whatever that of the movement."""
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
    """max λ with R(F) = origin + sign λ."""
    scaling = scaling_of(assembly)
    # λ is a force times a speed here, and has the scale of forces
    scaling = Scaling(scaling.force, scaling.face, scaling.row, scaling.force)
    matrix, rows = _support_rows(assembly, velocity.any(axis=1))
    weights = np.where(assembly.elements.support[:, None], velocity, 0.0)[rows].ravel()
    row = (matrix.T @ weights) * scaling.face.ravel() / scaling.force
    beside = Beside(row=row, dead=-origin / scaling.force, live=-sign)
    template = Template(assembly, scaling, yield_set(assembly, scaling, "paper"), beside)
    analysis = LimitAnalysis(assembly, template=template, gap=gap, solver="clarabel")
    analysis.floor = tolerances.GAP_FLOOR * reference_load(assembly) / scaling.force
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
    # the movement at the greatest reaction is against the supports
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
        route=tuple(proof.route),
        seconds={"assemble": analysis.seconds, "solve": proof.seconds, "total": analysis.seconds + proof.seconds},
        model=SolveOptions(gap=gap),
    )
    return Thrust(value, (low, high), width, "certified" if certified else "uncertified", found)
