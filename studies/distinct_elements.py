"""Distinct elements with inner and dry faces: what brittle cracking and missing dilation leave of λ, and why.

``python -m studies.distinct_elements [--seconds S] [--out FILE]`` makes the runs, one row each, written as they are
done, and goes on where it was stopped; the study's page shows those that are there. Source: Iannuzzo et al. 2024,
section 5, which names this study as future work.
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
from matplotlib.figure import Figure

from jld_core import Assembly, Scene, build_assembly, load_scene, solve
from jld_core.arrays import Bits, Floats
from jld_core.fields import bounds_by_fields
from jld_core.limit.options import Status
from jld_experiment import Joints, Push, Settings, Specimen, Standing, push, specimen_of
from jld_experiment.experiment import scout
from jld_explore import ExploreSettings, explore
from studies.crack_models import HALVES, finer
from studies.report import GREY, PAIRED, RESULTS, SCENES, Report, axes_at, figure_of, markdown_table, write
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


def cases(coarse: bool = False) -> list[Case]:
    """The flagship, the flat arch of section 3.3 and a wall with an opening, each with its layouts."""
    wall = wall_with_opening(["aabbc", "a...c", "ddeff", "#####"])
    asked = (
        ("beam-arch", load_scene(SCENES / "flat_beam_arch.json"), "enumeration", None, 300),
        ("flat arch", leonardo_flat_arch(), "random", 400, 100),
        ("wall with an opening", wall, "random", 400, 100),
    )
    found = []
    for name, scene, driver, budget, count in asked:
        count = 2 if coarse else count
        budget = 40 if coarse else budget
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
    parser = argparse.ArgumentParser(prog="python -m studies.distinct_elements", description=__doc__)
    parser.add_argument("--seconds", type=float, help="time after which no run is begun; default no limit")
    parser.add_argument("--out", type=Path, default=FILE, help="table to add to")
    given = parser.parse_args()
    found = cases()
    made = run_all(given.out, found, given.seconds)
    print(f"{made} runs made; {len(done(given.out))} of {sum(1 for _ in asked(found))} are there")


NAME: Final = "distinct_elements"
GAIN: Final = 1.01
"""Collapse load without dilation over that with it, above which a layout counts as carrying more without."""
CASES: Final = 8
"""Layouts with the largest gains that are looked into."""
ABOVE: Final = 3
"""Layouts that end furthest above λ, which are pushed again with the laws of limit analysis."""
BALANCE: Final = 0.01
"""Error of energy above which a run is repeated with half of its step."""
REACHED: Final = 0.9
"""Share of the lower first crack at which both states are compared."""


def law(inner: str, dilation: str) -> str:
    """Name of a law, for tables and columns."""
    return f"{inner}, {'dilation' if dilation == 'friction' else 'no dilation'}"


def side_by_side(runs: pd.DataFrame, numerics: str = DEFAULT) -> pd.DataFrame:
    """One row per layout with the collapse load of each law, 0 where it does not stand, NaN where it still rises."""
    part = runs[(runs["kind"] == "experiment") & (runs["numerics"] == numerics)].copy()
    part["law"] = [law(*pair) for pair in zip(part["inner"], part["dilation"], strict=True)]
    part.loc[part["status"] == "locked", "load_factor"] = np.nan
    wide = part.pivot_table("load_factor", ["scene", "layout", "associative"], "law", dropna=False)
    wide = wide.reindex(columns=[law(*pair) for pair in LAWS])
    return wide.dropna(how="all").reset_index()


def summary(runs: pd.DataFrame, found: list[Case]) -> pd.DataFrame:
    """Per scene and law: how many runs were asked and done, and collapse over λ by quartiles."""
    rows = []
    for case in found:
        for inner, dilation in LAWS:
            own = runs[(runs["scene"] == case.name) & (runs["inner"] == inner) & (runs["dilation"] == dilation)]
            own = own[(own["kind"] == "experiment") & (own["numerics"] == DEFAULT)]
            stood = own[own["status"] == "collapse"]
            ratio = stood["load_factor"] / stood["associative"]
            quartiles = ratio.quantile([0.0, 0.25, 0.5, 0.75, 1.0]) if len(ratio) else pd.Series([np.nan] * 5)
            rows.append(
                {
                    "scene": case.name,
                    "law": law(inner, dilation),
                    "asked": len(case.layouts),
                    "done": len(own),
                    "do not stand": int(own["status"].isin(["falls", "creeps"]).sum()),
                    "still rise": int((own["status"] == "locked").sum()),
                    **dict(zip(("least / λ", "25 %", "median", "75 %", "most / λ"), quartiles, strict=True)),
                    "energy error": own["energy_error"].max(),
                }
            )
    return pd.DataFrame(rows)


def numerics(runs: pd.DataFrame) -> pd.DataFrame:
    """Per setting and law: by how much the collapse load differs from that of the full set's settings."""
    base = side_by_side(runs).set_index(["scene", "layout"])
    rows = []
    for name in NUMERICS:
        if name == DEFAULT:
            continue
        other = side_by_side(runs, name).set_index(["scene", "layout"])
        both = base.index.intersection(other.index)
        row: dict[str, Any] = {"numerics": name}
        for pair in LAWS:
            one, two = base.loc[both, law(*pair)], other.loc[both, law(*pair)]
            change = (two[one > 0.0] / one[one > 0.0] - 1.0).dropna()
            row |= {
                f"{law(*pair)}: layouts": len(change),
                "median": change.abs().median(),
                "largest": change.abs().max(),
            }
            row = {(key if ":" in key or key == "numerics" else f"{law(*pair)}: {key}"): v for key, v in row.items()}
        own = runs[(runs["kind"] == "experiment") & (runs["numerics"] == name)]
        rows.append(row | {"energy error": own["energy_error"].max()})
    return pd.DataFrame(rows)


