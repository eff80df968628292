"""A driver of one's own: handed in or by name, with options, facts and a record to go on with."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from pydantic import Field

from cases import every_layout, grid_document
from command import Command
from jld_core import InputError, Scene, build_assembly, parse_scene
from jld_explore import Driver, Evaluation, ExploreSettings, SearchSpace, explore, search_space
from jld_explore.drivers import DRIVERS, DriverOptions


class BackwardsOptions(DriverOptions):
    step: int = Field(5, ge=1, description="labellings asked at a time")


class Backwards(Driver):
    """Enumeration from its far end, some at a time."""

    name = "backwards"
    Options = BackwardsOptions

    def __init__(self, space: SearchSpace, seed: int = 0, step: int = 5) -> None:
        super().__init__(space, seed)
        self.left = every_layout(space)[::-1]
        self.step, self.told = step, 0

    @property
    def settings(self) -> dict[str, Any]:
        return {"step": self.step}

    def ask(self, limit: int | None = None) -> np.ndarray:
        count = self.step if limit is None else min(limit, self.step)
        rows, self.left = self.left[:count], self.left[count:]
        return rows

    def tell(self, labellings: np.ndarray, evaluations: Sequence[Evaluation]) -> None:
        self.told += len(evaluations)

    def facts(self, results: pd.DataFrame, complete: bool) -> dict[str, Any]:
        return {"told": self.told, "rows": len(results), "complete": complete}


def scene() -> Scene:
    return parse_scene(grid_document(["aaa", "aaa", "###"], block_cells=[1, 3]))


def space_of(found: Scene) -> SearchSpace:
    return search_space(found, build_assembly(found))


def run(folder: Path, driver: Any, **settings: Any) -> Any:
    return explore(scene(), folder, ExploreSettings(pictures=False, **settings), driver=driver)


def plain(table: pd.DataFrame) -> pd.DataFrame:
    return table.drop(columns=["seconds", "driver"])


@pytest.fixture
def named() -> Iterator[None]:
    DRIVERS[Backwards.name] = Backwards
    yield
    del DRIVERS[Backwards.name]


def test_a_driver_object_can_be_given_to_explore(tmp_path: Path) -> None:
    every = run(tmp_path / "every", "enumeration")
    done = run(tmp_path / "own", Backwards(space_of(scene())))
    pd.testing.assert_frame_equal(plain(done.results), plain(every.results))
    assert set(done.results["driver"]) == {"backwards"}
    facts = done.summary.facts
    assert (facts["driver"], facts["told"], facts["rows"]) == ("backwards", *[len(every.results)] * 2)
    # it has never said that it goes through everything, so nothing is proven by its end
    assert (facts["stop_reason"], facts["proven"], facts["complete"]) == ("exhausted", False, False)


def test_a_search_with_an_own_driver_is_resumed(tmp_path: Path) -> None:
    whole = run(tmp_path / "whole", Backwards(space_of(scene())), budget=40)
    run(tmp_path / "part", Backwards(space_of(scene())), budget=15)
    rest = run(tmp_path / "part", Backwards(space_of(scene())), budget=40, resume=True)
    assert rest.summary.solved == 25
    pd.testing.assert_frame_equal(plain(rest.results), plain(whole.results))
    with pytest.raises(InputError, match="driver's step 5, not 6"):
        run(tmp_path / "part", Backwards(space_of(scene()), step=6), resume=True)


def test_a_driver_of_another_scene_is_refused(tmp_path: Path) -> None:
    other = parse_scene(grid_document(["aaaa", "####"], block_cells=[1, 3]))
    with pytest.raises(InputError, match="made for the space of another scene"):
        run(tmp_path / "out", Backwards(space_of(other)))
    assert not (tmp_path / "out").exists()


def test_a_registered_driver_is_used_by_its_name(named: None, tmp_path: Path) -> None:
    done = run(tmp_path / "out", "backwards", options={"step": 7})
    assert done.summary.driver == "backwards"
    for options, words in (
        ({"step": 0}, "step: 0 is wrong; expected a whole number greater than or equal to 1"),
        ({"step": "many"}, "step: 'many' is wrong; expected a whole number"),
        (
            {"aim": "best"},
            'aim: the driver backwards has no such option; expected `driver="genetic"` or `driver="exact"`',
        ),
        ({"stride": 2}, "stride: the driver backwards has no such option"),
    ):
        with pytest.raises(InputError) as error:
            run(tmp_path / "bad", "backwards", options=options)
        assert words in str(error.value)
    assert not (tmp_path / "bad").exists()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--driver", "genetic", "--population", "2"], ("--population: '2' is wrong", "greater than or equal to 4")),
        (["--driver", "genetic", "--population", "few"], ("--population: 'few' is wrong", "a whole number")),
        (["--driver", "exact", "--aim", "both"], ("--aim: 'both' is wrong", "one of best or front")),
        (["--driver", "random", "--sampler", "TPE"], ("--sampler", "no such option", "--driver optuna")),
        (["--driver", "optuna", "--sampler", "dice"], ("--sampler: no sampler is named 'dice'",)),
        (["--driver", "hillclimb", "--start", "dd"], ("letters d or i",)),
    ],
)
def test_errors_of_options_follow_from_the_driver(
    options: list[str], words: tuple[str, ...], tmp_path: Path, jld: Command
) -> None:
    file = tmp_path / "scene.json"
    file.write_text(scene().model_dump_json(exclude_defaults=True))
    outcome = jld("explore", file, "--out", tmp_path / "out", *options)
    assert (outcome.code, outcome.out, outcome.err.count("\n")) == (2, "", 1)
    for word in words:
        assert word in outcome.err
    assert not (tmp_path / "out").exists()


def test_help_follows_from_the_drivers(tmp_path: Path, jld: Command) -> None:
    said = " ".join(jld("explore", "--help").out.split())
    for kind in DRIVERS.values():
        for name, field in kind.Options.model_fields.items():
            assert f"--{name}" in said
            assert str(field.description) in said
