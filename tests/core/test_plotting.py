"""Pictures say what the numbers say: positions, counts, directions; no image baselines."""

from __future__ import annotations

import inspect
import json
import pkgutil
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text
from PIL import Image

import cases
import jld_practice.laying
import jld_practice.reactions
import jld_views
from cases import dry_and_inner, grid_document, small_scene
from command import SCENES, Command, saved
from jld_core import (
    Assembly,
    InputError,
    LimitAnalysisResult,
    Status,
    blocks_of,
    build_assembly,
    load_scene,
    parse_scene,
    samples,
    solve,
)
from jld_core.build import loads
from jld_core.models import solve_by_fields
from jld_practice.laying import assembly_order
from jld_practice.reactions import settle, thrust_ranges
from jld_samples import box
from jld_views import annotations, figures, look, moved_joints, quantities, structure, writing


def axes() -> Axes:
    figure = Figure(figsize=(5.0, 5.0))
    FigureCanvasAgg(figure)
    return figure.add_axes((0.15, 0.4, 0.8, 0.55))


def block_on_ground(live: list[dict[str, Any]], angle: float = 35.0, rows: tuple[str, ...] = ("a", "#")) -> Assembly:
    """A stack of cells 2 wide and 4 high on a support, weight 80 each."""
    materials = {
        "density": 10.0,
        "gravity": 1.0,
        "dry": {"friction_angle": angle},
        "inner": {"tensile_strength": 1.0, "shear_strength": 1.0},
    }
    grid = {"cell": [2.0, 4.0], "rows": list(rows)}
    return build_assembly(parse_scene({"name": "block", "grid": grid, "materials": materials, "loads": {"live": live}}))


PUSH = [{"element": "c0r0", "force": [1.0, 0.0], "at": [0.0, 7.0]}]
"""A push at height 3 above the base of the block: it rocks at λ = 80 · 1 / 3 if friction allows."""

PUSH_ON_TOP = [{"element": "c0r0", "force": [1.0, 0.0]}]


@pytest.fixture(scope="module")
def wall() -> LimitAnalysisResult:
    return solve(build_assembly(load_scene(SCENES / "ferris_tinloi_1.json")))


@pytest.fixture(scope="module")
def beam() -> LimitAnalysisResult:
    return solve(build_assembly(load_scene(SCENES / "flat_beam_arch.json")))


def outcome(assembly: Assembly, forces: Any = None, mechanism: Any = None, **changes: Any) -> LimitAnalysisResult:
    values: dict[str, Any] = {
        "labels": assembly.labels,
        "status": Status.COLLAPSE,
        "load_factor": 1.0,
        "bracket": (1.0, 1.0),
        "gap": 1e-9,
        "stands_at_zero": True,
        "forces": forces,
        "mechanism": mechanism,
        "iterations": 1,
        "solve_log": (),
        "seconds": {},
    }
    return LimitAnalysisResult(assembly=assembly, **{**values, **changes})


def stack_of_boxes() -> Assembly:
    """A support, a box 2 × 1 × 1 on it, a box 1 × 1 × 1 on the right half of that."""
    corners = {"ground": ([0, 0, -1], [2, 1, 0]), "low": ([0, 0, 0], [2, 1, 1]), "high": ([1, 0, 1], [2, 1, 2])}
    elements = [cases.box(name, *ends, weight=1.0, support=name == "ground") for name, ends in corners.items()]
    return cases.assembly_in_space(elements, materials={"dry": {"friction_coefficient": 0.5}})


def test_neighbouring_blocks_get_different_tints(wall: LimitAnalysisResult) -> None:
    assembly = wall.assembly
    colours = quantities.block_colours(assembly, wall.labels, len(look.TINTS))
    free = assembly.free_faces
    assert np.all(colours[assembly.interfaces.a[free]] != colours[assembly.interfaces.b[free]])
    assert np.all(colours[assembly.elements.support] == -1)


