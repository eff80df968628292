"""Which layout a command speaks of: the scene's own labelling, or a rank of a results folder."""

from __future__ import annotations

from pathlib import Path

from jld_core.arrays import Bits
from jld_core.assembly import Assembly
from jld_core.build import build_assembly
from jld_core.errors import InputError
from jld_core.limit import Status
from jld_core.scene import Scene, load_scene
from jld_explore.report import read_folder
from jld_explore.space import from_string


def layout_of(source: Path, rank: int | None) -> tuple[Scene, Assembly, Bits]:
    """The scene's own labelling, or that of a rank in a folder, the best where none is named.

    Raises InputError for a rank of a scene, and for one that the folder does not hold.
    """
    if not source.is_dir():
        if rank is not None:
            raise InputError("--rank", f"{source} is a scene, which has no ranks", "a folder written by jld explore")
        scene = load_scene(source)
        try:
            assembly = build_assembly(scene)
        except InputError as error:
            raise error.within(str(source)) from None
        return scene, assembly, assembly.labels
    done = read_folder(source)
    ranked = done.results[done.results["status"] == str(Status.COLLAPSE)]
    found = ranked[ranked["rank"] == (rank or 1)]
    if not len(found):
        raise InputError("--rank", f"{source} has no layout of rank {rank or 1}", f"1 to {len(ranked)}")
    return done.scene, done.assembly, from_string(str(found["labelling"].iloc[0]))
