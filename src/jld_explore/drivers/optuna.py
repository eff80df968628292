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
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import optuna
from optuna.distributions import BaseDistribution, FloatDistribution
from optuna.storages import RDBStorage
from optuna.study import StudyDirection
from optuna.trial import FrozenTrial, Trial, TrialState, create_trial

from jld_core.arrays import Bits
from jld_core.errors import InputError
from jld_core.limit import Status
from jld_explore.drivers.searcher import Searcher
from jld_explore.evaluation import Evaluation, objectives
from jld_explore.space import SearchSpace, canonical, keys, to_string

FILE: Final = "optuna.sqlite3"
"""Name of the default storage in the folder of a study."""

_NEEDS: Final = {"cmaes": "cmaes", "gp": "torch"}
"""Packages that some samplers need and that are not among our own requirements."""

_NOT_FOR_KEYS: Final = ("Base", "BaseGA", "BruteForce", "Grid", "PartialFixed")
"""Samplers that cannot propose keys without being told more than a seed."""


def sampler_names() -> list[str]:
    """Names that `--sampler` takes."""
    names = [name.removesuffix("Sampler") for name in dir(optuna.samplers) if name.endswith("Sampler")]
    return sorted(name for name in names if name not in _NOT_FOR_KEYS)


def make_sampler(name: str, seed: int) -> tuple[str, optuna.samplers.BaseSampler]:
    """The sampler's own name, and a fresh one of it.

    name: with or without "Sampler", in any case and with or without hyphens. Raises InputError for a name
    that is none, and for a sampler whose package is not installed.
    """

    def plain(text: str) -> str:
        return re.sub(r"[^a-z0-9]", "", text.lower()).removesuffix("sampler")

    known = {plain(other): other for other in sampler_names()}
    if plain(name) not in known:
        raise InputError("--sampler", f"no sampler is named {name!r}", "one of " + ", ".join(known.values()))
    needed = _NEEDS.get(plain(name))
    if needed is not None and importlib.util.find_spec(needed) is None:
        problem = f"{known[plain(name)]} needs the package {needed}, which is not installed"
        raise InputError("--sampler", problem, "another sampler, or that package")
    kind: Any = getattr(optuna.samplers, known[plain(name)] + "Sampler")
    sampler: optuna.samplers.BaseSampler = kind(seed=seed)
    return known[plain(name)], sampler


class Optuna(Searcher):
    """Trials of one sampler, `size` in flight.

    sampler: its name. storage: URL of a database, a file to make one in, or None for none. title: the
    study's name there. Samplers made for several objectives get two, λ and the scene's count; others λ alone.
    """

    name = "optuna"

    def __init__(
        self,
        space: SearchSpace,
        seed: int,
        sampler: str = "TPE",
        storage: str | Path | None = None,
        title: str = "jld",
        size: int = 16,
    ) -> None:
        super().__init__(space, seed, size)
        optuna.logging.set_verbosity(optuna.logging.WARNING)  # its log would land among our own output
        self.sampler, chosen = make_sampler(sampler, seed)
        self.aims = 2 if self.sampler.startswith("NSGA") else 1
        directions = [StudyDirection.MINIMIZE] * self.aims
        self._study = optuna.create_study(sampler=chosen, directions=directions, study_name=title)
        width = len(str(self.operators.keys))
        self._space: dict[str, BaseDistribution] = {
            f"key{number:0{width}d}": FloatDistribution(0.0, 1.0) for number in range(self.operators.keys)
        }
        self._known: dict[bytes, tuple[Evaluation, list[float]]] = {}
        self._waiting: dict[bytes, list[Trial]] = {}
        self._copy = Copy(storage, title, directions)

    @property
    def settings(self) -> dict[str, Any]:
        """What the sequence of proposals depends on besides space and seed."""
        return {"sampler": self.sampler, "size": self.size, "optuna": optuna.__version__}

    def propose(self) -> Bits:
        """The labellings of new trials, filled up at random where trials keep meeting known classes."""
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
        found, value = self._known[key]
        if found.status is Status.COLLAPSE:
            frozen = self._study.tell(trial, value)
        else:
            frozen = self._study.tell(trial, state=TrialState.PRUNED)
        self._copy.add(frozen, _attributes(labels, found))

    def _add(self, labels: Bits, found: Evaluation, value: list[float]) -> None:
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
    """Finished trials, copied in order into a storage; those it holds already are left as they are."""

    def __init__(self, storage: str | Path | None, title: str, directions: list[StudyDirection]) -> None:
        self._storage, self._title, self._directions = storage, title, directions
        self._study: optuna.Study | None = None
        self._waiting: list[FrozenTrial] = []
        self._there = 0
        if isinstance(storage, str):
            self._open()

    def add(self, trial: FrozenTrial, attributes: dict[str, Any]) -> None:
        """Take a trial to be written."""
        if self._storage is not None:
            trial.user_attrs = {**trial.user_attrs, **attributes}
            self._waiting.append(trial)

    def write(self) -> None:
        """Write what waits."""
        if self._storage is None:
            return
        study = self._study or self._open()
        for trial in self._waiting:
            if self._there > 0:
                self._there -= 1
            else:
                study.add_trial(trial)
        self._waiting = []

    def _open(self) -> optuna.Study:
        """Open the storage; a file only now, because its folder is made after the driver."""
        from sqlalchemy import event
        from sqlalchemy.exc import ArgumentError, SQLAlchemyError

        file = isinstance(self._storage, Path)
        url = f"sqlite:///{self._storage}" if file else str(self._storage)
        try:
            storage = RDBStorage(url)
            if file:
                # our own store is the record and this a copy: no need to wait for the disk
                event.listen(storage.engine, "connect", _hurry)
                storage.engine.dispose()
            self._study = optuna.create_study(
                storage=storage, study_name=self._title, directions=self._directions, load_if_exists=True
            )
        except (ArgumentError, SQLAlchemyError, ImportError) as error:
            problem = f"{url!r} cannot be used ({str(error).splitlines()[0]})"
            raise InputError("--storage", problem, "the URL of a database") from None
        self._there = len(self._study.get_trials(deepcopy=False))
        return self._study


def _hurry(connection: Any, _: Any) -> None:
    connection.execute("PRAGMA synchronous=OFF")
    connection.execute("PRAGMA journal_mode=MEMORY")