def test_blocks_are_joined_through_inner_faces(beam: LimitAnalysisResult) -> None:
    blocks = blocks_of(beam.assembly, beam.labels)
    assert len(np.unique(blocks[beam.assembly.elements.free])) == 1
    alone = blocks_of(beam.assembly, np.ones(24, dtype=bool))
    assert len(np.unique(alone)) == 17


def test_layout_tells_dry_from_inner_without_colour_and_hatches_supports(beam: LimitAnalysisResult) -> None:
    ax = axes()
    drawn = figures.draw_assembly(ax, beam.assembly)
    dry, inner = drawn["dry"][0], drawn["inner"][0]
    assert len(dry.get_segments()) == 2
    assert len(inner.get_segments()) == 22
    assert min(dry.get_linewidth()) > 2.0 * max(inner.get_linewidth())
    assert dry.get_linestyle()[0][1] is None
    assert inner.get_linestyle()[0][1] is not None
    assert len(drawn["ticks"][0].get_segments()) == 2
    assert drawn["supports"][0].get_hatch()
    assert len(drawn["elements"][0].get_paths()) == 15
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("x [m]", "y [m]")
    assert ax.get_aspect() == 1.0


def test_point_loads_stand_at_their_points_and_body_loads_beside(
    beam: LimitAnalysisResult, wall: LimitAnalysisResult
) -> None:
    live = figures.draw_assembly(axes(), beam.assembly)["live"][0]
    assert live.get_offsets() == pytest.approx(np.array([[0.22, 0.4], [0.25, 0.4], [0.28, 0.4]]))
    assert live.V[1] == pytest.approx(2.0 * live.V[0])
    assert live.pivot == "tip"
    drawn = figures.draw_assembly(axes(), wall.assembly)
    assert "live" not in drawn
    body = drawn["body"][0]
    assert body.U[0] > 0.0
    assert body.V[0] == pytest.approx(0.0)
    assert body.get_offsets()[0][0] < wall.assembly.elements.lower[:, 0].min()


def test_a_live_couple_is_drawn_the_way_it_turns() -> None:
    for moment, marker in ((1.0, "left"), (-1.0, "right")):
        drawn = figures.draw_assembly(axes(), block_on_ground([{"element": "c0r0", "moment": moment}]))
        (mark,) = drawn["couples"]
        assert marker in str(mark.get_marker())
        assert mark.get_xydata()[0] == pytest.approx([1.0, 6.0])


def test_labels_of_another_length_are_refused(beam: LimitAnalysisResult) -> None:
    with pytest.raises(ValueError, match=r"expected \(24,\)"):
        figures.draw_assembly(axes(), beam.assembly, np.ones(3, dtype=bool))


def test_arrow_of_a_rocking_block_stands_at_its_toe() -> None:
    result = solve(block_on_ground(PUSH, angle=45.0))
    assert result.load_factor == pytest.approx(80.0 / 3.0, rel=1e-6)
    drawn = figures.draw_forces(axes(), result)
    arrow = drawn["press"][0]
    assert arrow.get_offsets()[0] == pytest.approx([2.0, 4.0], abs=1e-5)
    # what the block does to the ground: its weight down, the push to the right
    assert arrow.U[0] / arrow.V[0] == pytest.approx(-(80.0 / 3.0) / 80.0, rel=1e-5)
    assert "yield dry" in drawn


def test_force_at_the_centre_of_pressure_has_the_moment_of_the_face(wall: LimitAnalysisResult) -> None:
    assembly, forces = wall.assembly, wall.forces
    points, on_face = quantities.pressure_points(assembly, forces)
    arm, vector = points - assembly.interfaces.origin, quantities.face_vectors(assembly, forces)
    moment = arm[:, 0] * vector[:, 1] - arm[:, 1] * vector[:, 0]
    loaded = on_face & (forces[:, 0] > 1e-6)
    assert loaded.sum() > 40
    assert moment[loaded] == pytest.approx(forces[loaded, 2], abs=1e-9)


