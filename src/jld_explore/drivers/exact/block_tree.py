"""Branch and bound over the choice of blocks, docs/method.md (6.5), for spaces of small blocks."""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import Final, Literal

import numpy as np

from jld_core.arrays import Bits, Bools, Ints
from jld_core.limit.block_relaxation import BlockRequest, Choice, applies_to
from jld_explore.drivers.exact.block_bounds import BlockBoundPool, sides_of
from jld_explore.drivers.exact.context import BlockTables, PossibleBlocks, ProofContext
from jld_explore.drivers.exact.formula import Formula
from jld_explore.drivers.exact.proof_state import BlockEvidence, Conflict, Evidence
from jld_explore.space.search_space import SearchSpace

Possible = Callable[[Ints, Bits], bool]  # returns whether any labelling with labels (k,) on faces (k,) is left


@dataclass(frozen=True)
class Node:
    """Node of the tree: a partial labelling and its block relaxation."""

    # faces, labels: (k,) decided faces and their labels, True = dry
    faces: Ints
    labels: Bits
    allowed: Bools  # (p,) blocks that are left
    choice: Choice  # result of the block relaxation over those blocks
    proof: tuple[BlockEvidence, ...]  # mechanisms of the node and of the nodes above it, from the root on

    def solved(self, choice: Choice) -> Node:
        """Return a copy of the node with the result of its own block relaxation and its proof."""
        return replace(self, choice=choice, proof=(*self.proof, *map(BlockEvidence, choice.mechanisms)))

    def conflict(self, bound: float) -> Conflict:
        """Return the conflict that no labelling of the node exceeds `bound`, a scaled λ."""
        return Conflict(self.faces, self.labels, bound, Evidence.BLOCKS, by_blocks=self.proof)


@dataclass(frozen=True)
class FaceChildren:
    """Children of a node for both labels of a face; None: refuted, or without labellings."""

    inner: Node | None
    dry: Node | None

    @property
    def left(self) -> list[Node]:
        """Children that may still hold labellings: none, one or two."""
        return [branch for branch in (self.inner, self.dry) if branch is not None]


# children of a node for several faces, and the conflicts of the refuted children
Branches = tuple[list[FaceChildren], list[Conflict]]

# face (index among the candidates) and label of a child, and the unsolved child
UnsolvedChild = tuple[tuple[int, bool], Node]


@dataclass(frozen=True)
class Branching:
    node: Node
    allowed: Bools  # (p,) blocks left at the node
    threshold: float  # scaled λ to reach
    possible: Possible
    time_is_up: Callable[[], bool]


@dataclass(frozen=True)
class TreeStep:
    node: Node  # the node that was processed
    conflicts: tuple[Conflict, ...] = ()  # conflicts found
    # (m,) labelling of a node without undecided faces, which the caller must check; True = dry
    labelling: Bits | None = None


# Number of faces tried at a node, without and with the batch solver. The second number fills a SIMD register. The wall
# of 10 × 12 cells in blocks of two, with 1, 2, 4 and 8 faces tried, takes 50, 16, 13 and 10 nodes. The programs number
# 100, 69, 110 and 163.
_FACES_TRIED: Final = (2, 4)

# Least decrease of a bound that counts, scaled λ. With this minimum a label without effect does not hide the effect of
# the other label.
_LEAST_DECREASE: Final = 1e-5


