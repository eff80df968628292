"""All studies, one after the other, and a gallery page over their results."""

from __future__ import annotations

import argparse
import importlib
import re
import time
from pathlib import Path
from typing import Final

from studies.report import RESULTS

STUDIES: Final = (
    "walls_of_section_3_1",
    "t_block",
    "one_block_two_cubes",
    "leonardo_flat_arch",
    "leonardo_section_3_3",
    "what_is_1312",
    "article",
    "how_low_can_it_go",
    "semicircular_arch",
    "settlement",
    "few_shapes",
    "few_cuts",
    "left_out",
    "wall_with_opening",
    "corner",
    "virtual_experiment",
    "distinct_elements",
    "brittle_front",
    "whose_cracks",
    "cracking_units",
    "non_planar_faces",
    "two_loads",
    "strong_enough",
    "laid",
    "joints_that_move",
    "published_wall",
    "grooves_and_tables",
    "cut_solids",
)


def gallery(out: Path) -> str:
    """README.md of the results: every study's page that is there, one after the other."""
    pages = {path.stem: path.read_text("utf-8") for path in out.glob("*.md") if path.stem != "README"}
    names = [name for name in STUDIES if name in pages] + sorted(set(pages) - set(STUDIES))
    lines = [
        "# Studies",
        "",
        "Written by `make studies`; every study also runs alone, as `python -m studies NAME`. Each says where its "
        "numbers come from, what agrees with the source and what does not. Vector pictures (SVG) are written beside "
        "the PNGs and not kept in the repository.",
        "",
    ]
    titles = {name: re.sub(r"^# ", "", pages[name].splitlines()[0]) for name in names}
    lines += [f"{number}. [{titles[name]}](#{anchor(titles[name])})" for number, name in enumerate(names, 1)]
    for name in names:
        lines += ["", re.sub(r"(?m)^# ", "## ", pages[name]).rstrip()]
    return "\n".join(lines) + "\n"


def anchor(title: str) -> str:
    """The anchor under which a heading is found on a markdown page."""
    return re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")


def main() -> None:
    """Run all studies, or those named, and write the gallery."""
    parser = argparse.ArgumentParser(description="Run the studies and write their gallery page.")
    parser.add_argument("names", nargs="*", choices=[*STUDIES, []], help="studies to run, default all")
    parser.add_argument("--out", type=Path, default=RESULTS, help="folder to write into")
    parser.add_argument("--coarse", action="store_true", help="coarser, for tests")
    given = parser.parse_args()
    for name in given.names or STUDIES:
        start = time.perf_counter()
        table = importlib.import_module(f"studies.{name}").run(given.out, given.coarse)
        print(f"{name}: {len(table)} rows, {time.perf_counter() - start:.0f} s")
    (given.out / "README.md").write_text(gallery(given.out), "utf-8")


if __name__ == "__main__":
    main()