def test_utilisation_by_hand() -> None:
    assembly = block_on_ground(PUSH, angle=45.0)
    for force, expected in (
        ([80.0, 40.0, 0.0], 0.5),
        ([80.0, 0.0, 60.0], 0.75),
        ([80.0, 8.0, 80.0], 1.0),
        ([0.0, 0.0, 0.0], 0.0),
    ):
        assert quantities.utilisation(outcome(assembly, np.array([force])))[0] == pytest.approx(expected)
    # inner, σt A = τ A = 2: 6 |M| / ((N + 2) · 2), |V| / 2, −N / 2
    inner = np.array([False])
    for force, expected in (([2.0, 0.0, 1.0], 0.75), ([2.0, -1.8, 0.0], 0.9), ([-1.0, 0.0, 0.0], 0.5)):
        used = quantities.utilisation(outcome(assembly, np.array([force]), labels=inner))
        assert used[0] == pytest.approx(expected)
    with pytest.raises(ValueError, match="no forces"):
        quantities.utilisation(outcome(assembly))


def test_a_couple_without_thrust_and_tension_are_marked() -> None:
    assembly = block_on_ground(PUSH)
    inner = np.array([False])
    pulled = figures.draw_forces(axes(), outcome(assembly, np.array([[-1.0, 0.5, 1.5]]), labels=inner))
    assert "tension" in pulled
    assert "press" not in pulled
    (turn,) = pulled["couples on faces"]
    assert turn.get_xydata()[0] == pytest.approx([1.0, 4.0])


def test_thrust_line_follows_a_column_and_is_left_out_in_a_wall(wall: LimitAnalysisResult) -> None:
    column = solve(block_on_ground(PUSH_ON_TOP, angle=45.0, rows=("a", "b", "c", "#")))
    pieces = figures.draw_forces(axes(), column)["thrust"]
    assert len(pieces) == 2
    ends = [line.get_xydata() for line in pieces]
    low = max(float(end[:, 0].max()) for end in ends)
    assert low == pytest.approx(2.0, abs=1e-5)
    assert "thrust" not in figures.draw_forces(axes(), wall)


def test_mechanism_moves_elements_by_scale_times_velocity(wall: LimitAnalysisResult) -> None:
    assembly, velocity = wall.assembly, wall.mechanism
    drawn = figures.draw_mechanism(axes(), wall)
    scale = quantities.mechanism_scale(assembly, velocity)
    free = assembly.elements.free
    paths = drawn["elements"][0].get_paths()
    moved = np.array([path.vertices[:4].mean(axis=0) for path in paths]) - assembly.elements.centroid[free]
    assert moved == pytest.approx(scale * velocity[free, :2], abs=1e-9)
    assert float(np.sum(moved * assembly.live[free, :2])) == pytest.approx(scale, rel=1e-6)
    corners = np.vstack([path.vertices[:4] for path in paths]) - np.vstack([assembly.elements.shape[k] for k in free])
    assert np.hypot(*corners.T).max() <= quantities.REACH * assembly.size * (1.0 + 1e-9)


def test_rocking_sliding_and_cracking_are_distinguished(beam: LimitAnalysisResult) -> None:
    rocking = solve(block_on_ground(PUSH, angle=45.0))
    kinds, places = quantities.movements(rocking)
    assert kinds == (quantities.MovementSign.HINGE,)
    assert places[0] == pytest.approx([2.0, 4.0])
    (hinge,) = figures.draw_mechanism(axes(), rocking)["hinge"]
    assert hinge.get_xydata()[0] == pytest.approx([2.0, 4.0], abs=1e-4)
    sliding = solve(block_on_ground(PUSH, angle=10.0))
    assert quantities.movements(sliding)[0] == (quantities.MovementSign.SLIDE,)
    lifted = outcome(block_on_ground(PUSH), mechanism=np.array([[0.1, 1.0, 0.0], [0.0, 0.0, 0.0]]))
    assert quantities.movements(lifted)[0] == (quantities.MovementSign.OPEN,)
    kinds, _ = quantities.movements(beam)
    assert kinds.count(quantities.MovementSign.CRACK) == 6
    assert set(kinds) == {quantities.MovementSign.CRACK, quantities.MovementSign.STILL}
    with pytest.raises(ValueError, match="no mechanism"):
        quantities.movements(outcome(beam.assembly))


