"""Provide `jld check` and `jld verify`, and checks of a scene that other commands share."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from jld_core import plugins
from jld_core.assembly import Assembly
from jld_core.build.assemble import build_assembly
from jld_core.build.loads import settlements_of
from jld_core.errors import InputError, error_context
from jld_core.mechanics import require_materials
from jld_core.models import require_cracks, rigid
from jld_core.models.costs import require_memory
from jld_core.scene.reading import load_scene
from jld_core.scene.schema import Scene
from jld_explore.cli.options import AsJson, SceneFile, Strict
from jld_explore.cli.streams import remark, say
from jld_explore.verification import verify
from jld_explore.verification.verify import Verified

if TYPE_CHECKING:
    from jld_explore.space.search_space import SearchSpace


def load(path: Path, strict: bool = False) -> tuple[Scene, Assembly]:
    """Read a scene file and return scene and assembly; InputError if invalid or too large."""
    scene = load_scene(path)
    with error_context(path):
        require_memory(scene)  # before contacts are built, which may take minutes
        assembly = build_assembly(scene)
        require_memory(assembly)
    if assembly.warnings and strict:
        more = f" (and {len(assembly.warnings) - 1} more)" if len(assembly.warnings) > 1 else ""
        raise InputError(str(path), assembly.warnings[0] + more, "a scene without warnings, or no --strict")
    return scene, assembly


def warn_of(path: Path, assembly: Assembly) -> None:
    """Write warnings and notes of an assembly to stderr, when the command ends."""
    for warning in assembly.warnings:
        remark(f"jld: warning: {path}: {warning}")
    for note in assembly.notes:
        remark(f"jld: note: {path}: {note}")


def check_search(path: Path, scene: Scene, assembly: Assembly) -> SearchSpace:
    """Return the search space of a scene; InputError for an impossible search."""
    from jld_explore.space.search_space import search_space

    has_search = "search" in scene.model_fields_set
    with error_context(path):
        return search_space(scene, assembly, allow_empty=not has_search, need_materials=has_search)


def check(scene: SceneFile, strict: Strict = False) -> None:
    """Check a scene file: read it, find its interfaces, and print what will be modelled."""
    # Plausibility warnings go to stderr; with --strict they are errors. The exit code is 2 for a scene that is refused.
    from jld_explore.report import words

    parsed, assembly = load(scene, strict)
    space = check_search(scene, parsed, assembly)
    with error_context(scene):
        require_materials(assembly, assembly.labels, ~assembly.labels)
        settlements_of(parsed, assembly)
        require_cracks(assembly)
        rigid(assembly, assembly.labels)
        if parsed.move is not None:
            plugins.part("require_movable")(parsed, assembly)
    warn_of(scene, assembly)
    say(words.assembly(parsed, assembly, space))


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
    parsed = None if scene is None else load_scene(scene)
    box = plugins.part("box_certificate")
    if box.is_box_certificate(certificate):
        proven = box.verify_box(certificate, parsed)
        say(json.dumps(box.box_facts(proven), indent=1) if as_json else box.box_words(proven))
        return
    verified = verify(certificate, parsed)
    say(json.dumps(facts(verified), indent=1) if as_json else words(verified))


def facts(verified: Verified) -> dict[str, object]:
    """Return the outcome of a successful check of a certificate as JSON data."""
    claim = verified.claim
    return {
        "scene": verified.scene.name,
        "bound": claim.bound,
        "found": claim.load_factor,
        "labelling": claim.labelling,
        "mechanisms": verified.mechanisms,
        "rules": verified.rules,
        "lemmas": verified.lemmas,
        "bytes": verified.size,
        "seconds": verified.seconds,
    }


def words(verified: Verified) -> str:
    """Describe the outcome of a successful check of a certificate for the terminal."""
    claim = verified.claim
    lines = [
        f"verified: no labelling of {verified.scene.name!r} carries more than λ = {claim.bound:.9g}",
        f"  by {verified.mechanisms} mechanisms, {verified.rules} rules of a segmentation and {verified.lemmas} lemmas",
        f"  in {verified.size / 1e3:.0f} kB, checked in {verified.seconds:.2f} s",
    ]
    if claim.load_factor is not None:
        lines.append(f"  found (by the search; not part of what is checked): λ = {claim.load_factor:.9g}")
    return "\n".join(lines)
