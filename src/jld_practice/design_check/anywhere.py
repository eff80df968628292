"""Check of a layout whose blocks may crack anywhere, beside the check by the faces or cells that are drawn."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

from jld_core.arrays import Bits
from jld_core.assembly import Assembly
from jld_core.errors import InputError
from jld_core.models.crack_models import require_cracks
from jld_core.scene import Scene
from jld_core.scene.cracks import FieldCracks
from jld_practice.design_check.combinations import ROUTE, Combination

COARSE: Final = 0.9
"""Gap of the first bounds of every load case: one mesh."""

FINER: Final = (0.4, 0.15, 0.05)
"""Gaps of the bounds of load cases that the first ones leave open, one after the other."""

_REFUTED: Final = 0.1  # share of the time that may be spent on the utilisation of a case that is refuted anyway


Assess = Callable[[int, float, float], bool | None]
"""Assess the case of a number to a gap within seconds."""


@dataclass(frozen=True)
class Loaded:
    """Structure under one load case and one combination, at design values.

    number: position of the case. required: its required factor.
    """

    number: int
    structure: Assembly
    labels: Bits
    required: float
    combination: Combination


def why_not_anywhere(scene: Scene, assembly: Assembly) -> str:
    """Return why cracks anywhere in the blocks are not checked; "" where they are."""
    if scene.materials.inner is None and not any(one.inner for one in scene.materials.faces or []):
        return "rigid"
    try:
        require_cracks(replace(assembly, cracks=FieldCracks(kind="fields", gap=FINER[-1])))
    except InputError as error:
        return error.problem
    return ""


def assess_all(count: int, seconds: float, assess: Assess, least: Callable[[int], float]) -> None:
    """Assess load cases until each is settled, one is refuted, or the time is over.

    seconds: of the wall clock for all; no case is begun after them, and the first one always is. assess: computes
    bounds of a case to a gap within a time, and returns True where they verify it, False where they refute it. least:
    upper bound of an assessed case over its required factor, by which the worst come first.
    """
    end = time.perf_counter() + seconds
    verdicts: dict[int, bool | None] = {}
    for k in range(count):
        if k and time.perf_counter() > end:
            break
        verdicts[k] = assess(k, COARSE, 0.0)
    refuted = [k for k, verdict in verdicts.items() if verdict is False]
    again = sorted(refuted or [k for k, verdict in verdicts.items() if verdict is None], key=least)
    for k in again[: 1 if refuted else None]:
        for gap in FINER:
            left = end - time.perf_counter()
            if left <= 0.0:
                return
            verdict = assess(k, gap, min(left, _REFUTED * seconds) if refuted else left)
            if verdict is True or (verdict is False and not refuted):
                break
        if verdict is False:
            return


def loaded_cases(structure: Assembly, labels: Bits, combination: Combination) -> list[Loaded]:
    """Return the load cases of a structure under the design loads of a combination."""
    return [
        Loaded(number, alone.with_strengths(alone.strengths(ROUTE)), labels, float(required), combination)
        for number, (alone, required) in enumerate(zip(structure.by_case, structure.required, strict=True))
    ]