def test_figure_of_a_result_has_three_panels_on_one_scale(wall: LimitAnalysisResult) -> None:
    figure = figures.figure_of_result(wall)
    assert len(figure.axes) == 3
    assert len({ax.get_xlim() for ax in figure.axes}) == 1
    title = figure.get_suptitle()
    assert "ferris_tinloi_1" in title
    assert "0.64285" in title
    assert "collapse" in title


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", ["ferris_tinloi_4", "flat_beam_arch"])
def test_nothing_is_drawn_over_the_structure(name: str) -> None:
    result = solve(build_assembly(load_scene(SCENES / f"{name}.json")))
    figure = figures.figure_of_result(result)
    figure.canvas.draw()
    whole = figure.bbox
    for ax in figure.axes:
        legend = ax.get_legend()
        box = legend.get_window_extent()
        assert not box.overlaps(ax.bbox)
        assert whole.x0 <= box.x0 < box.x1 <= whole.x1
        assert whole.y0 <= box.y0
        assert annotations.legend_inches(ax) > 0.5
    for left, right in zip(figure.axes[:-1], figure.axes[1:], strict=True):
        one, other = left.get_legend(), right.get_legend()
        assert one.get_window_extent().x1 < other.get_window_extent().x0


@pytest.mark.parametrize(
    ("status", "word"),
    [(Status.LOCKED, "no live load"), (Status.UNSTABLE, "does not stand"), (Status.UNCERTIFIED, "proven")],
)
def test_results_without_mechanism_are_drawn_with_a_note(status: Status, word: str) -> None:
    nan = float("nan")
    result = outcome(block_on_ground(PUSH), status=status, load_factor=nan, bracket=(nan, nan), gap=nan)
    figure = figures.figure_of_result(result)
    assert word in figure.axes[2].get_title()
    assert "none" in figure.axes[1].get_title()
    assert str(status) in figure.get_suptitle()


def test_wide_scenes_are_stacked() -> None:
    assembly = block_on_ground([{"element": "c0r0", "force": [1.0, 0.0]}], rows=("a" * 30, "#" + "." * 28 + "#"))
    figure = figures.figure_of_result(outcome(assembly))
    assert len({round(ax.get_position().x0, 6) for ax in figure.axes}) == 1


@pytest.mark.parametrize("ending", ["png", "svg", "pdf"])
def test_equal_figures_give_equal_files(ending: str, tmp_path: Path) -> None:
    paths = [tmp_path / f"{k}.{ending}" for k in range(2)]
    for path in paths:
        figures.save_figure(figures.figure_of_assembly(block_on_ground(PUSH)), path)
    assert paths[0].stat().st_size > 1000
    assert paths[0].read_bytes() == paths[1].read_bytes()


def test_other_endings_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"\.gif"):
        figures.save_figure(figures.figure_of_assembly(block_on_ground(PUSH)), tmp_path / "picture.gif")
    assert not list(tmp_path.iterdir())


def test_svg_text_can_stand_in_a_page() -> None:
    text = figures.svg_of(figures.figure_of_assembly(block_on_ground(PUSH)))
    assert text.startswith("<svg")
    assert text.rstrip().endswith("</svg>")
    assert "dc:date" not in text


def test_spatial_view_keeps_up_upwards_and_lengths() -> None:
    projection = structure.projection_of(stack_of_boxes())
    assert projection.across.T @ projection.across == pytest.approx(np.eye(2))
    up = projection(np.array([[0.0, 0.0, 1.0]]))[0]
    assert up[0] == pytest.approx(0.0)
    assert up[1] > 0.0
    assert projection.across.T @ projection.toward == pytest.approx(np.zeros(2))


