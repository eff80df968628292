"""Explanation of a missing or a wide bound in one sentence."""

from __future__ import annotations

import math
from typing import Any

from jld_core import tolerances
from jld_core.limit.status import Status


def reason_of(status: Status, bracket: tuple[float, float], gap: float, gap_limit: float, extra: dict[str, Any]) -> str:
    """Explain which bound of a result is missing, and why, or how far its bounds are apart.

    status: outcome of the analysis. bracket: (float, float) lower and upper bound, NaN where missing. gap: relative
    width of the bracket. gap_limit: relative width that was aimed at. extra: further facts of the model, as in the JSON
    output. Result: one sentence without a full stop; "" where nothing is missing and the bracket is as narrow as asked.
    """
    apart = f"the bounds are {gap:.1e} apart, relative (asked {gap_limit:.0e})"
    if status is not Status.UNCERTIFIED:
        return apart if status is Status.COLLAPSE and gap > gap_limit else ""
    low, high = (math.isfinite(end) for end in bracket)
    lower = "no lower bound: no forces were found that balance the loads in every yield set, within rounding (1e-12)"
    upper = (
        f"no upper bound: no mechanism was found whose jumps all faces allow, within rounding ({tolerances.EXACT:.0e})"
    )
    areas = extra.get("effective_area")
    if isinstance(areas, dict) and areas["fixed_point"] > tolerances.FIXED_POINT:
        at = f", most at face {areas['face']}" if "face" in areas else ""
        change, least = areas["fixed_point"], tolerances.FIXED_POINT
        return f"effective areas did not settle: they still change by {change:.1e}{at} (asked {least:.0e})"
    if isinstance(areas, dict) and "above" in areas:
        above = areas["above"]
        stays = f"stays {above:.1e} above the forces (asked {gap_limit:.0e})"
        return f"effective areas: the bound of the frozen areas {stays}"
    if "effective_area" in extra and areas is None:
        return (
            "effective areas: with whole faces no forces are in balance at any λ, so that there are none to begin from"
        )
    if not low and not high:
        return f"{lower}; {upper}"
    if not low:
        return lower
    if not high and isinstance(areas, dict):
        return f"{upper}, nor forces that grow without end within the effective areas they ask for"
    if not high:
        return upper
    if isinstance(areas, dict) and gap <= gap_limit:
        return "effective areas: the forces that fit their own areas carry less than the bracket of the frozen areas"
    if gap <= gap_limit:
        return "the evidence that this model asks for is missing, see the numbers beside λ"
    return apart
