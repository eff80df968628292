"""Ten solids for `jld cut`, lengths in m: each with its box, load and least load factor."""

from __future__ import annotations

import resource
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
import trimesh
from manifold3d import CrossSection, Manifold, Mesh64, OpType
from matplotlib.figure import Figure
from PIL import Image

from jld_core import InputError
from jld_cut import Options, cut
from jld_cut.meshes import stl_bytes, surface_of
from studies.report import PAIRED, Report, axes_at, figure_of, name_axes, write

NAME: Final = "cut_solids"


@dataclass(frozen=True)
class Case:
    """A solid, the sides of the box of its parts, m, and its loads, N."""

    solid: Callable[[], Any]
    fit: float | tuple[float, float, float]
    loads: tuple[str, ...]

    @property
    def box(self) -> tuple[float, float, float]:
        """Sides of the box."""
        return self.fit if isinstance(self.fit, tuple) else (self.fit,) * 3


def block(x0: float, y0: float, z0: float, x1: float, y1: float, z1: float) -> Any:
    return Manifold.cube((x1 - x0, y1 - y0, z1 - z0)).translate((x0, y0, z0))


def standing(outline: list[tuple[float, float]], width: float) -> Any:
    """Extrude an outline in x and z along y."""
    return CrossSection([np.array(outline)]).extrude(width).rotate((90, 0, 0)).translate((0, width, 0))


def bench() -> Any:
    return block(0, 0, 0.4, 1.8, 0.4, 0.5) + block(0.1, 0, 0, 0.3, 0.4, 0.41) + block(1.5, 0, 0, 1.7, 0.4, 0.41)


def bridge() -> Any:
    """A footbridge: a segment of a circle below, a hump above."""
    angle = np.linspace(np.pi / 2 + 0.9, np.pi / 2 - 0.9, 24)
    radius = 1.5 / np.sin(0.9)
    low = [(1.5 + radius * np.cos(a), radius * (np.sin(a) - np.cos(0.9))) for a in angle]
    high = [(3.4, 0.0), (3.4, 0.4), (3.0, 1.0), (1.5, 1.15), (0.0, 1.0), (-0.4, 0.4), (-0.4, 0.0)]
    return standing([*low, *high], 1.0)


def shell() -> Any:
    dome = Manifold.sphere(1.6, 48) - Manifold.sphere(1.4, 48)
    half = dome ^ block(-2, -2, 0, 2, 2, 2)
    for turn in range(2):
        half -= Manifold.cylinder(4, 0.85, 0.85, 32, True).rotate((90, 0, 90 * turn))
    return half


def arch() -> Any:
    outer = CrossSection.circle(2.0, 48) - CrossSection.circle(1.3, 48)
    ring = outer.extrude(0.7) ^ block(-3, 0, -1, 3, 3, 1)
    standing_arch = ring.rotate((90, 0, 0))
    return standing_arch - Manifold.cylinder(2, 0.16, 0.16, 24, True).rotate((90, 0, 0)).translate((0, 0, 1.66))


def stair() -> Any:
    """Ten steps about a newel, each of which lies on the one below: a step that hangs from the newel falls if cut."""
    whole = Manifold.cylinder(2.0, 0.25, 0.25, 32)
    angle = np.radians(np.linspace(0.0, 54.0, 10))
    for k in range(10):
        sector = CrossSection([np.array([(0.0, 0.0), *zip(1.1 * np.cos(angle), 1.1 * np.sin(angle), strict=True)])])
        whole += sector.extrude(0.3 if k else 0.2).rotate((0, 0, 36 * k)).translate((0, 0, max(0.0, 0.2 * k - 0.1)))
    return whole


def table() -> Any:
    top = Manifold.cylinder(0.08, 0.7, 0.7, 48).translate((0, 0, 0.7))
    legs = [Manifold.cylinder(0.71, 0.09, 0.07, 16).translate((x, y, 0)) for x in (-0.4, 0.4) for y in (-0.4, 0.4)]
    return Manifold.batch_boolean([top, *legs], OpType.Add)


def chair() -> Any:
    seat = block(0, 0, 0.4, 0.5, 0.5, 0.48) + block(0, 0.42, 0.4, 0.5, 0.5, 1.0)
    legs = [block(x, y, 0, x + 0.08, y + 0.08, 0.41) for x in (0, 0.42) for y in (0, 0.42)]
    return Manifold.batch_boolean([seat, *legs], OpType.Add)