def test_painter_draws_what_stands_behind_first() -> None:
    assembly = stack_of_boxes()
    assert structure.painter_order(assembly, structure.projection_of(assembly).toward) == [0, 1, 2]
    # a contact decides against the depth of centroids: seen from below the upper boxes come first
    assert structure.painter_order(assembly, np.array([0.0, 0.6, -0.8])) == [2, 1, 0]
    turned = replace(assembly.interfaces, a=assembly.interfaces.b, b=assembly.interfaces.a)
    flipped = replace(assembly, interfaces=replace(turned, normal=-turned.normal))
    assert structure.painter_order(flipped, structure.projection_of(assembly).toward) == [0, 1, 2]


def test_spatial_arrows_stand_at_centres_of_pressure() -> None:
    assembly = stack_of_boxes()
    # N = 3 at x1 = 0.5, x2 = −0.25 of the lower face: M2 = −1.5, M1 = −0.75
    forces = np.array([[3.0, 0.3, 0.0, -0.75, -1.5, 0.0], [1.0, 0.1, 0.0, 0.0, 0.0, 0.0]])
    result = outcome(assembly, forces)
    arrow = figures.draw_forces(axes(), result)["press"][0]
    expected = structure.projection_of(assembly)(np.array([[1.5, 0.25, 0.0], [1.5, 0.5, 1.0]]))
    assert arrow.get_offsets() == pytest.approx(expected)
    # lower face: x1 at 0.5 of 1, x2 at 0.25 of 0.5, shear 0.3 of 0.5 · 3
    assert quantities.utilisation(result) == pytest.approx([0.5, 0.2])


def test_spatial_mechanism_and_figure() -> None:
    assembly = stack_of_boxes()
    mechanism = np.zeros((3, 6))
    mechanism[2] = (0.5, 0.0, 0.5, 0.0, 1.0, 0.0)  # the upper box turns about the far edge of its base, x = 2
    result = outcome(assembly, np.zeros((2, 6)), mechanism)
    kinds, places = quantities.movements(result)
    assert kinds == (quantities.MovementSign.STILL, quantities.MovementSign.HINGE)
    assert places[1] == pytest.approx([2.0, 0.5, 1.0])
    figure = figures.figure_of_result(result)
    figure.canvas.draw()
    assert len(figure.axes) == 3
    assert not figure.axes[0].axison
    drawn = figures.draw_assembly(axes(), assembly)
    assert [len(drawn[name]) for name in ("supports", "elements")] == [1, 1]
    # of each box three faces look to the eye; of each contact all four edges are there
    assert len(drawn["elements"][0].get_paths()) == 2 * 3 + 2 * 4


# Every drawing is made of planar and of spatial structures: a function without a row here fails.


SQUARE = [[0, 0], [1, 0], [1, 1], [0, 1]]
SIDES = [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]


def tower(dimension: int) -> dict[str, Any]:
    """Three stones on a support, with a tie, a settlement and a push."""

    def shape(level: float) -> dict[str, Any]:
        """Return the outline of a stone."""
        if dimension == 2:
            return {"polygon": [[x, level + y] for x, y in SQUARE]}
        return {"vertices": [[x, y, level + z] for z in (0, 1) for x, y in SQUARE], "faces": SIDES}

    down = [0.0] * (dimension - 1) + [-1.0]
    middle = [0.5] * (dimension - 1)
    return {
        "name": f"tower {dimension}",
        "elements": [{"id": "ground", "support": True, **shape(-1)}, *({"id": f"s{k}", **shape(k)} for k in range(3))],
        "materials": dry_and_inner(2000, 0.6, 1e5, 1e5),
        "loads": {"live": [{"element": "s2", "force": [1.0] + [0.0] * (dimension - 1)}]},
        "members": [
            {
                "kind": "tie",
                "from": {"element": "s1", "at": [*middle, 1.6]},
                "to": {"element": "s2", "at": [*middle, 2.4]},
                "tension": 50.0,
            }
        ],
        "settlements": [{"name": "down", "supports": [{"elements": ["ground"], "move": down}]}],
    }


