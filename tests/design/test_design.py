"""A design from an outline: what is read, cut, loaded, found and said; bad input is one line."""

from __future__ import annotations

import html
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases import ROUTE, dry_and_inner, solid_of
from command import Command, saved
from jld_core import Deadline, InputError, Layout, Scene, build_assembly, load_scene, parse_scene, samples, solve
from jld_core.fields import governing_bounds
from jld_core.refinement import refine
from jld_core.scene import units
from jld_explore import ExploreSettings, Interrupted, explore
from jld_practice.design import (
    Design,
    DesignOptions,
    Screening,
    Tessellation,
    Trial,
    facts_of,
    read_outline,
    run,
    tessellations,
    trials,
    with_loads,
    write_design,
)
from jld_samples import box

WALL = "id,x,y\n" + "".join(f"w,{x},{y}\n" for x, y in [(0, 0), (1.2, 0), (1.2, 0.8), (0, 0.8)])
ASKED: dict[str, Any] = {"load": "10 kN", "places": "0.3", "push": 0.1, "thickness": 0.3, "block_mass": 150.0}


def arch_outline() -> str:
    """CSV of a wall of 2 × 1.2 m over a semicircular opening."""
    angles = np.radians(np.linspace(180.0, 0.0, 17))
    points = [(0.0, 0.0), *zip((1.0 + 0.7 * np.cos(angles)).round(9), (0.7 * np.sin(angles)).round(9), strict=True)]
    points += [(2.0, 0.0), (2.0, 1.2), (0.0, 1.2)]
    return "id,x,y\n" + "".join(f"w,{x},{y}\n" for x, y in points)


NONE = (-np.inf, np.inf)


def tried(name: str, faces: tuple[float, float], fields: tuple[float, float] = NONE, **keys: Any) -> Any:
    """A layout of a tessellation with its bounds by faces and by fields, of a scene that is yet to be known."""
    keys = {"kind": "searched", "load_factor": faces[0], **keys}
    return lambda scene: Trial(name, scene=scene, faces=faces, fields=fields, words="", **keys)


def design_of(wall: Path, *found: Any, **keys: Any) -> Design:
    """A design of the plain wall in which these layouts were found."""
    options = DesignOptions(**ASKED)
    outline = read_outline(wall, options)
    return Design(options, outline, wall.parent, trials=[one(outline.scene) for one in found], **keys)


@pytest.fixture
def wall(tmp_path: Path) -> Path:
    """Outline of a plain wall."""
    path = tmp_path / "wall.csv"
    path.write_text(WALL)
    return path


@pytest.fixture
def opening(tmp_path: Path) -> Path:
    """Outline of a wall over an opening."""
    path = tmp_path / "opening.csv"
    path.write_text(arch_outline())
    return path


def test_supports_are_added_below_the_lowest_edges(opening: Path) -> None:
    """A drawing without supports gets one below each of its two feet, and says so."""
    outline = read_outline(opening, DesignOptions(**ASKED))
    elements = build_assembly(outline.scene).elements
    assert int(elements.support.sum()) == 2
    assert any("supports below the lowest edges" in note for note in outline.assumed)
    assert any("low friction 0.48" in note for note in outline.assumed)
    assert not any("no load" in note for note in outline.assumed)


def test_a_flat_arch_is_supported_beside_its_sides(tmp_path: Path) -> None:
    """Its soffit is its lowest edge, and yet it is free; a wall that leans less stands on the ground."""
    drawing = tmp_path / "jack.csv"
    for lean, number in ((0.15, 2), (0.01, 1)):
        corners = [(lean, 0), (1.8 - lean, 0), (1.8, 0.4), (0, 0.4)]
        drawing.write_text("id,x,y\n" + "".join(f"j,{x},{y}\n" for x, y in corners))
        outline = read_outline(drawing, DesignOptions(**ASKED))
        assembly = build_assembly(outline.scene)
        assert int(assembly.elements.support.sum()) == number
        assert (abs(assembly.interfaces.normal[:, 1]).max() < 1.0) == (number == 2)
        assert any("flat arch" in note for note in outline.assumed) == (number == 2)


def test_every_tessellation_carries_the_same_loads_and_keeps_the_limit(opening: Path) -> None:
    """Volume, force, its moment and the push agree to 1e-9; no cell is heavier than a block may be."""
    options = DesignOptions(**(ASKED | {"block_mass": 60.0}))
    outline = read_outline(opening, options)
    whole = build_assembly(with_loads(outline.scene, options))
    found = [one for one in tessellations.tessellations(outline.scene, options) if one.scene is not None]
    assert [one.name for one in found] == ["bond", "stones", "voussoirs", "thrust", "voronoi"]
    for one in found:
        assert one.scene is not None
        assembly = build_assembly(one.scene)
        free = assembly.elements.free
        assert assembly.elements.volume[free].sum() == pytest.approx(whole.elements.volume[0], rel=1e-9)
        assert max(block.mass for block in Layout(one.scene, assembly, assembly.labels).blocks) <= 60.0
        for ours, theirs in zip(assembly.by_case, whole.by_case, strict=True):
            assert ours.live[:, :2].sum(axis=0) == pytest.approx(theirs.live[:, :2].sum(axis=0), rel=1e-9, abs=1e-6)
        # the patch of the force: 10 kN about its place, 0.3 of the length of 2 m
        case = assembly.by_case[0]
        moment = case.live[:, 2] + case.elements.centroid[:, 0] * case.live[:, 1]
        assert moment.sum() == pytest.approx(-1e4 * 0.6, rel=0.02)


