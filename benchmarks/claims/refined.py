"""Claim: λ of ordinary refined samples has a bracket, in 99 of 100 cases narrower than 1e-6.

Arches, walls, vaults and buttresses of `jld_core.samples` with inner faces of 1e5 to 1e10 Pa, refined into cells. A
case disagrees where its status is `uncertified`. Brackets of 1e-6 and more are counted in ``notes``.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from benchmarks.claims.tally import Tally, run_cases
from jld_core import InputError, Scene, Status, build_assembly, samples, solve
from jld_core.refinement import refine

CLAIM: Final = "λ of refined samples has a bracket, in 99 of 100 cases narrower than 1e-6"
NARROW: Final = 1e-6
"""Relative width of a bracket that counts as narrow."""
MOST: Final = {2: 260, 3: 110}
"""Largest number of cells of a case by dimension, so that a case takes a second."""


def run(first_seed: int, cases: int, seconds: float) -> Tally:
    """Test the claim on random refined samples.

    Parameters
    ----------
    first_seed, cases : int
        Seeds to test.
    seconds : float
        Time limit, s.

    Returns
    -------
    Tally
        Disagreements, and in `notes` the number of cases by status and of wide brackets.
    """
    return run_cases(CLAIM, case, first_seed, cases, seconds)


def case(seed: int, tally: Tally) -> str:
    """Solve one refined sample."""
    kind, scene = scene_of(seed)
    result = solve(scene)
    tally.count(str(result.status))
    if result.status is Status.UNCERTIFIED:
        return f"{kind}: {result.reason}"
    if result.status is Status.COLLAPSE and not result.gap < NARROW:
        tally.count(f"width of 1e-6 or more, {kind}")
    return ""


def scene_of(seed: int) -> tuple[str, Scene]:
    """Return the kind and the refined scene of a seed; refinements of too many cells are drawn again."""
    rng = np.random.default_rng(seed)
    while True:
        kind = ("arch", "wall", "vault", "buttress")[seed % 4]
        scene, how = _drawn(kind, rng)
        try:
            fine = refine(scene, **how).scene
            assembly = build_assembly(fine)
        except InputError:  # cells that leave no element of such a shape whole
            continue
        if len(assembly.elements) <= MOST[assembly.dimension]:
            return kind, fine


def _drawn(kind: str, rng: np.random.Generator) -> tuple[Scene, dict[str, Any]]:
    """Return a sample and the options of its refinement."""
    strength, shear = 10.0 ** rng.uniform(5.0, 10.0, 2)
    if rng.random() < 0.5:
        shear = strength
    stone = samples.Stone(float(rng.uniform(1600, 2800)), float(rng.uniform(0.4, 0.9)), float(strength), float(shear))
    load = str(rng.choice(["push", "crown", "quarter"]))
    cell = float(rng.uniform(0.06, 0.3))
    if kind == "arch":
        thickness = float(rng.uniform(0.1, 0.3))
        scene = samples.arch(
            thickness=thickness, embrace=float(rng.uniform(90, 180)), voussoirs=int(rng.integers(5, 15)),
            rings=int(rng.integers(1, 3)), load=load, stone=stone,
        )  # fmt: skip
        if rng.random() < 0.5:
            return scene, {"kind": "radial", "centre": (0.0, 0.0), "cell": (thickness / 3, float(rng.uniform(4, 10)))}
        return scene, {"cell": (cell,)}
    if kind == "wall":
        scene = samples.wall(
            courses=int(rng.integers(3, 8)), length=0.4 * int(rng.integers(3, 7)), load=load, stone=stone,
            opening="0.4,0.2,0.4,0.2" if rng.random() < 0.4 else None,
        )  # fmt: skip
        return scene, {"cell": (cell, float(rng.uniform(0.08, 0.2)))}
    if kind == "buttress":
        scene = samples.buttress(
            courses=int(rng.integers(3, 9)), columns=int(rng.integers(1, 4)), thrust=float(rng.uniform(0.5, 0.9)),
            rise=float(rng.uniform(0.0, 0.5)), stone=stone,
        )  # fmt: skip
        return scene, {"cell": (4 * cell,), "kind": str(rng.choice(["grid", "voronoi"])), "seed": int(rng.integers(99))}
    scene = samples.vault(
        kind=str(rng.choice(["barrel", "cross"], p=[0.8, 0.2])),
        voussoirs=2 * int(rng.integers(2, 5)), courses=int(rng.integers(1, 4)), length=float(rng.uniform(0.6, 2.0)),
        load=load, stone=stone,
    )  # fmt: skip
    return scene, {"cell": tuple(float(v) for v in rng.uniform(0.3, 0.9, 3))}