class BlockTree:
    """Branch-and-bound tree over the choice of blocks, best bound first."""

    def __init__(
        self, relaxation: BlockBoundPool, space: SearchSpace, blocks: PossibleBlocks, threshold: float, most: float
    ) -> None:
        # A face decided dry excludes the blocks that contain it; the bound falls by about the dissipation inside them
        # times their shares. Those faces are tried with both labels, and the search branches on the one that lowers
        # both bounds most. Refuted nodes are conflicts: the formula, not the tree, proves.
        self._relaxation, self._space, self._blocks = relaxation, space, blocks
        self._tables = BlockTables(space, blocks)
        every = np.ones(len(blocks), dtype=bool)
        nothing = np.empty(0, dtype=np.int64)
        self.root = relaxation.choose(every, threshold, most)
        self._open: list[tuple[float, int, Node]] = []
        self._solved_ahead: dict[int, Branches] = {}
        self._count = 0
        self._next: Node | None = Node(nothing, nothing.astype(bool), every, self.root, ()).solved(self.root)

    @property
    def bound(self) -> float:
        """Scaled λ that no open labelling exceeds; −inf if no node is open."""
        bound = -self._open[0][0] if self._open else -np.inf
        return bound if self._next is None else max(bound, self._next.choice.bound)

    @property
    def open_conflicts(self) -> list[Conflict]:
        """One conflict for each open node: its labels, and the bound of its relaxation."""
        nodes = [node for _, _, node in self._open] + ([] if self._next is None else [self._next])
        return [node.conflict(node.choice.bound) for node in nodes]

    @property
    def finished(self) -> bool:
        return self._next is None and not self._open

    def step(self, threshold: float, possible: Possible, time_is_up: Callable[[], bool]) -> TreeStep:
        """Process an open node: branch on a face, refute the node, or return its only labelling."""
        node = self._next or heapq.heappop(self._open)[2]
        self._next = None
        refuted = node.conflict(threshold)
        if node.choice.bound <= threshold:
            return TreeStep(node, (refuted,))
        allowed = self._tables.propagated(node.allowed & ~node.choice.useless)
        if allowed is None:
            return TreeStep(node, (refuted,))
        undecided = self._tables.undecided(allowed)
        if not undecided.size:
            return TreeStep(node, (), self._blocks.labelling(self._space, np.flatnonzero(allowed)))
        branching = Branching(node, allowed, threshold, possible, time_is_up)
        branches = self._branch(branching)
        if branches is None:
            self._next = node
            return TreeStep(node)
        tried, conflicts = branches
        if all(len(children.left) == 2 for children in tried):
            # among faces of equal gain max() keeps the first one
            best = max(tried, key=lambda children: self._score(node, children))
            # The better child is solved first. If it raises the threshold, the other child is processed with that
            # higher threshold.
            self._next, other = sorted(best.left, key=lambda child: -child.choice.bound)
            self._add_open(other)
        else:
            forced = [children.left for children in tried if len(children.left) < 2]
            self._next = self._with_forced_labels(branching, forced, conflicts)
        return TreeStep(node, tuple(conflicts))

    def rounded(self, node: Node) -> tuple[Ints, Bits]:
        """Round the block shares of a node to labels (k,) of faces (k,)."""
        # Blocks with a share above 0.5 give the labels; labels that the node decides are kept.
        chosen = np.flatnonzero(node.allowed & (node.choice.share > 0.5))
        inside_chosen = self._tables.inside[:, chosen].any(axis=1)
        cut = self._tables.separated_by[:, chosen].any(axis=1) & ~inside_chosen
        decided = np.isin(self._tables.faces, node.faces)
        faces = np.concatenate(
            [node.faces, self._tables.faces[inside_chosen & ~decided], self._tables.faces[cut & ~decided]]
        )
        inner, dry = int((inside_chosen & ~decided).sum()), int((cut & ~decided).sum())
        return faces, np.concatenate([node.labels, np.zeros(inner, dtype=bool), np.ones(dry, dtype=bool)])

    # --- deciding ---------------------------------------------------------------------------------------

    def _add_open(self, node: Node) -> None:
        self._count += 1
        heapq.heappush(self._open, (-node.choice.bound, -self._count, node))

    def _faces_to_try(self, node: Node, undecided: Ints) -> list[int]:
        """Return the candidate indices of the faces to try, largest expected decrease first."""
        share = node.choice.share
        dissipation = self._tables.inside[undecided] @ (share * node.choice.inside)
        inner = np.clip(self._tables.inside[undecided] @ share, 0.0, 1.0)
        score = np.maximum(dissipation, 0.0) + _LEAST_DECREASE * np.minimum(inner, 1.0 - inner)
        most = _FACES_TRIED[self._relaxation.batched]
        return [int(face) for face in undecided[np.argsort(-score, kind="stable")[:most]]]

    def _branch(self, branching: Branching) -> Branches | None:
        """Solve the children of a node for the faces to try; return None if time runs out first."""
        solved_ahead = self._solved_ahead.pop(id(branching.node), None)
        if solved_ahead is not None:
            return solved_ahead
        faces = self._faces_to_try(branching.node, self._tables.undecided(branching.allowed))
        if self._relaxation.batched:
            if branching.time_is_up():
                return None
            first, *others = self._branch_together(branching, faces)
            self._solved_ahead.update(others)
            return first[1]
        tried, conflicts = list[FaceChildren](), list[Conflict]()
        # Without the batch solver programs are solved one by one, so further faces are skipped once a label is refuted.
        for face in faces:
            if branching.time_is_up():
                return None
            waiting = self._children(branching, [face], conflicts)
            choices = self._relaxation.bound_all([self._program(branching, child) for _, child in waiting])
            tried += self._pair_children(branching, [face], waiting, choices, conflicts)
            if len(tried[-1].left) < 2:
                break
        return tried, conflicts

    def _branch_together(self, branching: Branching, faces: list[int]) -> list[tuple[int, Branches]]:
        """Solve the children of a node, and of the best open node without children, together."""
        # Two nodes give work for two threads. The children of the second node are stored until the tree takes it. Each
        # result is paired with the `id` of its node.
        parts = []
        for part, its_faces in [(branching, faces), *self._next_branching(branching)]:
            conflicts: list[Conflict] = []
            parts.append((part, its_faces, self._children(part, its_faces, conflicts), conflicts))
        programs = [self._program(part, child) for part, _, waiting, _ in parts for _, child in waiting]
        choices = iter(self._relaxation.bound_all(programs))
        branches = []
        for part, its_faces, waiting, conflicts in parts:
            tried = self._pair_children(part, its_faces, waiting, list(islice(choices, len(waiting))), conflicts)
            branches.append((id(part.node), (tried, conflicts)))
        return branches

    def _next_branching(self, branching: Branching) -> list[tuple[Branching, list[int]]]:
        """Return the best other open node without known children, as branching and faces to try."""
        for bound, _, node in sorted(self._open, key=lambda entry: entry[:2]):
            if id(node) in self._solved_ahead or -bound <= branching.threshold:
                continue
            allowed = self._tables.propagated(node.allowed & ~node.choice.useless)
            if allowed is not None and (undecided := self._tables.undecided(allowed)).size:
                return [(replace(branching, node=node, allowed=allowed), self._faces_to_try(node, undecided))]
        return []

    @staticmethod
    def _program(branching: Branching, child: Node) -> BlockRequest:
        return child.allowed, branching.threshold, branching.node.choice.bound

    def _children(self, branching: Branching, faces: list[int], conflicts: list[Conflict]) -> list[UnsolvedChild]:
        """Return the children of a node that may have labellings, with the choice of the parent."""
        # Append to `conflicts` the children that no choice of blocks satisfies. Leave out those that `possible`
        # rejects.
        node, waiting = branching.node, []
        for face in faces:
            for label, others in ((False, self._tables.separated_by), (True, self._tables.inside)):
                decided = np.append(node.faces, self._tables.faces[face]), np.append(node.labels, label)
                allowed = self._tables.propagated(branching.allowed & ~others[face])
                child = Node(*decided, branching.allowed if allowed is None else allowed, node.choice, node.proof)
                if allowed is None:
                    conflicts.append(child.conflict(branching.threshold))
                elif branching.possible(*decided):
                    waiting.append(((face, label), child))
        return waiting

    def _pair_children(
        self,
        branching: Branching,
        faces: list[int],
        waiting: list[UnsolvedChild],
        choices: Sequence[Choice],
        conflicts: list[Conflict],
    ) -> list[FaceChildren]:
        """Pair children by face, given their relaxations (k,); add refuted ones to `conflicts`."""
        children: dict[tuple[int, bool], Node] = {}
        for (face_and_label, child), choice in zip(waiting, choices, strict=True):
            solved = child.solved(choice)
            if choice.refuted:
                conflicts.append(solved.conflict(branching.threshold))
            else:
                children[face_and_label] = solved
        return [FaceChildren(children.get((face, False)), children.get((face, True))) for face in faces]

    def _score(self, node: Node, tried: FaceChildren) -> float:
        return float(np.prod([max(node.choice.bound - child.choice.bound, _LEAST_DECREASE) for child in tried.left]))

    def _with_forced_labels(
        self, branching: Branching, forced: list[list[Node]], conflicts: list[Conflict]
    ) -> Node | None:
        """Decide each face that has one child left as in it; None if no labelling is left."""
        if not all(forced):
            return None
        children = [child for (child,) in forced]
        if len(children) == 1:
            return children[0]
        faces = np.concatenate([branching.node.faces, *(child.faces[-1:] for child in children)])
        labels = np.concatenate([branching.node.labels, *(child.labels[-1:] for child in children)])
        new_proofs = [child.proof[len(branching.node.proof) :] for child in children]
        proof = (*branching.node.proof, *(evidence for proof_of_child in new_proofs for evidence in proof_of_child))
        allowed = self._tables.propagated(np.logical_and.reduce([child.allowed for child in children]))
        if allowed is not None:
            weakest = min(children, key=lambda child: child.choice.bound)
            share = np.where(allowed, weakest.choice.share, 0.0)
            return Node(faces, labels, allowed, replace(weakest.choice, share=share), proof)
        conflicts.append(Conflict(faces, labels, branching.threshold, Evidence.BLOCKS, by_blocks=proof))
        return None


