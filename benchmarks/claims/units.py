"""Claim: λ does not depend on units, on position or on the order of the elements.

Random scenes of the claim `converged`, some of them with two load cases. Each is solved in N and m, and again in kN and
mm, MN and m, pounds and inches; moved by about a thousand sizes; and with its elements in another order. A case
disagrees if a status differs, or λ by more than 1e-9 of λ or of the load factor that counts as zero. Where a scene is
moved or its elements renumbered, coordinates are rounded and solvers take other paths: there λ may differ by the width
that a bracket may have, 1e-6. ``notes`` counts pairs by the decade of that difference.
"""

from __future__ import annotations

import copy
import math
from typing import Any, Final

import numpy as np

from benchmarks.claims import converged
from benchmarks.claims.tally import Tally, run_cases
from jld_core import Assembly, LimitAnalysisResult, build_assembly, parse_scene, solve, tolerances
from jld_core.limit import load_scale

CLAIM: Final = "λ is the same in other units to 1e-9, elsewhere and in another order of elements within the bracket"
ALIKE: Final = 1e-9
"""Largest relative difference of λ in other units."""
UNITS: Final = {
    "kN and mm": (1e3, 1e-3),
    "MN and m": (1.0, 1e-6),
    "pounds and inches": (1.0 / 0.0254, 1.0 / 4.4482216152605),
}
"""Units of length and force: numbers per metre and per newton."""
FAR: Final = 500.0
"""Distance by which a scene is moved, m: its size is about half a metre."""

Document = dict[str, Any]


def run(first_seed: int, cases: int, seconds: float) -> Tally:
    """Test the claim on random scenes.

    first_seed, cases: seeds to test; three consecutive seeds belong to the three groups of `converged`. seconds: time
    limit, s. Returns: disagreements, and in `notes` the number of pairs by kind of change and decade of the difference.
    """
    return run_cases(CLAIM, case, first_seed, cases, seconds)


def case(seed: int, tally: Tally, names: tuple[str, ...] = ()) -> str:
    """Solve the scene of one seed in all units, places and orders, or after the named changes only."""
    document, labels = drawn(seed)
    assembly = build_assembly(parse_scene(document))
    first = solve(assembly, labels)
    problems = []
    for name, changed in changes(document, seed).items():
        if names and name not in names:
            continue
        other = build_assembly(parse_scene(changed))
        second = solve(other, matched(assembly, labels, other))
        wrong = _difference(assembly, first, second, name, tally)
        if wrong:
            problems.append(wrong)
    return "; ".join(problems)


def drawn(seed: int) -> tuple[Document, np.ndarray]:
    """Draw the document of a seed, and labels of its interfaces; every fifth scene has two load cases."""
    document, labels = converged.drawn_document(seed)
    if seed % 5 == 0:
        live = document["loads"]["live"]
        elements = build_assembly(parse_scene(document)).elements
        force = [0.5, 0.0, -1.0] if "elements" in document else [0.5, -1.0]
        other = [{"element": elements.ids[elements.free[0]], "force": force}]
        cases = [{"name": "one", "live": live}, {"name": "two", "live": other, "required": 1.5}]
        document["loads"] = {"cases": cases}
    return document, labels


def changes(document: Document, seed: int) -> dict[str, Document]:
    """Return the same scene in other units, elsewhere, and in another order, by name of the change."""
    found = {name: in_units(document, length, force) for name, (length, force) in UNITS.items()}
    if "elements" in document:
        found["moved"] = in_units(document, 1.0, 1.0, (FAR, -0.7 * FAR, 0.4 * FAR))
        found["renumbered"] = copy.deepcopy(document)
        order = np.random.default_rng(seed).permutation(len(document["elements"]))
        found["renumbered"]["elements"] = [document["elements"][k] for k in order]
    return found


def in_units(
    document: Document, length: float, force: float, shift: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> Document:
    """Return a scene with numbers of length times `length` and forces times `force`, moved by `shift` before."""

    def placed(point: list[float]) -> list[float]:
        return [length * (x + by) for x, by in zip(point, shift, strict=False)]

    changed = copy.deepcopy(document)
    if "grid" in changed:
        changed["grid"]["cell"] = [length * x for x in changed["grid"]["cell"]]
        changed["grid"]["thickness"] *= length
    for element in changed.get("elements", []):
        element["vertices"] = [placed(point) for point in element["vertices"]]
    materials = changed["materials"]
    materials["density"] *= force / length**3
    for label in ("dry", "inner"):
        for key in materials[label]:
            if key.endswith("strength") or key == "cohesion":
                materials[label][key] *= force / length**2
    loads = changed["loads"]
    for live in (loads["live"],) if "live" in loads else tuple(one["live"] for one in loads["cases"]):
        for entry in live:
            if "force" in entry:
                entry["force"] = [force * x for x in entry["force"]]
            if "at" in entry:
                entry["at"] = placed(entry["at"])
    return changed


def matched(assembly: Assembly, labels: np.ndarray, other: Assembly) -> np.ndarray:
    """Return the labels of `assembly` in the order of the interfaces of `other`, by the names of their elements."""
    if len(labels) != len(other.interfaces):
        raise ValueError(f"{len(labels)} interfaces became {len(other.interfaces)}")
    mine, theirs = _names(assembly), _names(other)
    if mine == theirs:
        return labels
    # Several faces of one pair have the order of their places.
    of = dict(zip(mine, labels.tolist(), strict=True))
    return np.array([of[name] for name in theirs])


def _names(assembly: Assembly) -> list[tuple[str, str, int]]:
    """Return the pair of elements of each interface, and the number of the interface within its pair."""
    ids, faces, seen = assembly.elements.ids, assembly.interfaces, dict[tuple[str, str], list[int]]()
    pairs = [tuple(sorted((ids[a], ids[b]))) for a, b in zip(faces.a, faces.b, strict=True)]
    for k, (one, two) in enumerate(pairs):
        seen.setdefault((one, two), []).append(k)
    numbers = {}
    for own in seen.values():
        way = np.round((faces.origin[own] - faces.origin[own].min(axis=0)) / assembly.size, 6)
        for rank, place in enumerate(np.lexsort(way.T[::-1])):
            numbers[own[place]] = rank
    return [(one, two, numbers[k]) for k, (one, two) in enumerate(pairs)]


def _difference(
    assembly: Assembly, first: LimitAnalysisResult, second: LimitAnalysisResult, name: str, tally: Tally
) -> str:
    """Compare two results; count the decade of their difference and return what is wrong, "" if nothing is."""
    kind = "units" if name in UNITS else name
    if first.status is not second.status:
        tally.count(f"{kind}: status")
        return f"{name}: {first.status} became {second.status}"
    one, two = first.load_factor, second.load_factor
    if math.isnan(one) or str(first.status) == "uncertified":
        tally.count(f"{kind}: {first.status}")
        return ""
    apart = abs(two - one) / max(abs(one), abs(two), load_scale(assembly))
    decade = max(math.ceil(math.log10(apart)), -15) if apart else -15
    tally.count(f"{kind}: to 1e{decade}")
    wrong = apart > (ALIKE if name in UNITS else tolerances.GAP)
    return f"{name}: {one!r} became {two!r} ({apart:.1e}, {first.solve_log})" if wrong else ""
