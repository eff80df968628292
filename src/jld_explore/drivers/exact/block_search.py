"""When conflicts come from a tree of block choices, and what such a tree suggests on its way.

A tree is begun where the relaxation by blocks closes a good part of the gap that relaxing face by face leaves at the
root, which it does for blocks of a few cells, and given up where strengths are too large for its bounds to be accurate.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from jld_core.arrays import Bits
from jld_core.limit import AnyRelaxation, LimitAnalysis, applies_to
from jld_explore.drivers.exact.block_bound_pool import BlockBoundPool
from jld_explore.drivers.exact.block_tree import BlockTree, Node
from jld_explore.drivers.exact.conflict_minimization import Conflict
from jld_explore.drivers.exact.formula import Formula
from jld_explore.drivers.exact.possible_blocks import PossibleBlocks
from jld_explore.space import SearchSpace

ByBlocks = Literal["auto", "on", "off"]
"""Whether a tree of block choices is searched."""

_CLOSER: Final = 0.25
"""Part of the gap at the root that the relaxation by blocks must close for its tree to be searched."""

_NEAR: Final = (0.28, 0.2)
"""Gap at the root, beside the bound there, up to which conflicts of faces are sooner done than a tree, where the batch
solver
shrinks them; the second where it solves programs of the tree too. Then walls in blocks of two take by conflicts and by
a tree 0.9 and 1.8 s (6 × 8 cells, 19 %), 10 and 5 s (8 × 10, 26 %); that of 10 × 12, with 31 %, 19 s by a tree and
far more by conflicts."""

_LISTED: Final = 4
"""Possible blocks for each element above which it is not tried: blocks of one and two cells come to three. With those
of two to six on the beam on bearings a tree takes 20 s, where conflicts of faces take one."""

_BLUNT: Final = 20
"""Whole labellings left over by a tree and refuted by their own mechanism after which it is given up: its bounds are
then less accurate than strengths a million times the forces ask for."""


_OFTEN: Final = 16
_SELDOM: Final = 256
"""Programs of the tree after which annealing is given another chance, at first, and at the most."""

_ANNEALED: Final = 30
"""Labellings annealed then for each program, which takes about as long."""


@dataclass(frozen=True)
class Found:
    """What a step found: conflicts; a labelling (m,) with nothing undecided; one that may be better than known."""

    conflicts: tuple[Conflict, ...]
    whole: Bits | None = None
    promising: Bits | None = None


class BlockSearch:
    """The tree of one space, if it has one. analyses: of its load cases. relaxation: face by face, to look at single
    labellings. wanted: whether there is to be one; "auto": where it promises more than conflicts of faces.
    """

    def __init__(
        self,
        analyses: Sequence[LimitAnalysis],
        space: SearchSpace,
        blocks: PossibleBlocks | None,
        relaxation: AnyRelaxation,
        wanted: ByBlocks = "auto",
    ) -> None:
        self._wanted = wanted
        self._analyses, self._space, self._relaxation = analyses, space, relaxation
        self._blocks = blocks
        self._choices: BlockBoundPool | None = None
        self._jobs = 1
        self._tree: BlockTree | None = None
        self._seen: set[bytes] = set()
        self._blunt = 0
        self._last, self._again = 0, _OFTEN

    def start(self, least: float, root: float) -> float:
        """Begin a tree where there is to be one, and bound all labellings by what stands at its root.

        least, root: scaled λ to reach, and bound. Returns a bound, not above that one.
        """
        blocks = self._blocks
        if self._wanted == "off" or blocks is None or not math.isfinite(root):
            return root
        if not all(applies_to(analysis) for analysis in self._analyses):
            return root
        listed = _LISTED * len(self._space.assembly.elements.free)
        if self._wanted == "auto" and len(blocks) > listed:
            return root
        self._choices = BlockBoundPool(self._analyses, self._space, blocks)
        self._choices.set_workers(self._jobs)
        tree = BlockTree(self._choices, self._space, blocks, least, root)
        near = self._relaxation.many and root - least <= _NEAR[self._choices.many] * abs(root)
        quick = all(map(_has_wedges, self._analyses))
        if self._wanted == "on" or (quick and not near and root - tree.root.bound >= _CLOSER * (root - least)):
            self._tree = tree
        return min(root, tree.root.bound)

    def set_workers(self, jobs: int) -> None:
        """How many processes there may be."""
        self._jobs = jobs

    def abandon(self) -> None:
        """Give the tree up."""
        self._tree = None
        self.close()

    def close(self) -> None:
        """Let others go that solved programs."""
        if self._choices is not None:
            self._choices.close()

    @property
    def active(self) -> bool:
        """There is a tree, and some of it is open."""
        return self._tree is not None and not self._tree.finished

    @property
    def bound(self) -> float:
        """Scaled λ that no labelling exceeds that is still open in the tree."""
        return -math.inf if self._tree is None else self._tree.bound

    @property
    def open_conflicts(self) -> list[Conflict]:
        """What is known of the labellings that are still open in the tree, one conflict for each open node."""
        return [] if self._tree is None else self._tree.open_conflicts

    def annealed(self) -> int:
        """Labellings to be annealed before the next step: while something better is known to nobody a tree goes down
        between choices that are as good as each other."""
        since = self.solves - self._last
        if since < self._again:
            return 0
        self._last, self._again = self.solves, min(2 * self._again, _SELDOM)
        return _ANNEALED * since

    @property
    def solves(self) -> int:
        """Programs solved."""
        return 0 if self._choices is None else self._choices.solves

    def step(self, formula: Formula, threshold: float, late: Callable[[], bool]) -> Found:
        """Decide one more face. threshold: scaled λ to be reached. late: asked between programs."""
        assert self._tree is not None
        step = self._tree.step(threshold, formula.possible, late)
        if step.labelling is not None:
            return Found(step.conflicts, whole=step.labelling)
        promising = None if late() else self._rounded(self._tree, step.node, formula, threshold)
        return Found(step.conflicts, promising=promising)

    def note_blunt(self) -> None:
        """Note that a labelling in which nothing was undecided fell by its own mechanism, not by the tree's."""
        self._blunt += 1
        if self._blunt >= _BLUNT:
            self.abandon()

    def _rounded(self, tree: BlockTree, node: Node, formula: Formula, threshold: float) -> Bits | None:
        """A labelling that the shares of a node's blocks suggest, if no mechanism of its own rules it out."""
        labels = formula.next(*tree.rounded(node))
        if labels is None or labels.tobytes() in self._seen:
            return None
        self._seen.add(labels.tobytes())
        nothing = np.zeros(len(labels), dtype=bool)
        return labels if self._relaxation.refute(labels, nothing, threshold) is None else None


def _has_wedges(analysis: LimitAnalysis) -> bool:
    """Whether the relaxation by blocks is a linear program: one with cones is too slow for a tree."""
    return analysis.template.yield_set.wedge(dry=True) is not None