def drawings() -> dict[str, Any]:
    """Return the functions of views, laying and reactions that make a figure or write a file, by name."""
    found = {}
    packages = jld_views, jld_practice.laying, jld_practice.reactions
    for package, module in ((one, module) for one in packages for module in pkgutil.iter_modules(one.__path__)):
        code = import_module(f"{package.__name__}.{module.name}")
        for name, one in vars(code).items():
            made = inspect.isfunction(one) and one.__module__ == code.__name__ and not name.startswith("_")
            if made and name.startswith(("figure_of_", "save_")):
                found[f"{module.name}.{name}"] = one
    return found


class Made:
    """What the drawings of one structure need, each computed once."""

    def __init__(self, dimension: int) -> None:
        document = tower(dimension)
        self.scene = parse_scene(document)
        self.assembly = build_assembly(self.scene)
        self.result = solve(self.assembly)
        document.pop("members")  # which an order of laying does not know, nor do fields
        self.bare = parse_scene(document)
        self.plain = build_assembly(self.bare)
        self.laying = assembly_order(self.plain, self.plain.labels)
        self.vertices = np.unique(np.concatenate(self.plain.elements.shape), axis=0)
        self.ranges = thrust_ranges(self.plain)
        self.settled = settle(self.plain, loads.settlements_of(self.bare, self.plain)[0])

    @cached_property
    def fields(self) -> Any:
        """Return assembly, labels and bounds by fields of a coarse mesh."""
        return solve_by_fields(self.plain, gap=0.5, seconds=0.0).governing_case


@pytest.fixture(scope="module", params=[2, 3], ids=["planar", "spatial"])
def made(request: pytest.FixtureRequest) -> Made:
    return Made(request.param)


PATH = [moved_joints.PathValue("cart", 0.5 * k, 1.0, 1.0, 1.0) for k in range(3)]
CALLS: dict[str, Callable[[Any, Made, Path], Any]] = {
    "figures.save_animation": lambda draw, made, folder: draw(made.result, folder / "motion.gif"),
    "strip.save_laying_animation": lambda draw, made, folder: draw(made.laying, folder / "laying.gif"),
    "figures.figure_of_assembly": lambda draw, made, _: draw(made.assembly, ids=True, values=True),
    "figures.figure_of_mechanism": lambda draw, made, _: draw(made.result)[0],
    "figures.figure_of_result": lambda draw, made, _: draw(made.result, ids=True, values=True),
    "figures.figure_of_layouts": lambda draw, made, _: draw([made.result] * 2, ["one", "other"]),
    "figures.save_figure": lambda draw, made, folder: draw(made.result.plot(), folder / "result.svg"),
    "field_figures.figure_of_fields": lambda draw, made, _: draw(*made.fields),
    "field_figures.figure_of_field_layouts": lambda draw, made, _: draw([made.fields], ["one"]),
    "moved_joints.figure_of_move": lambda draw, made, _: draw(
        made.plain, made.plain, made.plain.labels, made.vertices, 0.1 * made.vertices, ("before", "after")
    ),
    "moved_joints.figure_of_vertex_rates": lambda draw, made, _: draw(
        made.plain, made.plain.labels, made.vertices, made.vertices
    ),
    "moved_joints.figure_of_path": lambda draw, made, _: draw(made.plain, PATH),
    "thrust_command.figure_of_settled": lambda draw, made, _: draw(made.settled),
    "strip.figure_of_laying": lambda draw, made, _: draw(made.laying, "laying"),
    "strip.figure_of_stage": lambda draw, made, _: draw(made.laying, 2),
    "thrust_command.figure_of_range": lambda draw, made, _: draw(made.ranges, made.ranges.ranges[0]),
}


