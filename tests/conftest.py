"""What all tests share: the tests' own helpers on the path, a headless canvas, single-threaded BLAS."""

from __future__ import annotations

import gc
import importlib.metadata
import os
import shutil
import signal
import sqlite3
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache, partial
from importlib import import_module
from pathlib import Path
from typing import Any
from zlib import crc32

import pytest

os.environ.setdefault("MPLBACKEND", "Agg")
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")
# a job that a shell put into the background begins with these ignored, and so would every process the tests begin
for name in ("SIGINT", "SIGHUP"):
    number = getattr(signal, name, None)
    if number is not None and signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, signal.default_int_handler)
# without compiled files each process that the tests begin would compile all that it imports: a second of processor time
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False
# files of tests stand in memory where that has room: a small search waited a fifth of its time for the disk
MEMORY = Path("/dev/shm")
if os.access(MEMORY, os.W_OK) and shutil.disk_usage(MEMORY).free > 4 << 30:
    os.environ.setdefault("PYTEST_DEBUG_TEMPROOT", str(MEMORY))
# a sixth of a small search was to read the versions of four packages three times
importlib.metadata.version = cache(importlib.metadata.version)
# most of what tests make stays or goes without the garbage collector, which took 3 s of 4 while all sources were parsed
gc.set_threshold(10_000, 10, 10)
sys.path.insert(0, str(Path(__file__).parent))


class _Unsynced(sqlite3.Connection):
    """A database that leaves to the system when the disk is written: tests kill processes, and never a machine.

    The record of a search waited a tenth of a second for the disk, and that of optuna several times as long.
    """

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        with suppress(sqlite3.DatabaseError):  # a damaged file, which is for whoever reads it to find
            super().execute("PRAGMA synchronous=OFF")

    def execute(self, statement: str, *more: Any) -> sqlite3.Cursor:
        """Keep to it, whatever is asked later."""
        return super().execute("PRAGMA synchronous=OFF" if "PRAGMA synchronous" in statement else statement, *more)


os.fsync = lambda _: None  # optuna's journal, at every trial
for module in (sqlite3, sqlite3.dbapi2):
    module.connect = partial(module.connect, factory=_Unsynced)


# files that take long: begun last, one would keep one core waiting for the other. Those of experiments compile the time
# steps, which the documentation needs as well
LONG = (
    *("test_moving_geometry.py", "test_studies_of_the_experiment.py", "test_planar_experiment.py"),
    *("test_interruption.py", "test_deadline.py", "test_doors.py", "test_move.py", "test_zero_dilation.py"),
    *("test_documentation.py", "test_studio.py", "test_hard_cases.py", "test_studies.py", "test_door.py"),
    *("test_cut.py", "test_design.py"),
)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Leave all rows of a table but one in so many to `make bench`; what takes long goes first."""
    tables: dict[str, list[pytest.Item]] = {}
    for item in items:
        if item.get_closest_marker("sampled") and not item.get_closest_marker("long"):
            tables.setdefault(item.nodeid.partition("[")[0], []).append(item)
    for name, rows in tables.items():
        step = min(rows[0].get_closest_marker("sampled").args[0], len(rows))  # of each table one is asked at least
        first = crc32(name.encode())  # of the same list other rows in every test
        for number, item in enumerate(rows):
            if (first + number + number // step) % step:  # of two lists every value is met
                item.add_marker(pytest.mark.long)
    items.sort(key=lambda item: LONG.index(item.path.name) if item.path.name in LONG else len(LONG))


def pytest_collection_finish() -> None:
    """Leave what was imported and collected, which stays, out of all later collections of garbage."""
    gc.freeze()


@pytest.fixture
def without_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out page and pictures of searches in this process: more than a second each, where only tables are read."""
    from without_pictures import leave_out_pictures  # loads the package, for which the environment above must stand

    leave_out_pictures(monkeypatch.setattr)


def _leave_out_field_check(patch: pytest.MonkeyPatch) -> None:
    # the package has a function of the name of this module
    patch.setattr(import_module("jld_explore.explore"), "plan_check", lambda *_: None)


@pytest.fixture
def without_field_check(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out the check of the best layouts by fields in this process: a third of a search of some dozen layouts."""
    _leave_out_field_check(monkeypatch)


@pytest.fixture(autouse=True, scope="module")
def _unchecked(request: pytest.FixtureRequest) -> Iterator[None]:
    """Tests of searches and doors leave it out, their fixtures too, but for those of searches by fields."""
    with pytest.MonkeyPatch.context() as patch:
        if request.path.parent.name in ("explore", "conformance") and request.path.name != "test_field_searches.py":
            _leave_out_field_check(patch)
        yield


@pytest.fixture
def jld(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., Any]:
    """The command line in this process: arguments → `command.Outcome`."""
    from command import call  # loads the package, for which the environment above must stand

    return partial(call, monkeypatch, capsys)