def survivors(runs: pd.DataFrame) -> pd.DataFrame:
    """Brittle collapse loads over λ by faces, by cells and by fields, of the layouts for which all are known."""
    wide = side_by_side(runs).set_index(["scene", "layout"])
    for kind in ("cells", "fields"):
        own = runs[(runs["kind"] == kind) & (runs["load_factor"] > 0.0)].set_index(["scene", "layout"])
        wide[kind] = own["load_factor"]
    wide = wide.dropna(subset=["cells", "fields"]).reset_index()
    rows = []
    for pair in LAWS:
        row: dict[str, Any] = {"law": law(*pair), "layouts": int(wide[law(*pair)].notna().sum())}
        for kind in ("associative", "cells", "fields"):
            row[f"median share of λ by {'faces' if kind == 'associative' else kind}"] = (
                wide[law(*pair)] / wide[kind]
            ).median()
        rows.append(row)
    return pd.DataFrame(rows)


def reversals(runs: pd.DataFrame) -> pd.DataFrame:
    """Layouts that carry more without dilation when cracks are brittle, the largest gain first."""
    wide = side_by_side(runs)
    wide["gain"] = wide[law("brittle", "0")] / wide[law("brittle", "friction")].replace(0.0, np.nan)
    return wide[wide["gain"] > GAIN].sort_values("gain", ascending=False)


def _state(specimen: Specimen, labels: Any, found: Push, level: float) -> tuple[float, float]:
    """Return the use of the most stressed inner sub-contact, and the compression of dry faces, at a load factor."""
    settled, _ = specimen.settle()
    count = int(np.flatnonzero(found.load_factor >= level)[0]) + 1
    scale = scout(specimen, settled)
    at = push(specimen, settled, scale, specimen.settings.periods, records=count).at_end
    bench, face = specimen.bench, specimen.points.face
    friction, cohesion, tension = bench.law[face][:, [2, 4, 5]].T
    inner = ~labels[face]
    size: Floats = np.linalg.norm(at.shear, axis=1)
    # Dry faces are left out before dividing: they have neither tension nor cohesion.
    shear = size[inner] / (cohesion + friction * at.pressure)[inner]
    use = np.maximum(-at.pressure[inner] / tension[inner], shear)
    pressed = float((at.pressure * specimen.points.place[:, -1])[~inner].sum())
    return float(use.max()), pressed