def column() -> Any:
    parts = [Manifold.cylinder(1.2, 0.22, 0.18, 24)]
    for k in range(4):
        ball = Manifold.sphere(0.18, 16)
        parts.append(
            (
                ball.translate((0, 0, 1.15))
                + ball.scale((0.7, 0.7, 0.7))
                .rotate((0, 0, 90 * k))
                .translate((0.5 * np.cos(k * np.pi / 2), 0.5 * np.sin(k * np.pi / 2), 2.1))
            ).hull()
        )
    return Manifold.batch_boolean(parts, OpType.Add) ^ block(-2, -2, 0, 2, 2, 2.15)


def corbel() -> Any:
    outline = [(0, 0), (0.5, 0), (0.5, 1.0), (0.7, 1.0), (0.7, 1.3), (0.95, 1.3), (0.95, 1.6), (0, 1.6)]
    return standing(outline, 0.5)


def dome() -> Any:
    angle = np.linspace(0.0, np.arccos(0.45 / 1.85), 13)
    outer = [(2.0 * np.cos(a), 2.0 * np.sin(a)) for a in angle]
    inner = [(1.7 * np.cos(a), 1.7 * np.sin(a)) for a in angle[::-1]]
    return CrossSection([np.array(outer + inner)]).revolve(48)


SOLIDS: Final[dict[str, Case]] = {
    "bench": Case(bench, 0.95, ("0,0,-1000@0.6,-1,0.49,1.2,1,0.51",)),
    "bridge": Case(bridge, 1.7, ("0,0,-20000@1.2,-1,0.9,1.8,2,2",)),
    "shell": Case(shell, 1.3, ("0,0,-10000@-2,-2,1.2,2,2,2",)),
    "arch": Case(arch, 1.4, ("0,0,-10000@-0.4,-2,1.9,0.4,2,2.1",)),
    "stair": Case(stair, (1.9, 1.4, 0.5), ("0,0,-500@0.6,-2,0,2,2,2.5",)),
    "table": Case(table, 0.75, ("0,0,-1000@-0.2,-0.2,0.7,0.2,0.2,1",)),
    "chair": Case(chair, 0.6, ("0,0,-1000@0,0,0.4,0.5,0.4,0.5",)),
    "column": Case(column, 1.0, ("0,0,-400@-2,-2,2.1,2,2,3",)),
    "corbel": Case(corbel, 0.7, ("0,0,-2000@0.7,-1,1.5,1,2,2",)),
    "dome": Case(dome, 2.0, ("0,0,-20000@-2,-2,1.6,2,2,3",)),
}


def independent_check(folder: Path, fit: tuple[float, float, float]) -> dict[str, Any]:
    """Read the parts of a folder again: watertight, in their box, disjoint, and each path of assembly free."""
    table = pd.read_csv(folder / "parts.csv").sort_values("part")
    meshes = {int(row["part"]): trimesh.load_mesh(folder / row["file"]) for _, row in table.iterrows()}
    solids = {
        k: Manifold(Mesh64(np.array(one.vertices, dtype=float), np.array(one.faces, dtype=np.uint64)))
        for k, one in meshes.items()
    }
    overlap, blocked, laid = 0.0, 0, list[int]()
    size = max(float(one.extents.max()) for one in meshes.values())
    for _, row in table.sort_values("step").iterrows():
        part = int(row["part"])
        whole = solids[part].volume()
        for other in laid:
            overlap = max(overlap, (solids[part] ^ solids[other]).volume() / whole)
        if row["step"] == row["step"]:
            way = -np.array([row["comes_x"], row["comes_y"], row["comes_z"]])
            for share in np.linspace(0.02, 1.5, 12):
                moved = solids[part].translate(tuple(share * size * way))
                blocked += any((moved ^ solids[other]).volume() > 1e-6 * whole for other in laid)
        laid.append(part)
    beds = [trimesh.load_mesh(folder / "bed" / Path(row["file"]).name) for _, row in table.iterrows()]
    sides = np.array([np.sort(one.extents) for one in beds])
    return {
        "watertight": all(one.is_watertight for one in meshes.values()),
        "in_box": bool((sides <= np.sort(fit) * (1 + 1e-4)).all()),
        "overlap": overlap,
        "blocked": blocked,
    }


def processor() -> float:
    """Return the processor time of this process and of those that it started and that ended, s."""
    return sum(sum(resource.getrusage(who)[:2]) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))


def with_planes(row: dict[str, Any], out: Path, seconds: float) -> dict[str, Any]:
    """Cut a solid by planes along its axes alone, to at most as many parts, without keys: λ of the strongest."""
    name, case = row["solid"], SOLIDS[row["solid"]]
    options = Options(case.box, case.loads, seconds=seconds, clearance=0.002, families=("grid",), keys=False)
    try:
        found = cut(out / f"{name}.stl", replace(options, parts=row["parts"]), out / f"{name}_grid")
    except InputError:
        return row | {"grid": None, "grid_proven": None, "by_grid": None}
    low = np.inf if row["locked"] else row["bracket_lo"]
    grid = np.inf if found["locked"] else found["bracket"][0]
    by_grid = 1.0 if low == grid else low / grid
    return row | {"grid": grid, "grid_proven": found["proven"], "by_grid": by_grid}


