"""Convert tables to spreadsheet-safe text, and describe units and meanings of columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from jld_core.arrays import Bools, Floats
from jld_core.assembly import Assembly
from jld_core.errors import InputError
from jld_core.files import RUN_BY_SPREADSHEETS, harmless
from jld_explore.space import registered

if TYPE_CHECKING:
    import pandas as pd


Columns = dict[str, dict[str, str]]  # unit ("" for none) and meaning by the name of the column

_FACES: Final = {
    "index": ("", "place of the face in a labelling, counted from 0"),
    "element_a": ("", "id of one element"),
    "element_b": ("", "id of the other, which the normal points to"),
    "candidate": ("", "whether the search may change its label"),
}
_RESULTS: Final = {
    "rank": ("", "1 is the strongest; only of layouts with a proven load factor, what falls without live load last"),
    "labelling": ("", "a letter for each face in the order of faces.csv: d dry, i inner"),
    "multiplicity": ("", "labellings that are equal to this one under the scene's symmetries, itself among them"),
    "load_factor": ("", "load factor of the objective"),
    "bracket_lo": ("", "proven lower bound on the load factor"),
    "bracket_hi": ("", "proven upper bound on the load factor"),
    "status": ("", "collapse, locked, uncertified, unstable or failed"),
    "stands_at_zero": ("", "whether it stands under its dead load alone; blank where that is not known"),
    "load_factor_associative": ("", "load factor where sliding joints dilate"),
    "load_factor_zero_dilation": ("", "load factor found without dilation"),
    "meets": ("", "whether it is proven to carry the load factor that the scene requires"),
    "load_factor_nominal": ("", "load factor at the nominal values of materials; all others are at the low ones"),
    "settled": ("", "solve, or bound (too weak to be solved)"),
    "seconds": ("s", "time of the evaluation"),
    "driver": ("", "what proposed it"),
    "fields_lo": ("", "what its blocks carry at least, wherever they crack; of the best layouts of a search by faces"),
    "fields_hi": ("", "what its blocks carry at most, wherever they crack"),
    "tilt_angle": ("degrees", "angle of the table at which it falls; of the best layouts of a tilted scene"),
    "tilt_lo": ("degrees", "proven angle at which it stands, and at all below"),
    "tilt_hi": ("degrees", "proven angle at which it falls"),
    "experiment": ("", "load factor carried in the virtual experiment, where one was made"),
    "beta_form": ("", "reliability index of first order, of the best layouts by load factor"),
    "beta_monte_carlo": ("", "reliability index by simulation"),
    "evidence": ("", "what is known of the point of the front: proven, found or visited"),
}


def require_own_columns() -> None:
    """Raise InputError for a count that has the name of another column of results.csv."""
    for count in registered():
        if count.name in _RESULTS:
            raise InputError(f"count {count.name!r}", "another column of results.csv has that name", "another name")


_BLOCKS: Final = {
    "block": ("", "name of the block"),
    "elements": ("", "ids of its elements"),
    "cells": ("", "how many elements it has"),
    "mass": ("kg", "its mass, where units are m and N"),
    "shape": ("", "a number for each shape, turned ones alike"),
}
_EXPERIMENTS: Final = {
    "labelling": _RESULTS["labelling"],
    "load_factor": ("", "load factor by limit analysis"),
    "experiment": ("", "load factor carried in the virtual experiment"),
    "status": ("", "how the experiment ended"),
    "stands": ("", "whether it stands under the dead load"),
    "rate_error": ("", "relative difference of what is carried at two rates of loading"),
    "first_crack": ("", "load factor at the first crack"),
    "seconds": ("s", "time of the experiment"),
}
_RELIABILITY: Final = {
    "row": ("", "row of the layout in results.csv"),
    "labelling": _RESULTS["labelling"],
    "load_factor": ("", "load factor at the means of values with uncertainty"),
    "beta_form": _RESULTS["beta_form"],
    "beta_monte_carlo": _RESULTS["beta_monte_carlo"],
    "probability": ("", "probability of failure by simulation"),
    "failures": ("", "samples that fail"),
    "samples": ("", "samples of the simulation"),
    "undecided": ("", "samples that bounds leave open, counted as failures"),
}
_CONVERGENCE: Final = {
    "solves": ("", "evaluations up to there"),
    "seconds": ("s", "time of all evaluations up to there, summed over workers"),
    "best": ("", "largest load factor up to there"),
}


def ranked_by(results: pd.DataFrame) -> str:
    """Return the name of the quantity that ranks layouts: "λ", or "λ / required" with cases."""
    return "λ / required" if "governing" in results.columns else "λ"


def value_in_words(results: pd.DataFrame, value: float) -> str:
    """Return a value of the ranking quantity as a short text, such as "λ = 1.234"."""
    return f"{value:#.4g} × required" if "governing" in results.columns else f"λ = {value:#.4g}"


def columns(assembly: Assembly) -> dict[str, Columns]:
    """Return the content of columns.json: unit and meaning of each column of each table."""
    # The keys are file name, then column name, then "unit" and "meaning". Load factors have the unit "".
    length = assembly.units[0]
    ends = {f"{axis}{end}": (length, f"{axis} of end {end} of the face") for end in (0, 1) for axis in "xyz"}
    if assembly.dimension == 2:
        ends = {name: value for name, value in ends.items() if name[0] != "z"}
    else:
        sides = ("least", "greatest")
        ends = {name: (length, f"{sides[int(name[1])]} {name[0]} of the face") for name in ends}
    counts = {count.name: (count.unit(assembly), count.label(assembly).partition(" [")[0]) for count in registered()}
    cases = {f"load_factor[{case.name}]": ("", f"load factor of the case {case.name}") for case in assembly.cases}
    governing = {"governing": ("", "the load case with the least load factor over what is required of it")}
    factor = {
        "load_factor": ("", "governing factor of the objective: the least load factor over what is required of it")
    }
    results = _RESULTS | counts | cases | (governing | factor if cases else {})
    files = {
        "faces.csv": _FACES | ends,
        "results.csv": {name: value for name, value in results.items() if name != "evidence"},
        "pareto.csv": results,
        "convergence.csv": _CONVERGENCE,
        "blocks.csv": _BLOCKS | _sizes(assembly),
        "experiments.csv": _EXPERIMENTS,
        "reliability.csv": _RELIABILITY,
    }
    return {
        file: {name: {"unit": unit, "meaning": meaning} for name, (unit, meaning) in columns_of_file.items()}
        for file, columns_of_file in files.items()
    }


def _sizes(assembly: Assembly) -> dict[str, tuple[str, str]]:
    """Return unit and meaning of the columns of blocks.csv that depend on the dimension."""
    # The keys are the names of the columns.
    length, planar = assembly.units[0], assembly.dimension == 2
    axes = "xy" if planar else "xyz"
    kind, unit = ("length", length) if planar else ("area", f"{length}²")
    return {
        **{f"centroid_{axis}": (length, f"{axis} of its centroid") for axis in axes},
        **{f"extent_{axis}": (length, f"its extent along {axis}") for axis in axes},
        "volume": (f"{length}³", "its volume"),
        f"dry_{kind}": (unit, "of its dry faces"),
        f"inner_{kind}": (unit, "of the inner faces in it"),
    }


def csv_of(table: pd.DataFrame) -> str:
    """Convert a table to CSV that is safe for spreadsheets.

    Parameters
    ----------
    table : DataFrame
        Table of the results.

    Returns
    -------
    str
        CSV without index; a text that begins with = + - @ gets a leading apostrophe, so that no formula is run.
    """
    import pandas as pd  # slow to import and needed for tables only

    texts = table.select_dtypes(include=["object", "string"]).columns
    safe = table.copy(deep=False)
    for name in texts:
        # Few tables have such texts, and a check of first letters is fast.
        if any(isinstance(value, str) and value.startswith(RUN_BY_SPREADSHEETS) for value in table[name].tolist()):
            safe[name] = pd.Series([harmless(value) for value in table[name]], index=table.index, dtype=object)
    safe.columns = pd.Index([harmless(name) for name in table.columns])
    return safe.to_csv(index=False)


PROVEN: Final = "proven"  # evidence that no layout carries more, or as much with a better count
FOUND: Final = "found"  # evidence of a point that is the best found by a search for it
VISITED: Final = "visited"  # evidence of a point that was evaluated during a search with another aim
COLUMN: Final = "evidence"  # name of the column of the evidence


def raised(bound: float, best: pd.Series[Any]) -> float:
    """Return a bound that is not below λ of a row, which lies somewhere in its bracket."""
    return max(bound, float(best["load_factor"])) if best["bracket_lo"] <= bound else bound


def front_rows(
    front: pd.DataFrame, summary: Mapping[str, Any], axes: Sequence[tuple[str, str]], *, complete: bool, aimed: bool
) -> list[dict[str, Any]]:
    """Return the best λ known for every count, with evidence; complete: every class; aimed: whole front sought."""
    # Counts are those on the front and those of the driver's own front. Each row has count, load_factor, bound, proven
    # and evidence ("proven", "found" or "visited"). With two counts `count` is a list. The strongest layout alone is
    # proven the best of its count, and not on the front: one with a better count may carry as much.
    unpaired = {row["count"]: row for row in summary.get("front") or [] if not isinstance(row["count"], list)}
    rows, points = [], list(unpaired.values())
    sign = 1.0 if axes[0][1] == "max" else -1.0
    for key, group in front.groupby([name for name, _ in axes]):
        values = key if isinstance(key, tuple) else (key,)
        value = _value(values)
        best = group.sort_values("load_factor", ascending=False, kind="stable").iloc[0]
        point = unpaired.pop(value, None) if len(values) == 1 else None
        # Of several tied rows, the one on the front may have a slightly smaller λ.
        strongest = bool(best["rank"] == 1 or best["bracket_hi"] >= summary["best"])
        rivals = [] if point is None else [row for row in points if sign * row["count"] >= sign * point["count"]]
        sure = bool(complete or (rivals and all(row["proven"] for row in rivals)))
        bound = (point or {}).get("bound")
        if bound is None and (sure or (strongest and summary["proven"])):
            bound = summary["bound"] if strongest and not complete else best["bracket_hi"]
        rows.append(
            {
                "count": value,
                "load_factor": float(best["load_factor"]),
                "bound": None if bound is None else raised(float(bound), best),
                "proven": sure,
                COLUMN: PROVEN if sure else FOUND if aimed or strongest else VISITED,
            }
        )
    # Counts whose best is dominated are not on the front, but their bounds are known.
    others = [{**row, COLUMN: PROVEN if row["proven"] else FOUND} for row in unpaired.values()]
    return sorted([*rows, *others], key=lambda row: row["count"] if isinstance(row["count"], list) else [row["count"]])


def _value(values: Sequence[Any]) -> Any:
    """Return counts as in JSON: a number, or a list for several counts."""
    numbers = [value if isinstance(value, float) else int(str(value)) for value in values]
    return numbers if len(numbers) > 1 else numbers[0]


def known_front(front: pd.DataFrame) -> tuple[pd.DataFrame, Bools]:
    """Return the rows of a front with better evidence than "visited", and (k,) whether proven."""
    if COLUMN not in front:
        return front, np.zeros(len(front), dtype=bool)
    evident = front[front[COLUMN] != VISITED]
    return evident, (evident[COLUMN] == PROVEN).to_numpy()


def with_evidence(front: pd.DataFrame, summary: Mapping[str, Any], counts: Sequence[str]) -> pd.DataFrame:
    """Return a front with its column `evidence`, from the entry `front` of a summary."""
    points = summary.get("front") or []
    evidence = {str(row["count"]): row.get(COLUMN, PROVEN if row["proven"] else FOUND) for row in points}
    return front.assign(**{COLUMN: [evidence.get(str(value), VISITED) for value in values_on(front, counts)]})


def values_on(front: pd.DataFrame, counts: Sequence[str]) -> list[Any]:
    """Return the count of each row of a front as in summary.json: a number, or a list for several."""
    return [_value(row) for row in zip(*(front[name].tolist() for name in counts), strict=True)]


PLACES: Final = 9  # significant digits of coordinates and load factors
DIGITS: Final = 6  # significant digits of forces, velocities and utilisations


def rounded(values: Any, digits: int = PLACES) -> Any:
    """Round numbers to significant digits and return them in the form of JSON."""
    array = np.asarray(values, dtype=float)
    if array.ndim == 0:
        return float(f"{array:.{digits}g}") if np.isfinite(array) else None
    with np.errstate(divide="ignore", invalid="ignore"):
        exponent = np.where((array == 0.0) | ~np.isfinite(array), 0.0, np.floor(np.log10(abs(array))))
    # numbers whose power of ten would overflow stay as they are
    usual = abs(exponent) < 280
    decimals = np.where(usual, digits - 1 - exponent, 0.0)
    # Division by a power of ten gives the double nearest to the decimal number, which prints short; a product does not.
    power = 10.0 ** abs(decimals)
    integer = np.round(np.where(decimals >= 0, array * power, array / power))
    short = np.where(decimals >= 0, integer / power, integer * power)
    return _plain(np.where(usual & np.isfinite(power), short, array))


def rounded_each(arrays: Sequence[Floats]) -> list[Any]:
    """Return arrays (k, d) as `rounded` does; all are rounded together, to save time."""
    if not len(arrays):
        return []
    rows, cuts = rounded(np.concatenate(arrays)), np.cumsum([0, *map(len, arrays)]).tolist()
    return [rows[start:end] for start, end in pairwise(cuts)]


def _plain(array: Floats) -> Any:
    """Return an array as nested lists, with None for values that are not finite."""
    if np.all(np.isfinite(array)):
        return array.tolist()
    if array.ndim > 1:
        return [_plain(row) for row in array]
    return [float(v) if np.isfinite(v) else None for v in array]