def look_into(found: list[Case], turned: pd.DataFrame) -> pd.DataFrame:
    """Compare the states of both laws at one load below the first crack, with the usual settings."""
    rows = []
    for case_row in turned.head(CASES).to_dict("records"):
        (case,) = (one for one in found if one.name == case_row["scene"])
        labels = np.array(case.layouts[case_row["layout"]])
        pushes, specimens = {}, {}
        for dilation in ("friction", "0"):
            specimen = specimen_of(case.assembly, labels, joints_of("brittle", dilation), Settings())
            settled, _ = specimen.settle()
            specimens[dilation] = specimen
            pushes[dilation] = push(specimen, settled, scout(specimen, settled), specimen.settings.periods)
        first = {}
        for key, one in pushes.items():
            broke = np.flatnonzero(one.broken > 0)
            first[key] = float(one.load_factor[max(int(broke[0]) - 1, 0)]) if broke.size else np.nan
        # A run without a crack has no first one; the largest load of each run bounds the level as well.
        peaks = [float(one.load_factor.max()) for one in pushes.values()]
        level = REACHED * float(np.nanmin([*first.values(), *peaks]))
        states = {key: _state(specimens[key], labels, pushes[key], level) for key in pushes}
        carried = {key: float(one.load_factor[one.collapse]) for key, one in pushes.items()}
        rows.append(
            {
                "scene": case.name,
                "layout": case_row["layout"],
                "λ": case_row["associative"],
                "collapse with dilation": carried["friction"],
                "without": carried["0"],
                "first crack with": first["friction"],
                "without ": first["0"],
                "use of inner faces with": states["friction"][0],
                "without  ": states["0"][0],
                "compression of dry faces, without / with": states["0"][1] / states["friction"][1],
                "plastic: without / with": case_row[law("plastic", "0")] / case_row[law("plastic", "friction")],
            }
        )
    return pd.DataFrame(rows)


def under_own_laws(found: list[Case], runs: pd.DataFrame) -> list[tuple[float, float]]:
    """Push the layouts that end furthest above λ once more with the yield points and gaps of limit analysis.

    Returns the collapse load over λ, as in the full set and under these laws, of `ABOVE` layouts.
    """
    wide = side_by_side(runs)
    wide["ratio"] = wide[law("plastic", "friction")] / wide["associative"]
    pairs = []
    for row in wide.nlargest(ABOVE, "ratio").to_dict("records"):
        (case,) = (one for one in found if one.name == row["scene"])
        settings = Settings(scheme="limit", gaps="plastic", step=0.7, periods=100.0)
        labels = np.array(case.layouts[row["layout"]])
        specimen = specimen_of(case.assembly, labels, joints_of("plastic", "friction"), settings)
        settled, _ = specimen.settle()
        again = push(specimen, settled, row["associative"], settings.periods)
        pairs.append((row["ratio"], float(again.load_factor[again.collapse]) / row["associative"]))
    return pairs


def at_half_the_step(found: list[Case], runs: pd.DataFrame) -> list[float]:
    """Repeat the runs whose error of energy exceeds `BALANCE` with half of their step; return the new errors."""
    cases_by_name = {case.name: case for case in found}
    over = runs[(runs["kind"] == "experiment") & (runs["energy_error"] > BALANCE)].to_dict("records")
    return [
        experiment(
            cases_by_name[row["scene"]], row["layout"], row["numerics"], row["inner"], row["dilation"], halves=1
        ).energy_error
        for row in over
    ]


def run(out: Path, coarse: bool) -> pd.DataFrame:
    """Make the runs that are missing if coarse, and the page of those that are there."""
    found = cases(coarse)
    path = out / f"{NAME}.csv"
    if coarse or not path.exists():
        run_all(path, found)
    runs = pd.read_csv(path, keep_default_na=True, dtype={"dilation": str})
    turned = reversals(runs)
    looked = look_into(found, turned)
    parts = {"summary": summary(runs, found), "numerics": numerics(runs), "survivors": survivors(runs)}
    shown = pd.concat(
        [frame.assign(part=name) for name, frame in (*parts.items(), ("reversal", looked)) if len(frame)],
        ignore_index=True,
    )
    report = _report(runs, found, turned, looked, parts, under_own_laws(found, runs), at_half_the_step(found, runs))
    write(out, report, runs, {"": _picture(runs, turned)}, parts["summary"])
    _add_tables(out / f"{NAME}.md", parts["numerics"], parts["survivors"], looked)
    return shown


