"""What libraries may print, and how many threads they take."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from command import ROOT
from jld_core import LimitAnalysis, build_assembly, load_scene, one_thread, solve
from jld_explore import ExploreSettings, explore
from jld_explore.evaluation import Evaluator

LOUD = """
import os, highspy
real, greeted = highspy.Highs, []
class Loud(real):
    def __init__(self):
        if not greeted:
            os.write(1, b"a banner\\n")
            greeted.append(True)
        super().__init__()
highspy.Highs = Loud
from jld_core import samples, build_assembly, solve
print(solve(build_assembly(samples.wall(courses=2, length=0.8)), solver="highs").status, greeted)
"""


def test_a_banner_of_highs_is_not_on_stdout() -> None:
    """HiGHS 1.16 greets whoever makes the first instance, before it can be told to be silent."""
    done = subprocess.run([sys.executable, "-c", LOUD], capture_output=True, text=True, check=True)
    assert done.stdout == "collapse [True]\n"


# One thread in products of matrices within our own loops, as many as before outside of them.


def threads() -> set[int]:
    return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}


@contextmanager
def two() -> Iterator[None]:
    """An environment that asks for two threads."""
    with threadpool_limits(limits=2, user_api="blas"):
        if threads() != {2}:
            pytest.skip("the libraries here take one thread whatever they are told")
        yield


def test_the_limit_ends_where_it_began() -> None:
    with two():
        with one_thread(), one_thread():
            assert threads() == {1}
        assert threads() == {2}
        with pytest.raises(ZeroDivisionError), one_thread():
            raise ZeroDivisionError
        assert threads() == {2}


def test_a_solve_and_a_search_take_one_thread(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    seen: list[set[int]] = []
    for owner, name in ((LimitAnalysis, "prove"), (Evaluator, "evaluate_all")):
        whole = getattr(owner, name)

        def noted(*arguments: object, _whole: object = whole, **named: object) -> object:
            seen.append(threads())
            return _whole(*arguments, **named)

        monkeypatch.setattr(owner, name, noted)
    scene = load_scene(ROOT / "scenes" / "flat_beam_arch.json")
    assembly = build_assembly(scene)
    with two():
        solve(assembly)
        LimitAnalysis(assembly).solve(np.ones(len(assembly.labels), dtype=bool))
        settings = ExploreSettings(driver="random", budget=4, jobs=1, pictures=False)
        explore(scene, tmp_path / "out", settings)
        assert threads() == {2}
    assert len(seen) >= 3
    assert seen == [{1}] * len(seen)
