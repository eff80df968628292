"""Runs of the study of distinct elements: layouts, laws and numerics, one row each, written as they are done.

``python -m studies.distinct_runs [--seconds S] [--out FILE]`` goes on where it was stopped.
"""

from __future__ import annotations

import argparse
import csv
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import pandas as pd

from jld_core import Assembly, Scene, build_assembly, load_scene, solve
from jld_core.arrays import Bits
from jld_core.fields import bounds_by_fields
from jld_core.limit import Status
from jld_experiment import Joints, Settings, Specimen, Standing, push, specimen_of
from jld_experiment.driving import scout
from jld_explore import ExploreSettings, explore
from studies.crack_models import HALVES, finer
from studies.report import RESULTS, SCENES
from studies.scenes import leonardo_flat_arch, wall_with_opening

FILE: Final = RESULTS / "distinct_elements.csv"
SEED: Final = 0
WEAKEST: Final = 60.0
"""Share of the largest λ below which layouts are left out, as its inverse; the flagship's are those above 0.2."""

Inner = Literal["plastic", "brittle"]
LAWS: Final[tuple[tuple[Inner, str], ...]] = (
    ("plastic", "friction"),
    ("plastic", "0"),
    ("brittle", "friction"),
    ("brittle", "0"),
)
"""Inner faces, and dilation of dry ones."""

DEFAULT: Final = "coarse"
COARSE: Final[dict[str, Any]] = {"periods": 50.0, "step": 0.7}
"""Settings of the full set: a third of the usual duration and a longer step, a fifth of the cost.

On 24 runs of the three scenes the usual settings changed the collapse load by 0.8 % at most; the page has the table.
"""
NUMERICS: Final[dict[str, dict[str, Any]]] = {
    DEFAULT: COARSE,
    "viscous damping": COARSE | {"damping_scheme": "viscous"},
    "combined damping": COARSE | {"damping_scheme": "combined"},
    "half the step": COARSE | {"step": 0.35},
    "3 points a face": COARSE | {"segments": 2},
    "9 points a face": COARSE | {"segments": 8},
    "a third of the rate": COARSE | {"periods": 150.0},
}
"""Settings by name; those but the first are run on every `SAMPLE`-th layout."""
SAMPLE: Final = 12
"""Every so many layouts are run with all numerics, by cells and by fields."""
FIELD_SECONDS: Final = 8.0
"""Time for the bounds by fields of one layout, s."""


@dataclass(frozen=True)
class Case:
    """One scene of the study and how many of its layouts are asked for."""

    name: str
    scene: Scene
    assembly: Assembly
    layouts: tuple[tuple[bool, ...], ...]


@dataclass(frozen=True)
class Row:
    """One result; NaN where it does not apply.

    kind: "experiment", "cells" or "fields". load_factor: collapse load of the experiment, or λ (the lower bound by
    fields). upper: upper bound by fields. energy_error: the largest of the push. The other energies are shares of the
    turnover at the end: see `EnergyBalance`.
    """

    scene: str
    layout: int
    labelling: str
    associative: float
    kind: str
    numerics: str
    inner: str
    dilation: str
    status: str
    load_factor: float
    upper: float = np.nan
    first_crack: float = np.nan
    broken: float = np.nan
    energy_error: float = np.nan
    energy_error_collapse: float = np.nan
    friction: float = np.nan
    flow: float = np.nan
    fracture: float = np.nan
    damping: float = np.nan
    seconds: float = np.nan


KEY: Final = ("scene", "layout", "kind", "numerics", "inner", "dilation")
"""Columns that identify a run."""


def cases(quick: bool = False) -> list[Case]:
    """The flagship, the flat arch of section 3.3 and a wall with an opening, each with its layouts."""
    wall = wall_with_opening(["aabbc", "a...c", "ddeff", "#####"])
    asked = (
        ("beam-arch", load_scene(SCENES / "flat_beam_arch.json"), "enumeration", None, 300),
        ("flat arch", leonardo_flat_arch(), "random", 400, 100),
        ("wall with an opening", wall, "random", 400, 100),
    )
    found = []
    for name, scene, driver, budget, count in asked:
        count = 2 if quick else count
        budget = 40 if quick else budget
        settings = ExploreSettings(driver=driver, budget=budget, seed=SEED, pictures=False, check_fields=0)
        table = explore(scene, None, settings).results
        table = table[table["status"] == "collapse"].sort_values("load_factor", ascending=False, kind="stable")
        table = table[table["load_factor"] > table["load_factor"].max() / WEAKEST]
        places = np.unique(np.round(np.linspace(0, len(table) - 1, count)).astype(int))
        # Layouts are run in an order without trend, so that a part of them is a fair sample.
        places = np.random.default_rng(SEED).permutation(places)
        labels = tuple(tuple(letter == "d" for letter in str(table["labelling"].iloc[k])) for k in places)
        found.append(Case(name, scene, build_assembly(scene), labels))
    return found


def asked(found: list[Case]) -> Iterator[tuple[Case, int, str, str, Inner, str]]:
    """Yield all runs: case, layout, kind, numerics, inner faces and dilation; scenes take turns."""
    shares = [(layout / len(case.layouts), place, layout) for place, case in enumerate(found)
              for layout in range(len(case.layouts))]  # fmt: skip
    for _, place, layout in sorted(shares):
        case = found[place]
        for inner, dilation in LAWS:
            yield case, layout, "experiment", DEFAULT, inner, dilation
        if layout % SAMPLE == 0:
            for name in NUMERICS:
                for inner, dilation in LAWS if name != DEFAULT else ():
                    yield case, layout, "experiment", name, inner, dilation
            for kind in ("cells", "fields"):
                yield case, layout, kind, "", "plastic", "friction"


