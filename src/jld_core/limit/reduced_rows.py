"""Programs reduced to the rows whose multipliers may be non-zero beside a self-stress."""

from __future__ import annotations

import copy
from dataclasses import dataclass, field

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from jld_core import tolerances
from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.limit.auxiliary_programs import LargestSupport, slack_rows
from jld_core.linalg.projection import Projector
from jld_core.program import ConicProgram, Template, pack


@dataclass(frozen=True)
class Reduced:
    """Yield rows left after facial reduction, which alone may have multipliers beside a self-stress."""

    linear: Ints  # (k,) linear inequalities that are kept, as rows of the program
    cones: tuple[int, ...]  # indices of the cones that are kept
    # for each cone, by index, whose multipliers are only a ray: the direction of the self-stress in it, a unit vector
    rays: dict[int, Floats] = field(default_factory=dict)


def kept_rows(program: ConicProgram) -> Reduced:
    """Return all yield rows but that of λ, from which facial reduction starts."""
    s = program.structure
    return Reduced(slack_rows(s)[: s.linear - 1], tuple(range(len(s.cones))))


def program_of_rows(program: ConicProgram, reduced: Reduced, right: bool = False) -> ConicProgram:
    """Return a program with the yield rows of `reduced` alone; right: False sets their right-hand sides to zero."""
    # The new rows are the equations, the row that bounds λ, the kept inequalities, one inequality s₀ ≥ d·s for each ray
    # of direction d, and the kept cones. Here s₀ is the first slack of the cone, s are the others.
    s = program.structure
    first = np.concatenate([np.arange(s.equalities + 1), reduced.linear]).astype(np.int64)
    cones = [np.arange(s.heads[cone], s.heads[cone] + s.cones[cone]) for cone in reduced.cones]
    last = np.concatenate(cones or [np.empty(0)]).astype(np.int64)
    pick = [sp.eye_array(s.shape[0]).tocsr()[first]]
    if reduced.rays:
        ways = sp.lil_array((len(reduced.rays), s.shape[0]))
        for row, (cone, direction) in enumerate(reduced.rays.items()):
            ways[row, s.heads[cone]] = 1.0
            for place, value in enumerate(direction, start=1):
                ways[row, s.heads[cone] + place] = -value
        pick.append(ways.tocsr())
    chosen: sp.csr_array = sp.vstack([*pick, sp.eye_array(s.shape[0]).tocsr()[last]]).tocsr()
    rhs = np.asarray(chosen @ program.rhs) if right else np.zeros(chosen.shape[0])
    linear = 1 + len(reduced.linear) + len(reduced.rays)
    sizes = tuple(s.cones[cone] for cone in reduced.cones)
    return pack(chosen @ program.matrix.tocsr(), rhs, program.objective, s.equalities, linear, sizes, s.places)


def leaning_program(program: ConicProgram, reduced: Reduced, stress: Floats) -> ConicProgram:
    """Return the program of forces that are admissible once a large self-stress (columns,) is added."""
    # The program is `program_of_rows` with one more cone for each ray, docs/method.md (3.12a). In a cone on whose
    # boundary the self-stress R lies, along d, let V be the shear and t its bound. The forces then keep s (2 |R|) ≥ |V
    # across d|², where s = t − d·V.
    left = program_of_rows(program, reduced, right=True)
    s, matrix, own = program.structure, program.matrix.tocsr(), left.structure
    rows, ends = [left.matrix.tocsr()], [left.rhs]
    last = own.equalities + own.linear - len(reduced.rays)
    for number, (cone, way) in enumerate(reduced.rays.items()):
        at = slice(s.heads[cone], s.heads[cone] + s.cones[cone])
        touch, end = left.matrix.tocsr()[[last + number]], left.rhs[last + number]
        size = float(-(matrix[[s.heads[cone]]][:, : len(stress)] @ stress)[0])
        across = sp.csr_array(la.null_space(way[None]).T) * (2.0 / np.sqrt(2.0 * size))
        rows += [touch, across @ matrix[at][1:], touch]
        ends += [np.array([end + 1.0]), np.asarray(across @ program.rhs[at][1:]), np.array([end - 1.0])]
    sizes = own.cones + tuple(s.cones[cone] for cone in reduced.rays)
    tall = sp.vstack(rows)
    return pack(tall, np.concatenate(ends), program.objective, own.equalities, own.linear, sizes, own.places)


