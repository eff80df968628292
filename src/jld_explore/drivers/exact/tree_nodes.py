"""Define the nodes of the tree over the choice of blocks, and the results of its steps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from jld_core.arrays import Bits, Bools, Ints
from jld_core.limit.block_relaxation import Choice
from jld_explore.drivers.exact.conflict_minimization import Conflict

Possible = Callable[[Ints, Bits], bool]
"""Function that returns True if any labelling with labels (k,) on faces (k,) is left."""


@dataclass(frozen=True)
class Node:
    """Node of the tree: a partial labelling and its block relaxation.

    Attributes
    ----------
    faces, labels : (k,) int array and (k,) bool array
        Decided faces and their labels, True = dry.
    allowed : (p,) bool array
        Blocks that are left.
    choice : Choice
        Result of the block relaxation over those blocks.
    """

    faces: Ints
    labels: Bits
    allowed: Bools
    choice: Choice


@dataclass(frozen=True)
class FaceChildren:
    """Children of a node for both labels of one face; None for a child that is refuted."""

    inner: Node | None
    dry: Node | None

    @property
    def left(self) -> list[Node]:
        """The children that are not refuted."""
        return [one for one in (self.inner, self.dry) if one is not None]


Branches = tuple[list[FaceChildren], list[Conflict]]
"""Children of a node for several faces, and the conflicts of the refuted children."""

UnsolvedChild = tuple[tuple[int, bool], Node]
"""Face (index among the candidates) and label of a child, and the unsolved child."""


@dataclass(frozen=True)
class Branching:
    """Arguments of branching at one node.

    Attributes
    ----------
    node : Node
        The node.
    allowed : (p,) bool array
        Blocks left at the node.
    threshold : float
        Scaled λ to reach.
    possible, time_is_up : callable
        As in `BlockTree.step`.
    """

    node: Node
    allowed: Bools
    threshold: float
    possible: Possible
    time_is_up: Callable[[], bool]


@dataclass(frozen=True)
class TreeStep:
    """Result of `BlockTree.step`.

    Attributes
    ----------
    node : Node
        The node that was processed.
    conflicts : tuple of Conflict
        Conflicts found.
    labelling : (m,) bool array or None
        Labelling of a node without undecided faces, which the caller must check; True = dry.
    """

    node: Node
    conflicts: tuple[Conflict, ...] = ()
    labelling: Bits | None = None
