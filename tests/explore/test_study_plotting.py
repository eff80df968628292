"""Pictures of a study hold what its tables hold."""

from __future__ import annotations

import html
import re
import subprocess
import sys
from pathlib import Path
from urllib.parse import unquote, urlsplit

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from tools.gallery import CUT_FILES, CUTS, ENTRIES, PAGE, files_of, page_text, write_cut, write_entry

from command import ROOT, Command
from jld_core import Assembly, LimitAnalysis, Status, blocks_of, build_assembly, load_scene, solve
from jld_views import figures
from jld_views import pictures as pictures_of_views

SCENE = Path(__file__).parents[2] / "scenes" / "flat_beam_arch.json"


@pytest.fixture(scope="module")
def assembly() -> Assembly:
    return build_assembly(load_scene(SCENE))


def random_blocks(assembly: Assembly, rng: np.random.Generator) -> np.ndarray:
    """Labels of a segmentation: faces between free elements are glued at random, then slits are closed."""
    free = assembly.free_faces
    labels = np.where(free, rng.random(len(free)) < rng.uniform(0.2, 0.9), True)
    block = blocks_of(assembly, labels)
    apart = block[assembly.interfaces.a] != block[assembly.interfaces.b]
    return np.where(free, apart, True)


@pytest.fixture(scope="module")
def results(assembly: Assembly) -> pd.DataFrame:
    """Rows of results.csv for some sixty labellings, really solved."""
    rng, analysis = np.random.default_rng(5), LimitAnalysis(assembly)
    rows = {}
    for _ in range(60):
        labels = random_blocks(assembly, rng)
        proof = analysis.prove(labels)
        load = analysis.template.scaling.load
        low, high = proof.low * load, proof.high * load
        dry = labels & assembly.free_faces
        text = "".join("d" if value else "i" for value in labels)
        rows[text] = {
            "labelling": text,
            "multiplicity": 2,
            "load_factor": 0.5 * (low + high) if proof.status is Status.COLLAPSE else np.nan,
            "bracket_lo": low,
            "bracket_hi": high,
            "status": str(proof.status),
            "dry_faces": int(dry.sum()),
            "dry_length": float(assembly.interfaces.l1[dry].sum()),
            "blocks": len(np.unique(blocks_of(assembly, labels)[assembly.elements.free])),
        }
    return pd.DataFrame(list(rows.values())).sort_values("load_factor", ascending=False, ignore_index=True)


def front_of(results: pd.DataFrame, count: str, sense: str) -> pd.DataFrame:
    """The rows that no other one beats, by brute force."""
    known = results[results["status"] == "collapse"]
    value = known[count].to_numpy(dtype=float) * (1.0 if sense == "max" else -1.0)
    load = known["load_factor"].to_numpy(dtype=float)
    kept = [
        not np.any((value >= v) & (load >= p) & ((value > v) | (load > p))) for v, p in zip(value, load, strict=True)
    ]
    return known[np.array(kept, dtype=bool)]


def numbers(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.texts if text.get_text().isdigit()]


@pytest.mark.parametrize(("count", "sense"), [("dry_faces", "max"), ("dry_length", "max"), ("blocks", "min")])
def test_front_and_all_rows_are_on_the_axes(assembly: Assembly, results: pd.DataFrame, count: str, sense: str) -> None:
    front = front_of(results, count, sense)
    figure = pictures_of_views.plot_pareto(results, front, assembly, count=count, sense=sense)
    ax = figure.axes[0]
    dots, steps, marks = ax.lines
    known = results[results["status"] == "collapse"]
    assert len(np.asarray(dots.get_xdata())) == len(known) > 10
    assert steps.get_drawstyle() == ("steps-pre" if sense == "max" else "steps-post")
    expected = front.sort_values(count)[[count, "load_factor"]].to_numpy(dtype=float)
    assert np.asarray(marks.get_xydata()) == pytest.approx(expected)
    assert not dots.get_rasterized()
    assert len(figure.axes) - 1 == len(numbers(figure)) >= 2
    assert f"{len(known)} collapse" in figure.texts[-1].get_text()
    assert f"{int((results['status'] == 'unstable').sum())} unstable" in figure.texts[-1].get_text()


