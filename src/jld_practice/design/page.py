"""Files of a design: page in plain words, picture, table of blocks, scene and summary."""

from __future__ import annotations

import html
import json
import math
import re
from collections.abc import Sequence
from typing import Any, Final

from jld_core import Layout, blocks_csv, build_assembly, files
from jld_core.limit import number
from jld_practice.design.tessellations import region_words
from jld_practice.design.trials import UNPROVEN, Bounds, Design, Trial, built

# page, summary, scene of the best layout, its picture and its blocks
FILES: Final = ("report.html", "summary.json", "best.json", "best.png", "blocks.csv")

# explanation of what surprises most
WHY_CUT: Final = (
    "A cut layout may carry more than the uncut structure where blocks crack along the faces of their cells only. "
    "Such a crack carries its shear strength whatever presses on it, unless the scene gives inner faces friction. A "
    "dry joint has friction, which grows with the load that presses on it. By fields, which decide the order here, "
    "blocks crack anywhere, and a gain that rests on the cells alone does not show. A hinge between blocks also needs "
    "a width there, since stone fails in shear beside a point that carries a large force."
)

_PAGE: Final = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>{title}</title>
<style>
body {{ font: 15px/1.5 system-ui, sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem; color: #1b1b1b; }}
table {{ border-collapse: collapse; }} td, th {{ padding: .2rem .8rem; text-align: left; vertical-align: top; }}
thead th {{ border-bottom: 1px solid #888; }} img {{ max-width: 100%; }} .big {{ font-size: 1.2rem; }}
</style></head><body>
<h1>{title}</h1>
{body}
</body></html>
"""


def write_design(work: Design, *, pictures: bool = True) -> dict[str, Any]:
    """Write all files of a design into its folder; return the contents of summary.json."""
    winner = work.winner
    facts = facts_of(work)
    files.write_text(work.folder / FILES[1], json.dumps(facts, indent=1))
    if winner is not None:
        files.write_text(work.folder / FILES[2], winner.scene.model_dump_json(indent=1, exclude_defaults=True) + "\n")
        assembly = built(winner)
        layout = Layout(winner.scene, assembly, assembly.labels)
        files.write_text(work.folder / FILES[4], blocks_csv(layout))
        if pictures:
            _draw(work, winner)
    files.write_text(work.folder / FILES[0], _page(work, pictures and winner is not None))
    return facts


def facts_of(work: Design) -> dict[str, Any]:
    """Return the results of a design as in summary.json; None for unknown or infinite values."""
    # `jld design --json` prints the same object.
    winner, usual = work.winner, work.usual
    return {
        "best": None if winner is None else number(winner.proven),
        "proven": False,
        "verdict": verdict(work),
        "rivals": [
            {"tessellation": rival.tessellation, "kind": rival.kind, "at_most": number(rival.upper_estimate)}
            for rival in rivals_of(work)
        ],
        "fields": None if winner is None else _bounds(winner.fields),
        "load_factor": None if winner is None else number(winner.load_factor),
        "tessellation": None if winner is None else winner.tessellation,
        "kind": None if winner is None else winner.kind,
        "usual": None if usual is None else {"load_factor": number(usual.load_factor), "fields": _bounds(usual.fields)},
        "gain": gain_of(work),
        "tessellations": [
            {
                "name": tessellation.name,
                "words": tessellation.words,
                "problem": tessellation.problem,
                "search": work.search_words.get(tessellation.name),
            }
            for tessellation in work.tessellations
        ],
        "layouts": [
            {
                "tessellation": trial.tessellation,
                "kind": trial.kind,
                "load_factor": number(trial.load_factor),
                "fields": _bounds(trial.fields),
                "words": trial.words,
            }
            for trial in work.trials
        ],
        "checks": [{"name": check.name, "words": check.words, **check.values} for check in work.checks],
        **({} if (uncut := uncut_at_most(work)) is None else {"uncut_at_most": uncut}),
        "assumed": list(work.outline.assumed),
        "options": work.options.given(),
        "scene": FILES[2] if winner is not None else None,
        "stop_reason": work.stop,
        "seconds": work.seconds,
    }


def uncut_at_most(work: Design) -> float | None:
    """Return the upper bound on λ by faces without cuts if the best is proven stronger."""
    return next((check.values["uncut_at_most"] for check in work.checks if "uncut_at_most" in check.values), None)


def gain_of(work: Design) -> float | None:
    """Return the proven ratio of λ of the best layout to λ of the usual bond; None if unknown."""
    # The lower bound of the best over the upper bound of the usual bond, both by fields or both by faces.
    winner, usual = work.winner, work.usual
    if winner is None or usual is None:
        return None
    # like with like: by faces a layout may seem far stronger
    if UNPROVEN in (winner.fields, usual.fields) and winner.fields != usual.fields:
        return None
    by_fields = winner.fields != UNPROVEN
    ours, theirs = (winner.fields[0], usual.fields[1]) if by_fields else (winner.faces[0], usual.faces[1])
    return ours / theirs if math.isfinite(ours) and 0.0 < theirs < math.inf else None


def rivals_of(work: Design) -> list[Trial]:
    """Return the other allowed layouts that are not proven weaker, those that may carry most first."""
    winner = work.winner
    if winner is None:
        return []
    others = [trial for trial in work.trials if trial is not winner and trial.allowed and trial.fields[1] >= 0.0]
    return sorted(
        (other for other in others if other.upper_estimate > winner.proven), key=lambda other: -other.upper_estimate
    )


def verdict(work: Design) -> str:
    """Say what the best layout carries, by the weakest model known, and what is not decided."""
    winner = work.winner
    if winner is None:
        return "No layout was found yet that keeps the limits and stands."
    stones = len(_blocks(winner))
    subject = f"{stones} stones carry" if stones != 1 else "1 stone carries"
    load = "your load" if not winner.scene.loads.has_cases else "what your load cases require"
    anywhere = winner.fields != UNPROVEN
    low, high = winner.fields if anywhere else winner.faces
    model = "wherever they crack" if anywhere else "by the faces drawn; cracks elsewhere are not bounded"
    diagram = (
        "" if not anywhere or math.isnan(winner.load_factor) else f" By the faces drawn it is {winner.load_factor:.4g}."
    )
    if not math.isfinite(low):
        at_most = f"at most {high:.4g} times {load}" if math.isfinite(high) else "no bound was found in time"
        text = f"What {stones} stones carry {model} is not decided: {at_most}."
    else:
        ending = f"; not decided between that and {high:.4g}" if high > (1.0 + _CLOSE) * low else ""
        ending = "; nothing bounds it from above" if math.isinf(high) else ending
        text = f"{subject} at least {low:.4g} times {load} {model}{ending}."
        if low < 1.0:
            text += " That is less than the load itself." if high < 1.0 else " That the load is carried is not proven."
    text += diagram
    rivals = rivals_of(work)
    if rivals:
        at_most = (
            "without a bound" if math.isinf(rivals[0].upper_estimate) else f"at most {rivals[0].upper_estimate:.4g}"
        )
        count = "another layout" if len(rivals) == 1 else f"one of {len(rivals)} other layouts"
        text += f" Whether {count} carries more is not decided ({_name(rivals[0])}: {at_most})."
    return text


_CLOSE: Final = 1e-3  # relative width of a bracket up to which nothing is said to be undecided


def words_of(work: Design) -> str:
    """Describe the result of a design in lines for the terminal: best, gain, checks, guesses."""
    winner = work.winner
    if winner is None:
        return "no layout was found that keeps the limits and stands"
    lines = [f"verdict      {verdict(work)}", f"best         {_name(winner)}: {_claim(winner)}"]
    if work.usual is not None:
        lines.append(f"usual bond   {_claim(work.usual)}; {_compared(work, work.usual)}")
    lines += [f"checked      {check.words}" for check in work.checks]
    lines += [f"assumed      {assumption}" for assumption in work.outline.assumed]
    lines.append("not proven   that no stronger layout exists: tessellations and moves were tried, not all")
    return "\n".join([*lines, f"written to   {work.folder}: {', '.join(FILES)}"])


def _name(trial: Trial) -> str:
    """Return the tessellation of a trial and how its labels and joints were found, in words."""
    how = {"stated": "as stated", "searched": "labels searched", "moved": "labels searched and joints moved"}
    return f"{trial.tessellation}, {how[trial.kind]}"


def _compared(work: Design, usual: Trial) -> str:
    """Say what is proven of the best layout beside the usual bond."""
    if usual is work.winner:
        return "it is the best that was found"
    if min(usual.fields[1], usual.faces[1]) < 0.0 and work.winner is not None and work.winner.proven >= 0.0:
        return "the best does"
    gain = gain_of(work)
    broken = "" if usual.allowed else "it does not keep the limits, and "
    if gain is None or gain < 1.0:
        return f"{broken}that the best carries more is not proven"
    return f"{broken}the best is proven to carry {gain:.3g} times that most"


def _claim(trial: Trial) -> str:
    """Describe the load carried at least and at most, with the kind of proof."""
    low, high = trial.fields
    if math.isfinite(low):
        at_most = f", at most {high:.4g}" if math.isfinite(high) else ""
        return f"carries at least {low:.4g} times the load wherever its blocks crack{at_most}"
    if high < 0.0:
        return "does not stand under its dead load where blocks crack anywhere"
    if math.isfinite(high):
        text = (
            f"carries at most {high:.4g} times the load where blocks crack anywhere; no lower bound was found in time"
        )
        return f"{text} ({trial.by_faces})"
    low, high = trial.faces
    if high < 0.0:
        return "does not stand under its dead load"
    if math.isfinite(low):
        return f"carries {low:.4g} times the load if its blocks crack along the faces of its cells only"
    return f"{trial.by_faces}, without a proof"


def _page(work: Design, pictured: bool) -> str:
    winner = work.winner
    name = work.outline.scene.name
    parts = [f"<p class=big><strong>{html.escape(verdict(work))}</strong></p>"]
    parts.append(f"<p>{html.escape(region_words(work.outline.scene))}. Loads: {html.escape(_loads(work))}.</p>")
    if winner is not None:
        claim = f"The best layout ({_name(winner)}) {_claim(winner)}."
        if work.usual is not None:
            claim += f" The usual bond {_claim(work.usual)}; {_compared(work, work.usual)}."
        parts.append(f"<p>{html.escape(claim)}</p>")
        if pictured:
            parts.append(f'<img src="{FILES[3]}" alt="Usual bond and best layout with numbered blocks">')
    parts.append("<h2>What was tried</h2>" + _table(_tried(work)))
    if work.checks:
        parts.append("<h2>How the best was checked</h2>" + _list([check.words for check in work.checks]))
    parts.append("<h2>What is proven, and what is not</h2>" + _list(_proven(work)))
    if winner is not None:
        parts.append("<h2>Blocks</h2>" + _table(_blocks(winner)))
    if work.outline.assumed:
        parts.append("<h2>What was assumed</h2>" + _list(work.outline.assumed))
    if uncut_at_most(work) is not None:
        parts.append("<h2>Why cuts make it stronger here</h2><p>" + WHY_CUT + "</p>")
    parts.append("<h2>What next</h2>" + _list(_next()))
    parts.append(f"<p>{work.seconds:.0f} s, ended: {html.escape(work.stop)}.</p>")
    return _PAGE.format(title=html.escape(f"{name}: a design"), body="\n".join(parts))


def _loads(work: Design) -> str:
    """Describe the load cases of a design in one phrase."""
    scene = next(
        (tessellation.scene for tessellation in work.tessellations if tessellation.scene is not None),
        work.outline.scene,
    )
    loads = scene.loads
    cases = [case.name for case in loads.cases or []] + [vehicle.name for vehicle in loads.moving or []]
    if loads.pushes is not None:
        cases.append(loads.pushes.name)
    if cases:
        return f"several cases, of which the worst counts ({', '.join(cases)})"
    return "one live load, times λ"


def _tried(work: Design) -> list[dict[str, str]]:
    """Return one table row for each tessellation, with its bounds."""
    rows = []
    for tessellation in work.tessellations:
        its_trials = [trial for trial in work.trials if trial.tessellation == tessellation.name]
        row = {
            "tessellation": tessellation.words,
            "search": work.search_words.get(tessellation.name, tessellation.problem or "not begun"),
        }
        for kind, words in (("stated", "as stated"), ("searched", "searched"), ("moved", "moved")):
            trial_of_kind = next((trial for trial in its_trials if trial.kind == kind), None)
            row[f"λ by fields, {words}"] = "–" if trial_of_kind is None else _words_of_bounds(trial_of_kind)
        rows.append(row)
    return rows


def _words_of_bounds(trial: Trial) -> str:
    """Return the text for the λ of a trial: its bounds by fields if known, else λ by faces."""
    # With an upper bound alone both are given; below 0 it is "does not stand".
    low, high = trial.fields
    if math.isfinite(low):
        return f"{low:.4g} to {high:.4g}"
    if high < 0.0:
        return "does not stand"
    if math.isfinite(high):
        return f"at most {high:.4g} ({trial.by_faces})"
    return trial.by_faces


def _proven(work: Design) -> list[str]:
    sentences = []
    winner = work.winner
    if winner is not None and math.isfinite(winner.fields[0]):
        sentences.append(
            f"Proven: the best layout carries at least {winner.fields[0]:.4g} times the load in every load case. A "
            "stress field that nowhere exceeds the strengths was found and weighed."
        )
    elif winner is not None and math.isfinite(winner.fields[1]):
        sentences.append(
            f"Proven: the best layout carries at most {winner.fields[1]:.4g} times the load. No lower bound by fields "
            "was found in time: give more time, or jld solve DIR/best.json --cracks fields."
        )
    elif winner is not None:
        sentences.append(
            f"Proven for cracks along the faces of the cells: λ from {winner.faces[0]:.4g} to {winner.faces[1]:.4g}. "
            "Blocks that crack elsewhere may carry less."
        )
    for name, words in work.search_words.items():
        if re.match(r"\d+ layouts?, proven", words):
            crushed = "" if work.outline.scene.dimension == 3 else ", where faces crush as blocks do,"
            sentences.append(f"Proven: of the cells of {name}{crushed} no other choice of joints is stronger by faces.")
    tried = sum(tessellation.scene is not None for tessellation in work.tessellations)
    moved = any(trial.kind == "moved" for trial in work.trials)
    ends = "; moves end at a local best" if moved else ""
    kinds = "1 kind of cells was" if tried == 1 else f"{tried} kinds of cells were"
    sentences.append(f"Not proven: that no stronger layout exists. {kinds} tried{ends}.")
    if work.options.shapes is not None or work.options.laid is not None:
        sentences.append("Joints were not moved: a limit on shapes or on laying holds for the cells as they are.")
    return sentences


def _blocks(winner: Trial) -> list[dict[str, str]]:
    """Return one table row per block of the winner, by column."""
    assembly = build_assembly(winner.scene)
    layout = Layout(winner.scene, assembly, assembly.labels)
    mass = "mass, kg" if assembly.units == ("m", "N") else "mass, weight over gravity"
    return [
        {"stone": str(number), "shape": str(block.shape), mass: f"{block.mass:.4g}", "cells": str(block.cells)}
        for number, block in enumerate((candidate for candidate in layout.blocks if candidate.cells), 1)
    ]


def _next() -> list[str]:
    return [
        "jld report DIR --pdf: pages to print, with loads, blocks, moulds and the order of laying",
        "jld solve DIR/best.json --cracks fields: both bounds, narrower",
        "jld export DIR/best.json --format dxf -o blocks.dxf: the blocks as a drawing",
        "jld move DIR/best.json -o moved.json --seconds 600: joints moved further",
    ]


def _draw(work: Design, winner: Trial) -> None:
    """Draw the usual bond and the best layout with numbered blocks."""
    from jld_views import figures, writing

    trials = [trial for trial in (work.usual, winner) if trial is not None]
    assemblies = [built(trial) for trial in trials]
    figure, axes = figures.figure_for(assemblies[0], len(trials))
    for ax, trial, assembly in zip(axes, trials, assemblies, strict=True):
        figures.draw_assembly(ax, assembly, assembly.labels)
        title = "usual bond" if trial.kind == "stated" else f"best: {_name(trial)}"
        ax.set_title(
            f"{title}\nλ by fields {_words_of_bounds(trial)}" if math.isfinite(trial.fields[0]) else title, fontsize=9
        )
        if trial is winner:
            blocks = [block for block in Layout(trial.scene, assembly, assembly.labels).blocks if block.cells]
            elements, centroids = [block.elements for block in blocks], [block.centroid for block in blocks]
            writing.write_numbers(ax, assembly, elements, centroids)
    figures.finish(figure, axes, f"{work.outline.scene.name}: a design")
    figures.save_figure(figure, work.folder / FILES[3])


def _table(rows: list[dict[str, str]]) -> str:
    if not rows:
        return ""
    head = "".join(f"<th>{html.escape(name)}</th>" for name in rows[0])
    body = "".join("<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row.values()) + "</tr>" for row in rows)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def _list(items: Sequence[str]) -> str:
    return "<ul>" + "".join(f"<li>{html.escape(item)}</li>" for item in items) + "</ul>"


def _bounds(bounds: Bounds) -> list[float | None]:
    return [number(bounds[0]), number(bounds[1])]
