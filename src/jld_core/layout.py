"""Layout: an assembly under one labelling, as the blocks to be cut."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import shapely

from jld_core.arrays import Bits, Floats, Ints
from jld_core.assembly import Assembly, blocks_of, faces_of
from jld_core.files import harmless
from jld_core.geometry.outlines import Outlines, reach_of, shape_numbers
from jld_core.geometry.unions import Region, Surface, extrude, union_outlines, union_solids
from jld_core.limit.mechanism import result_of_faces
from jld_core.limit.result import LimitAnalysisResult
from jld_core.parameters import typed
from jld_core.scene.schema import Scene


@dataclass(frozen=True)
class Block:
    """One block of a layout.

    Attributes
    ----------
    name : str
        Name of the block.
    elements : tuple of int
        Indices of all elements, including supports joined to it.
    support : bool
        True if it holds a support.
    cells : int
        Number of free elements.
    volume, mass : float
        Volume and mass of the free elements (of supports where there are none); mass is weight over gravity, kg with m
        and N.
    centroid : tuple of float
        Centre of weight; centre of volume where there is no weight.
    lower, upper : tuple of float
        Corners of the bounding box.
    shape : int
        Number of its shape from 1; 0 for supports.
    dry, inner : float
        Length of dry faces around it and of inner faces within it (spatial: area).
    """

    name: str
    elements: tuple[int, ...]
    support: bool
    cells: int
    volume: float
    mass: float
    centroid: tuple[float, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    shape: int
    dry: float
    inner: float


@dataclass(frozen=True)
class Layout:
    """Assembly under one labelling, as blocks.

    Attributes
    ----------
    scene : Scene
        Scene of the assembly.
    assembly : Assembly
        Assembly with n elements and m interfaces.
    labels : (m,) bool array
        Labels, True = dry.
    result : LimitAnalysisResult or None
        Its analysis, where available.
    drawn_from : Layout or None
        Layout in the unit of the scene, for one whose geometry is in another unit.
    """

    scene: Scene
    assembly: Assembly
    labels: Bits
    result: LimitAnalysisResult | None = None
    drawn_from: Layout | None = None

    @cached_property
    def block_of(self) -> Ints:
        """Position in `blocks` of each element's block (n,)."""
        label = blocks_of(self.assembly, self.labels)
        free = ~self.assembly.elements.support
        _, first = np.unique(label, return_index=True)
        grounded = [not free[label == label[k]].any() for k in first]
        order = [k for _, k in sorted(zip(grounded, first.tolist(), strict=True))]
        position_of = {int(label[k]): position for position, k in enumerate(order)}
        return np.array([position_of[int(k)] for k in label], dtype=np.int64)

    @cached_property
    def members(self) -> tuple[Ints, ...]:
        """Indices of the elements of each block, ascending, in the order of `blocks`."""
        return tuple(np.flatnonzero(self.block_of == k) for k in range(int(self.block_of.max()) + 1))

    @cached_property
    def regions(self) -> tuple[tuple[Region, ...], ...]:
        """Plane regions of each block, one per connected part, with holes; planar scenes only."""
        shapes = self.assembly.elements.shape
        return tuple(tuple(union_outlines([shapes[k] for k in block.tolist()])) for block in self.members)

    @cached_property
    def openings(self) -> tuple[Floats, ...]:
        """Outlines (k, 2) of the empty parts of holes in blocks; planar scenes only."""
        holes = [shapely.Polygon(hole) for regions in self.regions for region in regions for hole in region.holes]
        if not holes:
            return ()
        size = self.assembly.size
        filled = shapely.union_all([shapely.Polygon(shape) for shape in self.assembly.elements.shape])
        empty = shapely.difference(shapely.union_all(holes), filled.buffer(1e-9 * size))
        parts = [part for part in shapely.get_parts(empty) if part.area > 1e-8 * size**2]
        outlines = [hole for hole in holes if any(hole.covers(part.representative_point()) for part in parts)]
        # a hole that is empty as a whole keeps its exact corners
        empty_holes = [hole for hole in outlines if hole.area - empty.intersection(hole).area <= 1e-6 * hole.area]
        partial = [part for part in parts if not any(hole.covers(part.representative_point()) for hole in empty_holes)]
        return tuple(shapely.get_coordinates(part.exterior)[:-1] for part in [*empty_holes, *partial])

    @cached_property
    def surfaces(self) -> tuple[tuple[Surface, ...], ...]:
        """Closed surfaces of each block; planar ones are extruded along y from 0 to the thickness, y becomes z."""
        elements = self.assembly.elements
        if self.assembly.dimension == 2:
            depth = self.thickness
            return tuple(tuple(extrude(region, depth) for region in regions) for regions in self.regions)
        return tuple(
            (union_solids([elements.shape[k] for k in block.tolist()], [elements.faces[k] for k in block.tolist()]),)
            for block in self.members
        )

    @property
    def thickness(self) -> float:
        """Out-of-plane depth of a planar scene, in the unit of the assembly."""
        if self.drawn_from is None:
            return self.scene.plane_thickness
        return self.scene.plane_thickness * self.assembly.size / self.drawn_from.assembly.size

    @cached_property
    def blocks(self) -> tuple[Block, ...]:
        """All blocks; those with a free element come first, blocks of supports alone last."""
        elements, faces = self.assembly.elements, self.assembly.interfaces
        weight = np.linalg.norm(elements.weight, axis=1)
        face_size = self.assembly.face_sizes
        block_a, block_b = self.block_of[faces.a], self.block_of[faces.b]
        shapes = self._shapes()
        blocks = []
        for k, members in enumerate(self.members):
            free = members[~elements.support[members]]
            counted = free if len(free) else members
            dry_around = self.labels & ((block_a == k) | (block_b == k))
            inner_inside = ~self.labels & ~self.assembly.of_members & (block_a == k) & (block_b == k)
            share = weight[counted] if weight[counted].sum() > 0.0 else elements.volume[counted]
            blocks.append(
                Block(
                    name=self._name(members),
                    elements=tuple(members.tolist()),
                    support=bool(elements.support[members].any()),
                    cells=len(free),
                    volume=float(elements.volume[counted].sum()),
                    mass=float(elements.mass[counted].sum()),
                    centroid=tuple((share @ elements.centroid[counted] / share.sum()).tolist()),
                    lower=tuple(elements.lower[counted].min(axis=0).tolist()),
                    upper=tuple(elements.upper[counted].max(axis=0).tolist()),
                    shape=shapes[k],
                    dry=float(face_size[dry_around].sum()),
                    inner=float(face_size[inner_inside].sum()),
                )
            )
        return tuple(blocks)

    def _name(self, members: Ints) -> str:
        """Return a block's name: that of the scene for exactly these elements, else the first id.

        members: (k,) indices of its elements.
        """
        elements = self.assembly.elements
        name = elements.blocks[int(members[0])]
        named_so = self._named.get(name, [])
        return name if name is not None and named_so == members.tolist() else elements.ids[int(members[0])]

    @cached_property
    def _named(self) -> dict[str | None, list[int]]:
        by_name: dict[str | None, list[int]] = {}
        for k, name in enumerate(self.assembly.elements.blocks):
            by_name.setdefault(name, []).append(k)
        return by_name

    def _shapes(self) -> list[int]:
        """Return the shape number of each block: from 1, equal for equal shapes; 0 for supports."""
        # Supports are blocks without a free element. Planar blocks may be mirrored (turned over), spatial ones may not.
        elements = self.assembly.elements
        planar = self.assembly.dimension == 2
        free_blocks = [k for k, block in enumerate(self.members) if not elements.support[block].all()]
        # the outline of a block excludes supports joined to it
        shapes = Outlines(self.assembly)
        members = [self.members[k] for k in free_blocks]
        outlines = [shapes.of(block[~elements.support[block]]) for block in members]
        numbers = [0] * len(self.members)
        for k, number in zip(free_blocks, shape_numbers(outlines, reach_of(self.assembly), flip=planar), strict=True):
            numbers[k] = number
        return numbers

    def without_members(self) -> Layout:
        assembly = faces_of(self.assembly)
        if assembly is self.assembly:
            return self
        result = None if self.result is None else result_of_faces(self.result)
        return replace(self, assembly=assembly, labels=self.labels[: assembly.faces], result=result)

    def table(self) -> list[dict[str, Any]]:
        """Return the rows of `blocks.csv`.

        One dict by column per block with a free element, scene units, twelve digits.
        """
        ids, axes = self.assembly.elements.ids, "xyz"[: self.assembly.dimension]
        measure = "length" if self.assembly.dimension == 2 else "area"
        rows = [
            {
                "block": block.name,
                "elements": " ".join(ids[k] for k in block.elements),
                "cells": block.cells,
                "mass": block.mass,
                **{f"centroid_{axis}": value for axis, value in zip(axes, block.centroid, strict=True)},
                **{
                    f"extent_{axis}": high - low for axis, low, high in zip(axes, block.lower, block.upper, strict=True)
                },
                "shape": block.shape,
                "volume": block.volume,
                f"dry_{measure}": block.dry,
                f"inner_{measure}": block.inner,
            }
            for block in self.blocks
            if block.cells
        ]
        # twelve digits: sums have rounding errors in the last ones
        return [
            {key: float(f"{value:.12g}") if isinstance(value, float) else value for key, value in row.items()}
            for row in rows
        ]


@typed
def blocks_csv(layout: Layout) -> str:
    """Return the text of blocks.csv: one row for each block with a free element.

    Parameters
    ----------
    layout : Layout
        Layout of the blocks.

    Returns
    -------
    str
        CSV text with a header.
    """
    rows = layout.table()
    stream = io.StringIO()
    writer = csv.DictWriter(stream, list(rows[0]) if rows else ["block"], lineterminator="\n")
    writer.writeheader()
    writer.writerows({key: harmless(value) for key, value in row.items()} for row in rows)
    return stream.getvalue()
