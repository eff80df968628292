"""Interfaces of plane contacts: local frames and section properties."""

from __future__ import annotations

import numpy as np

from jld_core import tolerances
from jld_core.assembly import Interfaces
from jld_core.geometry import polygons as measures
from jld_core.geometry.facet_planes import longest_edge, unit_vectors
from jld_core.geometry.spatial_contacts import SpatialContact


def spatial_interfaces(contacts: list[SpatialContact]) -> Interfaces:
    """Compute local frames and sections of plane contacts.

    The origin lies at the centroid; e1 runs along the longest edge, e2 = n × e1.

    contacts: the m contacts. Result: interfaces of dimension 3. Sizes of rectangles are means of opposite sides; those
    of other polygons are extents along e1 and e2. Sections are those of the area without its holes.

    Source: docs/method.md (1.2), (2.2).
    """
    count = len(contacts)
    normal = np.array([c.normal for c in contacts]).reshape(-1, 3)
    polygons = [measures.keyhole(c.polygon, c.holes) for c in contacts]
    solid = np.array([not c.holes for c in contacts], dtype=bool)
    e1, rectangle = np.empty((count, 3)), np.zeros(count, dtype=bool)
    plain = measures.without_idle_corners([c.polygon for c in contacts], tolerances.FACE)
    for chosen, stack in measures.by_corner_count(plain):
        e1[chosen] = longest_edge(stack)
        rectangle[chosen] = measures.is_rectangle(stack, tolerances.FACE) & solid[chosen]
    e1 = unit_vectors(e1 - np.einsum("ij,ij->i", e1, normal)[:, None] * normal)
    e2 = np.cross(normal, e1)
    origin = np.empty((count, 3))
    l1, l2, area, c_t = (np.empty(count) for _ in range(4))
    for chosen, stack in measures.by_corner_count(polygons):
        base = stack[:, :1]
        frame = np.stack([e1[chosen], e2[chosen], normal[chosen]], axis=1)
        local = np.einsum("nkj,nij->nki", stack - base, frame)
        signed = measures.area(local[..., :2])
        turned = signed < 0.0
        local[turned] = local[turned][:, ::-1]
        flat = local[..., :2]
        middle = np.column_stack([measures.centroid(flat), local[..., 2].mean(axis=1)])
        origin[chosen] = base[:, 0] + np.einsum("ni,nij->nj", middle, frame)
        area[chosen] = np.abs(signed)
        c_t[chosen] = measures.torsion_length(flat)
        l1[chosen], l2[chosen] = measures.sizes(flat).T
        for index in chosen[turned]:
            polygons[index] = polygons[index][::-1]
    for chosen, stack in measures.by_corner_count([plain[i] for i in np.flatnonzero(rectangle)]):
        which = np.flatnonzero(rectangle)[chosen]
        one, two = (
            stack[:, 1] - stack[:, 0] + stack[:, 2] - stack[:, 3],
            stack[:, 2] - stack[:, 1] + stack[:, 3] - stack[:, 0],
        )
        along = np.abs(np.einsum("nj,nj->n", one, e1[which])) > np.abs(np.einsum("nj,nj->n", two, e1[which]))
        first, second = 0.5 * np.linalg.norm(one, axis=1), 0.5 * np.linalg.norm(two, axis=1)
        l1[which], l2[which] = np.where(along, first, second), np.where(along, second, first)
        c_t[which] = measures.rectangle_torsion_length(l1[which], l2[which])
    return Interfaces(
        a=np.array([c.a for c in contacts], dtype=np.int64),
        b=np.array([c.b for c in contacts], dtype=np.int64),
        origin=origin,
        normal=normal,
        e1=e1,
        e2=e2,
        l1=l1,
        l2=l2,
        area=area,
        c_t=c_t,
        rectangle=rectangle,
        polygon=tuple(polygons),
    )
