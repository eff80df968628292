"""Any of the library's samplers by name, through ask and tell, many trials in flight.

A **trial** is one set of keys, a number in [0, 1] for each pair of neighbouring atoms, from which
`Operators.read` makes a valid labelling; every labelling comes out of some keys. Trials of a class that is known
already are told at once and cost nothing. The sampler works on a study in memory; finished trials are copied
into a storage that the library's dashboard reads, so a slow database does not slow the sampler down, and to
resume is to replay as with every driver: what the storage holds already is not written again.

Labellings without a number (locked, uncertified, unstable, failed) are told as pruned: samplers rank those
apart and never see a value for them.
"""

from __future__ import annotations

import importlib.util
import re
import time
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from pydantic import Field

from jld_core.arrays import Bits
from jld_core.deadline import Deadline
from jld_core.errors import InputError
from jld_core.limit import Status
from jld_explore.drivers.base import DriverOptions
from jld_explore.drivers.searcher import Searcher
from jld_explore.evaluation import Evaluation, Records, objectives
from jld_explore.space import SearchSpace, canonical, keys, to_string

if TYPE_CHECKING:
    import optuna
    from optuna.distributions import BaseDistribution
    from optuna.study import StudyDirection
    from optuna.trial import FrozenTrial, Trial

FILE: Final = "optuna.journal"
"""Name of the default storage in the folder of a study: a journal, one line a trial. A database of the library takes
fifteen times as long for each (58 ms against 4 with 17 faces), which is more than most trials."""

_BEGUN: Final = 4
"""Times a database is tried again that another search is making its tables in."""

_NEEDS: Final = {"cmaes": "cmaes", "gp": "torch"}
"""Packages that some samplers need and that are not among our own requirements."""

_SEEDS: Final = 2**32

_ODD: Final = (ValueError, KeyError, TypeError, AttributeError)
"""What the library raises for a journal that is none of its own."""

_NOT_FOR_KEYS: Final = ("Base", "BaseGA", "BruteForce", "Grid", "PartialFixed")
"""Samplers that cannot propose keys without being told more than a seed."""


def sampler_names() -> list[str]:
    """Names that `--sampler` takes."""
    import optuna  # here and below: slow to import, and only for those who ask for it

    names = [name.removesuffix("Sampler") for name in dir(optuna.samplers) if name.endswith("Sampler")]
    return sorted(name for name in names if name not in _NOT_FOR_KEYS)


def make_sampler(name: str, seed: int) -> tuple[str, optuna.samplers.BaseSampler]:
    """The sampler's own name, and a fresh one of it.

    name: with or without "Sampler", in any case and with or without hyphens. Raises InputError for a name
    that is none, and for a sampler whose package is not installed.
    """

    def plain(text: str) -> str:
        return re.sub(r"[^a-z0-9]", "", text.lower()).removesuffix("sampler")

    import optuna

    known = {plain(other): other for other in sampler_names()}
    if plain(name) not in known:
        raise InputError("--sampler", f"no sampler is named {name!r}", "one of " + ", ".join(known.values()))
    needed = _NEEDS.get(plain(name))
    if needed is not None and importlib.util.find_spec(needed) is None:
        problem = f"{known[plain(name)]} needs the package {needed}, which is not installed"
        raise InputError("--sampler", problem, "another sampler, or that package")
    kind: Any = getattr(optuna.samplers, known[plain(name)] + "Sampler")
    if seed >= _SEEDS:  # more than the library's generators take
        seed = int(np.random.SeedSequence(seed).generate_state(1)[0])
    sampler: optuna.samplers.BaseSampler = kind(seed=seed)
    return known[plain(name)], sampler


class OptunaOptions(DriverOptions):
    """Options of the optuna driver."""

    sampler: str = Field("TPE", description="its sampler, by name")
    storage: str | None = Field(None, description="URL of its database; default: a file in the folder")


