"""Hold the balance of energy of an experiment."""

from __future__ import annotations

from dataclasses import astuple, dataclass


@dataclass(frozen=True)
class EnergyBalance:
    """Energies from the unloaded structure to a state, in scene units of work.

    The work of the loads equals kinetic and elastic energy and all losses. Each is computed on its own: none is what
    the others leave.

    dead, live: work of the dead loads, and of the live loads at the reported λ. damping: energy lost by damping, less
    what the constraint of a push supplies against it. friction: energy lost by sliding and crushing of dry joints and
    cracks. flow: energy lost by plastic flow of inner faces. fracture: elastic energy released by brittle breaking.
    corners: energy that contacts of corners store or lose. kinetic, elastic: kinetic energy, and elastic energy of the
    sub-contacts.
    """

    dead: float
    live: float
    damping: float
    friction: float
    flow: float
    fracture: float
    corners: float
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