@pytest.mark.usefixtures("without_pictures", "without_field_check")
def test_shapes_are_counted_as_the_moulds_of_the_report(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Voussoirs of a jack arch are all different unless turned over; half as many moulds are enough for them."""

    def refused(*_: object) -> None:
        raise InputError("", "its stresses take most of the time, and nobody asks for them", "")

    monkeypatch.setattr(tessellations, "stresses_of_body", refused)
    drawing = tmp_path / "jack.csv"
    drawing.write_text("id,x,y\n" + "".join(f"j,{x},{y}\n" for x, y in [(0.15, 0), (1.65, 0), (1.8, 0.4), (0, 0.4)]))
    options = DesignOptions(**(ASKED | {"shapes": 4, "block_mass": 80.0}))
    cut = {one.name: one for one in tessellations.tessellations(read_outline(drawing, options).scene, options)}
    scene = cut["voussoirs"].scene
    assert scene is not None
    done = explore(scene, tmp_path / "out", ExploreSettings(driver="genetic", budget=12, jobs=1, pictures=False))
    assert (done.results["shapes"] <= 4).all()
    assert len(done.results) > 0


def test_after_the_deadline_only_the_usual_bond_is_cut(opening: Path) -> None:
    """Cutting obeys the clock: what is not begun in time says so, and the bond is always there."""
    options = DesignOptions(**ASKED)
    outline = read_outline(opening, options)
    found = tessellations.tessellations(outline.scene, options, Deadline(0.0))
    assert found[0].scene is not None
    assert all(one.scene is None and one.problem == "no time was left" for one in found[1:])


def test_places_are_shares_of_the_top(wall: Path) -> None:
    """Three places lie in the middle of equal thirds; shares are taken as they are."""
    assert DesignOptions(places="3").shares() == pytest.approx([1 / 6, 0.5, 5 / 6])
    assert DesignOptions(places="0.5,0.25").shares() == [0.25, 0.5]
    options = DesignOptions(load="10 kN", places="3", thickness=0.3)
    scene = with_loads(read_outline(wall, options).scene, options)
    assert [case.name for case in scene.loads.cases or []] == ["load at 0.2", "load at 0.6", "load at 1"]


@pytest.mark.parametrize(
    ("along", "places", "at"),
    [
        # chords of the intrados below 22.5° face sidewards: from x = 1 − 0.7 cos 22.5° on
        ("bottom", "0.25", (0.6766, 0.6171)),
        ("left", "0.25", (0.0, 0.3)),
        ("right", "0.75", (2.0, 0.9)),
        ("2,0,2,1.2", "0.25", (2.0, 0.3)),
        ("0.5,1.2,1.5,1.2", "0.25", (0.75, 1.2)),
    ],
)
def test_loads_act_along_any_edge(opening: Path, along: str, places: str, at: tuple[float, float]) -> None:
    """Force and moment about the origin are those of the place; cells carry what the whole outline does."""
    options = DesignOptions(load="10 kN", along=along, places=places, thickness=0.3, width=0.04)
    outline = read_outline(opening, options)
    for scene in (outline.scene, refine(outline.scene, (0.3, 0.22)).scene):
        found = [one.model_dump() for one in with_loads(scene, options).loads.live or []]
        force = np.array([one["force"] for one in found])
        place = np.array([one["at"] for one in found])
        assert force.sum(axis=0) == pytest.approx([0.0, -1e4])
        assert (force[:, 1] @ place) / -1e4 == pytest.approx(at, abs=2e-3)


def test_loads_act_along_the_extrados(tmp_path: Path) -> None:
    """Places are lengths along the arc from the left: a quarter of a half circle lies at 135°."""
    angles = np.radians(np.linspace(0.0, 180.0, 25))
    arc = np.column_stack([np.cos(angles), np.sin(angles)])
    file = tmp_path / "ring.csv"
    file.write_text("id,x,y\n" + "".join(f"r,{x:.9f},{y:.9f}\n" for x, y in [*(2.4 * arc), *(2.0 * arc[::-1])]))
    options = DesignOptions(load="10 kN", along="extrados", places="0.25,0.5", thickness=0.3, width=0.01)
    outline = read_outline(file, options)
    for scene in (outline.scene, refine(outline.scene, voussoirs=7).scene):
        cases = with_loads(scene, options).loads.cases or []
        places = [np.mean([one.at for one in case.live], axis=0) for case in cases]
        assert places == pytest.approx(np.array([[-2.4, 2.4], [0.0, 2.4]]) * [[0.5**0.5] * 2, [1.0, 1.0]], abs=6e-3)


def test_a_layout_becomes_the_labels_of_its_scene(wall: Path) -> None:
    """The scene of a layout has its λ; another friction and a single case are those of the scene."""
    options = DesignOptions(**ASKED)
    outline = read_outline(wall, options)
    scene = tessellations.tessellations(outline.scene, options, Deadline(0.0))[0].scene  # the bond alone
    assert scene is not None
    assembly = build_assembly(scene)
    labels = np.arange(len(assembly.interfaces)) % 3 > 0
    labels |= ~assembly.free_faces
    expected = solve(assembly, labels)
    again = trials.labelled(scene, assembly, labels)
    result = solve(again)
    assert result.load_factor == pytest.approx(expected.load_factor, rel=1e-9)
    case = list(expected.cases.values())[1]
    assert solve(trials.one_case(again, 1)).load_factor == pytest.approx(case.load_factor, rel=1e-9)
    friction = build_assembly(trials.with_friction(again, 0.25)).strengths(ROUTE).friction
    assert friction[labels] == pytest.approx(0.25)


@pytest.mark.parametrize(
    ("dry", "low"),
    [
        ({"friction_coefficient": 0.6}, 0.8 * 0.6),
        ({"friction_coefficient": {"nominal": 0.6, "low": 0.5}}, 0.5),
        ({"friction_coefficient": {"mean": 0.6, "cov": 0.1, "kind": "normal"}}, 0.8 * 0.6),
        ({"friction_angle": 30}, 0.8 * np.tan(np.radians(30.0))),
        ({"friction_angle": {"nominal": 30, "low": 25}}, np.tan(np.radians(25.0))),
        ({"friction_angle": {"mean": 30, "cov": 0.1, "kind": "lognormal"}}, 0.8 * np.tan(np.radians(30.0))),
    ],
)
def test_every_form_of_friction_has_a_low_value(dry: dict[str, Any], low: float) -> None:
    """The low value where one is stated, else 0.8 of the nominal one or of the mean; angles by their tangents."""
    document = samples.arch(voussoirs=5).model_dump(mode="json", exclude_defaults=True)
    scene = parse_scene(document | {"materials": document["materials"] | {"dry": dry}})
    assert trials.low_friction(scene) == pytest.approx(low, rel=1e-12)


def test_bounds_by_fields_hold_the_closed_form_of_a_sliding_wall(wall: Path) -> None:
    """A wall that slides on its base fails at μ over the push, 0.6/0.1, from both sides."""
    options = DesignOptions(push=0.1, friction=0.6, tension=1e9, shear=1e9, thickness=0.3)
    scene = with_loads(read_outline(wall, options).scene, options)
    assembly = build_assembly(scene)
    low, high = governing_bounds(assembly, assembly.labels, 60.0)
    assert low <= 6.0 * (1.0 + 1e-6)
    assert high >= 6.0 * (1.0 - 1e-6)
    assert low == pytest.approx(6.0, rel=0.05)


def test_a_gain_compares_like_with_like(wall: Path) -> None:
    """The gain is the lower bound of the best over the upper one of the usual bond, never fields over faces."""
    for usual, fields, gain in (
        (NONE, (5.0, 6.0), None),
        ((1.6, 2.0), NONE, None),
        ((1.6, 2.0), (5.0, 6.0), pytest.approx(2.5)),
        (NONE, NONE, pytest.approx(4.5)),
    ):
        known = tried("bond", (2.0, 2.0), usual, kind="stated", allowed=False)
        best = tried("bond", (9.0, 9.0), fields, kind="moved")
        assert facts_of(design_of(wall, known, best))["gain"] == gain


def test_a_gain_by_faces_that_fields_refute_is_not_claimed(wall: Path) -> None:
    """An upper bound by fields below λ by faces takes the claim away, and ranks the layout by what it can carry."""
    refuted = tried("stones", (933.0, 933.0), (-np.inf, 5.4))
    work = design_of(wall, refuted, tried("bond", (7.0, 7.0)), tried("voronoi", (3.0, 3.0), (1.5, 3.0)))
    denied = work.trials[0]
    assert (denied.proven, denied.upper_estimate, denied.stands) == (-np.inf, 5.4, True)
    assert [one.tessellation for one in work.ranked] == ["voronoi", "bond", "stones"]
    work.trials = [denied]
    facts = write_design(work, pictures=False)
    assert "carries at most 5.4" in (wall.parent / "report.html").read_text("utf-8")
    assert facts["best"] is None
    assert design_of(wall, tried("bond", (7.0, 7.0), (-np.inf, -16.0)), refuted).winner.tessellation == "stones"
    usual = tried("bond", (2.0, 2.0), kind="stated", allowed=False)
    assert facts_of(design_of(wall, usual, refuted))["gain"] is None


@pytest.mark.parametrize(
    ("faces", "fields", "rival", "words"),
    [
        ((26.7, 26.7), (1.6, 2.1), None, "at least 1.6 times your load wherever they crack; not decided between"),
        ((2.0, 2.0), NONE, None, "carries at least 2 times your load by the faces drawn; cracks elsewhere"),
        ((2.0, 2.0), (0.4, 0.5), None, "That is less than the load itself."),
        ((2.0, 2.0), (0.9, 1.5), None, "That the load is carried is not proven."),
        ((9.0, 9.0), (-np.inf, 2.1), None, "is not decided: at most 2.1 times your load."),
        ((9.0, 9.0), (1.6, 2.1), (1.2, 3.3), "Whether another layout carries more is not decided (voronoi"),
        ((9.0, 9.0), (1.6, 2.1), (1.2, 1.5), ""),
    ],
)
def test_a_design_begins_with_its_verdict(
    wall: Path, faces: tuple[float, float], fields: tuple[float, float], rival: tuple[float, float] | None, words: str
) -> None:
    """What the best carries by the weakest model known, what is not decided, and who may carry more."""
    others = [] if rival is None else [tried("voronoi", (9.0, 9.0), rival)]
    work = design_of(wall, tried("bond", faces, fields), *others)
    facts = facts_of(work)
    told = facts["verdict"]
    assert words in told
    assert ("not decided (voronoi" in told) is (rival is not None and rival[1] > 1.6)
    assert len(facts["rivals"]) == int("(voronoi" in told)
    write_design(work, pictures=False)
    page = (wall.parent / "report.html").read_text("utf-8")
    assert page.index(told.split(".")[0][:40]) < page.index("Loads:")


@pytest.mark.parametrize(
    ("searched", "claimed"),
    [
        ("17 layouts, proven", True),
        ("1 layout, proven: none of them stands", True),
        ("48 layouts, not proven", False),
        ("search: no layout was found within 2 s, nor a proof that there is none", False),
        ("no time was left", False),
    ],
)
def test_only_finished_searches_are_called_proven(wall: Path, searched: str, claimed: bool) -> None:
    write_design(design_of(wall, search_words={"bond": searched}), pictures=False)
    assert ("Proven: of the cells of bond" in (wall.parent / "report.html").read_text("utf-8")) == claimed


@pytest.mark.parametrize(
    ("faces", "load_factor", "words"),
    [
        ((5.0, np.inf), np.nan, "λ ≥ 5 by faces"),
        ((-np.inf, -np.inf), np.nan, "does not stand"),
        ((2.0, 2.0), 2.0, "λ = 2"),
    ],
)
def test_what_has_no_number_is_said_in_words(
    wall: Path, faces: tuple[float, float], load_factor: float, words: str
) -> None:
    """Locked layouts have a lower bound, unstable ones none; a gain below one is no gain."""
    usual = tried("bond", faces, kind="stated", load_factor=load_factor, allowed=False)
    work = design_of(wall, usual, tried("stones", (1.0, 1.0)))
    assert work.trials[0].by_faces.startswith(words)
    write_design(work, pictures=False)
    told = html.unescape((wall.parent / "report.html").read_text("utf-8"))
    falls = "does not stand under its dead load; the best does"
    unproven = "it does not keep the limits, and that the best carries more is not proven"
    assert (falls if words == "does not stand" else unproven) in told
    assert "nan" not in told


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few cells, of one kind, without moves and experiment, so that a design takes a second."""
    monkeypatch.setattr(tessellations, "_CELLS", 4)
    kept = tessellations.tessellations

    def first(
        outline: Scene, options: DesignOptions, until: Deadline, made: Callable[[Tessellation], None]
    ) -> list[Tessellation]:
        found = kept(outline, options, until)[:1]
        made(found[0])
        return found

    monkeypatch.setattr(run, "tessellations", first)
    monkeypatch.setattr(run, "_MOVED", 1e9)
    monkeypatch.setattr(trials, "_LEAST_EXPERIMENT", 1e9)


@pytest.mark.usefixtures("small")
def test_a_design_leaves_page_scene_and_proven_load(jld: Command, tmp_path: Path, wall: Path) -> None:
    """The scene of the best layout has the load that the summary says is proven; the page names what is not."""
    out = tmp_path / "out"
    asked = ["--push", "0.1", "--friction", "0.6", "--thickness", "0.3", "--seconds", "40", "--block-mass", "400"]
    jld("design", wall, "-o", out, *asked, "--jobs", "1").done()
    facts = json.loads((out / "summary.json").read_text())
    assert facts["proven"] is False
    best = solve(out / "best.json")
    assert facts["best"] <= best.load_factor * (1.0 + 1e-6)
    # sliding on the base bounds every layout: μ over the push
    assert facts["best"] <= 6.0 * (1.0 + 1e-6)
    page = (out / "report.html").read_text()
    for words in ("Not proven: that no stronger layout exists", "low friction 0.48", "supports below the lowest"):
        assert words in page
    assert (out / "blocks.csv").read_text().count("\n") > 1
    checked = {"laying", "experiment", "by fields", "low friction", "without cuts"}
    assert {one["name"] for one in facts["checks"]} == checked


@pytest.mark.usefixtures("small")
@pytest.mark.parametrize(
    ("work", "said"),
    [("check_winner", "the best so far is in"), ("tessellations", "stopped while the outline was cut")],
)
def test_a_signal_leaves_the_best_so_far_or_nothing(
    jld: Command, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, wall: Path, work: str, said: str
) -> None:
    """Interrupted in the checks, a design writes page and scene; before anything is solved, one line and no folder."""

    def stop(*_: object) -> None:
        raise Interrupted

    monkeypatch.setattr(run, work, stop)
    out = tmp_path / "out"
    done = jld("design", wall, "-o", out, "--push", "0.1", "--thickness", "0.3", "--seconds", "40", "--jobs", "1")
    assert done.code == 3
    assert said in done.err
    assert out.exists() is (work == "check_winner")
    if not out.exists():
        assert done.err.count("\n") == 1
        return
    facts = json.loads((out / "summary.json").read_text())
    assert facts["stop_reason"] == "interrupted"
    assert facts["best"] is not None
    assert (out / "report.html").exists()


def test_checks_that_fail_leave_no_pipe_open(monkeypatch: pytest.MonkeyPatch, wall: Path) -> None:
    """An error in the checks, after the experiment beside them has ended: nobody has read its output."""
    pipe = subprocess.PIPE
    experiment = subprocess.Popen([sys.executable, "-c", "print(1)"], stdout=pipe, stderr=pipe, text=True)
    experiment.wait(120.0)

    def fail(*_: object) -> None:
        raise Interrupted

    monkeypatch.setattr(trials, "_laid", lambda *_: trials.Check("laying", "laid"))
    monkeypatch.setattr(trials, "_begin_experiment", lambda *_: trials.Experiment(experiment, "", ""))
    monkeypatch.setattr(trials, "_by_fields", fail)
    work = design_of(wall)
    with pytest.raises(Interrupted):
        trials.check_winner(work, Deadline(60.0), lambda _: None)
    assert experiment.stdout.closed


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (["--seconds", "2"], "--seconds: 2 s are too short"),
        (["--block-mass", "0.01"], "1920 kg would be 192000 blocks of that mass; expected at least 9.6 kg"),
        (["--block-mass", "-1"], "--block-mass"),
        (["--shapes", "0"], "--shapes"),
        (["--load", "10 apples"], "--load"),
        (["--load", "1 kN/m"], "--load"),
        (["--places", "0"], "--places"),
        (["--places", "0.5,1.5"], "--places"),
        (["--load", "1 kN", "--width", "5"], "--width"),
        (["--load", "1 kN", "--along", "front"], "--along: 'front' is no part of an outline"),
        (["--load", "1 kN", "--along", "bottom"], "--along: no free edge of the outline faces downwards"),
        (["--load", "1 kN", "--along", "extrados"], "--along: no arc of the outline is round upwards"),
        (["--load", "1 kN", "--along", "0,0.1,1.2,0.8"], "--along: no free straight edge"),
        (["--load", "1 kN", "--along", "0,1,2"], "--along: '0,1,2' is no part"),
        (["--along", "left"], "--along: no force acts there"),
        (["--friction-low", "0.5"], "--friction-low"),
        (["--friction", "0.5", "--friction-low", "0.6"], "--friction-low: 0.6 is above"),
    ],
)
def test_bad_options_are_one_line(jld: Command, tmp_path: Path, wall: Path, flags: list[str], words: str) -> None:
    """Every wrong option is one line with exit code 2, and no folder is made."""
    jld("design", wall, "-o", tmp_path / "out", *flags).refused(words)
    assert not (tmp_path / "out").exists()


