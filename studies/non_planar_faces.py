"""Blocks with non-planar faces that may crack: Abeille's flat vault, and osteomorphic blocks in facets.

Sources: the vault of truncated tetrahedra is that of J. Abeille's patent of 1699; the osteomorphic block, whose faces
are convex along one direction and concave along the other, is that of Dyskin, Estrin, Pasternak et al. Measures: ours.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jld_core import Assembly, LimitAnalysisResult, build_assembly, parse_scene, solve
from jld_core.arrays import Floats
from jld_experiment import Joints, Settings, run_experiment
from jld_views.figures import draw_assembly, draw_mechanism
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

NAME: Final = "non_planar_faces"
CELL, DEPTH, LEAN = 0.3, 0.2, 20.0
"""Side of a block of the vault in its middle plane and its height, m; angle of its faces from the vertical, "
"degrees."""

DENSITY, FRICTION = 2000.0, 0.5
STRENGTHS: Final = (0.05e6, 0.1e6, 0.2e6, 0.5e6, 1e6, 2e6)
"""σt = τ of the blocks, Pa."""

WAVE: Final = 0.04
"""Amplitude of an osteomorphic face over the side of a block."""

WEAK: Final = 0.5
"""σt = τ of osteomorphic blocks that crack, in weights of a block over its area."""


