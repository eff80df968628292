"""Joints that the studio's page drags: λ against a closed form, what may move, improvements, and bad requests."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from structures import HEIGHT, flat_arch, flat_arch_load

from jld_core import InputError, parse_scene, solve
from jld_studio.session import StudioSession

TOPS = [{"at": [1.2, HEIGHT], "direction": [1, 0]}, {"at": [-1.2, HEIGHT], "direction": [-1, 0]}]
"""Paths of the tops of both springings of the flat arch."""


@pytest.fixture(scope="module")
def desk() -> StudioSession:
    return StudioSession(parse_scene(flat_arch(20.0, 1.2, 0.2, along=TOPS, ties="mirror-x", box=0.02)))


def letters(desk: StudioSession) -> str:
    return "d" * len(desk.setup({}).assembly.interfaces)


def tops(desk: StudioSession, half: float) -> dict[str, list[float]]:
    """Vertices of the tops of both springings at a half width."""
    places = desk.joints.mesh.places
    found = [int(np.argmin(np.linalg.norm(places - [sign * 1.2, HEIGHT], axis=1))) for sign in (1, -1)]
    return {str(found[0]): [half, HEIGHT], str(found[1]): [-half, HEIGHT]}


def factor(desk: StudioSession, changes: dict[str, Any]) -> float:
    return float(desk.solve(letters(desk), changes)["solution"]["load_factor"])


@pytest.mark.parametrize("half", [1.15, 1.22, 1.3])
def test_a_dragged_joint_follows_the_closed_form(desk: StudioSession, half: float) -> None:
    """λ of (11.8) at every half width of the springings where no joint slides, and in the file that is saved."""
    changes = {"vertices": tops(desk, half)}
    assert factor(desk, changes) == pytest.approx(flat_arch_load(half, 0.2, 0.1), rel=1e-8)
    saved = parse_scene(desk.scene_with(letters(desk), changes))
    assert solve(saved).load_factor == pytest.approx(flat_arch_load(half, 0.2, 0.1), rel=1e-8)
    # points that name vertices moved with them, so that the file can be moved on
    again = StudioSession(saved)
    assert again.joints.facts()["ties"]


def test_vertices_that_may_move_and_their_directions(desk: StudioSession) -> None:
    """Tops slide along the outline and bottoms of the key too; corners and vertices of supports stay; ties mirror."""
    facts = json.loads(json.dumps(desk.joints.facts()))
    places = np.array(facts["places"])
    moving = {tuple(np.round(places[int(vertex)], 9)): path for vertex, path in facts["paths"].items()}
    assert set(moving) == {(s * x, y) for s in (1, -1) for x, y in ((1.2, HEIGHT), (0.2, HEIGHT), (0.1, 0.0))}
    assert all(abs(path["direction"][1]) < 1e-12 for path in moving.values())
    for vertex, others in facts["ties"].items():
        assert [places[other].tolist() for other, _ in others] == [[-places[int(vertex)][0], places[int(vertex)][1]]]
        assert [sign for _, sign in others] == [-1]


def test_some_steps_from_the_geometry_drawn(desk: StudioSession) -> None:
    """The improvement begins at the drawn joints, raises λ, keeps the ties, and is what the page then solves."""
    changes = {"vertices": tops(desk, 1.22), "materials": {"density": 1000.0, "dry": {"friction_angle": 21}}}
    found = desk.improve(letters(desk), changes)
    assert found["start"] == pytest.approx(flat_arch_load(1.22, 0.2, 0.1), rel=1e-8)
    assert found["value"] > 1.05 * found["start"]
    assert found["steps"] >= 1
    after = factor(desk, {**changes, "vertices": found["vertices"]})
    assert after == pytest.approx(found["value"], rel=1e-8)
    ends = np.array(list(found["vertices"].values()))
    assert np.sort(ends[:, 0]) == pytest.approx(-np.sort(ends[:, 0])[::-1], abs=1e-9)


def test_bad_vertices_are_one_line(desk: StudioSession) -> None:
    name = next(iter(tops(desk, 1.2)))
    for vertices, said in (
        ([1], "they are no JSON object"),
        ({"x": [0, 0]}, "no vertex that may move"),
        ({"99999": [0, 0]}, "no vertex that may move"),
        ({name: [1.0]}, "two finite numbers"),
        ({name: [float("nan"), 0.0]}, "two finite numbers"),
        ({name: [True, 0.0]}, "two finite numbers"),
        ({name: [0.1, HEIGHT]}, "polygon"),
    ):
        with pytest.raises(InputError, match=said):
            desk.solve(letters(desk), {"vertices": vertices})


def test_scenes_without_joints_that_move() -> None:
    """A block on a support has no vertex to drag, and says so."""
    document = flat_arch(20.0, 1.2, 0.2)
    kept = [one for one in document["elements"] if one["id"] in ("pier right", "ground")]
    loads = {"live": [{"body": [1, 0]}]}
    desk = StudioSession(parse_scene({**document, "elements": kept, "loads": loads}))
    assert desk.joints is None
    with pytest.raises(InputError, match="no vertex of this scene moves"):
        desk.improve(letters(desk), {})


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"fill": {"level": 2.0, "density": 1800.0, "friction_angle": 30.0}}, "fill: .* variable pressure"),
        (
            {"fill": {"level": 2.0, "density": 1800.0, "friction_angle": 30.0, "active": 0, "passive": 0}},
            "fill: its loads do not move with the joints",
        ),
        (
            {
                "members": [
                    {
                        "kind": "tie",
                        "from": {"element": "pier left", "at": [-1.5, -1.0]},
                        "to": {"element": "pier right", "at": [1.5, -1.0]},
                        "tension": 1.0,
                    }
                ]
            },
            "members: a move of joints does not model them",
        ),
    ],
)
def test_fill_and_members_are_named(more: dict[str, Any], said: str) -> None:
    """The button that improves joints says what excludes it; the scene is still solved."""
    desk = StudioSession(parse_scene({**flat_arch(20.0, 1.2, 0.2), **more}))
    with pytest.raises(InputError, match=said):
        desk.improve(letters(desk), {})
