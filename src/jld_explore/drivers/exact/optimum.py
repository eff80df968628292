"""What is known of the strongest labelling, with one count or of all, and when that is a proof."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from jld_core import tolerances
from jld_core.limit import Status, exceeds
from jld_explore.drivers.exact.incumbents import Incumbents
from jld_explore.drivers.exact.proof_check import Claim
from jld_explore.space import Count, SearchSpace

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Best:
    """What is known of the labellings with one count, or of all (count None); λ in scene units.

    load_factor: best found, NaN where none. bound: proven upper bound, −inf where nothing stands or there is
    nothing, inf where nothing is known. floor: λ below which differences are no matter, as in a bracket's width.
    Labellings that are locked have no λ and are not spoken of.
    """

    count: int | None
    load_factor: float
    bound: float
    floor: float = 0.0

    @property
    def proven(self) -> bool:
        """Nothing is better by more than `tolerances.PROVEN`, relative."""
        if self.bound == -math.inf:
            return True
        if not (math.isfinite(self.bound) and math.isfinite(self.load_factor)):
            return False
        size = max(abs(self.bound), abs(self.load_factor), self.floor)
        return bool(self.bound - self.load_factor <= tolerances.PROVEN * size)


def claims_of(
    found: Iterable[Best], incumbents: Incumbents, scale: float, load_scale: float
) -> tuple[list[Claim], str]:
    """Return what a proof claims, and what is wrong with it at first sight, "" for nothing.

    scale: λ in scene units of one scaled λ. load_scale: λ below which differences are no matter, scene units.
    """
    claims, problem = [], ""
    for best in found:
        # where nothing stands, nothing exceeds zero
        claims.append(Claim(best.count, (0.0 if best.bound == -math.inf else best.bound) / scale))
        low = incumbents.best(best.count)
        if not best.proven:
            problem = problem or f"the bound {best.bound:.9g} is not met"
        if math.isfinite(low) and exceeds(low, best.bound, load_scale):
            problem = problem or f"a layout carries {low:.9g}, above the bound {best.bound:.9g}"
    return claims, problem


def front(found: Iterable[Best]) -> list[dict[str, Any]]:
    """The proven front: count, load_factor, bound, proven of every count; those nothing stands at are left out."""
    rows: list[dict[str, Any]] = []
    for best in found:
        if best.count is None or (math.isnan(best.load_factor) and best.bound == -math.inf):
            continue
        known = None if math.isnan(best.load_factor) else best.load_factor
        bound = best.bound if math.isfinite(best.bound) else None
        rows.append({"count": best.count, "load_factor": known, "bound": bound, "proven": best.proven})
    return sorted(rows, key=lambda row: int(row["count"]))


def front_of_all(results: pd.DataFrame, count: str, complete: bool) -> list[dict[str, Any]]:
    """The same of a space that was enumerated instead. count: column of the front's count; complete: nothing lacks."""
    rows: list[dict[str, Any]] = []
    for value, group in results.groupby(count):
        ranked = group[group["status"] == str(Status.COLLAPSE)]
        if not ranked.empty:
            sure = complete and not group["status"].isin([str(Status.UNCERTIFIED), str(Status.FAILED)]).any()
            best, bound = float(ranked["load_factor"].max()), float(ranked["bracket_hi"].max())
            rows.append(
                {"count": int(str(value)), "load_factor": best, "bound": bound if sure else None, "proven": sure}
            )
    return rows


def counts_of(space: SearchSpace, count: Count) -> list[int]:
    """Values that a count of the front, a sum of ones, may take in a space."""
    assert count.terms is not None
    most = count.terms(space.assembly).most(space.assembly)
    bounds = next((bounds for one, bounds in space.limits.on_counts if one is count), None)
    if bounds is None:
        return list(range(most + 1))
    return list(range(int(bounds.low or 0), (most if bounds.high is None else min(int(bounds.high), most)) + 1))
