"""Provide `jld settlement`: thrust and mechanism under movements of supports."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Annotated

import typer

from jld_core.build.settlements import settlements_of
from jld_core.errors import InputError, error_context
from jld_core.files import require_folder, write_text
from jld_core.models import rigid
from jld_explore.cli.ending import UNCERTIFIED
from jld_explore.cli.layout import layout_of, require_whole_faces
from jld_explore.cli.options import AsJson, Rank
from jld_explore.cli.streams import say
from jld_practice.reactions import Settled
from jld_practice.reactions.force_range import settle


def settlement(
    source: Annotated[
        Path,
        typer.Argument(help='A scene file with "settlements", or a folder written by jld explore.', show_default=False),
    ],
    rank: Rank = None,
    out: Annotated[Path | None, typer.Option("-o", "--out", help="Folder for settlement.json and pictures.")] = None,
    as_json: AsJson = False,
) -> None:
    """Bracket the thrust along each movement of supports that a scene names.

    The output has the least and the greatest thrust, with the mechanisms at these ends. The exit code is 4 if an end
    stays uncertified.
    """
    if out is not None:
        require_folder(out)
    scene, assembly, labels, model = layout_of(source, rank)
    if not scene.settlements:
        raise InputError(f"{source}: settlements", "the scene has none", "a list of movements of supports")
    with error_context(source):
        require_whole_faces(model, "a movement of supports")
        assembly, labels = rigid(assembly, labels, "a movement of supports")
        found = [settle(assembly, one, labels) for one in settlements_of(scene, assembly)]
    told = {"name": scene.name, "settlements": [one.to_json() for one in found]}
    if out is not None:
        _write(found, json.dumps(told, indent=1), out)
    say(json.dumps(told, indent=1) if as_json else "\n".join(map(_words, found)))
    ends = [end for one in found for end in (one.least, one.most) if end is not None]
    if any(end.status == "uncertified" for end in ends):
        raise typer.Exit(UNCERTIFIED)


def _words(found: Settled) -> str:
    """Describe the reactions under one settlement."""
    from jld_practice.reactions.settled_figure import words_of

    if found.stands is False:
        return f"{found.settlement.name}: it falls under its dead load alone"
    force = found.assembly.units[1]
    return (
        f"{found.settlement.name}\n"
        f"  least reaction    {words_of(found.least, force)}\n"
        f"  greatest reaction {words_of(found.most, force)}"
    )


def _write(found: list[Settled], told: str, out: Path) -> None:
    """Write settlement.json and one picture per settlement."""
    from jld_core.views.figures import save_figure
    from jld_practice.reactions.settled_figure import figure_of_settled

    out.mkdir(parents=True, exist_ok=True)
    write_text(out / "settlement.json", told)
    for number, one in enumerate(found, 1):
        name = re.sub(r"[^\w-]+", "_", one.settlement.name)[:40]
        save_figure(figure_of_settled(one), out / f"settlement-{number}-{name}.png")