def test_an_open_outline_is_named_with_the_place(jld: Command, tmp_path: Path) -> None:
    """An outline whose ends do not meet is one line that names an end."""
    path = tmp_path / "open.svg"
    path.write_text(
        '<svg xmlns="http://www.w3.org/2000/svg"><path d="M 0 0 L 2 0 L 2 1 L 0 1" fill="none" stroke="black"/></svg>'
    )
    pytest.importorskip("svgelements")
    jld("design", path, "-o", tmp_path / "out").refused("not closed")


@pytest.mark.parametrize(
    ("corners", "flags", "words"),
    [
        ("0,0 2,0 0,1 2,1", [], "its outline crosses itself at (1, 0.5)"),
        ("0,0 4000,0 4000,3000 0,3000", [], "--unit: the structure is 4e+03 m large"),
        ("0,0 2,0 2,1 0,1", ["--load", "10"], "--load: '10' names no unit of force"),
    ],
)
def test_an_outline_that_cannot_be_meant_is_refused(
    jld: Command, tmp_path: Path, corners: str, flags: list[str], words: str
) -> None:
    """A drawing that crosses itself, one in mm that was read in m, and a load without a unit are one line each."""
    drawing = tmp_path / "drawing.csv"
    drawing.write_text("id,x,y\n" + "".join(f"w,{point}\n" for point in corners.split()))
    jld("design", drawing, "-o", tmp_path / "out", *(flags or ["--load", "10 kN"])).refused(words)
    assert not (tmp_path / "out").exists()


