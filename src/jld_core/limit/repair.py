"""Auxiliary programs that make a solver's answer admissible where it does not prove its own bounds."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import Final

import numpy as np
import scipy.sparse as sp

from jld_core import tolerances
from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.deadline import Deadline
from jld_core.limit.auxiliary_programs import (
    interior_motion,
    largest_slack_program,
    largest_support,
    maximise_slacks,
    restrict_columns,
    slack_rows,
    without_small_components,
)
from jld_core.limit.bounds import Motion, Prover, State, usable
from jld_core.limit.facial_reduction import Attempt, FacialReduction, SelfStress
from jld_core.linalg.factors import ConsistentProjector
from jld_core.program import Template
from jld_core.program.template import Structure
from jld_core.solvers import RawSolution, is_large, solve_auxiliary
from jld_core.strengths import Route, Strengths

_ROUTE: Final = Route("opening motions")

_STRETCHES = (1.0, 10.0, 100.0)  # Factors on the velocity component along gravity, tried for a simple opening motion.
_OPENS = 1e-6  # Margin, at speeds up to 1, above which a motion counts as opening.


class OpeningMotions:
    """Motions that open every face of one assembly, computed once; prover: checks motions of this template."""

    def __init__(self, template: Template, prover: Prover) -> None:
        self.template, self.prover = template, prover
        self._all_dry = np.ones(len(template.assembly.interfaces), dtype=bool)

    @cached_property
    def opening(self) -> Motion | None:
        """Motion with positive margin on every face; None if the assembly is confined."""
        # Every face is taken as dry. A dry face has a stricter condition on jumps (δ ≥ |θ| l/2 + μ|s|) than an inner
        # one (δ ≥ |θ| l/6), with μ the larger friction of both labels. One such motion therefore serves all labellings
        # of the assembly.
        program = self._steepest().program(self._all_dry)
        velocity = interior_motion(program, program.structure.shape[1] - 1)
        if velocity is None:
            return None
        labellings = (self._all_dry, ~self._all_dry)
        motions = [self.prover.motion(velocity, labels, normalise=False) for labels in labellings]
        return min(motions, key=lambda motion: motion.margin)

    @cached_property
    def expansion(self) -> Motion | None:
        """Opening motion without a program: courses separate as they leave the supports; None if none opens all."""
        # None also without supports or weight, with a further equation, and where joints crush or inner faces have the
        # larger friction.
        template = self.template
        elements, faces = template.assembly.elements, template.assembly.interfaces
        at_support = elements.support[faces.a] | elements.support[faces.b]
        weight = template.assembly.dead[elements.free, : template.assembly.dimension].sum(axis=0)
        size = float(np.linalg.norm(weight))
        if template.beside is not None or self._steepest() is not template or not at_support.any() or size == 0.0:
            return None
        offset, down = elements.centroid[elements.free] - faces.origin[at_support].mean(axis=0), weight / size
        if abs(offset).max() <= tolerances.ROUNDING * template.assembly.size:
            return None  # A single element in the middle of its supports has nowhere to go.
        for stretch in _STRETCHES:
            speed = np.zeros((len(offset), template.assembly.freedoms))
            speed[:, : len(down)] = offset + (stretch - 1.0) * (offset @ down)[:, None] * down
            motion = self.prover.motion((speed / abs(speed).max()).ravel(), self._all_dry, normalise=False)
            if motion.margin > _OPENS:
                return motion
        return None

    def _steepest(self) -> Template:
        """Return a template with the strictest conditions on jumps of both labels."""
        # The template has no crushing, since a crushing face has finite dissipation for every jump, and the larger
        # friction of both labels. Its dry faces are therefore at least as strict as inner ones. Strengths of members
        # stay.
        assembly, scaling = self.template.assembly, self.template.scaling
        if assembly.face_strengths.criteria:
            rows = self.template.yield_set.hull()
            return self.template if rows is None else self.template.with_rows(rows)
        strengths = assembly.strengths(_ROUTE)
        # A member has finite dissipation for every jump, as it stands.
        of_members, dry, inner = assembly.of_members, strengths.side(dry=True), strengths.side(dry=False)
        crushes = bool((strengths.crushes & ~of_members).any())
        if not crushes and not (inner.friction > np.nan_to_num(dry.friction)).any():
            return self.template
        uncrushable = np.full(len(assembly.interfaces), np.inf)
        dry_side = replace(dry, friction=np.fmax(dry.friction, inner.friction), crush=uncrushable)
        strengths = Strengths.of(dry_side, replace(inner, crush=np.where(of_members, inner.crush, uncrushable)))
        return Template(assembly.with_strengths(strengths), scaling, beside=self.template.beside)


_SIMPLEX = 800  # Number of columns up to which rays are sought by simplex first; its time grows by their cube.
_LEAST_SLACK = 1e-5  # Slack, scaled, that every row can have at once if it can have any.
# In the order tried; large programs take those by simplex last
_BY_SIMPLEX = Attempt(0.0, 0.0), Attempt(0.0, 1e-5)
_BY_BOUND = Attempt(1e3, 1e-5), Attempt(1e2, 1e-4), Attempt(1e1, 1e-6)
_SNAP = 1e-4  # Component of a direction on the boundary of a cone below which it is set to zero.
_ON_BOUNDARY = 0.5  # Tail over head of a tight cone from which its tail has a direction, else all rows are zero.
_NO_FORCE = 1e-3  # Head of a cone, scaled, below which a point counts as the tip of the cone.


_GAPS: Final = (1e-2, 1e-8)  # relative gaps at which λ = 0 is decided: coarse on large scenes, then fine
_TIGHT: Final = 1e-6  # slack, scaled, of a row that is tight in all solutions
_MOST_DENSE: Final = 1_000_000  # largest number of entries of equations of tight rows that are full
_SHARES: Final = (0.0, *np.logspace(-13.0, -3.0, 11), 1.0)  # shares of a state inside, tried in turn


class Repair:
    def __init__(self, template: Template, prover: Prover) -> None:
        self.template, self.prover = template, prover
        self._openings = OpeningMotions(template, prover)
        self._largest_slack_key: bytes | None = None
        self._largest_slack: RawSolution | None = None
        self._magnitudes = abs(template.matrix)

    # --- states -----------------------------------------------------------------------------------------

    def state(self, labels: Bits) -> State | None:
        """Find the state of largest slack at any λ; None where it is not admissible."""
        state = self.prover.state(self._largest_slack_solution(labels).point[: self.template.columns], labels, passes=3)
        return state if state.admissible else None

    def standing_state(self, labels: Bits) -> State | None:
        """Find an admissible state at λ = 0, with slack where possible; None if none is found."""
        raw = solve_auxiliary(largest_slack_program(self.template.program(labels), load_fixed=True), _GAPS[1])
        point = np.append(raw.point[: self.template.columns - 1], 0.0)
        state = self.prover.state(point, labels, passes=3, fixed_load=True)
        return state if state.admissible else self._boundary_state_at_zero(raw.point, labels)

    def stands(self, labels: Bits) -> bool | None:
        """Decide whether λ = 0 is admissible: by a state, or not, by a motion that gains energy; else None."""
        proof = self.proof_at_zero(labels)
        return None if proof is None else isinstance(proof, State)

    def proof_at_zero(self, labels: Bits, until: Deadline | None = None) -> State | Motion | None:
        """Return the state or motion that decides whether λ = 0 is admissible; None if neither is found.

        DeadlinePassed is raised after `until`.
        """
        program = largest_slack_program(self.template.program(labels), load_fixed=True)
        # A coarse solve suffices where the structure stands or fails by a margin; on large scenes it saves time.
        for gap in _GAPS if is_large(program.structure) else _GAPS[1:]:
            proof = self._settle(solve_auxiliary(program, gap, until), labels)
            if proof is not None:
                break
        return proof

    def _settle(self, raw: RawSolution, labels: Bits) -> State | Motion | None:
        """Return a state that proves λ = 0 admissible, or a motion that proves it is not; None without proof."""
        # cheap repairs first
        point = np.append(raw.point[: self.template.columns - 1], 0.0)
        state = self.prover.state(point, labels, passes=3, fixed_load=True)
        if state.admissible:
            return state
        motion = self.prover.motion(raw.dual, labels, normalise=False)
        opening = self.opening()
        if motion.margin < 0.0 and opening is not None:
            motion = self.prover.add_opening(motion, opening, labels)
        if motion.margin < 0.0:
            motion = self.reduced(motion, labels, normalise=False) or motion
        if motion.margin >= 0.0 and motion.bound < -max(tolerances.ROUNDING, motion.noise):
            return motion
        return self._boundary_state_at_zero(raw.point, labels)

    def _boundary_state_at_zero(self, point: Floats, labels: Bits) -> State | None:
        """Find an admissible state at λ = 0 near the point of largest slack t (columns,), t last, of about zero."""
        near = self._near_boundary(point, labels) if usable(point) and abs(point[-1]) < _TIGHT else None
        return near or self.boundary_state(point, labels, load_fixed=True)

    def _near_boundary(self, point: Floats, labels: Bits) -> State | None:
        """Return the state at λ = 0 next to a point where rows tight in it are equations; None if inadmissible."""
        # An interior point ends amid the solutions: rows that are not tight in all of them have slack.
        program = self.template.program(labels)
        structure, columns = program.structure, self.template.matrix.shape[1]
        if columns != structure.shape[1] - 1 or (projector := self.prover.projector(labels)) is None:
            return None
        values = program.rhs - program.matrix[:, :columns] @ point[:columns]
        slack = values[slack_rows(structure)]
        for k, (head, size) in enumerate(zip(structure.heads, structure.cones, strict=True), structure.linear - 1):
            slack[k] -= np.linalg.norm(values[head + 1 : head + size])
        tight = slack < _TIGHT
        selection = sp.csr_array(sp.vstack(self._equations(structure, tight, values)))
        if selection.shape[0] * columns > _MOST_DENSE:
            return None
        equations = sp.csr_array((selection @ program.matrix)[:, :columns])
        sides = program.rhs[: structure.equalities], selection @ program.rhs
        nearest = projector.project_onto(equations, point[:columns], *sides)
        return self._state_on_boundary(nearest, labels, self._faces_of(slack_rows(structure)[tight], labels), 0.0)

    def _faces_of(self, rows: Ints, labels: Bits) -> Bools:
        """Return (m,) the faces of yield rows of the program."""
        structure = self.template.structure
        faces = self.template.yield_set.pattern.row_face[rows - structure.equalities - 1]
        return np.isin(np.arange(len(labels)), faces)

    def instability_velocities(self, labels: Bits) -> Floats:
        """Find velocities (≥ q·free,) that may prove that no λ ≥ 0 is admissible (3.15), unchecked."""
        return self._largest_slack_solution(labels).dual

    def _largest_slack_solution(self, labels: Bits) -> RawSolution:
        """Return the raw solution of largest slack at any λ; the last one is cached."""
        key = np.packbits(labels).tobytes()
        if self._largest_slack is None or key != self._largest_slack_key:
            self._largest_slack = solve_auxiliary(largest_slack_program(self.template.program(labels)), 1e-4)
            self._largest_slack_key = key
        return self._largest_slack

    def boundary_state(self, point: Floats | None, labels: Bits, load_fixed: bool = False) -> State | None:
        """Find an admissible state where some yield rows are tight for all admissible forces."""
        # The point is projected onto equilibrium and the equations of the tight rows together. It is then blended with
        # a state that leaves all other rows slack. Rounding is judged per face and per row, by the size of the terms in
        # it.
        program = self.template.program(labels)
        structure = program.structure
        columns = structure.shape[1] - int(load_fixed)
        answer, slack = maximise_slacks(program, program.rhs, columns, cap=_LEAST_SLACK)
        tight = slack < 1e-3 * _LEAST_SLACK
        values = program.rhs - program.matrix[:, :columns] @ answer.point[:columns]
        balance = sp.csr_array(sp.eye_array(structure.equalities, structure.shape[0]))
        selection = sp.csr_array(sp.vstack([balance, *self._equations(structure, tight, values)]))
        equations, sides = sp.csr_array((selection @ program.matrix)[:, :columns]), selection @ program.rhs
        if not usable(answer.point):
            return None
        projector = ConsistentProjector(equations)
        interior = projector.project(answer.point[:columns], sides)
        start = projector.project(point[:columns], sides) if point is not None and usable(point) else interior
        on_boundary = self._faces_of(slack_rows(structure)[tight], labels)
        for share in _SHARES:
            blend = (1.0 - share) * start + share * interior
            state = self._state_on_boundary(blend, labels, on_boundary, 0.0 if load_fixed else float(blend[-1]))
            if state is not None:
                return state
        return None

    def _equations(self, structure: Structure, tight: Bools, values: Floats) -> list[sp.csr_array]:
        """Return matrices (k, rows) whose products with slacks vanish where rows are tight.

        tight: linear rows but that of λ, then cones; values: (rows,) slacks.
        """
        # A tight linear row gives one equation. On the boundary of a cone away from its tip, the tail is a fixed
        # direction times the head. At the tip all rows of the cone are zero.
        first_rows, linear = slack_rows(structure), structure.linear - 1
        tight_rows = first_rows[:linear][tight[:linear]]
        count = len(tight_rows)
        entries = np.ones(count), (np.arange(count), tight_rows)
        equations = [sp.csr_array(entries, shape=(count, structure.shape[0]))]
        for start, size, is_tight in zip(structure.heads, structure.cones, tight[linear:], strict=True):
            if not is_tight:
                continue
            head, tail = values[start], values[start + 1 : start + size]
            rows = sp.lil_array((size, structure.shape[0]))
            rows[np.arange(size), start + np.arange(size)] = 1.0
            if head > _NO_FORCE and float(np.linalg.norm(tail)) > _ON_BOUNDARY * head:
                rows = rows[1:]
                rows[:, start] = -without_small_components(tail / np.linalg.norm(tail), _SNAP)[:, None]
            equations.append(rows.tocsr())
        return equations

    def _state_on_boundary(self, point: Floats, labels: Bits, on_boundary: Bools, load: float) -> State | None:
        """Return the state of a point, with rounding accepted on faces `on_boundary` (m,); None if inadmissible."""
        template, sets = self.template, self.template.yield_set
        forces = point[: template.matrix.shape[1]].reshape(len(labels), -1)
        forces = np.where(sets.active(labels), forces, 0.0)
        largest = abs(forces).max(axis=1)
        # The residual force on a face that must be free of force by the equations is rounding of other forces.
        forces[on_boundary & (largest <= 1e-2 * tolerances.ROUNDING * max(1.0, float(largest.max())))] = 0.0
        dead, live = template.dead, load * template.live
        residual = template.matrix @ forces.ravel() + dead + live
        terms = self._magnitudes @ abs(forces.ravel()) + abs(dead) + abs(live)
        slack = sets.slack(forces, labels)
        last_digit = np.finfo(float).eps * max(1.0, float(largest.max()))  # Last digit of the projected values.
        noise = tolerances.ROUNDING * abs(forces[on_boundary]).max(axis=1) + last_digit
        slack[on_boundary] = np.where(abs(slack[on_boundary]) <= noise, np.inf, slack[on_boundary])
        if np.any(abs(residual) > tolerances.ROUNDING * terms + last_digit) or slack.min() < 0.0:
            return None
        return State(forces, load, float(slack.min()), 0.0)

    def self_stress_states(self, labels: Bits) -> list[State]:
        """Find states that rely on a self-stress at the boundary of the friction cones."""
        inside = self._largest_slack_solution(labels).point[: self.template.columns]
        return [
            *FacialReduction(self.template, self.prover).states(labels),
            *SelfStress(self.prover, labels).states(inside),
        ]

    # --- rays and self-stress ---------------------------------------------------------------------------

    def ray(self, labels: Bits) -> State | None:
        """Find a ray along which the live load grows without limit; None where no proof is found."""
        # A ray R satisfies A R + b_λ = 0 with R in the recession cones (docs/method.md (3.14)). Faces that crush carry
        # no ray: drop their columns and with them their cones, which solvers satisfy only to a residual.
        program = self.template.program(labels)
        active = self.template.yield_set.recession_active(labels).ravel()
        if not active.any():
            return None
        column_kept = np.ones(program.structure.shape[1], dtype=bool)
        column_kept[: len(active)] = active
        program = restrict_columns(program, column_kept)
        target = -self.template.live
        columns = program.structure.shape[1] - 1
        # Rows that no ray leaves slack are equations, which a solver satisfies only to a residual. The size of that
        # residual depends on the bound on the ray.
        for attempt in (*_BY_SIMPLEX, *_BY_BOUND) if columns <= _SIMPLEX else (*_BY_BOUND, *_BY_SIMPLEX):
            support = attempt.support(program, columns, target) or largest_support(program, columns, target, np.inf)
            resultants = np.zeros(len(active))
            # columns after the resultants are auxiliary
            resultants[active] = attempt.point(program, support, target)[: int(active.sum())]
            ray = self.prover.ray(np.append(resultants, 1.0), labels)
            if self.prover.is_ray(ray):
                return ray
        return None

    def ray_with_self_stress(self, labels: Bits) -> State | None:
        inside = self.state(labels)
        return None if inside is None or inside.slack < _OPENS else SelfStress(self.prover, labels).ray()

    # --- motions ----------------------------------------------------------------------------------------

    def opening(self) -> Motion | None:
        return self._openings.opening

    def expansion(self) -> Motion | None:
        return self._openings.expansion

    def make_work_positive(self, motion: Motion, labels: Bits) -> Motion:
        """Add a small opening motion to one whose live work is negative by rounding; the same if none helps."""
        opening = self.opening()
        if opening is None or opening.work <= 0.0:
            return motion
        share = -2.0 * motion.work / opening.work
        return self.prover.motion(motion.velocity + share * opening.velocity, labels, normalise=False)

    def reduced(self, motion: Motion, labels: Bits, normalise: bool = True) -> Motion | None:
        return FacialReduction(self.template, self.prover).repair(motion, labels, normalise)

    def of_positive_multipliers(self, motion: Motion, multipliers: Floats, labels: Bits) -> Motion | None:
        return FacialReduction(self.template, self.prover).of_positive_multipliers(motion, multipliers, labels)
