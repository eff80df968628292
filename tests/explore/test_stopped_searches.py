"""Signals at awkward moments: between search and tables, twice, and while modules are loading."""

from __future__ import annotations

import importlib
import os
import signal
import sys
from pathlib import Path
from typing import Any

import pytest

from jld_core import samples
from jld_explore import ExploreSettings, explore
from jld_explore import __main__ as entry
from jld_explore.cli import command, ending, streams
from jld_explore.cli.ending import raise_on_signals
from jld_explore.drivers.genetic import Genetic
from jld_explore.evaluation.records import RECORDS_FILE, recorded_driver
from jld_explore.search.state import Interrupted


def test_a_signal_between_search_and_tables_leaves_page_and_load_factor(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A signal while all layouts were bounded after a search left neither tables nor page."""
    module = importlib.import_module("jld_explore.explore")
    bound_all, calls = module._bound_all, []

    def interrupted(*arguments: Any, **options: Any) -> None:
        calls.append(1)
        if len(calls) == 1:
            raise Interrupted
        bound_all(*arguments, **options)

    monkeypatch.setattr(module, "_bound_all", interrupted)
    with pytest.raises(Interrupted) as stop:
        explore(samples.grid(columns=4, rows=3), tmp_path / "out", driver="random", budget=20, jobs=1)
    facts = stop.value.done.summary
    assert (len(stop.value.done.results), facts.stop_reason) == (20, "interrupted")
    assert facts.best is not None
    assert (tmp_path / "out" / "report.html").exists()


def test_a_second_signal_waits_while_results_are_written(monkeypatch: pytest.MonkeyPatch) -> None:
    """An impatient second Ctrl-C left a search without tables; one that comes much later ends it."""
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    clock = 100.0
    monkeypatch.setattr(ending.time, "monotonic", lambda: clock)
    try:
        raise_on_signals()
        with pytest.raises(Interrupted):
            os.kill(os.getpid(), signal.SIGINT)
        clock += 1.0
        os.kill(os.getpid(), signal.SIGINT)
        os.kill(os.getpid(), signal.SIGTERM)
        clock += 60.0
        with pytest.raises(Interrupted):
            os.kill(os.getpid(), signal.SIGTERM)
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)


def test_a_signal_while_modules_load_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def stop() -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(streams, "open_streams", stop)
    with pytest.raises(SystemExit) as end:
        entry.main()
    assert end.value.code == streams.STOPPED
    assert capsys.readouterr().err == f"{streams.STOPPED_WORDS}\n"


def test_a_signal_before_the_driver_proposes_leaves_one_layout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A driver that looks for its first layouts for minutes left a search without λ after Ctrl-C."""

    def stop(*_: object) -> None:
        raise Interrupted

    scene = samples.grid(columns=4, rows=3)
    wanted: dict[str, Any] = {"driver": "genetic", "jobs": 1, "budget": 30}
    with monkeypatch.context() as patched:
        patched.setattr(Genetic, "ask", stop)
        with pytest.raises(Interrupted) as stopped:
            explore(scene, tmp_path / "out", **wanted)
    done = stopped.value.done
    assert (len(done.results), done.summary.stop_reason) == (1, "interrupted")
    assert done.summary.best is not None
    assert (tmp_path / "out" / "report.html").exists()
    # that layout, which no driver proposed, is not part of the search when it goes on
    resumed = explore(scene, tmp_path / "out", **wanted, resume=True, pictures=False).results
    whole = explore(scene, tmp_path / "whole", **wanted, pictures=False).results
    assert resumed["labelling"].tolist() == whole["labelling"].tolist()


def test_a_search_goes_on_with_the_driver_that_it_has(tmp_path: Path) -> None:
    """With more time a space counts as small, and --resume asked for the driver that had been chosen without."""
    scene, settings = samples.grid(columns=3, rows=2), ExploreSettings(jobs=1, pictures=False, check_fields=0)
    begun = explore(scene, tmp_path / "out", settings, budget=5, driver="random")
    assert begun.summary.facts["driver"] == "random"
    done = explore(scene, tmp_path / "out", settings, resume=True)
    assert (done.summary.facts["driver"], done.summary.proven) == ("random", True)
    assert explore(scene, tmp_path / "other", settings).summary.facts["driver"] == "enumeration"
    assert recorded_driver(tmp_path / "out" / RECORDS_FILE) == "random"
    (tmp_path / "broken").write_bytes(b"no record at all")
    assert recorded_driver(tmp_path / "broken") is None


def test_a_signal_while_the_process_ends_does_not_replace_its_exit_code(monkeypatch: pytest.MonkeyPatch) -> None:
    """Python resets its handlers before it ends, so that SIGINT then killed a search that was complete.

    A command that is called within a process leaves its signals alone.
    """
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    monkeypatch.setattr(sys, "argv", ["jld", "--version"])
    try:
        with pytest.raises(SystemExit) as end:
            command.main()
        assert end.value.code == 0
        assert signal.SIG_IGN not in [signal.getsignal(number) for number in handlers]
        with pytest.raises(SystemExit) as end:
            entry.main()
        assert end.value.code == 0
        assert [signal.getsignal(number) for number in handlers] == [signal.SIG_IGN] * 2
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
