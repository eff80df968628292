"""Find the layout that a command refers to: a scene's own, or a rank of a results folder."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from jld_core.arrays import Bits
from jld_core.assembly import Assembly
from jld_core.build.assemble import build_assembly, noted_means
from jld_core.build.plausibility import not_judged
from jld_core.errors import InputError, ParameterError, error_context
from jld_core.limit.options import Model
from jld_core.scene.reading import load_scene
from jld_core.scene.schema import Scene
from jld_explore.cli.streams import remark


def best_of_design(source: Path) -> Path:
    """Return the scene of the best layout of a folder of `jld design`; any other source as it is."""
    best = source / "best.json"
    return best if source.is_dir() and best.exists() else source


class LaidOut(NamedTuple):
    """Layout that a command refers to, and the model that its source states."""

    scene: Scene
    # its structure, with the crack model of the source; low values of materials where a search was robust
    assembly: Assembly
    labels: Bits  # (m,) True = dry
    model: Model  # model of the search; of a scene the default


def layout_of(source: Path, rank: int | None, *, uncertain: bool = False) -> LaidOut:
    """Return the layout that a command refers to; InputError for a rank that is not there."""
    source = best_of_design(source)
    if source.is_dir():
        from jld_explore.report.reading import read_folder

        exploration = read_folder(source)
        layout = exploration.layout(rank)
        laid_out = LaidOut(exploration.scene, layout.assembly, layout.labels, exploration.model)
    else:
        if rank is not None:
            raise ParameterError("rank", f"{source} is a scene, which has no ranks", "a folder written by jld explore")
        scene = load_scene(source)
        with error_context(source):
            assembly = build_assembly(scene)
        laid_out = LaidOut(scene, assembly, assembly.labels, Model())
    # a word on plausibility is for the commands that judge it, one on means for those that read them alone
    not_said = (*not_judged(laid_out.scene), *(noted_means(laid_out.scene) if uncertain else ()))
    for note in laid_out.assembly.notes:
        if note not in not_said:
            remark(f"jld: note: {source}: {note}")
    return laid_out


def require_whole_faces(model: Model, command: str) -> None:
    """Raise InputError for a model beyond associative friction on whole faces."""
    for name, value in model.beyond_whole_faces.items():
        written = str(value).lower() if isinstance(value, bool) else value
        problem = f"the search in this folder had {name.replace('_', ' ')} {written}, and {command} knows no such model"
        raise InputError("model", problem, "a folder of a search without it, or jld solve")
