"""Bounds of planar blocks by fields: in order, below rigid blocks, the same wherever a scene stands."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any, Final

import numpy as np

from benchmarks.claims.geometry import Move, document, planar_grid, polygon_entry, random_move
from benchmarks.claims.tally import Tally, run_cases
from jld_core import Assembly, InputError, LimitAnalysis, Status, build_assembly, parse_scene
from jld_core.fields import bounds_by_fields
from jld_core.fields.bounds import CoarseBounds, FieldBounds, FieldSetting

CLAIM: Final = (
    "Bounds by fields are in order, monotonic, below rigid blocks, independent of position and units, and hold "
    "for other labellings"
)
SAME: Final = 1e-6
"""Relative difference of bounds that two statements of one scene may show."""
ADAPTED: Final = 2e-4
"""Relative amount by which a bound may fall back on an adaptive mesh, where opening a field may cost 1e-4 of it."""
_TRIANGLES: Final = 400


def run(first_seed: int, cases: int, seconds: float) -> Tally:
    """Test the claim on random structures: see `run_cases`."""
    return run_cases(CLAIM, case, first_seed, cases, seconds)


def case(seed: int, tally: Tally) -> str:
    """Return "" where the claim holds for one random structure, else what does not."""
    rng = np.random.default_rng([seed, 2026])
    still = Move(np.eye(2), 1.0, np.zeros(2))
    moved = random_move(rng, 2)
    scenes = random_scenes(rng, [still, moved])
    if scenes is None:
        return ""
    try:
        one, other = (build_assembly(parse_scene(scene)) for scene in scenes)
    except InputError as error:
        tally.count("refused by the builder")
        return "" if "no path" in str(error) else f"refused: {error}"
    found = bounds_by_fields(one, gap=1e-3, adaptive=False, most=_TRIANGLES)
    again = bounds_by_fields(other, gap=1e-3, adaptive=False, most=_TRIANGLES)
    finer = bounds_by_fields(one, gap=1e-3, most=2 * _TRIANGLES, seconds=2.0)
    tally.count(found.status.value)
    scale = max(abs(found.upper) if math.isfinite(found.upper) else 0.0, 1e-3)
    lows = [step.lower for step in (*found.history, *finer.history)]
    highs = [step.upper for step in (*found.history, *finer.history)]
    if max(lows) > min(highs) + 1e-9 * scale:
        return f"lower bound {max(lows):.9g} above upper bound {min(highs):.9g}"
    for values, most in ((found.history, SAME), (finer.history, ADAPTED)):
        for sign, name in ((1.0, "lower"), (-1.0, "upper")):
            numbers = [sign * getattr(step, name) for step in values if math.isfinite(getattr(step, name))]
            if any(b < a - most * scale for a, b in pairwise(numbers)):
                return f"{name} bounds {[sign * number for number in numbers]} do not narrow on nested meshes"
    for name in ("lower", "upper"):
        a, b = getattr(found, name), getattr(again, name)
        if not (a == b or abs(a - b) <= SAME * scale):
            return f"{name} bound {a:.9g} here and {b:.9g} when moved"
    return _transferred(one, rng) or _against_rigid(one, found)


def random_scenes(rng: np.random.Generator, moves: list[Move]) -> list[dict[str, Any]] | None:
    """One random structure, moved in several ways; None where it has a single element."""
    labels, nodes, straight = planar_grid(rng)
    names = [label for label in np.unique(labels).tolist() if label > 0]
    if len(names) < 2:
        return None
    strength = float(10.0 ** rng.uniform(-1.0, 2.0))
    rough, crushed = float(rng.choice([0.0, 0.0, 0.4])), float(rng.choice([math.inf, math.inf, 3.0]))
    joint = {"friction_coefficient": float(rng.uniform(0.1, 0.9)), "cohesion": float(rng.choice([0.0, 0.0, 0.3]))}
    soft = float(rng.choice([math.inf, math.inf, 8.0]))
    pairs = [[f"e{a}", f"e{b}"] for a in names for b in names if a < b]
    whole = [pair for pair in pairs if rng.random() < rng.choice([0.0, 0.5])]
    corners = [np.random.default_rng(int(rng.integers(1 << 30))) for _ in names]
    states = [generator.bit_generator.state for generator in corners]
    scenes = []
    for number, move in enumerate(moves):
        elements = []
        for name, generator, state in zip(names, corners, states, strict=True):
            generator.bit_generator.state = state
            elements.append(polygon_entry(generator, labels, name, nodes, move, straight))
        scene = document(elements if number == 0 else elements[::-1], move)
        weight = 1000.0 * 9.81 * move.scale
        inner = {"tensile_strength": 0.8 * strength * weight, "shear_strength": 1.1 * strength * weight}
        if rough:
            inner["friction_coefficient"] = rough
        if math.isfinite(crushed):
            inner["compressive_strength"] = crushed * strength * weight
        dry = {**joint, "cohesion": joint["cohesion"] * weight}
        if math.isfinite(soft):
            dry["compressive_strength"] = soft * weight
        scene["materials"] |= {"inner": inner, "dry": dry}
        scene["labels"] = {"default": "dry"}
        built = build_assembly(parse_scene(scene)) if whole else None
        if built is not None:
            touch = {frozenset(built.pair(face).split("–")) for face in range(len(built.interfaces))}
            scene["labels"]["inner"] = [pair for pair in whole if frozenset(pair) in touch]
        scenes.append(scene)
    return scenes


def _transferred(assembly: Assembly, rng: np.random.Generator) -> str:
    """What the fields of one labelling prove for another agrees with the bounds of the other."""
    coarse = CoarseBounds(FieldSetting.of(assembly))
    other = assembly.labels ^ (rng.random(len(assembly.labels)) < 0.4)
    mechanism, stresses = coarse.upper(assembly.labels)[1], coarse.lower(assembly.labels)[1]
    low, high = coarse.lower(other)[0], coarse.upper(other)[0]
    scale = max(abs(high) if math.isfinite(high) else 0.0, 1e-3)
    if mechanism is not None and low > float(mechanism.bounds(other[None])[0]) + 1e-9 * scale:
        return f"lower bound {low:.9g} above that of the mechanism of another labelling"
    if stresses is not None and high < float(stresses.bounds(other[None])[0]) - 1e-9 * scale:
        return f"upper bound {high:.9g} below that of the stresses of another labelling"
    return ""


def _against_rigid(assembly: Assembly, found: FieldBounds) -> str:
    """Blocks of real material carry no more than rigid ones, which may have all forces that fields have."""
    if not assembly.labels.all():
        return ""
    rigid = LimitAnalysis(assembly).solve(assembly.labels)
    if rigid.status is not Status.COLLAPSE:
        return ""
    highest = float(rigid.bracket[1])
    if found.lower > highest + 1e-9 * abs(highest):
        return f"lower bound {found.lower:.9g} above that of rigid blocks, {highest:.9g}"
    return ""
