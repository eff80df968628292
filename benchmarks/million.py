"""A million labellings of a wall of 88 faces, explored on two cores: time, memory, and size on disk.

`explore` as the command line calls it, driver random, budget of a million classes in blocks of 2 to 6 cells, two
jobs, in a process of its own: from the scene to the last picture. To read: a new process opens the record again and
makes the table and the front from it; nothing is solved. On two free cores: what the processor's time makes of it, half
of it or that of the first thread where it is more, without waits for the disk; by the clock of this run, which shared
the machine, stands beside it. `python -m benchmarks.million COUNT` takes another number. Version 0.2 made the tables in
25.5 s, with a CSV file of 280 MB, and needed 1.50 GB on the same machine when it was free.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from benchmarks.common import about, table, write
from benchmarks.search_scenes import LARGE, built
from jld_core.batch.library import described

COUNT: Final = 1_000_000
SCENE: Final = "planar 88 faces"


def memory() -> float:
    """Most memory that this process has had, GB."""
    for line in Path("/proc/self/status").read_text(encoding="utf-8").splitlines():
        if line.startswith("VmHWM"):
            return int(line.split()[1]) / 1e6
    return float("nan")


def search(folder: Path, count: int) -> dict[str, Any]:
    """Explore, and say what each part took."""
    from importlib import import_module
    from unittest.mock import patch

    from jld_explore.settings import ExploreSettings
    from jld_explore.study import Study

    whole = import_module("jld_explore.explore")
    parts: dict[str, Part] = {}

    def watched(call: Any, name: str) -> Any:
        def run(*positional: Any, **keys: Any) -> Any:
            with part(parts, name):
                return call(*positional, **keys)

        return run

    settings = ExploreSettings(driver="random", budget=count, jobs=2)
    with (
        part(parts, "all"),
        patch.object(Study, "run", watched(Study.run, "search")),
        patch.object(whole, "write_tables", watched(whole.write_tables, "tables")),
        patch.object(whole, "write_pictures", watched(whole.write_pictures, "pictures")),
        patch.object(whole, "write_report", watched(whole.write_report, "page")),
    ):
        done = whole.explore(LARGE[SCENE](), folder, settings)
    return {
        **parts,
        "memory": memory(),
        "rows": len(done.results),
        "front": len(done.front),
        "statuses": done.summary.counts_by_status,
    }


Part = tuple[float, float, float]
"""Seconds by the clock, of the processor, and on two free cores."""


@contextmanager
def part(parts: dict[str, Part], name: str) -> Iterator[None]:
    """Time what runs within."""
    clock, processor, first = time.perf_counter(), time.process_time(), time.thread_time()
    yield
    clock, processor, first = time.perf_counter() - clock, time.process_time() - processor, time.thread_time() - first
    parts[name] = clock, processor, max(first, 0.5 * processor)


def again(folder: Path, header: dict[str, Any]) -> dict[str, Any]:
    """Open the record and make the table and the front."""
    from jld_explore.evaluation import Records
    from jld_explore.report.front import on_front
    from jld_explore.report.tables import results_table

    assembly, space = built(LARGE[SCENE]())
    parts: dict[str, Part] = {}
    with part(parts, "open"):
        records = Records(folder, header, len(assembly.interfaces))
    with part(parts, "table"):
        results = results_table(records, assembly, space, "random")
    with part(parts, "front"):
        names, senses = zip(*space.search.front.axes, strict=True)
        ranked = results["load_factor"].where(results["status"] == "collapse").to_numpy(dtype=float)
        front = on_front(ranked, results[list(names)].to_numpy(dtype=float), *senses)
    records.close()
    return {**parts, "memory": memory(), "rows": int(front.sum())}


def header_of(folder: Path) -> dict[str, Any]:
    """What the record was made with."""
    import sqlite3

    with sqlite3.connect(folder / "records.sqlite3") as file:
        found = {key: json.loads(value) for key, value in file.execute("SELECT key, value FROM meta")}
    return {key: value for key, value in found.items() if key not in ("jld", "format", "faces", "conflicts of")}


def elsewhere(*arguments: str) -> dict[str, Any]:
    """What this module says in a process of its own."""
    command = [sys.executable, "-m", "benchmarks.million", *arguments]
    text = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
    found: dict[str, Any] = json.loads(text.strip().splitlines()[-1])
    return found


def main() -> None:
    """Explore, read again, and write benchmarks/results/million.md."""
    count = int(sys.argv[1]) if sys.argv[1:] else COUNT
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "study"
        one = elsewhere("search", str(folder), str(count))
        two = elsewhere("again", str(folder))
        sizes = {path.name: path.stat().st_size / 1e6 for path in folder.iterdir()}
    found = one | {name: two[name] for name in ("open", "table", "front")}
    found["pictures"] = [a + b for a, b in zip(one["pictures"], one["page"], strict=True)]
    # only the search has two threads
    found["all"][2] = one["all"][1] - one["search"][1] + one["search"][2]
    words = {
        "search": "search, every row on disk",
        "tables": "tables: counts, ranking, front, Parquet",
        "pictures": "pictures and page",
        "all": "**all, from the scene to the page**",
        "open": "to open the record again",
        "table": "table from it, ranked, all counts",
        "front": "front from that",
    }
    rows = [
        [text, *(f"{found[name][k]:.2f}" if name == "front" else f"{found[name][k]:.1f}" for k in (2, 1, 0))]
        for name, text in words.items()
    ]
    more = [
        ["labellings a second while searching", f"{one['rows'] / one['search'][2]:.0f} on two free cores"],
        ["most memory", f"{one['memory']:.2f} GB"],
        ["record", f"{sizes['records.sqlite3']:.0f} MB"],
        ["results.parquet", f"{sizes['results.parquet']:.0f} MB"],
        ["everything on disk", f"{sum(sizes.values()):.0f} MB"],
    ]
    known = ", ".join(f"{number} {status}" for status, number in one["statuses"].items())
    note = f"{one['rows']} classes: {known}; {one['front']} on the front. {described().capitalize()}."
    head = ["seconds", "on two free cores", "of the processor", "by the clock"]
    load = f"Load of the machine at the end: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores."
    text = ["# A million labellings", about(__doc__), table(head, rows), table(["", ""], more), f"{note} {load}"]
    write("million", "\n\n".join(text))


if __name__ == "__main__":
    if sys.argv[1:2] == ["search"]:
        sys.stdout.write(json.dumps(search(Path(sys.argv[2]), int(sys.argv[3]))) + "\n")
    elif sys.argv[1:2] == ["again"]:
        sys.stdout.write(json.dumps(again(Path(sys.argv[2]), header_of(Path(sys.argv[2])))) + "\n")
    else:
        main()
