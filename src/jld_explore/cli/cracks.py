"""Options and output of the crack models: `--cracks faces|cells:SIZE|fields[:GAP]`."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from jld_core.arrays import Bits
from jld_core.assembly import Assembly
from jld_core.errors import InputError, ParameterError
from jld_core.files import require_folder, write_text
from jld_core.limit import LimitAnalysisResult, SolveOptions, Status
from jld_core.models.crack_models import require_cracks
from jld_core.scene import Scene, parse_cracks
from jld_core.scene.cracks import CellCracks, FieldCracks, cracks_in_words, cracks_to_json
from jld_core.views.notebook import aligned, facts_of_result
from jld_explore.cli.ending import UNCERTIFIED
from jld_explore.cli.streams import say

if TYPE_CHECKING:
    from jld_core.models.by_fields import FieldResult

Cracks = Annotated[
    str | None,
    typer.Option(
        help="How blocks crack: faces, cells:SIZE or fields[:GAP]; default: as the scene says, or along its faces."
    ),
]
FieldSeconds = Annotated[
    float, typer.Option("--seconds", min=0.0, help="With --cracks fields: time for the bounds of each load case, s.")
]

_OPTION = "--cracks"


def with_cracks(scene: Scene, text: str | None) -> Scene:
    """Return a scene with the crack model that the option --cracks names.

    text: value of the option; None leaves the scene unchanged. Raises InputError for an unknown model.
    """
    return scene if text is None else scene.model_copy(update={"cracks": parse_cracks(text)})


def check_cracks(scene: Scene, assembly: Assembly, text: str | None, options: SolveOptions, robust: bool) -> None:
    """Raise InputError if the scene or the options of a solve do not fit its crack model.

    text: value of --cracks, None if not given. robust: True with --robust.
    """
    if isinstance(scene.cracks, FieldCracks) and robust:
        raise ParameterError("robust", "cracks by fields take one value of each strength", "cracks by faces or cells")
    require_cracks(scene, assembly, options, "cracks" if text is None else _OPTION)


def say_by_fields(
    scene: Scene, assembly: Assembly, labels: Bits, seconds: float, out: Path | None, as_json: bool
) -> None:
    """Solve a layout whose blocks crack by fields, print the result, and write it to a folder.

    labels: (m,) True = dry. seconds: time for each load case. out: folder for result.json and pictures, None for none.
    as_json: print JSON. Exits with the code of `uncertified` where a bound is missing.
    """
    assert isinstance(scene.cracks, FieldCracks)
    from jld_core.models import solve_by_fields  # loads the mesh and the programs of fields

    found = solve_by_fields(assembly, labels, gap=scene.cracks.gap, seconds=seconds)
    content = json.dumps(found.to_json(), indent=1)
    if out is not None:
        require_folder(out)
        out.mkdir(parents=True, exist_ok=True)
        write_text(out / "result.json", content)
        _draw(found, out)
    say(content if as_json else aligned(found.facts()))
    if found.status is Status.UNCERTIFIED:
        raise typer.Exit(UNCERTIFIED)


def _draw(found: FieldResult, out: Path) -> None:
    """Draw labels, stresses and cracks under each load case into a folder, as png and svg."""
    from jld_core.fields.bounds import FieldBounds
    from jld_core.views import field_figures, figures  # importing matplotlib takes longer than many solves

    several = len(found.cases) > 1
    for k, (case, bounds) in enumerate(zip(found.assembly.by_case, found.cases.values(), strict=True), 1):
        if not isinstance(bounds, FieldBounds):
            continue  # fields in space have no picture
        figure = field_figures.figure_of_fields(case, found.labels, bounds)
        for ending in ("png", "svg"):
            figures.save_figure(figure, out / f"result{f'-{k}' if several else ''}.{ending}")


def rigid_cells(scene: Scene, assembly: Assembly, labels: Bits) -> tuple[Assembly, Bits]:
    """Return the assembly and labels that a command for rigid elements solves.

    If blocks crack by cells, these are the finer cells. labels: (m,) True = dry. Raises InputError where blocks crack
    by fields, or the crack model does not fit the scene.
    """
    if isinstance(scene.cracks, FieldCracks):
        raise InputError("cracks", "this command needs rigid cells, and fields have none", '"faces" or "cells"')
    require_cracks(scene, assembly)
    return of_cells(scene, assembly, labels)


def of_cells(scene: Scene, assembly: Assembly, labels: Bits) -> tuple[Assembly, Bits]:
    """Return the assembly and labels of the finer cells, where blocks crack by cells.

    labels: (m,) True = dry. For other crack models both are returned unchanged.
    """
    if not isinstance(scene.cracks, CellCracks):
        return assembly, labels
    from jld_core.refinement.cells import crack_cells

    cells = crack_cells(scene, assembly, scene.cracks.cell)
    return cells.fine, cells.labels(labels)


def named(scene: Scene, result: LimitAnalysisResult) -> LimitAnalysisResult:
    """Return a result whose `facts` also hold the scene's crack model, for JSON output."""
    return replace(result, facts={"cracks": cracks_to_json(scene.cracks), **result.facts})


def result_in_words(scene: Scene, result: LimitAnalysisResult) -> str:
    """Describe a limit analysis and the scene's crack model for the terminal."""
    return aligned({**facts_of_result(result), "cracks": cracks_in_words(scene.cracks)})
