"""Ask and tell: how a driver proposes labellings and learns what became of them.

A **driver** decides what is tried next and evaluates nothing. To **ask** is to take labellings from it that
it has not given before; to **tell** is to hand back their evaluations. A labelling is **new** to a driver
until it was asked from it, **distinct** from another when no symmetry of the scene maps one onto the other,
**canonical** when it is the smallest of its symmetric images. A driver is **exhausted** when it has nothing
more to propose, because its space is used up or because it gave up.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Self

from pydantic import BaseModel, ConfigDict, ValidationError

from jld_core.arrays import Bits
from jld_core.deadline import Deadline
from jld_core.errors import InputError
from jld_explore.evaluation import Evaluation, Records
from jld_explore.space import SearchSpace

if TYPE_CHECKING:
    import pandas as pd

Aim = Literal["best", "front"]
"""What a search is for: the largest λ, or the largest λ for every value of the scene's count."""


class DriverOptions(BaseModel):
    """What a driver takes beside its space and seed: one field an option, with its type, default and description.

    The options of the command line, their help and what is said of a wrong one follow from these fields.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")


class Driver(ABC):
    """One strategy of search over the labellings of a search space; `name`, `ask` and `tell` make one.

    space: what is searched. seed: of whatever chance it uses. One that is chosen by name takes its `Options` as
    further arguments.

    What it proposes depends on its space, its seed and what it was told, never on time or on the number of
    workers, long proofs in several processes excepted. How asking is cut into portions may decide how far it looks
    ahead, so a study that is to be repeated asks with the same limits.
    """

    remembers: ClassVar[bool] = False
    """Whether `restore` does anything."""

    ahead: ClassVar[int] = 0
    """Portions a study asks before it tells the answers to an earlier one, so that asking and evaluating overlap."""

    checks: ClassVar[bool] = False
    """Whether it checks its proof when that ends, so that nothing is called proven without the check."""

    modular: ClassVar[bool] = False
    """Whether it relies on bounds of labellings never solved, which hold for convex contact on whole faces alone."""

    name: ClassVar[str]
    """The word for it on the command line and in tables."""

    Options: ClassVar[type[DriverOptions]] = DriverOptions
    """What it may be told by name."""

    def __init__(self, space: SearchSpace, seed: int = 0) -> None:
        self.space, self.seed = space, seed

    @classmethod
    def made(cls, space: SearchSpace, seed: int, given: Mapping[str, Any]) -> Self:
        """One for a space, with options by name. Raises InputError for one that is wrong."""
        try:
            options = cls.Options(**given)
        except ValidationError as error:
            raise _complaint(error.errors()[0]) from None
        make: Any = cls
        made: Self = make(space, seed, **{name: getattr(options, name) for name in cls.Options.model_fields})
        return made

    @property
    def settings(self) -> dict[str, Any]:
        """What the sequence of proposals depends on besides space, seed and answers; a resumed study must agree."""
        return {}

    @property
    def bound(self) -> float | None:
        """A proven upper bound on λ over the whole space, scene units, where the driver has one of its own."""
        return None

    @property
    def finished(self) -> bool:
        """Whether the driver has proven all that it was to prove, though not every labelling was evaluated."""
        return False

    @property
    def exhaustive(self) -> bool:
        """Whether a driver with nothing more to propose has proposed every class of its space: a proof."""
        return False

    @property
    def working(self) -> bool:
        """Whether there is more to do for a driver that came back with nothing because time is up."""
        return False

    def facts(self, results: pd.DataFrame, complete: bool) -> dict[str, Any]:
        """What the driver adds to the summary. results: the table; complete: it holds every class of the space."""
        return {}

    @property
    def complaints(self) -> list[str]:
        """Return what went wrong with a proof, one line each; the summary holds them among its warnings."""
        return []

    def withdraw(self, reason: str) -> None:  # noqa: B027
        """Forget every bound on layouts that were never evaluated: one of them has been contradicted.

        reason: one line that says what contradicts what.
        """

    def set_workers(self, jobs: int) -> None:  # noqa: B027 – most leave that to whoever evaluates
        """Told once before the start: how many processes may help a driver that has work of its own."""

    def start(  # noqa: B027 – most ask in no time
        self, deadline: Deadline | None, heartbeat: Callable[[], None], records: Records | None = None
    ) -> None:
        """Told once before the first ask: when to come back from a long one, and what to call meanwhile.

        deadline: of the study, None for none. Once it has passed, loops that call `jld_core.deadline.checkpoint` end in
        DeadlinePassed, after which the driver is not asked again. heartbeat: reports progress; signals are heard when
        it is called. records: of the study, for what the driver itself must not lose.
        """

    def close(self) -> None:  # noqa: B027
        """Told once after the last ask: let go of files."""

    def restore(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:  # noqa: B027
        """What a study that is gone on with knows already; it is told again when it is asked again."""

    @abstractmethod
    def ask(self, limit: int | None = None) -> Bits:
        """New, distinct, canonical and feasible labellings, (k, m) with k ≤ limit; k = 0: exhausted.

        limit: how many at the most; None leaves the portion to the driver.
        """

    @abstractmethod
    def tell(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        """What became of labellings (k, m) it was asked, in the same order."""


def _complaint(error: Any) -> InputError:
    """What is wrong with an option, in one line."""
    context, given = error.get("ctx", {}), error["input"]
    expected = {
        "literal_error": f"one of {context.get('expected', '')}".replace("'", ""),
        "greater_than_equal": f"a whole number greater than or equal to {context.get('ge')}",
        "int_parsing": "a whole number",
        "int_type": "a whole number",
        "extra_forbidden": "an option that the driver has",
    }.get(error["type"], error["msg"].lower())
    return InputError("--" + str(error["loc"][0]).replace("_", "-"), f"{given!r} is wrong", expected)
