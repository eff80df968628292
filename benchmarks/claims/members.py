"""Claim: walls with members and bond have the same strongest layout by proof, by enumeration and by certificate.

Random walls of 2 by 3 cells have one to three ties, tendons over two or three points, and pins, anchored in cells and
in supports. Half of them have bond, a third crush, and in turn supports are candidates, slits are allowed, or a load
factor is required. The exact driver and enumeration must agree to 1e-6. `jld verify` must accept the certificate of a
proof, where the search allows one, and its bound must lie above the optimum by at most 1e-5.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.claims.tally import Tally, run_cases
from jld_core import parse_scene
from jld_explore import ExploreSettings, explore
from jld_explore.verification import verify

CLAIM: Final = "Walls with members and bond have one optimum by proof, enumeration and certificate"
CLOSE: Final = 1e-6
"""Largest relative difference of both optima."""
ABOVE: Final = 1e-5
"""Largest relative distance of the bound of a certificate above the optimum."""
_INSIDE: Final = [["c0r0", "c1r0"], ["c0r0", "c0r1"], ["c1r0", "c1r1"], ["c0r1", "c1r1"]]
SEARCHES: Final[list[dict[str, Any]]] = [
    {"block_cells": [1, 2]},
    {"block_cells": [1, 2], "candidates": "all+supports"},
    {"block_cells": [1, 2], "segmentation": False, "candidates": _INSIDE},
    {"block_cells": [1, 3], "front": {"count": "blocks", "sense": "min"}, "require": {"load_factor": 0.4}},
]
"""Searches that scenes take in turn; certificates know the first one."""
Document = dict[str, Any]


def run(first_seed: int, cases: int, seconds: float) -> Tally:
    """Test the claim on random walls.

    first_seed, cases: seeds ``first_seed`` to ``first_seed + cases - 1`` are tested. seconds: time after which no
    further case begins, s. Returns: number of cases and disagreements.
    """
    return run_cases(CLAIM, case, first_seed, cases, seconds)


def case(seed: int, tally: Tally) -> str:
    """Return "" if the optima of one wall agree, otherwise one line that says how they differ."""
    scene = parse_scene(drawn(seed))
    with tempfile.TemporaryDirectory() as folder:
        out, file = Path(folder), Path(folder) / "proof"
        common: dict[str, Any] = {"pictures": False, "check_fields": 0, "seconds": 60.0}
        every = explore(scene, out / "every", ExploreSettings(driver="enumeration", **common)).summary
        certificate = file if seed % len(SEARCHES) == 0 else None
        proof = explore(
            scene, out / "exact", ExploreSettings(driver="exact", certificate=certificate, **common)
        ).summary
        tally.count("members", len(scene.members))
        if not (every.proven and proof.proven):
            tally.count("not proven")
            return ""
        if every.best is None or proof.best is None:
            tally.count("no finite λ")
            return (
                "" if every.best == proof.best else f"seed {seed}: {every.best} by enumeration, {proof.best} by proof"
            )
        if abs(every.best - proof.best) > CLOSE * abs(every.best):
            return f"seed {seed}: {every.best:.9g} by enumeration, {proof.best:.9g} by proof"
        if certificate is not None:
            bound = float(verify(file).claim.bound)
            tally.count("verified")
            if not every.best * (1.0 - CLOSE) <= bound <= every.best * (1.0 + ABOVE):
                return f"seed {seed}: the certificate bounds {bound:.9g}, the optimum is {every.best:.9g}"
    return ""


def drawn(seed: int) -> Document:
    """Return the wall of one seed."""
    rng = np.random.default_rng(seed)
    friction = float(rng.uniform(0.3, 0.8))
    dry: Document = {"friction_coefficient": friction}
    inner: Document = {key: float(rng.uniform(3e3, 1e4)) for key in ("tensile_strength", "shear_strength")}
    if rng.random() < 0.5:
        bond = float(rng.uniform(100.0, 2000.0))
        dry |= {"tensile_strength": bond, "cohesion": bond * friction * float(rng.uniform(1.0, 2.0))}
    if rng.random() < 0.3:
        dry["compressive_strength"] = inner["compressive_strength"] = float(rng.uniform(1e5, 5e5))
    members = [found for _ in range(rng.integers(1, 4)) if (found := _member(rng)) is not None]
    return {
        "name": f"wall {seed}",
        "grid": {"cell": [1, 1], "thickness": 1.0, "rows": ["abc", "def", "###"]},
        "materials": {"density": 1000, "dry": dry, "inner": inner},
        "loads": {"live": [{"body": [float(rng.choice([-1, 1])), 0]}]},
        "members": members,
        "search": SEARCHES[seed % len(SEARCHES)],
    }


def _member(rng: np.random.Generator) -> Document | None:
    """Return a random member; None for one between supports alone."""
    cells = [divmod(int(k), 3) for k in rng.choice(9, 3, replace=False)]
    anchors = [
        {"element": f"c{c}r{r}", "at": [c + float(rng.uniform()), 2 - r + float(rng.uniform())]} for c, r in cells
    ]
    if all(row == 2 for _, row in cells[:2]):
        return None
    found: Document = {"from": anchors[0], "to": anchors[1]}
    kind, force = str(rng.choice(["tie", "tendon", "pin"])), float(rng.uniform(1e3, 2e4))
    if kind == "tie":
        return {**found, "kind": kind, "tension": force, "compression": float(rng.choice([0.0, 0.5 * force]))}
    if kind == "pin":
        return {**found, "kind": kind, "shear": force, "tension": float(rng.choice([0.0, force / 3.0]))}
    more = {"tension": force} if rng.random() < 0.6 else {}
    over = {"through": [anchors[2]]} if rng.random() < 0.5 else {}
    return {**found, "kind": kind, "prestress": 0.25 * force, **more, **over}