def _add_tables(page: Path, *tables: pd.DataFrame) -> None:
    """Add further tables to the page, before its last line."""
    text = page.read_text("utf-8")
    heads = (
        "Change of the collapse load by numerics, relative",
        "What is left of λ by faces, cells and fields (lower bound)",
        "Layouts with the largest gains without dilation, usual settings",
    )
    parts = [f"**{head}**\n\n{markdown_table(one)}\n" for head, one in zip(heads, tables, strict=True) if len(one)]
    body, last = text.rsplit("\nRun: ", 1)
    page.write_text(body + "\n" + "\n".join(parts) + "\nRun: " + last, "utf-8")


def _share(part: pd.Series, limit: float) -> str:
    """Say how many values exceed a limit."""
    return f"{int((part > limit).sum())} of {int(part.notna().sum())}"


def _report(
    runs: pd.DataFrame,
    found: list[Case],
    turned: pd.DataFrame,
    looked: pd.DataFrame,
    parts: dict[str, pd.DataFrame],
    again: list[tuple[float, float]],
    halved: list[float],
) -> Report:
    wide = side_by_side(runs)
    every = sum(1 for _ in asked(found))
    ratio = {pair: wide[law(*pair)] / wide["associative"] for pair in LAWS}
    own = runs[runs["kind"] == "experiment"]
    both = int((wide[law("brittle", "0")].gt(0.0) & wide[law("brittle", "friction")].gt(0.0)).sum())
    fallen = int((wide[law("brittle", "0")] == 0.0).sum())
    cracked = own[(own["inner"] == "brittle") & (own["numerics"] == DEFAULT) & own["first_crack"].notna()]
    at_once = int((cracked["load_factor"] <= 1.01 * cracked["first_crack"]).sum())
    earlier = int((looked["first crack with"] < looked["without "]).sum()) if len(looked) else 0
    used = int((looked["use of inner faces with"] > looked["without  "]).sum()) if len(looked) else 0
    plastic = (wide[law("plastic", "0")] / wide[law("plastic", "friction")]).dropna()
    shares = parts["survivors"]
    left = "; ".join(
        f"{row['law']}: {row['median share of λ by faces']:.2f} by faces, {row['median share of λ by cells']:.2f} by "
        f"cells, {row['median share of λ by fields']:.2f} by fields"
        for row in shares.to_dict("records")
    )
    return Report(
        name=NAME,
        title="Distinct elements with inner and dry faces",
        question="What do brittle cracks and joints that do not dilate leave of λ, over hundreds of layouts, and when "
        "does a layout carry more without dilation?",
        source="Iannuzzo et al. 2024: its section 5 names this study as future work, its section 3.3 has the surprise "
        "(2187 N without dilation against 1911 N with it).",
        model=f"{every} runs are asked for, {len(runs)} were made in the time there was. Full set: 300 layouts of the "
        "beam-arch and 100 each of the flat arch and of a wall with an opening, evenly over those above a "
        "sixtieth of the largest λ, plastic and brittle, with and without dilation, one rate, local damping. Every "
        f"{SAMPLE}th layout also with two other damping schemes, half the step, three and nine points "
        "a face and a third of the rate, and λ by cells of half the size and by fields. The full set is pushed three "
        "times as fast as usual with a step of 0.7 of the critical one; the second table says what that changes.",
        agrees=(
            f"Energy: the largest error of a run is {own['energy_error'].max():.1%}, the median "
            f"{own['energy_error'].median():.0e}; {len(halved)} of {len(own)} exceed 1 %"
            + (f"; with half of their step the largest of these is {max(halved):.2%}." if halved else "."),
            f"Brittle with dilation exceeds λ by over 1 % in {_share(ratio[('brittle', 'friction')], 1.01)} layouts, "
            f"without dilation in {_share(ratio[('brittle', '0')], 1.01)}.",
            f"Plastic without dilation exceeds plastic with it by over 1 % in {_share(plastic, GAIN)} layouts.",
            f"Median shares of λ that are carried, with 0 for what falls: {left}.",
        ),
        differs=(
            f"Brittle, {len(turned)} of {both} layouts that stand under both laws carry over 1 % more without "
            "dilation than with it"
            + (f", the most {100 * (turned['gain'].max() - 1.0):.0f} %." if len(turned) else "."),
            f"Why: in {used} of the {len(looked)} largest gains inner faces are used more with dilation at the same "
            f"load, and in {earlier} the first crack comes at a smaller load. Joints that open as they slide wedge the "
            "blocks apart and press where nothing gives way; the crack that follows ends the run, as it does in "
            f"{at_once} of {len(cracked)} brittle runs. The others end above λ; why was not found out.",
            f"Plastic with dilation ends more than 1 % below λ in {int((ratio[('plastic', 'friction')] < 0.99).sum())} "
            f"and more than 1 % above it in {_share(ratio[('plastic', 'friction')], 1.01)} layouts. Below: gaps that "
            "close without resistance slide without dilating (docs/notes/tried.md). Above: five points a face bear "
            "more bending than the kern of limit analysis. With its yield points and gaps the furthest above end at "
            + ", ".join(f"{after:.3f} instead of {before:.3f}" for before, after in again)
            + " of λ. λ therefore bounds a default run only where inner faces do not bend.",
            f"{fallen} of {int(wide[law('brittle', '0')].notna().sum())} layouts do not stand under their own weight "
            "when cracks are brittle and joints do not dilate.",
        ),
        pictures={
            "": "Left: collapse over λ by law and scene, as shares of layouts below a ratio. Middle: brittle without "
            "dilation against with it, both over λ. Right: error of energy of all runs."
        },
    )


