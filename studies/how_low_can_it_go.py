"""How low can it go: the lowest, the highest and the proven least λ without dilation, and what lies between.

Source: walls of Ferris & Tin-Loi, Int. J. Mech. Sci. 43 (2001) 209–224, with the local minima that a public MPEC
solver gives and the fixed points of Gilbert, Casapulla & Ahmed 2006; flat arch after Iannuzzo et al. 2024, section
3.3. The small walls are ours, of the same blocks.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jld_core import LimitAnalysis, LimitAnalysisResult, Scene, build_assembly, load_scene, solve
from jld_core.arrays import Bits, Floats
from jld_dilation.fixed_point_search import ProximalOptions
from jld_dilation.sweep import MultiStartSearch
from jld_views.figures import draw_mechanism
from studies.families import halved_bond
from studies.report import (
    GREY,
    PAIRED,
    SCENES,
    Report,
    axes_at,
    drawing_handles,
    figure_of,
    legend_at,
    without_legend,
    write,
)
from studies.scenes import leonardo_flat_arch

_LEGS: Final = 60  # mechanisms tried at the most
_IDLE: Final = 20  # in a row that carry no more


@dataclass(frozen=True)
class SolutionPath:
    """Corners of a path: forces (k, m, q) in scene units, λ (k,), and how far along, Σ |ΔN| over the dead load (k,)."""

    forces: Floats
    load_factors: Floats
    along: Floats


def path_of_solutions(analysis: LimitAnalysis, labels: Bits, seed: int = 0) -> SolutionPath | None:
    """From the lowest λ that is found upwards; None where nothing is found, or rows are not linear.

    All forces with y = 0 where one mechanism moves are solutions with that mechanism, and they are convex: from one to
    another of them a straight line of solutions runs, along which λ changes. Where no forces carry more, another
    mechanism of the same state takes over.

    analysis: planar, without crushing. labels: (m,) True dry.
    """
    side = MultiStartSearch(analysis, labels, ProximalOptions(), analysis.prove(labels))
    lowest = side.search().lowest
    if lowest is None or side.alternation is None:
        return None
    points = side.alternation.ascending_path(
        np.append(lowest.state.forces.ravel(), lowest.state.load), seed, _LEGS, _IDLE
    )
    scaling = analysis.template.scaling
    forces = np.array([point[:-1].reshape(scaling.face.shape) * scaling.face for point in points])
    steps = abs(np.diff(forces[:, :, 0], axis=0)).sum(axis=1)
    weight = analysis.assembly.total_dead or 1.0
    loads = np.array([point[-1] for point in points]) * scaling.load
    return SolutionPath(forces, loads, np.concatenate([[0.0], np.cumsum(steps)]) / weight)


NAME: Final = "how_low_can_it_go"


@dataclass(frozen=True)
class Case:
    """A scene, what others publish of its lowest λ, and the processor time that its floor is given."""

    name: str
    scene: Callable[[], Scene]
    published: float = np.nan
    seconds: float = 0.0


CASES: Final = (
    Case("wall 2 × 3", lambda: halved_bond(2, 3), seconds=20.0),
    Case("wall 2 × 5", lambda: halved_bond(2, 5), seconds=60.0),
    Case("wall 2 × 6", lambda: halved_bond(2, 6), seconds=60.0),
    Case("wall 2 × 7", lambda: halved_bond(2, 7), seconds=60.0),
    Case("wall 2 × 8", lambda: halved_bond(2, 8), seconds=60.0),
    Case("wall 3 × 6", lambda: halved_bond(3, 6), seconds=300.0),
    Case("flat arch", leonardo_flat_arch, 1312.0, 20.0),
    Case("Ferris & Tin-Loi 1", lambda: load_scene(SCENES / "ferris_tinloi_1.json"), 0.638981),
    Case("Ferris & Tin-Loi 2", lambda: load_scene(SCENES / "ferris_tinloi_2.json"), 0.562005),
    Case("Ferris & Tin-Loi 3", lambda: load_scene(SCENES / "ferris_tinloi_3.json")),
    Case("Ferris & Tin-Loi 4", lambda: load_scene(SCENES / "ferris_tinloi_4.json"), 0.263736),
    Case("Ferris & Tin-Loi 5", lambda: load_scene(SCENES / "ferris_tinloi_5.json")),
    Case("Ferris & Tin-Loi 6", lambda: load_scene(SCENES / "ferris_tinloi_6.json")),
)
QUICK: Final = ("wall 2 × 3", "flat arch")
DRAWN: Final = ("wall 2 × 7", "flat arch", "Ferris & Tin-Loi 4")


def ranges(cases: tuple[Case, ...]) -> tuple[pd.DataFrame, dict[str, LimitAnalysisResult]]:
    """One row per scene, and the lowest solution of each."""
    rows, lowest = [], {}
    for case in cases:
        result = solve(build_assembly(case.scene()), friction="zero-dilation", range=True, floor_seconds=case.seconds)
        extra = result.facts
        lowest[case.name] = result
        rows.append(
            {
                "scene": case.name,
                "dry": int(result.labels.sum()),
                "faces": len(result.labels),
                "associative": extra["associative_load_factor"],
                "highest_found": extra["highest_found"],
                "lowest_found": extra["lowest_found"],
                "lowest_proven": extra["lowest_proven"],
                "published_lowest": case.published,
                "share_of_associative": extra["lowest_found"] / extra["associative_load_factor"],
                "floor_s": round(extra["floor_seconds"], 1),
            }
        )
    return pd.DataFrame(rows).astype({"lowest_proven": float}), lowest


def path_of(case: Case) -> SolutionPath | None:
    """The continuum of one scene, from its lowest solution up."""
    assembly = build_assembly(case.scene())
    return path_of_solutions(LimitAnalysis(assembly), assembly.labels)


def run(out: Path, coarse: bool = False) -> pd.DataFrame:
    """Find, prove and draw, write table, picture and page into a folder; returns the table."""
    cases = tuple(case for case in CASES if not coarse or case.name in QUICK)
    table, lowest = ranges(cases)
    drawn = tuple(case for case in cases if case.name in (QUICK if coarse else DRAWN))
    figure = _picture(table, lowest, drawn)
    walls = table[table["scene"].str.startswith("Ferris")]
    lower = walls[walls["lowest_found"] < walls["published_lowest"] * (1.0 - 1e-5)]
    met = table[table["lowest_proven"] >= table["lowest_found"] * (1.0 - 1e-6)]
    agrees = [
        f"On {len(met)} of {len(table)} scenes the lowest found is proven to be the lowest there is, within 1e-6, by "
        "certificates checked in exact arithmetic: " + ", ".join(met["scene"]) + "."
    ]
    differs = []
    if len(walls):
        known = walls[walls["published_lowest"].notna()]
        agrees.append(
            "On the walls of Ferris & Tin-Loi for which a minimum is published the lowest found is below it or within "
            "1e-5 of it; "
            + "; ".join(
                f"{row.scene}: {row.lowest_found:.6f} beside {row.published_lowest:.6f}" for row in known.itertuples()
            )
            + "."
        )
        differs.append(
            f"{len(lower)} of {len(known)} of them lie lower than published; for the others we know of none. No floor "
            f"is sought for these walls here, of {walls['faces'].min()} to {walls['faces'].max()} faces: `python -m "
            "benchmarks.zero_dilation` bounds most of them from below."
        )
    arch = table[table["scene"] == "flat arch"].iloc[0]
    differs.append(
        f"The flat arch's lowest, {arch.lowest_found:.1f} N per force, lies beside the 1312 N of section 3.3, whose "
        "layout is not known to us; the arch also stands at anything up to "
        f"{arch.highest_found:.1f} N, as its thrust has it."
    )
    unproven = table[table["lowest_proven"].isna() & table["scene"].str.startswith("wall")]
    if len(unproven):
        differs.append(
            "No floor is sought here for "
            + ", ".join(unproven["scene"])
            + ": `python -m benchmarks.zero_dilation` does."
        )
    report = Report(
        name=NAME,
        title="How low can it go",
        question="Without dilation the collapse load is not one number. Which is the lowest, and is that proven?",
        source="walls of Ferris & Tin-Loi 2001; flat arch after Iannuzzo et al. 2024, section 3.3.",
        model="Small walls n × r: n blocks of 4 × 1.75 in a course, r courses, the lowest half–whole–half, μ = 0.65, "
        "horizontal body load. Solutions are certified by their own forces and mechanism; bounds by the products of "
        "docs/method.md (4.7), (4.8).",
        agrees=tuple(agrees),
        differs=tuple(differs),
        pictures={
            "": "Above: λ of solutions over λ associative, from lowest to highest, with what is proven and what others "
            "publish. Middle: a path through the solutions, each leg with one mechanism; every point of it is a "
            "solution, and friction alone does not say which one a structure is in. Below: the mechanism of the lowest."
        },
    )
    write(out, report, table, {"": figure}, table)
    return table


def _picture(table: pd.DataFrame, lowest: dict[str, LimitAnalysisResult], drawn: tuple[Case, ...]) -> Figure:
    figure = figure_of(12.6, 10.6)
    _bars(axes_at(figure, 1.7, 7.2, 10.4, 2.8), table)
    width = 10.4 / len(drawn) - 0.8
    for k, case in enumerate(drawn):
        left = 1.1 + k * (11.2 / len(drawn))
        row = table[table["scene"] == case.name].iloc[0]
        _path(axes_at(figure, left, 3.75, width, 2.6), case, row, path_of(case))
        ax = axes_at(figure, left, 0.75, width, 2.2)
        draw_mechanism(ax, lowest[case.name])
        without_legend(ax, f"{case.name}: mechanism of the lowest, λ = {row.lowest_found:.6g}")
    legend_at(
        figure, drawing_handles("dry face", "inner face", "hinge", "slide", "open", "crack", "at rest"), 1.1, 0.05, 7
    )
    figure.suptitle("How low can it go: collapse without dilation", fontsize=12, y=0.993)
    return figure


def _bars(ax: Axes, table: pd.DataFrame) -> None:
    top = table["associative"].to_numpy(dtype=float)
    place = np.arange(len(table))[::-1]
    low, high = (table[name].to_numpy(dtype=float) / top for name in ("lowest_found", "highest_found"))
    ax.hlines(place, low, high, color=PAIRED[0][0], lw=5, alpha=0.55, label="solutions found")
    ax.plot(low, place, PAIRED[0][2], color=PAIRED[0][0], ms=6, ls="none", label="lowest found")
    proven = table["lowest_proven"].to_numpy(dtype=float) / top
    ax.plot(proven, place, "|", color="#1B1B1B", ms=20, mew=2.0, ls="none", label="proven: none below")
    published = table["published_lowest"].to_numpy(dtype=float) / top
    ax.plot(published, place, PAIRED[1][2], color=PAIRED[1][0], ms=7, mfc="none", ls="none", label="published lowest")
    ax.axvline(1.0, color=GREY, lw=0.9, ls=(0, (4, 2)))
    ax.set_yticks(place, table["scene"], fontsize=9)
    ax.set_xlabel("λ without dilation / λ associative [–]", fontsize=9)
    ax.set_ylim(-0.6, len(table) - 0.4)
    ax.legend(frameon=False, fontsize=8.5, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4)


def _path(ax: Axes, case: Case, row: pd.Series, path: SolutionPath | None) -> None:
    if path is not None:
        ax.plot(path.along, path.load_factors, "o-", color=PAIRED[0][0], ms=4, lw=1.4, label="solutions")
    ax.axhline(row.associative, color=GREY, lw=0.9, ls=(0, (4, 2)), label="associative")
    if np.isfinite(row.lowest_proven):
        ax.axhline(row.lowest_proven, color="#1B1B1B", lw=1.2, ls=(0, (1, 1)), label="proven: none below")
    ax.set_xlabel("way through the solutions, Σ |ΔN| / weight [–]", fontsize=9)
    unit = "λ, N per force" if case.name == "flat arch" else "λ [–]"
    ax.set_ylabel(unit, fontsize=9)
    ax.set_title(case.name, fontsize=10)
    ax.legend(frameon=False, fontsize=8, loc="lower right", bbox_to_anchor=(1.0, 0.1))
