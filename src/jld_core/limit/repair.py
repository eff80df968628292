"""States well inside all yield sets, motions that open every joint they may, rays: what repairs are made with.

These are small programs of their own, solved only where the first answer does not prove itself.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from jld_core import tolerances
from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.limit.auxiliary_programs import least_multipliers, of_columns, tips_of, with_slack
from jld_core.limit.bounds import Motion, Prover, State, usable
from jld_core.program import ConicProgram, Structure, Template, beginnings, pack
from jld_core.solvers import RawSolution, auxiliary, is_large

_DENSE = 4000  # velocities up to which the facial reduction is done with dense algebra
_ROUNDED = 1e-9  # rounding of jumps, times the largest live load, that a motion may have for each unit of live work
_LEAST_SLACK = 1e-5  # slack, scaled, that every row can have at once if it can have any
_TIMES = (1.0, 10.0, 100.0)  # how many times faster courses part than what stands in them
_OPENS = 1e-6  # margin, of speeds up to 1, above which a plain motion counts as opening


class Repair:
    """Auxiliary programs of one template."""

    def __init__(self, template: Template, prover: Prover) -> None:
        self.template, self.prover = template, prover
        self._opening: Motion | None = None
        self._opening_known = False
        self._deepest_key: bytes | None = None
        self._deepest: RawSolution | None = None
        self._magnitudes = abs(template.matrix)

    # --- states -----------------------------------------------------------------------------------------

    def state(self, labels: Bits) -> State | None:
        """The state of largest slack at any λ, or None where it is not admissible."""
        state = self.prover.state(self._deepest_answer(labels).point[: self.template.columns], labels, passes=3)
        return state if state.admissible else None

    def stands(self, labels: Bits) -> bool | None:
        """Is λ = 0 admissible? True with a state, False with a motion that gains energy, None if neither is found."""
        program = with_slack(self.template.program(labels), load_fixed=True)
        # a rough answer will do where the scene stands or falls by a margin, and large scenes are worth the try
        for gap in (1e-2, 1e-8) if is_large(program.structure) else (1e-8,):
            found = self._settled(auxiliary(program, gap), labels)
            if found is not None:
                break
        return found

    def _settled(self, raw: RawSolution, labels: Bits) -> bool | None:
        """What an answer with the largest slack at λ = 0 proves."""
        point = np.append(raw.point[: self.template.columns - 1], 0.0)
        if self.prover.state(point, labels, passes=3, held=True).admissible:
            return True
        motion = self.prover.motion(raw.dual, labels, normalise=False)
        opening = self.opening()
        if motion.margin < 0.0 and opening is not None:
            motion = self.prover.open_up(motion, opening, labels)
        if motion.margin < 0.0:
            motion = self.reduced(motion, labels, normalise=False) or motion
        if motion.margin >= 0.0 and motion.bound < -max(tolerances.ROUNDING, motion.noise):
            return False
        return True if self.edge_state(raw.point, labels, load_fixed=True) is not None else None

    def fall(self, labels: Bits) -> Floats:
        """Velocities (≥ q·free,) that gain energy, raw, where the largest slack at any λ is negative."""
        return self._deepest_answer(labels).dual

    def _deepest_answer(self, labels: Bits) -> RawSolution:
        key = np.packbits(labels).tobytes()
        if self._deepest is None or key != self._deepest_key:
            self._deepest = auxiliary(with_slack(self.template.program(labels)), 1e-4)
            self._deepest_key = key
        return self._deepest

    def edge_state(self, point: Floats | None, labels: Bits, load_fixed: bool = False) -> State | None:
        """A state where some yield rows are equations in disguise (no admissible force leaves them any slack).

        point: (≥ columns,) to start from, without λ where that is fixed at 0; None: from a state that leaves all
        other rows slack. It is projected on equilibrium and those equations together, then blended with such a
        state. Rounding is judged face by face and row by row, by the numbers that meet there.
        """
        program = self.template.program(labels)
        s = program.structure
        if s.shape[1] > _DENSE:
            return None
        columns = s.shape[1] - int(load_fixed)
        answer, slack = self._with_most_slack(program, program.rhs, columns, cap=_LEAST_SLACK)
        tight = self._whole_rows(s, slack < 1e-3 * _LEAST_SLACK)
        rows = np.concatenate([np.arange(s.equalities), tight])
        equations = program.matrix.tocsr()[rows][:, :columns].toarray()
        inverse = np.linalg.pinv(equations, rcond=1e-12)

        def project(y: Floats) -> Floats:
            for _ in range(3):
                y = y - inverse @ (equations @ y - program.rhs[rows])
            return y

        if not usable(answer.point):
            return None
        inside = project(answer.point[:columns])
        start = project(point[:columns]) if point is not None and usable(point) else inside
        edge = np.isin(np.arange(len(labels)), self.template.yield_set.pattern.row_face[tight - s.equalities - 1])
        for share in (0.0, *np.logspace(-13.0, -3.0, 11), 1.0):
            y = (1.0 - share) * start + share * inside
            state = self._state_at_edge(y, labels, edge, 0.0 if load_fixed else float(y[-1]))
            if state is not None:
                return state
        return None

    def _whole_rows(self, s: Structure, tight: Bools) -> Ints:
        """Yield rows of the tips that are tight, a cone with all of its rows."""
        linear = s.linear - 1
        cones = [np.arange(a, a + k) for a, k, at in zip(s.heads, s.cones, tight[linear:], strict=True) if at]
        return np.concatenate([tips_of(s)[:linear][tight[:linear]], *cones]).astype(np.int64)

    def _state_at_edge(self, y: Floats, labels: Bits, edge: Bools, load: float) -> State | None:
        """The state of a projected point, or None where more than rounding is missing to admissibility."""
        template, sets = self.template, self.template.yield_set
        forces = y[: template.matrix.shape[1]].reshape(len(labels), -1)
        forces = np.where(sets.active(labels), forces, 0.0)
        largest = abs(forces).max(axis=1)
        # what a face holds that equations say holds nothing is rounding of forces elsewhere
        forces[edge & (largest <= 1e-2 * tolerances.ROUNDING * max(1.0, float(largest.max())))] = 0.0
        dead, live = template.dead, load * template.live
        left = template.matrix @ forces.ravel() + dead + live
        met = self._magnitudes @ abs(forces.ravel()) + abs(dead) + abs(live)
        room = sets.slack(forces, labels)
        nothing = np.finfo(float).eps * max(1.0, float(largest.max()))  # last digit of what was projected
        noise = tolerances.ROUNDING * abs(forces[edge]).max(axis=1) + nothing
        room[edge] = np.where(abs(room[edge]) <= noise, np.inf, room[edge])
        if np.any(abs(left) > tolerances.ROUNDING * met + nothing) or room.min() < 0.0:
            return None
        return State(forces, load, float(room.min()), 0.0)

    # --- rays and self-stress ---------------------------------------------------------------------------

    def ray(self, labels: Bits) -> State | None:
        """A way to carry ever more live load: A R + b_λ = 0 with R inside the recession cones; None without proof."""
        # faces that crush bear no ray; without them their cones, which a solver meets to its residual only, are gone
        program = self.template.program(labels)
        bears = self.template.yield_set.recession_active(labels).ravel()
        if not bears.any():
            return None
        kept = np.ones(program.structure.shape[1], dtype=bool)
        kept[: len(bears)] = bears
        program = of_columns(program, kept)
        target = np.concatenate([-self.template.live, np.zeros(len(program.rhs) - len(self.template.live))])
        s, columns = program.structure, int(bears.sum())
        answer, slack = self._with_most_slack(program, target, s.shape[1] - 1)
        point = answer.point[:columns]
        if columns <= _DENSE and not s.cones:
            # rows that no ray leaves slack are equations: a solver meets them to its residual only
            tight = tips_of(s)[slack < 1e-6 * max(1.0, float(slack.max()))]
            equations = program.matrix.tocsr()[np.concatenate([np.arange(s.equalities), tight])][:, :columns].toarray()
            wanted = np.concatenate([-self.template.live, np.zeros(len(tight))])
            for _ in range(2):
                point = point - np.linalg.lstsq(equations, equations @ point - wanted, rcond=1e-12)[0]
        whole = np.zeros(len(bears))
        whole[bears] = point
        ray = self.prover.ray(np.append(whole, 1.0), labels)
        return ray if ray.to_rounding else None

    def _with_most_slack(
        self, program: ConicProgram, rhs: Floats, columns: int, cap: float = 1.0
    ) -> tuple[RawSolution, Floats]:
        """A point with as many yield rows slack as can be, and that slack in [0, cap] per row.

        program: supplies the rows; columns: how many of its columns count (all but the last leaves out λ).
        rhs: (rows,) right-hand side, zero below equilibrium for recession cones. cap: in a cone any slack can be
        scaled up to 1; elsewhere it must be so small that rows need not compete for slack.
        """
        s = program.structure
        matrix = program.matrix[:, :columns].tocsr()
        tips = tips_of(s)
        count = len(tips)
        pick = sp.csr_array((np.ones(count), (tips, np.arange(count))), shape=(s.shape[0], count))
        linear = s.equalities + s.linear
        bound = sp.hstack([sp.csr_array((count, columns)), sp.eye_array(count)])
        wide = sp.hstack([matrix, pick]).tocsr()
        rows = sp.vstack([wide[:linear], bound, -bound, wide[linear:]])
        ends = np.concatenate([rhs[:linear], np.full(count, cap), np.zeros(count), rhs[linear:]])
        objective = np.concatenate([np.zeros(columns), -np.ones(count)])
        raw = auxiliary(pack(rows, ends, objective, s.equalities, s.linear + 2 * count, s.cones, s.places))
        return raw, raw.point[columns:]

    # --- motions ----------------------------------------------------------------------------------------

    def opening(self) -> Motion | None:
        """A motion that strictly opens every face taken as dry: it does for every labelling. None if confined.

        A dry face asks more of a jump than an inner one (δ ≥ |θ| l/2 + μ|s| against δ ≥ |θ| l/6, with the larger μ
        of both), so one such motion serves all labellings of the assembly.
        """
        if not self._opening_known:
            every = np.ones(len(self.template.assembly.interfaces), dtype=bool)
            template = self._steepest()
            rows = np.ones(len(tips_of(template.structure)), dtype=bool)
            self._opening = self._relative_interior(template.program(every), rows, every)
            self._opening_known = True
        return self._opening

    def expansion(self) -> Motion | None:
        """The same without a program, where there is one as plain as that: all elements leave the supports, or courses
        leave one another faster than what stands in them."""
        template = self.template
        elements, faces = template.assembly.elements, template.assembly.interfaces
        held = elements.support[faces.a] | elements.support[faces.b]
        weight = template.assembly.dead[elements.free, : template.assembly.dimension].sum(axis=0)
        size = float(np.linalg.norm(weight))
        if self._steepest() is not template or not held.any() or size == 0.0:
            return None
        every = np.ones(len(faces), dtype=bool)
        away, down = elements.centroid[elements.free] - faces.origin[held].mean(axis=0), weight / size
        for times in _TIMES:
            speed = np.zeros((len(away), template.assembly.freedoms))
            speed[:, : len(down)] = away + (times - 1.0) * (away @ down)[:, None] * down
            motion = self.prover.motion((speed / abs(speed).max()).ravel(), every, normalise=False)
            if motion.margin > _OPENS:
                return motion
        return None

    def _steepest(self) -> Template:
        """This template with faces that open wherever those of either label do: no crushing, the larger friction.

        A crushing face has finite dissipation and opens nothing, and a dry face must ask no less of a jump than an
        inner one.
        """
        assembly, scaling = self.template.assembly, self.template.scaling
        strengths = assembly.strengths
        crushes = np.isfinite(strengths.crush_dry).any() or np.isfinite(strengths.crush_inner).any()
        friction = np.fmax(strengths.friction, strengths.inner_friction)
        if not crushes and not (strengths.inner_friction > np.nan_to_num(strengths.friction)).any():
            return self.template
        endless = np.full(len(assembly.interfaces), np.inf)
        strengths = replace(strengths, friction=friction, crush_dry=endless, crush_inner=endless)
        return Template(replace(assembly, strengths=strengths), scaling, beside=self.template.beside)

    def make_work_positive(self, motion: Motion, labels: Bits) -> Motion:
        """Add a little opening to a motion whose work of the live load is negative by rounding."""
        opening = self.opening()
        if opening is None or opening.work <= 0.0:
            return motion
        share = -2.0 * motion.work / opening.work
        return self.prover.motion(motion.velocity + share * opening.velocity, labels, normalise=False)

    def reduced(self, motion: Motion, labels: Bits, normalise: bool = True) -> Motion | None:
        """Repair a motion of a confined assembly by facial reduction (docs/method.md (3.12)).

        Where a self-stress lies inside the recession cone of a row, no finite dissipation lets that row's
        multiplier be other than zero; the motion is projected on the jumps that the other rows allow, then
        blended with one from the relative interior of those.
        """
        template = self.template
        if template.matrix.shape[0] > _DENSE:
            return None
        # the sign of a work that is zero but for the solver's residual decides the proof: make it zero. What carries
        # ever more live load then stands in the way like a self-stress, if it can
        idle = not normalise and abs(motion.work) < 1e-9
        return (self._reduced(motion, labels, normalise, idle, True) if idle else None) or self._reduced(
            motion, labels, normalise, idle, False
        )

    def _reduced(self, motion: Motion, labels: Bits, normalise: bool, idle: bool, loaded: bool) -> Motion | None:
        """The same; idle: the live load does no work. loaded: self-stress is in balance with more of it."""
        template = self.template
        program = template.program(labels)
        columns = program.structure.shape[1] - (0 if loaded else 1)
        _, slack = self._with_most_slack(program, np.zeros(len(program.rhs)), columns)
        moving = slack < 0.5
        inside = self._relative_interior(program, moving, labels, columns)
        if inside is None:
            return None
        bases = self._allowed_jumps(program, moving)
        forbid = self._forbidden(bases)
        if idle:
            forbid = np.vstack([forbid, template.live / np.linalg.norm(template.live)])
        inverse = np.linalg.pinv(forbid) if len(forbid) else np.zeros((template.matrix.shape[0], 0))

        def project(velocity: Floats) -> Floats:
            for _ in range(2):
                velocity = velocity - inverse @ (forbid @ velocity)
            return velocity

        start, step = project(motion.velocity), project(inside.velocity)
        size = float(abs(start).max()) / max(float(abs(step).max()), 1e-300)
        for share in (0.0, *np.logspace(-14.0, -3.0, 23)):
            velocity = start + share * size * step
            work = float(template.live @ velocity)
            if normalise:
                # where the live load hardly works, what decides the proof would be jumps as small as their rounding
                if not work * _ROUNDED > tolerances.ROUNDING * float(abs(template.live).max() * abs(velocity).max()):
                    continue
                velocity, work = velocity / work, 1.0
            found = self._measure_reduced(velocity, work, labels, bases)
            if found.margin >= 0.0:
                return found
        return None

    def _relative_interior(
        self, program: ConicProgram, moving: Bools, labels: Bits, columns: int | None = None
    ) -> Motion | None:
        """Velocities whose jumps are −Gᵀz with z ≥ 1 on the moving rows and 0 on the others; None if there are none.

        columns: those that are balanced, all but that of λ by default.
        """
        s = program.structure
        matrix = program.matrix.tocsr()[:, : s.shape[1] - 1 if columns is None else columns]
        tips = tips_of(s)
        linear_rows = tips[: s.linear - 1]
        kept_linear = linear_rows[moving[: len(linear_rows)]]
        kept_cones = [
            (start, size) for start, size, use in zip(s.heads, s.cones, moving[len(linear_rows) :], strict=True) if use
        ]
        cone_rows = np.concatenate([np.arange(a, a + k) for a, k in kept_cones] or [np.empty(0, dtype=int)]).astype(int)
        chosen = np.concatenate([kept_linear, cone_rows])
        balance = sp.hstack([matrix[: s.equalities].T, matrix[chosen].T]).tocsr()
        velocities = s.equalities
        floor = np.zeros(len(chosen))
        floor[: len(kept_linear)] = 1.0
        sizes = tuple(k for _, k in kept_cones)
        starts = len(kept_linear) + beginnings(sizes)
        floor[starts] = 1.0
        point = least_multipliers(matrix[: s.equalities], matrix[chosen], floor, len(kept_linear), sizes, s)
        left = balance @ point
        if not np.all(np.isfinite(left)) or abs(left).max() > 1e-6 or np.any(point[velocities:][starts] < 0.5):
            return None
        if np.any(point[velocities : velocities + len(kept_linear)] < 0.5):
            return None
        return self.prover.motion(point[:velocities], labels, normalise=False)

    def _allowed_jumps(self, program: ConicProgram, moving: Bools) -> dict[int, Floats]:
        """Per face that may not move freely: an orthonormal basis (q, k) of the jumps its moving rows span."""
        s, q = program.structure, self.template.assembly.freedoms
        pattern = self.template.yield_set.pattern
        yields = program.matrix.tocsr()[s.equalities + 1 :].toarray()
        own = q * len(self.template.assembly.interfaces)
        row_moves = np.concatenate(
            [moving[: pattern.linear], np.repeat(moving[pattern.linear :], np.array(s.cones, dtype=int))]
        ).astype(bool)
        bases: dict[int, Floats] = {}
        for face in range(len(self.template.assembly.interfaces)):
            rows = np.flatnonzero(pattern.row_face == face)
            if row_moves[rows].all():
                continue
            table = yields[rows[row_moves[rows]]]
            extra = table[:, own:]
            extra = extra[:, np.any(extra != 0.0, axis=0)]
            free = la.null_space(extra.T) if extra.size else np.eye(len(table))
            bases[face] = la.orth(table[:, q * face : q * face + q].T @ free) if free.size else np.zeros((q, 0))
        return bases

    def _forbidden(self, bases: dict[int, Floats]) -> Floats:
        """Rows E with E u = 0 ⇔ every reduced face jumps within its basis."""
        q = self.template.assembly.freedoms
        parts = []
        for face, basis in bases.items():
            jumps = self.prover.transposed[q * face : q * face + q].toarray()
            parts.append(jumps - basis @ (basis.T @ jumps))
        if not parts:
            return np.zeros((0, self.template.matrix.shape[0]))
        stacked = np.concatenate(parts)
        return np.asarray(stacked[abs(stacked).max(axis=1) > 1e-12])

    def _measure_reduced(self, velocity: Floats, work: float, labels: Bits, bases: dict[int, Floats]) -> Motion:
        """Margin and bound, the jumps of reduced faces taken on their bases, where they lie but for rounding."""
        jumps = (self.prover.transposed @ velocity).reshape(len(labels), -1)
        noise = tolerances.ROUNDING * max(float(abs(velocity).max()), 1.0)
        for face, basis in bases.items():
            snapped = basis @ (basis.T @ jumps[face])
            if abs(snapped - jumps[face]).max() > noise:
                return Motion(velocity, jumps, work, -np.inf, np.inf)
            jumps[face] = snapped
        # a jump below the rounding of the sums it comes from is none
        jumps[abs(jumps).max(axis=1) <= 1e-3 * noise] = 0.0
        sets = self.template.yield_set
        margin = sets.margin(jumps, labels)
        edge: Ints = np.array(sorted(bases), dtype=np.int64)
        margin[edge] = np.where(abs(margin[edge]) <= noise, 0.0, margin[edge])
        bound = float(sets.dissipation(jumps, labels).sum() - self.template.dead @ velocity)
        return Motion(velocity, jumps, work, float(margin.min()), bound, self.prover.noise(velocity, bound))
