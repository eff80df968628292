"""Cells that may be left out: which layouts there are, and that each is the structure drawn without them."""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases import every_layout, grid_document
from command import Command
from jld_core import InputError, Scene, build_assembly, parse_scene, solve
from jld_explore import ExploreSettings, explore, read_folder, search_space
from jld_explore.space import cut
from jld_explore.space.labelling import omitted

ROWS = ["aaa", "aaa", "###"]
LIMITS = {"block_cells": [1, 2], "dry_faces": [2, None]}


def scene_of(rows: list[str] = ROWS, void: Any = None, **search: Any) -> Scene:
    """A wall pushed by a share of its weight and at the middle of its top."""
    document = grid_document(rows, **{**LIMITS, "symmetry": "none", **search})
    document["loads"] = {"live": [{"element": "c1r0", "force": [1e-3, 0]}, {"body": [0.1, 0]}]}
    if void is not None:
        document["search"]["void"] = void
    return parse_scene(document)


def drawn_without(cells: tuple[str, ...]) -> Scene | None:
    """The scene without some cells; None where something then hangs in the air."""
    rows = [
        "".join("." if f"c{x}r{y}" in cells else letter for x, letter in enumerate(row)) for y, row in enumerate(ROWS)
    ]
    try:
        scene = scene_of(rows)
        build_assembly(scene)
    except InputError:
        return None
    return scene


@pytest.fixture(scope="module")
def every(tmp_path_factory: pytest.TempPathFactory) -> Any:
    scene = scene_of(void={"most": 0.34}, front={"count": "mass", "sense": "min"})
    return explore(scene, tmp_path_factory.mktemp("void") / "every", ExploreSettings(driver="enumeration"))


@pytest.mark.usefixtures("without_pictures")
def test_all_layouts_of_all_structures(every: Any) -> None:
    """Brute force over what may be left out: every structure that is drawn without, with all of its own layouts."""
    cells = [f"c{x}r{y}" for y in range(2) for x in range(3) if (x, y) != (1, 0)]
    found = dict(zip(every.results["labelling"], every.results.to_dict("records"), strict=True))
    assert len(found) == len(every.results)
    seen = 0
    for gone in itertools.chain(*(itertools.combinations(cells, k) for k in (0, 1, 2))):
        scene = drawn_without(gone)
        if scene is None:
            continue
        space = search_space(scene, build_assembly(scene))
        own = {text for text in found if {every.assembly.elements.ids[k] for k in _rows(every, text)} == set(gone)}
        bits = every_layout(space)
        assert len(own) == len(bits)
        seen += len(own)
        pairs = {tuple(row) for row in bits.tolist()}
        assert {tuple(cut(every.assembly, text)[1].tolist()) for text in own} == pairs
    assert seen == len(found)


def _rows(every: Any, text: str) -> list[int]:
    found: list[int] = np.flatnonzero(omitted(every.assembly, text)).tolist()
    return found


def test_a_layout_with_cells_left_out_equals_the_scene_without_them(every: Any) -> None:
    """λ and counts of a layout with cells left out are those of the scene drawn without them."""
    some = every.results[every.results["labelling"].str.contains("v")].iloc[::17]
    assert len(some) > 5
    for row in some.to_dict("records"):
        gone = tuple(every.assembly.elements.ids[k] for k in _rows(every, row["labelling"]))
        scene = drawn_without(gone)
        assert scene is not None
        assembly = build_assembly(scene)
        labels = cut(every.assembly, row["labelling"])[1]
        result = solve(assembly, labels)
        assert str(result.status) == row["status"]
        if row["status"] == "collapse":
            assert row["load_factor"] == pytest.approx(result.load_factor, rel=1e-6)
        space = search_space(scene, assembly)
        assert row["mass"] == pytest.approx(float(assembly.elements.mass[assembly.elements.free].sum()))
        from jld_explore.space.counts import counts

        for name, values in counts(assembly, labels[None], space.graph, space.limits.block_shapes).items():
            assert row[name] == pytest.approx(float(values[0])), name


