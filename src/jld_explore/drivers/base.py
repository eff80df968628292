"""Ask and tell: how a driver proposes labellings and learns what became of them.

A **driver** decides what is tried next and evaluates nothing. To **ask** is to take labellings from it that
it has not given before; to **tell** is to hand back their evaluations. A labelling is **new** to a driver
until it was asked from it, **distinct** from another when no symmetry of the scene maps one onto the other,
**canonical** when it is the smallest of its symmetric images. A driver is **exhausted** when it has nothing
more to propose, because its space is used up or because it gave up.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar

from jld_core.assembly import Bits
from jld_explore.evaluator import Evaluation


class Driver(ABC):
    """One strategy of search over the labellings of a search space.

    What it proposes depends on its space, its seed and what it was told, never on time or on the number of
    workers. How asking is cut into portions may decide how far it looks ahead, so a study that is to be
    repeated asks with the same limits.
    """

    name: ClassVar[str]
    """The word for it on the command line and in tables."""

    @property
    def settings(self) -> dict[str, Any]:
        """What the sequence of proposals depends on besides space, seed and answers; a resumed study must agree."""
        return {}

    @abstractmethod
    def ask(self, limit: int | None = None) -> Bits:
        """New, distinct, canonical and feasible labellings, (k, m) with k ≤ limit; k = 0: exhausted.

        limit: how many at the most; None leaves the portion to the driver.
        """

    @abstractmethod
    def tell(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        """What became of labellings (k, m) it was asked, in the same order."""
