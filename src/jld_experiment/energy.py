"""Hold the balance of energy of an experiment."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any, Final, TypeVar, cast

from jld_core.errors import InputError


@dataclass(frozen=True)
class EnergyBalance:
    """Energies from the unloaded structure to a state, in scene units of work.

    The work of the loads equals kinetic and elastic energy and all losses. Each is computed on its own: none is what
    the others leave.
    """

    # dead, live: work of the dead loads, and of the live loads at the reported λ
    dead: float
    live: float
    damping: float  # energy lost by damping, less what the constraint of a push supplies against it
    friction: float  # energy lost by sliding and crushing of dry joints and cracks
    flow: float  # energy lost by plastic flow of inner faces
    fracture: float  # elastic energy released by brittle breaking
    corners: float  # energy that contacts of corners store or lose
    # kinetic, elastic: kinetic energy, and elastic energy of the sub-contacts
    kinetic: float
    elastic: float

    @property
    def residual(self) -> float:
        """Work of the loads that is neither stored nor lost; the error of the time steps."""
        return float(self.dead + self.live - sum(astuple(self)[2:]))

    @property
    def turnover(self) -> float:
        """Energy that changed hands: half the sum of all parts by size."""
        return float(0.5 * sum(abs(part) for part in (*astuple(self), self.residual)))

    @property
    def error(self) -> float:
        """Residual over `turnover`, at least 0; 0 without any load."""
        return abs(self.residual) / self.turnover if self.turnover > 0.0 else 0.0


try:
    import numba
except ImportError as error:  # Name the missing optional dependency.
    raise InputError("jld_experiment", "numba is not installed", "pip install 'jld[experiment]'") from error

F = TypeVar("F", bound=Callable[..., object])

# Name, time and size of all source files of the package, which identify the cached code
_SOURCES: Final = tuple(
    (path.name, path.stat().st_mtime, path.stat().st_size) for path in sorted(Path(__file__).parent.glob("*.py"))
)


def compiled(function: F) -> F:
    """Return a function of arrays and numbers that numba compiles at its first call.

    There is no fast-math, so two runs of one experiment are bitwise equal. The machine code is cached on disk. The
    cache depends on the sources of the whole package: numba alone checks only the file of the function and would keep
    outdated code of other files. Importing this module raises InputError where numba is not installed.
    """
    made: Any = numba.njit(cache=True, error_model="numpy")(function)
    made._cache._cache_file._source_stamp = _SOURCES
    return cast(F, made)
