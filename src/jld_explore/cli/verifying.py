"""Provide `jld verify`: check the certificate of a proof."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from jld_core import plugins
from jld_core.scene import load_scene
from jld_explore.cli.options import AsJson
from jld_explore.cli.streams import say
from jld_explore.verification import verify
from jld_explore.verification.verify import Verified


def verify_command(
    certificate: Annotated[
        Path, typer.Argument(help="File of jld explore or jld move --certificate.", show_default=False)
    ],
    scene: Annotated[
        Path | None, typer.Option(help="Scene file that it is to be of; default: the one it holds.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Check the certificate of a proof: no layout or position carries more than its bound.

    Print the proven bound. The exit code is 2, with the first reason that does not hold, if the certificate is wrong.
    """
    given = None if scene is None else load_scene(scene)
    box = plugins.part("box_certificate")
    if box.is_box_certificate(certificate):
        proven = box.verify_box(certificate, given)
        say(json.dumps(box.box_facts(proven), indent=1) if as_json else box.box_words(proven))
        return
    done = verify(certificate, given)
    say(json.dumps(facts(done), indent=1) if as_json else words(done))


def facts(done: Verified) -> dict[str, object]:
    """Return the outcome of a successful check of a certificate as JSON data."""
    claim = done.claim
    return {
        "scene": done.scene.name,
        "bound": claim.bound,
        "found": claim.load_factor,
        "labelling": claim.labelling,
        "mechanisms": done.mechanisms,
        "rules": done.rules,
        "lemmas": done.lemmas,
        "bytes": done.size,
        "seconds": done.seconds,
    }


def words(done: Verified) -> str:
    """Describe the outcome of a successful check of a certificate for the terminal."""
    claim = done.claim
    lines = [
        f"verified: no labelling of {done.scene.name!r} carries more than λ = {claim.bound:.9g}",
        f"  by {done.mechanisms} mechanisms, {done.rules} rules of a segmentation and {done.lemmas} lemmas",
        f"  in {done.size / 1e3:.0f} kB, checked in {done.seconds:.2f} s",
    ]
    if claim.load_factor is not None:
        lines.append(f"  found (by the search; not part of what is checked): λ = {claim.load_factor:.9g}")
    return "\n".join(lines)