def test_a_scene_says_its_thickness_itself(tmp_path: Path) -> None:
    """Options of drawings are refused for scenes."""
    scene = tmp_path / "scene.json"
    scene.write_text('{"elements": []}')
    with pytest.raises(InputError, match="the outline is a scene"):
        read_outline(scene, DesignOptions(thickness=0.2))


@pytest.mark.parametrize(("force", "length"), [("kN", "m"), ("N", "mm"), ("kip", "in")])
def test_options_are_kilograms_metres_and_pascals_in_scenes_of_all_units(
    force: str, length: str, tmp_path: Path
) -> None:
    """Density, strengths, mass of blocks and width of a load as `--help` states them: one λ of one tessellation."""
    found = []
    for words in (("N", "m"), (force, length)):
        n, m = units.NEWTONS[words[0]], units.METRES[words[1]]
        outline = [[x / m, y / m] for x, y in ((0, 0), (1.2, 0), (1.2, 0.8), (0, 0.8))]
        ground = [[x / m, y / m] for x, y in ((0, -0.1), (1.2, -0.1), (1.2, 0), (0, 0))]
        scene = {
            "units": {"force": words[0], "length": words[1]},
            "elements": [{"id": "w", "polygon": outline}, {"id": "g", "polygon": ground, "support": True}],
            "thickness": 0.3 / m,
            "materials": {"dry": {"friction_coefficient": 0.6}},
            "loads": {"live": [{"element": "w", "force": [1e3 / n, 0.0], "at": [0.0, 0.8 / m]}]},
        }
        path = saved(tmp_path / "scene.json", scene)
        options = DesignOptions(load="5 kN", width=0.3, push=0.1, block_mass=90.0, density=1800.0, shear=2e6)
        read = read_outline(path, options).scene
        cut = {one.name: one for one in tessellations.tessellations(read, options, Deadline(0.0))}
        assembly = build_assembly(cut["bond"].scene)
        weight = float(assembly.elements.weight[assembly.elements.free, 1].sum()) * n
        stone = read.materials.inner
        strengths = [value * n / m**2 for value in (stone.tensile_strength, stone.shear_strength)]
        found.append([solve(assembly).load_factor, len(assembly.elements), weight, *strengths])
    assert found[0][3:] == [2e5, 2e6]
    assert found[1] == pytest.approx(found[0], rel=1e-9)