ByBlocks = Literal["auto", "on", "off"]  # whether to search the tree; "auto" where it promises to be faster

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

# Labellings annealed per program of the tree at most, and sides of blocks for each, without and with the batch solver:
# a labelling of 140 faces takes .4 ms, a program of 1 000 sides 4 ms there. A tree of 74 000 sides beside a search,
# which finds more, should lose no time.
_MOST_LABELLINGS: Final = 30
_SIDES_PER_LABELLING: Final = (12, 100)


@dataclass(frozen=True)
class BlockStep:
    conflicts: tuple[Conflict, ...]  # conflicts found in the step
    complete: Bits | None = None  # (m,) labelling of a node without undecided faces, True = dry
    promising: Bits | None = None  # (m,) labelling that may exceed the best one known, True = dry


class BlockSearch:
    """Branch and bound over the blocks of one space, if that search is wanted and promising."""

    def __init__(self, context: ProofContext, wanted: ByBlocks = "auto") -> None:
        self._context, self._by_blocks = context, wanted
        self._bounds: BlockBoundPool | None = None
        self._jobs = 1
        self._tree: BlockTree | None = None
        self._root_proof: tuple[BlockEvidence, ...] = ()
        self._offered: set[bytes] = set()
        self._inaccurate_bounds = 0
        self._last_run, self._interval = 0, _FIRST_INTERVAL
        self._labellings_per_program = 1

    def start(self, least: float, root: float) -> float:
        """Start the tree where it is wanted; return a bound on scaled λ of all, at most `root`."""
        # Without possible blocks, or where the relaxation does not apply, nothing is started and `root` is returned.
        blocks = self._context.blocks
        if self._by_blocks == "off" or blocks is None or not math.isfinite(root):
            return root
        if not all(applies_to(analysis) for analysis in self._context.analyses):
            return root
        listed = _BLOCKS_PER_ELEMENT * len(self._context.space.assembly.elements.free)
        if self._by_blocks == "auto" and len(blocks) > listed:
            return root
        return self._make_tree(blocks, least, root)

    def start_late(self, least: float, root: float) -> float:
        """Start the tree of many blocks once conflicts of faces have taken as long as a program; see `start`."""
        blocks, bounds = self._context.blocks, self._bounds
        if self._by_blocks == "off" or bounds is not None or blocks is None:
            return root
        new_bounds = BlockBoundPool(self._context, blocks)
        return self._make_tree(blocks, least, root, new_bounds) if new_bounds.batched else root

    def _make_tree(
        self, blocks: PossibleBlocks, least: float, root: float, bounds: BlockBoundPool | None = None
    ) -> float:
        """Solve the root, and keep its tree where that is wanted; return a bound, at most `root`."""
        self._bounds = bounds or BlockBoundPool(self._context, blocks)
        self._bounds.set_workers(self._jobs)
        sides = sides_of(self._context.space, blocks)
        some = sides // _SIDES_PER_LABELLING[self._bounds.batched]
        self._labellings_per_program = max(1, min(some, _MOST_LABELLINGS))
        tree = BlockTree(self._bounds, self._context.space, blocks, least, root)
        self._root_proof = tuple(map(BlockEvidence, tree.root.mechanisms))
        narrow = self._context.relaxation.batched and root - least <= _NARROW_GAP[self._bounds.batched] * abs(root)
        # the relaxation of wedges is a linear program; with cones it is too slow for a tree
        sets = [analysis.template.yield_set for analysis in self._context.analyses]
        quick = all(yield_set.coulomb_wedge(dry=True) is not None for yield_set in sets)
        if self._by_blocks == "on" or (quick and not narrow and root - tree.root.bound >= _GAP_CLOSED * (root - least)):
            self._tree = tree
        return min(root, tree.root.bound)

    @property
    def root_proof(self) -> tuple[BlockEvidence, ...]:
        """Mechanisms of the root of the tree, which prove the bound that `start` returned."""
        return self._root_proof

    def set_workers(self, jobs: int) -> None:
        """Set the number of processes that may be used; it takes effect at `start`."""
        self._jobs = jobs

    def abandon(self) -> None:
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
        """Return how many labellings to anneal now; a number above 0 starts the next interval."""
        # without a better labelling the tree descends between choices of equal bounds
        since = self.solves - self._last_run
        if since < self._interval:
            return 0
        self._last_run, self._interval = self.solves, min(2 * self._interval, _LONGEST_INTERVAL)
        return self._labellings_per_program * since

    @property
    def solves(self) -> int:
        return 0 if self._bounds is None else self._bounds.solves

    def step(self, formula: Formula, threshold: float, time_is_up: Callable[[], bool]) -> BlockStep:
        """Process one node of the tree, which usually decides one more face."""
        tree = self._tree
        if tree is None:
            raise RuntimeError("there is no tree to step in; call `start` first")
        step = tree.step(threshold, formula.possible, time_is_up)
        if step.labelling is not None:
            return BlockStep(step.conflicts, complete=step.labelling)
        promising = None if time_is_up() else self._round_to_labelling(tree, step.node, formula, threshold)
        return BlockStep(step.conflicts, promising=promising)

    def note_inaccurate_bound(self) -> None:
        """Count a labelling that the tree left but its own mechanism refutes; give up after many."""
        self._inaccurate_bounds += 1
        if self._inaccurate_bounds >= _MOST_INACCURATE:
            self.abandon()

    def _round_to_labelling(self, tree: BlockTree, node: Node, formula: Formula, threshold: float) -> Bits | None:
        """Round block shares to a labelling (m,) that may exceed a scaled λ; None if old or refuted."""
        labels = formula.next(*tree.rounded(node))
        if labels is None or labels.tobytes() in self._offered:
            return None
        self._offered.add(labels.tobytes())
        nothing = np.zeros(len(labels), dtype=bool)
        return labels if self._context.relaxation.refute(labels, nothing, threshold) is None else None
