"""One call from an assembly to a result: which model is solved, and by which way.

Only what is asked for is modelled: point contacts, kern bending, effective areas and zero dilation each have
their own module and cost nothing where they are not wanted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from jld_core import tolerances
from jld_core.assembly import Assembly, Bits
from jld_core.condense import solve_condensed, worth_condensing
from jld_core.errors import InputError
from jld_core.limit import LimitAnalysis
from jld_core.point_contacts import point_contact_assembly, resultants_of_faces
from jld_core.program import Template
from jld_core.result import LimitAnalysisResult
from jld_core.scaling import scaling_of
from jld_core.yield_sets import require_materials
from jld_core.yield_spatial import spatial_yield


@dataclass(frozen=True)
class Model:
    """What is modelled, as on the command line; spatial choices change nothing in planar scenes.

    contact: "convex" (resultants at the centre of pressure) or "concave" (point contacts at the corners of dry
    faces). inner_bending: "paper" (uncoupled) or "kern" (elastic edge stress). condense: rigid blocks, cracked
    on demand ("auto": where inner faces are very strong). solver: route by name. gap: width of the bracket above
    which a result is uncertified.
    """

    contact: Literal["convex", "concave"] = "convex"
    inner_bending: Literal["paper", "kern"] = "paper"
    condense: Literal["auto", "on", "off"] = "auto"
    solver: str = "clarabel"
    gap: float = tolerances.GAP


def solve(assembly: Assembly, labels: Bits | None = None, **options: Any) -> LimitAnalysisResult:
    """Collapse load factor of one labelling with associative friction, with a two-sided bracket.

    assembly: planar or spatial. labels: (m,) True dry; default the scene's own. options: fields of `Model`.
    Raises InputError where a material that the labelling needs is missing, or an option has no such value.
    Source: Iannuzzo et al. 2024, eq. (2); METHOD §2–3.
    """
    model = Model(**options)
    choices = (
        ("contact", ("convex", "concave")),
        ("inner_bending", ("paper", "kern")),
        ("condense", ("auto", "on", "off")),
    )
    for key, allowed in choices:
        if getattr(model, key) not in allowed:
            raise InputError(
                f"--{key.replace('_', '-')}",
                f"no {key} is named {getattr(model, key)!r}",
                " or ".join(allowed),
            )
    own = assembly.labels if labels is None else np.asarray(labels, dtype=bool)
    require_materials(assembly, own, ~own)
    if assembly.dimension == 3 and model.contact == "concave":
        return _concave(assembly, own, model)
    analysis = limit_analysis(assembly, model, reference=own)
    found = None
    if model.condense == "on" or (model.condense == "auto" and worth_condensing(analysis.template, own)):
        found = solve_condensed(analysis, own)
    return replace(found or analysis.solve(own), contact=model.contact)


def limit_analysis(assembly: Assembly, model: Model, reference: Bits | None = None) -> LimitAnalysis:
    """A limit analysis of an assembly under convex contact, for any number of labellings."""
    template = None
    if assembly.dimension == 3 and model.inner_bending != "paper":
        scaling = scaling_of(assembly)
        template = Template(assembly, scaling, spatial_yield(assembly, scaling, model.inner_bending))
    return LimitAnalysis(assembly, solver=model.solver, gap=model.gap, reference=reference, template=template)


def _concave(assembly: Assembly, labels: Bits, model: Model) -> LimitAnalysisResult:
    """Point contacts at the corners of every dry face, the resultants brought back to the faces (METHOD §2)."""
    points, parent = point_contact_assembly(assembly, labels)
    found = limit_analysis(points, model, reference=points.labels).solve(points.labels)
    forces = None if found.forces is None else resultants_of_faces(assembly, points, parent, found.forces)
    return replace(found, assembly=assembly, labels=labels, forces=forces, contact="concave")
