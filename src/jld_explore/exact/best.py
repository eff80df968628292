"""What is known of the strongest labelling, with one count or of all, and when that is a proof."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final

PROVEN: Final = 1e-6
"""Relative distance of bound and incumbent at which the optimum is proven."""


@dataclass(frozen=True)
class Best:
    """What is known of the labellings with one count, or of all (count None); λ in scene units.

    load_factor: best found, NaN where none. bound: proven upper bound, −inf where nothing stands or there is
    nothing, inf where nothing is known. Labellings that are locked have no λ and are not spoken of.
    """

    count: int | None
    load_factor: float
    bound: float

    @property
    def proven(self) -> bool:
        """Nothing is better by more than PROVEN, relative."""
        if self.bound == -math.inf:
            return True
        if not (math.isfinite(self.bound) and math.isfinite(self.load_factor)):
            return False
        size = max(abs(self.bound), abs(self.load_factor))
        return bool(self.bound - self.load_factor <= PROVEN * size)


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