def row_of(name: str, out: Path, seconds: float) -> dict[str, Any]:
    """Cut one solid; return its facts and those of the independent check."""
    case, start = SOLIDS[name], processor()
    path = out / f"{name}.stl"
    path.write_bytes(stl_bytes(*surface_of(case.solid())))
    options = Options(case.box, case.loads, seconds=seconds, clearance=0.002)
    found = cut(path, options, out / name, print)
    kept = ("family", "parts", "proven", "layouts", "bound", "bound_by", "meets", "can_be_laid")
    used = processor() - start
    planes = [one["parts"] for one in found["families"] if one["name"] == "grid" and one["parts"] is not None]
    return (
        {"solid": name}
        | {key: found[key] for key in (*kept, "volume_error", "verdict", "file_error", "seconds")}
        | {"processor": used}
        | {f"{key}_{end}": found[key][k] for key in ("bracket", "uncut") for k, end in enumerate(("lo", "hi"))}
        | {"of_cells": found["load_factor_of_cells"], "locked": found["locked"]}
        | {"grid_parts": min(planes, default=None)}
        | {f"by_fields_{end}": (found["by_fields"] or (None, None))[k] for k, end in enumerate(("lo", "hi"))}
        | {"without_keys": found["load_factor_without_keys"], "keys": "; ".join(key["told"] for key in found["keys"])}
        | {"left_out": "; ".join(found["left_out"])}
        | independent_check(out / name, case.box)
    )


