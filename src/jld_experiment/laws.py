"""What one sub-contact does: springs, Mohr–Coulomb with dilation, tension and cohesion plastic or brittle."""

from __future__ import annotations

from jld_core.arrays import Floats
from jld_experiment.compiled import compiled

Law = tuple[float, float, float, float, float, float, float, float]
"""Columns of `law`, one row a face: springs kn and ks, friction, dilation, cohesion, tension, crushing, residual."""


@compiled
def numbers_of(law: Floats, f: int) -> Law:
    """Row f of `law`."""
    return (law[f, 0], law[f, 1], law[f, 2], law[f, 3], law[f, 4], law[f, 5], law[f, 6], law[f, 7])


@compiled
def sub_contact(
    overlap: float, size: float, law: Law, brittle: bool, gaps: bool, broken: bool
) -> tuple[float, float, float, bool]:
    """What one carries after an elastic trial: overlap, compressive stress, size of the shear stress, is it broken.

    overlap, size: of the trial, see `contact_stress`. law: of its face, as numbers: arrays that are handed on count
    their references, which takes longer than all that is done here. broken: was it before? A brittle one that exceeds
    its tension or cohesion is now.
    """
    kn, ks, mu, psi, cohesion, tension, crushing, residual = law
    p = kn * overlap
    if broken:
        mu, psi, cohesion, tension = residual, 0.0, 0.0, 0.0
    failing = p < -tension or size > cohesion + mu * p
    if failing or p > crushing:
        if failing and brittle and not broken:
            broken = True
            mu, psi, cohesion, tension = residual, 0.0, 0.0, 0.0
        overlap, p, size = contact_stress(overlap, size, kn, ks, mu, psi, cohesion, tension, crushing, gaps or broken)
    return overlap, p, size, broken


@compiled
def contact_stress(
    overlap: float,
    size: float,
    kn: float,
    ks: float,
    friction: float,
    dilation: float,
    cohesion: float,
    tension: float,
    crushing: float,
    gaps: bool,
) -> tuple[float, float, float]:
    """Return of one sub-contact from an elastic trial to its yield surface, per unit of area.

    overlap: elastic overlap of the trial, length (negative: apart). size: shear stress of the trial, ≥ 0. kn, ks:
    springs, stress per length. friction: μ. dilation: tan of its angle, opening per slip where it slides. cohesion,
    tension, crushing: stresses ≥ 0. gaps: is what has opened still open when the movement turns back (True), or
    plastic like everything else (False). Returns overlap, compressive stress and size of the shear stress.

    The return is the closest point in the elastic energy where dilation equals friction: p ↦ p + kn ψ γ and
    |q| ↦ |q| − ks γ with γ = (|q| − c − μp) / (ks + μ ψ kn), or the corner p = −σt, |q| ≤ c − μσt.
    """
    p = kn * overlap
    if p > crushing:
        p = crushing
        overlap = p / kn
    over = size - cohesion - friction * p
    if over > 0.0:
        gamma = over / (ks + friction * dilation * kn)
        raised = p + kn * dilation * gamma
        if raised >= -tension and ks * gamma <= size:
            return overlap + dilation * gamma, raised, size - ks * gamma
    if p >= -tension:
        return overlap, p, min(size, max(cohesion + friction * p, 0.0))
    if not gaps:
        overlap = -tension / kn
    return overlap, -tension, min(size, max(cohesion - friction * tension, 0.0))
