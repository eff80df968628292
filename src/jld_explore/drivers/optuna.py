"""Driver for the samplers of Optuna, through ask and tell, with many trials in progress."""

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
from jld_core.errors import InputError, ParameterError
from jld_core.limit.options import Status
from jld_explore.drivers.base import DriverOptions
from jld_explore.drivers.searcher import Searcher
from jld_explore.evaluation import Records
from jld_explore.evaluation.protocol import Evaluation, objectives
from jld_explore.space import keys, to_string
from jld_explore.space.labelling import canonical
from jld_explore.space.search_space import SearchSpace

if TYPE_CHECKING:
    import optuna
    from optuna.distributions import BaseDistribution
    from optuna.study import StudyDirection
    from optuna.trial import FrozenTrial, Trial

# default storage in the folder of a study: a journal; a database takes 58 ms a trial, this 4 ms
FILE: Final = "optuna.journal"
_RETRIES: Final = 4  # number of retries to open a database in which another search is creating its tables

# Packages that some samplers need and that the project does not require
_PACKAGES: Final = {"cmaes": "cmaes", "gp": "torch"}
_SEED_BOUND: Final = 2**32  # bound on seeds of the library: each is below this number

# Exceptions of the library for a journal file that is damaged or in another format
_JOURNAL_ERRORS: Final = (ValueError, KeyError, TypeError, AttributeError)

# Samplers that need more than a seed and thus cannot propose keys
_NOT_FOR_KEYS: Final = ("Base", "BaseGA", "BruteForce", "Grid", "PartialFixed")


def make_sampler(name: str, seed: int) -> tuple[str, optuna.samplers.BaseSampler]:
    """Return the proper name and an Optuna sampler; InputError if it is unknown or lacks a package."""

    def normalized(text: str) -> str:
        """Return a name in lower case, without hyphens and the ending "sampler"."""
        return re.sub(r"[^a-z0-9]", "", text.lower()).removesuffix("sampler")

    import optuna  # imported in functions because the import is slow and few users need it

    names = [other.removesuffix("Sampler") for other in dir(optuna.samplers) if other.endswith("Sampler")]
    sampler_names = {normalized(other): other for other in sorted(names) if other not in _NOT_FOR_KEYS}
    if normalized(name) not in sampler_names:
        raise ParameterError("sampler", f"no sampler is named {name!r}", "one of " + ", ".join(sampler_names.values()))
    needed = _PACKAGES.get(normalized(name))
    if needed is not None and importlib.util.find_spec(needed) is None:
        problem = f"{sampler_names[normalized(name)]} needs the package {needed}, which is not installed"
        raise ParameterError("sampler", problem, "another sampler, or that package")
    kind: Any = getattr(optuna.samplers, sampler_names[normalized(name)] + "Sampler")
    if seed >= _SEED_BOUND:  # the generators of the library accept smaller seeds only
        seed = int(np.random.SeedSequence(seed).generate_state(1)[0])
    sampler: optuna.samplers.BaseSampler = kind(seed=seed)
    return sampler_names[normalized(name)], sampler


class OptunaOptions(DriverOptions):
    sampler: str = Field("TPE", description="its sampler, by name")
    storage: str | None = Field(None, description="URL of its database; default: a file in the folder")


class Optuna(Searcher):
    name = "optuna"
    Options = OptunaOptions

    def __init__(
        self, space: SearchSpace, seed: int, sampler: str = "TPE", storage: str | None = None, size: int = 16
    ) -> None:
        # A trial is a number in [0, 1] for each pair of neighbouring atoms. Layouts without λ are reported as pruned,
        # which samplers rank separately. Finished trials are copied to a storage, so a slow database delays nothing.
        import optuna
        from optuna.distributions import FloatDistribution
        from optuna.study import StudyDirection

        super().__init__(space, seed, size)
        optuna.logging.set_verbosity(optuna.logging.WARNING)  # the log of the library would mix with the output of jld
        self.sampler, sampler_of_library = make_sampler(sampler, seed)
        self.objective_count = 1 + len(space.search.front.axes) if self.sampler.startswith("NSGA") else 1
        self._directions = [StudyDirection.MINIMIZE] * self.objective_count
        self._study = optuna.create_study(sampler=sampler_of_library, directions=self._directions)
        self._storage_copy = StorageCopy(storage, self._directions)
        digits = len(str(self.operators.keys))
        self._space: dict[str, BaseDistribution] = {
            f"key{number:0{digits}d}": FloatDistribution(0.0, 1.0) for number in range(self.operators.keys)
        }
        self._evaluated: dict[bytes, tuple[Evaluation, list[float]]] = {}
        self._waiting: dict[bytes, list[Trial]] = {}

    def start(self, deadline: Deadline | None, heartbeat: Callable[[], None], records: Records | None = None) -> None:
        if records is not None:
            header = records.header
            scene, objective = str(header.get("scene"))[:12], header.get("objective")
            facts = (self.space.assembly.name, scene, objective, self.sampler, self.seed)
            self._storage_copy.open("jld " + " ".join(str(fact) for fact in facts), records.folder / FILE)

    @property
    def settings(self) -> dict[str, Any]:
        return {"sampler": self.sampler, "size": self.size, "optuna": version("optuna")}

    def propose(self) -> Bits:
        # Trials of known classes are finished at once; random labellings fill their places. Labellings are registered
        # as proposed.
        from optuna.trial import TrialState

        rows: list[Bits] = []
        for _ in range(2 * self.size):
            trial = self._study.ask(self._space)
            row = self.operators.read(np.array([[trial.params[name] for name in self._space]]))[0]
            if not len(row):
                self._storage_copy.add(self._study.tell(trial, state=TrialState.PRUNED), {})
                continue
            key = keys(canonical(row, self.space.group))[0]
            if key in self._evaluated:
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
        # A labelling that no trial proposed is added to the study as a finished trial.
        if not len(labellings):
            return
        values = objectives(self.space, labellings, evaluations)[:, : self.objective_count].tolist()
        for key, labels, evaluation, value in zip(keys(labellings), labellings, evaluations, values, strict=True):
            self._evaluated[key] = evaluation, value
            trials = self._waiting.pop(key, [])
            for trial in trials:
                self._finish(trial, key, labels)
            if not trials:
                self._add(labels, evaluation, value)
        self._storage_copy.write()

    def _finish(self, trial: Trial, key: bytes, labels: Bits) -> None:
        """Finish a trial with the known evaluation of its class, and queue it for the storage."""
        from optuna.trial import TrialState

        evaluation, value = self._evaluated[key]
        if evaluation.status is Status.COLLAPSE:
            frozen = self._study.tell(trial, value)
        else:
            frozen = self._study.tell(trial, state=TrialState.PRUNED)
        self._storage_copy.add(frozen, _attributes(labels, evaluation))

    def _add(self, labels: Bits, evaluation: Evaluation, value: list[float]) -> None:
        """Add a finished trial for labels (m,) that no trial proposed."""
        from optuna.trial import TrialState, create_trial

        params = dict(zip(self._space, self.operators.write(labels[None])[0].tolist(), strict=True))
        collapsed = evaluation.status is Status.COLLAPSE
        frozen = create_trial(
            state=TrialState.COMPLETE if collapsed else TrialState.PRUNED,
            values=value if collapsed else None,
            params=params,
            distributions=self._space,
        )
        if self._enumeration is None:
            self._study.add_trial(frozen)
        self._storage_copy.add(frozen, _attributes(labels, evaluation))


