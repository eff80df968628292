"""Write the results of a search of labels and geometry: table, scene, picture and page."""

from __future__ import annotations

import html
import json
import math
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd

from jld_core.build import build_assembly
from jld_core.files import write_text
from jld_explore.report import csv_of
from jld_explore.space import to_string
from jld_geometry.moved_search import MovedSearch

FILES: Final = ("moved.csv", "moved.json", "moved.png", "moved.html")
"""Files that a search of labels and geometry adds to the folder of its first round."""

_PAGE: Final = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>{title}</title>
<style>
body {{ font: 15px/1.5 system-ui, sans-serif; max-width: 70rem; margin: 2rem auto; padding: 0 1rem; color: #1b1b1b; }}
table {{ border-collapse: collapse; }} td, th {{ padding: .2rem .8rem; text-align: right; }}
thead th {{ border-bottom: 1px solid #888; }} img {{ max-width: 100%; }}
td:last-child, th:last-child {{ text-align: left; }}
</style></head><body>
<h1>{title}</h1>
<p>{words}</p>
<p><a href="moved.json">Scene of the best layout</a>, <a href="moved.csv">table</a>, searches of labels: {rounds}.</p>
<img src="moved.png" alt="Best layout before and after its joints moved">
<p>Layouts whose joints moved, ranked by the lower bound of λ by fields (blocks may crack anywhere). Row 0 is the
layout that the scene states; a dash means that nothing is proven.</p>
{table}
</body></html>
"""


def moved_table(done: MovedSearch) -> pd.DataFrame:
    """Return one row per moved layout, ranked by the lower bound of λ by fields."""
    rows = []
    for rank, one in enumerate(done.layouts, 1):
        low, high = one.fields_start
        moved_low, moved_high = one.fields
        rows.append(
            {
                "rank": rank,
                "round": one.number,
                "row": one.row,
                "start": one.start,
                "load_factor": one.load_factor,
                "fields_lo_start": low if math.isfinite(low) else math.nan,
                "fields_hi_start": high if math.isfinite(high) else math.nan,
                "fields_lo": moved_low if math.isfinite(moved_low) else math.nan,
                "fields_hi": moved_high if math.isfinite(moved_high) else math.nan,
                "end": one.end,
                "labelling": to_string(one.labels),
            }
        )
    return pd.DataFrame(rows)


def moved_facts(done: MovedSearch) -> dict[str, Any]:
    """Return the entry "moved" of summary.json and of `jld explore --move --json`."""
    best = done.best
    stated = next((one for one in done.layouts if one.row == 0), None)
    bounds = best.fields if best.moved.any() else best.fields_start
    return {
        "rounds": len(done.rounds),
        "layouts": len(done.layouts),
        "stated": None if stated is None else [_number(end) for end in stated.fields_start],
        "fields_lo": _number(bounds[0]),
        "fields_hi": _number(bounds[1]),
        "round": best.number,
        "row": best.row,
        "labelling": to_string(best.labels),
        "load_factor": _number(best.load_factor),
        "stop": done.stop,
        "scene": FILES[1],
    }


def words_of_move(facts: dict[str, Any]) -> str:
    """Describe the best moved layout in one sentence."""
    low, high = (_said(facts[name]) for name in ("fields_lo", "fields_hi"))
    found = f"best with moved joints: {low} ≤ λ ≤ {high} by fields (round {facts['round']}, row {facts['row']})"
    if facts["stated"] is not None:
        least, most = (_said(end) for end in facts["stated"])
        found += f"; the layout of the scene: {least} ≤ λ ≤ {most}"
    return f"{found}; rounds: {facts['rounds']}, layouts moved: {facts['layouts']}, ended: {facts['stop']}"


def write_moved(done: MovedSearch, folder: Path, *, pictures: bool = True) -> dict[str, Any]:
    """Write table, scene, picture and page of moved layouts; return the entry "moved".

    folder: folder of the first search, whose summary also gets the entry. pictures: False omits picture and page.
    """
    table, facts, best = moved_table(done), moved_facts(done), done.best
    write_text(folder / FILES[0], csv_of(table))
    write_text(folder / FILES[1], best.scene.model_dump_json(indent=1, exclude_defaults=True) + "\n")
    summary = {**done.first.summary.to_json(), "moved": facts}
    write_text(folder / "summary.json", json.dumps(summary, indent=1))
    if not pictures:
        return facts
    from jld_core.views.figures import save_figure
    from jld_core.views.moved_joints import figure_of_move

    before, after = done.first.assembly, build_assembly(best.scene)
    # vertices of later rounds start where the former round left them
    moved = best.moved if best.number == 1 else np.zeros_like(best.moved)
    bounds = f"{_said(facts['fields_lo'])} ≤ λ ≤ {_said(facts['fields_hi'])} by fields"
    titles = ("layout of the scene", f"best moved layout: {bounds}")
    figure = figure_of_move(before, after, best.labels, best.places, moved, titles, before.labels)
    save_figure(figure, folder / FILES[2])
    links = ", ".join(
        f'<a href="{"" if k == 1 else f"round-{k}/"}report.html">round {k}</a>' for k in range(1, len(done.rounds) + 1)
    )
    shown = table.drop(columns=["labelling"]).to_html(index=False, float_format=_said, na_rep="–", border=0)
    title = html.escape(f"{done.first.scene.name}: layouts with moved joints")
    page = _PAGE.format(title=title, words=html.escape(words_of_move(facts)), rounds=links, table=shown)
    write_text(folder / FILES[3], page)
    return facts


def _number(value: float) -> float | None:
    """Return a float for JSON, None where it is not finite."""
    return float(value) if math.isfinite(value) else None


def _said(value: float | None) -> str:
    """Return a number as text for the page and the picture."""
    return "none" if value is None else f"{value:.5g}"