def abeille(count: int, strength: float | None, friction: float = FRICTION) -> Assembly:
    """A flat vault of count × count truncated tetrahedra in a fixed frame, λ N down on the block in the middle.

    strength: σt = τ, Pa, of blocks that may crack along both of their middle planes; None: rigid blocks.
    """
    lean = 0.5 * DEPTH * math.tan(math.radians(LEAN))
    elements: list[dict[str, Any]] = []
    for i, j in itertools.product(range(-1, count + 1), repeat=2):
        edge = [k in (-1, count) for k in (i, j)]
        if all(edge):
            continue
        wide = lean if (i + j) % 2 == 0 else -lean
        name = f"b{i}_{j}"
        signs = ((1, 1), (-1, 1), (-1, -1), (1, -1))
        if any(edge) or strength is None:
            rings = [[(s * (CELL / 2 + w), t * (CELL / 2 - w)) for s, t in signs] for w in (-wide, wide)]
            elements.append(_prismatoid(name, i, j, rings, support=any(edge)))
            continue
        for k, (s, t) in enumerate(signs):
            rings = []
            for w in (-wide, wide):
                x, y = s * (CELL / 2 + w), t * (CELL / 2 - w)
                ring = [(0.0, 0.0), (x, 0.0), (x, y), (0.0, y)]
                rings.append(ring if s * t > 0 else ring[::-1])
            elements.append(_prismatoid(f"{name}q{k}", i, j, rings, block=name))
    middle = f"b{count // 2}_{count // 2}"
    pushed = [e["id"] for e in elements if e["id"] == middle or e["id"].startswith(f"{middle}q")]
    at = [(count // 2) * CELL, (count // 2) * CELL, DEPTH / 2]
    live = [{"element": name, "force": [0, 0, -1.0 / len(pushed)], "at": at} for name in pushed]
    return _built(f"Abeille's flat vault, {count} × {count}", elements, live, friction, strength)


def _prismatoid(name: str, i: int, j: int, rings: list[list[tuple[float, float]]], **keys: Any) -> dict[str, Any]:
    """A solid between a ring of four points below and one above, about the middle of cell (i, j)."""
    vertices = [
        [i * CELL + x, j * CELL + y, z] for ring, z in zip(rings, (-DEPTH / 2, DEPTH / 2), strict=True) for x, y in ring
    ]
    sides = [[k, (k + 1) % 4, 4 + (k + 1) % 4, 4 + k] for k in range(4)]
    return {"id": name, "vertices": vertices, "faces": [[3, 2, 1, 0], [4, 5, 6, 7], *sides], **keys}


def osteomorphic(facets: int, strength: float | None, saddle: bool = True, wave: float = WAVE) -> Assembly:
    """A unit block 0.4 high on another and on a base, their bed faces wavy in facets, under a load along x.

    facets: along each half of a side, two triangles each. strength: σt = τ over the weight of a block on its area, of
    blocks that may crack along both middle planes; None: rigid. saddle: convex along x and concave along y, else waves
    along x alone.
    """

    def bed(x: Floats, y: Floats) -> Floats:
        return np.asarray(0.5 * wave * (np.cos(2 * np.pi * x) - saddle * np.cos(2 * np.pi * y)))

    half = np.linspace(0.0, 0.5, facets + 1)
    both = np.concatenate([half - 0.5, half[1:]])
    elements: list[dict[str, Any]] = [_solid("base", both, both, lambda x, y: 0 * x - 0.2, bed, support=True)]
    for level in range(2):
        low, high = 0.4 * level, 0.4 * (level + 1)
        flat = level == 1

        def bottom(x: Floats, y: Floats, low: float = low) -> Floats:
            return low + bed(x, y)

        def top(x: Floats, y: Floats, high: float = high, flat: bool = flat) -> Floats:
            return high + (0 * x if flat else bed(x, y))

        if strength is None:
            elements.append(_solid(f"b{level}", both, both, bottom, top))
            continue
        for k, (xs, ys) in enumerate(itertools.product((half - 0.5, half), repeat=2)):
            elements.append(_solid(f"b{level}q{k}", xs, ys, bottom, top, block=f"b{level}"))
    weight = 0.4 * DENSITY * 9.81
    stress = None if strength is None else strength * weight
    return _built(f"osteomorphic blocks, {facets} facets a half", elements, [{"body": [1, 0, 0]}], FRICTION, stress)


def _solid(
    name: str,
    xs: Floats,
    ys: Floats,
    bottom: Callable[[Floats, Floats], Floats],
    top: Callable[[Floats, Floats], Floats],
    **keys: Any,
) -> dict[str, Any]:
    """A solid over a grid between two surfaces, each square of them two triangles."""
    x, y = (grid.ravel() for grid in np.meshgrid(xs, ys, indexing="ij"))
    p, q = len(xs), len(ys)
    vertices = [*np.column_stack([x, y, bottom(x, y)]).tolist(), *np.column_stack([x, y, top(x, y)]).tolist()]
    above = p * q
    faces: list[list[int]] = []
    for i, j in itertools.product(range(p - 1), range(q - 1)):
        a, b, c, d = i * q + j, (i + 1) * q + j, (i + 1) * q + j + 1, i * q + j + 1
        faces += [[a, c, b], [a, d, c], [above + a, above + b, above + c], [above + a, above + c, above + d]]
    rims = (
        [i * q for i in range(p)],
        [(p - 1) * q + j for j in range(q)],
        [i * q + q - 1 for i in reversed(range(p))],
        list(reversed(range(q))),
    )
    faces += [[*rim, *(above + k for k in reversed(rim))] for rim in rims]
    return {"id": name, "vertices": vertices, "faces": faces, **keys}


def _built(
    name: str, elements: list[dict[str, Any]], live: list[dict[str, Any]], friction: float, stress: float | None
) -> Assembly:
    materials: dict[str, Any] = {"density": DENSITY, "dry": {"friction_coefficient": friction}}
    if stress is not None:
        materials["inner"] = {"tensile_strength": stress, "shear_strength": stress}
    return build_assembly(
        parse_scene({"name": name, "elements": elements, "materials": materials, "loads": {"live": live}})
    )


def steepest(facets: int, wave: float = WAVE) -> float:
    """Upper bound on λ of a rigid block: straight sliding up the steepest facet, tan(φ + slope), slopes of chords."""
    nodes = np.linspace(0.0, 0.5, facets + 1)
    slope = float(np.abs(np.diff(0.5 * wave * np.cos(2 * np.pi * nodes))).max() / (0.5 / facets))
    return math.tan(math.atan(FRICTION) + math.atan(slope))


def _row(part: str, result: LimitAnalysisResult, **keys: Any) -> dict[str, Any]:
    low, high = result.bracket
    found = {"load_factor": result.load_factor, "bracket_lo": low, "bracket_hi": high, "status": str(result.status)}
    return {"part": part, **keys, **found}


def vaults(coarse: bool) -> list[dict[str, Any]]:
    """Abeille's vault: rigid, crackable by strength, with both kinds of contact, and experiments."""
    rows = [
        _row("vault", solve(abeille(n, None)), blocks=n * n, contact="convex") for n in ((3,) if coarse else (3, 5))
    ]
    for contact in ("convex", "concave"):
        for strength in STRENGTHS[2:3] if coarse else STRENGTHS:
            found = solve(abeille(3, strength), contact=contact)
            rows.append(_row("vault", found, blocks=9, contact=contact, strength=strength))
    if not coarse:
        rows.append(_row("vault", solve(abeille(5, STRENGTHS[2])), blocks=25, contact="convex", strength=STRENGTHS[2]))
    strength = STRENGTHS[2]
    for inner in ("brittle", "plastic"):
        joints = Joints(inner=inner)
        settings = Settings(segments=1, periods=60.0, length=20.0)
        curve = run_experiment(abeille(3, strength), joints=joints, settings=settings)
        row: dict[str, Any] = {"part": f"vault, experiment, {inner}", "blocks": 9, "strength": strength}
        row |= {"load_factor": curve.collapse_load, "status": str(curve.standing), "rate_error": curve.rate_error}
        rows.append(row)
    return rows


def waves(coarse: bool) -> list[dict[str, Any]]:
    """Osteomorphic blocks by facets, rigid and crackable, both kinds of contact; and waves along x alone."""
    rows = []
    for facets in (1, 2) if coarse else (1, 2, 3, 4, 5, 6, 8):
        for strength in (None, WEAK):
            for contact in ("convex", "concave"):
                found = solve(osteomorphic(facets, strength), contact=contact)
                rows.append(_row("osteomorphic", found, facets=facets, contact=contact, strength=strength))
        ridge = solve(osteomorphic(facets, None, saddle=False))
        rows.append(_row("waves along x", ridge, facets=facets, contact="convex", closed_form=steepest(facets)))
    return rows


def run(out: Path, coarse: bool) -> pd.DataFrame:
    """λ of both families, table, picture and page."""
    table = pd.DataFrame([*vaults(coarse), *waves(coarse)])
    shown = solve(abeille(3, STRENGTHS[2])), solve(osteomorphic(2 if coarse else 4, WEAK))
    write(out, _report(table), table, {"": _picture(table, *shown)})
    return table


def _report(table: pd.DataFrame) -> Report:
    vault = table[(table["part"] == "vault") & table["strength"].notna()]
    rigid = table[(table["part"] == "vault") & table["strength"].isna()]
    convex = vault[(vault["contact"] == "convex") & (vault["blocks"] == 9)].set_index("strength")["load_factor"]
    concave = vault[vault["contact"] == "concave"].set_index("strength")["load_factor"]
    per_area = float((convex / convex.index.to_numpy()).median())
    bones = table[table["part"] == "osteomorphic"]
    cracked = bones["strength"].notna().map({True: "cracks", False: "rigid"})
    wide = bones.assign(cracks=cracked).pivot_table(index="facets", columns=["contact", "cracks"], values="load_factor")
    last, before = wide.iloc[-1], wide.iloc[-2]
    ridge = table[table["part"] == "waves along x"]
    below = 1.0 - ridge["load_factor"] / ridge["closed_form"]
    tried = table[table["part"].str.startswith("vault, experiment")]
    base = float(convex.loc[STRENGTHS[2]])
    said = ", ".join(
        f"{row['part'].split(', ')[2]} {row['load_factor'] / base:.2f}" for row in tried.to_dict("records")
    )
    return Report(
        name=NAME,
        title="Blocks with non-planar faces",
        question="What do crackable blocks change in assemblies that hold by the shape of their faces, and how many "
        "facets does a curved face need?",
        source="Abeille's flat vault (patent of 1699); osteomorphic blocks (Dyskin, Estrin, Pasternak et al.), faces "
        "convex along one direction and concave along the other. Measures and loads are ours; nothing is reproduced.",
        model=f"Vault: truncated tetrahedra of {CELL:g} m, {DEPTH:g} m high, faces leaning {LEAN:g}°, in a frame that "
        "does not give, a force down on the block in the middle; each block four quarters where it may crack. "
        f"Osteomorphic: two unit blocks 0.4 high on a base, beds with an amplitude of {0.5 * WAVE:g} each way, pushed "
        f"along x by their weight, quarters with σt = τ = {WEAK:g} weights over area. μ = {FRICTION:g}, associative.",
        agrees=(
            f"Rigid blocks in a fixed frame lock ({', '.join(rigid['status'])}): no load brings the vault down. "
            f"Crackable ones carry {per_area:.3f} m² times their shear strength: the middle block punches out along "
            f"the middle planes of its neighbours, {8 * CELL * DEPTH:.2f} m² of crack.",
            "Waves along x alone stay below straight sliding up their steepest facet, tan(φ + slope), an upper bound: "
            f"by {100 * below.min():.0f} to {100 * below.max():.0f} %, since blocks turn about a crest as they slide.",
        ),
        differs=(
            f"Osteomorphic beds: from {int(wide.index[-2])} to {int(wide.index[-1])} facets a half λ still moves by "
            f"{100 * float((last / before - 1.0).abs().max()):.1f} %; cracks cost "
            f"{100 * (1 - float(last[('convex', 'cracks')]) / float(last[('convex', 'rigid')])):.0f} % of λ here.",
            "Contact at points of every facet (concave) against contact spread over it (convex): the vault differs by "
            f"{100 * float((concave / convex - 1.0).abs().max()):.2g} %, the osteomorphic blocks by "
            f"{100 * float((wide['concave'] / wide['convex'] - 1.0).abs().to_numpy().max()):.2g} %.",
            f"Experiments without dilation on the vault at {STRENGTHS[2] / 1e6:g} MPa, over λ: {said}. The geometry of "
            "these experiments stays at rest, and there is no row here that was held against a published number.",
        ),
        pictures={"": "Top: Abeille's vault, its mechanism, λ by strength. Bottom: osteomorphic blocks, λ by facets."},
    )  # fmt: skip


def _picture(table: pd.DataFrame, vault: LimitAnalysisResult, bone: LimitAnalysisResult) -> Figure:
    figure = figure_of(13.2, 9.2)
    draw_assembly(ax := axes_at(figure, 0.2, 4.9, 4.2, 3.6), vault.assembly, vault.labels)
    without_legend(ax, "Abeille's vault, 3 × 3, blocks of four quarters")
    draw_mechanism(ax := axes_at(figure, 4.5, 4.9, 4.2, 3.6), vault)
    without_legend(ax, f"its mechanism, λ = {vault.load_factor / 1e3:.1f} kN")
    _strengths(axes_at(figure, 9.6, 5.3, 3.3, 3.0), table)
    draw_mechanism(ax := axes_at(figure, 0.4, 0.8, 5.2, 3.6), bone)
    without_legend(ax, f"osteomorphic blocks that crack, λ = {bone.load_factor:.3f}")
    _facets(axes_at(figure, 6.6, 0.9, 6.2, 3.3), table)
    handles = drawing_handles("dry face", "inner face", "hinge", "slide", "open", "crack", "at rest")
    legend_at(figure, handles, 0.4, 0.05, 7)
    figure.suptitle("Blocks with non-planar faces that may crack", fontsize=12, y=0.985)
    return figure


def _strengths(ax: Axes, table: pd.DataFrame) -> None:
    rows = table[(table["part"] == "vault") & table["strength"].notna() & (table["blocks"] == 9)]
    for contact, (colour, dash, marker) in (("convex", PAIRED[0]), ("concave", PAIRED[1])):
        part = rows[rows["contact"] == contact]
        ax.plot(part["strength"] / 1e6, part["load_factor"] / 1e3, marker, color=colour, ls=dash, ms=5, label=contact)
    for row in table[table["part"].str.startswith("vault, exp")].to_dict("records"):
        brittle = row["part"].endswith("brittle")
        ax.plot(row["strength"] / 1e6, row["load_factor"] / 1e3, "v" if brittle else "D", color=GREY, ms=7,
                mfc="none", label=f"experiment, {'brittle' if brittle else 'plastic'}")  # fmt: skip
    ax.set_xscale("log")
    ax.set_yscale("log")
    name_axes(
        ax, "strength of the blocks σt = τ [MPa]", "λ, force on the middle [kN]", "crackable; rigid ones are locked"
    )
    ax.legend(frameon=False, fontsize=8)


def _facets(ax: Axes, table: pd.DataFrame) -> None:
    rows = table[table["part"] == "osteomorphic"]
    for (contact, cracks), (colour, dash, marker) in zip(
        itertools.product(("convex", "concave"), (False, True)), PAIRED, strict=False
    ):
        part = rows[(rows["contact"] == contact) & (rows["strength"].notna() == cracks)]
        name = f"{contact}, {'crackable' if cracks else 'rigid'}"
        ax.plot(part["facets"], part["load_factor"], marker, color=colour, ls=dash, ms=5, lw=1.2, label=name)
    ridge = table[table["part"] == "waves along x"]
    ax.plot(ridge["facets"], ridge["load_factor"], "+", color=GREY, ms=9, label="waves along x alone, rigid")
    ax.plot(
        ridge["facets"], ridge["closed_form"], color=GREY, lw=0.9, label="straight sliding, tan(φ + steepest chord)"
    )
    name_axes(ax, "facets along half a side [–]", "λ, horizontal load / weight [–]")
    ax.set_ylim(0.48, 0.74)
    ax.legend(frameon=False, fontsize=8, ncols=2)
    ax.set_title("two osteomorphic blocks on a base", fontsize=9)
