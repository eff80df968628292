"""Writers of OBJ, STL and PLY: one closed solid per block, numbers in full precision."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np

from jld_core.exchange.layout import Layout
from jld_core.geometry.unions import Surface, extrude, union_outlines, union_solids


def solids_of(layout: Layout, *, cells: bool) -> Iterator[tuple[str, bool, Surface]]:
    """Yield name, support flag and closed surface of each block, or of each element.

    cells: True for elements. A block of several separate parts gives one solid for each, numbered from 1.
    """
    if not cells:
        for block, surfaces in zip(layout.blocks, layout.surfaces, strict=True):
            for number, surface in enumerate(surfaces):
                name = block.name if len(surfaces) == 1 else f"{block.name}.{number + 1}"
                yield name, block.support, surface
        return
    elements = layout.assembly.elements
    for k, name in enumerate(elements.ids):
        if layout.assembly.dimension == 2:
            (region,) = union_outlines([elements.shape[k]])
            surface = extrude(region, layout.thickness)
        else:
            surface = union_solids([elements.shape[k]], [elements.faces[k]])
        yield name, bool(elements.support[k]), surface


def _title(name: str, support: bool) -> str:
    """Return a name as one word; names of supports contain "support"."""
    word = re.sub(r"\s+", "_", name)
    return word if not support or "support" in word.casefold() else f"{word}_support"


def obj_text(layout: Layout, *, cells: bool) -> str:
    """Return the text of an OBJ file with one group of polygonal faces per solid.

    cells: write every element, not every block. Names of supports contain "support", so that a later import finds them.
    """
    lines = [f"# {layout.assembly.name}, lengths in {layout.assembly.units[0]}, z up; written by jld"]
    start = 1
    for name, support, surface in solids_of(layout, cells=cells):
        lines.append(f"g {_title(name, support)}")
        lines += [f"v {x!r} {y!r} {z!r}" for x, y, z in surface.points.tolist()]
        lines += ["f " + " ".join(str(start + index) for index in loop) for loop in surface.faces]
        start += len(surface.points)
    return "\n".join(lines) + "\n"


def stl_text(layout: Layout, *, cells: bool) -> str:
    """Return the text of an ASCII STL file with one named solid of triangles per block.

    cells: write every element, not every block. Coordinates keep all digits.
    """
    lines = []
    for name, support, surface in solids_of(layout, cells=cells):
        title = _title(name, support)
        lines.append(f"solid {title}")
        for triangle in surface.triangles:
            a, b, c = surface.points[list(triangle)]
            normal = np.cross(b - a, c - a)
            size = float(np.linalg.norm(normal))
            normal = normal / size if size > 0.0 else normal
            lines.append(f" facet normal {normal[0]:.9g} {normal[1]:.9g} {normal[2]:.9g}\n  outer loop")
            lines += [f"   vertex {x!r} {y!r} {z!r}" for x, y, z in (a.tolist(), b.tolist(), c.tolist())]
            lines.append("  endloop\n endfacet")
        lines.append(f"endsolid {title}")
    return "\n".join(lines) + "\n"


def ply_text(layout: Layout, *, cells: bool) -> str:
    """Return the text of an ASCII PLY file of polygonal faces, solid after solid.

    cells: write every element, not every block. PLY has no groups: comments state the names of the solids in their
    order.
    """
    points: list[str] = []
    faces: list[str] = []
    names = []
    for number, (name, support, surface) in enumerate(solids_of(layout, cells=cells)):
        names.append(f"comment block {number} {_title(name, support)}")
        begin = len(points)
        points += [f"{x!r} {y!r} {z!r}" for x, y, z in surface.points.tolist()]
        faces += [f"{len(f)} {' '.join(str(begin + index) for index in f)}" for f in surface.faces]
    head = ["ply", "format ascii 1.0", f"comment {layout.assembly.name}, written by jld", *names]
    head += [f"element vertex {len(points)}", *(f"property double {axis}" for axis in "xyz")]
    head += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    return "\n".join([*head, *points, *faces]) + "\n"
