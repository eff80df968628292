"""Make result tables from the records and the study, and write and read them as CSV or Parquet."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly, faces_of
from jld_core.deadline import Deadline
from jld_core.errors import InputError
from jld_core.files import harmless, whole_file, write_text
from jld_core.limit import load_scale, relative_width
from jld_core.limit.options import Status
from jld_core.scene import Search
from jld_core.tolerances import GAP
from jld_explore.evaluation import Records
from jld_explore.evaluation.cases import Standing
from jld_explore.evaluation.protocol import BOUND, ORDER, load_factors, settled, statuses
from jld_explore.evaluation.records import RefinedRecords
from jld_explore.report.columns import csv_of, raised
from jld_explore.search.state import StopReason, versions
from jld_explore.search.study import Study
from jld_explore.space import Count, count_named, registered, unpack
from jld_explore.space.counts import counts, values_until
from jld_explore.space.labelling import letters_of
from jld_explore.space.search_space import SearchSpace

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Summary:
    """Outcome of a search: the entries of summary.json that every search has.

    Attributes
    ----------
    best, best_labelling : float, str or None
        Largest load factor of the objective, scene units, and its labelling as text.
    unbounded, proven : bool
        Whether some layout carries any load, and whether none carries more than `best`.
    stands_at_zero : bool or None
        False if the best falls under its dead load alone.
    bound, gap : float or None
        Proven upper bound on λ of all layouts, and its relative distance from `best`.
    stop_reason : str
        Why the search ended.
    classes, evaluated, labellings : int
        Layouts up to symmetry, in total and evaluated; and those evaluated with their images.
    solved, pruned, settled : int
        Classes solved in this run; not worth a solve by a bound; always 0.
    counts_by_status : dict of str to int
        Number of classes by status.
    seconds, rate : float
        Duration, s, and classes solved per second, or None.
    driver, seed : str, int
        Driver and its seed.
    warnings : list of str
        Warnings.
    front : list of dict
        Points: `count`, `load_factor`, `bound`, `proven`.
    next : str or None
        How to complete the proof.
    cracks : str or dict
        Crack model of λ, as in a scene.
    by_fields, uncut : [float or None, float or None] or None
        Bounds on λ of the best, and without cuts, where blocks may crack anywhere.
    facts : dict
        All entries of summary.json.
    """

    best: float | None
    best_labelling: str | None
    unbounded: bool
    proven: bool
    bound: float | None
    gap: float | None
    stop_reason: str
    labellings: int
    evaluated: int
    counts_by_status: dict[str, int]
    seconds: float
    rate: float | None
    driver: str
    classes: int | None = None
    stands_at_zero: bool | None = None
    solved: int = 0
    settled: int = 0
    pruned: int = 0
    seed: int = 0
    warnings: list[str] = field(default_factory=list)
    front: list[dict[str, Any]] = field(default_factory=list)
    next: str | None = None
    cracks: Any = "faces"
    by_fields: list[float | None] | None = None
    uncut: list[float | None] | None = None
    facts: dict[str, Any] = field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, facts: Mapping[str, Any]) -> Summary:
        """Make a summary from the content of summary.json; TypeError if a field without default is missing."""
        names = {entry.name for entry in fields(cls)} - {"facts", "warnings"}
        warnings = [*facts.get("warnings", []), *(facts.get("fields") or {}).get("findings", [])]
        entries = {name: value for name, value in facts.items() if name in names}
        return cls(**entries, warnings=warnings, facts=dict(facts))

    def to_json(self) -> dict[str, Any]:
        """Return the content of summary.json as a new dict."""
        return dict(self.facts)


MEETS: Final = "meets"  # column of layouts that reach the required load factor


def requirement_column(low: Floats, status: NDArray[np.object_], search: Search) -> dict[str, Any]:
    """Return the column of rows (k,) that reach the required load factor, as locked ones do.

    Empty if none is required.
    """
    if search.require is None:
        return {}
    with np.errstate(invalid="ignore"):
        carries = (status == str(Status.COLLAPSE)) & (low >= search.require.threshold)
    return {MEETS: carries | (status == str(Status.LOCKED))}


def requirement_sort_keys(table: pd.DataFrame, search: Search) -> list[Floats]:
    """Return sort keys (k,) for `numpy.lexsort` that put layouts with the required λ, by count, first."""
    if search.require is None:
        return []
    met = table[MEETS].to_numpy(bool)
    return [np.where(met, _signed_count(table, search), 0.0), np.where(met, 0.0, 1.0)]


def requirement_entries(table: pd.DataFrame, search: Search, *, complete: bool, finished: bool) -> dict[str, Any]:
    """Return the entries of summary.json on the required load factor; empty if none is required.

    complete: every class was evaluated; finished: the driver proved its aim without that.
    """
    if search.require is None:
        return {}
    met, (count, sense) = table[table[MEETS]], search.front.axes[0]
    sign = _signed_count(met, search)
    best = None if met.empty else met.iloc[int(np.argmin(sign))]
    # a layout that collapses may reach the factor although its lower bound does not
    open_status = [Status.UNCERTIFIED, Status.FAILED, Status.COLLAPSE]
    open_rows = table[~table[MEETS] & table["status"].isin([str(status) for status in open_status])]
    high = open_rows["bracket_hi"].to_numpy(float)
    # Undecided layouts matter only if their count is better.
    may_meet = ~(high < search.require.threshold) & (open_rows["settled"] != BOUND).to_numpy(bool)
    better = _signed_count(open_rows, search) < (np.inf if best is None else float(np.min(sign)))
    proven = finished or (complete and not np.any(may_meet & better))
    entry: dict[str, Any] = {
        "load_factor": search.require.load_factor,
        "count": count,
        "sense": sense,
        "met": len(met),
        "best": None if best is None else _plain(best[count]),
        "best_load_factor": None if best is None or np.isnan(best["load_factor"]) else float(best["load_factor"]),
        "best_labelling": None if best is None else str(best["labelling"]),
        "proven": proven,
    }
    return {"require": entry, "proven": proven}


def requirement_words(require: dict[str, Any]) -> str:
    """Describe the entry `require` of a summary in one line."""
    least = f"λ ≥ {require['load_factor']:g}"
    if require["best"] is None:
        return f"no layout with {least}" + (": proven that there is none" if require["proven"] else " found")
    count = count_named(require["count"])
    value = f"{require['best']:g} {count.noun}s" if count.integer else f"{count.title} {require['best']:.4g}"
    carried = "any load" if require["best_load_factor"] is None else f"{require['best_load_factor']:.6g}"
    side = "fewest" if require["sense"] == "min" else "most"
    if not count.integer:
        side = "least" if require["sense"] == "min" else "most"
    proof = f"proven the {side}" if require["proven"] else "not proven"
    return f"{value} ({proof} with {least}), which carry {carried}; {require['met']} layouts meet it"


def _signed_count(table: pd.DataFrame, search: Search) -> Floats:
    """Return the first count of the front, signed so that less is better."""
    count, sense = search.front.axes[0]
    return np.asarray((1.0 if sense == "min" else -1.0) * table[count].to_numpy(float))


def _plain(value: Any) -> float | int:
    return float(value) if isinstance(value, float | np.floating) else int(value)


CSV_FILE: Final = "results.csv"  # table for people and spreadsheets
PARQUET_FILE: Final = "results.parquet"  # table that programs read

# Most rows written as CSV beside Parquet unasked: a million take 280 MB and 15 s, ten times as long as Parquet
CSV_ROWS: Final = 20_000
_GROUP: Final = 100_000  # rows of a group of a Parquet file, which limits its memory
WITH_PARQUET: Final = "pip install 'jld[parquet]'"  # installs what Parquet needs

# Columns of texts, which CSV does not tell from numbers
_TEXTS: Final = ("labelling", "status", "settled", "driver", "governing")


def parquet_is_installed() -> bool:
    return find_spec("pyarrow") is not None


def without_parquet(rows: int) -> list[str]:
    """Return the sentence that says what a table of so many rows loses without Parquet; none for few."""
    if rows <= CSV_ROWS or parquet_is_installed():
        return []
    lost = f"{CSV_FILE} of {rows} rows takes four times the space and time of {PARQUET_FILE}, which needs pyarrow"
    return [f"{lost}: {WITH_PARQUET}"]


def write_results(folder: Path, results: pd.DataFrame, *, csv: bool | None = None) -> None:
    """Write the table of results into a folder; a file that is not written any more is removed."""
    # Parquet: where pyarrow is installed. CSV: always without it; else if csv is True or there are at most `CSV_ROWS`
    # rows, and with None also where the folder has a CSV file already.
    path, parquet = folder / CSV_FILE, parquet_is_installed()
    if csv or not parquet or len(results) <= CSV_ROWS or (csv is None and path.exists()):
        write_text(path, csv_of(results))
    else:
        path.unlink(missing_ok=True)
    if parquet:
        with whole_file(folder / PARQUET_FILE) as fresh:
            results.to_parquet(fresh, index=False, row_group_size=_GROUP)
    else:
        (folder / PARQUET_FILE).unlink(missing_ok=True)


def results_path(folder: Path) -> Path:
    """Return the file of a folder that holds its table: Parquet where it can be read, else CSV."""
    parquet, csv = folder / PARQUET_FILE, folder / CSV_FILE
    if not parquet.exists() or (csv.exists() and not parquet_is_installed()):
        return csv
    if not parquet_is_installed():
        raise InputError(str(parquet), "it needs pyarrow, which is not installed", f"{CSV_FILE}, or {WITH_PARQUET}")
    return parquet


def read_results(path: Path) -> pd.DataFrame:
    """Read a table of results, of the same types from both files."""
    import pandas as pd  # slow to import and needed for tables only

    if path.suffix == ".parquet":
        return pd.read_parquet(path)
    # from version 3.1 on pandas reads all digits by default, and warns where that is asked for
    version = tuple(int(part) for part in pd.__version__.split(".")[:2])
    exact: Any = {} if version >= (3, 1) else {"float_precision": "round_trip"}
    texts = dict.fromkeys(_TEXTS, "str")
    table: pd.DataFrame = pd.read_csv(path, dtype=texts, keep_default_na=False, na_values=[""], **exact)
    if "governing" in table:  # names of load cases, which a spreadsheet might run
        table["governing"] = table["governing"].map(_without_apostrophe)
    table.columns = pd.Index([_without_apostrophe(name) for name in table.columns])
    for count in registered():
        if count.name in table and table[count.name].isna().any():
            table[count.name] = table[count.name].astype("Int64" if count.integer else "Float64")
    return table.astype({"rank": "Int64"}) if "rank" in table else table


def _without_apostrophe(value: object) -> object:
    """Return a text as it was before `harmless` put an apostrophe before it."""
    return value[1:] if isinstance(value, str) and value[:1] == "'" and harmless(value[1:]) == value else value


_TOGETHER: Final = 1 << 24  # number of comparisons made at once, which limits temporary memory
_DIGITS: Final = 12  # decimal digits to which counts are compared, relative to the largest count


def on_front(load_factors: Floats, counts: Floats, *senses: str) -> Bools:
    """Return (k,) rows not dominated in load factors (k,), never NaN, and counts (k, c) of senses "max" or "min"."""
    # A row is dominated if another is at least as good in all objectives and better in one.
    signs = np.array([1.0 if sense == "max" else -1.0 for sense in senses])
    worth = np.asarray(counts, dtype=float).reshape(len(load_factors), len(senses)) * signs
    # Equal sums of lengths or masses may differ by rounding.
    worth = np.round(worth / np.maximum(abs(worth).max(axis=0, initial=0.0), 1e-300), _DIGITS)
    mask = np.zeros(len(worth), dtype=bool)
    rows = np.flatnonzero(np.isfinite(load_factors))
    if rows.size == 0:
        return mask
    # Take the best row for each combination of counts, then those that no other dominates.
    level, group = np.unique(worth[rows], axis=0, return_inverse=True)
    group = group.reshape(-1)
    best = np.full(len(level), -np.inf)
    np.maximum.at(best, group, load_factors[rows])
    unbeaten = _unbeaten(best, level)
    mask[rows] = unbeaten[group] & (load_factors[rows] == best[group])
    return mask


def _unbeaten(best: Floats, level: Floats) -> Bools:
    """Return (p,) the non-dominated rows, of largest λ (p,) and distinct ascending counts (p, c)."""
    if level.shape[1] == 1:
        # Levels ascend, so rows with better counts follow.
        behind = np.maximum.accumulate(best[::-1])[::-1]
        return best > np.concatenate([behind[1:], [-np.inf]])
    unbeaten = np.empty(len(best), dtype=bool)
    step = max(1, _TOGETHER // (len(best) * level.shape[1]))
    for low in range(0, len(best), step):
        part = slice(low, low + step)
        beaten = (best >= best[part, None]) & (level >= level[part, None]).all(axis=2)
        # Each row dominates itself in this comparison.
        unbeaten[part] = beaten.sum(axis=1) == 1
    return unbeaten


CONVERGENCE: Final = "convergence.csv"  # file name of the convergence table
LOCKED: Final = "nothing: a locked layout carries any load"  # entry `bound_by` of a summary without a bound
STANDS: Final = "stands_at_zero"  # column, and entry of the summary, on layouts that stand under their dead load alone
_SLICE: Final = 1 << 15  # number of labellings turned into texts at a time, which limits temporary memory


def faces_table(assembly: Assembly, space: SearchSpace) -> pd.DataFrame:
    # Columns are index, ids of both elements, end points (scene units), and whether a search may choose the label. In
    # space the end points are opposite corners of the bounding box of the face.
    import pandas as pd  # here and below: slow to import and needed for tables only

    faces, ids = faces_of(assembly).interfaces, assembly.elements.ids
    table = pd.DataFrame(
        {"index": np.arange(len(faces)), "element_a": [ids[a] for a in faces.a], "element_b": [ids[b] for b in faces.b]}
    )
    axes = "xy" if assembly.dimension == 2 else "xyz"
    for end in (0, 1):
        for axis, name in enumerate(axes):
            if assembly.dimension == 2:
                table[f"{name}{end}"] = [polygon[end, axis] for polygon in faces.polygon]
            else:
                pick = np.min if end == 0 else np.max
                table[f"{name}{end}"] = [pick(polygon[:, axis]) for polygon in faces.polygon]
    table["candidate"] = space.candidates[: len(faces)]
    return table


def results_table(
    records: Records | RefinedRecords,
    assembly: Assembly,
    space: SearchSpace,
    driver: str,
    *,
    own_objective: bool = False,
    deadline: Deadline | None = None,
    standing: Standing | None = None,
    by_fields: bool = False,
) -> pd.DataFrame:
    """Make the table of results: one row per class, collapse by λ, then the other statuses."""
    # Rows share a rank if their brackets overlap: equally many others are proven stronger. Layouts that fall under
    # their dead load alone follow those of the same status that stand. If a load factor is required, layouts that reach
    # it come first, sorted by the count of the front.
    import pandas as pd

    rows = records.rows
    packed = np.ascontiguousarray(rows["labelling"])
    stands = _stands(rows, records.faces, standing, deadline, by_fields=by_fields)
    falls = stands == 0.0
    associative, zero = rows["cases"][:, -1] if own_objective else rows["associative"], rows["zero_dilation"]
    load_factor = load_factors(rows)
    axes = {name for name, _ in space.search.front.axes}
    deadline = deadline or Deadline()
    late = [count for count in registered() if deadline.limited and count.outlines and count.name not in axes]
    # Texts are added in the order of the table: as columns of a million rows they take most of the memory.
    # mypy takes seconds for the types of so many columns
    columns: dict[str, Any] = {
        "multiplicity": rows["multiplicity"].astype(np.int64),
        "load_factor": load_factor,
        "bracket_lo": rows["low"],
        "bracket_hi": rows["high"],
        **counts(assembly, unpack(packed, records.faces), space.graph, space.limits.block_shapes, without=late),
        "load_factor_associative": associative,
        "load_factor_zero_dilation": zero,
        **({} if not assembly.has_low_values else {"load_factor_nominal": rows["cases"][:, -1]}),
        **_of_cases(rows, assembly),
        **requirement_column(rows["low"], np.where(falls, str(Status.UNSTABLE), statuses(rows)), space.search),
        "seconds": rows["seconds"],
    }
    table = pd.DataFrame(columns)
    state = np.array([ORDER.index(status) for status in Status], dtype=np.int64)[rows["status"]]
    group, level = _ties(np.where((state == 0) & ~falls, load_factor, np.nan), rows["low"], rows["high"])
    last, lower = _ties(np.where((state == 0) & falls, load_factor, np.nan), rows["low"], rows["high"])
    group = np.where(last > 0, last + group.max(initial=0), group)
    level = np.where(lower > 0, lower + level.max(initial=0), level)
    # Sort ties by simplicity, using the counts with terms: fewer blocks, then fewer dry faces.
    simple = [table[count.name].to_numpy() for count in registered() if count.terms is not None]
    required = requirement_sort_keys(table, space.search)
    order = np.lexsort((packed.view(f"S{packed.shape[1]}").ravel(), *simple, level, group, *required, falls, state))
    table = table.iloc[order].reset_index(drop=True)
    packed = packed[order]
    void = space.void
    texts = _texts(packed, records.faces, assembly.faces) if void is None else void.texts(unpack(packed, records.faces))
    table.insert(0, "labelling", texts)
    table.insert(table.columns.to_list().index("bracket_hi") + 1, "status", statuses(rows)[order])
    stands_column = pd.Series(pd.arrays.BooleanArray(~falls[order], np.isnan(stands)[order]))
    table.insert(table.columns.to_list().index("status") + 1, STANDS, stands_column)
    table.insert(table.columns.to_list().index("seconds"), "settled", settled(rows)[order])
    table["driver"] = driver
    _insert_late(table, late, unpack(packed, records.faces), space, deadline)
    # Tied rows share the rank of the first of them.
    ranked = int(np.count_nonzero(state == 0))
    alike = np.array([key[order] for key in (group, *required, falls)])
    first = np.r_[True, (alike[:, 1:] != alike[:, :-1]).any(axis=0)][: len(order)]
    number = np.maximum.accumulate(np.where(first, np.arange(1, len(table) + 1), 0)) if len(table) else order
    unranked = np.arange(len(table)) >= ranked
    table.insert(0, "rank", pd.Series(pd.arrays.IntegerArray(number.astype(np.int64), unranked)))
    return table


def _stands(
    rows: NDArray[np.void], faces: int, standing: Standing | None, deadline: Deadline | None, *, by_fields: bool
) -> Floats:
    """Return 1 for rows whose layouts stand under their dead load alone, 0 for others, NaN where undecided."""
    status = statuses(rows)
    stands = np.where(status == str(Status.UNSTABLE), 0.0, np.nan)
    bounded = np.flatnonzero((status == str(Status.COLLAPSE)) | (status == str(Status.LOCKED)))
    if standing is not None:
        labels = unpack(np.ascontiguousarray(rows["labelling"][bounded]), faces)
        longest = float(np.nanmax(rows["seconds"][bounded], initial=0.0))
        stands[bounded] = standing.of(labels, rows["low"][bounded], deadline, longest)
    # `standing` looks at rigid blocks: where these stand, blocks that crack anywhere may still fall.
    return np.where(stands == 1.0, np.nan, stands) if by_fields else stands


def that_stand(results: pd.DataFrame) -> pd.DataFrame:
    """Return the rows with a load factor that stand under their dead load alone; all where none does."""
    ranked = results[results["status"] == str(Status.COLLAPSE)]
    if STANDS not in ranked:
        return ranked
    stands = ranked[ranked[STANDS].fillna(True).astype(bool)]
    return ranked if stands.empty else stands


def _insert_late(
    table: pd.DataFrame, late: Sequence[Count], labellings: Bits, space: SearchSpace, deadline: Deadline
) -> None:
    """Insert the columns of counts that need block outlines; NA where the deadline comes first."""
    import pandas as pd

    for count in late:
        values = values_until(count, space.assembly, labellings, space.graph, space.limits.block_shapes, deadline)
        column = pd.Series(values)
        if column.isna().any():
            column = column.astype("Int64" if count.integer else "Float64")
        before = registered()[registered().index(count) - 1].name
        table.insert(int(table.columns.to_list().index(before)) + 1, count.name, column)


def _texts(packed: NDArray[np.uint8], interfaces: int, faces: int) -> pd.Series[str]:
    """Return packed labellings (k, bytes) as texts, "d" for dry and "i" for inner."""
    import pandas as pd

    letters = np.empty((len(packed), faces), dtype=np.uint8)
    for low in range(0, len(packed), _SLICE):
        letters[low : low + _SLICE] = letters_of(unpack(packed[low : low + _SLICE], interfaces)[:, :faces])
    if not parquet_is_installed():
        text = letters.tobytes().decode("ascii")
        return pd.Series([text[k * faces : (k + 1) * faces] for k in range(len(packed))], name="labelling", dtype="str")
    import pyarrow as pa

    ends = np.arange(len(packed) + 1, dtype=np.int64) * faces
    column = pa.Array.from_buffers(pa.large_string(), len(packed), [None, pa.py_buffer(ends), pa.py_buffer(letters)])
    texts: pd.Series[str] = pa.table({"labelling": column}).to_pandas()["labelling"]
    return texts


def nominal_of_best(results: pd.DataFrame) -> float | None:
    """Return λ at nominal values of the layout that is strongest at low values, or None."""
    ranked = that_stand(results)
    return None if ranked.empty else float(ranked["load_factor_nominal"].iloc[0])


def _ties(load_factor: Floats, low: Floats, high: Floats) -> tuple[Ints, Ints]:
    """Return groups (k,) that share a rank, as many proven stronger, and within them levels of strength, best first."""
    group, level = np.zeros((2, len(load_factor)), dtype=np.int64)
    # Replace a missing end of a bracket by λ.
    low, high = (np.where(np.isnan(end), load_factor, end) for end in (low, high))
    ranked = np.flatnonzero(~np.isnan(load_factor))
    group[ranked] = 1 + len(ranked) - np.searchsorted(np.sort(low[ranked]), high[ranked], side="right")
    ranked = ranked[np.argsort(-load_factor[ranked], kind="stable")]
    near = GAP * abs(load_factor)
    low, high = np.maximum(low, load_factor - near), np.minimum(high, load_factor + near)
    number, least = 0, np.inf
    for row, lower, upper in zip(ranked.tolist(), low[ranked].tolist(), high[ranked].tolist(), strict=True):
        if upper < least:
            number, least = number + 1, lower
        level[row] = number
    return group, level


def _of_cases(rows: NDArray[np.void], assembly: Assembly) -> dict[str, Any]:
    """Return the columns for load cases: governing case (blank if none) and λ of each case."""
    if not assembly.cases:
        return {}
    names = np.array([*(case.name for case in assembly.cases), ""], dtype=object)
    each = {f"load_factor[{case.name}]": rows["cases"][:, k] for k, case in enumerate(assembly.cases)}
    return {"governing": names[rows["governing"]], **each}


def front_table(results: pd.DataFrame, axes: Sequence[tuple[str, str]]) -> pd.DataFrame:
    """Return the table pareto.csv: rows of the results on the front of λ and given counts."""
    ranked = results.index.isin(that_stand(results).index)
    value = np.where(ranked, results["load_factor"].to_numpy(dtype=float), np.nan)
    _, level = _ties(value, *(results[end].to_numpy(dtype=float) for end in ("bracket_lo", "bracket_hi")))
    names, senses = zip(*axes, strict=True)
    # Levels are numbered from the best; 0 means that there is no λ.
    worth = np.where(level > 0, -level.astype(float), np.nan)
    front = results[on_front(worth, results[list(names)].to_numpy(dtype=float), *senses)]
    return front.drop_duplicates(list(names))


def is_ahead(results: pd.DataFrame, bound: float | None, gap: float, floor: float = 0.0) -> bool:
    """Return whether no other layout may be stronger than the first, by more than a gap."""
    top = results[(results["rank"] == 1).fillna(False)]
    high = min(float(top["bracket_hi"].max()), math.inf if bound is None else bound)
    return len(top) <= 1 or not relative_width(float(top["bracket_lo"].max()), high, floor) > gap


def convergence_table(records: Records | RefinedRecords) -> pd.DataFrame:
    """Return the table convergence.csv: the best λ so far at each improvement and at the end."""
    # Columns are solves (number so far), seconds (solver time so far, summed over workers) and best. Rows follow the
    # order in which evaluations finished.
    import pandas as pd

    rows = records.rows
    value = np.where(statuses(rows) == str(Status.COLLAPSE), load_factors(rows), np.nan)
    best = np.fmax.accumulate(value) if len(value) else value
    before = np.concatenate([[np.nan], best[:-1]])
    last = np.arange(len(rows)) == len(rows) - 1
    is_new = (np.isfinite(best) & ~(best <= before)) | last
    seconds = np.cumsum(rows["seconds"])
    table = {"solves": np.flatnonzero(is_new) + 1, "seconds": seconds[is_new], "best": best[is_new]}
    return pd.DataFrame(table)


def summary(results: pd.DataFrame, study: Study, reason: StopReason, *, complete: bool) -> dict[str, Any]:
    # with all classes the best is optimal up to the widths of brackets; a driver may have a bound or a proof of its own
    # The content names the best labelling, its proof, and how it was found.
    bound, driver, solved, seconds = study.bound, study.driver, study.solved, study.elapsed
    tally = Counter({str(status): int(number) for status, number in results["status"].value_counts().items()})
    ranked = that_stand(results)
    best = None if ranked.empty else float(ranked["load_factor"].iloc[0])
    stands = None if ranked.empty or ranked[STANDS].isna().iloc[0] else bool(ranked[STANDS].iloc[0])
    pruned = int((results["settled"] == BOUND).sum())
    certain = complete and not (tally[str(Status.UNCERTIFIED)] - pruned or tally[str(Status.FAILED)])
    unbounded = bool(tally[str(Status.LOCKED)])
    dilates = not results["load_factor_zero_dilation"].notna().any()
    if not dilates:
        # Solutions without dilation are not unique, so none is proven; the associative λ bounds all of them.
        bound = float(ranked["load_factor_associative"].max()) if certain and not ranked.empty else bound
        certain = False
    if certain and not ranked.empty and not unbounded:
        bound = float(ranked["bracket_hi"].max())
    if stands is False and (bound is not None or driver.finished):
        # a driver that proves that no layout stands has evaluated all that carry the live load nevertheless
        known_bound = -math.inf if bound is None or driver.finished else bound
        bound = max(float(ranked["bracket_hi"].max()), known_bound)
    if unbounded:  # a driver may have a bound on all others
        bound = None
    if bound is not None and not ranked.empty:
        bound = raised(bound, ranked.iloc[0])
    gap = None
    if best is not None and bound is not None:
        width = relative_width(float(ranked["bracket_lo"].max()), bound, load_scale(study.assembly))
        gap = width if math.isfinite(width) else None
    # If the best reaches a bound known before the search, it is optimal, although the search continues.
    met = dilates and not unbounded and driver.bound is None and not driver.checks and gap is not None and gap <= GAP
    return {
        "best": best,
        "best_labelling": None if ranked.empty else str(ranked["labelling"].iloc[0]),
        STANDS: stands,
        "falling": int(((results[STANDS] == False) & (results["status"] != str(Status.UNSTABLE))).sum()),  # noqa: E712
        "unbounded": unbounded,
        # If every standing layout is locked, there is no strongest one.
        "proven": (certain or driver.finished or met) and not (unbounded and ranked.empty),
        "bound": bound,
        "bound_by": study.bound_by if bound is not None else LOCKED if unbounded else None,
        "gap": gap,
        "stop_reason": str(reason),
        "classes": len(results) if complete else study.total,
        "labellings": int(results["multiplicity"].sum()),
        "evaluated": len(results),
        "solved": solved,
        "settled": 0,  # An entry of the contract that no search counts any more.
        "pruned": pruned,
        "counts_by_status": {str(s): int(tally[str(s)]) for s in ORDER if tally[str(s)]},
        "seconds": seconds,
        "rate": solved / seconds if seconds > 0.0 else None,
        "driver": driver.name,
        "seed": study.settings.seed,
        "versions": versions(),
    }