def reduced_by(found: LargestSupport, program: ConicProgram, reduced: Reduced) -> Reduced | None:
    """Return the yield rows that are left once a large self-stress acts; None if all are."""
    # Rows in which the self-stress has slack are removed. A cone on whose boundary it lies becomes a ray.
    sizes = [program.structure.cones[cone] for cone in reduced.cones]
    linear = len(reduced.linear) + len(reduced.rays)
    loose: Bools = found.slack > 0.5
    kept = reduced.linear[~loose[: len(reduced.linear)]]
    turned = dict(zip(reduced.rays, loose[len(reduced.linear) : linear], strict=True))
    rays = {cone: way for cone, way in reduced.rays.items() if not turned[cone]}
    cones = []
    starts = len(found.values) - sum(sizes) + np.cumsum([0, *sizes])[:-1]
    for cone, start, size, free in zip(reduced.cones, starts, sizes, loose[linear:], strict=True):
        if free:
            continue
        way = found.boundary_direction(start, size)
        if way is None:
            cones.append(cone)
        else:
            rays[cone] = way
    if len(kept) == len(reduced.linear) and len(cones) == len(reduced.cones) and len(rays) == len(reduced.rays):
        return None
    return Reduced(kept, tuple(cones), rays)


def rows_by_element(rows: Floats, freedoms: int) -> Floats:
    """Reshape a vector (q·free,) to (free, q); each further entry gets a row of its own."""
    whole = len(rows) // freedoms * freedoms
    more = np.zeros((len(rows) - whole, freedoms))
    more[:, 0] = rows[whole:]
    return np.concatenate([rows[:whole].reshape(-1, freedoms), more])


def projected_onto(projector: Projector, vector: Floats, target: Floats, passes: int) -> tuple[Floats, Floats, float]:
    """Project a vector (columns,) onto rows·y = target: vector, residual (rows,), error estimate."""
    for _ in range(passes):
        vector = vector - projector.correction(projector.rows @ vector - target)
    left = projector.rows @ vector - target
    return vector, left, float(abs(projector.correction(left)).max())


def error_or_inf(error: float, left: Floats, forces: Floats) -> float:
    """Return an error estimate, or inf if the residual (rows,) exceeds rounding, so no equilibrium exists."""
    much = float(abs(left).max()) > tolerances.ROUNDING * max(1.0, float(abs(forces).max()))
    return np.inf if much else error


def usable(vector: Floats) -> bool:
    """Return True if a vector is below 1e30, unlike those that a failed solve may leave."""
    return not vector.size or bool(abs(vector).max() < 1e30)


class EquilibriumProjectors:
    """Cached projectors onto the equilibrium of one template, for each set of kept resultants."""

    def __init__(self, template: Template) -> None:
        self.template = template
        self._known: dict[bytes, Projector] = {}
        self._everything = np.ones((len(template.assembly.interfaces), template.assembly.freedoms), dtype=bool)

    def with_template(self, template: Template) -> EquilibriumProjectors:
        """Return these projectors for another template of the same equilibrium matrix, cache shared."""
        other = copy.copy(self)
        other.template = template
        return other

    def with_load(self, labels: Bits) -> tuple[Projector, Floats | None]:
        """Return the projector of the resultants that a labelling keeps, and their mask (q·m,); None: all."""
        active = self.template.yield_set.active(labels)
        if active.all():
            active = self._everything
        key = np.packbits(active).tobytes()
        mask = None if active is self._everything else active.ravel().astype(float)
        if key not in self._known:
            matrix, places = self.template.matrix, self.template.structure.places
            if mask is not None:
                places = None
                live = sp.csc_array(self.template.live[:, None])
                matrix = sp.csc_array(sp.hstack([matrix @ sp.diags_array(mask), live]))
            if len(self._known) >= 16:
                self._known.pop(next(iter(self._known)))
            self._known[key] = Projector(sp.csc_array(matrix), places)
        return self._known[key], mask

    def of_forces(self, mask: Floats) -> Projector:
        """Return a new projector onto equilibrium at fixed λ, of the kept resultants (q·m,)."""
        return Projector(sp.csc_array(self.template.matrix @ sp.diags_array(mask)), self.template.structure.places)
