"""Make the gallery of the documentation: ten structures with drawing, scene, page and export, and three cut solids.

`python -m tools.gallery [FOLDER]` writes the files below FOLDER/gallery, and the page docs/gallery.md that links them.
FOLDER is docs/_gallery by default, which `make docs` copies beside its pages. Every scene is read from its drawing.
"""

from __future__ import annotations

import argparse
import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from studies.cut_solids import SOLIDS

from jld_core import Layout, Scene, build_assembly, load_scene, samples, solve
from jld_core.files import write_text
from jld_core.scene.reading import parse_scene
from jld_cut import Options, cut
from jld_cut.meshes import stl_bytes, surface_of
from jld_explore import explore
from jld_formats import ImportOptions, export, import_file
from jld_views.figures import png_of
from jld_views.page_of_study import scene_page, study_page

ROOT: Final = Path(__file__).parents[1]
FOLDER: Final = ROOT / "docs" / "_gallery"
"""Folder whose content the documentation has beside its pages."""

PAGE: Final = ROOT / "docs" / "gallery.md"
"""Page of the documentation that links the files."""


@dataclass(frozen=True)
class Entry:
    """One structure of the gallery.

    name: folder of its files. words: one sentence. make: its scene. drawing, blocks: formats of the drawing that is
    read and of the blocks that are written. budget: layouts that a search looks at; 0 shows the scene's own layout.
    """

    name: str
    words: str
    make: Callable[[], Scene]
    drawing: str
    blocks: str
    budget: int = 0


def _scene(name: str) -> Callable[[], Scene]:
    """Return a function that loads a scene of the repository."""
    return lambda: load_scene(ROOT / "scenes" / f"{name}.json")


ENTRIES: Final = (
    Entry("beam_arch", "A deep beam on two bearings, cut by a search.", _scene("flat_beam_arch"), "dxf", "dxf", 150),
    Entry("arch", "An arch loaded at a quarter of its span.", lambda: samples.arch(load="quarter"), "dxf", "svg"),
    Entry(
        "two_rings", "An arch of two rings in a running bond.",
        lambda: samples.arch(rings=2, thickness=0.4, bond="running", load="crown"), "svg", "dxf",
    ),
    Entry("wall", "A wall of courses pushed sideways.", samples.wall, "dxf", "step"),
    Entry("buttress", "A buttress under a thrust.", samples.buttress, "svg", "obj"),
    Entry("flat_arch", "A flat arch of wedges pushed sideways.", lambda: samples.flat_arch(load="push"), "dxf", "svg"),
    Entry("barrel_vault", "A barrel vault.", lambda: samples.vault("barrel", voussoirs=6, courses=3), "3dm", "gltf"),
    Entry("cross_vault", "A cross vault.", lambda: samples.vault("cross", voussoirs=4, courses=1), "ifc", "step"),
    Entry("dome", "A faceted dome.", samples.dome, "3dm", "ifc"),
    Entry(
        "cut_vault", "A small barrel vault, cut by a search.",
        lambda: samples.vault("barrel", voussoirs=4, courses=2), "3dm", "stl", 60,
    ),
)  # fmt: skip
"""The ten structures."""


CUTS: Final = {
    "bridge": "A footbridge for a printer of 1.7 m.",
    "arch": "An arch with a round hole.",
    "dome": "A dome with an oculus.",
}
"""Solids of `studies.cut_solids` that are cut to parts, and what they are."""

CUT_FILES: Final = {"solid": "solid.stl", "picture": "parts.png", "page": "parts.html", "parts": "parts.3mf"}


