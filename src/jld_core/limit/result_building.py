"""Build results from proofs, and the governing result from those of load cases."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.limit.brackets import load_scale, relative_width
from jld_core.limit.governing import CaseBounds, governing
from jld_core.limit.member_results import without_idle
from jld_core.limit.options import SolveOptions
from jld_core.limit.proof import Proof
from jld_core.limit.result import LimitAnalysisResult
from jld_core.limit.status import Status
from jld_core.program import Template


def result_of(
    template: Template, labels: Bits, options: SolveOptions, proof: Proof, *, assemble: float = 0.0, elapsed: float
) -> LimitAnalysisResult:
    """Convert a proof about the assembly of a template to a result in scene units.

    Parameters
    ----------
    template : Template
        Template of the proof; supplies the assembly and the scaling.
    labels : (m,) bool array
        Labels, True = dry.
    options : SolveOptions
        Options to record in the result.
    proof : Proof
        Bounds and status, scaled.
    assemble : float
        Seconds spent on building the analysis.
    elapsed : float
        Seconds since then.

    Returns
    -------
    LimitAnalysisResult
        The result, scene units.
    """
    scaling, (low, high), status = template.scaling, proof.bracket, proof.status
    scale = load_scale(template.assembly) / scaling.load
    held, motion = proof.found or proof.state, proof.motion
    forces = None if held is None or status is Status.UNSTABLE else _scene(template, held.forces)
    moves = motion is not None and status not in (Status.UNSTABLE, Status.LOCKED)
    mechanism = element_velocities(template, motion.velocity) if motion is not None and moves else None
    width = relative_width(low, high, scale)
    nothing = status in (Status.UNSTABLE, Status.LOCKED)
    ray = proof.ray if status is Status.LOCKED else None
    return LimitAnalysisResult(
        assembly=template.assembly,
        labels=labels,
        status=status,
        load_factor=proof.load_factor * scaling.load,
        bracket=(low * scaling.load, high * scaling.load),
        gap=math.nan if nothing else width,
        stands_at_zero=proof.stands,
        forces=forces,
        mechanism=mechanism,
        iterations=proof.solves,
        solve_log=tuple(proof.solve_log),
        seconds={"assemble": assemble, "solve": proof.seconds, "total": assemble + elapsed},
        model=options,
        facts=proof.extra,
        notes=tuple(proof.notes),
        instability_mechanism=_instability_mechanism(template, proof),
        unbounded_forces=None if ray is None else _scene(template, ray.forces, ray=True),
    )


def _scene(template: Template, forces: Floats, *, ray: bool = False) -> Floats:
    """Convert scaled resultants (m, q) to scene units, and subtract the bond from normal forces.

    Resultants of members that cannot occur become zero, see `without_idle`. ray: True for forces that grow with λ; no
    bond is subtracted from these.
    """
    assembly = template.assembly
    if ray and assembly.members.bond is not None:
        assembly = replace(assembly, members=replace(assembly.members, bond=None))
    return without_idle(assembly, forces * template.scaling.face)


def _instability_mechanism(template: Template, proof: Proof) -> Floats | None:
    """Return the velocities (n, q) that prove an instability, scaled to a largest value of 1.

    That value is the largest displacement, or the largest rotation if nothing is displaced. The result is None if the
    proof has no such velocities.
    """
    motion = proof.collapse_below_zero or proof.motion
    if proof.status is not Status.UNSTABLE or motion is None:
        return None
    velocity = element_velocities(template, motion.velocity)
    d = template.assembly.dimension
    largest = float(np.linalg.norm(velocity[:, :d], axis=1).max()) or float(abs(velocity).max())
    return velocity / largest if largest > 0.0 else None


def governing_result(assembly: Assembly, cases: dict[str, LimitAnalysisResult]) -> LimitAnalysisResult:
    """Combine the results of load cases into the result of the structure.

    Parameters
    ----------
    assembly : Assembly
        Structure with load cases; supplies the required factors.
    cases : dict of str to LimitAnalysisResult
        Result of each case by name, in the order of the assembly's cases.

    Returns
    -------
    LimitAnalysisResult
        Governing factor with its bracket; forces and mechanism are those of the governing case.
    """
    found = list(cases.values())
    known = [CaseBounds(one.status, *one.bracket, one.load_factor) for one in found]
    decided = governing(known, assembly.required.tolist())
    first = found[decided.case]
    scale = max(1e-300, load_scale(first.assembly) / float(assembly.required[decided.case]))
    width = relative_width(decided.low, decided.high, scale)
    stands = [one.stands_at_zero for one in found]
    ends = [[end / factor for end in one.least_bracket] for one, factor in zip(found, assembly.required, strict=True)]
    least = (float(np.max([low for low, _ in ends])), float(np.max([high for _, high in ends])))
    return replace(
        first,
        assembly=assembly,
        status=decided.status,
        load_factor=decided.load_factor,
        bracket=(decided.low, decided.high),
        gap=math.nan if decided.status in (Status.UNSTABLE, Status.LOCKED) else width,
        stands_at_zero=False if False in stands else None if None in stands else True,
        iterations=sum(one.iterations for one in found),
        seconds={key: sum(one.seconds[key] for one in found) for key in first.seconds},
        cases=cases,
        least_bracket=least,
        governing=list(cases)[decided.case],
    )


def element_velocities(template: Template, velocity: Floats) -> Floats:
    """Convert scaled velocities of the free elements to scene units with b_λ·u = 1.

    template: supplies the assembly and the scaling. velocity: (q·free,) scaled velocities with scaled live work 1.
    Returns (n, q): velocities about the centroids of all elements, scene units; zero for supports.
    """
    assembly, scaling = template.assembly, template.scaling
    full = np.zeros((len(assembly.elements), assembly.freedoms))
    free = scaling.load * velocity / scaling.row.ravel()
    full[assembly.elements.free] = free.reshape(-1, assembly.freedoms)
    return full
