"""What every study leaves behind: a table, pictures and a page that says where they come from and what agrees."""

from __future__ import annotations

import math
import tempfile
import textwrap
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from PIL import Image

from jld_core import Scene
from jld_core.arrays import Bools, Floats
from jld_explore import Exploration, ExploreSettings, explore
from jld_views.annotations import MEANING, MOVES, YIELD
from jld_views.figures import save_figure
from jld_views.look import INK, PRESS, REST
from jld_views.structure import DOTTED

ROOT: Final = Path(__file__).resolve().parent.parent
SCENES: Final = ROOT / "scenes"
RESULTS: Final = ROOT / "studies" / "results"

PAIRED: Final[tuple[tuple[str, Any, str], ...]] = (
    ("#0072B2", "solid", "o"),
    ("#D55E00", (0, (5.0, 2.0)), "s"),
    ("#009E73", (0, (6.0, 1.5, 1.0, 1.5)), "^"),
    ("#CC79A7", (0, (1.0, 1.2)), "D"),
    ("#1B1B1B", (0, (3.0, 1.0, 1.0, 1.0, 1.0, 1.0)), "v"),
)
"""Colour, dash and marker that go together, so that nothing is told apart by colour alone."""

GREY: Final = "#5C5C5C"


@dataclass(frozen=True)
class Report:
    """What a study says beside its table and pictures.

    name: stem of its files. title. question: what it asks. source: whose geometry and numbers. model: geometry,
    materials and choices that are ours. agrees, differs: findings against the source, one sentence each.
    pictures: what is seen in each, by the ending of its name ("" for the first).
    """

    name: str
    title: str
    question: str
    source: str
    model: str
    agrees: tuple[str, ...]
    differs: tuple[str, ...]
    pictures: dict[str, str]

    @property
    def caption(self) -> str:
        """The report as plain text, as printed by the study."""
        parts = [self.title, self.question, f"Source: {self.source}", f"Model: {self.model}"]
        parts += [f"+ {line}" for line in self.agrees] + [f"- {line}" for line in self.differs]
        return "\n".join(textwrap.fill(part, 110, subsequent_indent="  ") for part in parts)


def write(
    out: Path, report: Report, table: pd.DataFrame, figures: dict[str, Figure], shown: pd.DataFrame | None = None
) -> None:
    """Write NAME.csv, NAME.md, and NAME.png and NAME.svg for every figure.

    out: a folder, made where it is missing. figures: by the ending of their names. shown: the table of the page,
    default the whole one.
    """
    out.mkdir(parents=True, exist_ok=True)
    table.to_csv(out / f"{report.name}.csv", index=False, float_format="%.10g")
    for ending, figure in figures.items():
        for kind in ("png", "svg"):
            save_figure(figure, out / f"{report.name}{ending}.{kind}")
        _lighten(out / f"{report.name}{ending}.png")
    (out / f"{report.name}.md").write_text(_page(report, table if shown is None else shown, figures), "utf-8")


def _lighten(path: Path) -> None:
    """Store a drawing in 256 colours, a third of the size; deterministic."""
    with Image.open(path) as picture:
        fewer = picture.convert("RGB").quantize(256, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    fewer.save(path, optimize=True)


def _page(report: Report, table: pd.DataFrame, figures: dict[str, Figure]) -> str:
    lines = [f"# {report.title}", "", report.question, ""]
    for ending in figures:
        file = f"{report.name}{ending}.png"
        what = report.pictures.get(ending, report.title)
        lines += [f"![{what}]({file})", "", f"*{what}*", ""]
    lines += [f"**Source.** {report.source}", "", f"**Model.** {report.model}", "", "**What agrees**", ""]
    lines += [f"- {line}" for line in report.agrees]
    lines += ["", "**What does not, or is not known**", ""]
    lines += [f"- {line}" for line in report.differs]
    lines += ["", markdown_table(table), "", f"Run: `python -m studies {report.name}` · [table]({report.name}.csv)", ""]
    return "\n".join(lines)


def markdown_table(table: pd.DataFrame) -> str:
    """A table as markdown, numbers to five digits, blank where there is no value."""
    rows = [list(table.columns), ["---"] * len(table.columns)]
    rows += [[_cell(value) for value in row] for row in table.itertuples(index=False)]
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)


