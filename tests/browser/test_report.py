"""The page of a search in a real browser: every view, by mouse and by keyboard."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from browser_visits import Open, Visit, looks_like
from cases import HOSTILE, scene_of_cases, small_scene, spatial_scene
from command import SCENES
from jld_core import blocks_of, build_assembly, load_scene, parse_scene, samples, solve
from jld_explore import ExploreSettings, explore, read_folder
from jld_studio import NotebookPage
from jld_views import look, page_of_study, quantities, show_page
from jld_views import page_data as joined


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the page of a search; the page holds forces of the front and the best only."""
    where = tmp_path_factory.mktemp("browser") / "study"
    explore(parse_scene(small_scene()), where, ExploreSettings(jobs=1, pictures=False))
    done = read_folder(where)
    (where / "report.html").write_text(page_of_study.study_page(done, patience=60.0), encoding="utf-8")
    return where


@pytest.fixture(scope="module")
def spatial(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of a search of a spatial scene."""
    where = tmp_path_factory.mktemp("browser") / "spatial"
    explore(parse_scene(spatial_scene()), where, ExploreSettings(jobs=1, budget=20, pictures=False))
    (where / "report.html").write_text(page_of_study.study_page(read_folder(where), patience=60.0), encoding="utf-8")
    return where


def rows(found: Visit) -> list[list[str]]:
    """Texts of the rows of the table in sight."""
    cells = "() => [...document.querySelectorAll('tr[data-row]')].map(r => [...r.cells].map(c => c.innerText))"
    return list(found.run(cells))


def place(study: Path, row: int) -> str:
    """How a link names a row: by its rank where it is the first of that rank, which layouts may share."""
    ranks = [int(rank) for rank in read_folder(study).results["rank"]]
    return str(ranks[row]) if ranks.index(ranks[row]) == row else f"r{row}"


def test_a_page_opens_from_disk_with_its_best_layout(visit: Open, study: Path) -> None:
    found = visit(study / "report.html")
    assert found.run("() => document.body.dataset.ready") == "yes"
    done = read_folder(study)
    assert found.text("h1") == "two courses"
    assert "Rank 1" in found.text(".pane h3")
    assert f"{done.summary.best:.5g}" in found.text(".pane .verdict")
    assert found.text(".count") == f"{len(done.results)} layouts"
    assert f"{done.summary.bound:.9g}" in found.text("#facts")
    looks_like(found, "report", "#picture")  # words around it may change


def test_views_follow_clicks_and_links(visit: Open, study: Path) -> None:
    found = visit(f"{(study / 'report.html').as_uri()}#row=1&view=mechanism")
    rank = read_folder(study).results["rank"].iloc[1]
    assert f"Rank {rank}" in found.text(".pane h3")
    assert found.run("() => document.querySelector('[role=tab][aria-selected=true]').dataset.view") == "mechanism"
    assert found.page.locator(".motion").is_visible()
    moved = "() => [...document.querySelectorAll('svg.figure > g')].map(g => g.getAttribute('transform')).join()"
    full = found.run(moved)
    found.page.locator("#phase").fill("0")
    assert found.run(moved) != full
    at_rest = found.run(moved)
    assert "matrix(1 0 0 1 0 0)" in at_rest.replace("-0", "0")
    found.page.locator(".play").click()
    found.page.wait_for_function(f"() => ({moved})() !== {json.dumps(at_rest)}")
    found.page.locator(".play").click()
    found.page.locator("#phase").fill("1")
    looks_like(found, "mechanism", "#viewer")
    found.page.locator("[data-view=forces]").click()
    assert "view=forces" in found.page.url
    assert found.page.locator("path.force").count() > 0
    looks_like(found, "forces", ".drawing")  # not the legend: which forces prove λ is the solver's choice


def test_the_thrust_line_and_values_are_there_on_request(visit: Open, tmp_path: Path) -> None:
    scene = load_scene(SCENES / "ferris_tinloi_1.json")
    (tmp_path / "scene.html").write_text(page_of_study.scene_page(scene, build_assembly(scene)), encoding="utf-8")
    found = visit(tmp_path / "scene.html")
    found.page.locator("[data-view=forces]").click()
    for name in ("ids", "values"):
        assert found.page.locator(f"text.note{'.id' if name == 'ids' else '.value'}").count() == 0
        found.page.locator(f"[data-show={name}]").check()
        assert found.page.locator(f"text.note{'.id' if name == 'ids' else '.value'}").count() > 0


def test_the_pointer_shows_the_forces_of_a_face(visit: Open, study: Path) -> None:
    found = visit(f"{(study / 'report.html').as_uri()}#view=forces")
    found.page.locator("line.touch").first.hover(force=True)
    tip = found.text(".stage .tip")
    assert "face 0" in tip
    assert "N = " in tip
    assert "utilisation" in tip


def test_the_table_filters_sorts_and_brushes_with_the_picture(visit: Open, study: Path) -> None:
    found = visit(study / "report.html")
    done = read_folder(study)
    found.page.locator("[data-filter=dry_faces]").fill("3..4")
    wanted = int(done.results["dry_faces"].between(3, 4).sum())
    assert 0 < wanted < len(done.results)
    assert found.text(".count") == f"{wanted} of {len(done.results)} layouts"
    found.page.locator("[data-filter=dry_faces]").fill("nonsense")
    assert found.page.locator("[data-filter=dry_faces]").get_attribute("aria-invalid") == "true"
    found.page.locator("[data-filter=dry_faces]").fill("")
    found.page.locator("th[data-column=blocks] button").click()
    assert found.page.locator("th[data-column=blocks]").get_attribute("aria-sort") == "ascending"
    head = found.run("() => [...document.querySelectorAll('th')].findIndex(t => t.dataset.column === 'blocks')")
    blocks = [int(row[head]) for row in rows(found)]
    assert blocks == sorted(blocks)
    assert blocks[0] == int(done.results["blocks"].min())
    canvas = found.page.locator("canvas.scatter")
    canvas.scroll_into_view_if_needed()
    box = canvas.bounding_box()
    assert box is not None
    found.page.mouse.move(box["x"] + 70, box["y"] + 15)
    found.page.mouse.down()
    found.page.mouse.move(box["x"] + 0.55 * box["width"], box["y"] + 0.6 * box["height"], steps=4)
    found.page.mouse.up()
    chosen = found.text(".count")
    assert chosen != f"{len(done.results)} layouts"
    assert not chosen.startswith("0 ")
    found.page.locator(".reset").click()
    assert found.text(".count") == f"{len(done.results)} layouts"


def test_a_point_of_the_picture_is_a_layout(visit: Open, study: Path) -> None:
    found = visit(study / "report.html")
    canvas = found.page.locator("canvas.scatter")
    canvas.focus()
    before = found.page.url
    canvas.press("ArrowRight")
    canvas.press("ArrowRight")
    assert found.page.url != before
    assert "Chosen: rank" in str(canvas.get_attribute("aria-label"))


def test_keyboard_goes_along_the_table_and_compares(visit: Open, study: Path) -> None:
    found = visit(study / "report.html")
    scroll = found.page.locator(".scroll")
    scroll.focus()
    for key in ("ArrowDown", "ArrowDown", "c", "ArrowDown"):
        scroll.press(key)
    assert found.page.locator(".pane").count() == 2
    chosen = place(study, 3)
    assert (f"row={chosen[1:]}" if chosen.startswith("r") else f"rank={chosen}") in found.page.url
    assert f"compare={place(study, 2)}" in found.page.url
    differ = found.page.locator(".drawing").first.locator("line.differs").count()
    texts = [str(read_folder(study).results["labelling"].iloc[k]) for k in (3, 2)]
    assert differ == sum(a != b for a, b in zip(*texts, strict=True)) > 0
    looks_like(found, "compare", "#viewer")
    found.page.locator("#uncompare").click()
    assert found.page.locator(".pane").count() == 1


def test_a_layout_without_forces_names_the_command_that_solves_it(visit: Open, study: Path, tmp_path: Path) -> None:
    page = tmp_path / "few.html"
    page.write_text(page_of_study.study_page(read_folder(study), patience=0.0), encoding="utf-8")
    found = visit(f"{page.as_uri()}#row=2&view=forces")
    # by the number of the row: ranks may be shared
    assert "jld solve FOLDER --rank 3" in found.text(".lacking")
    assert found.page.locator("svg.figure").is_visible()


def test_a_search_in_which_nothing_stands_is_reported(visit: Open, tmp_path: Path) -> None:
    scene = {**small_scene(rows=["abc", "#.."]), "loads": {"live": [{"body": [1, 0]}]}}
    scene["materials"]["inner"] = {"tensile_strength": 1.0, "shear_strength": 1.0}
    explore(parse_scene(scene), tmp_path / "out", ExploreSettings(jobs=1, pictures=False))
    (tmp_path / "page.html").write_text(page_of_study.study_page(read_folder(tmp_path / "out")), encoding="utf-8")
    found = visit(tmp_path / "page.html")
    assert "4 of 4 layouts have no λ" in found.text("#picture")
    assert "proven: no layout stands" in found.text("#facts")
    assert found.page.locator("#scatter .legend li").count() == 0
    assert "no layouts" in found.page.locator("canvas.scatter").get_attribute("aria-label")


def test_downloads_are_the_scene_the_summary_and_the_table(visit: Open, study: Path) -> None:
    found = visit(study / "report.html")
    for name in ("scene.json", "summary.json", "layouts.csv"):
        with found.page.expect_download() as waiting:
            found.page.locator(f"[data-file='{name}']").click()
        content = Path(waiting.value.path()).read_text(encoding="utf-8")
        if name == "layouts.csv":
            assert len(content.splitlines()) == len(read_folder(study).results) + 1
        elif name == "scene.json":
            parse_scene(json.loads(content))
        else:
            assert json.loads(content)["best"] == read_folder(study).summary.best
    with found.page.expect_download() as waiting:
        found.page.locator(".save-picture").click()
    assert Path(waiting.value.path()).read_text(encoding="utf-8").startswith("<svg")


def test_a_hostile_name_is_shown_as_it_is(visit: Open, tmp_path: Path) -> None:
    scene = parse_scene(small_scene(name=HOSTILE))
    (tmp_path / "scene.html").write_text(page_of_study.scene_page(scene, build_assembly(scene)), encoding="utf-8")
    found = visit(tmp_path / "scene.html")
    assert found.text("h1") == " ".join(HOSTILE.split())
    assert found.page.title() == f"{HOSTILE} – jld"


def test_each_load_case_has_its_own_drawing(visit: Open, tmp_path: Path) -> None:
    scene = parse_scene(scene_of_cases())
    (tmp_path / "scene.html").write_text(page_of_study.scene_page(scene, build_assembly(scene)), encoding="utf-8")
    found = visit(tmp_path / "scene.html")
    assert "governed by right" in found.text(".pane .verdict")
    arrow = "() => document.querySelector('path.load').getAttribute('d')"
    first = found.run(arrow)
    found.page.get_by_label("load case").select_option("1")
    assert "Case <b>left</b>" in found.text(".pane .verdict")
    assert found.run(arrow) != first
    found.page.locator("[data-view=mechanism]").click()
    top = "document.querySelector('polygon[data-element=\\'0\\']').closest('g[transform]')"
    moved = f"() => {top}.getAttribute('transform')"
    to_the_left = float(found.run(moved).removeprefix("matrix(").split()[4])
    found.page.get_by_label("load case").select_option("0")
    to_the_right = float(found.run(moved).removeprefix("matrix(").split()[4])
    assert to_the_left < 0 < to_the_right


def test_unknown_data_are_reported(visit: Open, tmp_path: Path, study: Path) -> None:
    data = page_of_study.study_data(read_folder(study), patience=0.0)
    for change, words in (({"version": 99}, "version 99"), ({"look": {}}, "look lacks tints")):
        (tmp_path / "page.html").write_text(joined.page({**data, **change}), encoding="utf-8")
        found = visit(tmp_path / "page.html")
        assert found.run("() => document.body.dataset.ready") == "failed"
        assert words in found.text("#facts")


def test_blocks_and_tints_are_those_of_the_pictures(visit: Open, tmp_path: Path) -> None:
    """The page numbers and colours blocks by itself, for layouts by the thousand: by the rule of jld_core."""
    scene = parse_scene(small_scene(rows=["abcde", "fghij", "klmno", "##.##"]))
    assembly = build_assembly(scene)
    (tmp_path / "x.html").write_text("<!doctype html><title>x</title><link rel=icon href='data:,'>", encoding="utf-8")
    found = visit(tmp_path / "x.html", ready=False)
    rng = np.random.default_rng(3)
    labellings = rng.random((40, len(assembly.interfaces))) < 0.55
    data = page_of_study.page_data(
        kind="report", scene=scene, assembly=assembly, candidates=assembly.free_faces, facts={}
    )
    letters = ["".join("d" if dry else "i" for dry in row) for row in labellings]
    script = joined.linked("viewer.js", joined.PLANAR)
    got = found.run(
        f'([structure, rows, most]) => {{ {script}; const m = $modules["blocks.js"];'
        " return rows.map((row) => [m.blocksOf(structure, row), m.coloursOf(structure, row, most)]); }",
        [data["structure"], letters, len(look.TINTS)],
    )
    for labels, (blocks, colours) in zip(labellings, got, strict=True):
        assert blocks == blocks_of(assembly, labels).tolist()
        assert colours == quantities.block_colours(assembly, labels, len(look.TINTS)).tolist()


def test_page_in_the_dark_scheme_and_on_a_phone(visit: Open, study: Path) -> None:
    dark = visit(f"{(study / 'report.html').as_uri()}#view=forces", color_scheme="dark")
    assert dark.pixels()[:, :5].mean() < 60
    looks_like(dark, "dark", "#viewer")
    phone = visit(study / "report.html", size=(390, 800), is_mobile=True, has_touch=True)
    assert phone.run("() => document.documentElement.scrollWidth") <= 390
    # writing on a drawing that is made smaller stays as large as writing beside it
    assert phone.run("() => document.querySelector('.scalebar text').getBoundingClientRect().height") > 11
    looks_like(phone, "phone", "#viewer")


def test_a_spatial_layout_turns_explodes_and_is_cut(visit: Open, spatial: Path) -> None:
    found = visit(spatial / "report.html")
    canvas = found.page.locator("canvas.spatial")
    canvas.scroll_into_view_if_needed()

    def drawn() -> Any:
        return found.pixels("canvas.spatial")

    first = drawn()
    assert (np.ptp(first, axis=(0, 1)) > 100).all()  # not empty
    assert abs(first - first[0, 0]).max(axis=2).astype(bool).mean() > 0.05
    looks_like(found, "spatial", "#viewer")
    states = [first]
    canvas.focus()
    for act in (
        lambda: canvas.press("ArrowLeft"),
        lambda: found.page.get_by_label("explode").fill("1"),
        lambda: found.page.get_by_label("see through").fill("0.7"),
        lambda: (
            found.page.get_by_label("Cut across").select_option("0"),
            found.page.get_by_label("place of the cut").fill("0.4"),
        ),
        lambda: found.page.locator("[data-view=forces]").click(),
    ):
        act()
        states.append(drawn())
        assert abs(states[-1] - states[-2]).mean() > 0.2
    box = canvas.bounding_box()
    assert box is not None
    found.page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"])
    found.page.mouse.down()
    found.page.mouse.move(box["x"] + 0.8 * box["width"], box["y"] + 0.5 * box["height"], steps=3)
    found.page.mouse.up()
    assert abs(drawn() - states[-1]).mean() > 0.2
    found.page.get_by_role("button", name="reset view").click()
    found.page.get_by_label("Cut across").select_option("-1")
    found.page.get_by_label("explode").fill("0")
    for share in np.linspace(0.3, 0.7, 9):
        found.page.mouse.move(box["x"] + share * box["width"], box["y"] + 0.5 * box["height"])
        if found.page.locator(".stage .tip").is_visible():
            break
    assert found.text(".stage .tip").startswith(("face ", "slab", "a\n", "b\n", "c\n", "d\n"))


def test_a_notebook_shows_the_page_alive_in_a_cell(visit: Open, study: Path, tmp_path: Path) -> None:
    cell = show_page(read_folder(study), height=700)._repr_html_()
    (tmp_path / "notebook.html").write_text(f"<!doctype html><meta charset=utf-8>{cell}", encoding="utf-8")
    found = visit(tmp_path / "notebook.html", ready=False)
    frame = found.page.frame_locator("iframe")
    frame.locator("body[data-ready=yes]").wait_for()
    frame.locator("tr[data-row='2'] td").first.click()
    frame.locator("[data-view=mechanism]").click()
    assert frame.locator("[data-view=mechanism]").get_attribute("aria-selected") == "true"
    assert "Rank" in frame.locator(".pane h3").first.inner_text()


# The page of a notebook in a browser: static, with scripts switched off, and connected with the kernel.


MODEL = """<script type="module">
%s
const heard = [];
const model = {
  get: () => %s, on: (_, handler) => heard.push(handler), off() {},
  send: async (message) => {
    const answer = await window.kernel(message);
    heard.forEach((handler) => handler(answer));
  },
};
bridge.render({ model, el: document.body });
</script>"""
"""What anywidget does with the bridge: messages go to the kernel, and its answers come back."""


@pytest.fixture(scope="module")
def arch() -> NotebookPage:
    page: NotebookPage = load_scene(SCENES / "flat_beam_arch.json").show()
    return page


def saved(page: NotebookPage, path: Path, live: bool = False) -> Path:
    """A notebook with one output, as a file."""
    bridge = joined.asset("bridge.js").replace("export default", "const bridge =")
    model = MODEL % (bridge, json.dumps(page._identifier)) if live else ""
    path.write_text(f"<!doctype html><meta charset=utf-8><body data-ready>{page.html}{model}", encoding="utf-8")
    return path


def connected(visit: Open, page: NotebookPage, path: Path) -> tuple[Visit, Any, list[str]]:
    """A notebook whose kernel runs; its frame, and the kinds of the messages that the kernel got."""
    asked: list[str] = []

    def kernel(message: dict[str, Any]) -> dict[str, Any]:
        asked.append(message["kind"])
        return page.answer(message)

    found = visit("about:blank", ready=False)
    found.page.expose_function("kernel", kernel)
    found.page.goto(saved(page, path, live=True).as_uri())
    frame = found.page.frame_locator("iframe")
    frame.locator("body[data-ready=yes]").wait_for()
    return found, frame, asked


def test_a_saved_notebook_shows_the_page_and_says_why_sliders_rest(
    visit: Open, arch: NotebookPage, tmp_path: Path
) -> None:
    found = visit(saved(arch, tmp_path / "a.html"))
    frame = found.page.frame_locator("iframe")
    frame.locator("body[data-ready=yes]").wait_for()
    frame.locator("[data-view=mechanism]").click()
    assert not found.page.locator("[data-plain]").is_visible()
    sliders = frame.locator("#materials input[type=range]")
    assert sliders.count() == 3
    assert all(not sliders.nth(k).is_enabled() for k in range(3))
    assert frame.locator("#kernel").inner_text() == "The sliders need a running kernel: run this cell again."
    looks_like(found, "notebook")


def test_without_scripts_facts_and_picture_are_there(visit: Open, arch: NotebookPage, tmp_path: Path) -> None:
    found = visit(saved(arch, tmp_path / "a.html"), java_script_enabled=False)
    assert found.page.locator("[data-plain] img").is_visible()
    assert "11.8763940004" in found.text("[data-plain] table")
    assert "need a running kernel" in found.text("[data-plain]")


def test_sliders_are_solved_by_the_kernel(visit: Open, tmp_path: Path) -> None:
    scene = samples.arch(voussoirs=5)
    page = scene.show()
    found, frame, asked = connected(visit, page, tmp_path / "a.html")
    friction = frame.locator("input[data-material^=friction]")
    found.page.wait_for_function("window.frames[0].document.querySelector('#materials input:not(:disabled)')")
    before = frame.locator(".verdict").first.inner_text()
    friction.fill("0.3")
    frame.get_by_text("materials changed").wait_for()
    assembly = build_assembly(scene.model_copy(update={"materials": scene.materials.model_copy(update={
        "dry": scene.materials.dry.model_copy(update={"friction_coefficient": 0.3, "friction_angle": None}),
    })}))  # fmt: skip
    known = solve(assembly)
    frame.locator(".verdict", has_text=f"λ = {known.load_factor:.6g}").wait_for()
    frame.locator("[data-view=forces]").click()
    assert frame.locator(".lacking").first.inner_text() == ""
    frame.get_by_role("button", name="materials of the scene").click()
    frame.locator(".verdict", has_text=before).wait_for()
    assert asked == ["hello", "solve"]


def test_a_page_that_is_too_large_comes_from_the_kernel(visit: Open, tmp_path: Path) -> None:
    """Spatial pages need WebGL code of 150 kB: a saved notebook has the picture alone."""
    page = samples.vault("cross", voussoirs=4, courses=1).show()
    assert "<iframe" not in page.html
    found, frame, asked = connected(visit, page, tmp_path / "a.html")
    assert asked[:2] == ["hello", "page"]
    frame.locator("canvas.spatial").wait_for()
    assert not found.page.locator("[data-plain]").is_visible()
