"""Hold the arrays of the time stepping, and the balance of energy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeVar, cast

from jld_core import Bools, Floats, InputError, Ints

# Control of a number of steps: push, share of the dead loads, λ, rate, damping scheme (0 local, 1 viscous, 2 combined)
# and damping. In a push live·velocity follows the rate and λ is its multiplier. Pairs hold first and last step, linear
# between. Damping is the share of the unbalanced force against the velocity; of viscous damping the drag over momentum,
# per step.
Drive = tuple[bool, tuple[float, float], tuple[float, float], tuple[float, float], int, float]

# Entries of `Motion.work`, energies since the first step, scene units: work of the dead loads and of the live loads at
# the reported λ; losses by damping (less what the constraint of a push supplies), friction, plastic flow and brittle
# breaking; what contacts of corners store or lose; and, no sum, the work of contacts in the half step of the velocities
DEAD, LIVE, DAMPING, FRICTION, FLOW, FRACTURE, CORNERS, HALF = range(8)


class Bench(NamedTuple):
    """Constant arrays of the time stepping: n elements, m faces, s sub-contacts, q freedoms."""

    # dead, live: (n, q) forces, then moments about the centroid, of the dead loads and of the live loads at λ = 1
    dead: Floats
    live: Floats
    inverse: Floats  # (n, 2) inverse of mass and inertia, scaled to a time step of one; 0 on supports
    radius: Floats  # (n,) length by which moments are divided to compare them with forces
    ends: Ints  # (m, 2) elements a and b
    # (m, 6) planar: normal n (x, y), then r × n and r × t for the arm r from a and from b to the centre of the face.
    # Spatial: normal, e1, e2, and the arms from a and from b.
    frame: Floats
    first: Ints  # (m + 1,) position of the first sub-contact of each face
    place: Floats  # (s, d) coordinates along the face, and area
    # (m, 8) law of each face: two springs, friction, dilation, three strengths, residual friction, in the order of
    # `Law`
    law: Floats
    brittle: Bools  # (m,) True for faces that lose a strength that is exceeded
    gaps: Bools  # (m,) True for joints whose gaps stay open
    dry: Bools  # (m,) True for dry faces


class Motion(NamedTuple):
    """Arrays of an assembly that every time step changes in place, in scene units."""

    # moved, velocity: (n, q) displacements and rotations of the elements, and their change per time step
    moved: Floats
    velocity: Floats
    # overlap, pressure: (s,) elastic overlap (length) and compressive stress of sub-contacts
    overlap: Floats
    pressure: Floats
    shear: Floats  # (s, d − 1) shear stress of sub-contacts
    broken: Bools  # (s,) True for broken sub-contacts
    before: Floats  # (n, q) unbalanced forces of the step before, for combined damping
    work: Floats  # (8,) energies since the first step, entries as `DEAD` and following


@dataclass(frozen=True)
class EnergyBalance:
    """Energies from the unloaded structure to a state, scene units, each computed on its own."""

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
    """Return a function of arrays and numbers that numba compiles at its first call."""
    # No fast-math, so that runs are bitwise equal. The cache on disk depends on all sources of the package: numba alone
    # checks the file of the function and would keep outdated code of others.
    made: Any = numba.njit(cache=True, error_model="numpy")(function)
    made._cache._cache_file._source_stamp = _SOURCES
    return cast(F, made)
