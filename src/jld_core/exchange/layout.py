"""A layout: one labelling of an assembly as the blocks that a saw would cut."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from jld_core.arrays import Bits, Ints
from jld_core.assembly import Assembly, blocks_of
from jld_core.geometry import (
    Outlines,
    Region,
    Surface,
    extrude,
    reach_of,
    shape_numbers,
    union_outlines,
    union_solids,
)
from jld_core.limit import LimitAnalysisResult
from jld_core.scene import Scene


@dataclass(frozen=True)
class Block:
    """One block. elements: indices, free ones and supports glued to it. support: it holds a support.

    cells: free elements in it. volume, mass: of those (mass is weight over gravity, kg with m and N). centroid: of
    their weight, of their volume where there is none. lower, upper: bounding box. shape: number of its shape, from 1,
    0 for supports. dry, inner: length of joints around it and of cracks in it (spatial: area).
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
    """An assembly under one labelling, as blocks. labels: (m,) True dry. result: its analysis, where it was made."""

    scene: Scene
    assembly: Assembly
    labels: Bits
    result: LimitAnalysisResult | None = None

    @cached_property
    def block_of(self) -> Ints:
        """(n,) position in `blocks` of each element's block; blocks with free elements come first."""
        number = blocks_of(self.assembly, self.labels)
        free = ~self.assembly.elements.support
        _, first = np.unique(number, return_index=True)
        grounded = [not free[number == number[k]].any() for k in first]
        order = [k for _, k in sorted(zip(grounded, first.tolist(), strict=True))]
        place = {int(number[k]): position for position, k in enumerate(order)}
        return np.array([place[int(k)] for k in number], dtype=np.int64)

    @cached_property
    def members(self) -> tuple[Ints, ...]:
        """Elements of each block, ascending."""
        return tuple(np.flatnonzero(self.block_of == k) for k in range(int(self.block_of.max()) + 1))

    @cached_property
    def regions(self) -> tuple[tuple[Region, ...], ...]:
        """Planar: outlines of each block, with holes."""
        shapes = self.assembly.elements.shape
        return tuple(tuple(union_outlines([shapes[k] for k in one.tolist()])) for one in self.members)

    @cached_property
    def surfaces(self) -> tuple[tuple[Surface, ...], ...]:
        """Closed surfaces of each block; planar ones extruded from y = 0, with the plane's y as z."""
        elements = self.assembly.elements
        if self.assembly.dimension == 2:
            depth = self.thickness
            return tuple(tuple(extrude(region, depth) for region in regions) for regions in self.regions)
        return tuple(
            (union_solids([elements.shape[k] for k in one.tolist()], [elements.faces[k] for k in one.tolist()]),)
            for one in self.members
        )

    @property
    def thickness(self) -> float:
        """Out-of-plane depth of a planar scene."""
        scene = self.scene
        return scene.grid.thickness if scene.grid is not None else (scene.thickness or 1.0)

    @cached_property
    def blocks(self) -> tuple[Block, ...]:
        """All blocks, those that are only supports last."""
        elements, faces = self.assembly.elements, self.assembly.interfaces
        weight = np.linalg.norm(elements.weight, axis=1)
        extent = self.assembly.face_sizes
        block_a, block_b = self.block_of[faces.a], self.block_of[faces.b]
        shapes = self._shapes()
        found = []
        for k, one in enumerate(self.members):
            free = one[~elements.support[one]]
            own = free if len(free) else one
            around = self.labels & ((block_a == k) | (block_b == k))
            inside = ~self.labels & (block_a == k) & (block_b == k)
            share = weight[own] if weight[own].sum() > 0.0 else elements.volume[own]
            found.append(
                Block(
                    name=self._name(one),
                    elements=tuple(one.tolist()),
                    support=bool(elements.support[one].any()),
                    cells=len(free),
                    volume=float(elements.volume[own].sum()),
                    mass=float(elements.mass[own].sum()),
                    centroid=tuple((share @ elements.centroid[own] / share.sum()).tolist()),
                    lower=tuple(elements.lower[own].min(axis=0).tolist()),
                    upper=tuple(elements.upper[own].max(axis=0).tolist()),
                    shape=shapes[k],
                    dry=float(extent[around].sum()),
                    inner=float(extent[inside].sum()),
                )
            )
        return tuple(found)

    def _name(self, members: Ints) -> str:
        """The scene's name of a block that is the whole of one of its blocks, else the name of its first element."""
        elements = self.assembly.elements
        name = elements.blocks[int(members[0])]
        whole = [k for k, other in enumerate(elements.blocks) if other == name]
        return name if name is not None and whole == members.tolist() else elements.ids[int(members[0])]

    def _shapes(self) -> list[int]:
        """Number of the shape of each block; a planar block may be turned over, a spatial one may not be mirrored."""
        elements = self.assembly.elements
        planar = self.assembly.dimension == 2
        chosen = [k for k, one in enumerate(self.members) if not elements.support[one].all()]
        # what the block is without a support that it is glued to
        shapes = Outlines(self.assembly)
        outlines = [shapes.of(one[~elements.support[one]]) for one in map(self.members.__getitem__, chosen)]
        numbers = [0] * len(self.members)
        for k, number in zip(chosen, shape_numbers(outlines, reach_of(self.assembly), flip=planar), strict=True):
            numbers[k] = number
        return numbers

    def table(self) -> list[dict[str, Any]]:
        """Rows of blocks.csv: the blocks that hold a free element, with their names, sizes and shapes."""
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
        # to twelve digits: what sums leave behind the last is no news
        return [
            {key: float(f"{value:.12g}") if isinstance(value, float) else value for key, value in row.items()}
            for row in rows
        ]