def write_cut(name: str, folder: Path, seconds: float = 60.0) -> None:
    """Cut a solid and write it with its parts, their picture and their page into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    case, solid = SOLIDS[name], folder / CUT_FILES["solid"]
    solid.write_bytes(stl_bytes(*surface_of(case.solid())))
    with TemporaryDirectory() as out:
        cut(solid, Options(case.box, case.loads, seconds=seconds, clearance=0.002, tenons=True, marks=True), out)
        for file in ("picture", "page", "parts"):
            shutil.copy(Path(out) / CUT_FILES[file], folder)


def files_of(entry: Entry) -> dict[str, str]:
    """Return the names of the files of a structure, by what they are."""
    return {
        "picture": "picture.png",
        "drawing": f"drawing.{entry.drawing}",
        "scene": "scene.json",
        "page": "page.html",
        "export": f"blocks.{entry.blocks}",
    }


def write_entry(entry: Entry, folder: Path) -> None:
    """Write the files of a structure into a folder; the scene is read from its drawing."""
    folder.mkdir(parents=True, exist_ok=True)
    place = {what: folder / name for what, name in files_of(entry).items()}
    given = entry.make()
    assembly = build_assembly(given)
    planar = assembly.dimension == 2
    export(Layout(given, assembly, assembly.labels), entry.drawing, place["drawing"], cells=not planar)
    place["drawing"].with_suffix(".blocks.csv").unlink(missing_ok=True)
    options = ImportOptions(like=given, thickness=given.plane_thickness if planar else None)
    scene = parse_scene({**import_file(place["drawing"], options).document, "name": given.name})
    write_text(place["scene"], json.dumps(scene.model_dump(mode="json", exclude_defaults=True), indent=1) + "\n")
    if entry.budget:
        with TemporaryDirectory() as out:
            study = explore(scene, Path(out) / "study", driver="genetic", budget=entry.budget, seed=1, pictures=False)
            write_text(place["page"], study_page(study))
            export(study.layout(1), entry.blocks, place["export"])
            result = study.result(1)
    else:
        found = build_assembly(scene)
        result = solve(found)
        write_text(place["page"], scene_page(scene, found))
        export(Layout(scene, found, found.labels, result), entry.blocks, place["export"])
    place["export"].with_suffix(".blocks.csv").unlink(missing_ok=True)
    place["picture"].write_bytes(png_of(result.drawn()))


def page_text() -> str:
    """Return the page of the documentation."""
    lines = [
        "# Gallery",
        "",
        "Ten structures, each as the drawing that is read, the scene, its interactive page, and blocks for another",
        "program.",
        "`python -m tools.gallery` makes them all; nothing is loaded from elsewhere.",
        "",
        "<!-- written by python -m tools.gallery -->",
    ]
    for entry in ENTRIES:
        files = {what: f"gallery/{entry.name}/{name}" for what, name in files_of(entry).items()}
        links = ", ".join(f'<a href="{files[what]}">{what}</a>' for what in ("drawing", "scene", "page", "export"))
        kinds = f"drawing {entry.drawing.upper()}, export {entry.blocks.upper()}"
        lines += [
            "", f"## {entry.name.replace('_', ' ').capitalize()}", "", f"{entry.words} ({kinds})", "", "```{raw} html",
            f'<p><a href="{files["page"]}"><img alt="{entry.words}" src="{files["picture"]}"></a></p>',
            f"<p>{links}</p>", "```",
        ]  # fmt: skip
    lines += [
        "",
        "## Cut solids",
        "",
        "Parts that fit a box, turned and put together on a page ([guide](guide/cutting.md)).",
    ]
    for name, words in CUTS.items():
        place = f"gallery/cut_{name}"
        links = ", ".join(f'<a href="{place}/{CUT_FILES[what]}">{what}</a>' for what in ("solid", "page", "parts"))
        shown = f'<a href="{place}/parts.html"><img alt="{words}" src="{place}/parts.png"></a>'
        lines += ["", words, "", "```{raw} html", f"<p>{shown}</p>", f"<p>{links}</p>", "```"]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Write all files, and the page that links them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, default=FOLDER)
    folder = parser.parse_args().folder
    for entry in ENTRIES:
        write_entry(entry, folder / "gallery" / entry.name)
    for name in CUTS:
        write_cut(name, folder / "gallery" / f"cut_{name}")
    write_text(PAGE, page_text())


if __name__ == "__main__":
    main()
