"""Where the search for low and high collapse loads without dilation begins, and how one found is certified."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from jld_core.arrays import Floats
from jld_core.limit import Proof, State, Status
from jld_core.models.zero_dilation.search import FixedPointSearch, PrimalDualPair
from jld_core.program import ConicProgram
from jld_core.solvers import ClarabelSolver, HighsSolver, RawSolution, RawStatus

_STEPS: Final = 20  # of the load path, halved four times where one finds no state
_SLOPE: Final = -0.01  # share of the present N in friction, negative: friction falls as N grows
_RELAXED: Final = 0.6  # share of the new N in the N that friction goes by
_FALLS: Final = 15  # programs with that slope
_TURNS: Final = (2, 4)  # from states of little pressure, of mechanism and forces, at least and most
_MATCHES: Final = 3  # of forces with the last mechanism and of a mechanism with those, until they agree
_DRAWN: Final = 1e-3  # mean of what draws a mechanism, in scaled forces of order one


def starts(search: FixedPointSearch, associative: Proof, thorough: bool = True) -> Iterator[Floats]:
    """Scaled forces (q·m,) to search from, most telling first; thorough: also those that cost more programs."""
    first = first_forces(search, associative, "associative")
    yield first
    gravity = first_forces(search, associative, "gravity")
    yield gravity
    if thorough:
        yield along_the_load(search, gravity, associative.load_factor)
        yield falling_friction(search, first)


def first_forces(search: FixedPointSearch, associative: Proof, start: str) -> Floats:
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


def along_the_load(search: FixedPointSearch, gravity: Floats, most: float) -> Floats:
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


def _nearest(search: FixedPointSearch, forces: Floats, load: float) -> RawSolution:
    """The state at a given λ nearest to given forces: λ leaves equilibrium for the right-hand side."""
    near = ClarabelSolver(search.analysis.template.precision.residual, proximal=(search.count, 1.0))
    return near.solve(_at_load(search, load), forces)


def _at_load(search: FixedPointSearch, load: float) -> ConicProgram:
    """The program of states at a given λ, without an objective in forces."""
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


def falling_friction(search: FixedPointSearch, forces: Floats) -> Floats:
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


def low_compression_states(search: FixedPointSearch, load: float, rng: np.random.Generator) -> PrimalDualPair | None:
    """A pair from the state at a given λ that presses least on faces drawn at random; None where there is none.

    Every solution has the λ of its own frozen friction, which rises with N: where faces carry nothing, they resist
    nothing. From there mechanisms of the frozen friction and the lowest forces of each follow one another.
    """
    program = _at_load(search, load)
    freedoms = search.analysis.template.assembly.freedoms
    program.objective[: search.count : freedoms] = rng.exponential(size=len(search.labels))
    raw = search.route.solve(program)
    if raw.status not in (RawStatus.OPTIMAL, RawStatus.ALMOST):
        return None
    forces = raw.point[: search.count]
    turns = int(rng.integers(*_TURNS, endpoint=True))
    for turn in range(turns):
        drawn = rng.exponential(scale=_DRAWN, size=program.structure.linear)
        raw = search.mechanism(forces, drawn if turn + 1 < turns else None)
        if raw.status not in (RawStatus.OPTIMAL, RawStatus.ALMOST):
            return None
        state = search.lowest(forces, raw.dual)
        forces = state.forces.ravel()
    pair = search.judge(state, None)
    for _ in range(_MATCHES):
        if pair.motion is None or pair.solves(search.analysis.gap):
            break
        pair = search.judge(search.least_gap(pair.state.forces.ravel(), pair.motion.velocity, None), None)
    return pair


def certified(search: FixedPointSearch, point: Floats) -> PrimalDualPair:
    """A pair for forces and λ (q·m + 1,): moved inside the true cone where they stand on its edge, then judged."""
    areas = search.areas(point)
    state: State = search.admissible(point, search.analysis.template, areas)
    return search.judge(state, areas)