def _cell(value: Any) -> str:
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return ""
    return f"{value:.5g}" if isinstance(value, float) else str(value)


def searched(scene: Scene, settings: ExploreSettings, **options: Any) -> Exploration:
    """Search a scene without pictures, and throw its folder away; options: of `explore`."""
    with tempfile.TemporaryDirectory() as folder:
        return explore(scene, Path(folder) / "search", replace(settings, pictures=False), **options)


def figure_of(width: float, height: float) -> Figure:
    """An empty figure in inches, on a canvas without a display."""
    figure = Figure(figsize=(width, height), dpi=110)
    FigureCanvasAgg(figure)
    return figure


def axes_at(figure: Figure, left: float, bottom: float, width: float, height: float, **keys: Any) -> Axes:
    """Axes at a place in inches from the lower left corner, small ticks, no box. keys: of `Figure.add_axes`."""
    wide, high = figure.get_size_inches()
    ax = figure.add_axes((left / wide, bottom / high, width / wide, height / high), **keys)
    ax.tick_params(labelsize=8)
    if keys.get("projection") != "polar":
        for side in ("top", "right"):
            ax.spines[side].set_visible(False)
    return ax


def name_axes(ax: Axes, x: str, y: str, title: str | None = None, size: float = 9.0) -> None:
    """Write what stands along both axes, and a title where there is one."""
    ax.set_xlabel(x, fontsize=size)
    ax.set_ylabel(y, fontsize=size)
    if title is not None:
        ax.set_title(title, fontsize=size)


def fill_region(ax: Axes, x: Floats, y: Floats, mask: Bools, fill: str, hatch: str) -> None:
    """Cells of a map whose mask (len(y), len(x)) is set, filled and hatched; x, y: evenly spaced on their axes."""
    logs = (ax.get_xscale() == "log", ax.get_yscale() == "log")
    edges = []
    for values, log in zip((x, y), logs, strict=True):
        even = np.log(values) if log else values
        ends = np.append(even, even[-1] + (even[1] - even[0])) - 0.5 * (even[1] - even[0])
        edges.append(np.exp(ends) if log else ends)
    ax.pcolormesh(*edges, np.where(mask, 1.0, np.nan), cmap=ListedColormap([fill]), rasterized=True)
    if hatch:
        drawn = ax.contourf(x, y, mask.astype(float), levels=[0.5, 1.5], colors="none", hatches=[hatch])
        drawn.set_edgecolor("#A9A9A9")
        drawn.set_linewidth(0.0)


def without_legend(ax: Axes, title: str) -> None:
    """Take the legend of a drawing away and give it another title: for rows of equal drawings."""
    found = ax.get_legend()
    if found is not None:
        found.remove()
    ax.set_title(title, fontsize=9)


def drawing_handles(*names: str) -> list[Line2D]:
    """Legend of what the drawings of a study show, by name: of faces, marks of movement, marks of forces."""
    handles = {
        "dry face": Line2D([], [], color=INK, lw=1.8, label="dry face"),
        "inner face": Line2D([], [], color=INK, lw=0.9, ls=DOTTED, label="inner face"),
        "at rest": Line2D([], [], color=REST, lw=0.7, label="at rest"),
        "pressing": Line2D(
            [], [], marker=r"$\longrightarrow$", ms=14, color=PRESS, mew=0.3, lw=0, label="pressing (hollow: pulling)"
        ),
    }
    for name, style in YIELD.items():
        handles[name] = Line2D([], [], lw=0, ms=6, label=f"{name.removeprefix('yield ')} face yields", **style)
    for kind, style in MOVES.items():
        handles[str(kind)] = Line2D([], [], lw=0, ms=5.5, label=MEANING[kind], **style)
    return [handles[name] for name in names]


def legend_at(figure: Figure, handles: list[Any], left: float, bottom: float, columns: int = 6) -> None:
    """One legend for a whole figure, its lower left corner at a place in inches."""
    wide, high = figure.get_size_inches()
    figure.legend(
        handles=handles,
        loc="lower left",
        bbox_to_anchor=(left / wide, bottom / high),
        ncols=columns,
        frameon=False,
        fontsize=8,
    )
