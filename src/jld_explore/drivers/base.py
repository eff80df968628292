"""Interface of all drivers: ask for labellings, tell their evaluations."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError

from jld_core import plugins
from jld_core.arrays import Bits
from jld_core.deadline import Deadline
from jld_core.errors import InputError, ParameterError
from jld_core.models.solve_many import BatchResult
from jld_core.parameters import require_kind, typed
from jld_explore.evaluation import Records
from jld_explore.evaluation.protocol import Evaluation, evaluations_of
from jld_explore.space import feasible, to_string
from jld_explore.space.search_space import SearchSpace

if TYPE_CHECKING:
    import pandas as pd

Aim = Literal["best", "front"]  # the largest λ, or the largest λ for every value of a count


class DriverOptions(BaseModel):
    """Base class of the options of a driver besides space and seed.

    A subclass has one field per option, with type, default and description, from which the command line follows.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")


class Driver(ABC):
    """Search strategy over the labellings of a space (abstract base class).

    A subclass defines `name`, `ask` and `tell`; what it proposes must follow from space, seed and evaluations alone.

    Parameters
    ----------
    space : SearchSpace
        Also an attribute.
    seed : int
        Seed of the random choices; also an attribute. Fields of `Options` are further keyword arguments.
    """

    remembers: ClassVar[bool] = False
    """True if `restore` has an effect."""

    ahead: int = 0
    """Calls of `ask` before the evaluations of an earlier one arrive."""

    checks: ClassVar[bool] = False
    """True if the driver checks its proof at the end; without that nothing is called proven."""

    modular: ClassVar[bool] = False
    """True if bounds replace evaluations, valid for convex contact on whole faces only."""

    name: ClassVar[str]
    """Name of the driver on the command line and in tables."""

    Options: ClassVar[type[DriverOptions]] = DriverOptions
    """Class of the options of the driver."""

    def __init__(self, space: SearchSpace, seed: int = 0) -> None:
        require_kind("seed", seed, int)
        if seed < 0:
            raise ParameterError("seed", f"{seed} is no seed", "a whole number from 0")
        self.space, self.seed = space, seed

    def __init_subclass__(cls, **keywords: Any) -> None:
        """Let `tell` of a driver take a `BatchResult` in place of evaluations, and check what it is given."""
        super().__init_subclass__(**keywords)
        if "ask" in cls.__dict__:
            original_ask: Any = typed(cls.ask)

            @wraps(original_ask)
            def ask(self: Driver, *arguments: Any, **keyword_arguments: Any) -> Bits:
                with plugins.guarded("jld.drivers", self.name):
                    labellings: Bits = original_ask(self, *arguments, **keyword_arguments)
                    self._require_labellings(labellings)
                return labellings

            setattr(cls, "ask", ask)  # noqa: B010 – mypy refuses the assignment of a method
        original: Any = cls.__dict__.get("tell")
        if original is not None:

            @wraps(original)
            def tell(self: Driver, labellings: Bits, evaluations: Sequence[Evaluation] | BatchResult) -> None:
                rows, told = np.asarray(labellings), evaluations_of(evaluations)
                if rows.dtype != np.bool_ or rows.ndim != 2 or len(rows) != len(told):
                    problem = f"they are of shape {rows.shape}, with {len(told)} evaluations"
                    raise ParameterError("labellings", problem, "those that `ask` returned, a row for each evaluation")
                with plugins.guarded("jld.drivers", self.name):
                    original(self, rows, told)

            setattr(cls, "tell", tell)  # noqa: B010

    def _require_labellings(self, labellings: Any) -> None:
        """Raise InputError unless `ask` returned labellings (k, m), those of a driver of others in the space."""
        where, faces = f"driver {self.name!r}", len(self.space.fixed)
        expected = f"a bool array (k, {faces}), True = dry"
        if not isinstance(labellings, np.ndarray):
            raise InputError(where, f"it asks for {type(labellings).__name__}", expected)
        if labellings.dtype != np.bool_ or labellings.shape[1:] != (faces,):
            raise InputError(where, f"it asks for {labellings.dtype} of shape {labellings.shape}", expected)
        if type(self).__module__.startswith("jld_explore."):  # they propose what the operators keep feasible
            return
        if not (admissible := feasible(self.space, labellings)).all():
            problem = f"it asks for {to_string(labellings[~admissible][0])}, which the search excludes"
            raise InputError(where, problem, "what its Register admits")

    @classmethod
    def made(cls, space: SearchSpace, seed: int, values: Mapping[str, Any]) -> Self:
        """Make a driver from values of fields of `Options`; InputError for an unknown one or a wrong value."""
        require_kind("space", space, SearchSpace)
        try:
            options = cls.Options(**values)
        except ValidationError as error:
            raise _option_error(error.errors()[0]) from None
        kind: Any = cls
        driver: Self = kind(space, seed, **{name: getattr(options, name) for name in cls.Options.model_fields})
        return driver

    @property
    def settings(self) -> dict[str, Any]:
        """Values that the proposals depend on beside space and seed; a resumed study must have the same."""
        return {}

    @property
    def bound(self) -> float | None:
        """Proven upper bound on λ over the whole space, scene units; None without one."""
        return None

    @property
    def finished(self) -> bool:
        """True if the aim is proven although not every labelling was evaluated."""
        return False

    @property
    def exhaustive(self) -> bool:
        """True if an exhausted driver has proposed every class of its space, which is a proof."""
        return False

    @property
    def working(self) -> bool:
        """True if work is left for a driver that returned nothing because the deadline passed."""
        return False

    def facts(self, results: pd.DataFrame, complete: bool) -> dict[str, Any]:
        """Return the entries that the driver adds to the summary; complete: the table holds every class."""
        return {}

    @property
    def complaints(self) -> list[str]:
        """Problems of the proof, one line each, for the warnings of the summary."""
        return []

    def withdraw(self, reason: str) -> None:  # noqa: B027
        """Forget every bound on labellings, because an evaluation exceeds one.

        Parameters
        ----------
        reason : str
            The contradiction, in one line.
        """

    def set_workers(self, jobs: int) -> None:  # noqa: B027 – most leave that to whoever evaluates
        """Set the number of processes that the driver may use; called once before `start`."""

    def start(  # noqa: B027 – most ask in no time
        self, deadline: Deadline | None, heartbeat: Callable[[], None], records: Records | None = None
    ) -> None:
        """Set deadline, heartbeat, which reports progress during long work, and records; before the first `ask`."""

    def close(self) -> None:  # noqa: B027
        """Release files and workers; called once after the last `ask`."""

    def prepare(self) -> None:  # noqa: B027
        """Work for the next `ask` while labellings are evaluated; `tell` must give the same without it."""

    def restore(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:  # noqa: B027
        """Take over the evaluations of labellings (k, m) of a resumed study, which `tell` passes again."""

    @abstractmethod
    def ask(self, limit: int | None = None) -> Bits:
        """Return labellings (k, m), new, canonical, feasible, distinct under symmetry; k = 0 if exhausted."""

    @abstractmethod
    def tell(self, labellings: Bits, evaluations: Any) -> None:
        """Take in evaluations, or a `BatchResult`, of labellings (k, m) that `ask` has returned."""


def _option_error(error: Any) -> InputError:
    """Convert a validation error of an option to an InputError of one line."""
    context, value = error.get("ctx", {}), error["input"]
    expected = {
        "literal_error": f"one of {context.get('expected', '')}".replace("'", ""),
        "greater_than_equal": f"a whole number greater than or equal to {context.get('ge')}",
        "int_parsing": "a whole number",
        "int_type": "a whole number",
        "extra_forbidden": "an option that the driver has",
    }.get(error["type"], error["msg"].lower())
    return ParameterError(str(error["loc"][0]), f"{value!r} is wrong", expected)