def _attributes(labels: Bits, evaluation: Evaluation) -> dict[str, Any]:
    return {"labelling": to_string(labels), "status": str(evaluation.status)}


class StorageCopy:
    """Copy of finished trials in a storage, without those it holds already."""

    def __init__(self, url: str | None, directions: list[StudyDirection]) -> None:
        self._directions = directions
        self._storage: Any = None if url is None else _storage(url)
        self._study: optuna.Study | None = None
        self._waiting: list[FrozenTrial] = []
        self._already_stored = 0

    def open(self, title: str, file: Path) -> None:
        """Open the storage and start copying; InputError if it cannot be used."""
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
        except _JOURNAL_ERRORS:
            # a damaged copy is written anew, because a resumed study replays all trials
            file.unlink()
            self._storage = _journal(file)
            self._begin(title)

    def _begin(self, title: str) -> None:
        """Load or create the study in the storage, and count its trials."""
        import optuna

        self._study = optuna.create_study(
            storage=self._storage, study_name=title, directions=self._directions, load_if_exists=True
        )
        self._already_stored = len(self._study.get_trials(deepcopy=False))

    def add(self, trial: FrozenTrial, attributes: dict[str, Any]) -> None:
        """Queue a finished trial with user attributes for `write`; ignored before `open`."""
        if self._study is not None:
            trial.user_attrs = {**trial.user_attrs, **attributes}
            self._waiting.append(trial)

    def write(self) -> None:
        """Write the queued trials to the storage, and empty the queue; ignored before `open`."""
        # As many first trials are skipped as the storage held when it was opened.
        if self._study is None:
            return
        for trial in self._waiting:
            if self._already_stored > 0:
                self._already_stored -= 1
            else:
                self._study.add_trial(trial)
        self._waiting = []


def _storage(url: str) -> Any:
    """Open a database, and retry while another search creates its tables."""
    from optuna.storages import RDBStorage
    from sqlalchemy.exc import ArgumentError, IntegrityError, ProgrammingError, SQLAlchemyError

    for retries_left in range(_RETRIES, -1, -1):
        try:
            return RDBStorage(url)
        except (IntegrityError, ProgrammingError) as error:
            # searches that start at the same time on an empty database create the same tables; one succeeds
            if not retries_left:
                raise _unusable(url, error) from None
            time.sleep(0.5)
        except (ArgumentError, SQLAlchemyError, ImportError) as error:
            raise _unusable(url, error) from None
    raise AssertionError


def _journal(file: Path) -> Any:
    # The lock of the study excludes other writers, so a lock file and an incomplete line of a killed run are removed.
    # One of `_JOURNAL_ERRORS` is raised for a damaged journal.
    from optuna.storages import JournalStorage
    from optuna.storages.journal import JournalFileBackend, JournalFileOpenLock

    file.with_name(f"{file.name}.lock").unlink(missing_ok=True)
    if file.exists():
        content = file.read_bytes()
        if not content.endswith(b"\n"):
            with file.open("r+b") as stream:
                stream.truncate(content.rfind(b"\n") + 1)
    return JournalStorage(JournalFileBackend(str(file), JournalFileOpenLock(str(file))))


def _unusable(url: str, error: Exception) -> InputError:
    return ParameterError("storage", f"{url!r} cannot be used ({str(error).splitlines()[0]})", "the URL of a database")