def measured(folder: Path, seconds: float, names: tuple[str, ...] = tuple(SOLIDS)) -> pd.DataFrame:
    """Cut solids into folders; write the table after each."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = []
    for name in names:
        print(name, flush=True)
        try:
            rows.append(row_of(name, folder, seconds))
        except (InputError, ArithmeticError, ValueError) as error:
            rows.append({"solid": name, "problem": str(error)})
        pd.DataFrame(rows).to_csv(folder / "table.csv", index=False)
    rows = [with_planes(row, folder, seconds) if "parts" in row else row for row in rows]
    pd.DataFrame(rows).to_csv(folder / "table.csv", index=False)
    return pd.DataFrame(rows)


def parts_of(folder: Path, names: list[str]) -> Figure:
    """Return the pictures of cut solids, two in a row."""
    rows = -(-len(names) // 2)
    figure = figure_of(10.0, 3.6 * rows)
    for k, name in enumerate(names):
        with Image.open(folder / name / "parts.png") as picture:
            image = np.asarray(picture.convert("RGB"))
        axes = figure.add_axes((0.5 * (k % 2), 1.0 - (k // 2 + 1) / rows, 0.5, 1.0 / rows))
        axes.imshow(image)
        axes.set_axis_off()
    return figure


def written(out: Path, folder: Path, table: pd.DataFrame, seconds: float, load: str) -> pd.DataFrame:
    """Write the page of a table, with the pictures in the folders of the solids."""
    whole = table[table["parts"].notna()].copy()
    whole["grid"] = whole["grid"].astype(float)
    finite = whole[whole["bracket_lo"].notna() & (whole["bracket_hi"].notna() | np.isfinite(whole["grid"]))]
    yes = ("watertight", "in_box", "meets", "can_be_laid", "proven")
    counts = {key: sum(value == 1 for value in whole[key]) for key in yes}
    above = whole["solid"][whole["bracket_lo"].astype(float) > 1.001 * whole["uncut_lo"].astype(float)]
    ratio = whole["by_grid"].astype(float)
    better, fewer = whole["solid"][ratio >= 1.15], whole["solid"][whole["grid_parts"].astype(float) > whole["parts"]]
    keyed = whole[whole["keys"].fillna("") != ""]
    gains = [f"{row['solid']} {row['without_keys']:.4g} to {row['bracket_lo']:.4g}" for _, row in keyed.iterrows()]
    ends = [
        f"{row['solid']} {'–' if np.isnan(low) else f'{low:.4g}'} to {'–' if np.isnan(high) else f'{high:.4g}'}"
        for _, row in whole.iterrows()
        for low, high in [np.array([row["by_fields_lo"], row["by_fields_hi"]], dtype=float)]
        if not np.isnan([low, high]).all()
    ]
    unproven = [
        f"{row['solid']} (λ of the cells ≤ {row['bound']:.4g} by {row['bound_by']})"
        for _, row in whole[whole["proven"] != 1].iterrows()
    ]
    report = Report(
        name=NAME,
        title="Ten solids cut to parts",
        question="Do the parts of any solid fit, go together, carry, and have whole files?",
        source="No published numbers; the solids are ours.",
        model=f"{seconds:g} s asked for each cut, on {load}. Clearance 2 mm, default material. The columns watertight, "
        "in_box, overlap (share of a part) and blocked (steps on the paths of assembly) come from another library, "
        "which reads the files of the parts again. of_cells: λ of the layout on the cells of the search; layouts: how "
        "many were solved; processor: time of all processes, s. grid: λ of the strongest layout of planes along the "
        "axes with at most as many parts, by a cut of its own in as much time; grid_parts: the fewest that such planes "
        "need; by_grid: λ by grid.",
        agrees=(
            f"{counts['watertight']} of {len(whole)} solids have watertight files only, {counts['in_box']} parts that "
            "all fit the box.",
            f"{counts['meets']} carry the load that was asked, {counts['can_be_laid']} go together by translations; "
            f"the largest overlap of two parts is {whole['overlap'].max():.1e} of a part.",
            f"{counts['proven']} of {len(whole)} are proven: no layout of their cells with at most as many parts is "
            "stronger.",
            f"λ is at least {ratio.min():.3f} times that of planes along the axes with as many parts, and at least "
            f"1.15 times it on {len(better)}: {', '.join(better)} (the planes have no keys). Such planes need more "
            f"parts on {len(fewer)}: {', '.join(fewer)}.",
            f"Keys raise λ on {len(keyed)}: {', '.join(gains) or 'none'}. On the others none slides, or no key "
            "raises it.",
            f"Volumes of the files differ from those of the parts by at most {whole['file_error'].max():.1e}.",
        ),
        differs=(
            f"Without an order in time: {', '.join(whole['solid'][whole['can_be_laid'].isna()]) or 'none'}.",
            f"Parts above the uncut solid: {', '.join(above) or 'none'}. A dry joint opens over its whole depth, an "
            "inner section cracks at its elastic limit: where thrust exceeds half of tensile strength × area, the dry "
            "joint bends more.",
            f"Not proven in time: {', '.join(unproven) or 'none'}.",
            f"Solids with bounds by fields in time: {len(ends)} ({'; '.join(ends)}). The upper bound comes first, and "
            "says where the cells have too few faces to crack at.",
            "Without an upper end: no load makes these solids collapse while nothing is crushed.",
            *(f"{row['solid']}: {row['problem']}." for _, row in table.iterrows() if row["parts"] != row["parts"]),
        ),
        pictures={
            "": "λ of the parts on cells that crack (lower end), and of the best layout of planes along the axes with "
            "at most as many parts.",
            "_parts": "The parts of each solid, pulled apart.",
        },
    )
    figure = figure_of(8.0, 4.0)
    ax = axes_at(figure, 0.9, 0.7, 6.8, 2.9)
    place = np.arange(len(finite))
    ax.bar(place - 0.2, finite["bracket_lo"].astype(float), 0.38, color=PAIRED[0][0], label="chosen")
    ax.bar(place + 0.2, finite["grid"].astype(float), 0.38, color=PAIRED[1][0], hatch="//", label="grid")
    grids = ["–" if np.isnan(number) else f"{number:.0f}" for number in finite["grid_parts"].astype(float)]
    names = zip(finite["solid"], finite["parts"], grids, strict=True)
    ax.set_xticks(place, [f"{name}\n{parts:.0f} | {grid} parts" for name, parts, grid in names])
    ax.set_yscale("log")
    name_axes(ax, "", "λ [–]")
    ax.legend(frameon=False, fontsize=9)
    shown = table.drop(columns=["verdict", "problem", "left_out"], errors="ignore")
    write(out, report, table, {"": figure, "_parts": parts_of(folder, list(whole["solid"]))}, shown)
    return table


def run(out: Path, coarse: bool = False) -> pd.DataFrame:
    """Cut the ten solids, or two, and write the page."""
    seconds = 6.0 if coarse else 60.0
    with tempfile.TemporaryDirectory() as folder:
        table = measured(Path(folder), seconds, ("bench", "corbel") if coarse else tuple(SOLIDS))
        return written(out, Path(folder), table, seconds, "a machine whose load was not measured")


if __name__ == "__main__":
    print(measured(Path(sys.argv[1]), float(sys.argv[2]), tuple(sys.argv[3:]) or tuple(SOLIDS)).to_string())
