"""Provide `jld verify`: check the certificate of a proof."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from jld_core.scene import load_scene
from jld_explore.cli.options import AsJson
from jld_explore.cli.streams import say
from jld_explore.verification import verify
from jld_explore.verification.box_certificate import is_box_certificate
from jld_explore.verification.boxes import VerifiedBox, verify_box
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
    if is_box_certificate(certificate):
        box = verify_box(certificate, given)
        say(json.dumps(box_facts(box), indent=1) if as_json else box_words(box))
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


def box_facts(done: VerifiedBox) -> dict[str, object]:
    """Return the outcome of a successful check of a proof over a box as JSON data."""
    claim = done.claim
    return {
        "scene": done.scene.name,
        "bound": claim.bound,
        "found": claim.load_factor,
        "box": [list(ends) for ends in claim.box],
        "parameters": None if claim.parameters is None else list(claim.parameters),
        "boxes": done.boxes,
        "bytes": done.size,
        "seconds": done.seconds,
    }


def box_words(done: VerifiedBox) -> str:
    """Describe the outcome of a successful check of a proof over a box for the terminal."""
    claim = done.claim
    box = " × ".join(f"[{low:.6g}, {high:.6g}]" for low, high in claim.box)
    lines = [
        f"verified: no position of the joints of {done.scene.name!r} in {box} carries more than λ = {claim.bound:.9g}",
        f"  by mechanisms for {done.boxes} boxes, in {done.size / 1e3:.0f} kB, checked in {done.seconds:.2f} s",
    ]
    if claim.load_factor is not None and claim.parameters is not None:
        where = ", ".join(f"{value:.6g}" for value in claim.parameters)
        lines.append(f"  found (by the search; not part of what is checked): λ = {claim.load_factor:.9g} at {where}")
    return "\n".join(lines)