def test_every_drawing_has_a_row() -> None:
    assert set(CALLS) == set(drawings())


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", CALLS)
def test_drawing(name: str, made: Made, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(figures, "FRAMES", 2)
    try:
        figure = CALLS[name](drawings()[name], made, tmp_path)
    except InputError:
        assert (name.partition(".")[0], made.assembly.dimension) == ("field_figures", 3)
        return
    if figure is None:
        assert [file.stat().st_size > 1000 for file in tmp_path.iterdir()] == [True]
        return
    assert isinstance(figure, Figure)
    figure.savefig(tmp_path / "figure.png", dpi=40)
    assert (tmp_path / "figure.png").stat().st_size > 1000


@pytest.mark.parametrize("dimension", [2, 3])
def test_pictures_of_a_laying_by_command(dimension: int, jld: Command, tmp_path: Path) -> None:
    document = tower(dimension)
    document.pop("members")
    (tmp_path / "scene.json").write_text(json.dumps(document))
    out = tmp_path / "out"
    jld("assembly", tmp_path / "scene.json", "-o", out, "--stages", "--animation").done()
    written = {file.name for file in out.iterdir()}
    assert {"assembly.csv", "assembly.png", "assembly.gif", "stage-1.png", "stage-3.png"} <= written


# Ids, values and movement on pictures, for who asks for them.


WALL = SCENES / "ferris_tinloi_1.json"


def texts(axes: object) -> list[str]:
    return [artist.get_text().strip() for artist in axes.findobj(Text)]


def test_ids_are_written_on_request_and_as_they_are() -> None:
    document = small_scene()
    base = {"id": "ground", "polygon": [[0, -1], [3, -1], [3, 0], [0, 0]], "support": True}
    block = {"id": "$\\frac{1}{2}$ <b>", "polygon": [[0, 0], [3, 0], [3, 1], [0, 1]]}
    document = {**document, "elements": [base, block], "loads": {"live": [{"body": [1, 0]}]}}
    del document["grid"]
    assembly = build_assembly(parse_scene(document))
    assert block["id"] not in texts(figures.figure_of_assembly(assembly))
    figure = figures.figure_of_assembly(assembly, ids=True)
    assert {"ground", block["id"]} <= set(texts(figure))
    figure.canvas.draw()  # a formula that is none would raise here


def test_values_of_loads_and_forces_are_those_of_the_result() -> None:
    assembly = build_assembly(parse_scene(small_scene()))
    result = solve(assembly)
    assert result.forces is not None
    written = texts(figures.figure_of_result(result, values=True))
    assert "100 N × λ" in written
    total = quantities.body_load(assembly)
    assert total is not None
    assert f"{np.linalg.norm(total):.3g} N × λ" in written
    largest = np.linalg.norm(quantities.face_vectors(assembly, result.forces), axis=1).max()
    assert f"{largest:.3g}" in written
    assert not any("× λ" in text and "N" in text.split() for text in texts(figures.figure_of_result(result)))


def test_a_mechanism_moves_from_rest_one_way_and_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(figures, "FRAMES", 8)
    result = solve(build_assembly(parse_scene(small_scene())))
    figures.save_animation(result, tmp_path / "m.gif")
    with Image.open(tmp_path / "m.gif") as film:
        assert film.n_frames == figures.FRAMES
        frames = []
        for k in range(figures.FRAMES):
            film.seek(k)
            frames.append(np.asarray(film.convert("L"), dtype=float))
    away = [float(abs(frame - frames[0]).mean()) for frame in frames]
    half = figures.FRAMES // 2
    assert away[half] == max(away) > 0.2
    assert away[1] < away[2] < away[half]
    assert away[1] == pytest.approx(away[-1], rel=1e-6)  # the same way back, never through one another


def test_an_animation_needs_an_ending_and_a_mechanism(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    result = solve(build_assembly(parse_scene(small_scene())))
    with pytest.raises(InputError, match=r"\.gif or \.mp4"):
        figures.save_animation(result, tmp_path / "m.avi")
    monkeypatch.setattr(figures.shutil, "which", lambda name: None)
    with pytest.raises(InputError, match="ffmpeg"):
        figures.save_animation(result, tmp_path / "m.mp4")
    document = small_scene()
    document["loads"]["live"] = [{"body": [0, -1]}]
    with pytest.raises(InputError, match="no mechanism"):
        figures.save_animation(solve(build_assembly(parse_scene(document))), tmp_path / "m.gif")
    assert not (tmp_path / "m.gif").exists()


def test_jld_plot_writes_the_requested_format(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, jld: Command) -> None:
    monkeypatch.setattr(figures, "FRAMES", 2)
    for ending, begins in (("svg", b"<?xml"), ("html", b"<!doctype html>")):
        target = tmp_path / f"wall.{ending}"
        assert jld("plot", WALL, "--out", target, "--ids", "--values").code == 0
        assert target.read_bytes().startswith(begins)
    monkeypatch.chdir(tmp_path)  # a picture of a scene is drawn where one stands
    scene = saved(tmp_path / "small.json", parse_scene(small_scene()))
    assert jld("plot", scene, "--format", "gif").code == 0
    assert (tmp_path / "small.gif").read_bytes().startswith(b"GIF8")
    jld("plot", WALL, "--out", tmp_path / "wall.bmp").refused(".html")


def test_the_rules_of_drawing_are_those_of_the_pictures() -> None:
    """One place: what a page is told is what matplotlib draws with."""

    found = look.rules()
    wall = load_scene(WALL)
    figure = figures.figure_of_assembly(build_assembly(wall))
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
    project = structure.projection_of(assembly)
    assert project.toward == pytest.approx([0.43, -0.81, 0.41], abs=0.01)  # the viewer looks from the side of −y
    (written,) = writing.write_numbers(Figure().add_subplot(), assembly, [[0], [1]], assembly.elements.centroid[:2])
    assert written.get_text() == "1"
    outline = shapely.MultiPoint(project(assembly.elements.shape[0])).convex_hull
    assert outline.contains(shapely.Point(written.get_position()))
    apart = document | {
        "elements": [document["elements"][0], box("aside", (2, 0, 0), (2.5, 0.5, 0.5)), document["elements"][2]]
    }
    both_seen = build_assembly(parse_scene(apart))
    both = writing.write_numbers(Figure().add_subplot(), both_seen, [[0, 2], [1]], both_seen.elements.centroid[:2])
    assert [one.get_text() for one in both] == ["1", "2"]
    assert outline.contains(shapely.Point(both[0].get_position()))  # not on the support joined to it


def test_numbers_in_the_plane_stand_at_the_centroids_of_blocks() -> None:
    assembly = build_assembly(samples.grid(columns=3, rows=1))
    ax = Figure().add_subplot()
    free = assembly.elements.free.tolist()
    centroid = assembly.elements.centroid
    places = [centroid[free[:2]].mean(axis=0), centroid[free[2]]]
    written = writing.write_numbers(ax, assembly, [free[:2], free[2:]], places)
    assert np.array([text.get_position() for text in written]) == pytest.approx(np.array(places), rel=1e-12)


def test_the_number_of_an_angle_stands_within_it() -> None:
    """The centroid of an L of thin legs lies in its hollow; its number stands where both legs meet."""
    document = grid_document(["a...", "a...", "aaaa", "####"])
    assembly = build_assembly(parse_scene(document))
    own = assembly.elements.free.tolist()
    weight = assembly.elements.volume[own]
    centroid = weight @ assembly.elements.centroid[own] / weight.sum()
    (written,) = writing.write_numbers(Figure().add_subplot(), assembly, [own], [centroid])
    whole = shapely.union_all([shapely.Polygon(assembly.elements.shape[k]) for k in own])
    assert not whole.contains(shapely.Point(centroid))
    assert whole.boundary.distance(shapely.Point(written.get_position())) > 0.04
    assert whole.contains(shapely.Point(written.get_position()))
