"""Ids, values and movement on pictures, for who asks for them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely
from matplotlib.figure import Figure
from matplotlib.text import Text
from PIL import Image

from cases import grid_document
from command import Command
from jld_core import InputError, build_assembly, load_scene, parse_scene, samples, solve
from jld_core.samples import box
from jld_core.views import animation, quantities
from jld_core.views.figures import figure_of_assembly, figure_of_result
from jld_core.views.look import rules
from jld_core.views.structure import projection_of
from jld_core.views.writing import write_numbers
from paths import SCENES
from scenes_of_pages import small_scene

WALL = SCENES / "ferris_tinloi_1.json"


def texts(axes: object) -> list[str]:
    return [artist.get_text().strip() for artist in axes.findobj(Text)]  # type: ignore[attr-defined]


def test_ids_are_written_on_request_and_as_they_are() -> None:
    document = small_scene()
    base = {"id": "ground", "polygon": [[0, -1], [3, -1], [3, 0], [0, 0]], "support": True}
    block = {"id": "$\\frac{1}{2}$ <b>", "polygon": [[0, 0], [3, 0], [3, 1], [0, 1]]}
    document = {**document, "elements": [base, block], "loads": {"live": [{"body": [1, 0]}]}}
    del document["grid"]
    assembly = build_assembly(parse_scene(document))
    assert block["id"] not in texts(figure_of_assembly(assembly))
    figure = figure_of_assembly(assembly, ids=True)
    assert {"ground", block["id"]} <= set(texts(figure))
    figure.canvas.draw()  # a formula that is none would raise here


def test_values_of_loads_and_forces_are_those_of_the_result() -> None:
    assembly = build_assembly(parse_scene(small_scene()))
    result = solve(assembly)
    assert result.forces is not None
    written = texts(figure_of_result(result, values=True))
    assert "100 N × λ" in written
    total = quantities.body_load(assembly)
    assert total is not None
    assert f"{np.linalg.norm(total):.3g} N × λ" in written
    largest = np.linalg.norm(quantities.face_vectors(assembly, result.forces), axis=1).max()
    assert f"{largest:.3g}" in written
    assert not any("× λ" in text and "N" in text.split() for text in texts(figure_of_result(result)))


def test_a_mechanism_moves_from_rest_one_way_and_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(animation, "FRAMES", 8)
    result = solve(build_assembly(parse_scene(small_scene())))
    animation.save_animation(result, tmp_path / "m.gif")
    with Image.open(tmp_path / "m.gif") as film:
        assert film.n_frames == animation.FRAMES
        frames = []
        for k in range(animation.FRAMES):
            film.seek(k)
            frames.append(np.asarray(film.convert("L"), dtype=float))
    away = [float(abs(frame - frames[0]).mean()) for frame in frames]
    half = animation.FRAMES // 2
    assert away[half] == max(away) > 0.2
    assert away[1] < away[2] < away[half]
    assert away[1] == pytest.approx(away[-1], rel=1e-6)  # the same way back, never through one another


def test_an_animation_needs_an_ending_and_a_mechanism(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    result = solve(build_assembly(parse_scene(small_scene())))
    with pytest.raises(InputError, match=r"\.gif or \.mp4"):
        animation.save_animation(result, tmp_path / "m.avi")
    monkeypatch.setattr(animation.shutil, "which", lambda name: None)
    with pytest.raises(InputError, match="ffmpeg"):
        animation.save_animation(result, tmp_path / "m.mp4")
    document = small_scene()
    document["loads"]["live"] = [{"body": [0, -1]}]
    with pytest.raises(InputError, match="no mechanism"):
        animation.save_animation(solve(build_assembly(parse_scene(document))), tmp_path / "m.gif")
    assert not (tmp_path / "m.gif").exists()


def test_jld_plot_writes_the_requested_format(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, jld: Command) -> None:
    monkeypatch.setattr(animation, "FRAMES", 2)
    for ending, begins in (("svg", b"<?xml"), ("html", b"<!doctype html>")):
        target = tmp_path / f"wall.{ending}"
        assert jld("plot", WALL, "--out", target, "--ids", "--values").code == 0
        assert target.read_bytes().startswith(begins)
    monkeypatch.chdir(tmp_path)  # a picture of a scene is drawn where one stands
    scene = tmp_path / "small.json"
    scene.write_text(parse_scene(small_scene()).model_dump_json(exclude_defaults=True))
    assert jld("plot", scene, "--format", "gif").code == 0
    assert (tmp_path / "small.gif").read_bytes().startswith(b"GIF8")
    wrong = jld("plot", WALL, "--out", tmp_path / "wall.bmp")
    assert wrong.code == 2
    assert ".html" in wrong.err


def test_the_rules_of_drawing_are_those_of_the_pictures() -> None:
    """One place: what a page is told is what matplotlib draws with."""
    from jld_core.views import annotations, structure

    found = rules()
    wall = load_scene(WALL)
    figure = figure_of_assembly(build_assembly(wall))
    drawn = {c for patch in figure.axes[0].collections for c in map(tuple, patch.get_facecolor()[:, :3].round(3))}
    tints = {tuple(round(int(t[k : k + 2], 16) / 255, 3) for k in (1, 3, 5)) for t in found["tints"]}
    assert len(drawn & tints) >= 4
    assert structure.DOTTED[1] == tuple(found["inner_dash"])
    for kind, style in annotations.MOVES.items():
        assert style["color"] == found["movements"][str(kind)]["fill"]
        assert annotations.MEANING[kind] == found["movements"][str(kind)]["meaning"]


def test_numbers_in_space_stand_on_visible_parts_of_their_blocks() -> None:
    """A cube is numbered on one of its faces; a small one behind it, which it hides, has no number."""
    document = samples.corner().model_dump(mode="json", exclude_defaults=True)
    document["elements"] = [
        box("near", (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)),
        box("behind", (0.3, 1.05, 0.0), (0.4, 1.15, 0.05)),
        box("ground", (-1.0, -1.0, -1.0), (3.0, 3.0, 0.0), support=True),
    ]
    assembly = build_assembly(parse_scene(document))
    project = projection_of(assembly)
    assert project.toward == pytest.approx([0.43, -0.81, 0.41], abs=0.01)  # the viewer looks from the side of −y
    (written,) = write_numbers(Figure().add_subplot(), assembly, [[0], [1]], assembly.elements.centroid[:2])
    assert written.get_text() == "1"
    outline = shapely.MultiPoint(project(assembly.elements.shape[0])).convex_hull
    assert outline.contains(shapely.Point(written.get_position()))
    apart = document | {
        "elements": [document["elements"][0], box("aside", (2, 0, 0), (2.5, 0.5, 0.5)), document["elements"][2]]
    }
    both_seen = build_assembly(parse_scene(apart))
    both = write_numbers(Figure().add_subplot(), both_seen, [[0, 2], [1]], both_seen.elements.centroid[:2])
    assert [one.get_text() for one in both] == ["1", "2"]
    assert outline.contains(shapely.Point(both[0].get_position()))  # not on the support joined to it


def test_numbers_in_the_plane_stand_at_the_centroids_of_blocks() -> None:
    assembly = build_assembly(samples.grid(columns=3, rows=1))
    ax = Figure().add_subplot()
    free = assembly.elements.free.tolist()
    centroid = assembly.elements.centroid
    places = [centroid[free[:2]].mean(axis=0), centroid[free[2]]]
    written = write_numbers(ax, assembly, [free[:2], free[2:]], places)
    assert np.array([text.get_position() for text in written]) == pytest.approx(np.array(places), rel=1e-12)


def test_the_number_of_an_angle_stands_within_it() -> None:
    """The centroid of an L of thin legs lies in its hollow; its number stands where both legs meet."""
    document = grid_document(["a...", "a...", "aaaa", "####"])
    assembly = build_assembly(parse_scene(document))
    own = assembly.elements.free.tolist()
    weight = assembly.elements.volume[own]
    centroid = weight @ assembly.elements.centroid[own] / weight.sum()
    (written,) = write_numbers(Figure().add_subplot(), assembly, [own], [centroid])
    whole = shapely.union_all([shapely.Polygon(assembly.elements.shape[k]) for k in own])
    assert not whole.contains(shapely.Point(centroid))
    assert whole.boundary.distance(shapely.Point(written.get_position())) > 0.04
    assert whole.contains(shapely.Point(written.get_position()))
