"""Provide `jld check-design`: utilisation of a layout with partial factors, and its page."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Literal

import typer

from jld_core import Bits, ParameterError, Scene, error_context, files
from jld_core.limit import FIELD_SECONDS
from jld_core.scene import design
from jld_explore.cli import check as cli_check
from jld_explore.cli import ending, options, streams


def check_design(
    source: Annotated[
        Path, typer.Argument(help="A scene, or a folder of jld explore or jld design.", show_default=False)
    ],
    rank: options.Rank = None,
    set_: Annotated[
        str | None,
        typer.Option("--set", help="Set of partial factors: EN 1990, EN 1990 EQU, EN 1996-1-1, or one of the scene."),
    ] = None,
    cracks: options.Cracks = None,
    seconds: options.CaseSeconds = None,
    out: Annotated[Path | None, typer.Option("-o", "--out", help="Folder for page (PDF, HTML) and JSON.")] = None,
    language: Annotated[Literal["en", "de", "it"], typer.Option(help="Language of the page.")] = "en",
    as_json: options.AsJson = False,
) -> None:
    """Check a layout with partial factors: utilisation, reactions, joints near their limit.

    Utilisation is required factor over λ at design values; at most 1 is verified. Permanent loads are tried as
    favourable and as unfavourable. The exit code is 4 if neither result is proven.
    """
    from jld_practice.design_check import design_check, in_words, to_json

    if out is not None:
        files.require_folder(out)
    scene, labels = _layout(source, rank)
    with error_context(source):
        scene = options.with_cracks(scene, cracks)
        check = design_check(
            scene,
            labels,
            design.partial_factors(scene.design, set_),
            seconds=FIELD_SECONDS if seconds is None else seconds,
        )
    if not as_json and not source.is_dir():
        cli_check.warn_of(source, check.assembly)
    text = json.dumps(to_json(check), indent=1)
    if out is not None:
        from jld_practice.design_check.page import write_pages

        out.mkdir(parents=True, exist_ok=True)
        files.write_text(out / "design_check.json", text)
        write_pages(check, out, language)
    streams.say(text if as_json else in_words(check))
    if check.verified is None:
        raise typer.Exit(ending.UNCERTIFIED)


def _layout(source: Path, rank: int | None) -> tuple[Scene, Bits | None]:
    """Return scene and labels of a file, or of a rank in a folder of a search."""
    best = source / "best.json"
    file = best if source.is_dir() and best.exists() else source
    if not file.is_dir():
        if rank is not None:
            raise ParameterError("rank", f"{file} is a scene, which has no ranks", "a folder written by jld explore")
        return cli_check.load(file)[0], None
    from jld_explore.cli import layout  # a folder needs pandas, a scene does not

    scene, _, labels, model = layout.layout_of(source, rank, uncertain=True)
    with error_context(source):
        layout.require_whole_faces(model, "the design check")
    return scene, labels
