"""Joints with a shape: a key is climbed at small depth and breaks at large; the best lies between.

Trend of Mousavian, Bagi and Casapulla (2022) for interlocking joints; geometry and materials are ours.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

import pandas as pd
from matplotlib.figure import Figure

from jld_core import LimitAnalysisResult, Scene, build_assembly, parse_scene, samples, solve
from jld_core.models import solve_by_fields
from jld_geometry import Key, TrustRegion, move_joints, shaped_scene
from jld_views.figures import draw_mechanism
from studies.report import (
    GREY,
    PAIRED,
    Report,
    axes_at,
    drawing_handles,
    figure_of,
    legend_at,
    name_axes,
    without_legend,
    write,
)

NAME: Final = "joints_that_move"
LENGTH, PRESS, FRICTION = 0.4, 4000.0, 0.4
WIDTH, FLANKS = 0.35, (0.025, 0.05)
DEPTHS: Final = (0.0125, 0.025, 0.0375, 0.05, 0.075, 0.1, 0.125, 0.15)
"""Length of the joint, m; force on it, N; friction. Width, flanks and depths of keys in shares of the length."""

FIELDS: Final = 8.0
"""Time for the bounds by fields of one key, s."""

THIN: Final = 120.0
"""Time limit of the search for the thinnest arch, s."""


def scene() -> Scene:
    """A block on a base, pressed by 4 kN and pushed by a multiple of its weight."""
    base = [[-0.4, -0.2], [0.8, -0.2], [0.8, 0.0], [-0.4, 0.0]]
    block = [[0.0, 0.0], [LENGTH, 0.0], [LENGTH, 0.12], [0.0, 0.12]]
    press = {"element": "block", "force": [0.0, -PRESS], "at": [0.5 * LENGTH, 0.12]}
    document: dict[str, Any] = {
        "name": "key",
        "thickness": 0.2,
        "elements": [{"id": "base", "polygon": base, "support": True}, {"id": "block", "polygon": block}],
        "materials": {
            "density": 2000.0,
            "dry": {"friction_coefficient": FRICTION},
            "inner": {"tensile_strength": 2e5, "shear_strength": 4e5},
        },
        "loads": {"dead": [press], "live": [{"body": [1.0, 0.0]}]},
    }
    return parse_scene(document)


def keyed(depth: float, flank: float) -> LimitAnalysisResult:
    """The block with a key."""
    plain = scene()
    assembly = build_assembly(plain)
    return solve(shaped_scene(plain, assembly, assembly.labels, Key(depth, WIDTH, flank)))


def _by_fields(table: pd.DataFrame) -> str:
    """Say whether λ by fields falls with depth as well."""
    if "fields_lo" not in table:
        return ""
    names = ["flank", "depth", "fields_lo", "fields_hi"]
    parts = [part.to_numpy(dtype=float).T for _, part in table[names].groupby("flank")]
    if all(low[-1] > high[:-3].max() for _, _, low, high in parts):
        return (
            " By fields no optimum is seen up to the largest depth: the deepest key is proven stronger than all "
            f"up to a depth of {parts[0][1][-4]:g}."
        )
    return " By fields the best depth is not proven."


def thin_arch(voussoirs: int) -> Scene:
    """A semicircular arch under its weight, joints on circles, whose least thickness is sought."""
    document: dict[str, Any] = json.loads(
        samples.arch(voussoirs=voussoirs, thickness=0.12, load="push").model_dump_json(exclude_defaults=True)
    )
    document["materials"] = {"density": 1000.0, "dry": {"friction_coefficient": 0.8}}
    return parse_scene({**document, "move": {"along": [{"circle": [0.0, 0.0]}], "maximise": "least_thickness"}})


def least_thickness(coarse: bool) -> tuple[int, float, float]:
    """Voussoirs, and the least thickness over radius with radial joints and with moved ones, each proven to stand."""
    voussoirs = 8 if coarse else 28
    found = thin_arch(voussoirs)
    assembly = build_assembly(found)
    trust = TrustRegion(points=3) if coarse else None
    done = move_joints(found, assembly, assembly.labels, seconds=THIN, trust=trust)
    return voussoirs, done.start, done.value


def run(out: Path, coarse: bool = False) -> pd.DataFrame:
    """Analyse keys of many depths and a thin arch, write table, picture and page into a folder; returns the table."""
    table = keys(coarse)
    page(out, table, least_thickness(coarse))
    return table


def keys(coarse: bool) -> pd.DataFrame:
    """λ of keys of many depths and two flanks, by faces and, unless coarse, by fields."""
    rows: list[dict[str, Any]] = []
    for flank in FLANKS:
        for depth in DEPTHS[1::2] if coarse else DEPTHS:
            result = keyed(depth, flank)
            row = {"flank": flank, "depth": depth, "load_factor": result.load_factor}
            if not coarse:
                found = solve_by_fields(result.assembly, result.labels, gap=0.1, seconds=FIELDS).decided
                row |= {"fields_lo": found.low, "fields_hi": found.high}
            rows.append(row)
    return pd.DataFrame(rows)


def page(out: Path, table: pd.DataFrame, thin: tuple[int, float, float]) -> None:
    """Write table, picture and page into a folder; thin: as `least_thickness` returns it."""
    straight = solve(scene())
    voussoirs, radial, moved = thin
    best = table.iloc[int(table["load_factor"].to_numpy().argmax())]
    checked = "" if "fields_lo" not in table else f"; by fields the best is at least {table['fields_lo'].max():.4g}"
    report = Report(
        name=NAME,
        title="Joints that move: the depth of a key, and a thin arch",
        question="How deep should a key be whose block may climb it and whose root may break?",
        source="Trend of Mousavian, Bagi and Casapulla (2022) for interlocking joints: no numbers are compared.",
        model=f"Ours: a block of 0.4 × 0.12 × 0.2 m on a base under {PRESS / 1000:g} kN, μ = {FRICTION}, σt = 0.2 MPa, "
        f"τ = 0.4 MPa; a key of {WIDTH} of the joint's length, flanks of {FLANKS[0]} and {FLANKS[1]}. λ is the push in "
        "weights of the block, with cracks at the root of the key and at its depth, and by fields: cracks anywhere.",
        agrees=(
            "Shallow keys are climbed: λ grows with depth as the flank steepens. With cracks at the planes drawn deep "
            "keys break, and λ falls.",
            f"The best by faces: depth {best['depth']:g}, flank {best['flank']:g}, λ = {best['load_factor']:.5g}, "
            f"{best['load_factor'] / straight.load_factor:.1f} times that of the straight joint{checked}.",
            f"Thin arches: a semicircle of {voussoirs} voussoirs with μ = 0.8 stands from a thickness of {radial:.5f} "
            "radii on with radial joints. "
            f"With moved joints it is proven to stand at {moved:.5f}, {100.0 * (1.0 - moved / radial):.1f} % less "
            '(`"maximise": "least_thickness"`; the end of a local search, no least value is proven).',
        ),
        differs=(
            "λ by faces is above that by fields: blocks crack elsewhere than at the planes drawn." + _by_fields(table),
            "Strengths are perfectly plastic; a brittle key may break earlier.",
        ),
        pictures={"": "λ against the depth of the key, and mechanisms of a shallow, the best and a deep key."},
    )
    write(out, report, table, {"": _picture(table, straight, float(best["depth"]), float(best["flank"]))})


def _picture(table: pd.DataFrame, straight: LimitAnalysisResult, best: float, flank: float) -> Figure:
    figure = figure_of(11.4, 8.2)
    ax = axes_at(figure, 0.8, 3.9, 10.2, 3.7)
    for k, (own, part) in enumerate(table.groupby("flank")):
        ax.plot(part["depth"], part["load_factor"], "o-", color=PAIRED[k][0], ms=4, label=f"flank {own:g}, by faces")
        if "fields_lo" in part:
            ax.fill_between(
                part["depth"],
                part["fields_lo"],
                part["fields_hi"],
                color=PAIRED[k][0],
                alpha=0.2,
                lw=0,
                label=f"flank {own:g}, between bounds by fields",
            )
    ax.axhline(straight.load_factor, color=GREY, lw=1.0, ls=(0, (4, 2)), label="straight joint")
    name_axes(ax, "depth of the key, share of the joint [–]", "load factor λ, push over weight [–]")
    ax.set_ylim(bottom=0.0)
    ax.legend(frameon=False, fontsize=8.5, loc="center right", bbox_to_anchor=(1.0, 0.68))
    for k, depth in enumerate((DEPTHS[0], best, DEPTHS[-1])):
        result = keyed(depth, flank)
        ax = axes_at(figure, 0.6 + 3.65 * k, 0.9, 3.2, 2.1)
        draw_mechanism(ax, result)
        without_legend(ax, f"depth {depth:g}: λ = {result.load_factor:.4g}")
    legend_at(figure, drawing_handles("dry face", "inner face", "slide", "open", "crack", "at rest"), 2.0, 0.05, 6)
    figure.suptitle("A key under a push: climbed at small depth, broken at large", fontsize=12, y=0.99)
    return figure
