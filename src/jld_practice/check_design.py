"""Provide `jld check-design`: utilisation of a layout with partial factors, and its page."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Literal

import typer

from jld_core.arrays import Bits
from jld_core.errors import ParameterError, error_context
from jld_core.files import require_folder, write_text
from jld_core.limit import FIELD_SECONDS
from jld_core.scene import Scene
from jld_core.scene.design import partial_factors
from jld_explore.cli.check import load, warn_of
from jld_explore.cli.ending import UNCERTIFIED
from jld_explore.cli.options import AsJson, CaseSeconds, Cracks, Rank, with_cracks
from jld_explore.cli.streams import say


def check_design(
    source: Annotated[
        Path, typer.Argument(help="A scene, or a folder of jld explore or jld design.", show_default=False)
    ],
    rank: Rank = None,
    set_: Annotated[
        str | None,
        typer.Option("--set", help="Set of partial factors: EN 1990, EN 1990 EQU, EN 1996-1-1, or one of the scene."),
    ] = None,
    cracks: Cracks = None,
    seconds: CaseSeconds = None,
    out: Annotated[Path | None, typer.Option("-o", "--out", help="Folder for page (PDF, HTML) and JSON.")] = None,
    language: Annotated[Literal["en", "de", "it"], typer.Option(help="Language of the page.")] = "en",
    as_json: AsJson = False,
) -> None:
    """Check a layout with partial factors: utilisation, reactions, joints near their limit.

    Utilisation is required factor over λ at design values; at most 1 is verified. Permanent loads are tried as
    favourable
    and as unfavourable. The exit code is 4 if neither result is proven.
    """
    from jld_practice.design_check.check import design_check
    from jld_practice.design_check.tables import in_words, to_json

    if out is not None:
        require_folder(out)
    scene, labels = _layout(source, rank)
    with error_context(source):
        scene = with_cracks(scene, cracks)
        check = design_check(
            scene, labels, partial_factors(scene.design, set_), seconds=FIELD_SECONDS if seconds is None else seconds
        )
    if not as_json and not source.is_dir():
        warn_of(source, check.assembly)
    told = json.dumps(to_json(check), indent=1)
    if out is not None:
        from jld_practice.design_check.page import write_pages

        out.mkdir(parents=True, exist_ok=True)
        write_text(out / "design_check.json", told)
        write_pages(check, out, language)
    say(told if as_json else in_words(check))
    if check.verified is None:
        raise typer.Exit(UNCERTIFIED)


def _layout(source: Path, rank: int | None) -> tuple[Scene, Bits | None]:
    """Return the scene and the labels (m,) to check; None for those of the scene."""
    best = source / "best.json"
    file = best if source.is_dir() and best.exists() else source
    if not file.is_dir():
        if rank is not None:
            raise ParameterError("rank", f"{file} is a scene, which has no ranks", "a folder written by jld explore")
        return load(file)[0], None
    from jld_explore.cli.layout import layout_of, require_whole_faces  # a folder needs pandas, a scene does not

    scene, _, labels, model = layout_of(source, rank)
    with error_context(source):
        require_whole_faces(model, "the design check")
    return scene, labels
