"""Test claims on random cases and write the table: ``python -m benchmarks.claims [NAME ...] [options]``."""

from __future__ import annotations

import argparse
import csv
import json
import math
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from benchmarks.claims import CLAIMS, Tally, run
from benchmarks.common import RESULTS, table, write
from jld_core import __version__

VERSION: Final = __version__.rpartition(".")[0]  # version under development, which the rows of the table name
CSV: Final = RESULTS / "claims.csv"
FIELDS: Final = ("family", "version", "claim", "first_seed", "cases", "disagreements", "seconds", "notes")


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.claims", description=__doc__)
    parser.add_argument("families", nargs="*", help="names of claims; default: all")
    parser.add_argument("--cases", type=int, default=None, help="number of random cases; default: of a whole run")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=math.inf, help="time limit per family, s")
    parser.add_argument("--version-name", default=VERSION, help="name of the tested version in the table")
    parser.add_argument("--add", action="store_true", help="add to the cases in the table; name a new first seed")
    parser.add_argument("--failures", type=Path, default=None, help="file to which all disagreements are written")
    given = parser.parse_args(arguments)
    for name in given.families or CLAIMS:
        cases = CLAIMS[name].cases if given.cases is None else given.cases
        found = run(name, given.first_seed, cases, given.seconds)
        print(
            f"{name}: {found.cases} cases, {len(found.disagreements)} disagreements, {found.seconds:.0f} s", flush=True
        )
        for line in found.disagreements:
            print(f"  {line}", flush=True)
        if given.failures is not None:
            with given.failures.open("a", encoding="utf-8") as file:
                file.writelines(f"{name}: {line}\n" for line in found.disagreements)
        _record(name, given.version_name, given.first_seed, found, add=given.add)
    _write_table()


def _record(family: str, version: str, first_seed: int, found: Tally, *, add: bool) -> None:
    """Replace the row of one family and version in the record of runs, or `add` the cases to it."""
    before = [row for row in _rows() if (row["family"], row["version"]) == (family, version)]
    rows = [row for row in _rows() if row not in before]
    cases, wrong, seconds, notes = found.cases, len(found.disagreements), found.seconds, Counter(found.notes)
    for row in before if add else []:
        cases, wrong = cases + int(row["cases"]), wrong + int(row["disagreements"])
        seconds += float(row["seconds"])
        notes.update(json.loads(row["notes"]))
        first_seed = min(first_seed, int(row["first_seed"]))
    numbers = (str(first_seed), str(cases), str(wrong), f"{seconds:.0f}", json.dumps(dict(sorted(notes.items()))))
    rows.append(dict(zip(FIELDS, (family, version, found.claim, *numbers), strict=True)))
    order = list(CLAIMS)
    rows.sort(key=lambda row: (order.index(row["family"]) if row["family"] in order else len(order), row["version"]))
    with CSV.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, FIELDS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def _rows() -> list[dict[str, str]]:
    if not CSV.exists():
        return []
    with CSV.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def _write_table() -> None:
    rows = []
    for row in _rows():
        counts = ", ".join(f"{name}: {count}" for name, count in json.loads(row["notes"]).items())
        rows.append([*(row[key] for key in ("claim", "version", "cases", "disagreements", "seconds")), counts])
    words = "Every row: random cases of one claim, tested by `python -m benchmarks.claims`."
    head = "claim | version | cases | disagreements | s | counts"
    write("claims", "# Claims against independent routes", words, table(head, rows))


if __name__ == "__main__":
    main()
