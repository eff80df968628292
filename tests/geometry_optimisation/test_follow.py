"""Vertices of inner faces that follow joints, and loads that keep the width on which they act."""

from __future__ import annotations

import numpy as np
import pytest

from cases import grid_document
from jld_core import InputError, build_assembly, parse_scene
from jld_geometry.optimise import MovedJoints, move_joints
from jld_geometry.search import GeometrySearch

ROWS = ["aab", "aab", "###"]
"""A block of four cells beside one of two, on a ground that stays."""


def moved(inner: str, **move: object) -> MovedJoints:
    document = {**grid_document(ROWS, friction=0.9, tension=3e5, shear=5e5), "move": {"inner": inner, **move}}
    scene = parse_scene(document)
    assembly = build_assembly(scene)
    return move_joints(scene, assembly, assembly.labels)


def at(done: MovedJoints, x: float, y: float) -> np.ndarray:
    """Movement of the vertex that was at a point."""
    start = done.places - done.moved
    return np.asarray(done.moved[np.argmin(np.linalg.norm(start - [x, y], axis=1))])


def test_vertices_without_joints_follow_their_neighbours() -> None:
    """The middle of the four cells moves as the mean of its neighbours, vertices on the outline along it."""
    done = moved("follow")
    assert done.value > 1.05 * done.start
    neighbours = [at(done, *point) for point in ((0.0, 0.2), (0.2, 0.2), (0.1, 0.1), (0.1, 0.3))]
    assert at(done, 0.1, 0.2) == pytest.approx(np.mean(neighbours, axis=0), abs=1e-9)
    assert np.linalg.norm(at(done, 0.1, 0.2)) > 1e-3
    assert at(done, 0.0, 0.2)[0] == pytest.approx(0.0, abs=1e-12)
    assert at(done, 0.1, 0.1) == pytest.approx(np.zeros(2), abs=1e-12)


def test_vertices_of_inner_faces_stay_by_default() -> None:
    """Without the key only the upper end of the joint between both blocks, which no inner face touches, is free."""
    done = moved("stay")
    still = np.linalg.norm(done.moved, axis=1) == 0.0
    start = (done.places - done.moved)[~still]
    assert start == pytest.approx(np.array([[0.2, 0.3]]), abs=1e-9)


def test_a_load_keeps_the_width_on_which_it_acts() -> None:
    """The edge under a patch reaches half its width beyond the place of the force."""
    push = [{"element": "c2r0", "force": [1.0, -1.0], "at": [0.26, 0.3], "width": 0.06}]
    document = {**grid_document(ROWS, friction=0.9, live=push), "move": {"inner": "follow", "edge": 0.01}}
    scene = parse_scene(document)
    assembly = build_assembly(scene)
    search = GeometrySearch(scene, assembly, assembly.labels)
    places = search.variables.start.copy()
    end = int(np.argmin(np.linalg.norm(places - [0.2, 0.3], axis=1)))
    places[end, 0] = 0.23
    limits = search.evaluator.limits
    assert limits.at(places).values.min() >= -1e-9
    places[end, 0] = 0.2301
    lacks = limits.least - limits.at(places).values
    assert lacks.max() == pytest.approx(1e-4 / assembly.size, rel=1e-6)


def test_an_unknown_choice_is_refused() -> None:
    with pytest.raises(InputError, match=r"move\.inner"):
        moved("run")
