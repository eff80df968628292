"""One call from an assembly to a result: which model is solved, and by which way.

Only what is asked for is modelled: point contacts, kern bending, effective areas and zero dilation each have
their own module and cost nothing where they are not wanted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from jld_core import tolerances
from jld_core.arrays import Bits
from jld_core.assembly import Assembly
from jld_core.errors import InputError
from jld_core.limit import LimitAnalysis, LimitAnalysisResult, Status, apart
from jld_core.mechanics import require_materials, scaling_of, spatial_yield
from jld_core.models.effective_area import solve_effective_area
from jld_core.models.point_contacts import point_contact_assembly, resultants_of_faces
from jld_core.models.rigid_blocks import solve_condensed, worth_condensing
from jld_core.models.zero_dilation import zero_dilation
from jld_core.models.zero_dilation_search import Scheme
from jld_core.program import Template
from jld_core.solvers import is_large


@dataclass(frozen=True)
class SolveOptions:
    """What is modelled, as on the command line; spatial choices change nothing in planar scenes.

    friction: "associative", or "zero-dilation" (sliding without uplift, not unique, see zero_dilation.py). range: of
    zero dilation the lowest and the highest λ that are found.
    contact: "convex" (resultants at the centre of pressure) or "concave" (point contacts at the corners of dry
    faces). effective_area: torsion about the area that is really pressed, by iteration. inner_bending: "paper"
    (uncoupled) or "kern" (elastic edge stress). condense: rigid blocks, cracked on demand ("auto": where inner
    faces are very strong). solver: route by name. gap: width of the bracket above which a result is uncertified.
    """

    friction: Literal["associative", "zero-dilation"] = "associative"
    range: bool = False
    contact: Literal["convex", "concave"] = "convex"
    effective_area: bool = False
    inner_bending: Literal["paper", "kern"] = "paper"
    condense: Literal["auto", "on", "off"] = "auto"
    solver: str = "auto"
    gap: float = tolerances.GAP


def solve(assembly: Assembly, labels: Bits | None = None, **options: Any) -> LimitAnalysisResult:
    """Collapse load factor of one labelling, with a two-sided bracket.

    assembly: planar or spatial. labels: (m,) True dry; default the scene's own. options: fields of `SolveOptions`.
    Raises InputError where a material that the labelling needs is missing, or an option has no such value.
    Source: Iannuzzo et al. 2024, eq. (2); docs/method.md (2.1), (3.3).
    """
    model = SolveOptions(**options)
    _check(model)
    own = assembly.labels if labels is None else np.asarray(labels, dtype=bool)
    require_materials(assembly, own, ~own)
    if assembly.dimension == 3 and model.contact == "concave":
        points, parent = point_contact_assembly(assembly, own)
        found = _solved(limit_analysis(points, model, reference=points.labels), points.labels, model)
        forces = None if found.forces is None else resultants_of_faces(assembly, points, parent, found.forces)
        return replace(found, assembly=assembly, labels=own, forces=forces, contact="concave")
    return replace(_solved(limit_analysis(assembly, model, reference=own), own, model), contact=model.contact)


def _check(model: SolveOptions) -> None:
    """Raise InputError for options that have no such value, or that do not go together."""
    for key, allowed in (
        ("friction", ("associative", "zero-dilation")),
        ("contact", ("convex", "concave")),
        ("inner_bending", ("paper", "kern")),
        ("condense", ("auto", "on", "off")),
    ):
        value = getattr(model, key)
        if value not in allowed:
            option = key.replace("_", "-")
            raise InputError(f"--{option}", f"no {key.replace('_', ' ')} is named {value!r}", " or ".join(allowed))
    if model.range and model.friction != "zero-dilation":
        raise InputError("--range", "λ of associative friction is one number", "--friction zero-dilation with it")
    if model.effective_area and model.contact == "concave":
        raise InputError("--effective-area", "points have no area", "--contact convex with it")


def _solved(analysis: LimitAnalysis, labels: Bits, model: SolveOptions) -> LimitAnalysisResult:
    if model.friction == "zero-dilation":
        return zero_dilation(analysis, labels, Scheme(effective_area=model.effective_area), range=model.range)
    if model.effective_area:
        return solve_effective_area(analysis, labels)
    found = None
    if model.condense == "on" or (model.condense == "auto" and worth_condensing(analysis.template, labels)):
        found = solve_condensed(analysis, labels)
    if found is not None:
        return found
    # strengths far above some loads: blocks that are rigid in fact leave no rounding in their cracks
    joined = model.condense == "auto" and not labels.all()
    large = joined and is_large(analysis.template.structure)  # where repairs take longer than rigid blocks do
    found = analysis.solve(labels, harder=not large)
    if found.status is Status.UNCERTIFIED and joined:
        rigid = solve_condensed(analysis, labels)
        if rigid is not None and rigid.status is not Status.UNCERTIFIED:
            if not apart(rigid.bracket, found.bracket):
                return rigid
            rigid = None
        found = analysis.solve(labels) if large else rigid or found
    return found


def limit_analysis(assembly: Assembly, model: SolveOptions, reference: Bits | None = None) -> LimitAnalysis:
    """A limit analysis of an assembly under convex contact, for any number of labellings."""
    template = None
    if assembly.dimension == 3 and model.inner_bending != "paper":
        scaling = scaling_of(assembly)
        template = Template(assembly, scaling, spatial_yield(assembly, scaling, model.inner_bending))
    return LimitAnalysis(assembly, solver=model.solver, gap=model.gap, reference=reference, template=template)
