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

from cases import grid_document
from jld_core import Scene, build_assembly, parse_scene
from jld_core.deadline import Deadline, DeadlinePassed
from jld_core.samples import vault
from jld_core.scene import Search
from jld_explore import ExploreSettings, SearchSpace, explore, search_space
from jld_explore.drivers.enumeration import Enumeration
from jld_explore.drivers.exact.driver import Exact
from jld_explore.report.pictures import front_picture
from jld_explore.space import Count, Layouts, Terms, register, registered, unregister
from jld_explore.space.counts import counts, values_until
from jld_explore.space.limits import MEASURES, SHAPED
from jld_explore.space.search_space import feasible
from jld_explore.space.shapes import BlockShapes

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
    return np.concatenate([rows for rows, _ in Enumeration(space).batches()])


@pytest.mark.parametrize(("low", "high"), [(None, 1), (2, 2), (1, None)])
def test_a_new_limit_alone_is_applied(count: Count, low: int | None, high: int | None) -> None:
    """Enumeration used to keep a list of limits of its own, and left out what was not in it."""
    space = limited_space(low, high)
    every = rows_of(replace(space, search=scene_of().search))
    number = counts(space.assembly, every)[count.name]
    wanted = every[(number >= (low or 0)) & (number <= (99 if high is None else high))]
    assert 0 < len(wanted) < len(every)
    assert np.array_equal(rows_of(space), wanted)
    assert feasible(space, every).sum() == len(wanted)


def test_every_limit_of_a_scene_has_an_owner() -> None:
    """A key with bounds under "search" is a measure of blocks or a count: no driver lists them again."""
    bounds = {name for name, field in Search.model_fields.items() if field.default == [None, None]}
    owned = {measure.key for measure in MEASURES} | {count.name for count in registered()} | set(SHAPED)
    assert bounds <= owned
    assert {measure.key for measure in MEASURES} <= bounds


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
    driver = Exact(space, 0)
    rows = driver.ask()
    assert driver.exhaustive is (count.terms is None)
    assert feasible(space, rows).all()


def test_a_count_of_ones_own_is_a_column_a_front_and_an_axis(count: Count, tmp_path: Path) -> None:
    done = explore(scene_of(front={"count": count.name, "sense": "min"}), tmp_path / "study")
    assert count.name in done.results.columns
    assert (done.front[count.name].diff().dropna() != 0).all()
    best = done.results.groupby(count.name)["load_factor"].max()
    assert done.front["load_factor"].max() == best.max()
    picture = front_picture(done)
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
    whole = values_until(count, assembly, rows, space.graph, BlockShapes(assembly), Deadline())
    assert whole.dtype.kind == "i"
    late = values_until(count, assembly, rows, space.graph, BlockShapes(assembly), Deadline(0.0))
    assert late[0] == whole[0]
    assert np.isnan(late[1:]).all()
    known = BlockShapes(assembly)
    values_until(count, assembly, rows[:100], space.graph, known, Deadline())
    known._of = Mock(side_effect=DeadlinePassed)  # type: ignore[method-assign]
    part = values_until(count, assembly, rows, space.graph, known, Deadline(100.0))
    assert np.array_equal(part[:65], whole[:65])
    assert np.isnan(part[129:]).all()