def test_a_vault_spans_across_its_axis(tmp_path: Path) -> None:
    """A load at a quarter lies at a quarter of the span, though the vault is shorter than wide; it acts on the top."""
    angles = np.radians(np.linspace(0.0, 180.0, 9))
    unit = np.column_stack([np.cos(angles), np.sin(angles)]).round(12)
    ring = np.concatenate([2.0 * unit, 1.6 * unit[::-1]])
    count = len(ring)
    lines = [f"v {x} {y} {z}" for y in (0.0, 1.0) for x, z in ring.tolist()]
    loops = [range(1, count + 1), range(2 * count, count, -1)]
    lines += ["f " + " ".join(map(str, loop)) for loop in loops]
    lines += [f"f {i + 1} {count + i + 1} {count + (i + 1) % count + 1} {(i + 1) % count + 1}" for i in range(count)]
    path = tmp_path / "vault.obj"
    path.write_text("o vault\n" + "\n".join(lines) + "\n")
    pytest.importorskip("meshio")
    options = DesignOptions(load="5 kN", places="0.25,0.5", push=0.1)
    outline = read_outline(path, options)
    found = {one.name: one for one in tessellations.tessellations(outline.scene, options)}
    assert found["grid"].scene is None
    assert "not convex" in found["grid"].problem
    scene = found["bond"].scene
    places = [case.live[0].model_dump()["at"] for case in (scene.loads.cases or [])[:2]]
    assert places[0][0] == pytest.approx(-1.0)
    assert places[1] == pytest.approx([0.0, 0.499, 2.0])
    assert (scene.loads.cases or [])[2].live[0].model_dump()["body"] == [0.1, 0.0, 0.0]
    assembly = build_assembly(scene)
    whole = build_assembly(outline.scene)
    assert assembly.elements.volume[assembly.elements.free].sum() == pytest.approx(whole.elements.volume[0], rel=1e-9)


