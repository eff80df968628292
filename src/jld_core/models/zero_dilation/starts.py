"""Starting states for the search for low and high collapse loads without dilation.

The module also certifies the solutions that are found.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from jld_core.arrays import Floats
from jld_core.limit import Proof, State, Status
from jld_core.models.zero_dilation.fixed_point_search import FixedPointSearch
from jld_core.models.zero_dilation.primal_dual_pair import PrimalDualPair
from jld_core.program import ConicProgram
from jld_core.solvers import ClarabelSolver, HighsSolver, RawSolution, RawStatus

_STEPS: Final = 20  # Number of steps of the load path. A step without a state is halved, at most four times in all.

_SLOPE: Final = -0.01  # share of the present N in friction; negative: friction decreases as N grows

_RELAXED: Final = 0.6  # weight of the new N in the updated N that determines friction

_FALLS: Final = 15  # maximum number of programs with friction that decreases with N

# Least and largest number of alternations between mechanism and forces from a state of low compression
_TURNS: Final = (2, 4)

# Maximum number of rounds that match forces with the last mechanism and a mechanism with these forces
_MATCHES: Final = 3

# Mean of the random increase of resistances that selects a mechanism, for scaled forces of order one
_DRAWN: Final = 1e-3


def starts(search: FixedPointSearch, associative: Proof, thorough: bool = True) -> Iterator[Floats]:
    """Yield the scaled forces (q·m,) from which searches start, the most useful first.

    search: supplies labels and solvers, and counts programs. associative: associative proof of the labelling. thorough:
    also yield starts that need more programs.
    """
    first = initial_forces(search, associative, "associative")
    yield first
    gravity = initial_forces(search, associative, "gravity")
    yield gravity
    if thorough:
        yield forces_along_load_path(search, gravity, associative.load_factor)
        yield forces_of_decreasing_friction(search, first)


def initial_forces(search: FixedPointSearch, associative: Proof, start: str) -> Floats:
    """Return the scaled forces (q·m,) of a named start: "associative", "vertex" or "gravity".

    "associative": forces of the associative solution. "vertex": a vertex of the associative problem. "gravity": the
    state of least forces at λ = 0. If the vertex program fails, or gravity has no state, the associative forces are
    used, and zero forces if there are none. search: supplies labels and solvers, and counts programs.
    """
    labels, template = search.labels, search.analysis.template
    if start == "vertex":
        search.solves += 1
        raw = HighsSolver().solve(template.program(labels))
        if raw.status is RawStatus.OPTIMAL:
            return raw.point[: search.count]
    # The associative forces of a locked assembly are arbitrary.
    if start == "gravity" or associative.status is Status.LOCKED:
        raw = _nearest(search, np.zeros(search.count), 0.0)
        if raw.status is RawStatus.OPTIMAL:
            return raw.point[: search.count]
    return np.zeros(search.count) if associative.state is None else associative.state.forces.ravel()


def forces_along_load_path(search: FixedPointSearch, gravity: Floats, most: float) -> Floats:
    """Follow a load path from gravity in steps of λ; return the forces (q·m,) at its end.

    Each state is the nearest to the previous one, as in distinct element analysis, where the final state depends on the
    load path. The path ends where no further state is found. search: supplies labels and programs. gravity: (q·m,)
    scaled forces at λ = 0. most: scaled λ above which no state exists, NaN if unknown.
    """
    forces, load = gravity, 0.0
    step = (most if most > 0.0 else 1.0) / _STEPS
    least = step / 16.0
    for _ in range(2 * _STEPS):
        raw = _nearest(search, forces, load + step)
        if raw.status in (RawStatus.OPTIMAL, RawStatus.ALMOST):
            forces, load = raw.point[: search.count], load + step
        elif step > least:
            step *= 0.5
        else:
            break
    return forces


def _nearest(search: FixedPointSearch, forces: Floats, load: float) -> RawSolution:
    """Find the state of equilibrium at one scaled λ that is nearest to given forces.

    forces: (q·m,) scaled. load: the scaled λ. search: supplies labelling and program.
    """
    near = ClarabelSolver(search.analysis.template.precision.residual, proximal=(search.count, 1.0))
    return near.solve(_at_load(search, load), forces)


def _at_load(search: FixedPointSearch, load: float) -> ConicProgram:
    """Build the program of all admissible states at one scaled λ, given by `load`.

    λ moves from the unknowns of equilibrium to its right-hand side; its free column is minimised alone. search:
    supplies labelling and program, and counts it.
    """
    template = search.analysis.template
    program = template.program(search.labels, search.margin)
    s = program.structure
    data, objective, rhs = program.data.copy(), np.zeros(s.shape[1]), program.rhs.copy()
    column = slice(s.indptr[-2], s.indptr[-1])
    data[column] = np.where(s.indices[column] < s.equalities, 0.0, data[column])
    rhs[: s.equalities] -= load * template.live
    objective[-1] = 1.0
    search.solves += 1
    return ConicProgram(s, data, rhs, objective)


def forces_of_decreasing_friction(search: FixedPointSearch, forces: Floats) -> Floats:
    """Iterate with friction that decreases as N grows; return the final forces (q·m,).

    This removes thrust that the mechanism does not need. forces: (q·m,) scaled start. Iterations end early where a
    program fails.
    """
    previous = search.normals(forces)
    for _ in range(_FALLS):
        template, _ = search.freeze_friction(_SLOPE, previous, search.areas(forces))
        raw = search.solver.solve(template.program(search.labels, search.margin))
        search.solves += 1
        if raw.status not in (RawStatus.OPTIMAL, RawStatus.ALMOST):
            break
        forces = raw.point[: search.count]
        previous = np.maximum(_RELAXED * search.normals(forces) + (1.0 - _RELAXED) * previous, 0.0)
    return forces


def low_compression_states(search: FixedPointSearch, load: float, rng: np.random.Generator) -> PrimalDualPair | None:
    """Search for a solution from a state of low compression on random faces.

    Every solution has the λ of its own frozen friction, which grows with N: faces without compression do not resist.
    From a state at the scaled λ `load`, a mechanism of the frozen friction and the lowest forces for it are computed in
    turn. The result is the pair reached, which need not be a solution; None where a program fails. rng: draws faces and
    mechanisms.
    """
    program = _at_load(search, load)
    freedoms = search.analysis.template.assembly.freedoms
    program.objective[: search.count : freedoms] = rng.exponential(size=len(search.labels))
    raw = search.solver.solve(program)
    if raw.status not in (RawStatus.OPTIMAL, RawStatus.ALMOST):
        return None
    forces = raw.point[: search.count]
    turns = int(rng.integers(*_TURNS, endpoint=True))
    for turn in range(turns):
        drawn = rng.exponential(scale=_DRAWN, size=program.structure.linear)
        raw = search.mechanism(forces, drawn if turn + 1 < turns else None)
        if raw.status not in (RawStatus.OPTIMAL, RawStatus.ALMOST):
            return None
        state = search.lowest_state(forces, raw.dual)
        forces = state.forces.ravel()
    pair = search.evaluate_pair(state, None)
    for _ in range(_MATCHES):
        if pair.motion is None or pair.is_solution(search.analysis.gap):
            break
        pair = search.evaluate_pair(search.minimise_gap(pair.state.forces.ravel(), pair.motion.velocity, None), None)
    return pair


def repair_and_evaluate(search: FixedPointSearch, point: Floats) -> PrimalDualPair:
    """Move a point into the true friction cone where possible, and evaluate it as a pair.

    point: (q·m + 1,) scaled forces and λ.
    """
    areas = search.areas(point)
    state: State = search.repaired_state(point, search.analysis.template, areas)
    return search.evaluate_pair(state, areas)