def _picture(runs: pd.DataFrame, turned: pd.DataFrame) -> Figure:
    figure = figure_of(12.8, 4.6)
    wide = side_by_side(runs)
    ax = axes_at(figure, 0.7, 0.7, 3.6, 3.2)
    for pair, (colour, dash, _) in zip(LAWS, PAIRED, strict=False):
        ratio = np.sort((wide[law(*pair)] / wide["associative"]).dropna())
        share = np.arange(1, len(ratio) + 1) / max(len(ratio), 1)
        ax.step(ratio, share, where="post", color=colour, ls=dash, lw=1.3, label=law(*pair))
    ax.axvline(1.0, color=GREY, lw=0.8)
    ax.set(xlabel="collapse / λ by faces [–]", ylabel="share of layouts below [–]", xlim=(-0.02, 1.25))
    ax.legend(frameon=False, fontsize=7.5, loc="upper left")
    ax.set_title(f"{len(wide)} layouts of three scenes", fontsize=9)
    ax = axes_at(figure, 5.1, 0.7, 3.2, 3.2)
    for (scene, part), (colour, _, marker) in zip(wide.groupby("scene"), PAIRED, strict=False):
        x, y = (part[law("brittle", key)] / part["associative"] for key in ("friction", "0"))
        ax.plot(x, y, marker, color=colour, ms=4, mfc="none", mew=0.8, label=str(scene))
    ax.plot([0, 1.1], [0, 1.1], color=GREY, lw=0.8)
    ax.set(xlabel="brittle with dilation / λ [–]", ylabel="brittle without dilation / λ [–]")
    ax.legend(frameon=False, fontsize=7.5, loc="upper left")
    ax.set_title(f"{len(turned)} layouts carry over 1 % more without", fontsize=9)
    ax = axes_at(figure, 9.1, 0.7, 3.4, 3.2)
    own = runs[(runs["kind"] == "experiment") & (runs["energy_error"] > 0.0)]
    for (inner, part), (colour, dash, _) in zip(own.groupby("inner"), PAIRED, strict=False):
        values = np.sort(part["energy_error"])
        ax.step(values, np.arange(1, len(values) + 1) / len(values), color=colour, ls=dash, label=str(inner))
    ax.axvline(0.01, color=GREY, lw=0.8, label="1 %")
    ax.set(xscale="log", xlabel="largest error of energy in a run [–]", ylabel="share of runs below [–]")
    ax.set_xlim(left=1e-9)
    ax.legend(frameon=False, fontsize=7.5, loc="upper left")
    ax.set_title(f"balance of energy of {len(own)} runs", fontsize=9)
    return figure


if __name__ == "__main__":
    main()
