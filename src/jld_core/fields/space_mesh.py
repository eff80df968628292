"""Tetrahedra in the cells of a spatial assembly, conforming across interfaces; bisection."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from jld_core.arrays import Bools, Floats, Ints
from jld_core.fields.outlines import FREE

# Local corners of the four faces of a tetrahedron, counter-clockwise seen from outside; face k lacks corner k
_SIDES = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])

_EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])  # local corners of the six edges of a tetrahedron

# Weight of the length alone in the choice of an edge. Layers end at an aspect ratio of half its inverse.
_ASPECT = 0.05

_DIGITS = 9  # decimal digits to which lengths of edges are compared; edges of equal length are ordered by number


@dataclass(frozen=True)
class Sides:
    """Triangles of a mesh of tetrahedra, as arrays over f triangles.

    a, b: (f,) tetrahedra; b = −1 on a surface or support. corner_a, corner_b: (f, 3) which corners (0 to 3) of a and b
    the same three nodes are. normal: (f, 3) unit vector from a to b, or outward. area: (f,). tag: (f,) as
    `SolidMesh.tag`; triangles inside a cell and free ones have FREE = −1.
    """

    a: Ints
    b: Ints
    corner_a: Ints
    corner_b: Ints
    normal: Floats
    area: Floats
    tag: Ints

    def __len__(self) -> int:
        return len(self.a)


@dataclass(frozen=True)
class SolidMesh:
    """Tetrahedra over common nodes.

    Parameters
    ----------
    points : (p, 3) float array
        Nodes, scene units.
    tetrahedra : (t, 4) int array
        Nodes of each tetrahedron, of positive volume (b − a) · (c − a) × (d − a).
    cell : (t,) int array
        Element of each tetrahedron.
    root : (t,) int array
        Tetrahedron of the coarsest mesh that contains it.
    tagged : (k, 3) int array
        Nodes of the triangles on interfaces and load patches, in ascending order.
    tag : (k,) int array
        Tag of each of these triangles: an interface, or −2 − the number of a load patch.
    """

    points: Floats
    tetrahedra: Ints
    cell: Ints
    root: Ints
    tagged: Ints
    tag: Ints

    def __len__(self) -> int:
        return len(self.tetrahedra)

    @cached_property
    def corners(self) -> Floats:
        """(t, 4, 3) positions of the corners of each tetrahedron."""
        return self.points[self.tetrahedra]

    @cached_property
    def volume(self) -> Floats:
        """(t,) volumes of the tetrahedra, positive."""
        arm = self.corners[:, 1:] - self.corners[:, :1]
        return np.asarray(np.einsum("ti,ti->t", arm[:, 0], np.cross(arm[:, 1], arm[:, 2])) / 6.0)

    @cached_property
    def gradient(self) -> Floats:
        """(t, 4, 3) gradients of the linear functions that are 1 at one corner, 0 at the others."""
        side = self.corners[:, _SIDES]
        outward = np.cross(side[:, :, 1] - side[:, :, 0], side[:, :, 2] - side[:, :, 0])
        return np.asarray(-outward / (6.0 * self.volume[:, None, None]))

    @cached_property
    def sides(self) -> Sides:
        """All triangles with their neighbours, each once.

        Where two cells share a triangle that is on no interface, each cell has one of its own.
        """
        loose = self.tetrahedra[:, _SIDES].reshape(-1, 3)
        whole, number = np.unique(np.sort(loose, axis=1), axis=0, return_inverse=True)
        number = number.ravel()
        tags = self._tags(whole)
        order = np.argsort(number, kind="stable")
        place, start, count = np.unique(number[order], return_index=True, return_counts=True)
        first = order[start]
        second = np.where(count == 2, order[np.minimum(start + 1, len(order) - 1)], -1)
        tags = tags[place]
        apart = (second >= 0) & (tags < 0) & (self.cell[first // 4] != self.cell[np.maximum(second, 0) // 4])
        extra = second[apart]
        second = np.concatenate([np.where(apart, -1, second), np.full(len(extra), -1, dtype=np.int64)])
        tags = np.concatenate([tags, tags[apart]])
        first = np.concatenate([first, extra])
        a, corner_a = first // 4, _SIDES[first % 4]
        b = np.where(second >= 0, second // 4, -1)
        nodes = self.tetrahedra[a[:, None], corner_a]
        other = self.tetrahedra[np.maximum(b, 0)]
        corner_b = (other[:, None, :] == nodes[:, :, None]).argmax(axis=2)
        places = self.points[nodes]
        outward = np.cross(places[:, 1] - places[:, 0], places[:, 2] - places[:, 0])
        double = np.linalg.norm(outward, axis=1)
        return Sides(a, b, corner_a, corner_b, outward / double[:, None], 0.5 * double, tags)

    def _tags(self, whole: Ints) -> Ints:
        """Return the tag (u,) of each triangle; FREE without one.

        whole: (u, 3) nodes of the triangles, each row ascending, rows in lexicographic order.
        """
        tags = np.full(len(whole), FREE, dtype=np.int64)
        if len(self.tagged):
            _, number = np.unique(np.concatenate([whole, self.tagged]), axis=0, return_inverse=True)
            number = number.ravel()
            # every tagged triangle is a side, so that numbers of sides are their places
            tags[number[len(whole) :]] = self.tag
        return tags


def patch_tag(patch: int) -> int:
    """Return the tag, −2 − patch, of the triangles on load patch number `patch` ≥ 0."""
    return -2 - patch


def bisect(mesh: SolidMesh, marked: Bools, weight: Floats | None = None) -> SolidMesh:
    """Halve one edge of each marked tetrahedron, and others where quality asks for it.

    An edge is halved in all tetrahedra around it at once, so that the mesh stays conforming. Without weights a
    tetrahedron with a halved edge has its longest one halved before (Rivara 1991, longest-edge bisection).

    Parameters
    ----------
    mesh : SolidMesh
        Any mesh.
    marked : (t,) bool array
        Tetrahedra to split.
    weight : (t, 4) float array, optional
        Weights of the corners of each tetrahedron, of sum 1 or all 0. Its edge is then the one with the greatest length
        × (difference of the weights + a little), so that layers grow along edges where weights are great.

    Returns
    -------
    SolidMesh
        Conforming; tags and roots are inherited.
    """
    ends = np.sort(mesh.tetrahedra[:, _EDGES], axis=2)
    unique, number = np.unique(ends.reshape(-1, 2), axis=0, return_inverse=True)
    number = number.reshape(-1, 6)
    length = np.linalg.norm(mesh.points[unique[:, 1]] - mesh.points[unique[:, 0]], axis=1)
    rank = np.empty(len(unique), dtype=np.int64)
    order = np.lexsort((-np.arange(len(unique)), np.round(length / length.max(), _DIGITS)))
    rank[order] = np.arange(len(unique))
    split = np.zeros(len(unique), dtype=bool)
    every = np.arange(len(mesh))
    if weight is not None:
        steep = _ASPECT + abs(weight[:, _EDGES[:, 0]] - weight[:, _EDGES[:, 1]])
        best = np.argmax(np.round(length[number] * steep / length.max(), _DIGITS) + 1e-12 * rank[number], axis=1)
        split[number[every, best][marked]] = True
        return halve_edges(mesh, unique[[edge for edge in order[::-1].tolist() if split[edge]]])
    longest = number[every, np.argmax(rank[number], axis=1)]
    split[longest[marked]] = True
    while True:
        more = split[number].any(axis=1) & ~split[longest]
        if not more.any():
            break
        split[longest[more]] = True
    return halve_edges(mesh, unique[[edge for edge in order[::-1].tolist() if split[edge]]])


def split_at_centroids(mesh: SolidMesh) -> SolidMesh:
    """Return the mesh with every tetrahedron split in four at its centroid (Alfeld 1984).

    Parameters
    ----------
    mesh : SolidMesh
        Any mesh.

    Returns
    -------
    SolidMesh
        Part k of tetrahedron i is number 4 i + k; its corner k is the centroid, the others are those of i.
    """
    parts = np.repeat(mesh.tetrahedra[:, None], 4, axis=1)
    parts[:, np.arange(4), np.arange(4)] = len(mesh.points) + np.arange(len(mesh))[:, None]
    return SolidMesh(
        points=np.concatenate([mesh.points, mesh.corners.mean(axis=1)]),
        tetrahedra=parts.reshape(-1, 4),
        cell=np.repeat(mesh.cell, 4),
        root=np.repeat(mesh.root, 4),
        tagged=mesh.tagged,
        tag=mesh.tag,
    )


def halve_edges(mesh: SolidMesh, edges: Ints) -> SolidMesh:
    """Halve edges one after another, each in all tetrahedra and tagged triangles around it.

    Parameters
    ----------
    mesh : SolidMesh
        Any mesh.
    edges : (k, 2) int array
        Nodes of the edges in ascending order.

    Returns
    -------
    SolidMesh
        Conforming; tags and roots are inherited.
    """
    solids = [tuple(nodes) for nodes in mesh.tetrahedra.tolist()]
    parent = list(range(len(solids)))
    around: dict[int, set[int]] = {}
    for index, nodes in enumerate(solids):
        for node in nodes:
            around.setdefault(node, set()).add(index)
    tags = {tuple(nodes): tag for nodes, tag in zip(mesh.tagged.tolist(), mesh.tag.tolist(), strict=True)}
    touching: dict[int, set[tuple[int, ...]]] = {}
    for key in tags:
        for node in key:
            touching.setdefault(node, set()).add(key)
    points = mesh.points.tolist()
    for i, j in edges.tolist():
        middle = len(points)
        points.append([0.5 * (p + q) for p, q in zip(points[i], points[j], strict=True)])
        around[middle] = set()
        for index in sorted(around[i] & around[j]):
            nodes = solids[index]
            solids[index] = tuple(middle if node == j else node for node in nodes)
            other = tuple(middle if node == i else node for node in nodes)
            around[j].discard(index)
            for node in other:
                around[node].add(len(solids))
            around[middle].add(index)
            solids.append(other)
            parent.append(parent[index])
        for key in sorted(touching.get(i, set()) & touching.get(j, set())):
            tag = tags.pop(key)
            for node in key:
                touching[node].discard(key)
            for gone in (i, j):
                half = tuple(sorted(middle if node == gone else node for node in key))
                tags[half] = tag
                for node in half:
                    touching.setdefault(node, set()).add(half)
    return SolidMesh(
        points=np.array(points),
        tetrahedra=np.array(solids, dtype=np.int64),
        cell=mesh.cell[parent],
        root=mesh.root[parent],
        tagged=np.array(list(tags), dtype=np.int64).reshape(-1, 3),
        tag=np.array(list(tags.values()), dtype=np.int64),
    )


__all__ = ["FREE", "Sides", "SolidMesh", "bisect", "halve_edges", "patch_tag", "split_at_centroids"]
