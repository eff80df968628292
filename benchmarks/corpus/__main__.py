"""Check every value of the corpus: ``python -m benchmarks.corpus [--quick] [--write]``; exit code 1 if one disagrees.

``--write`` also writes docs/validation.md and its picture, ``--quick`` leaves out what takes long.
"""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from benchmarks.common import ROOT, table
from benchmarks.corpus import CLASSES, RELATIONS, TIERS, Value, read
from jld_views.figures import save_figure

PAGE: Final = ROOT / "docs" / "validation.md"
PICTURE: Final = ROOT / "docs" / "images" / "corpus.png"
# mark of each tier in the picture
MARKS: Final = {"closed form": "o", "independent program": "s", "experiment": "^", "ours": "x"}
# text of the page above and below its tables
HEAD, END = (Path(__file__).parent / "page.md").read_text(encoding="utf-8").split("{rows}\n")
Pair = tuple[Value, tuple[float, float]]


def _number(value: float) -> str:
    return "no end" if math.isinf(value) else f"{value:.10g}"


def row(value: Value, ours: tuple[float, float]) -> list[str]:
    low, high = ours
    unit = f" {value.unit}" if value.unit else ""
    if value.relation == "inside":
        found, apart, allowed = f"{_number(low)} to {_number(high)}", "inside", "inside"
    elif value.relation == "falls":
        found = {(0.0, 0.0): "falls", (1.0, 1.0): "stands"}.get(ours, "undecided")
        apart, allowed = ("equal" if found == "falls" else "differs"), "equal"
    elif value.relation in ("above", "below"):
        digits = 1 if value.relation == "above" else 2
        found, apart, allowed = _number(high), f"{value.published / high:.{digits}f} times", value.relation
    else:
        found = _number(low) if low == high else f"{_number(low)} to {_number(high)}"
        difference = max(abs(one - value.published) for one in ours) / abs(value.published)
        apart = f"{difference:.0e}" if difference > 1e-13 else "0"
        allowed = f"{value.tolerance:.0e}"
    what = value.what + (f" ({value.why})" if value.why else "")
    published = "falls" if value.relation == "falls" else f"{value.published:.10g}{unit}"
    return [what, value.place or "–", published, found, apart, allowed]


def classified(pairs: list[Pair]) -> str:
    wrong = [value.what for value, ours in pairs if not value.agrees(ours)]
    counts = {relation: sum(value.relation == relation for value, _ in pairs) for relation in RELATIONS}
    said = ", ".join(f"{count} {relation}" for relation, count in counts.items() if count)
    listed = "\n".join(f"- {what}" for what in wrong)
    listed = f"{len(wrong)} of {len(pairs)}:\n\n{listed}\n" if wrong else f"None of {len(pairs)} ({said}).\n"
    lines = [f"## Rows that disagree\n\n{listed}\n## Rows that differ for a reason, by class\n"]
    lines.append(
        "*Bond*, *strength of fill* and *deformation* are what the scene leaves out. *Printed value*: the source"
    )
    lines.append("prints, beside or instead of the value, one that its own equations or matrices do not give.\n")
    for value in sorted((value for value, _ in pairs if value.kind), key=lambda value: CLASSES.index(value.kind)):
        published = f"{value.published:.6g} {value.unit}".strip()
        lines.append(f"- *{value.kind}*: {value.what}: published {published}; {value.why}")
    return "\n".join([*lines, ""])


def of_others(values: list[Value]) -> str:
    """Return the sentence that says how many values are by others, in space, and of experiments."""
    others = [value for value in values if value.source.tier != "ours" and not value.derived]
    spatial = sum(value.spatial for value in others)
    tests = sum(value.source.tier == "experiment" for value in others)
    return (
        f"By others: {len(others)}, of these {spatial} of structures in space and {tests} of experiments; "
        f"{len(values) - len(others)} closed forms were derived here."
    )


