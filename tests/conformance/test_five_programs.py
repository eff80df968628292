"""Programs of a user who knows SciPy and Optuna, written without reading the source: each runs as it stands."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import jld_core as jc
import jld_explore as je
from cases import grid_document
from command import ROOT


@pytest.fixture(autouse=True)
def in_a_folder_with_an_arch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copy(ROOT / "scenes" / "flat_beam_arch.json", tmp_path / "arch.json")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))


def test_one_sweep_of_friction() -> None:
    found = {}
    for friction in (0.3, 0.5, 0.7):
        arch = jc.samples.arch(voussoirs=8, stone=jc.samples.Stone(friction=friction))
        result = jc.solve(arch)
        found[friction] = result.load_factor if result.status == "collapse" else np.nan
    assert found[0.7] >= found[0.5]


def test_two_solve_from_a_path() -> None:
    result = jc.solve("arch.json", friction="zero-dilation")
    low, high = result.bracket
    assert low <= result.load_factor <= high
    assert result.zero_dilation.associative_load_factor is not None
    result.plot().savefig("arch.png")
    forces = result.to_frame()
    assert forces.loc[forces["label"] == "dry", "N"].min() >= -1e-6 * forces["N"].max()


def test_three_own_labels() -> None:
    assembly = jc.build_assembly(jc.load_scene("arch.json"))
    letters = "".join("d" if dry else "i" for dry in assembly.labels)
    own = jc.solve(assembly, letters)
    assert own.load_factor == jc.solve(assembly).load_factor == jc.solve(assembly, list(letters)).load_factor
    with pytest.raises(jc.InputError, match="labels: "):
        jc.solve(assembly, letters[1:])


def test_four_many_labellings() -> None:
    assembly = jc.build_assembly(jc.load_scene("arch.json"))
    labels = np.random.default_rng(0).random((200, len(assembly.interfaces))) < 0.8
    many = jc.solve_many(assembly, labels)
    table = many.to_frame()
    assert len(table) == 200
    if many.best is not None:
        assert table["load_factor"].idxmax() == many.best
        assert (
            (table["bracket_lo"] <= table["load_factor"] * (1.0 + 1e-12))
            .where(table["status"] == "collapse", True)
            .all()
        )


def test_five_a_search_with_a_function() -> None:
    scene = jc.parse_scene(grid_document(["aaa", "aaa", "###"], block_cells=[1, 3]))

    def per_joint(evaluation: je.Evaluation, assembly: jc.Assembly, labels: Any) -> float:
        return float(evaluation.load_factor / (1 + labels[assembly.free_faces].sum()))

    found = je.explore(scene, driver="enumeration", objective=per_joint, pictures=False)
    results = found.results[found.results["status"] == "collapse"]
    np.testing.assert_allclose(
        results["load_factor"], results["load_factor_associative"] / (1 + results["dry_faces"]), rtol=1e-12
    )
    assert results["load_factor"].is_monotonic_decreasing
    every = je.explore(scene, driver="enumeration", pictures=False).results
    assert every["load_factor"].max() == pytest.approx(results["load_factor_associative"].max(), rel=1e-5)
    assert found.summary.best == results["load_factor"].iloc[0]
    assert (found.summary.proven, found.summary.bound, found.summary.next) == (False, None, None)
    assert "per_joint" in found.summary.facts["own_objective"]
    assert found.folder.parent.samefile(Path.cwd())


PROGRAM = """
import jld_core as jc, jld_explore as je
r = jc.solve("arch.json", friction="zero-dilation")      # path, Scene or Assembly; typed keyword arguments
r.plot(); r.to_frame()                                    # forces per interface with column names and units
r.zero_dilation.lowest_proven                             # dataclasses, not result.extra["..."]
many = jc.solve_many(assembly, labellings)                # the batch solver: 50 to 150 times faster per labelling
s = je.explore("arch.json", driver="exact", seconds=60)   # out=None: temporary folder; str and Path accepted
"""
"""The program that the design of version 0.3 promises, word for word."""


def test_the_program_of_the_design() -> None:
    assembly = jc.build_assembly(jc.load_scene("arch.json"))
    names: dict[str, Any] = {"assembly": assembly, "labellings": np.array([assembly.labels] * 3)}
    exec(PROGRAM, names)
    r, many, s = names["r"], names["many"], names["s"]
    assert r.status == "collapse"
    assert many.load_factor == pytest.approx(many.load_factor[0])
    assert s.summary.best is not None
    assert s.summary.proven


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"driver": "exact"}, "`driver` needs λ"),
        ({"certificate": "proof.jld"}, "`certificate` needs λ"),
        ({"experiment": 3}, "`experiment` needs λ"),
    ],
)
def test_options_that_an_own_objective_excludes(more: dict[str, Any], words: str) -> None:
    scene = jc.parse_scene(grid_document(["aa", "##"]))
    with pytest.raises(jc.InputError, match=rf"^objective: {words}"):
        je.explore(scene, "out", objective=lambda evaluation, assembly, labels: 1.0, **more)
    assert not Path("out").exists()


def test_values_that_an_objective_may_return() -> None:
    scene = jc.parse_scene(grid_document(["aa", "##"]))
    with pytest.raises(jc.InputError, match=r"^objective: it is nan for the labelling [di]+; expected a finite number"):
        je.explore(scene, objective=lambda evaluation, assembly, labels: float("nan"), pictures=False)
    with pytest.raises(jc.InputError, match=r"^objective: no objective is named 'mass'"):
        je.explore(scene, objective="mass")
    before = sorted(Path.cwd().iterdir())
    with pytest.raises(jc.InputError, match=r"^driver: no driver is named"):
        je.explore(scene, driver="exakt")
    assert sorted(Path.cwd().iterdir()) == before  # no empty folder is left


def test_settings_by_keywords_and_by_parts_are_one() -> None:
    parts = je.ExploreSettings.of(
        je.BudgetSettings(budget=6), je.SearchMethod("random", seed=2), je.OutputSettings(pictures=False)
    )
    assert parts == je.ExploreSettings(driver="random", budget=6, seed=2, pictures=False)
    scene = jc.parse_scene(grid_document(["aaa", "aaa", "###"], block_cells=[1, 3]))
    by_parts = je.explore(scene, "parts", parts).results
    by_keywords = je.explore(scene, Path("words"), driver="random", budget=6, seed=2, pictures=False).results
    assert by_parts["labelling"].tolist() == by_keywords["labelling"].tolist()
    for wrong, words in (
        ({"budget": 0}, "^budget: 0 is no number of layouts"),
        ({"seconds": -1.0}, "^seconds: -1 is no time limit"),
        ({"jobs": 0}, "^jobs: 0 is no number of processes"),
        ({"driver": "exakt"}, "^driver: no driver is named 'exakt'"),
        ({"resume": True}, "^out: a search is resumed in its own folder"),
    ):
        with pytest.raises(jc.InputError, match=words):
            je.explore(scene, **wrong)
