"""The iteration without dilation, visible: starts, shares and steps, beside the interval of all solutions."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd
import pytest
from studies.scenes import leonardo_flat_arch

import jld_core as jc
from command import Command, saved


@pytest.fixture(scope="module")
def arch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return saved(
        tmp_path_factory.mktemp("arch") / "arch.json", leonardo_flat_arch().model_dump(mode="json", exclude_unset=True)
    )


@pytest.mark.parametrize(("start", "alpha"), [("gravity", 0.5)])
def test_every_step_is_written_and_the_last_is_the_answer(jld: Command, arch: Path, start: str, alpha: float) -> None:
    path = arch.with_name(f"{start}.csv")
    options = ("--friction", "zero-dilation", "--start", start, "--alpha", alpha, "--no-sensitivities", "--json")
    answer, steps = json.loads(jld("solve", arch, *map(str, options), "--history", path).done().out), pd.read_csv(path)
    assert list(steps["step"]) == list(range(1, len(steps) + 1))
    assert steps["alpha"][0] == alpha
    last = steps.iloc[-1]
    assert last["kind"] == "least gap"
    assert last["load_factor"] == pytest.approx(answer["load_factor"], rel=1e-9)
    assert last["friction_violation"] == answer["friction_violation"]
    assert last["complementarity_gap"] == pytest.approx(answer["complementarity_gap"], abs=1e-12)
    assert 1305.0 < answer["load_factor"] < answer["associative_load_factor"] * (1 + 1e-6)
    assert path.with_suffix(".png").stat().st_size > 5_000


def test_the_start_decides_which_solution_is_found(arch: Path) -> None:
    low, high = (jc.solve(arch, friction="zero-dilation", start=one).load_factor for one in ("gravity", "associative"))
    assert low < 0.7 * high


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--start", "gravity"), "--start: friction with dilation needs no iteration"),
        (("--history", "x.csv"), "--history: only friction without dilation of whole faces iterates"),
        (("--friction", "zero-dilation", "--history", "x.txt"), "'x.txt' is no table; expected a file with the ending"),
        (("--friction", "zero-dilation", "--alpha", "2"), "--alpha: 2 is no share; expected a number from 0 to 1"),
        (("--friction", "zero-dilation", "--start", "3"), "--start: '3' is wrong; expected one of"),
    ],
)
def test_what_cannot_iterate_is_refused(jld: Command, arch: Path, options: tuple[str, ...], words: str) -> None:
    jld("solve", arch, *options).refused(words)
