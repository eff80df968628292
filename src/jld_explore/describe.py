"""Words for the terminal: what will be modelled, what came out."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from jld_core.assembly import Assembly
from jld_core.program import Template
from jld_core.result import LimitAnalysisResult
from jld_core.scene import Scene
from jld_explore.candidates import SearchSpace

if TYPE_CHECKING:
    from jld_explore.explore import Exploration


def assembly(scene: Scene, found: Assembly, space: SearchSpace) -> str:
    """What `jld check` prints: dimension, counts, loads, program size, candidates, symmetries."""
    elements, faces = found.elements, found.interfaces
    length, force = found.units
    structure = Template(found).structure
    dry = int(np.count_nonzero(found.labels))
    kind = "second-order cone program" if structure.cones else "linear program"
    spots = int(np.count_nonzero(space.candidates))
    lines = [
        f"scene        {scene.name}",
        f"dimension    {'planar' if found.dimension == 2 else 'spatial'}",
        f"elements     {len(elements)}: {len(elements.free)} free, {int(elements.support.sum())} supports",
        f"interfaces   {len(faces)}: {dry} dry, {len(faces) - dry} inner in the scene's own labelling",
        f"dead load    {found.total_dead:.6g} {force} in total",
        f"live load    {found.total_live:.6g} {force} in total, times λ",
        f"program      {kind}, {structure.shape[1]} unknowns, {structure.equalities} equations, "
        f"{structure.linear - 1} inequalities, {len(structure.cones)} cones",
        f"size         {found.size:.6g} {length}",
        f"candidates   {spots} of {len(faces)} faces may be dry or inner",
        f"symmetries   {len(space.group)} (with the identity)",
    ]
    return "\n".join(lines)


def result(found: LimitAnalysisResult) -> str:
    """What `jld solve` prints."""
    low, high = found.bracket
    bracket = " ".join("none" if math.isnan(end) else f"{end:.12g}" for end in (low, high))
    lines = [
        f"status       {found.status}",
        f"λ            {'none' if math.isnan(found.load_factor) else f'{found.load_factor:.12g}'}",
        f"bracket      {bracket}" + ("" if math.isnan(found.gap) else f"   (relative width {found.gap:.1e})"),
        f"stands at 0  {'undecided' if found.stands_at_zero is None else 'yes' if found.stands_at_zero else 'no'}",
        f"route        {', '.join(found.route)}",
        f"seconds      {found.seconds['total']:.3g} ({found.seconds['solve']:.3g} solving)",
    ]
    if found.friction == "zero-dilation":
        extra = found.extra
        lines[3:3] = [
            f"associative  {_shown(extra['associative_load_factor'])} (the only upper bound on every zero-dilation λ)",
            f"evidence     violation {_shown(extra['friction_violation'])}, dilation {_shown(extra['dilation'])}, "
            f"complementarity gap {_shown(extra['complementarity_gap'])}, "
            + ("converged" if extra["converged"] else "not converged"),
        ]
    return "\n".join(lines)


def _shown(value: float | None) -> str:
    return "none" if value is None else f"{value:.6g}"


def exploration(done: Exploration, top: int = 10) -> str:
    """What `jld explore` prints: the best rows, the front, and what is proven."""
    columns = [
        "rank",
        "load_factor",
        "bracket_lo",
        "bracket_hi",
        "dry_faces",
        "blocks",
        "largest_block_cells",
        "labelling",
    ]
    facts = done.summary
    counted = ", ".join(f"{number} {name}" for name, number in facts["counts_by_status"].items())
    best = "none" if facts["best"] is None else f"{facts['best']:.9g}"
    proof = "proven strongest" if facts["proven"] and facts["best"] is not None else "not proven"
    if facts["unbounded"]:
        proof = "but some labellings are locked: they carry any load"
    ranked = done.results[done.results["status"] == "collapse"]
    return "\n".join(
        [
            f"{facts['evaluated']} classes ({facts['labellings']} labellings): {counted}",
            f"stopped      {facts['stop_reason']} after {facts['seconds']:.1f} s, {facts['rate'] or 0.0:.0f} solves/s",
            f"best λ       {best} ({proof})",
            "",
            ranked[columns].head(top).to_string(index=False),
            "",
            f"front        λ against {done.scene.search.front.count} ({done.scene.search.front.sense})",
            done.front[columns].to_string(index=False),
            "",
            f"written to   {done.folder}",
        ]
    )
