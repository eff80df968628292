"""The article, row by row: every figure and table of its section 3 beside what the other studies computed.

Source: Iannuzzo et al. 2024. The numbers of the other studies are read from their tables, as last written.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

import jld_maps
from jld_explore import sweep
from studies import leonardo_section_3_3, one_block_two_cubes, walls_of_section_3_1, what_is_1312
from studies.report import GREY, PAIRED, RESULTS, Report, axes_at, figure_of, markdown_table, name_axes, write
from studies.scenes import stacked_cubes

NAME: Final = "article"
MU, TAU = "materials.dry.friction_coefficient", "materials.inner.shear_strength"
UNKNOWN: Final = {
    "walls": "the article's own digits of the walls are not at hand: those of its source, Ferris & Tin-Loi",
    "layout": "the layout of the arch is a drawing that is not at hand: ours, and one searched for its λ",
    "load": "whether the force is each of three or all together is not said",
    "order": "which of Figures 5 to 7 shows what is not at hand",
}
SHOWN: Final = (
    ("Figure 2", "walls of section 3.1 at collapse",
     "first picture: mechanisms with dilation, highest and lowest without"),
    ("Table 1", "λ of these walls; digits: Ferris & Tin-Loi's", "six rows, and all solutions under the first picture"),
    ("Figure 3", "one block and two cubes, λ by direction", "second picture, above; eight rows, in closed form"),
    ("Figure 4", "mechanisms of two cubes over μ and τ",
     "second picture, below; two rows, all four regions and borders"),
    ("Figures 5 to 7", "arch of section 3.3; which shows what is unknown", "third and fourth picture: layouts, "
     "mechanisms, path of load and movement, interval without dilation; eight rows"),
    ("Table 2", "density, friction, strengths and stiffness of 3DEC", "used as stated; four rows of experiments"),
)  # fmt: skip


def table_of(name: str, out: Path) -> pd.DataFrame:
    """The table that a study has written, in a folder or among the results of the repository."""
    own = out / f"{name}.csv"
    return pd.read_csv(own if own.exists() else RESULTS / f"{name}.csv")


def figure_4(tension: float, points: int) -> tuple[set[str], float, float]:
    """Regions of two cubes over (μ, τA/W), and largest errors of λ and of borders against the closed form."""
    grid = {MU: np.linspace(0.02, 0.9, points).tolist(), TAU: np.linspace(0.03, 0.93, points + 1).tolist()}
    scene = stacked_cubes(2, friction=0.5, tension=tension, shear=0.5)

    def forms(table: pd.DataFrame) -> Any:
        mu, tau = (table[key].to_numpy(dtype=float) for key in (MU, TAU))
        return np.sort(np.stack(np.broadcast_arrays(mu, tau, (1.0 + tension) / 3.0, 0.5)), axis=0)

    table = sweep(scene, grid)
    found = jld_maps.borders(scene, grid, table)
    error = abs(table["load_factor"].to_numpy() - forms(table)[0]).max()
    apart = forms(found)
    return set(table["mechanism"]), float(error), float((apart[1] - apart[0]).max())


def rows_of(out: Path, coarse: bool) -> list[dict[str, Any]]:
    """One row for each number of section 3: what was published, and ours as a number or an interval."""
    rows: list[dict[str, Any]] = []

    def add(item: str, quantity: str, published: float | None, ours: Any, unknown: str = "", note: str = "") -> None:
        low, high = ours if isinstance(ours, tuple) else (ours, ours)
        inside = published is not None and low < high and low <= published <= high
        off = None if published is None or inside or low < high else high / published - 1.0
        if published is not None and low < high and abs(low / published - 1.0) < 1e-4:
            note = "equals the lowest"
        row = {"item": item, "quantity": quantity, "published": published, "ours_low": low, "ours_high": high}
        rows.append(row | {"difference": off, "agrees": "inside" if inside else note, "not_known": unknown})

    walls = table_of(walls_of_section_3_1.NAME, out)
    for wall, (published, lowest) in walls_of_section_3_1.PUBLISHED.items():
        own = walls[walls["wall"] == wall]
        zero = own[own["friction"] == "zero-dilation"]["load_factor"]
        with_dilation = float(own[own["friction"] == "associative"]["load_factor"].iloc[0])
        add("Figure 2, Table 1", f"wall {wall}, λ with dilation", published, with_dilation, "walls", "equal")
        add(
            "Figure 2, Table 1",
            f"wall {wall}, λ without",
            lowest,
            (float(zero.min()), float(zero.max())),
            "walls",
            "below",
        )
    cubes = table_of(one_block_two_cubes.NAME, out)
    for case, own in cubes[cubes["part"] == "direction"].groupby("case", sort=False):
        error = float((own["load_factor"] / own["closed_form"] - 1.0).abs().max())
        span = (float(own["load_factor"].min()), float(own["load_factor"].max()))
        add("Figure 3", f"{case}", None, span, note=f"closed form to {max(error, 1e-10):.0e} in {len(own)} directions")
    for tension in (0.0, 1.0):
        names, error, border = figure_4(tension, 12 if coarse else 40)
        regions = sorted(name for name in names if " and " not in name)
        note = f"{', '.join(regions)}; λ to {error:.0e}, borders to {border:.0e} of the closed form"
        add("Figure 4", f"mechanisms over (μ, τA/W), σtA/W = {tension:g}", None, np.nan, note=note)
    arch, history = table_of(leonardo_section_3_3.NAME, out), table_of(what_is_1312.NAME, out)
    ends = history.groupby(["layout", "start", "share"])["load_factor"].last()
    number = leonardo_section_3_3.value
    for name in ("ours", "found"):
        what = "our layout" if name == "ours" else "layout searched for this λ"
        add("Figures 5 to 7", f"JLD with dilation, N: {what}", 2153.0, number(arch, name, "λ, with dilation"), "layout")
        low, high = (number(arch, name, f"λ, without: {end}") for end in ("lowest", "highest"))
        add("Figures 5 to 7", f"JLD without, N: {what}, all solutions", 1312.0, (low, high), "layout")
        own = ends[name]
        add("Figures 5 to 7", f"JLD without, N: {what}, iterations", 1312.0, (own.min(), own.max()), "load", "beside")
        for end, published in (("with dilation", 1911.13), ("without", 2187.0)):
            each = [number(arch, name, f"experiment, {kind}, {end}") for kind in ("plastic", "brittle")]
            each += [number(arch, name, "experiment, plastic, with dilation, plastic gaps")] if end != "without" else []
            text = f"3DEC {end}, N: {what}, experiments"
            add("Figures 5 to 7, Table 2", text, published, (min(each), max(each)), "order", "outside")
    return rows


def run(out: Path, coarse: bool = False) -> pd.DataFrame:
    """Table, picture and page of all rows."""
    table = pd.DataFrame(rows_of(out, coarse))
    write(out, _report(table), table, {"": _picture(table)})
    page = (out / f"{NAME}.md").read_text("utf-8")
    places = [
        ("Figure 2, Table 1", walls_of_section_3_1.NAME),
        ("Figures 3 and 4", one_block_two_cubes.NAME),
        ("Figures 5 to 7, Table 2", leonardo_section_3_3.NAME),
        ("1312 N on the interval of all solutions", what_is_1312.NAME),
    ]
    pictures = "\n\n".join(f"**{item}** ([study]({name}.md))\n\n![{item}: ours]({name}.png)" for item, name in places)
    shown = markdown_table(pd.DataFrame(SHOWN, columns=["of the article", "what is known of it", "ours"]))
    text = f"{shown}\n\n{pictures}\n\n**What agrees**"
    (out / f"{NAME}.md").write_text(page.replace("**What agrees**", text, 1), "utf-8")
    return table


def _report(table: pd.DataFrame) -> Report:
    exact = table[table["quantity"].str.contains("wall .*with dilation", regex=True)]["difference"].abs().max()
    inside = table[table["agrees"] == "inside"]
    outside = table[table["agrees"] == "outside"]
    return Report(
        name=NAME,
        title="The article, row by row",
        question="What of section 3 of the source is met here, and what cannot be compared?",
        source="Iannuzzo et al. 2024, section 3: Figures 2 to 7, Tables 1 and 2. Walls: Ferris & Tin-Loi 2001.",
        model="Each row is a number of the source beside ours; an interval where the answer is not one number. Rows "
        "are read from the tables of the studies named beside their pictures; Figure 4 is computed anew by "
        "`jld_explore.sweep`.",
        agrees=(
            f"Walls with dilation to {max(exact, 1e-10):.0e}; blocks and cubes in closed form, with all four "
            "mechanisms and their borders.",
            f"{len(inside)} published numbers lie inside intervals of ours.",
        ),
        differs=(
            *(f"Not known ({name}): {one}." for name, one in UNKNOWN.items()),
            f"{len(outside)} rows of 3DEC lie outside every experiment here; see the study of section 3.3.",
        ),
        pictures={"": "Ours over published: dots where both are one number, bars where ours is an interval."},
    )


def _picture(table: pd.DataFrame) -> Figure:
    own = table[table["published"].notna()].reset_index(drop=True)
    figure = figure_of(9.5, 0.28 * len(own) + 1.1)
    ax = axes_at(figure, 4.9, 0.6, 4.3, 0.28 * len(own) + 0.1)
    for k, (_, row) in enumerate(own.iterrows()):
        ends = [row[name] / row["published"] for name in ("ours_low", "ours_high")]
        colour = PAIRED[0][0] if row["agrees"] != "outside" else PAIRED[1][0]
        ax.plot(ends, [k, k], color=colour, lw=4.0, solid_capstyle="butt")
        ax.plot(ends, [k, k], "o" if ends[0] == ends[1] else "|", color=colour, ms=6)
    ax.axvline(1.0, color=GREY, lw=1.0)
    ax.set_yticks(range(len(own)), [f"{one.item}: {one.quantity}" for one in own.itertuples()], fontsize=7)
    ax.invert_yaxis()
    name_axes(ax, "ours over published", "", None)
    return figure
