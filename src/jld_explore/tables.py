"""Result tables: pure functions of the store."""

from __future__ import annotations

from collections import Counter
from typing import Any, Final

import numpy as np
import pandas as pd

from jld_core.assembly import Assembly
from jld_core.solvers.status import Status
from jld_explore.candidates import SearchSpace
from jld_explore.constraints import counts
from jld_explore.labelling import to_string, unpack
from jld_explore.pareto import on_front
from jld_explore.store import Store, settled, statuses

ORDER: Final = (Status.COLLAPSE, Status.LOCKED, Status.UNCERTIFIED, Status.UNSTABLE, Status.FAILED)


def faces_table(assembly: Assembly, space: SearchSpace) -> pd.DataFrame:
    """faces.csv: index, elements, end points (spatial: opposite corners of the bounding box) and candidacy."""
    faces, ids = assembly.interfaces, assembly.elements.ids
    table = pd.DataFrame(
        {
            "index": np.arange(len(faces)),
            "element_a": [ids[a] for a in faces.a],
            "element_b": [ids[b] for b in faces.b],
        }
    )
    axes = "xy" if assembly.dimension == 2 else "xyz"
    for end in (0, 1):
        for axis, name in enumerate(axes):
            if assembly.dimension == 2:
                table[f"{name}{end}"] = [polygon[end, axis] for polygon in faces.polygon]
            else:
                pick = np.min if end == 0 else np.max
                table[f"{name}{end}"] = [pick(polygon[:, axis]) for polygon in faces.polygon]
    table["candidate"] = space.candidates
    return table


def results_table(store: Store, assembly: Assembly, space: SearchSpace, driver: str) -> pd.DataFrame:
    """results.csv: one row per class, collapse by λ, then locked, uncertified, unstable, failed; λ in scene units."""
    rows = store.rows
    labellings = unpack(rows["labelling"], store.faces)
    associative, zero = rows["associative"], rows["zero_dilation"]
    load_factor = np.where(np.isnan(zero), associative, zero)
    status = statuses(rows)
    tally = counts(assembly, labellings)
    table = pd.DataFrame(
        {
            "labelling": [to_string(labels) for labels in labellings],
            "multiplicity": rows["multiplicity"].astype(np.int64),
            "load_factor": load_factor,
            "bracket_lo": rows["low"],
            "bracket_hi": rows["high"],
            "status": [str(s) for s in status],
            "dry_faces": tally.dry_faces,
            "dry_length": tally.dry_length,
            "blocks": tally.blocks,
            "largest_block_cells": tally.largest_block_cells,
            "load_factor_associative": associative,
            "load_factor_zero_dilation": zero,
            "settled": settled(rows),
            "seconds": rows["seconds"],
            "driver": driver,
        }
    )
    place = np.array([ORDER.index(s) for s in status], dtype=np.int64)
    worth = np.where(place == 0, -load_factor, 0.0)
    order = np.lexsort((table["labelling"].to_numpy(dtype=str), worth, place))
    table = table.iloc[order].reset_index(drop=True)
    collapsed = int(np.count_nonzero(place == 0))
    rank = pd.array([n + 1 if n < collapsed else pd.NA for n in range(len(table))], dtype="Int64")
    table.insert(0, "rank", rank)
    return table


def front_table(results: pd.DataFrame, count: str, sense: str) -> pd.DataFrame:
    """pareto.csv: the rows of the results on the front of λ against the scene's count."""
    ranked = results["status"] == str(Status.COLLAPSE)
    value = np.where(ranked, results["load_factor"].to_numpy(dtype=float), np.nan)
    return results[on_front(value, results[count].to_numpy(dtype=float), sense)]


def summary(
    results: pd.DataFrame,
    *,
    stop_reason: str,
    complete: bool,
    classes: int | None,
    solved: int,
    seconds: float,
    driver: str,
    seed: int,
    versions: dict[str, str],
    bound: float | None = None,
) -> dict[str, Any]:
    """summary.json: the best labelling, what is proven of it, and how it was found.

    complete: every class of the space has its evaluation, so that the best of them is the best there is up to the
    widths of the brackets. bound: a proven upper bound on λ over the whole space, where the driver has one.
    """
    tally = Counter(results["status"])
    ranked = results[results["status"] == str(Status.COLLAPSE)]
    best = None if ranked.empty else float(ranked["load_factor"].iloc[0])
    certain = complete and not (tally[str(Status.UNCERTIFIED)] or tally[str(Status.FAILED)])
    unbounded = bool(tally[str(Status.LOCKED)])
    if certain and not ranked.empty and not unbounded:
        bound = float(ranked["bracket_hi"].max())
    gap = None
    if best is not None and bound is not None:
        low = float(ranked["bracket_lo"].max())
        gap = (bound - low) / max(abs(bound), abs(low)) if max(abs(bound), abs(low)) > 0.0 else 0.0
    return {
        "best": best,
        "best_labelling": None if ranked.empty else str(ranked["labelling"].iloc[0]),
        "unbounded": unbounded,
        "proven": certain,
        "bound": bound,
        "gap": gap,
        "stop_reason": stop_reason,
        "classes": classes,
        "labellings": int(results["multiplicity"].sum()),
        "evaluated": len(results),
        "solved": solved,
        "settled": {name: int(number) for name, number in Counter(results["settled"]).items()},
        "counts_by_status": {str(s): int(tally[str(s)]) for s in ORDER if tally[str(s)]},
        "seconds": seconds,
        "rate": solved / seconds if seconds > 0.0 else None,
        "driver": driver,
        "seed": seed,
        "versions": versions,
    }