def test_a_scene_of_cells_is_one_outline() -> None:
    """Area, weight, loads and supports of the flagship stay; what speaks of its cells is left out, and said."""
    path = Path(__file__).parents[2] / "scenes" / "flat_beam_arch.json"
    old = build_assembly(load_scene(path))
    outline = read_outline(path, DesignOptions())
    new = build_assembly(outline.scene)
    assert len(new.elements.free) == 1
    free = old.elements.free
    assert new.elements.volume[new.elements.free].sum() == pytest.approx(old.elements.volume[free].sum(), rel=1e-9)
    assert int(new.elements.support.sum()) == int(old.elements.support.sum())
    assert new.live[:, :2].sum(axis=0) == pytest.approx(old.live[:, :2].sum(axis=0))
    assert any("are one outline" in note for note in outline.assumed)


@pytest.mark.usefixtures("small")
def test_without_time_for_a_search_the_usual_bond_is_the_best(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, wall: Path
) -> None:
    """Where the limits allow it, the stated bond is what is left, with its proven λ; else the design says why not."""
    monkeypatch.setattr(run, "_search_all", lambda *_: None)
    monkeypatch.setattr(run, "_screen_tessellation", lambda *_: None)
    done = run.design_outline(wall, tmp_path / "out", DesignOptions(push=0.1, thickness=0.3, seconds=40.0, jobs=1))
    assert done.winner is done.usual
    assert done.winner.proven > 0.0
    limited = DesignOptions(push=0.1, thickness=0.3, seconds=40.0, jobs=1, shapes=1)
    with pytest.raises(InputError, match="no layout keeps the limits"):
        run.design_outline(wall, tmp_path / "none", limited)
    assert not (tmp_path / "none").exists()
    (tmp_path / "none").mkdir()
    with pytest.raises(InputError, match="no layout keeps the limits"):
        run.design_outline(wall, tmp_path / "none", limited)
    assert list((tmp_path / "none").iterdir()) == []


