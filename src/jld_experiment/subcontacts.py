"""Place sub-contacts on every face and distribute its area over them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely

from jld_core import Assembly, Bits, Floats, Ints, ParameterError
from jld_core.geometry import area_of
from jld_experiment.bench import FLOW, FRACTURE, FRICTION, compiled

SCHEMES: Final = ("trapezoid", "simpson", "midpoint", "limit")


@dataclass(frozen=True)
class SubContacts:
    """The s sub-contacts of all m faces, one face after the other."""

    first: Ints  # (m + 1,) position of the first sub-contact of each face
    # (s, 2) coordinate along e1 and area (planar), or coordinates along e1 and e2 and area (spatial), scene units
    place: Floats
    face: Ints  # (s,) face of each sub-contact


def sub_contacts(assembly: Assembly, labels: Bits, scheme: str, segments: int) -> SubContacts:
    """Compute points and areas of sub-contacts by one of `SCHEMES`; InputError for too few segments."""
    if scheme not in SCHEMES:
        raise ParameterError("scheme", f"no scheme is named {scheme!r}", " or ".join(SCHEMES))
    if segments < 1 or (scheme == "midpoint" and segments < 2):
        raise ParameterError("segments", f"{segments} give a face no resistance to rotation", "a larger number")
    faces, rows, counts = assembly.interfaces, [], []
    for face in range(len(faces)):
        if assembly.dimension == 2:
            points = _line(scheme, segments, bool(labels[face]))
            part = np.column_stack([points[:, 0] * faces.l1[face], points[:, 1] * faces.area[face]])
        elif faces.rectangle[face]:
            points = _line(scheme, segments, bool(labels[face]))
            first, second = np.repeat(points, len(points), axis=0), np.tile(points, (len(points), 1))
            part = np.column_stack(
                [
                    first[:, 0] * faces.l1[face],
                    second[:, 0] * faces.l2[face],
                    first[:, 1] * second[:, 1] * faces.area[face],
                ]
            )
        else:
            part = _polygon(assembly, face, scheme, segments, bool(labels[face]))
        rows.append(part)
        counts.append(len(part))
    first_of = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    return SubContacts(first_of, np.concatenate(rows), np.repeat(np.arange(len(faces)), counts))


def _line(scheme: str, segments: int, dry: bool) -> Floats:
    """Return (k, 2) positions on a line from −1/2 to 1/2 and weights that sum to one."""
    if scheme == "limit":
        # Two points: a dry joint rocks about its edges; at ±1/6 they carry an inner face's moment f t²/6 and force f t.
        end = 0.5 if dry else 1.0 / 6.0
        return np.array([[-end, 0.5], [end, 0.5]])
    ends = np.linspace(-0.5, 0.5, segments + 1)
    middles = 0.5 * (ends[:-1] + ends[1:])
    if scheme == "midpoint":
        return np.column_stack([middles, np.full(segments, 1.0 / segments)])
    tributary = np.full(segments + 1, 1.0 / segments)
    tributary[[0, -1]] *= 0.5
    if scheme == "trapezoid":
        return np.column_stack([ends, tributary])
    places = np.concatenate([ends, middles])
    weights = np.concatenate([tributary / 3.0, np.full(segments, 2.0 / (3.0 * segments))])
    order = np.argsort(places, kind="stable")
    return np.column_stack([places[order], weights[order]])


def _polygon(assembly: Assembly, face: int, scheme: str, segments: int, dry: bool) -> Floats:
    """Return (k, 3) points about the centroid and areas for a polygon that is no rectangle."""
    faces = assembly.interfaces
    arm = faces.polygon[face] - faces.origin[face]
    corners = np.column_stack([arm @ faces.e1[face], arm @ faces.e2[face]])
    triangles, size = _cut(corners), float(faces.area[face])
    one, two = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    share = 0.5 * np.abs(one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0])
    share = share * size / float(share.sum())
    if scheme == "limit":
        ends = triangles if np.any(triangles[:, 0]) else triangles[:, 1:]
        points, areas = _merged(ends.reshape(-1, 2), np.repeat(share / ends.shape[1], ends.shape[1]))
        points = points if dry else points / 3.0
    elif scheme == "midpoint":
        points = np.concatenate([_triangle_middles(base, one, two, segments) for base, one, two in triangles])
        areas = np.repeat(share / segments**2, segments**2)
    else:
        # Split each triangle into segments² equal ones; the nodes have tributary areas.
        points, areas = _split(triangles, share, segments, scheme == "simpson")
    return np.column_stack([points, _balanced(points, areas)])


def _cut(corners: Floats) -> Floats:
    """Return (t, 3, 2) triangles of a polygon about its centroid, with it if it sees all edges."""
    after = np.roll(corners, -1, axis=0)
    signed = corners[:, 0] * after[:, 1] - corners[:, 1] * after[:, 0]
    if np.all(signed > 0.0) or np.all(signed < 0.0):
        return np.stack([np.zeros_like(corners), corners, after], axis=1)
    # Bridges to holes are traversed in both directions and are not edges of the region.
    cut = shapely.get_parts(shapely.constrained_delaunay_triangles(area_of(shapely.Polygon(corners))))
    return np.array([shapely.get_coordinates(part)[:3] for part in cut])


def _triangle_middles(base: Floats, one: Floats, two: Floats, segments: int) -> Floats:
    """Return (segments², 2) centroids of the equal parts of a triangle base, one, two (2,)."""
    one, two, found = one - base, two - base, []
    for i in range(segments):
        for j in range(segments - i):
            found.append(base + ((i + 1 / 3) * one + (j + 1 / 3) * two) / segments)
            if i + j < segments - 1:
                found.append(base + ((i + 2 / 3) * one + (j + 2 / 3) * two) / segments)
    return np.array(found)


def _split(triangles: Floats, share: Floats, segments: int, middles: bool) -> tuple[Floats, Floats]:
    """Return nodes and areas of triangles (t, 3, 2), each split into segments² equal ones."""
    # A third of each small area goes to each corner, or with `middles` to each midpoint of its sides. The midpoints
    # integrate quadratic functions exactly.
    points, areas = [], []
    for (base, first, second), whole in zip(triangles, share.tolist(), strict=True):
        one, two = first - base, second - base
        small = whole / segments**2
        for i in range(segments):
            for j in range(segments - i):
                for up in (True, False):
                    if not up and i + j >= segments - 1:
                        continue
                    at = [(i, j), (i + 1, j), (i, j + 1)] if up else [(i + 1, j + 1), (i + 1, j), (i, j + 1)]
                    nodes = [base + (a * one + b * two) / segments for a, b in at]
                    if middles:
                        nodes = [0.5 * (nodes[x] + nodes[(x + 1) % 3]) for x in range(3)]
                    points += nodes
                    areas += [small / 3.0] * 3
    return _merged(np.array(points), np.array(areas))


def _merged(points: Floats, areas: Floats) -> tuple[Floats, Floats]:
    """Merge nodes that coincide and add their areas."""
    size = float(np.abs(points).max())
    keys = np.round(points / size, 9)
    order = np.lexsort(keys.T[::-1])
    fresh = np.concatenate([[True], np.any(np.diff(keys[order], axis=0) != 0.0, axis=1)])
    group = np.cumsum(fresh) - 1
    return points[order][fresh], np.bincount(group, weights=areas[order]).astype(float)


def _balanced(points: Floats, areas: Floats) -> Floats:
    """Return areas with zero first moments about the centroid, changed as little as possible."""
    rows = np.vstack([np.ones(len(areas)), points.T])
    off = rows @ areas - np.array([areas.sum(), 0.0, 0.0])
    return np.asarray(areas - areas * (rows.T @ np.linalg.solve((rows * areas) @ rows.T, off)))


# row of `law` for one face: kn, ks, friction, dilation, strength (shear at p = 0), tension, crushing, residual
Law = tuple[float, float, float, float, float, float, float, float]


@compiled
def numbers_of(law: Floats, f: int) -> Law:
    """Return row f of the laws (m, 8) as a tuple of numbers, as `sub_contact` takes it."""
    return (law[f, 0], law[f, 1], law[f, 2], law[f, 3], law[f, 4], law[f, 5], law[f, 6], law[f, 7])


@compiled
def sub_contact(
    overlap: float, size: float, law: Law, brittle: bool, gaps: bool, broken: bool
) -> tuple[float, float, float, bool]:
    """Return overlap, compressive stress, shear stress and broken state after a trial step."""
    # A brittle sub-contact breaks if it exceeds its tension or shear strength. Afterwards it has residual friction
    # alone.
    kn, ks, mu, psi, strength, tension, crushing, residual = law
    p = kn * overlap
    if broken:
        mu, psi, strength, tension = residual, 0.0, 0.0, 0.0
    failing = p < -tension or size > strength + mu * p
    if failing or p > crushing:
        if failing and brittle and not broken:
            broken = True
            mu, psi, strength, tension = residual, 0.0, 0.0, 0.0
        overlap, p, size = contact_stress(overlap, size, kn, ks, mu, psi, strength, tension, crushing, gaps or broken)
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
    """Add the energy lost from an elastic trial to the final stress to `Motion.work`."""
    # The loss is the mean stress of the step times the plastic jump, which is (trial − final)/stiffness. Sliding with a
    # dilation equal to friction therefore loses nothing without strength. A gap that opens without tension loses
    # nothing. A brittle break loses the elastic energy at the beginning, plus the work of the step, less the elastic
    # energy at the end.
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
    strength: float,
    tension: float,
    crushing: float,
    gaps: bool,
) -> tuple[float, float, float]:
    """Return overlap, compressive stress and size of shear from an elastic trial to the yield surface."""
    # The return is the closest point in the elastic energy where dilation equals friction. With compressive stress p
    # and shear stress q it maps p ↦ p + kn ψ γ and |q| ↦ |q| − ks γ, where γ = (|q| − c − μp) / (ks + μ ψ kn) is the
    # slip and c the strength. At the corner p = −σt (σt: tension) the shear stress is limited to |q| ≤ c − μσt.
    p = kn * overlap
    if p > crushing:
        p = crushing
        overlap = p / kn
    over = size - strength - friction * p
    if over > 0.0:
        gamma = over / (ks + friction * dilation * kn)
        raised = p + kn * dilation * gamma
        if raised >= -tension and ks * gamma <= size:
            return overlap + dilation * gamma, raised, size - ks * gamma
    if p >= -tension:
        return overlap, p, min(size, max(strength + friction * p, 0.0))
    if not gaps:
        overlap = -tension / kn
    return overlap, -tension, min(size, max(strength - friction * tension, 0.0))
