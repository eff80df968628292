"""Check that a scene and its options allow the crack model of the scene."""

from __future__ import annotations

from typing import Final

from jld_core.assembly import Assembly
from jld_core.errors import InputError, ParameterError
from jld_core.limit import SolveOptions
from jld_core.scene import Scene
from jld_core.scene.cracks import CellCracks, FieldCracks

FIELD_SECONDS: Final = 60.0
"""Default time for the bounds of one load case, s; no mesh is begun that is not expected to be done by then."""


def require_cracks(
    scene: Scene, assembly: Assembly, options: SolveOptions | None = None, where: str = "cracks"
) -> None:
    """Raise InputError if a scene cannot be analysed with its crack model.

    Parameters
    ----------
    scene : Scene
        Scene with the crack model.
    assembly : Assembly
        Assembly of the scene.
    options : SolveOptions, optional
        Model options. Cracks by fields require the default of every option.
    where : str
        Key or option that states the crack model, for error messages.

    Raises
    ------
    InputError
        If the cells do not divide the grid. With cracks by fields: if an option differs from its default, or as
        `require_fields` (planar) or `require_spatial_fields`.
    """
    if isinstance(scene.cracks, CellCracks):
        _require_cells(scene, scene.cracks.cell, where)
    if not isinstance(scene.cracks, FieldCracks):
        return
    default = SolveOptions()
    for name, value in vars(options or default).items():
        if value != getattr(default, name):
            raise ParameterError(name, "cracks by fields do not support it", "the default, or cracks by faces")
    # Local imports: `jld check` and `jld solve` without fields are to start quickly.
    if assembly.dimension == 3:
        from jld_core.fields.space_bounds import require_spatial_fields

        require_spatial_fields(assembly)
    else:
        from jld_core.fields.requirements import require_fields

        require_fields(assembly)


def _require_cells(scene: Scene, cell: float, where: str) -> None:
    """Raise InputError unless cells of size `cell` divide the grid of a scene.

    Of general elements any size is accepted here. where: key or option of the size, for the message.
    """
    if scene.grid is None:
        return
    for name, length in zip(("width", "height"), scene.grid.cell, strict=True):
        parts = length / cell
        if round(parts) < 1 or abs(parts - round(parts)) > _DIVIDES * parts:
            raise InputError(
                where,
                f"cells of {cell:g} do not divide the {name} {length:g} of a cell of the grid",
                f"{length:g} over a whole number, as {length / max(2, round(parts)):g}",
            )


_DIVIDES: Final = 1e-9
"""Relative error that a whole number of cells may have."""
