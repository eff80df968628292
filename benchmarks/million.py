"""A million labellings of a wall of 88 faces, explored on two cores: time, memory, and size on disk.

`explore` as the command line calls it, driver random, budget of a million classes in blocks of 2 to 6 cells, two
jobs, in a process of its own: from the scene to the last picture. To read: a new process opens the record again and
makes the table and the front from it; nothing is solved. `python -m benchmarks.million COUNT` takes another number.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, Final

from benchmarks.common import about, table, write
from benchmarks.search_scenes import LARGE, built
from jld_core.lanes import described

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

    from jld_explore.study import ExploreSettings, Study

    whole = import_module("jld_explore.explore")
    parts: dict[str, float] = {}

    def watched(call: Any, name: str) -> Any:
        def run(*positional: Any, **keys: Any) -> Any:
            start = time.perf_counter()
            answer = call(*positional, **keys)
            parts[name] = parts.get(name, 0.0) + time.perf_counter() - start
            return answer

        return run

    settings = ExploreSettings(driver="random", budget=count, jobs=2)
    start, used = time.perf_counter(), time.process_time()
    with (
        patch.object(Study, "run", watched(Study.run, "search")),
        patch.object(whole, "write_tables", watched(whole.write_tables, "tables")),
        patch.object(whole, "write_pictures", watched(whole.write_pictures, "pictures")),
        patch.object(whole, "write_report", watched(whole.write_report, "page")),
    ):
        done = whole.explore(LARGE[SCENE](), folder, settings)
    spent = time.perf_counter() - start
    return {
        **parts,
        "all": spent,
        "processor": time.process_time() - used,
        "memory": memory(),
        "rows": len(done.results),
        "front": len(done.front),
        "statuses": done.summary["counts_by_status"],
    }


def again(folder: Path, header: dict[str, Any]) -> dict[str, Any]:
    """Open the record and make the table and the front."""
    from jld_explore.evaluation import Records
    from jld_explore.report import on_front, results_table

    assembly, space = built(LARGE[SCENE]())
    start = time.perf_counter()
    records = Records(folder, header, len(assembly.interfaces))
    opened = time.perf_counter() - start
    results = results_table(records, assembly, space, "random")
    made = time.perf_counter() - start - opened
    names, senses = zip(*space.search.front.axes, strict=True)
    ranked = results["load_factor"].where(results["status"] == "collapse").to_numpy(dtype=float)
    front = on_front(ranked, results[list(names)].to_numpy(dtype=float), *senses)
    records.close()
    every = time.perf_counter() - start
    return {"open": opened, "table": made, "front": every - opened - made, "memory": memory(), "rows": int(front.sum())}


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
    rows = [
        ["search, every row on disk", f"{one['search']:.1f} s"],
        ["tables: counts, ranking, front, CSV and Parquet", f"{one['tables']:.1f} s"],
        ["pictures and page", f"{one['pictures'] + one['page']:.1f} s"],
        ["**all, from the scene to the page**", f"**{one['all']:.1f} s** ({one['processor']:.0f} s of processor time)"],
        ["labellings a second while searching", f"{one['rows'] / one['search']:.0f}"],
        ["most memory", f"{one['memory']:.2f} GB"],
        ["record", f"{sizes['records.sqlite3']:.0f} MB"],
        ["results.csv, results.parquet", f"{sizes['results.csv']:.0f} MB, {sizes['results.parquet']:.0f} MB"],
        ["everything on disk", f"{sum(sizes.values()):.0f} MB"],
        ["to open the record again", f"{two['open']:.1f} s"],
        ["table from it, ranked, all counts", f"{two['table']:.1f} s"],
        ["front from that", f"{two['front']:.2f} s"],
    ]
    known = ", ".join(f"{number} {status}" for status, number in one["statuses"].items())
    note = f"{one['rows']} classes: {known}; {one['front']} on the front. {described().capitalize()}."
    sys.stderr.write(str((one, two)) + "\n")
    write("million", "\n\n".join(["# A million labellings", about(__doc__), table(["", ""], rows), note]))


if __name__ == "__main__":
    if sys.argv[1:2] == ["search"]:
        sys.stdout.write(json.dumps(search(Path(sys.argv[2]), int(sys.argv[3]))) + "\n")
    elif sys.argv[1:2] == ["again"]:
        sys.stdout.write(json.dumps(again(Path(sys.argv[2]), header_of(Path(sys.argv[2])))) + "\n")
    else:
        main()
