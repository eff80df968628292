"""Best labelling and bound for each count, and the claims of the proof about them."""

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
    """Best λ found and proven bound of the labellings with one count, or of all.

    Locked labellings have no λ and are excluded.

    Attributes
    ----------
    count : int or None
        Value of the count; None for all labellings.
    load_factor : float
        Largest λ found, scene units; NaN if there is none.
    bound : float
        Proven upper bound on λ, scene units; −inf if no labelling stands or none exists, inf if nothing is known.
    floor : float
        Load scale: λ below which differences do not matter, scene units.
    """

    count: int | None
    load_factor: float
    bound: float
    load_scale: float = 0.0

    @property
    def proven(self) -> bool:
        """Whether no labelling is better by more than `tolerances.PROVEN`, relative."""
        if self.bound == -math.inf:
            return True
        if not (math.isfinite(self.bound) and math.isfinite(self.load_factor)):
            return False
        size = max(abs(self.bound), abs(self.load_factor), self.load_scale)
        return bool(self.bound - self.load_factor <= tolerances.PROVEN * size)


def claims_of(
    found: Iterable[Best], incumbents: Incumbents, scale: float, load_scale: float
) -> tuple[list[Claim], str]:
    """Return the claims of a proof, and an obvious problem of theirs ("" for none).

    Parameters
    ----------
    found : iterable of Best
        Best labelling and bound of each target.
    incumbents : Incumbents
        Bounds of the evaluated labellings.
    scale : float
        λ in scene units of one scaled λ.
    load_scale : float
        λ below which differences do not matter, scene units.
    """
    claims, problem = [], ""
    for best in found:
        # if no labelling stands none exceeds zero
        claims.append(Claim(best.count, (0.0 if best.bound == -math.inf else best.bound) / scale))
        low = incumbents.best(best.count)
        if not best.proven:
            problem = problem or f"the bound {best.bound:.9g} is not met"
        if math.isfinite(low) and exceeds(low, best.bound, load_scale):
            problem = problem or f"a layout carries {low:.9g}, above the bound {best.bound:.9g}"
    return claims, problem


def front(found: Iterable[Best]) -> list[dict[str, Any]]:
    """Return the rows of the proven front: count, load_factor, bound and proven.

    Counts for which no labelling stands are left out.
    """
    rows: list[dict[str, Any]] = []
    for best in found:
        if best.count is None or (math.isnan(best.load_factor) and best.bound == -math.inf):
            continue
        known = None if math.isnan(best.load_factor) else best.load_factor
        bound = best.bound if math.isfinite(best.bound) else None
        rows.append({"count": best.count, "load_factor": known, "bound": bound, "proven": best.proven})
    return sorted(rows, key=lambda row: int(row["count"]))


def front_of_all(results: pd.DataFrame, count: str, complete: bool) -> list[dict[str, Any]]:
    """Return the rows of the front of an enumerated space: count, load_factor, bound, proven.

    Parameters
    ----------
    results : DataFrame
        Table of all evaluations.
    count : str
        Column of the count.
    complete : bool
        Whether the table holds every class of the space.
    """
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
    """Return the values that a count may take within the limits of a space.

    Raises ValueError for a count that is no sum of binary terms.
    """
    if count.terms is None:
        raise ValueError(f"{count.name} is no sum of binary terms")
    most = count.terms(space.assembly).most(space.assembly)
    bounds = next((bounds for one, bounds in space.limits.on_counts if one is count), None)
    if bounds is None:
        return list(range(most + 1))
    return list(range(int(bounds.low or 0), (most if bounds.high is None else min(int(bounds.high), most)) + 1))
