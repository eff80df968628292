"""Find motions that open every face of an assembly, for every labelling."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Floats
from jld_core.limit.auxiliary_programs import (
    interior_motion,
)
from jld_core.limit.bounds import Motion, Prover
from jld_core.program import Template
from jld_core.strengths import Route, Strengths

_ROUTE: Final = Route("opening motions")

_TIMES = (1.0, 10.0, 100.0)  # Factors on the velocity component along gravity, tried for a simple opening motion.
_OPENS = 1e-6  # Margin, at speeds up to 1, above which a motion counts as opening.


class OpeningMotions:
    """Motions that open every face of one assembly, computed once.

    prover: checks motions of this template.
    """

    def __init__(self, template: Template, prover: Prover) -> None:
        self.template, self.prover = template, prover
        self._opening: Motion | None = None
        self._opening_known = False
        self._expansion: Motion | None = None
        self._expansion_known = False

    def opening(self) -> Motion | None:
        """Find a motion with positive margin on every face; None if the assembly is confined."""
        # Every face is taken as dry. A dry face has a stricter condition on jumps (δ ≥ |θ| l/2 + μ|s|) than an inner
        # one (δ ≥ |θ| l/6), with μ the larger friction of both labels. One such motion therefore serves all labellings
        # of the assembly, and is cached.
        if not self._opening_known:
            every = np.ones(len(self.template.assembly.interfaces), dtype=bool)
            template = self._steepest()
            program = template.program(every)
            inside = interior_motion(program, program.structure.shape[1] - 1)
            self._opening = None if inside is None else self._under_both(inside)
            self._opening_known = True
        return self._opening

    def _under_both(self, velocity: Floats) -> Motion:
        """Return a motion with its margin under the label that has the lesser one; velocity: scaled."""
        every = np.ones(len(self.template.assembly.interfaces), dtype=bool)
        motions = [self.prover.motion(velocity, labels, normalise=False) for labels in (every, ~every)]
        return min(motions, key=lambda motion: motion.margin)

    def expansion(self) -> Motion | None:
        """Find an opening motion without a program: courses separate as they leave the supports.

        None if none opens all.
        """
        # None also without supports or weight, with a further equation, and where joints crush or inner faces have the
        # larger friction.
        if not self._expansion_known:
            self._expansion, self._expansion_known = self._expanding(), True
        return self._expansion

    def _expanding(self) -> Motion | None:
        """Compute the motion that `expansion` returns and stores; None as there."""
        template = self.template
        elements, faces = template.assembly.elements, template.assembly.interfaces
        held = elements.support[faces.a] | elements.support[faces.b]
        weight = template.assembly.dead[elements.free, : template.assembly.dimension].sum(axis=0)
        size = float(np.linalg.norm(weight))
        if template.beside is not None or self._steepest() is not template or not held.any() or size == 0.0:
            return None
        every = np.ones(len(faces), dtype=bool)
        away, down = elements.centroid[elements.free] - faces.origin[held].mean(axis=0), weight / size
        if abs(away).max() <= tolerances.ROUNDING * template.assembly.size:
            return None  # A single element in the middle of its supports has nowhere to go.
        for times in _TIMES:
            speed = np.zeros((len(away), template.assembly.freedoms))
            speed[:, : len(down)] = away + (times - 1.0) * (away @ down)[:, None] * down
            motion = self.prover.motion((speed / abs(speed).max()).ravel(), every, normalise=False)
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
        bounded, dry, inner = assembly.of_members, strengths.side(dry=True), strengths.side(dry=False)
        crushes = bool((strengths.crushes & ~bounded).any())
        if not crushes and not (inner.friction > np.nan_to_num(dry.friction)).any():
            return self.template
        endless = np.full(len(assembly.interfaces), np.inf)
        steep = replace(dry, friction=np.fmax(dry.friction, inner.friction), crush=endless)
        strengths = Strengths.of(steep, replace(inner, crush=np.where(bounded, inner.crush, endless)))
        return Template(assembly.with_strengths(strengths), scaling, beside=self.template.beside)
