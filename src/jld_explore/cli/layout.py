"""Which layout a command speaks of: the scene's own labelling, or a rank of a results folder."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

from jld_core.arrays import Bits
from jld_core.assembly import Assembly
from jld_core.build import build_assembly
from jld_core.errors import InputError
from jld_core.limit import LimitAnalysisResult, Status
from jld_core.scene import Scene, load_scene
from jld_explore.cli.options import error_context
from jld_explore.report import Exploration, read_folder

if TYPE_CHECKING:
    pass

_MOST: Final = 6


def layout_of(source: Path, rank: int | None) -> tuple[Scene, Assembly, Bits]:
    """The scene's own labelling, or that of a rank in a folder, the best where none is named.

    Raises InputError for a rank of a scene, and for one that the folder does not hold.
    """
    if not source.is_dir():
        if rank is not None:
            raise InputError("--rank", f"{source} is a scene, which has no ranks", "a folder written by jld explore")
        scene = load_scene(source)
        with error_context(source):
            assembly = build_assembly(scene)
        return scene, assembly, assembly.labels
    done = read_folder(source)
    layout = done.layout(rank)
    return done.scene, layout.assembly, layout.labels


def plot_ranks(source: Path, text: str, out: Path | None, ending: str) -> Path:
    """Draw layouts of a folder side by side. text: ranks, as "1,4". out: the file, default in the folder.

    Raises InputError for what is no rank, or no folder with ranks.
    """
    if not source.is_dir():
        raise InputError("--rank", f"{source} is a scene, which has no ranks", "a folder written by jld explore")
    try:
        ranks = [int(part) for part in text.split(",")]
    except ValueError:
        raise InputError("--rank", f"{text!r} is wrong", "ranks, as 1,4") from None
    if not 1 <= len(ranks) <= _MOST:
        raise InputError("--rank", f"{len(ranks)} layouts do not fit side by side", f"at most {_MOST}")
    done = read_folder(source)
    results = [done.result(rank) for rank in ranks]
    target = out or source / f"layouts_{'_'.join(map(str, ranks))}.{ending}"
    if target.suffix not in (".png", ".svg", ".pdf"):
        raise InputError("--out", f"{target.name!r} has no known ending", ".png, .svg or .pdf")
    from jld_core.views import figures

    counts = [sum(1 for block in done.layout(rank).blocks if block.cells) for rank in ranks]
    titles = [
        f"{_named(done, rank)}: {_value(result)}, {count} block{'s' if count != 1 else ''}"
        for rank, result, count in zip(ranks, results, counts, strict=True)
    ]
    figures.save_figure(figures.figure_of_layouts(results, titles), target)
    return target


def _named(done: Exploration, number: int) -> str:
    """A row of the results by its rank, and by its number where others share that, or it has none."""
    import pandas as pd  # slow to import, and for tables alone

    rank = done.row(number)["rank"]
    if pd.isna(rank):
        return f"row {number}"
    return f"rank {rank}" + (f", row {number}" if (done.results["rank"] == rank).sum() > 1 else "")


def _value(result: LimitAnalysisResult) -> str:
    return f"λ = {result.load_factor:.5g}" if result.status is Status.COLLAPSE else str(result.status)
