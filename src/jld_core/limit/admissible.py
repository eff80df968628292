"""Define admissible states and motions: forces and velocities, with the bounds on λ that they prove."""

from __future__ import annotations

from dataclasses import dataclass

from jld_core.arrays import Floats


@dataclass(frozen=True)
class State:
    """Forces and λ of one labelling, with their slack and their equilibrium error.

    Attributes
    ----------
    forces : (m, q) float array
        Resultants of each face, scaled.
    load : float
        λ, scaled.
    slack : float
        Least slack over all yield rows, scaled; of a ray, over the recession cones.
    error : float
        Estimate of the force error left in equilibrium, scaled.
    """

    forces: Floats
    load: float
    slack: float
    error: float

    @property
    def admissible(self) -> bool:
        """Return True if the exact solution next to the rounded forces lies in every yield set."""
        return self.slack >= 2.0 * self.error


@dataclass(frozen=True)
class Motion:
    """Velocities of all free elements, with the upper bound on λ that they prove.

    Attributes
    ----------
    velocity : (q·free,) float array
        Velocities, scaled.
    jumps : (m, q) float array
        Velocity jumps of the faces, scaled.
    work : float
        Work b_λ·u of the live load, scaled.
    margin : float
        Least margin of the conditions for finite dissipation; the bound holds if it is ≥ 0.
    bound : float
        Dissipation minus dead work, Σ D(J) − b·u, scaled.
    noise : float
        Rounding error that the bound may contain.
    """

    velocity: Floats
    jumps: Floats
    work: float
    margin: float
    bound: float
    noise: float = 0.0