class Optuna(Searcher):
    """Trials of one sampler, `size` in flight.

    sampler: its name. storage: URL of a database; a file in the folder of the study where none is given. Samplers made
    for several objectives get λ and the counts of the scene's front; others λ alone.
    """

    name = "optuna"
    Options = OptunaOptions

    def __init__(
        self, space: SearchSpace, seed: int, sampler: str = "TPE", storage: str | None = None, size: int = 16
    ) -> None:
        import optuna
        from optuna.distributions import FloatDistribution
        from optuna.study import StudyDirection

        super().__init__(space, seed, size)
        optuna.logging.set_verbosity(optuna.logging.WARNING)  # its log would land among our own output
        self.sampler, chosen = make_sampler(sampler, seed)
        self.aims = 1 + len(space.search.front.axes) if self.sampler.startswith("NSGA") else 1
        self._directions = [StudyDirection.MINIMIZE] * self.aims
        self._study = optuna.create_study(sampler=chosen, directions=self._directions)
        self._copy = Copy(storage, self._directions)
        width = len(str(self.operators.keys))
        self._space: dict[str, BaseDistribution] = {
            f"key{number:0{width}d}": FloatDistribution(0.0, 1.0) for number in range(self.operators.keys)
        }
        self._known: dict[bytes, tuple[Evaluation, list[float]]] = {}
        self._waiting: dict[bytes, list[Trial]] = {}

    def start(self, deadline: Deadline | None, heartbeat: Callable[[], None], records: Records | None = None) -> None:
        """See `Driver.start`: finished trials are copied from here on."""
        if records is not None:
            known = records.header
            scene, objective = str(known.get("scene"))[:12], known.get("objective")
            facts = (self.space.assembly.name, scene, objective, self.sampler, self.seed)
            self._copy.open("jld " + " ".join(str(fact) for fact in facts), records.folder / FILE)

    @property
    def settings(self) -> dict[str, Any]:
        """What the sequence of proposals depends on besides space and seed."""
        return {"sampler": self.sampler, "size": self.size, "optuna": version("optuna")}

    def propose(self) -> Bits:
        """The labellings of new trials, filled up at random where trials keep meeting known classes."""
        from optuna.trial import TrialState

        rows: list[Bits] = []
        for _ in range(2 * self.size):
            trial = self._study.ask(self._space)
            row = self.operators.read([trial.params[name] for name in self._space])
            if not len(row):
                self._copy.add(self._study.tell(trial, state=TrialState.PRUNED), {})
                continue
            key = keys(canonical(row, self.space.group))[0]
            if key in self._known:
                self._finish(trial, key, row[0])
                continue
            self._waiting.setdefault(key, []).append(trial)
            if len(self._waiting[key]) == 1:
                rows.append(self.register.admit(row))
                if len(rows) == self.size:
                    break
        rows.append(self.fresh(self.draw, self.size - len(rows)))
        return np.concatenate(rows)

    def tell(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        """Finish the trials of these labellings; those no trial asked for become trials of their own."""
        if not len(labellings):
            return
        values = objectives(self.space, labellings, evaluations)[:, : self.aims].tolist()
        for key, labels, found, value in zip(keys(labellings), labellings, evaluations, values, strict=True):
            self._known[key] = found, value
            for trial in self._waiting.pop(key, []):
                self._finish(trial, key, labels)
                break
            else:
                self._add(labels, found, value)
        self._copy.write()

    def _finish(self, trial: Trial, key: bytes, labels: Bits) -> None:
        from optuna.trial import TrialState

        found, value = self._known[key]
        if found.status is Status.COLLAPSE:
            frozen = self._study.tell(trial, value)
        else:
            frozen = self._study.tell(trial, state=TrialState.PRUNED)
        self._copy.add(frozen, _attributes(labels, found))

    def _add(self, labels: Bits, found: Evaluation, value: list[float]) -> None:
        from optuna.trial import TrialState, create_trial

        params = dict(zip(self._space, self.operators.write(labels), strict=True))
        collapsed = found.status is Status.COLLAPSE
        frozen = create_trial(
            state=TrialState.COMPLETE if collapsed else TrialState.PRUNED,
            values=value if collapsed else None,
            params=params,
            distributions=self._space,
        )
        if self._rest is None:
            self._study.add_trial(frozen)
        self._copy.add(frozen, _attributes(labels, found))


def _attributes(labels: Bits, found: Evaluation) -> dict[str, Any]:
    return {"labelling": to_string(labels), "status": str(found.status)}


class Copy:
    """Finished trials, copied in order into a storage; those it holds already are left as they are.

    url: of the storage, None for a file that is named when it is opened. Raises InputError for one that cannot be used.
    """

    def __init__(self, url: str | None, directions: list[StudyDirection]) -> None:
        self._directions = directions
        self._storage: Any = None if url is None else _storage(url)
        self._study: optuna.Study | None = None
        self._waiting: list[FrozenTrial] = []
        self._there = 0

    def open(self, title: str, file: Path) -> None:
        """Begin to copy. title: of the study in the storage. file: where no other storage was named."""
        from sqlalchemy.exc import SQLAlchemyError

        if self._storage is not None:
            try:
                self._begin(title)
            except SQLAlchemyError as error:
                raise _unusable(title, error) from None
            return
        try:
            self._storage = _journal(file)
            self._begin(title)
        except _ODD:
            # a copy that is damaged is written again, since to resume is to replay
            file.unlink()
            self._storage = _journal(file)
            self._begin(title)

    def _begin(self, title: str) -> None:
        import optuna

        self._study = optuna.create_study(
            storage=self._storage, study_name=title, directions=self._directions, load_if_exists=True
        )
        self._there = len(self._study.get_trials(deepcopy=False))

    def add(self, trial: FrozenTrial, attributes: dict[str, Any]) -> None:
        """Take a trial to be written."""
        if self._study is not None:
            trial.user_attrs = {**trial.user_attrs, **attributes}
            self._waiting.append(trial)

    def write(self) -> None:
        """Write what waits."""
        if self._study is None:
            return
        for trial in self._waiting:
            if self._there > 0:
                self._there -= 1
            else:
                self._study.add_trial(trial)
        self._waiting = []


def _storage(url: str) -> Any:
    from optuna.storages import RDBStorage
    from sqlalchemy.exc import ArgumentError, IntegrityError, ProgrammingError, SQLAlchemyError

    for left in range(_BEGUN, -1, -1):
        try:
            return RDBStorage(url)
        except (IntegrityError, ProgrammingError) as error:
            # searches that begin at once on an empty database make the same tables; one of them is first
            if not left:
                raise _unusable(url, error) from None
            time.sleep(0.5)
        except (ArgumentError, SQLAlchemyError, ImportError) as error:
            raise _unusable(url, error) from None
    raise AssertionError


def _journal(file: Path) -> Any:
    """The journal in the folder of a study, which nobody else writes to: the study's lock sees to that.

    What a killed run left of a line, and its lock, are removed. Raises one of _ODD for a damaged journal.
    """
    from optuna.storages import JournalStorage
    from optuna.storages.journal import JournalFileBackend, JournalFileOpenLock

    file.with_name(f"{file.name}.lock").unlink(missing_ok=True)
    if file.exists():
        whole = file.read_bytes()
        if not whole.endswith(b"\n"):
            with file.open("r+b") as torn:
                torn.truncate(whole.rfind(b"\n") + 1)
    return JournalStorage(JournalFileBackend(str(file), JournalFileOpenLock(str(file))))


def _unusable(url: str, error: Exception) -> InputError:
    return InputError("--storage", f"{url!r} cannot be used ({str(error).splitlines()[0]})", "the URL of a database")