def joints_of(inner: Inner, dilation: str) -> Joints:
    """Properties of faces by the names of `LAWS`."""
    return Joints(inner=inner, dilation="friction" if dilation == "friction" else 0.0)


def experiment(case: Case, layout: int, numerics: str, inner: Inner, dilation: str, halves: int = 0) -> Row:
    """Settle and push one layout at one rate; `halves`: how often the time step is halved."""
    labels = np.array(case.layouts[layout])
    row = started(case, layout, "experiment", numerics, inner, dilation)
    start = time.process_time()
    settings = Settings(**NUMERICS[numerics])
    settings = replace(settings, step=settings.step / 2**halves)
    specimen = specimen_of(case.assembly, labels, joints_of(inner, dilation), settings)
    settled, standing = specimen.settle()
    if standing is not Standing.RESTS:
        error = specimen.energy(settled).error
        return replace(row, status=str(standing), load_factor=0.0, energy_error=error, seconds=_since(start))
    scale = scout(specimen, settled)
    if not 0.0 < scale < np.inf:
        return replace(row, status="locked" if scale else "no strength", seconds=_since(start))
    found = push(specimen, settled, scale, specimen.settings.periods)
    end, best = specimen.energy(found.at_end), specimen.energy(found.at_collapse)
    parts = {name: getattr(end, name) / end.turnover for name in ("friction", "flow", "fracture", "damping")}
    return replace(
        row,
        status="locked" if found.rising else "collapse",
        load_factor=float(found.load_factor[found.collapse]),
        first_crack=_first_crack(specimen, found.broken, found.load_factor, int(settled.broken.sum())),
        broken=float(found.at_end.broken.mean()),
        energy_error=float(found.energy_error.max()),
        energy_error_collapse=best.error,
        seconds=_since(start),
        **parts,
    )


def _since(start: float) -> float:
    """Processor time since a start, s."""
    return time.process_time() - start


def _first_crack(specimen: Specimen, broken: Any, load_factor: Any, before: int) -> float:
    """λ of the record before the first break of the push, NaN without one."""
    first = np.flatnonzero(broken > before)
    return float(load_factor[max(int(first[0]) - 1, 0)]) if first.size and specimen.bench.brittle.any() else np.nan


def started(case: Case, layout: int, kind: str, numerics: str, inner: str, dilation: str) -> Row:
    """Return a row that names its run and has λ by faces."""
    labels = np.array(case.layouts[layout])
    letters = "".join("d" if dry else "i" for dry in labels)
    exact = solve(case.assembly, labels).load_factor
    return Row(case.name, layout, letters, exact, kind, numerics, inner, dilation, "", np.nan)


def limit_analysis(case: Case, layout: int, kind: str) -> Row:
    """λ of one layout whose blocks crack by cells of half the size, or anywhere by fields."""
    labels: Bits = np.array(case.layouts[layout])
    row, start = started(case, layout, kind, "", "plastic", "friction"), time.process_time()
    if kind == "cells":
        cells = finer(case.scene, case.assembly, HALVES)
        found = solve(cells.fine, cells.labels(labels))
        value = found.load_factor if found.status is Status.COLLAPSE else 0.0
        return replace(row, status=str(found.status), load_factor=value, upper=value, seconds=_since(start))
    bounds = bounds_by_fields(case.assembly, labels, gap=0.05, seconds=FIELD_SECONDS)
    width = "narrow" if bounds.upper - bounds.lower <= 0.1 * abs(bounds.upper) else "wide"
    return replace(row, status=width, load_factor=bounds.lower, upper=bounds.upper, seconds=_since(start))


def done(path: Path) -> set[tuple[str, ...]]:
    """Keys of the runs that a file holds."""
    if not path.exists():
        return set()
    table = pd.read_csv(path, dtype=str, keep_default_na=False)
    return set(table[list(KEY)].itertuples(index=False, name=None))


def run_all(path: Path, found: list[Case], seconds: float | None = None) -> int:
    """Make all runs that a file lacks and add each as soon as it is done; return how many were made.

    seconds: time after which no run is begun.
    """
    start, made, held = time.monotonic(), 0, done(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    fresh = not path.exists()
    with path.open("a", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, [field.name for field in fields(Row)], lineterminator="\n")
        if fresh:
            writer.writeheader()
        for case, layout, kind, numerics, inner, dilation in asked(found):
            if (case.name, str(layout), kind, numerics, inner, dilation) in held:
                continue
            if seconds is not None and time.monotonic() - start > seconds:
                break
            row = (
                experiment(case, layout, numerics, inner, dilation)
                if kind == "experiment"
                else limit_analysis(case, layout, kind)
            )
            # Ten digits: what differs beyond is no result.
            writer.writerow({k: f"{v:.10g}" if isinstance(v, float) else v for k, v in asdict(row).items()})
            file.flush()
            made += 1
    return made


def main() -> None:
    """Run what is missing."""
    parser = argparse.ArgumentParser(prog="python -m studies.distinct_runs", description=__doc__)
    parser.add_argument("--seconds", type=float, help="time after which no run is begun; default no limit")
    parser.add_argument("--out", type=Path, default=FILE, help="table to add to")
    given = parser.parse_args()
    found = cases()
    made = run_all(given.out, found, given.seconds)
    print(f"{made} runs made; {len(done(given.out))} of {sum(1 for _ in asked(found))} are there")


if __name__ == "__main__":
    main()
