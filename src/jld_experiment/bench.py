"""Hold the arrays of the time stepping, and the balance of energy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeVar, cast

from jld_core.arrays import Bools, Floats, Ints
from jld_core.errors import InputError

Drive = tuple[bool, tuple[float, float], tuple[float, float], tuple[float, float], int, float]
"""Control of a number of steps: push, share of the dead loads, λ, rate, damping scheme and damping.

If `push` is True, live·velocity follows the rate and λ is the multiplier of this constraint; else λ is given.
Shares, λ and rates are pairs: first and last step, linear between.
Damping schemes are 0 local, 1 viscous and 2 combined, see `Settings.damping_scheme`. Damping is the share of the
unbalanced force that acts against the velocity; of viscous damping it is the drag over momentum, per time step.
Forces and moments are damped separately, so that no direction is preferred.
"""

DEAD, LIVE, DAMPING, FRICTION, FLOW, FRACTURE, CORNERS, HALF = range(8)
"""Entries of `Motion.work`, energies since the first step, in scene units.

Work of the dead loads, and of the live loads at the reported λ. Losses: damping (less what the constraint of a push
supplies against it), friction (dry joints and cracks), plastic flow of inner faces, brittle breaking, and what contacts
of corners store or lose. The last is no sum: the work of all contacts in the half step to which velocities belong.
"""


class Bench(NamedTuple):
    """Constant arrays of the time stepping, for n elements, m faces and s sub-contacts.

    There are q freedoms per element: 3 in the plane (d = 2) and 6 in space (d = 3). All numbers are in scene units.
    """

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
    """Arrays of an assembly that every time step changes in place, in scene units.

    Attributes
    ----------
    moved, velocity : (n, q) float array
        Displacements and rotations of the elements, and their change per time step.
    overlap, pressure : (s,) float array
        Elastic overlap (length) and compressive stress of sub-contacts.
    shear : (s, d − 1) float array
        Shear stress of sub-contacts.
    broken : (s,) bool array
        True for broken sub-contacts.
    before : (n, q) float array
        Unbalanced forces of the step before, for combined damping.
    work : (8,) float array
        Energies since the first step, see `DEAD`.
    """

    moved: Floats
    velocity: Floats
    overlap: Floats
    pressure: Floats
    shear: Floats
    broken: Bools
    before: Floats
    work: Floats


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
