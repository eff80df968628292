"""Assemble the data of a page as JSON: structure, loads and solutions.

The format is stated in `page_contract` and described in docs/guide/page.md.
Python computes everything that needs mechanics or geometry, and the page only draws.
Numbers are rounded for drawings and tooltips; `results.csv` keeps full precision.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal, cast

import numpy as np

from jld_core.arrays import Bools
from jld_core.assembly import Assembly
from jld_core.limit import LimitAnalysisResult
from jld_core.limit.member_results import effects
from jld_core.limit.result_of_faces import result_of_faces
from jld_core.scene import Scene
from jld_core.scene.members import MemberKind
from jld_core.sub_assembly import faces_of
from jld_core.views import look, quantities
from jld_explore.report.page_contract import (
    FORMAT,
    VERSION,
    CaseSolution,
    Curve,
    Edge,
    Load,
    Look,
    PageData,
    Picture,
    Solution,
    Structure,
    Table,
)
from jld_explore.report.rounding import DIGITS, rounded, rounded_each
from jld_explore.space import to_string
from jld_explore.space.void import beside_nothing, omitted


def page_data(
    *,
    kind: Literal["report", "studio"],
    scene: Scene | None,
    assembly: Assembly,
    candidates: Bools,
    facts: Mapping[str, str],
    warnings: Sequence[str] = (),
    how: str = "",
    table: Table | None = None,
    solutions: Mapping[int, Solution] | None = None,
    convergence: Sequence[Curve] = (),
    pictures: Sequence[Picture] = (),
    summary: Mapping[str, Any] | None = None,
    studio: Mapping[str, Any] | None = None,
) -> PageData:
    """Assemble the data of a page.

    kind: "report" or "studio". scene: scene; None where only its assembly is known. assembly: structure with m faces.
    candidates: (m,) faces whose label may be chosen. facts: facts shown by name. warnings: warnings shown. how:
    sentence on how to get forces that the page does not hold, with {rank} in it. table: table from `table_of`.
    solutions: data from `solution_of` by the number of the row. convergence: curves with name, solves, seconds and
    best. pictures: pictures with title and png, base64. studio: additional data of the studio. Result: data that can be
    written as JSON.
    """
    return {
        "format": FORMAT,
        "version": VERSION,
        "kind": kind,
        "title": assembly.name if scene is None else scene.name,
        "facts": [{"name": name, "value": value} for name, value in facts.items()],
        "warnings": list(warnings),
        "how": how,
        "look": cast(Look, look.rules()),
        "structure": structure_of(assembly, candidates),
        "cases": cases_of(assembly),
        "loads": loads_of(assembly),
        "table": table,
        "solutions": {str(row): solution for row, solution in (solutions or {}).items()},
        "convergence": list(convergence),
        "pictures": list(pictures),
        "scene": {} if scene is None else scene.model_dump(mode="json", exclude_defaults=True),
        "summary": dict(summary or {}),
        "studio": None if studio is None else dict(studio),
        "notebook": None,
    }


def structure_of(assembly: Assembly, candidates: Bools) -> Structure:
    """Return the elements and faces of an assembly for a page, lengths in scene units.

    candidates: (m,) True for faces whose label may be chosen.
    """
    assembly = faces_of(assembly)
    elements, faces = assembly.elements, assembly.interfaces
    planar, bars = assembly.dimension == 2, assembly.members
    weight = rounded(np.linalg.norm(elements.weight, axis=1), DIGITS)
    shapes, centroids = rounded_each(elements.shape), rounded(elements.centroid)
    polygons, areas = rounded_each(faces.polygon), rounded(faces.area, DIGITS)
    origins, normals = rounded(faces.origin), rounded(faces.normal)
    return {
        "dimension": 2 if planar else 3,
        "units": {"length": assembly.units[0], "force": assembly.units[1]},
        "size": rounded(assembly.size),
        "typical": rounded(quantities.typical(assembly)),
        "elements": [
            {
                "id": name,
                "support": bool(elements.support[k]),
                "shape": shapes[k],
                "faces": [] if planar else [list(ring) for ring in elements.faces[k]],
                "centroid": centroids[k],
                "weight": weight[k],
            }
            for k, name in enumerate(elements.ids)
        ],
        "faces": [
            {
                "elements": [int(faces.a[k]), int(faces.b[k])],
                "polygon": polygons[k],
                "origin": origins[k],
                "normal": normals[k],
                "area": areas[k],
                "candidate": bool(candidates[k]),
            }
            for k in range(len(faces))
        ],
        "edges": _bare_edges(assembly) if planar else [],
        "resultants": list(assembly.resultants),
        "touching": [list(pair) for pair in assembly.touching],
        "members": [
            {
                "name": name,
                "kind": cast(MemberKind | Literal["fill"], kind),
                "elements": held.tolist(),
                "points": rounded(points),
            }
            for name, kind, held, points in zip(bars.names, bars.kinds, bars.elements, bars.points, strict=True)
        ],
        "fill": [rounded(outline) for outline in assembly.fill],
    }


def _bare_edges(assembly: Assembly) -> list[Edge]:
    """Return the pieces of the outlines of free elements that no interface covers.

    Each piece has the element and its two ends.
    """
    touching: list[list[list[list[float]]]] = [[] for _ in assembly.elements.ids]
    for k, polygon in enumerate(assembly.interfaces.polygon):
        ends = np.asarray(polygon).tolist()
        touching[assembly.interfaces.a[k]].append(ends)
        touching[assembly.interfaces.b[k]].append(ends)
    near = 1e-6 * assembly.size
    pieces: list[Edge] = []
    # plain numbers: arrays of two points take ten times as long
    for element in assembly.elements.free.tolist():
        corners = assembly.elements.shape[element].tolist()
        for (x, y), (x1, y1) in zip(corners, corners[1:] + corners[:1], strict=True):
            length = math.hypot(x1 - x, y1 - y)
            along = (x1 - x) / length, (y1 - y) / length
            most, covered = max(near, 1e-3 * length), []
            for ends in touching[element]:
                if all(abs((u - x) * along[1] - (v - y) * along[0]) <= most for u, v in ends):
                    places = [(u - x) * along[0] + (v - y) * along[1] for u, v in ends]
                    covered.append((max(min(places), 0.0), min(max(places), length)))
            for part in _gaps(covered, length, near):
                low, high = ([x + place * along[0], y + place * along[1]] for place in part)
                pieces.append({"element": element, "from": rounded(low), "to": rounded(high)})
    return pieces


def _gaps(covered: Iterable[tuple[float, float]], length: float, near: float) -> list[tuple[float, float]]:
    """Return the parts of [0, length] that intervals leave uncovered, if longer than `near`."""
    found, at = [], 0.0
    for low, high in sorted(covered):
        if low - at > near:
            found.append((at, low))
        at = max(at, high)
    if length - at > near:
        found.append((at, length))
    return found


def cases_of(assembly: Assembly) -> list[str]:
    """Return the names of the load cases for a page; one empty name for a single load."""
    return [case.name for case in assembly.cases] or [""]


def loads_of(assembly: Assembly) -> list[Load]:
    """List the live loads for drawing: on points, on all bodies together, and couples.

    assembly: structure with its load cases. Result: loads with case, kind, element, position and vector, scene units.
    """
    planar, ids, d = assembly.dimension == 2, assembly.elements.ids, assembly.dimension
    found: list[Load] = []
    for name, case in zip(cases_of(assembly), assembly.by_case, strict=True):
        for element, at, vector in case.live_loads.arrows():
            found.append(_load(name, "live", ids[element], at, vector))
        total = quantities.body_load(case)
        if total is not None:
            found.append(_load(name, "body", "", np.zeros(d), total))
        for k in quantities.live_couples(case):
            moment = case.live[k, d:] if not planar else case.live[k, 2:]
            found.append(_load(name, "couple", ids[k], assembly.elements.centroid[k], moment))
    return found


def _load(case: str, kind: Literal["live", "body", "couple"], element: str, at: Any, vector: Any) -> Load:
    """Return one load as data."""
    return {"case": case, "kind": kind, "element": element, "at": rounded(at), "vector": rounded(vector, DIGITS)}


def solution_of(result: LimitAnalysisResult) -> Solution:
    """Convert a limit analysis result to the data of a drawing, by load case.

    result: result of one layout. Result: λ (with load cases the governing factor), bracket and status, and for each
    case forces and mechanism.
    """
    cases = result.cases or {"": result}
    names = list(cases)
    return {
        "labelling": to_string(result.labels[: result.assembly.faces]),
        "load_factor": rounded(result.load_factor),
        "bracket": [rounded(end, 15) for end in result.bracket],
        "status": str(result.status),
        "governing": names.index(result.governing) if result.governing in names else 0,
        "cases": [
            _case(name, one, float(required))
            for (name, one), required in zip(cases.items(), result.assembly.required, strict=True)
        ],
    }


def within(solution: Solution, assembly: Assembly, text: str) -> Solution:
    """Extend the solution of a structure with omitted cells to the whole structure.

    assembly: the whole structure. text: labelling with a letter per face of it, "v" beside an omitted cell. Values of
    omitted elements, and of faces beside them, become zeros.
    """
    gone = omitted(assembly, text)
    faces = np.flatnonzero(~beside_nothing(text)).tolist()
    elements = np.flatnonzero(~gone).tolist()

    def spread(values: Any, rows: list[int], count: int, none: Any) -> Any:
        if values is None:
            return None
        found = [none] * count
        for row, value in zip(rows, values, strict=True):
            found[row] = value
        return found

    freedoms = assembly.freedoms
    empty = {
        "forces": [0.0] * freedoms, "utilisation": 0.0, "vectors": [0.0] * assembly.dimension, "on_face": False,
        "movements": "still", "pressure": [0.0] * assembly.dimension, "places": [0.0] * assembly.dimension,
    }  # fmt: skip
    cases: list[CaseSolution] = []
    for case in solution["cases"]:
        values: dict[str, Any] = {**case}
        wide = {name: spread(values[name], faces, len(text), none) for name, none in empty.items()}
        wide["mechanism"] = spread(case["mechanism"], elements, len(gone), [0.0] * freedoms)
        cases.append(cast(CaseSolution, values | wide))
    return {**solution, "labelling": text, "cases": cases}


def _case(name: str, result: LimitAnalysisResult, required: float) -> CaseSolution:
    """Return the data of one load case: λ, forces, thrust and mechanism."""
    if result.instability_mechanism is not None:
        result = replace(result, mechanism=result.instability_mechanism)  # Show the mechanism that proves instability.
    whole, result = result, result_of_faces(result)
    assembly, forces, mechanism = result.assembly, result.forces, result.mechanism
    found: CaseSolution = {
        "name": name,
        "required": required,
        "load_factor": rounded(result.load_factor),
        "bracket": [rounded(end, 15) for end in result.bracket],
        "gap": rounded(result.gap, DIGITS),
        "status": str(result.status),
        "friction": result.friction,
        "forces": None,
        "utilisation": None,
        "pressure": None,
        "on_face": None,
        "vectors": None,
        "members": None,
        "thrust": [],
        "mechanism": None,
        "scale": 0.0,
        "movements": None,
        "places": None,
    }
    if forces is not None:
        pressure, on_face = quantities.pressure_points(assembly, forces)
        found |= {
            "forces": rounded(forces, DIGITS),
            "utilisation": rounded(quantities.utilisation(result), 4),
            "pressure": rounded(pressure, DIGITS),
            "on_face": [bool(on) for on in on_face],
            "vectors": rounded(
                quantities.down_the_load_path(assembly, quantities.face_vectors(assembly, forces)), DIGITS
            ),
            "members": rounded(effects(whole.assembly, whole.forces), DIGITS) if whole.forces is not None else None,
            "thrust": [rounded(piece, DIGITS) for piece in quantities.thrust_segments(assembly, forces)],
        }
    if mechanism is not None:
        kinds, places = quantities.movements(result)
        found |= {
            "mechanism": rounded(mechanism, DIGITS),
            "scale": rounded(quantities.mechanism_scale(assembly, mechanism), DIGITS),
            "movements": [str(kind) for kind in kinds],
            "places": rounded(places, DIGITS),
        }
    return found