def test_circles_and_thumbnails_carry_the_same_numbers_and_keep_apart(
    assembly: Assembly, results: pd.DataFrame, tmp_path: Path
) -> None:
    figure = pictures_of_views.plot_pareto(results, front_of(results, "dry_faces", "max"), assembly, layouts=4)
    figures.save_figure(figure, tmp_path / "pareto.png")
    circles = figure.axes[0].texts
    assert [text.get_text() for text in circles] == numbers(figure)
    assert 2 <= len(circles) <= 4
    boxes = [text.get_window_extent() for text in circles]
    assert not any(a.overlaps(b) for k, a in enumerate(boxes) for b in boxes[:k])
    places = [ax.get_window_extent() for ax in figure.axes]
    assert not any(a.overlaps(b) for k, a in enumerate(places) for b in places[:k])


def test_units_stand_on_the_axes(assembly: Assembly, results: pd.DataFrame) -> None:
    front = front_of(results, "dry_length", "max")
    ax = pictures_of_views.plot_pareto(results, front, assembly, count="dry_length").axes[0]
    assert ax.get_xlabel() == "dry length [m]"
    assert "λ" in ax.get_ylabel()


def test_many_rows_are_stored_as_an_image(assembly: Assembly, results: pd.DataFrame) -> None:
    known = results[results["status"] == "collapse"]
    many = pd.concat([known] * (5001 // len(known) + 1), ignore_index=True)
    figure = pictures_of_views.plot_pareto(many, front_of(results, "dry_faces", "max"), assembly)
    assert figure.axes[0].lines[0].get_rasterized()


def test_tables_without_collapse_or_front(assembly: Assembly, results: pd.DataFrame, tmp_path: Path) -> None:
    nothing = results[results["status"] == "unstable"]
    for number, table in enumerate((nothing, results.iloc[:0])):
        figure = pictures_of_views.plot_pareto(table, table.iloc[:0], assembly)
        assert len(figure.axes) == 1
        assert "no labelling" in figure.axes[0].texts[0].get_text()
        figures.save_figure(figure, tmp_path / f"{number}.png")
        assert "no labelling" in pictures_of_views.plot_distribution(table).axes[0].texts[0].get_text()
        assert "no labelling" in pictures_of_views.plot_dry_frequency(table, assembly).axes[0].texts[0].get_text()
    figure = pictures_of_views.plot_pareto(results, results.iloc[:0], assembly)
    assert len(figure.axes) == 1
    figures.save_figure(figure, tmp_path / "no_front.png")


def test_one_row_is_a_front(assembly: Assembly, results: pd.DataFrame, tmp_path: Path) -> None:
    one = results.head(1)
    figure = pictures_of_views.plot_pareto(one, one, assembly)
    figures.save_figure(figure, tmp_path / "one.png")
    assert numbers(figure) == ["1"]


def test_wrong_arguments_are_refused(assembly: Assembly, results: pd.DataFrame) -> None:
    with pytest.raises(ValueError, match="no such front"):
        pictures_of_views.plot_pareto(results, results, assembly, count="weight")
    with pytest.raises(ValueError, match="24 letters"):
        pictures_of_views.labels_of("0101", assembly)
    with pytest.raises(ValueError, match="24 letters"):
        pictures_of_views.labels_of(101, assembly)


def test_distribution_has_a_box_for_each_number_of_dry_faces(results: pd.DataFrame) -> None:
    ax = pictures_of_views.plot_distribution(results).axes[0]
    known = results[results["status"] == "collapse"]
    kinds, tally = np.unique(known["dry_faces"].to_numpy(dtype=int), return_counts=True)
    held = {round(text.get_position()[0]): int(text.get_text()) for text in ax.texts}
    assert held == dict(zip(kinds.tolist(), tally.tolist(), strict=True))


def test_dry_frequency_counts_the_best_rows(assembly: Assembly, results: pd.DataFrame) -> None:
    figure = pictures_of_views.plot_dry_frequency(results, assembly, top=1)
    best = pictures_of_views.labels_of(results["labelling"].iloc[0], assembly)
    lines = {item.get_label(): item for item in figure.axes[0].collections}
    assert len(lines["dry"].get_segments()) == int(best.sum())
    assert len(lines["inner"].get_segments()) == int((~best).sum())
    assert "the labelling" in figure.texts[0].get_text()
    wide = pictures_of_views.plot_dry_frequency(results, assembly, top=20)
    known = results[results["status"] == "collapse"].head(20)
    share = np.mean([pictures_of_views.labels_of(text, assembly) for text in known["labelling"]], axis=0)
    shown = {item.get_label(): item for item in wide.axes[0].collections}["dry"]
    widths = np.asarray(shown.get_linewidth())
    between = assembly.free_faces[share > 0.0]
    order = np.argsort(share[share > 0.0][between], kind="stable")
    assert np.all(np.diff(widths[between][order]) >= -1e-9)


def test_convergence_shows_the_best_so_far_over_solves_and_seconds() -> None:
    blank = float("nan")
    first = pd.DataFrame({"solves": [1, 2, 3, 4], "seconds": [0.1, 0.2, 0.3, 0.4], "best": [blank, 2.0, 1.0, 5.0]})
    none = pd.DataFrame({"solves": [1], "seconds": [0.1], "best": [blank]})
    figure = pictures_of_views.plot_convergence({"random": first, "nothing": none})
    solves, seconds = figure.axes
    assert len(solves.lines) == len(seconds.lines) == 1
    assert np.asarray(solves.lines[0].get_xydata()).tolist() == [[2.0, 2.0], [3.0, 2.0], [4.0, 5.0]]
    assert np.asarray(seconds.lines[0].get_xdata()).tolist() == [0.2, 0.3, 0.4]
    assert seconds.get_xlabel() == "time [s]"
    assert "no finite" in pictures_of_views.plot_convergence({"nothing": none}).axes[0].texts[0].get_text()
    assert pictures_of_views.plot_convergence({}).axes


def test_the_picture_of_the_best_layout_has_all_parts(assembly: Assembly) -> None:
    figure = pictures_of_views.plot_best(LimitAnalysis(assembly).solve())
    assert len(figure.axes) == 3


@pytest.mark.long
def test_pictures_are_drawn_again_as_vectors(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, jld: Command) -> None:
    """All of them, that of the convergence too, which is read from the folder of the study."""
    folder = tmp_path / "search"
    jld("explore", SCENE, "--out", folder, "--driver", "random", "--budget", "8", "--pictures")
    raster = {path.stem for path in folder.glob("*.png")}
    out = tmp_path / "vectors"
    assert jld("plot", folder, "--out", out, "--format", "svg").code == 0
    assert {path.stem for path in out.iterdir()} == raster
    assert all(path.read_bytes().startswith(b"<?xml") for path in out.iterdir())
    single = tmp_path / "scene.json"
    single.write_bytes(SCENE.read_bytes())
    monkeypatch.chdir(tmp_path)  # a scene is drawn where one stands
    assert jld("plot", single, "--format", "pdf").code == 0
    assert single.with_suffix(".pdf").read_bytes().startswith(b"%PDF")


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("driver", "options", "expected"),
    [
        ("enumeration", {}, {"proven"}),
        ("exact", {"aim": "front"}, {"proven"}),
        ("exact", {"aim": "best"}, {"found", "visited"}),
        ("genetic", {"aim": "front"}, {"found"}),
        ("genetic", {"aim": "best"}, {"found", "visited"}),
        ("random", {}, {"found", "visited"}),
    ],
)
def test_every_point_of_a_front_has_its_status(
    driver: str, options: dict[str, str], expected: set[str], tmp_path: Path
) -> None:
    """The exact driver with --aim best printed as a front what it happened to visit, under the word proven."""
    from cases import grid_document
    from jld_core import parse_scene
    from jld_explore import ExploreSettings, explore, read_folder

    scene = parse_scene(grid_document(["aaa", "aaa", "###"], block_cells=[1, 4]))
    few = {"genetic": 15, "random": 15}.get(driver)
    settings = ExploreSettings(driver=driver, options=options, pictures=False, jobs=1, budget=few)
    done = explore(scene, tmp_path / "out", settings)
    written = pd.read_csv(tmp_path / "out" / "pareto.csv")
    # a bound met proves the strongest of its count, and not that none with a better count carries as much
    assert set(written["evidence"]) <= expected
    strongest = written.sort_values("load_factor").iloc[-1]["evidence"]
    assert strongest == ("proven" if "proven" in expected else "found")
    known = {row["count"]: row for row in done.summary.front}
    assert set(written["dry_faces"]) <= set(known)
    assert all(row["proven"] == (row["evidence"] == "proven") for row in known.values())
    assert read_folder(tmp_path / "out").front["evidence"].tolist() == written["evidence"].tolist()


def test_a_search_draws_front_and_best_and_the_others_when_asked(tmp_path: Path, jld: Command) -> None:
    from cases import grid_document
    from jld_core import parse_scene
    from jld_explore import explore

    scene = parse_scene(grid_document(["aa", "##"]))
    shown = {"best.png", "pareto.png"}
    others = {"distribution.png", "dry_frequency.png", "convergence.png"}
    for name, pictures in (("few", True), ("every", "all"), ("none", False)):
        explore(scene, tmp_path / name, jobs=1, pictures=pictures)
    drawn = {name: {path.name for path in (tmp_path / name).glob("*.png")} for name in ("few", "every", "none")}
    assert drawn == {"few": shown, "every": shown | others, "none": set()}
    jld("plot", tmp_path / "few")
    assert {path.name for path in (tmp_path / "few").glob("*.png")} == shown | others


# The gallery of the documentation: scenes come from their drawings, and links of the website lead somewhere.


SMALL = 1_300_000  # bytes of the files of one structure; pages in space hold 0.6 MB of drawing code


def test_the_page_is_current_and_names_ten_structures() -> None:
    assert PAGE.read_text("utf-8") == page_text()
    assert len({entry.name for entry in ENTRIES}) == 10
    assert sum(entry.drawing in ("3dm", "ifc") for entry in ENTRIES) >= 3


def made(name: str, folder: Path) -> None:
    """Write the files of one structure; λ of the scene read from its drawing is that of the given one."""
    (entry,) = (one for one in ENTRIES if one.name == name)
    place = folder / "gallery" / name
    write_entry(entry, place)
    assert {path.name for path in place.iterdir()} == set(files_of(entry).values())
    assert sum(path.stat().st_size for path in place.iterdir()) < SMALL
    given, read = solve(entry.make()), solve(load_scene(place / "scene.json"))
    assert read.load_factor == pytest.approx(given.load_factor, rel=1e-6)
    assert read.bracket[0] <= given.bracket[1] * (1.0 + 1e-7)
    assert given.bracket[0] <= read.bracket[1] * (1.0 + 1e-7)


def test_a_structure_of_the_gallery(tmp_path: Path) -> None:
    made("flat_arch", tmp_path)
    linked = re.findall(r'(?:href|src)="(gallery/flat_arch/[^"]+)"', page_text())
    assert len(set(linked)) == 5
    assert all((tmp_path / link).stat().st_size > 500 for link in linked)
    for name in CUTS:
        assert set(re.findall(rf'(?:href|src)="gallery/cut_{name}/([^"]+)"', page_text())) == set(CUT_FILES.values())


def wrong_links(site: Path) -> list[str]:
    """Links of a website that lead nowhere, and what its pages would load from elsewhere."""
    wrong = []
    ids: dict[Path, set[str]] = {}
    pages = sorted(site.rglob("*.html"))
    for path in pages:
        text = re.sub(r"<(script|style)\b[^>]*>.*?</\1>", "", path.read_text("utf-8"), flags=re.S)
        ids[path.resolve()] = set(map(html.unescape, re.findall(r'\b(?:id|name)="([^"]+)"', text)))
    for path in pages:
        text = re.sub(r"(<script\b[^>]*>).*?</script>", r"\1", path.read_text("utf-8"), flags=re.S)
        for tag, kind, link in re.findall(r'<(\w+)\b[^>]*?\b(href|src)="([^"]*)"', text):
            parts = urlsplit(html.unescape(link))
            if parts.scheme in ("http", "https") or parts.netloc:
                if tag != "a":
                    wrong.append(f"{path.name}: {tag} {kind} loads {link}")
                continue
            if parts.scheme:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path.resolve()
            if not target.exists():
                wrong.append(f"{path.name}: {link} does not exist")
            elif parts.fragment and target in ids and unquote(parts.fragment) not in ids[target] | {""}:
                wrong.append(f"{path.name}: {link} has no such place")
    return wrong


def test_wrong_links_are_found(tmp_path: Path) -> None:
    (tmp_path / "a.html").write_text(
        '<a href="b.html#here">1</a><a href="b.html#there">2</a><a href="c.html">3</a><img src="https://x.org/d.png">'
        '<a href="https://x.org">4</a>'
    )
    (tmp_path / "b.html").write_text('<p id="here">')
    assert wrong_links(tmp_path) == [
        "a.html: b.html#there has no such place",
        "a.html: c.html does not exist",
        "a.html: img src loads https://x.org/d.png",
    ]


@pytest.mark.long
def test_the_website_is_whole(tmp_path: Path) -> None:
    """As `make docs` builds it: all ten structures, no warning, no link that leads nowhere, nothing from elsewhere."""
    for entry in ENTRIES:
        made(entry.name, tmp_path / "files")
    for name in CUTS:
        write_cut(name, tmp_path / "files" / "gallery" / f"cut_{name}", seconds=10.0)
    site = tmp_path / "site"
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html"]
    extra = f"html_extra_path=scene.schema.json,{tmp_path / 'files'}"
    done = subprocess.run(
        [*command, "-D", extra, "-d", str(tmp_path / "trees"), str(ROOT / "docs"), str(site)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert wrong_links(site) == []
