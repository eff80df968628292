"""Thrust of a structure on supports that move, and the mechanism that follows them.

While supports move along ū at a rate q, the structure resists with R q, where R = Σ ū·(forces that it puts on its
supports). R varies over the states in equilibrium with the dead load. Where supports yield, R decreases to its least
value, that of the mechanism of least resistance. Where supports are forced against the structure, R increases to its
greatest value (`force_range`).
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.build.settlements import Settlement
from jld_core.limit.analysis import LimitAnalysis
from jld_core.limit.force_range import ForceFunction, Thrust, extreme_value
from jld_core.mechanics import equilibrium_matrix, require_materials
from jld_core.threads import one_thread


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
        True if the structure stands under this load, False if not; None where undecided.
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

    assembly: structure, analysed under its dead load; of several load cases the first counts. settlement: velocities of
    the supports, and the factor of the live load that is added to the dead load. labels: (m,) labels, True = dry.
    Default: those of the assembly. gap: relative width of a bracket up to which an end counts as certified. Raises
    InputError if a material that the labelling needs is missing, or the assembly has members.
    """
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
    """Compute the resultants of the interface forces on some elements, supports included.

    assembly: the structure. forces: (m, q) resultants of the faces, scene units. elements: (k,) indices of the
    elements. Returns (k, q): force and moment on each element about its centroid, scene units.
    """
    matrix, rows = _support_rows(assembly, np.isin(np.arange(len(assembly.elements)), elements))
    found = np.zeros((len(assembly.elements), assembly.freedoms))
    found[rows] = (matrix @ forces.ravel()).reshape(len(rows), -1)
    return np.asarray(found[elements])


def _support_rows(assembly: Assembly, moving: Any) -> tuple[Any, Any]:
    """Build the equilibrium matrix in which some supports count as free elements.

    moving: (n,) True for these supports. Returns the matrix (q·free, q·m) and the free elements (free,), in the order
    of its rows.
    """
    elements = replace(assembly.elements, support=assembly.elements.support & ~moving)
    return equilibrium_matrix(replace(assembly, elements=elements)), elements.free


def _work_of_reactions(assembly: Assembly, velocity: Floats) -> ForceFunction:
    """Build the function of forces that gives the work rate of moving supports.

    velocity: (n, q) of all elements about their centroids; only supports count. The unit of the function is the largest
    speed of a translation.
    """
    speed = float(np.linalg.norm(velocity[:, : assembly.dimension], axis=1).max()) or (
        assembly.size * float(abs(velocity).max())
    )
    matrix, rows = _support_rows(assembly, velocity.any(axis=1))
    weights = np.where(assembly.elements.support[:, None], velocity, 0.0)[rows].ravel()
    return ForceFunction((matrix.T @ weights).reshape(-1, assembly.freedoms), speed)
