"""Find the layout that a command refers to: a scene's own, or a rank of a results folder."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

from jld_core.arrays import Bits
from jld_core.assembly import Assembly
from jld_core.build.assemble import build_assembly
from jld_core.build.plausibility import not_judged
from jld_core.errors import InputError, ParameterError, error_context
from jld_core.limit.options import Model, Status
from jld_core.limit.result import LimitAnalysisResult
from jld_core.scene.cracks import FieldCracks
from jld_core.scene.reading import load_scene
from jld_core.scene.schema import Scene
from jld_explore.cli.streams import warn

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from jld_explore.report.reading import Exploration

_MOST: Final = 6  # largest number of layouts drawn side by side


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

        done = read_folder(source)
        layout = done.layout(rank)
        found = LaidOut(done.scene, layout.assembly, layout.labels, done.model)
    else:
        if rank is not None:
            raise ParameterError("rank", f"{source} is a scene, which has no ranks", "a folder written by jld explore")
        scene = load_scene(source)
        with error_context(source):
            assembly = build_assembly(scene)
        found = LaidOut(scene, assembly, assembly.labels, Model())
    unjudged = not_judged(found.scene)  # a word on plausibility, for the commands that judge it
    for note in () if uncertain else (one for one in found.assembly.notes if one not in unjudged):
        warn(f"jld: note: {source}: {note}")
    return found


def require_whole_faces(model: Model, what: str) -> None:
    """Raise InputError for a model beyond associative friction on whole faces."""
    for name, value in model.beyond_whole_faces.items():
        shown = str(value).lower() if isinstance(value, bool) else value
        problem = f"the search in this folder had {name.replace('_', ' ')} {shown}, and {what} knows no such model"
        raise InputError("model", problem, "a folder of a search without it, or jld solve")


def plot_ranks(source: Path, text: str, out: Path | None, ending: str) -> Path:
    """Draw layouts of a results folder side by side, and return the file written."""
    if not source.is_dir():
        raise ParameterError("rank", f"{source} is a scene, which has no ranks", "a folder written by jld explore")
    try:
        ranks = [int(part) for part in text.split(",")]
    except ValueError:
        raise ParameterError("rank", f"{text!r} is wrong", "ranks, as 1,4") from None
    if not 1 <= len(ranks) <= _MOST:
        raise ParameterError("rank", f"{len(ranks)} layouts do not fit side by side", f"at most {_MOST}")
    from jld_explore.report.reading import read_folder

    done = read_folder(source)
    target = out or source / f"layouts_{'_'.join(map(str, ranks))}.{ending}"
    if target.suffix not in (".png", ".svg", ".pdf"):
        raise ParameterError("out", f"{target.name!r} has no known ending", ".png, .svg or .pdf")
    from jld_core.views import figures

    if isinstance(done.scene.cracks, FieldCracks):
        figures.save_figure(_by_fields(done, ranks), target)
        return target
    results = [done.result(rank) for rank in ranks]
    counts = [sum(1 for block in done.layout(rank).blocks if block.cells) for rank in ranks]
    titles = [
        f"{_named(done, rank)}: {_value(result)}, {count} block{'s' if count != 1 else ''}"
        for rank, result, count in zip(ranks, results, counts, strict=True)
    ]
    figures.save_figure(figures.figure_of_layouts(results, titles), target)
    return target


def _by_fields(done: Exploration, ranks: list[int]) -> Figure:
    """Draw stresses and cracks of layouts side by side, each under its governing load case."""
    from jld_core.views.field_figures import figure_of_field_layouts

    found = [done.field_result(rank) for rank in ranks]
    titles = [
        f"{_named(done, rank)}: λ in [{one.decided.low:.4g}, {one.decided.high:.4g}]"
        for rank, one in zip(ranks, found, strict=True)
    ]
    return figure_of_field_layouts([one.governing_case for one in found], titles)


def _named(done: Exploration, number: int) -> str:
    """Return the rank of a row in words, with its number if it shares the rank or has none."""
    import pandas as pd  # slow to import and needed for tables only

    rank = done.row(number)["rank"]
    if pd.isna(rank):
        return f"row {number}"
    return f"rank {rank}" + (f", row {number}" if (done.results["rank"] == rank).sum() > 1 else "")


def _value(result: LimitAnalysisResult) -> str:
    """Return λ of a result, or its status."""
    return f"λ = {result.load_factor:.5g}" if result.status is Status.COLLAPSE else str(result.status)