@pytest.mark.parametrize("door", [True, False])
def test_a_room_is_cut_with_lintels_or_flat_arches_and_loaded_on_its_nearest_wall(door: bool) -> None:
    """In the middle of the room nothing lies below a force: it acts on the front wall, in every tessellation."""
    levels = [[0.0, 0.2, 0.8, 1.4, 2.2, 2.4], [0.0, 0.2, 1.8, 2.0], [0.0, 0.8, 1.2]]
    cells = np.ones((5, 3, 2), dtype=bool)
    cells[1:4, 1] = False
    cells[2, 0, 0] = not door
    given = parse_scene(
        {
            "elements": [
                solid_of("w", cells, levels),
                box("ground", (-0.4, -0.4, -0.2), (2.8, 2.4, 0.0), support=True),
            ],
            "materials": dry_and_inner(2000.0, 0.6, 2e5, 2e5),
            "loads": {"live": [{"body": [1.0, 0.0, 0.0]}]},
        },
        "room",
    )
    options = DesignOptions(load="10 kN", places="0.5", push=0.1)
    found = {one.name: one for one in tessellations.tessellations(given, options)}
    cut = [found[name].scene for name in ("walls", "arches")]
    if not door:
        assert found["arches"].problem == "the same stones as walls"
    assert [one is not None for one in cut] == [True, door]
    for one in cut[: 1 + door]:
        case = next(case for case in one.loads.cases or [] if case.name.startswith("load"))
        x, y, z = (case.live or [])[0].model_dump()["at"]
        assert (x, z) == pytest.approx((1.2, 1.2))
        assert 0.0 < y < 0.2


def test_every_command_takes_the_folder_of_a_design(jld: Command, tmp_path: Path) -> None:
    """The layout of the folder is its best, which has no rank."""
    folder = tmp_path / "out"
    folder.mkdir()
    scene = samples.arch(voussoirs=5)
    (folder / "best.json").write_text(scene.model_dump_json(exclude_defaults=True))
    (folder / "summary.json").write_text(json.dumps({"options": {"laid": "right-to-left"}}))
    best = folder / "best.json"
    laid = [jld("assembly", *line).out for line in ([folder], [best, "--start", "right"], [best])]
    assert laid[0] == laid[1] != laid[2]
    told = json.loads(jld("solve", folder, "--json").out)
    assert told["load_factor"] == pytest.approx(solve(scene).load_factor)
    for command in (
        ["assembly", folder],
        ["thrust", folder],
        ["export", folder, "--format", "dxf", "-o", tmp_path / "blocks.dxf"],
        ["plot", folder, "--out", tmp_path / "arch.png"],
    ):
        jld(*command).done()
    assert "is a scene, which has no ranks" in jld("solve", folder, "--rank", "2").err