def page(pairs: list[Pair]) -> str:
    count = {tier: sum(value.source.tier == tier for value, _ in pairs) for tier in TIERS}
    parts = [
        HEAD,
        f"{len(pairs)} values: " + ", ".join(f"{count[tier]} {tier}" for tier in TIERS if count[tier])
        + f".\n{of_others([value for value, _ in pairs])}\n\n![Published values over ours: on the diagonal, or inside "
        "the proven interval drawn as a bar; tests lie above or below, those with bond furthest](images/corpus.png)\n",
    ]  # fmt: skip
    head = ["quantity", "place", "published", "ours", "difference", "allowed"]
    sources = {(value.source.key, value.source.tier): value.source for value, _ in pairs}
    for source in sorted(sources.values(), key=lambda one: TIERS.index(one.tier)):
        rows = [row(value, ours) for value, ours in pairs if value.source == source]
        link = f"\n{source.link}\n" if source.link else ""
        parts.append(f"## {source.tier.capitalize()}: {source.citation}\n{link}")
        parts.append(table(head, rows) + "\n")
    return "\n".join([*parts, classified(pairs)]) + END


def picture(pairs: list[Pair]) -> Figure:
    figure = Figure(figsize=(7.2, 5.4), layout="constrained")
    ax = figure.subplots()
    for tier in TIERS:
        shown = [(value, ours) for value, ours in pairs if value.source.tier == tier and value.relation != "falls"]
        if not shown:
            continue
        marks: list[tuple[float, ...]] = []
        for value, ours in shown:
            published = abs(value.published)
            low, high = sorted(math.copysign(end, end * value.published) for end in ours)
            if value.relation == "inside":
                # An end far away, or without bound, is drawn at 1/30 or 3 times the published value.
                low, high = (min(max(end, published / 30.0), 3.0 * published) for end in (low, high))
            middle = min(max(published, low), high)
            marks.append((middle, published, middle - low, high - middle))
        x, y, *bars = np.array(marks).T
        ax.errorbar(
            x, y, xerr=np.array(bars), fmt=MARKS[tier], markersize=6, markerfacecolor="none", capsize=2,
            linewidth=1.0, label=f"{tier} ({len(shown)})",
        )  # fmt: skip
    far = [(value, ours[1]) for value, ours in pairs if value.relation in ("above", "below")]
    far = [(value, own) for value, own in far if not 0.5 < value.published / own < 2.0]
    for k, (value, own) in enumerate(sorted(far, key=lambda one: one[0].published)):
        name = value.what.partition(":")[0].removeprefix("arch ")
        # The lowest label stands below its mark, as marks of one series lie close together.
        ax.annotate(name, (own, value.published), (6, 5 if k else -11), textcoords="offset points", fontsize=7)
    ends = np.array([1e-2, 1e6])
    ax.plot(ends, ends, color="#888888", linewidth=0.8, zorder=0)
    ax.set(
        xscale="log", yscale="log", xlabel="ours, in the unit of the row (bars: proven interval)",
        ylabel="published, in the unit of the row", title="Published values and ours",
    )  # fmt: skip
    ax.legend(frameon=False)
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.corpus", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="leave out values that take long")
    parser.add_argument("--write", action="store_true", help="write docs/validation.md and its picture")
    asked = parser.parse_args()
    pairs: list[Pair] = []
    wrong = 0
    for value in read():
        if value.slow and asked.quick:
            continue
        ours = value.ours()
        pairs.append((value, ours))
        agrees = value.agrees(ours)
        wrong += not agrees
        print(
            f"{'agrees   ' if agrees else 'DISAGREES'} {value.source.key}: {' | '.join(row(value, ours))}", flush=True
        )
    print(f"{len(pairs)} values, {wrong} disagree. {of_others([value for value, _ in pairs])}")
    if asked.write:
        PAGE.write_text(page(pairs), encoding="utf-8")
        save_figure(picture(pairs), PICTURE)
    if wrong:
        sys.exit(1)


if __name__ == "__main__":
    main()
