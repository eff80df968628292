"""Contacts and their sections do not depend on position, order, mirroring or units, and λ does not either.

Merged voxels and merged cells of planar grids, turned, mirrored, scaled, moved and shuffled, against contacts counted
on the grid. Areas, centroids, second moments and torsion lengths are sums over the squares of the grid in closed form,
hulls and kerns those of their corners.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from benchmarks.claims.tally import Tally, run_cases
from benchmarks.claims.voxels import Known, grown, known_contacts, outline, solid, with_hole
from jld_core import Assembly, InputError, Status, build_assembly, parse_scene, solve
from jld_core.arrays import Floats, Ints
from jld_core.mechanics import scaling_of, yield_set

CLAIM: Final = "Contacts, sections and λ are those counted on a grid, in any position, order and unit"
EXACT: Final = 1e-9
"""Relative difference of lengths, areas and moments that counts as a disagreement."""
_SOLVED: Final = 20  # one case in so many is solved, in both positions
_PLANAR: Final = 4  # one case in so many is planar
_DIRECTIONS: Final = 24  # in which hulls and kerns are compared


@dataclass(frozen=True)
class Move:
    """Similarity x → scale · turn · x + shift, mirrored where the determinant of turn is −1."""

    turn: Floats
    scale: float
    shift: Floats

    def points(self, places: Floats) -> Floats:
        """Move points (..., d)."""
        return np.asarray(self.scale * places @ self.turn.T + self.shift)


def run(first_seed: int, cases: int, seconds: float) -> Tally:
    """Test the claim on random assemblies: see `run_cases`."""
    return run_cases(CLAIM, case, first_seed, cases, seconds)


def case(seed: int, tally: Tally) -> str:
    """Return "" where one random assembly has the contacts, sections and λ of its grid, else what differs."""
    rng = np.random.default_rng([seed, 1915])
    try:
        problem = _planar_case(rng, seed, tally) if seed % _PLANAR == 0 else _spatial_case(rng, seed, tally)
    except InputError as error:
        return f"refused: {error}"
    return problem


def random_move(rng: np.random.Generator, dimension: int) -> Move:
    """Draw a rotation, in half of all cases mirrored, a scale of 1e-3 to 1e3 and a shift of up to 1e3 sizes."""
    turn = np.linalg.qr(rng.normal(size=(dimension, dimension)))[0]
    scale = 10.0 ** rng.uniform(-3.0, 3.0)
    return Move(turn, scale, scale * 10.0 ** rng.uniform(-1.0, 3.0) * rng.normal(size=dimension))


def document(elements: list[dict[str, Any]], move: Move, **keys: Any) -> dict[str, Any]:
    """Return a scene of elements under a body load, all of it moved; strengths grow with the scale."""
    planar, weight = len(move.shift) == 2, 1000.0 * 9.81 * move.scale
    down = np.array([0.0, -9.81]) if planar else np.array([0.0, 0.0, -9.81])
    live = np.array([1.0, 0.1]) if planar else np.array([0.6, 0.8, 0.1])
    return {
        "elements": elements,
        "materials": {
            "density": 1000.0,
            "gravity": (move.turn @ down).tolist(),
            "dry": {"friction_coefficient": 0.6},
            "inner": {"tensile_strength": 0.8 * weight, "shear_strength": 1.1 * weight},
        },
        "loads": {"live": [{"body": (move.turn @ live).tolist()}]},
        **({"thickness": move.scale} if planar else {}),
        **keys,
    }


def _spatial_case(rng: np.random.Generator, seed: int, tally: Tally) -> str:
    shape = (int(rng.integers(3, 5)), int(rng.integers(3, 5)), int(rng.integers(2, 5)))
    lines = [np.concatenate([[0.0], np.cumsum(rng.uniform(0.3, 1.5, count))]) for count in shape]
    first = with_hole(rng, shape) if shape[2] > 2 and rng.random() < 0.5 else set()
    labels = grown(rng, shape, first, int(rng.integers(1, 6)))
    names = [label for label in np.unique(labels).tolist() if label > 0]
    if len(names) < 2:
        tally.notes["nothing stands"] = tally.notes.get("nothing stands", 0) + 1
        return ""
    still = Move(np.eye(3), 1.0, np.zeros(3))
    plain = [{"id": f"e{n}", "support": n == 1, **solid(rng, labels, n, lines)} for n in names]
    known = known_contacts(labels, lines)
    move = random_move(rng, 3)
    again = [{"id": f"e{n}", "support": n == 1, **solid(rng, labels, n, lines)} for n in names]
    moved = [{**e, "vertices": move.points(np.array(e["vertices"])).tolist()} for e in again]
    moved = [moved[k] for k in rng.permutation(len(moved))]
    for elements, position in ((plain, still), (moved, move)):
        built = build_assembly(parse_scene(document(elements, position)))
        problem = _compare(built, known, position, rng)
        if problem:
            return f"{'moved' if position is move else 'straight'}: {problem}"
    tally.notes["contacts"] = tally.notes.get("contacts", 0) + len(known)
    if (seed // 2) % _SOLVED:
        return ""
    return _compare_loads((plain, still), (moved, move), names, rng, tally)


def _compare(built: Assembly, known: list[Known], move: Move, rng: np.random.Generator) -> str:
    """Return what differs between the interfaces of an assembly and the contacts known from the grid."""
    faces, ids = built.interfaces, built.elements.ids
    pairs = [(ids[a], ids[b]) for a, b in zip(faces.a.tolist(), faces.b.tolist(), strict=True)]
    if len(pairs) != len(known):
        return f"{len(pairs)} interfaces, expected {len(known)}"
    left = set(range(len(pairs)))
    for contact in known:
        section = _Section.of(contact, move)
        couple = {f"e{contact.a}", f"e{contact.b}"}
        mine = [k for k in sorted(left) if set(pairs[k]) == couple]
        if not mine:
            return f"no interface left for {couple}"
        face = min(mine, key=lambda k: float(np.linalg.norm(faces.origin[k] - section.centroid)))
        left.discard(face)
        sign = 1.0 if pairs[face][0] == f"e{contact.a}" else -1.0
        problem = _differences(built, face, section, sign, rng)
        if problem:
            return f"interface {pairs[face]}: {problem}"
    return ""


@dataclass(frozen=True)
class _Section:
    """Plane section as sums over rectangles: normal, corners (n, 3), area, centroid, moments (3, 3), c_T, sides."""

    normal: Floats
    corners: Floats
    area: float
    centroid: Floats
    moments: Floats
    torsion: float
    sides: tuple[float, float] | None

    @classmethod
    def of(cls, contact: Known, move: Move) -> _Section:
        """Sections of a contact after a move; integrals are taken before it, where sides follow the axes."""
        squares = contact.rectangles
        one, two = (axis for axis in range(3) if not contact.normal[axis])
        low, high = squares.min(axis=1)[:, [one, two]], squares.max(axis=1)[:, [one, two]]
        size, middle = high - low, 0.5 * (low + high)
        part = size.prod(axis=1)
        area = float(part.sum())
        centre = part @ middle / area
        own = np.array([np.diag(p * s * s / 12.0) for p, s in zip(part, size, strict=True)])
        arm = middle - centre
        tensor = (own + part[:, None, None] * arm[:, :, None] * arm[:, None, :]).sum(axis=0)
        whole = np.zeros((3, 3))
        whole[np.ix_((one, two), (one, two))] = tensor
        place = squares[0, 0].copy()
        place[[one, two]] = centre
        radial = sum(_radial(a - centre, b - centre) for a, b in zip(low, high, strict=True))
        extent = high.max(axis=0) - low.min(axis=0)
        filled = abs(area - extent.prod()) <= 1e-12 * area
        scale = move.scale
        return cls(
            normal=move.turn @ contact.normal,
            corners=move.points(squares.reshape(-1, 3)),
            area=area * scale**2,
            centroid=move.points(place),
            moments=move.turn @ whole @ move.turn.T * scale**4,
            torsion=radial / area * scale,
            sides=(float(extent.min()) * scale, float(extent.max()) * scale) if filled else None,
        )


def _radial(low: Floats, high: Floats) -> float:
    """∫ r dA over a rectangle between two corners; r about the origin."""

    def quarter(x: float, y: float) -> float:
        r = float(np.hypot(x, y))
        third = x**3 * np.arcsinh(y / abs(x)) if x else 0.0
        other = y**3 * np.arcsinh(x / abs(y)) if y else 0.0
        return float(2.0 * x * y * r + third + other) / 6.0

    (x0, y0), (x1, y1) = low.tolist(), high.tolist()
    return quarter(x1, y1) - quarter(x0, y1) - quarter(x1, y0) + quarter(x0, y0)


def _differences(built: Assembly, face: int, section: _Section, sign: float, rng: np.random.Generator) -> str:
    faces = built.interfaces
    size = float(np.ptp(section.corners, axis=0).max())
    # what coordinates far from the origin cannot say better
    grain = 1e-14 * float(abs(section.corners).max()) / size
    allowed = max(EXACT, 100.0 * grain)
    checks: list[tuple[str, Any, Any, float]] = [
        ("area", faces.area[face], section.area, section.area),
        ("centroid", faces.origin[face], section.centroid, size),
        ("normal", sign * faces.normal[face], section.normal, 1.0),
        ("torsion length", faces.c_t[face], section.torsion, section.torsion),
    ]
    ways = rng.normal(size=(_DIRECTIONS, 3))
    ways -= np.outer(ways @ section.normal, section.normal)
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    arm = section.corners - section.centroid
    most = (ways @ arm.T).max(axis=1)
    polygon = faces.polygon[face] - section.centroid
    checks.append(("hull", (ways @ polygon.T).max(axis=1), most, size))
    if section.sides is not None:
        checks.append(("sides", np.sort([faces.l1[face], faces.l2[face]]), np.array(section.sides), size))
    if bool(faces.rectangle[face]) != (section.sides is not None):
        return f"rectangle is {bool(faces.rectangle[face])}"
    hull, kern = _bending(built, face, ways, section)
    checks += [("bending of dry faces", *hull, 1.0), ("bending of inner faces", *kern, 1.0)]
    for name, found, expected, unit in checks:
        off = float(np.max(np.abs(np.asarray(found) - np.asarray(expected)))) / unit
        if not off <= allowed:
            return f"{name} differs by {off:.2g}"
    return ""


def _bending(
    built: Assembly, face: int, ways: Floats, section: _Section
) -> tuple[tuple[Floats, Floats], tuple[Floats, Floats]]:
    """Greatest N that a unit moment about each direction (k, 3) needs on a dry and on an inner face, over its scale.

    The program's rows against the corners of the grid: N ≥ M × n · a / d on the hull of a dry face, and
    N ≥ −A x·S⁻¹(n × M) at all corners x of an inner one, docs/method.md (2.3) and (2.6).
    """
    faces = built.interfaces
    if section.sides is not None:
        none = np.zeros(1)
        return (none, none), (none, none)
    bending = yield_set(built, scaling_of(built), "kern").bending  # type: ignore[attr-defined]
    rows = slice(int(bending.start[face]), int(bending.start[face + 1]))
    frame = np.array([faces.e1[face] / (0.5 * faces.l2[face]), faces.e2[face] / (0.5 * faces.l1[face])])
    moments = ways @ frame.T
    dry, inner = (np.max(moments @ table[rows].T, axis=1) for table in (bending.dry, bending.inner))
    # n × M, with n of the program: what presses at x = (n × M) / N
    towards = np.cross(faces.normal[face], ways)
    arm = section.corners - section.centroid
    plane = np.array([faces.e1[face], faces.e2[face]])
    flat, way = arm @ plane.T, towards @ plane.T
    tensor = plane @ section.moments @ plane.T
    kern = (-section.area * flat @ np.linalg.solve(tensor, way.T)).max(axis=0)
    # 1 / N: how far the hull reaches from the centroid along n × M
    reach = np.array([_reach(flat, direction) for direction in way])
    return (dry * reach, np.ones(len(reach))), (inner / kern, np.ones(len(kern)))


def _reach(points: Floats, way: Floats) -> float:
    """How far the convex hull of points (n, 2) reaches from the origin along a unit direction."""
    from scipy.spatial import ConvexHull

    planes = ConvexHull(points).equations
    along = planes[:, :2] @ way
    return float(np.min(-planes[along > 1e-12, 2] / along[along > 1e-12]))


def _planar_case(rng: np.random.Generator, seed: int, tally: Tally) -> str:
    labels, nodes, straight = planar_grid(rng)
    names = [label for label in np.unique(labels).tolist() if label > 0]
    if len(names) < 2:
        tally.notes["nothing stands"] = tally.notes.get("nothing stands", 0) + 1
        return ""
    known = _planar_contacts(labels, nodes, straight=straight)
    move, still = random_move(rng, 2), Move(np.eye(2), 1.0, np.zeros(2))
    plain, moved = (
        [polygon_entry(rng, labels, n, nodes, position, straight) for n in names] for position in (still, move)
    )
    moved = [moved[k] for k in rng.permutation(len(moved))]
    for elements, position in ((plain, still), (moved, move)):
        built = build_assembly(parse_scene(document(elements, position)))
        problem = _compare_planar(built, known, position)
        if problem:
            return f"planar, {'moved' if position is move else 'straight'}: {problem}"
    tally.notes["contacts"] = tally.notes.get("contacts", 0) + len(known)
    if (seed // 2) % _SOLVED:
        return ""
    return _compare_loads((plain, still), (moved, move), names, rng, tally)


def planar_grid(rng: np.random.Generator) -> tuple[Ints, Floats, bool]:
    """Draw labels (p, q) of the cells of a planar grid, its nodes, and whether its lines are straight.

    nodes: (p + 1, q + 1, 2). Elements have no holes and do not touch themselves.
    """
    shape = (int(rng.integers(3, 7)), int(rng.integers(3, 6)))
    labels = grown(rng, shape, set(), int(rng.integers(2, 9)))
    for label in np.unique(labels[labels > 1]).tolist():
        if outline(labels, label) is None:  # with a hole: its cells, one by one
            for cell in np.argwhere(labels == label)[1:].tolist():
                labels[tuple(cell)] = labels.max() + 1
    nodes = np.stack(np.meshgrid(*(np.arange(n + 1.0) for n in shape), indexing="ij"), axis=-1)
    straight = bool(rng.random() < 0.5)
    if straight:
        nodes = nodes @ (np.eye(2) + rng.uniform(-0.3, 0.3, (2, 2)))
    else:
        nodes = nodes + rng.uniform(-0.15, 0.15, nodes.shape)
    return labels, nodes, straight


def polygon_entry(
    rng: np.random.Generator, labels: Ints, label: int, nodes: Floats, move: Move, straight: bool
) -> dict[str, Any]:
    """Entry of a planar element: it begins anywhere, goes round either way, and has some corners in straight edges."""
    ring = outline(labels, label)
    assert ring is not None
    steps = np.diff(np.array([*ring, ring[0]]), axis=0)
    idle = np.all(steps == np.roll(steps, 1, axis=0), axis=1) if straight else np.zeros(len(ring), dtype=bool)
    kept = ~idle | (rng.random(len(ring)) < 0.3)
    places = move.points(nodes[tuple(np.array(ring)[kept].T)])
    places = np.roll(places, int(rng.integers(len(places))), axis=0)
    return {"id": f"e{label}", "support": label == 1, "polygon": places[:: rng.choice([1, -1])].tolist()}


def _planar_contacts(labels: Ints, nodes: Floats, *, straight: bool) -> list[tuple[int, int, Floats]]:
    """(a, b, ends (2, 2)) of each contact, a below or left of b: runs of shared edges where these are straight."""
    found: list[tuple[int, int, Floats]] = []
    for axis in (0, 1):
        turned, place = (labels, nodes) if axis == 0 else (labels.T, nodes.transpose(1, 0, 2))
        for i in range(turned.shape[0] - 1):
            pairs = [(int(turned[i, j]), int(turned[i + 1, j])) for j in range(turned.shape[1])]
            for (a, b), run_ in itertools.groupby(range(len(pairs)), key=lambda j, pairs=pairs: pairs[j]):  # type: ignore[misc]
                places = list(run_)
                if a == b or a == 0 or b == 0:
                    continue
                runs = [places] if straight else [[j] for j in places]
                found += [(a, b, np.array([place[i + 1, j[0]], place[i + 1, j[-1] + 1]])) for j in runs]
    return found


def _compare_planar(built: Assembly, known: Sequence[tuple[int, int, Floats]], move: Move) -> str:
    faces, ids = built.interfaces, built.elements.ids
    pairs = [(ids[a], ids[b]) for a, b in zip(faces.a.tolist(), faces.b.tolist(), strict=True)]
    if len(pairs) != len(known):
        return f"{len(pairs)} interfaces, expected {len(known)}"
    left = set(range(len(pairs)))
    for a, b, places in known:
        ends = move.points(places)
        mine = [k for k in sorted(left) if set(pairs[k]) == {f"e{a}", f"e{b}"}]
        if not mine:
            return f"no interface left for e{a} and e{b}"
        face = min(mine, key=lambda k: float(np.linalg.norm(faces.origin[k] - ends.mean(axis=0))))
        left.discard(face)
        length = float(np.hypot(*(ends[1] - ends[0])))
        allowed = max(EXACT, 1e-12 * float(abs(ends).max()) / length)
        off = max(
            abs(faces.l1[face] - length) / length,
            float(np.linalg.norm(faces.origin[face] - ends.mean(axis=0))) / length,
            abs(float(faces.normal[face] @ (ends[1] - ends[0]))) / length,
        )
        if not off <= allowed:
            return f"interface {pairs[face]} differs by {off:.2g}"
    return ""


def _compare_loads(
    one: tuple[list[dict[str, Any]], Move],
    other: tuple[list[dict[str, Any]], Move],
    names: list[int],
    rng: np.random.Generator,
    tally: Tally,
) -> str:
    """Return where λ of two positions differs: all faces dry, and some of them inner."""
    glued = [list(pair) for pair in itertools.combinations([f"e{n}" for n in names], 2) if rng.random() < 0.4]
    built = build_assembly(parse_scene(document(*one)))
    touching = {frozenset((built.elements.ids[a], built.elements.ids[b])) for a, b in _couples(built)}
    glued = [pair for pair in glued if frozenset(pair) in touching]
    for labels in ({"default": "dry"}, {"default": "dry", "inner": glued}):
        results = [solve(build_assembly(parse_scene(document(*each, labels=labels)))) for each in (one, other)]
        statuses = {result.status for result in results}
        if Status.UNCERTIFIED in statuses:
            tally.notes["uncertified"] = tally.notes.get("uncertified", 0) + 1
            continue
        if len(statuses) > 1:
            return f"status {results[0].status} and {results[1].status}"
        tally.notes["solved"] = tally.notes.get("solved", 0) + 1
        if results[0].status is not Status.COLLAPSE:
            continue
        (low, high), (least, greatest) = (result.bracket for result in results)
        slack = EXACT * max(1e-3, abs(high))
        if max(low, least) > min(high, greatest) + slack:
            return f"λ in [{low:.10g}, {high:.10g}] and in [{least:.10g}, {greatest:.10g}]"
    return ""


def _couples(built: Assembly) -> list[tuple[int, int]]:
    return list(zip(built.interfaces.a.tolist(), built.interfaces.b.tolist(), strict=True))