def test_the_strongest_for_its_weight(every: Any) -> None:
    masses = every.front["mass"].to_numpy()
    assert len(masses) > 1
    assert every.front["evidence"].eq("proven").all()
    assert (np.diff(every.front["load_factor"].to_numpy(dtype=float)) <= 0.0).all()
    assert every.summary.proven
    for file in ("pareto.png", "best.png", "report.html", "blocks.csv"):
        assert (every.folder / file).exists()


def test_other_drivers_keep_to_the_same_layouts(every: Any, tmp_path: Path) -> None:
    known = dict(zip(every.results["labelling"], every.results["load_factor"], strict=True))
    for driver in ("genetic", "hillclimb", "random"):
        settings = ExploreSettings(driver=driver, budget=40, pictures=False)
        done = explore(every.scene, tmp_path / driver, settings)
        assert set(done.results["labelling"]) <= set(known)
        assert done.results["labelling"].str.contains("v").any()
        best = done.results.iloc[0]
        assert best["load_factor"] == pytest.approx(known[best["labelling"]], rel=1e-6)


def test_mirror_images_are_one_class(tmp_path: Path) -> None:
    scene = scene_of(void={"cells": ["c0r0", "c2r0"]}, symmetry="auto")
    document = scene.model_dump(mode="json", exclude_defaults=True)
    document["loads"] = {"live": [{"element": "c1r0", "force": [0, -1e-3]}]}
    one = explore(parse_scene(document), tmp_path / "one", ExploreSettings(pictures=False))
    document["search"]["symmetry"] = "none"
    two = explore(parse_scene(document), tmp_path / "two", ExploreSettings(pictures=False))
    assert one.summary.labellings == two.summary.labellings == len(two.results)
    assert len(one.results) < len(two.results)


def test_ranks_are_solved_drawn_and_exported(every: Any, tmp_path: Path, jld: Command) -> None:
    ranked = every.results[every.results["status"] == "collapse"]["labelling"].reset_index(drop=True)
    rank = int(np.flatnonzero(ranked.str.contains("v"))[0]) + 1
    done = jld("solve", every.folder, "--rank", rank, "--json")
    assert done.code == 0
    told = json.loads(done.out)
    assert told["load_factor"] == pytest.approx(float(every.results["load_factor"].iloc[rank - 1]), rel=1e-6)
    assert told["elements"] < len(every.assembly.elements)
    assert jld("plot", every.folder, "--rank", rank, "--out", tmp_path / "r.png").code == 0
    file = tmp_path / "blocks.obj"
    assert jld("export", every.folder, "--format", "obj", "--rank", rank, "-o", file).code == 0
    again = read_folder(every.folder)
    assert again.layout(rank).assembly.elements.ids == every.layout(rank).assembly.elements.ids


@pytest.mark.parametrize(
    ("search", "words"),
    [
        ({"void": {"cells": ["x"]}}, "search.void.cells[0]: 'x' names no element"),
        ({"void": {"cells": ["c0r2"]}}, "'c0r2' is a support"),
        ({"void": {"cells": ["c1r0"]}}, "'c1r0' carries a load"),
        ({"void": {"cells": 3}}, "search.void.cells: 3"),
        ({"void": {"most": 1.0}}, "search.void.most: 1.0"),
        ({"void": {}, "segmentation": False}, "is given together with search.segmentation"),
        ({"void": {}, "keep": {"dry": [["c0r0", "c0r1"]]}}, "'c0r0', 'c0r1' between two of them is fixed dry"),
    ],
)
def test_bad_input(search: dict[str, Any], words: str, tmp_path: Path, jld: Command) -> None:
    document = scene_of().model_dump(mode="json", exclude_defaults=True)
    document["search"] = {**document["search"], **search}
    file = tmp_path / "scene.json"
    file.write_text(json.dumps(document))
    done = jld("explore", file, "--out", tmp_path / "out")
    assert (done.code, done.out) == (2, "")
    assert done.err.count("\n") == 1
    assert words in done.err


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (ExploreSettings(driver="exact"), "exact proves nothing where cells may be left out"),
        (ExploreSettings(experiment=1), "experiment: it needs one structure"),
    ],
)
def test_options_for_one_structure_are_refused_with_void_cells(
    settings: ExploreSettings, words: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=words):
        explore(scene_of(void={}), tmp_path / "out", settings)
    assert not (tmp_path / "out").exists()
