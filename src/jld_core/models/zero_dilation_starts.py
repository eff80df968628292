"""Where the search for low and high collapse loads without dilation begins, and how one found is certified."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from jld_core.arrays import Floats
from jld_core.limit import Proof, State, Status
from jld_core.models.zero_dilation_search import Pair, PairSearch
from jld_core.program import ConicProgram
from jld_core.solvers import ClarabelSolver, HighsSolver, RawSolution, RawStatus

_STEPS: Final = 20  # of the load path, halved four times where one finds no state
_SLOPE: Final = -0.01  # share of the present N in friction, negative: friction falls as N grows
_RELAXED: Final = 0.6  # share of the new N in the N that friction goes by
_FALLS: Final = 15  # programs with that slope


def starts(search: PairSearch, associative: Proof, thorough: bool = True) -> Iterator[Floats]:
    """Scaled forces (q·m,) to search from, most telling first; thorough: also those that cost more programs."""
    first = first_forces(search, associative, "associative")
    yield first
    gravity = first_forces(search, associative, "gravity")
    yield gravity
    if thorough:
        yield along_the_load(search, gravity, associative.load_factor)
        yield falling_friction(search, first)


def first_forces(search: PairSearch, associative: Proof, start: str) -> Floats:
    """Forces to start from, scaled (q·m,): those of "associative" friction, of one "vertex" of it, or of "gravity"."""
    labels, template = search.labels, search.analysis.template
    if start == "vertex":
        search.solves += 1
        raw = HighsSolver().solve(template.program(labels))
        if raw.status is RawStatus.OPTIMAL:
            return raw.point[: search.count]
    # associative forces of a locked assembly may be anything
    if start == "gravity" or associative.status is Status.LOCKED:
        raw = _nearest(search, np.zeros(search.count), 0.0)
        if raw.status is RawStatus.OPTIMAL:
            return raw.point[: search.count]
    return np.zeros(search.count) if associative.state is None else associative.state.forces.ravel()


def along_the_load(search: PairSearch, gravity: Floats, most: float) -> Floats:
    """Forces at the end of a path from those of gravity: λ grows by steps, each state the nearest to the last.

    most: λ beyond which there are no states, scaled; NaN where that is not known. Distinct elements go such a path:
    the state that a structure reaches depends on the way there.
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


def _nearest(search: PairSearch, forces: Floats, load: float) -> RawSolution:
    """The state at a given λ nearest to given forces: λ leaves equilibrium for the right-hand side."""
    template = search.analysis.template
    program = template.program(search.labels, search.margin)
    s = program.structure
    data, objective, rhs = program.data.copy(), np.zeros(s.shape[1]), program.rhs.copy()
    column = slice(s.indptr[-2], s.indptr[-1])
    data[column] = np.where(s.indices[column] < s.equalities, 0.0, data[column])
    rhs[: s.equalities] -= load * template.live
    objective[-1] = 1.0
    search.solves += 1
    near = ClarabelSolver(template.precision.residual, proximal=(search.count, 1.0))
    return near.solve(ConicProgram(s, data, rhs, objective), forces)


def falling_friction(search: PairSearch, forces: Floats) -> Floats:
    """Forces to which friction that falls with N leads: thrust that a mechanism does not need is given up."""
    previous = search.normals(forces)
    for _ in range(_FALLS):
        template, _ = search.frozen(_SLOPE, previous, search.areas(forces))
        raw = search.route.solve(template.program(search.labels, search.margin))
        search.solves += 1
        if raw.status not in (RawStatus.OPTIMAL, RawStatus.ALMOST):
            break
        forces = raw.point[: search.count]
        previous = np.maximum(_RELAXED * search.normals(forces) + (1.0 - _RELAXED) * previous, 0.0)
    return forces


def certified(search: PairSearch, point: Floats) -> Pair:
    """A pair for forces and λ (q·m + 1,): moved inside the true cone where they stand on its edge, then judged."""
    areas = search.areas(point)
    state: State = search.admissible(point, search.analysis.template, areas)
    return search.judge(state, areas)
