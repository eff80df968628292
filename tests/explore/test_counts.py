"""Counts and limits have one owner: what is registered is applied, drawn, tabled and proven, or refused."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from matplotlib.figure import Figure
from pydantic import Field

from cases import counts_of, every_layout, grid_document
from jld_core import Deadline, DeadlinePassed, InputError, Layout, Scene, build_assembly, parse_scene, samples
from jld_core.scene import Search
from jld_explore import ExploreSettings, SearchSpace, explore, search_space
from jld_explore.drivers import DRIVERS
from jld_explore.space import Count, Layouts, Terms, counts, feasible, register, registered, unregister, values_of
from jld_practice import making_of, stones_of
from jld_samples import vault
from jld_views import pictures

SOURCES = Path(__file__).parents[2] / "src"
ROWS = ["aaa", "aaa", "###"]


class MoreLimits(Search):
    """A search with a limit that no driver was written for."""

    lying_faces: list[int | None] = Field(default=[None, None])


def lying(layouts: Layouts) -> Any:
    """Dry faces whose normal is vertical: beds, of which the count speaks."""
    return layouts.labellings[:, _beds(layouts.assembly)].sum(axis=1)


def _beds(assembly: Any) -> Any:
    return np.flatnonzero(assembly.free_faces & (abs(assembly.interfaces.normal[:, 1]) > 0.5))


def _terms(assembly: Any) -> Terms:
    return Terms(faces=np.isin(np.arange(len(assembly.interfaces)), _beds(assembly)))


BEDS = Count("lying_faces", lying, "lying dry faces", "lying face", terms=_terms)


@pytest.fixture(params=[True, False], ids=["terms", "no terms"])
def count(request: pytest.FixtureRequest) -> Iterator[Count]:
    own = BEDS if request.param else replace(BEDS, terms=None)
    register(own)
    yield own
    unregister(own.name)


def scene_of(**search: Any) -> Scene:
    return parse_scene(grid_document(ROWS, block_cells=[1, 3], **search))


def limited_space(low: int | None, high: int | None) -> SearchSpace:
    scene = scene_of()
    space = search_space(scene, build_assembly(scene))
    return replace(space, search=MoreLimits(**space.search.model_dump(), lying_faces=[low, high]))


def rows_of(space: SearchSpace) -> Any:
    return every_layout(space)


@pytest.mark.parametrize(("low", "high"), [(None, 1), (2, 2), (1, None)])
def test_a_new_limit_alone_is_applied(count: Count, low: int | None, high: int | None) -> None:
    """Enumeration used to keep a list of limits of its own, and left out what was not in it."""
    space = limited_space(low, high)
    every = rows_of(replace(space, search=scene_of().search))
    number = values_of(count, space.assembly, every)
    wanted = every[(number >= (low or 0)) & (number <= (99 if high is None else high))]
    assert 0 < len(wanted) < len(every)
    assert np.array_equal(rows_of(space), wanted)
    assert feasible(space, every).sum() == len(wanted)


def test_the_exact_driver_proves_the_count_it_is_asked_for(count: Count, tmp_path: Path) -> None:
    """By conflicts where the count is a sum of binary terms, by enumeration where it is not."""
    scene = scene_of(front={"count": count.name})
    settings = ExploreSettings(driver="exact", pictures=False, options={"aim": "front"})
    every = explore(scene, tmp_path / "every", ExploreSettings(driver="enumeration", pictures=False))
    found = explore(scene, tmp_path / "exact", settings)
    known = every.results.groupby(count.name)["load_factor"].max()
    proven = {row["count"]: row["load_factor"] for row in found.summary.facts["best_by_count"]}
    assert found.summary.proven is True
    assert proven == pytest.approx(known.to_dict(), rel=1e-6)


def test_a_proof_under_a_limit_that_is_no_sum_is_by_enumeration(count: Count) -> None:
    space = limited_space(None, 1)
    driver = DRIVERS["exact"](space, 0)
    rows = driver.ask()
    assert driver.exhaustive is (count.terms is None)
    assert feasible(space, rows).all()


@pytest.mark.sampled(2)
def test_a_count_of_ones_own_is_a_column_a_front_and_an_axis(count: Count, tmp_path: Path) -> None:
    done = explore(scene_of(front={"count": count.name, "sense": "min"}), tmp_path / "study")
    assert count.name in done.results.columns
    assert (done.front[count.name].diff().dropna() != 0).all()
    best = done.results.groupby(count.name)["load_factor"].max()
    assert done.front["load_factor"].max() == best.max()
    picture = pictures.front_picture(done)
    assert isinstance(picture, Figure)
    assert picture.axes[0].get_xlabel() == "lying dry faces"
    said = [text.get_text() for text in picture.texts]
    assert any("lying face" in text for text in said)
    assert (tmp_path / "study" / "pareto.png").exists()


def test_a_name_is_taken_once() -> None:
    for name in ("blocks", "no key"):
        with pytest.raises(ValueError, match="cannot be named"):
            register(replace(BEDS, name=name))


def test_nobody_else_names_a_count() -> None:
    """The names stand in the registry, and in the keys of scenes."""
    # elements and blocks have a mass of their own, and a column of that name
    names = {count.name for count in registered()} - {"mass"}
    owners = {SOURCES / "jld_explore" / "space" / "counts.py", SOURCES / "jld_core" / "scene" / "schema.py"}
    wings = ("space", "evaluation", "drivers", "report")
    for path in sorted(SOURCES.rglob("jld_explore/**/*.py")):
        if path in owners or not set(wings) & set(path.relative_to(SOURCES).parts):
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Constant):
                assert node.value not in names, f"{path}:{node.lineno}: {node.value!r} has its owner in space.counts"
            if isinstance(node, ast.Attribute):
                assert node.attr not in names - {"blocks"}, f"{path}:{node.lineno}: {node.attr}"


def test_shapes_are_counted_while_there_is_time() -> None:
    """Values up to the deadline are those without one, the rest is missing, and the first layout always has its own."""
    scene = vault(voussoirs=4, courses=2)
    assembly = build_assembly(scene)
    space = search_space(scene, assembly)
    count = next(count for count in registered() if count.kinds)
    rows = np.random.default_rng(3).random((140, len(assembly.interfaces))) < 0.5
    whole = counts.values_until(count, assembly, rows, space.graph, counts.BlockShapes(assembly), Deadline())
    assert whole.dtype.kind == "i"
    late = counts.values_until(count, assembly, rows, space.graph, counts.BlockShapes(assembly), Deadline(0.0))
    assert late[0] == whole[0]
    assert np.isnan(late[1:]).all()
    known = counts.BlockShapes(assembly)
    counts.values_until(count, assembly, rows[:100], space.graph, known, Deadline())
    known._outlines_of = Mock(side_effect=DeadlinePassed)
    part = counts.values_until(count, assembly, rows, space.graph, known, Deadline(100.0))
    assert np.array_equal(part[:65], whole[:65])
    assert np.isnan(part[129:]).all()


# Counts of sawing: lengths, faces and set-ups of all blocks, against hand counts and the cutting list.


def values(scene: Scene, labels: list[np.ndarray[Any, Any]]) -> dict[str, np.ndarray[Any, Any]]:
    """Values of all counts of some labellings."""
    assembly = build_assembly(scene)
    space = search_space(scene, assembly, allow_empty=True, need_materials=False)
    return counts_of(assembly, labels, space.graph, space.limits.block_shapes)


def test_sawing_is_counted_by_hand() -> None:
    """Cells of 0.1 m: six squares; one rectangle of 3 × 2; three columns of two."""
    scene = parse_scene(grid_document(ROWS))
    assembly = build_assembly(scene)
    upright = abs(assembly.interfaces.normal[:, 0]) > 0.5
    every = np.ones(len(assembly.interfaces), dtype=bool)
    one = ~assembly.free_faces
    columns = np.where(assembly.free_faces, upright, True)
    found = values(scene, [every, one, columns])
    assert found["sawn_length"] == pytest.approx([6 * 0.4, 1.0, 3 * 0.6], rel=1e-12)
    assert found["saw_cuts"].tolist() == [24, 4, 12]
    assert found["saw_set_ups"].tolist() == [2, 2, 2]


@pytest.mark.parametrize("name", ["grid", "arch", "vault"])
def test_counts_are_those_of_the_cutting_list(name: str) -> None:
    """Random layouts without slits: the counts come from elements and faces, the list from the united outlines."""
    moulds: dict[str, Any] = {"moulds": {"rotate": True, "flip": True}}
    if name == "grid":
        scene = parse_scene(grid_document(ROWS, **moulds))
    else:
        made = samples.arch(voussoirs=7) if name == "arch" else samples.vault(voussoirs=5, courses=2)
        document = made.model_dump(mode="json", exclude_defaults=True)
        document["search"] = {**document.get("search", {}), **moulds}
        scene = parse_scene(document)
    assembly = build_assembly(scene)
    rng = np.random.default_rng(5)
    labels = []
    for _ in range(6):
        kept = np.ones(len(assembly.interfaces), dtype=bool)
        part = rng.integers(0, 3, len(assembly.elements))
        a, b = assembly.interfaces.a, assembly.interfaces.b
        kept[assembly.free_faces] = (part[a] != part[b])[assembly.free_faces]
        labels.append(kept)
    found = values(scene, labels)
    for k, row in enumerate(labels):
        layout = Layout(scene, assembly, row)
        made_of = making_of(stones_of(layout))
        depth = layout.thickness if assembly.dimension == 2 else 1.0
        assert found["sawn_length"][k] * depth == pytest.approx(made_of.sawn, rel=1e-6)
        assert found["saw_cuts"][k] == made_of.cuts
        assert found["shapes"][k] == made_of.moulds
        assert found["saw_set_ups"][k] == made_of.set_ups


@pytest.mark.usefixtures("without_pictures")
def test_a_limit_on_sawing_is_kept_and_the_front_is_that_of_all_layouts() -> None:
    document = grid_document(ROWS, front={"counts": ["sawn_length", "shapes"], "sense": "min"})
    every = explore(parse_scene(document), driver="enumeration").results
    document["search"] |= {"sawn_length": [None, 1.6], "saw_cuts": [None, 12], "saw_set_ups": [None, 4]}
    limited = explore(parse_scene(document), driver="enumeration").results
    kept = (every["sawn_length"] <= 1.6 + 1e-9) & (every["saw_cuts"] <= 12) & (every["saw_set_ups"] <= 4)
    assert 0 < len(limited) < len(every)
    assert sorted(limited["labelling"]) == sorted(every["labelling"][kept])


@pytest.mark.parametrize(
    ("search", "words"),
    [
        (
            {"blocks": [None, 2], "block_mass": [None, 3.0]},
            "search.blocks: [null, 2] asked, but there can be 3 to 6, since search.block_mass is [null, 3]; "
            "expected a range that meets this, or a wider search.block_mass",
        ),
        ({"shapes": [4, None], "block_cells": [2, None]}, "search.shapes: [4, null] asked, but there can be 1 to 3"),
        ({"shapes": [None, 0]}, "search.shapes: [null, 0] asked, but there can be 1 to 6"),
        ({"sawn_length": [None, 0.9]}, "search.sawn_length: [null, 0.9] asked, but there can be 1 to 2.4"),
        (
            {"saw_cuts": [None, 8], "block_cells": [None, 2]},
            "search.saw_cuts: [null, 8] asked, but there can be 9 and more (of at least 3 blocks",
        ),
        ({"saw_set_ups": [None, 1]}, "search.saw_set_ups: [null, 1] asked, but there can be 2 and more"),
    ],
)
def test_contradicting_limits_are_refused_with_the_contradiction(search: dict[str, Any], words: str) -> None:
    scene = parse_scene(grid_document(ROWS, **search))
    with pytest.raises(InputError) as caught:
        search_space(scene, build_assembly(scene))
    assert str(caught.value).startswith(words)


def test_shapes_that_must_exist_are_counted() -> None:
    """Stones that are too heavy to be joined keep their shapes: three of them are no two moulds."""
    squares = [[[x, 0], [x + w, 0], [x + w, 1], [x, 1]] for x, w in ((0, 1), (1, 2), (3, 3))]
    elements = [{"id": f"e{k}", "polygon": p, "weight": float(10 * (k + 1))} for k, p in enumerate(squares)]
    elements.append({"id": "s", "polygon": [[0, -1], [6, -1], [6, 0], [0, 0]], "support": True})
    document: dict[str, Any] = {
        "elements": elements,
        "materials": {"dry": {"friction_angle": 30}, "inner": {"tensile_strength": 1e3, "shear_strength": 1e3}},
        "loads": {"live": [{"body": [1, 0]}]},
        "search": {"block_weight": [None, 30.0], "shapes": [None, 2]},
    }
    scene = parse_scene(document)
    # the two lightest may be joined, the third stands alone
    search_space(scene, build_assembly(scene))
    document["search"]["block_weight"] = [None, 29.0]
    document["elements"][2]["weight"] = 29.0
    scene = parse_scene(document)
    with pytest.raises(InputError, match=r"search.shapes: \[null, 2\] asked, but there can be 3 to 3"):
        search_space(scene, build_assembly(scene))


def test_only_limits_that_no_layout_meets_are_refused() -> None:
    """All 128 labellings of six cells: what is refused has none, with random limits of every kind."""
    plain = parse_scene(grid_document(ROWS))
    assembly = build_assembly(plain)
    free = np.flatnonzero(assembly.free_faces)
    every = np.ones((2 ** len(free), len(assembly.interfaces)), dtype=bool)
    every[:, free] = (np.arange(len(every))[:, None] >> np.arange(len(free))) & 1
    rng = np.random.default_rng(8)
    refused = 0
    for _ in range(150):
        search: dict[str, Any] = {}
        for key, most in (("blocks", 7), ("shapes", 4), ("saw_cuts", 26), ("saw_set_ups", 9), ("sawn_length", 2.6)):
            if rng.random() < 0.4:
                low, high = sorted(rng.random(2) * most)
                if key != "sawn_length":
                    low, high = int(low), int(high)
                search[key] = [None if rng.random() < 0.5 else low, None if rng.random() < 0.3 else high]
        search["block_cells"] = [None, int(rng.integers(1, 7))]
        scene = parse_scene(grid_document(ROWS, **search))
        try:
            search_space(scene, assembly)
        except InputError:
            refused += 1
            space = search_space(plain, assembly)
            limited = replace(space, search=scene.search)
            assert not feasible(limited, every).any(), search
    assert 20 < refused < 140
