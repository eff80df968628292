"""Writer of 3DEC command files: convex blocks, joins, groups and properties.

The commands follow the manual of 3DEC 7; the output has not been run in 3DEC.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from jld_core.build.materials import gravity_vector
from jld_core.errors import InputError
from jld_core.exchange.layout import Layout
from jld_core.geometry import area_vector, solids
from jld_core.geometry.unions import Surface, extrude, union_outlines, union_solids
from jld_core.strengths import Route

_ROUTE: Final = Route("files of 3DEC")


def command_text(layout: Layout, *, cells: bool = False) -> str:
    """Return 3DEC commands that create elements, join those of a block, and set properties.

    Properties are densities, joint friction and gravity. Joint stiffnesses are not part of a scene; the first lines
    define them for the user to edit. Raises InputError for an element that is not convex.
    """
    assembly = layout.assembly
    elements, strengths = assembly.elements, assembly.strengths(_ROUTE)
    length, force = assembly.units
    vector = gravity_vector(layout.scene.materials, assembly.dimension).tolist()
    vector = [vector[0], 0.0, vector[1]] if assembly.dimension == 2 else vector
    lines = [
        f"; {assembly.name}",
        f"; lengths in {length}, forces in {force}; written by jld",
        "; stiffnesses are no part of the model: set them to those of your joints",
        "model new",
        "fish define joint_stiffness",
        "  global _kn = 1e10",
        "  global _ks = 5e9",
        "end",
        "[joint_stiffness]",
        "",
    ]
    for k, name in enumerate(elements.ids):
        surface = _surface(layout, k)
        if not _convex(surface):
            raise InputError(f"element {name!r}", "it is not convex, as a block of 3DEC must be", "jld refine first")
        block = layout.blocks[int(layout.block_of[k])]
        lines.append(f"block create polyhedron group '{_word(block.name)}' ...")
        loops = [[surface.points[index] for index in loop[::-1]] for loop in surface.faces]
        rows = ["  face " + " ".join(f"({x:.12g},{y:.12g},{z:.12g})" for x, y, z in loop) for loop in loops]
        lines += [row + " ..." for row in rows[:-1]] + [rows[-1]]
    lines.append("")
    for block in layout.blocks:
        if len(block.elements) > 1:
            lines.append(f"block join range group '{_word(block.name)}'")
    for block in layout.blocks:
        if block.cells and block.volume > 0.0:
            density = block.mass / block.volume
            lines.append(f"block property density {density:.9g} range group '{_word(block.name)}'")
        else:
            lines.append(f"block fix range group '{_word(block.name)}'")
    usual = {field: _median(getattr(strengths, field)) for field in ("friction", "tension", "shear")}
    lines += [
        "",
        "block contact jmodel assign mohr",
        "block contact property stiffness-normal [_kn] stiffness-shear [_ks] ...",
        f"  friction {np.degrees(np.arctan(usual['friction'])):.9g} cohesion 0 tension 0",
        "block contact material-table default property stiffness-normal [_kn] stiffness-shear [_ks] ...",
        f"  friction {np.degrees(np.arctan(usual['friction'])):.9g} cohesion 0 tension 0",
        "; cells of one block are joined for good; to let inner faces crack, leave out the joins and give them",
        f";   tension {usual['tension']:.9g}, cohesion {usual['shear']:.9g}, friction 0",
        f"model gravity ({vector[0]:.9g},{vector[1]:.9g},{vector[2]:.9g})",
    ]
    return "\n".join(lines) + "\n"


def _surface(layout: Layout, k: int) -> Surface:
    """Return the closed surface of an element."""
    elements = layout.assembly.elements
    if layout.assembly.dimension == 2:
        return extrude(union_outlines([elements.shape[k]])[0], layout.thickness)
    vertices, faces, _, _ = solids([elements.ids[k]], [elements.shape[k]], [elements.faces[k]])
    return union_solids(vertices, faces)


def _convex(surface: Surface) -> bool:
    """Return True if all points of a surface lie behind each of its faces."""
    points = surface.points
    size = float(np.ptp(points, axis=0).max())
    for loop in surface.faces:
        corners = points[list(loop)]
        normal = area_vector(corners)
        normal /= np.linalg.norm(normal)
        if ((points - corners.mean(axis=0)) @ normal).max() > 1e-5 * size:
            return False
    return True


def _median(values: np.ndarray) -> float:
    """Return the median of the finite values, or 0."""
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else 0.0


def _word(name: str) -> str:
    """Replace apostrophes in a name by underscores."""
    return name.replace("'", "_")
