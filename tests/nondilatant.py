"""What tests of collapse without dilation share: the evidence of a solution, and a block between walls."""

from __future__ import annotations

from typing import Any

import numpy as np

from cases import ROUTE
from jld_core import Assembly, LimitAnalysisResult, build_assembly, parse_scene
from jld_core.limit.mechanism import face_jumps
from jld_core.mechanics import equilibrium_matrix, load_vectors


def certify(result: LimitAnalysisResult) -> None:
    """All that docs/method.md (4.3) to (4.5) ask of a planar solution, from its own forces and mechanism alone."""
    assembly = result.assembly
    assert result.forces is not None
    assert result.mechanism is not None
    assert result.facts["converged"]
    dead, live = load_vectors(assembly)
    forces, dry = result.forces, result.labels
    left = equilibrium_matrix(assembly) @ forces.ravel() + dead + result.load_factor * live
    assert abs(left).max() <= 1e-9 * max(abs(forces).max(), assembly.total_dead)
    n, v, m = forces.T
    friction, half = assembly.strengths(ROUTE).friction, 0.5 * assembly.interfaces.l1
    largest = n.max()
    assert np.max((abs(v) - friction * n)[dry], initial=0.0) <= 1e-4 * largest
    assert np.max((abs(m) - half * n)[dry], initial=0.0) <= 1e-9 * largest
    opening, slip, turn = face_jumps(assembly, result.mechanism).T
    beyond = opening - half * abs(turn)
    assert beyond[dry].min(initial=0.0) >= -1e-9 * abs(slip).max()
    pressed = dry & (n > 1e-6 * largest)
    assert beyond[pressed].max(initial=0.0) <= 1e-6 * abs(slip).max() or abs(slip).max() < 1e-6 * abs(turn).max()
    gap = n * opening + m * turn + friction * n * abs(slip) + v * slip
    assert gap[dry].min(initial=0.0) >= -1e-4 * largest * abs(slip).max()
    if dry.all():
        dissipated = float((friction * n * abs(slip)).sum())
        assert gap.sum() <= 1e-3 * max(dissipated, 1e-6 * assembly.total_dead)
    assert abs(result.bracket[1] - result.bracket[0]) <= 1e-6 * abs(result.load_factor)


def block(friction: float, live: list[dict[str, Any]], dead: list[dict[str, Any]], walls: int) -> Assembly:
    """A unit cube of weight 1 on the ground, with a fixed wall to the right (1) or on both sides (2)."""
    boxes = {"block": (0, 1, 0, 1), "ground": (-2, 3, -1, 0), "right": (1, 2, 0, 2), "left": (-1, 0, 0, 2)}
    elements = [
        {"id": name, "polygon": [[x0, y0], [x1, y0], [x1, y1], [x0, y1]], "support": name != "block"}
        for name, (x0, x1, y0, y1) in list(boxes.items())[: 2 + walls]
    ]
    materials = {"density": 1.0, "gravity": 1.0, "dry": {"friction_coefficient": friction}}
    return build_assembly(
        parse_scene({"elements": elements, "materials": materials, "loads": {"live": live, "dead": dead}})
    )
