"""Define the law of a sub-contact: springs, Mohr–Coulomb with dilation, brittle strength."""

from __future__ import annotations

from jld_core.arrays import Floats
from jld_experiment.bench import FLOW, FRACTURE, FRICTION
from jld_experiment.compiled import compiled

Law = tuple[float, float, float, float, float, float, float, float]
"""Row of `law` for one face: kn, ks, friction, dilation, cohesion, tension, crushing, residual friction."""


@compiled
def numbers_of(law: Floats, f: int) -> Law:
    """Return row f of the laws (m, 8) as a tuple of numbers, as `sub_contact` takes it."""
    return (law[f, 0], law[f, 1], law[f, 2], law[f, 3], law[f, 4], law[f, 5], law[f, 6], law[f, 7])


@compiled
def sub_contact(
    overlap: float, size: float, law: Law, brittle: bool, gaps: bool, broken: bool
) -> tuple[float, float, float, bool]:
    """Return overlap, compressive stress, shear stress and broken state after a trial step.

    A brittle sub-contact breaks if it exceeds its tension or shear strength. Afterwards it has residual friction alone.

    overlap: elastic overlap of the trial, length; negative if apart. size: shear stress of the trial, ≥ 0. law: row of
    `numbers_of`; passing an array costs more time than this function. brittle, gaps: properties of the face, see
    `Bench`. broken: state before the step.
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
def record_loss(
    work: Floats,
    law: Law,
    area: float,
    face: tuple[bool, bool, bool],
    start: tuple[float, float],
    trial: tuple[float, float],
    final: tuple[float, float],
) -> None:
    """Add the energy lost from an elastic trial to the final stress to `Motion.work`.

    It is the mean stress of the step times the plastic jump, which is (trial − final)/stiffness. Sliding with a
    dilation equal to friction therefore loses nothing without cohesion. A gap that opens without tension loses nothing.
    A brittle break loses the elastic energy at the beginning, plus the work of the step, less the elastic energy at the
    end.

    law: row of `numbers_of`. area: of the sub-contact. face: whether the face is dry, and whether the sub-contact was
    broken before and after the step. start, trial, final: compressive stress and shear stress along that of the trial,
    before the step, of the trial, and after the step.
    """
    dry, was, broken = face
    breaks = broken and not was
    lost = 0.5 * (start[1] + final[1]) * (trial[1] - final[1]) / law[1]
    if breaks or final[0] != 0.0:
        lost += 0.5 * (start[0] + final[0]) * (trial[0] - final[0]) / law[0]
    if breaks:
        work[FRACTURE] += area * lost
    elif dry or broken:
        work[FRICTION] += area * lost
    else:
        work[FLOW] += area * lost


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
    """Return a sub-contact from an elastic trial to its yield surface, per unit of area.

    The return is the closest point in the elastic energy where dilation equals friction. With compressive stress p and
    shear stress q it maps p ↦ p + kn ψ γ and |q| ↦ |q| − ks γ, where γ = (|q| − c − μp) / (ks + μ ψ kn) is the slip and
    c the cohesion. At the corner p = −σt (σt: tension) the shear stress is limited to |q| ≤ c − μσt.

    overlap: elastic overlap of the trial, length; negative if apart. size: shear stress |q| of the trial, ≥ 0. kn, ks:
    springs, stress per length. friction: friction coefficient μ. dilation: tangent ψ of the dilation angle, opening per
    slip while sliding. cohesion, tension, crushing: strengths ≥ 0. gaps: True if an opened gap stays open on reversal;
    False if opening is plastic. Result: overlap, compressive stress and size of the shear stress.
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
