"""What a structure is under a crack model: its elements, their cells, or stress and velocity fields."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from jld_core.arrays import Bits
from jld_core.assembly import Assembly
from jld_core.errors import InputError, ParameterError
from jld_core.limit import Model
from jld_core.scene.cracks import CellCracks, FieldCracks, cracks_of

_DIVIDES: Final = 1e-9  # relative error that a whole number of cells may have


def under(assembly: Assembly, model: Model | None = None) -> Assembly:
    """Return an assembly with the crack model that a model names, else with its own."""
    cracks = assembly.cracks if model is None or model.cracks is None else cracks_of(model.cracks)
    return assembly if cracks == assembly.cracks else replace(assembly, cracks=cracks)


def require_cracks(assembly: Assembly, model: Model | None = None) -> None:
    """Raise InputError if an assembly cannot be analysed with its crack model.

    Cells must divide the grid. With cracks by fields no option may ask for another model or solver, and
    `require_fields` must pass.

    Parameters
    ----------
    assembly : Assembly
        Structure.
    model : Model, optional
        Model; None: the default.
    """
    if isinstance(assembly.cracks, CellCracks):
        _require_cells(assembly, assembly.cracks.cell, model)
    if not isinstance(assembly.cracks, FieldCracks):
        return
    model = model or Model()
    asked = [*model.beyond_whole_faces]
    asked += [name for name in ("condense", "solver") if getattr(model, name) != getattr(Model, name)]
    for name in asked:
        raise ParameterError(name, "cracks by fields do not support it", "the default, or cracks by faces")
    from jld_core.fields.problem import require_fields  # `jld check` without fields is to start quickly

    require_fields(assembly)


def rigid(assembly: Assembly, labels: Bits, what: str = "") -> tuple[Assembly, Bits]:
    """Return the rigid elements under a crack model: those of the assembly, or the finer cells.

    Parameters
    ----------
    assembly : Assembly
        Assembly with its crack model, see `under`.
    labels : (m,) or (k, m) bool array
        Labels, True = dry.
    what : str
        What needs rigid elements, to refuse cracks by fields; "" where fields are left as they are.

    Returns
    -------
    (Assembly, (M,) or (k, M) bool array)
        Elements that are solved as rigid, and their labels.

    Raises
    ------
    InputError
        Blocks crack by fields and `what` is given, or no cells can be cut.
    """
    if what and isinstance(assembly.cracks, FieldCracks):
        raise InputError("cracks", f"{what} needs rigid cells, and fields have none", '"faces" or "cells"')
    if not isinstance(assembly.cracks, CellCracks):
        return assembly, labels
    from jld_core.refinement.cells import cells_of

    require_cracks(assembly)
    cells = cells_of(assembly, assembly.cracks.cell)
    return cells.fine, cells.labels(labels)


def _require_cells(assembly: Assembly, cell: float, model: Model | None) -> None:
    """Raise InputError unless cells of size `cell` divide the grid of an assembly's scene."""
    # Of general elements any size is accepted here. The message names the parameter where the model states the cells.
    grid = None if assembly.scene is None else assembly.scene.grid
    if grid is None:
        return
    for name, length in zip(("width", "height"), grid.cell, strict=True):
        parts = length / cell
        if round(parts) < 1 or abs(parts - round(parts)) > _DIVIDES * parts:
            stated = model is not None and model.cracks is not None
            raise (ParameterError if stated else InputError)(
                "cracks",
                f"cells of {cell:g} do not divide the {name} {length:g} of a cell of the grid",
                f"{length:g} over a whole number, as {length / max(2, round(parts)):g}",
            )
