"""What a limit analysis returns: λ with its bracket, status, forces and mechanism."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.limit.status import Status
from jld_core.shown import Shown


@dataclass(frozen=True)
class LimitAnalysisResult(Shown):
    """One assembly under one labelling, solved, with proof.

    load_factor: λ, NaN where none. bracket: (lo, hi), NaN where an end is unproven or infinite. gap: relative
    width. labels: (m,). forces: (m, q) resultants in scene units, admissible at `bracket[0]` (planar N, V, M;
    spatial N, V1, V2, M1, M2, MT). mechanism: (n, q) velocities about the centroids with b_λ·u = 1, or None.
    route: what was done, in order. seconds: assemble, solve, total. In a notebook it shows its facts and drawing.
    """

    assembly: Assembly
    labels: Bits
    status: Status
    load_factor: float
    bracket: tuple[float, float]
    gap: float
    stands_at_zero: bool | None
    forces: Floats | None
    mechanism: Floats | None
    iterations: int
    route: tuple[str, ...]
    seconds: dict[str, float]
    friction: str = "associative"
    contact: str = "convex"
    extra: dict[str, Any] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """The object that `jld solve --json` prints: plain numbers, None where there is none."""
        assembly = self.assembly
        ids, faces = assembly.elements.ids, assembly.interfaces
        names = ("N", "V", "M") if assembly.dimension == 2 else ("N", "V1", "V2", "M1", "M2", "MT")
        forces = None
        if self.forces is not None:
            forces = [
                {
                    "elements": [ids[a], ids[b]],
                    "label": "dry" if dry else "inner",
                    **{name: float(value) for name, value in zip(names, row, strict=True)},
                }
                for a, b, dry, row in zip(faces.a, faces.b, self.labels, self.forces, strict=True)
            ]
        mechanism = None
        if self.mechanism is not None:
            mechanism = {name: [float(v) for v in row] for name, row in zip(ids, self.mechanism, strict=True)}
        return {
            "name": assembly.name,
            "load_factor": number(self.load_factor),
            "bracket": [number(end) for end in self.bracket],
            "gap": number(self.gap),
            "status": str(self.status),
            "stands_at_zero": self.stands_at_zero,
            "friction": self.friction,
            "contact": self.contact,
            "dimension": assembly.dimension,
            "elements": len(assembly.elements),
            "interfaces": len(faces),
            "iterations": self.iterations,
            "route": list(self.route),
            "seconds": dict(self.seconds),
            "warnings": list(assembly.warnings),
            **self.extra,
            "mechanism": mechanism,
            "forces": forces,
        }


def number(value: float) -> float | None:
    """A JSON number: None for NaN and infinities."""
    return float(value) if np.isfinite(value) else None
