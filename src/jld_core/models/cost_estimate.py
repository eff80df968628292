"""What one labelling costs, from the size of its assembly: said before it is begun, refused where it cannot be done.

Measured by benchmarks/growth.py and benchmarks/scale.py on one core. By the labelling it is a fifth (walls, all dry) or
several times of that (random blocks of strong material).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from jld_core.assembly import Assembly
from jld_core.errors import InputError
from jld_core.memory import memory_limit

_FACES: Final = 2e4
"""Faces of the assembly that `_COSTS` speaks of."""

_COSTS: Final = {2: (40.0, 1.35, 1.5e4), 3: (100.0, 1.5, 3.5e4)}
"""By dimension: seconds at `_FACES` faces, exponent of the number of faces, bytes of a face."""

_BASE: Final = 1.5e8
"""Bytes of Python and its libraries."""

LONG: Final = 5.0
"""Seconds of one evaluation from which they are said beforehand."""


@dataclass(frozen=True)
class CostEstimate:
    """What one labelling takes. seconds: of one core; memory: bytes of one process."""

    seconds: float
    memory: float

    @property
    def long(self) -> str | None:
        """What is said beforehand, where a labelling takes long; else None."""
        if self.seconds <= LONG:
            return None
        few = f"{self.seconds:.0f} s" if self.seconds < 100.0 else f"{self.seconds / 60.0:.0f} min"
        return f"one layout of this size is expected to take some {few} to evaluate"


def cost_estimate(assembly: Assembly) -> CostEstimate:
    """What one labelling of an assembly is expected to take, all its load cases together."""
    seconds, power, each = _COSTS[assembly.dimension]
    faces = len(assembly.interfaces)
    return CostEstimate(len(assembly.by_case) * seconds * (faces / _FACES) ** power, _BASE + each * faces)


def require_memory(assembly: Assembly) -> CostEstimate:
    """What one labelling is expected to take. Raises InputError where there is less memory than that."""
    effort, most = cost_estimate(assembly), memory_limit()
    if effort.memory > most:
        raise InputError(
            "",
            f"{len(assembly.interfaces)} faces take some {effort.memory / 1e9:.1f} GB of memory to evaluate",
            f"a scene that the {most / 1e9:.1f} GB there are suffice for",
        )
    return effort
