"""Define the data that stay fixed during a proof: space, possible blocks and relaxation."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Final, Protocol

import cloudpickle
import numpy as np

from jld_core.arrays import Bits, Bools, Floats
from jld_core.deadline import Deadline, DeadlinePassed, time_left
from jld_core.limit import LimitAnalysis
from jld_core.limit.case_relaxation import AnyRelaxation, relaxation_of
from jld_core.limit.dual_bounds import DualBound
from jld_explore.drivers.exact.possible_blocks import PossibleBlocks, possible_blocks
from jld_explore.space import Count, SearchSpace

# Largest share of the time left for listing the possible blocks; the formula works without the list
_LISTING_SHARE: Final = 0.3

SEED_STEP: Final = 1000
"""Difference of the seeds of two threads or of two workers, so that each prefers other labels."""


class PartialLabellingRelaxation(Protocol):
    """Relaxation that bounds λ of partial labellings, by rigid blocks or by fields.

    In a partial labelling, `undecided` (k, m) or (m,) is True for faces that may take either label. λ is scaled.
    """

    def refute_all(
        self, labellings: Bits, undecided: Bools, thresholds: Floats, thorough: Bools | None = None
    ) -> list[DualBound | None]:
        """Prove that partial labellings (k, m) do not exceed thresholds; None where it fails.

        thresholds: (k,) scaled λ. thorough: (k,) True where another solver may be tried; see `Relaxation.refute_all`. A
        proof holds its mechanism and its bound.
        """
        ...

    def refute(self, labels: Bits, undecided: Bools, threshold: float) -> DualBound | None:
        """Prove that one partial labelling (m,) does not exceed `threshold`; None if this fails.

        labels: True = dry, ignored where `undecided`. threshold: scaled λ.
        """
        ...

    def least_bound(self, labels: Bits, undecided: Bools) -> DualBound | None:
        """Return the least bound on the scaled λ of one partial labelling (m,), None without one."""
        ...

    def evaluate_mechanisms(self, case: int, velocities: Floats, labellings: Bits, undecided: Bools) -> Floats:
        """Return (k,) bounds that known mechanisms of one load case give for labellings (k, m).

        velocities: (k, q · free) one scaled mechanism for each. A bound is inf where its mechanism proves nothing, and
        −inf where no λ is admissible.
        """
        ...


class CheckedProof(Protocol):
    """Data that the check of a proof needs, of a proof by rigid blocks or by fields."""

    @property
    def space(self) -> SearchSpace:
        """The search space."""

    @property
    def blocks(self) -> PossibleBlocks | None:
        """Possible blocks, None where they are not listed."""

    @property
    def free(self) -> Bools:
        """Faces (m,) bool, True where some labelling of the space has either label."""

    @property
    def relaxation(self) -> PartialLabellingRelaxation:
        """Relaxation that refutes labellings and evaluates mechanisms."""

    @property
    def labels(self) -> Bits:
        """Labels (m,) of faces that are not free, True = dry; entries of free faces are unused."""


@dataclass(frozen=True)
class ProofContext:
    """Space of a proof by conflicts, with its possible blocks, analyses and relaxation.

    blocks: possible blocks, where they are listed. free: (m,) faces that may take either label in some labelling.
    analyses: analyses of the load cases, in their order. relaxation: relaxation face by face, which refutes labellings
    and evaluates mechanisms. It counts its solves.
    """

    space: SearchSpace
    blocks: PossibleBlocks | None
    free: Bools
    seed: int
    analyses: tuple[LimitAnalysis, ...]
    relaxation: AnyRelaxation

    @classmethod
    def of(
        cls, space: SearchSpace, seed: int, counted: Count | None = None, *, list_blocks: bool = True
    ) -> ProofContext | None:
        """Make the context of a space.

        counted: count that the formula must express besides the limited counts. list_blocks: whether to list the
        possible blocks where they are few enough. Result: None where the space has no formula or no relaxation, so that
        conflicts prove nothing.
        """
        analyses = tuple(LimitAnalysis(case) for case in space.assembly.by_case)
        blocks = _list_blocks(space) if list_blocks else None
        counts = [count for count, _ in space.limits.on_counts] + ([] if counted is None else [counted])
        terms = [count.terms(space.assembly) if count.terms else None for count in counts]
        if any(one is None or (one.blocks and blocks is None) for one in terms):
            return None
        relaxation = relaxation_of(space.assembly, analyses)
        if relaxation is None:
            return None
        free = space.candidates.copy()
        if blocks is not None:
            joined = {face for inside in blocks.inside for face in inside}
            free &= np.isin(np.arange(len(free)), list(joined))
        return cls(space, blocks, free, seed, analyses, relaxation)

    @property
    def labels(self) -> Bits:
        """Labels (m,) of faces that are not free, True = dry; entries of free faces are unused.

        Candidates outside every possible block are dry whatever the label of the scene.
        """
        return np.asarray(self.space.fixed | (self.space.candidates & ~self.free))

    def packed(self, seed: int) -> bytes:
        """Return the context with another seed, pickled for a worker.

        The worker makes a relaxation of its own. cloudpickle is used because limits hold lambdas, which pickle refuses.
        """
        content: bytes = cloudpickle.dumps((self.space, self.blocks, self.free, seed))
        return content

    @classmethod
    def unpacked(cls, content: bytes) -> ProofContext:
        """Make the context in a worker from the bytes of `packed`.

        Its analyses and its relaxation are made anew. Raises RuntimeError if the assembly has no relaxation.
        """
        given: tuple[SearchSpace, PossibleBlocks | None, Bools, int] = cloudpickle.loads(content)
        space, blocks, free, seed = given
        analyses = tuple(LimitAnalysis(case) for case in space.assembly.by_case)
        relaxation = relaxation_of(space.assembly, analyses)
        if relaxation is None:
            raise RuntimeError("a proof by conflicts needs a relaxation, and the assembly has none")
        return cls(space, blocks, free, seed, analyses, relaxation)

    @property
    def key(self) -> str:
        """Hash of all data that conflicts depend on.

        Recorded conflicts hold for an equal key only. The hash covers the numbers of the programs, the free faces, the
        symmetry group and the possible blocks.
        """
        space = self.space
        parts = [
            space.candidates.tobytes(),
            space.fixed.tobytes(),
            space.group.tobytes(),
            space.assembly.required.tobytes(),
        ]
        for analysis in self.analyses:
            template = analysis.template
            pattern = template.yield_set.pattern
            numbers = (template.matrix.data, template.dead, template.live, pattern.dry, pattern.inner)
            parts += [part.tobytes() for part in (*numbers, pattern.h_dry, pattern.h_inner)]
        names = repr(None if self.blocks is None else self.blocks.members).encode()
        return hashlib.sha256(b"".join([*parts, names])).hexdigest()


def _list_blocks(space: SearchSpace) -> PossibleBlocks | None:
    """List the possible blocks of a space; None also if that takes too long."""
    try:
        with Deadline(_LISTING_SHARE * time_left()).enforced():
            return possible_blocks(space)
    except DeadlinePassed:
        return None
