"""Facts of assemblies and results in words, and advice on results without a load factor."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from jld_core.arrays import Floats
from jld_core.assembly import Assembly
from jld_core.build.plausibility import Resultant, resultant
from jld_core.errors import SolverError
from jld_core.limit import number
from jld_core.limit.analysis import LimitAnalysis
from jld_core.limit.options import Status
from jld_core.limit.result import LimitAnalysisResult, stands_in_words, tensions
from jld_core.loads import resultants
from jld_core.models.tilting import tilt_in_words
from jld_core.program import Template
from jld_core.scene.cracks import cracks_in_words
from jld_core.solvers import installed_solvers, make_solver

_NAMED: Final = 6  # largest number of elements named; the others are counted

_MOVES: Final = 0.05  # share of the largest movement below which an element is not reported as moving

_CARRIES: Final = 1e-3  # share of the largest force below which a face does not count as pressed


def advice(result: LimitAnalysisResult) -> dict[str, str]:
    """Return causes of a result without a load factor ("falls", "confined") and the option to try ("next").

    Empty for several load cases, and where the bracket is as narrow as asked.
    """
    if result.cases:
        return {}
    if result.status is Status.UNSTABLE:
        return _of_unstable(result)
    if result.status is Status.LOCKED:
        return _of_locked(result)
    return {"next": _of_open(result)} if result.reason else {}


def _of_unstable(result: LimitAnalysisResult) -> dict[str, str]:
    """Describe which elements fall and how, and a remedy; keys "falls" and "next"."""
    remedy = {"next": "support what falls, or give its faces friction, a shear strength or an inner label"}
    if result.instability_mechanism is None:
        return {"falls": "it does under any λ ≥ 0; by which motion is not known", **remedy}
    assembly, d = result.assembly, result.assembly.dimension
    speed = result.instability_mechanism[:, :d]
    turning = np.linalg.norm(result.instability_mechanism[:, d:], axis=1) * assembly.size
    size = np.maximum(np.linalg.norm(speed, axis=1), turning)
    moving = np.flatnonzero(size > _MOVES * size.max(initial=0.0))
    moving = moving[np.argsort(-size[moving], kind="stable")]
    motion = _motion_in_words(speed[moving].sum(axis=0), float(turning[moving].sum()))
    words = f"{_list_names([assembly.elements.ids[k] for k in moving])} {motion}, whatever the live load"
    return {"falls": words + "; the motion is in the pictures of --out", **remedy}


def _motion_in_words(speed: Floats, turning: float) -> str:
    """Describe a motion: "turn", or "move along" a direction; speed: (d,) summed velocity of the moving elements."""
    length = float(np.linalg.norm(speed))
    if length < 0.1 * turning:
        return "turn"
    return "move along (" + ", ".join(f"{x:.2g}" for x in speed / length + 0.0) + ")"


def _of_locked(result: LimitAnalysisResult) -> dict[str, str]:
    """Describe the supports between which forces are unbounded, and a remedy."""
    # The keys are "confined", absent without unbounded forces, and "next".
    remedy = {"next": "a compressive_strength of dry and inner faces, which crushing then limits, gives a finite λ"}
    if result.unbounded_forces is None:
        return remedy
    faces, support = result.assembly.interfaces, result.assembly.elements.support
    size = np.linalg.norm(result.unbounded_forces, axis=1)
    pressed = size > _CARRIES * size.max(initial=0.0)
    ends = np.concatenate([faces.a[pressed], faces.b[pressed]])
    names = [result.assembly.elements.ids[k] for k in np.unique(ends[support[ends]])]
    between = "between" if len(names) > 1 else "against"
    words = (
        f"{between} {_list_names(names)}, through {int(pressed.sum())} faces: forces there grow with λ without an end"
    )
    return {"confined": words, **remedy}


def _of_open(result: LimitAnalysisResult) -> str:
    """Name the command-line option that may narrow the bracket, or find the missing bound."""
    if result.friction == "zero-dilation":
        return "--range seeks the lowest and the highest λ from every side, each with its own evidence"
    low, high = result.bracket
    solvers = _other_solvers(result)
    solver = f"--solver {' or '.join(solvers)}" if solvers else "another --condense"
    if math.isfinite(low) and math.isfinite(high):
        return f"{solver} may narrow the bracket"
    missing = " and ".join(word for word, end in (("lower", low), ("upper", high)) if not math.isfinite(end))
    return f"no {missing} bound was proven: {solver} may find one; so may strengths nearer to the forces"


def _other_solvers(result: LimitAnalysisResult) -> list[str]:
    """Return the installed solvers that accept the program of a result and were not asked for it."""
    used = {name.split(" ")[0] for name in result.solve_log}
    structure = LimitAnalysis(result.assembly, inner_bending=result.model.inner_bending).template.structure
    names = []
    for name in installed_solvers():
        if name == "auto" or name in used:
            continue
        try:
            make_solver(name).require(structure)
        except SolverError:
            continue
        names.append(name)
    return names


def _list_names(names: list[str]) -> str:
    """Join up to `_NAMED` names by commas, and state how many more there are."""
    if len(names) <= _NAMED:
        return ", ".join(names)
    return f"{', '.join(names[:_NAMED])} and {len(names) - _NAMED} more"


_MEMBERS: Final = 6  # largest number of members whose tension the facts of a result name


def facts_of_assembly(assembly: Assembly) -> dict[str, str]:
    """Describe an assembly by named facts: dimension, counts, loads, program size, dimensions.

    Parameters
    ----------
    assembly : Assembly
        Assembly to describe.

    Returns
    -------
    dict of str to str
        Facts by name, with units.
    """
    elements, faces, members = assembly.elements, assembly.faces, assembly.members
    length = assembly.units[0]
    structure = Template(assembly.by_case[0]).structure
    dry = int(np.count_nonzero(assembly.labels))
    names = {"tie": "ties", "tendon": "tendons", "pin": "pins", "fill": "pressures of fill"}
    kinds = [f"{members.kinds.count(kind)} {words}" for kind, words in names.items() if kind in members.kinds]
    kind = "second-order cone program" if structure.cones else "linear program"
    return {
        "dimension": "planar" if assembly.dimension == 2 else "spatial",
        "elements": f"{len(elements)}: {len(elements.free)} free, {int(elements.support.sum())} supports",
        "interfaces": f"{faces}: {dry} dry, {faces - dry} inner in the scene's own labelling",
        **({"members": f"{len(members)}: {', '.join(kinds)}"} if members else {}),
        **_loads(assembly),
        "program": f"{kind}, {structure.shape[1]} unknowns, {structure.equalities} equations, "
        f"{structure.linear - 1} inequalities, {len(structure.cones)} cones",
        "size": f"{assembly.size:.6g} {length}",
        **({"snapped": f"corners moved by {assembly.moved:.3g} {length} at the most"} if assembly.moved else {}),
    }


def _loads(assembly: Assembly) -> dict[str, str]:
    """Describe dead and live loads, for each load case by its name."""
    length, force = assembly.units
    facts = {}
    names = [case.name for case in assembly.cases] or [""]
    for name, required, case in zip(names, assembly.required, assembly.by_case, strict=True):
        suffix = f" {name}" if name else ""
        dead = resultants(case.dead_loads, case.elements)
        facts[f"dead load{suffix}"] = _load(resultant(dead, case.elements), force, length)
        facts[f"live load{suffix}"] = "λ × " + _load(resultant(case.live, case.elements), force, length)
        if required != 1.0:
            facts[f"live load{suffix}"] += f", λ of {required:g} required"
    return facts


def _load(total_load: Resultant, force: str, length: str) -> str:
    """Describe the resultant of a load: force, point of its line of action, remaining moment."""
    moment = f"{total_load.moment:.6g} {force}·{length}"
    if total_load.cancels:
        cancel = f", forces of {total_load.total:.6g} {force} cancel" if total_load.total else ""
        return f"a couple of {moment}{cancel}"
    components = ", ".join(f"{x:.6g}" for x in total_load.force)
    point = ", ".join(f"{x:.6g}" for x in total_load.point)
    words = f"({components}) {force} through ({point}) {length}"
    if total_load.total > 1.000001 * float(np.linalg.norm(total_load.force)):
        words += f", of forces of {total_load.total:.6g} {force} in all"
    return words + (f", and {moment} about that line" if abs(total_load.moment) > 1e-9 * total_load.total else "")


def _tensions(result: LimitAnalysisResult) -> dict[str, str]:
    """Describe the tensions of up to `_MEMBERS` members; {} without members or forces."""
    assembly = result.assembly
    if not assembly.members or result.forces is None:
        return {}
    values = tensions(assembly, result.forces).tolist()
    names = assembly.members.names[:_MEMBERS]
    shown = [f"{name} {tension + 0.0:.6g}" for name, tension in zip(names, values, strict=False)]
    others = f", and of {len(values) - len(shown)} more members" if len(values) > len(shown) else ""
    return {"tension": f"{', '.join(shown)} {assembly.units[1]}{others}"}


def facts_of_result(result: LimitAnalysisResult) -> dict[str, str]:
    """Describe a result by named facts: status, λ with its bracket, evidence, solve log, time.

    Parameters
    ----------
    result : LimitAnalysisResult
        Result to describe.

    Returns
    -------
    dict of str to str
        Facts by name; evidence of zero dilation, load cases, sensitivities and advice as available.
    """
    low, high = result.bracket
    bracket = " ".join("none" if math.isnan(end) else f"{end:.12g}" for end in (low, high))
    facts = {
        "status": str(result.status),
        **({"governing": str(result.governing)} if result.cases else {}),
        "λ / required" if result.cases else "λ": "none"
        if math.isnan(result.load_factor)
        else f"{result.load_factor:.12g}",
        "bracket": bracket + ("" if math.isnan(result.gap) else f"   (relative width {result.gap:.1e})"),
    }
    for name, case in {"": result, **{f" {name}": case for name, case in result.cases.items()}}.items():
        facts |= tilt_in_words(case.facts, name)
    if result.reason:
        facts["reason"] = result.reason
    for note in result.notes:
        facts["note"] = f"{facts['note']}; {note}" if "note" in facts else note
    facts |= _tensions(result)
    if result.friction == "zero-dilation":
        extra = result.facts
        facts["associative"] = (
            f"{_shown(extra['associative_load_factor'])} (the only upper bound on every zero-dilation λ)"
        )
        facts["evidence"] = (
            f"violation {_shown(extra['friction_violation'])}, dilation {_shown(extra['dilation'])}, "
            f"complementarity gap {_shown(extra['complementarity_gap'])}, "
            + ("converged" if extra["converged"] else "not converged")
        )
        facts |= _range(extra)
    for (name, case), required in zip(result.cases.items(), result.assembly.required, strict=False):
        ends = " ".join("none" if math.isnan(end) else f"{end:.12g}" for end in case.bracket)
        facts[f"λ {name}"] = f"{_shown(number(case.load_factor))} of {required:g} required ({case.status}, {ends})"
    if "load_factor_nominal" in result.facts:
        facts["λ at nominal"] = f"{_shown(result.facts['load_factor_nominal'])} (λ above is at the low values)"
    for name, rate in result.facts.get("sensitivities", {}).items():
        if name == "not_computed":
            facts["sensitivities"] = f"not computed: {rate}"
        else:
            facts[f"∂λ/∂{name}"] = _rate(rate)
    facts |= advice(result)
    facts["stands at 0"] = stands_in_words(result)
    facts["cracks"] = cracks_in_words(result.cracks)
    facts["solve log"] = ", ".join(result.solve_log)
    facts["seconds"] = f"{result.seconds['total']:.3g} ({result.seconds['solve']:.3g} solving)"
    return facts


def _range(facts: dict[str, Any]) -> dict[str, str]:
    """Describe the lowest and highest λ found without dilation, and the lower bound; empty if not sought."""
    if facts.get("lowest_found") is None:
        return {}
    ends = (
        f"{facts['lowest_found']:.9g} to {facts['highest_found']:.9g} ({facts['solutions_found']} solutions certified)"
    )
    proven, bound = facts["lowest_proven"], facts["lowest_bound"]
    if bound is None:
        lower = "not sought"
    elif proven is None and facts["bound_tolerance"] == 0.0:
        lower = "nothing above 0 proven"
    elif facts["proven"]:
        lower = f"{proven:.9g} proven" + (", the lowest found is the lowest there is" if facts["closed"] else "")
    else:
        proven_text = "nothing above 0" if proven is None else f"{proven:.9g}"
        lower = f"{proven_text} proven; {bound:.9g} by the solver's word, within {facts['bound_tolerance']:g} of λ"
    return {"found": ends, "none below": lower}


def _rate(rate: dict[str, Any]) -> str:
    """Describe a derivative of λ, on both sides where these differ."""
    unit = f" {'' if rate['unit'].startswith('of') else 'per '}{rate['unit']}" if rate["unit"] else ""
    if rate["derivative"] is not None:
        return f"{rate['derivative']:.6g}{unit}"
    left, right = ("unknown" if rate[side] is None else f"{rate[side]:.6g}" for side in ("left", "right"))
    return f"{left} for less, {right} for more{unit}"


def _shown(value: float | None) -> str:
    return "none" if value is None else f"{value:.6g}"


def aligned(facts: Mapping[str, str]) -> str:
    """Return facts as lines of text, the values one below another."""
    width = max(12, *(len(name) for name in facts))
    return "\n".join(f"{name:<{width}} {value}" for name, value in facts.items())
