"""Decide whether conflicts come from a branch and bound over blocks, and run that search.

The tree search starts where the block relaxation closes a good part of the gap that the relaxation face by face
leaves at the root. It does so for blocks of a few cells. The search is abandoned where strengths are too large for
accurate bounds of the block relaxation.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from jld_core.arrays import Bits
from jld_core.limit import LimitAnalysis
from jld_core.limit.block_relaxation import applies_to
from jld_explore.drivers.exact.block_bounds import BlockBoundPool
from jld_explore.drivers.exact.block_tree import BlockTree, Node
from jld_explore.drivers.exact.context import ProofContext
from jld_explore.drivers.exact.formula import Formula
from jld_explore.drivers.exact.proof_state import BlockEvidence, Conflict

ByBlocks = Literal["auto", "on", "off"]
"""Whether to search the tree: "on", "off", or "auto" where it promises to be faster."""

_GAP_CLOSED: Final = 0.25  # share of the gap at the root that the block relaxation must close to start the tree

# Largest relative gap at the root for which conflicts of faces are faster than a tree. The first value applies if the
# batch solver minimises conflicts, the second if it also solves the programs of the tree. Measured for walls in blocks
# of two, by conflicts and by a tree: 0.9 and 1.8 s (6 × 8 cells, gap 19 %), 10 and 5 s (8 × 10, 26 %). The wall of 10 ×
# 12 (31 %) takes 19 s by a tree and far longer by conflicts.
_NARROW_GAP: Final = (0.28, 0.2)

# Possible blocks per element above which the tree is not searched. Blocks of one and two cells come to three per
# element. For blocks of two to six cells on the beam on bearings a tree takes 20 s, conflicts of faces 1 s.
_BLOCKS_PER_ELEMENT: Final = 4

# Labellings left by the tree, but refuted by their own mechanism, that end the tree. The bounds of the tree are then
# too inaccurate, as happens where strengths are a million times the forces.
_MOST_INACCURATE: Final = 20


_FIRST_INTERVAL: Final = 16  # programs of the tree before annealing runs for the first time; later intervals double
_LONGEST_INTERVAL: Final = 256  # largest number of programs of the tree between two runs of annealing

# Labellings annealed per program of the tree, which takes about as long as the program
_LABELLINGS_PER_PROGRAM: Final = 30


@dataclass(frozen=True)
class BlockStep:
    """Result of one step of `BlockSearch`.

    conflicts: conflicts found in the step. complete: (m,) labelling of a node without undecided faces, True = dry.
    promising: (m,) labelling that may exceed the best one known, True = dry.
    """

    conflicts: tuple[Conflict, ...]
    complete: Bits | None = None
    promising: Bits | None = None


class BlockSearch:
    """Branch and bound over the blocks of one space, if that search is wanted and promising.

    A block relaxation bounds λ over all choices among possible blocks. Call `start`, then `step` while `active`.

    context: space, relaxation and other data that stay fixed during the proof. wanted: whether to search the tree;
    "auto": where it promises more than conflicts of faces.
    """

    def __init__(self, context: ProofContext, wanted: ByBlocks = "auto") -> None:
        self._context, self._wanted = context, wanted
        self._bounds: BlockBoundPool | None = None
        self._jobs = 1
        self._tree: BlockTree | None = None
        self._root_proof: tuple[BlockEvidence, ...] = ()
        self._offered: set[bytes] = set()
        self._inaccurate_bounds = 0
        self._last_run, self._interval = 0, _FIRST_INTERVAL

    def start(self, least: float, root: float) -> float:
        """Start the tree where it is wanted, and bound all labellings by the root relaxation.

        Without possible blocks, or where the relaxation does not apply, nothing is started and `root` is returned.

        least, root: scaled λ to reach, and bound on the scaled λ of all labellings. Result: bound on the scaled λ of
        all labellings, at most `root`.
        """
        blocks = self._context.blocks
        if self._wanted == "off" or blocks is None or not math.isfinite(root):
            return root
        if not all(applies_to(analysis) for analysis in self._context.analyses):
            return root
        listed = _BLOCKS_PER_ELEMENT * len(self._context.space.assembly.elements.free)
        if self._wanted == "auto" and len(blocks) > listed:
            return root
        self._bounds = BlockBoundPool(self._context, blocks)
        self._bounds.set_workers(self._jobs)
        tree = BlockTree(self._bounds, self._context.space, blocks, least, root)
        self._root_proof = tuple(map(BlockEvidence, tree.root.mechanisms))
        narrow = self._context.relaxation.batched and root - least <= _NARROW_GAP[self._bounds.batched] * abs(root)
        quick = all(map(_has_wedges, self._context.analyses))
        if self._wanted == "on" or (quick and not narrow and root - tree.root.bound >= _GAP_CLOSED * (root - least)):
            self._tree = tree
        return min(root, tree.root.bound)

    @property
    def root_proof(self) -> tuple[BlockEvidence, ...]:
        """Mechanisms of the root of the tree, which prove the bound that `start` returned.

        Empty before `start`, and where it solved no block relaxation.
        """
        return self._root_proof

    def set_workers(self, jobs: int) -> None:
        """Set the number of processes that may be used; it takes effect at `start`."""
        self._jobs = jobs

    def abandon(self) -> None:
        """Drop the tree and stop its workers."""
        self._tree = None
        self.close()

    def close(self) -> None:
        """Stop the workers that solve programs of the tree; the tree itself is kept."""
        if self._bounds is not None:
            self._bounds.close()

    @property
    def active(self) -> bool:
        """True if there is a tree with open nodes."""
        return self._tree is not None and not self._tree.finished

    @property
    def bound(self) -> float:
        """Scaled λ that no labelling still open in the tree exceeds; −inf without a tree."""
        return -math.inf if self._tree is None else self._tree.bound

    @property
    def open_conflicts(self) -> list[Conflict]:
        """One conflict for each open node of the tree, with the bound of the node."""
        return [] if self._tree is None else self._tree.open_conflicts

    def labellings_due(self) -> int:
        """Return how many labellings to anneal before the next step, 0 while annealing is not due.

        A number above 0 starts the next interval. Without a better labelling the tree descends between choices of equal
        bounds, so annealing saves nodes.
        """
        since = self.solves - self._last_run
        if since < self._interval:
            return 0
        self._last_run, self._interval = self.solves, min(2 * self._interval, _LONGEST_INTERVAL)
        return _LABELLINGS_PER_PROGRAM * since

    @property
    def solves(self) -> int:
        """Number of block relaxations solved."""
        return 0 if self._bounds is None else self._bounds.solves

    def step(self, formula: Formula, threshold: float, time_is_up: Callable[[], bool]) -> BlockStep:
        """Process one node of the tree, which usually decides one more face.

        Raises RuntimeError without a tree; see `active`.

        formula: formula of the labellings that are left. threshold: scaled λ to reach. time_is_up: returns True once
        the deadline has passed; called between programs.
        """
        tree = self._tree
        if tree is None:
            raise RuntimeError("there is no tree to step in; call `start` first")
        step = tree.step(threshold, formula.possible, time_is_up)
        if step.labelling is not None:
            return BlockStep(step.conflicts, complete=step.labelling)
        promising = None if time_is_up() else self._rounded(tree, step.node, formula, threshold)
        return BlockStep(step.conflicts, promising=promising)

    def note_inaccurate_bound(self) -> None:
        """Count a complete labelling that the tree left, although its own mechanism refutes it.

        Call it for each such labelling: after `_MOST_INACCURATE` of them the tree is abandoned, as its bounds are
        inaccurate.
        """
        self._inaccurate_bounds += 1
        if self._inaccurate_bounds >= _MOST_INACCURATE:
            self.abandon()

    def _rounded(self, tree: BlockTree, node: Node, formula: Formula, threshold: float) -> Bits | None:
        """Round the block shares of a node to a labelling (m,) that may exceed a scaled λ.

        None if the formula has no such labelling, if it was returned before, or if the relaxation refutes it.
        """
        labels = formula.next(*tree.rounded(node))
        if labels is None or labels.tobytes() in self._offered:
            return None
        self._offered.add(labels.tobytes())
        nothing = np.zeros(len(labels), dtype=bool)
        return labels if self._context.relaxation.refute(labels, nothing, threshold) is None else None


def _has_wedges(analysis: LimitAnalysis) -> bool:
    """Return True if the block relaxation is a linear program.

    A relaxation with cones is too slow for a tree.
    """
    return analysis.template.yield_set.coulomb_wedge(dry=True) is not None