def test_a_layout_is_known_as_soon_as_the_first_tessellation_is_cut(
    monkeypatch: pytest.MonkeyPatch, opening: Path, tmp_path: Path
) -> None:
    """A signal while other tessellations are cut left a design without λ, also where the usual bond falls."""

    def stop(*_: object) -> None:
        raise Interrupted

    monkeypatch.setattr(tessellations, "stresses_of_body", stop)
    options = DesignOptions(**ASKED | {"push": 0.05, "friction": 0.6, "seconds": 600.0, "jobs": 1})
    monkeypatch.setattr(run, "_solve_usual", lambda _: None)
    monkeypatch.setattr(run, "_LONGEST_SCREENING", 0.1)
    with pytest.raises(Interrupted) as stopped:
        run.design_outline(opening, tmp_path / "out", options)
    assert "the best so far is in" in stopped.value.words
    facts = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert facts["stop_reason"] == "interrupted"
    assert facts["load_factor"] > 0.0
    assert facts["best"] == pytest.approx(facts["load_factor"], rel=1e-6)
    assert [one["kind"] for one in facts["layouts"]].count("searched") == len(facts["layouts"])
    assert (tmp_path / "out" / "best.json").exists()


def test_a_short_time_is_spent_on_the_most_promising_tessellations(
    monkeypatch: pytest.MonkeyPatch, opening: Path, tmp_path: Path
) -> None:
    """Equal shares of 9 s among five tessellations gave each a hundred layouts, and none a bound by fields."""
    options = DesignOptions(**ASKED | {"seconds": 60.0, "jobs": 1})
    assembly = build_assembly(read_outline(opening, options).scene)
    for left, expected in ((17.0, ["b", "d"]), (300.0, ["b", "d", "c", "a"])):
        work = Design(options, read_outline(opening, options), tmp_path)
        work.tessellations = [Tessellation(name, name, work.outline.scene) for name in "abcde"]
        values = zip("abcd", (-np.inf, 3.0, 1.0, 2.0), strict=True)
        work.screened = {name: Screening(assembly, None, value, 48, 5.0) for name, value in values}
        work.search_words = {"e": "its limits cannot be met"}
        searched: list[str] = []

        def note(_: Design, one: Tessellation, until: Deadline, found: list[str] = searched) -> None:
            assert until.remaining() > 1.0
            found.append(one.name)

        monkeypatch.setattr(run, "_search", note)
        work.search_words |= dict.fromkeys("abcd", "48 layouts, not proven")
        run._search_all(work, Deadline(left), lambda _: None)
        assert searched == expected


# The outline of a design that is a scene: its loads stay on the parts that carry them.


def outline(rows: list[str], live: list[dict[str, Any]], path: Path, **more: Any) -> dict[str, Any]:
    document = {
        "grid": {"cell": [1.0, 1.0], "thickness": 1.0, "rows": rows},
        "materials": {"density": 2000, "dry": {"friction_coefficient": 0.6}},
        "loads": {"live": live},
        **more,
    }
    path.write_text(json.dumps(document), encoding="utf-8")
    return read_outline(path, DesignOptions()).scene.model_dump(mode="json", exclude_defaults=True)


@pytest.mark.parametrize("at", [[3.0, 2.5], [1.5, 3.0], [5.0, 3.0], None])
@pytest.mark.parametrize("column", [1, 4])
def test_a_load_stays_on_the_outline_of_its_element(column: int, at: list[float] | None, tmp_path: Path) -> None:
    """Two piers: a force may act half way between them, or even within the other one."""
    load = {"element": f"c{column}r0", "force": [0, -1e3]}
    document = outline(
        ["aa..bb", "aa..bb", "######"], [load if at is None else {**load, "at": at}], tmp_path / "s.json"
    )
    loaded = document["loads"]["live"][0]["element"]
    (polygon,) = (entry["polygon"] for entry in document["elements"] if entry["id"] == loaded)
    low, high = np.min(polygon, axis=0)[0], np.max(polygon, axis=0)[0]
    assert low < column + 0.5 < high


@pytest.mark.parametrize(
    ("live", "more", "where"),
    [
        ({"face": {"between": ["c1r0", "outside"]}, "pressure": 1e3}, {}, "loads"),
        (
            {"body": [1, 0]},
            {
                "members": [
                    {
                        "kind": "tie",
                        "from": {"element": "c0r0", "at": [0.5, 2.5]},
                        "to": {"element": "c1r0", "at": [1.5, 2.5]},
                        "tension": 1e3,
                    }
                ]
            },
            "members",
        ),
    ],
)
def test_what_names_cells_of_an_outline_is_refused(live: Any, more: Any, where: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="become one outline") as complaint:
        outline(["aa", "##"], [live], tmp_path / "s.json", **more)
    assert complaint.value.where.endswith(where)
